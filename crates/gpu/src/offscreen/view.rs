//! Texels and filtered samples, read back exactly.
//!
//! An image is drawn in tiles, so its size is bound by the caller's memory and not by the device's.

use glam::{Affine2, Vec2};
use texfold_shaders::Entry;
use wgpu::{BindGroup, CommandEncoder, RenderPipeline, TextureFormat, TextureView};

use super::pipeline::{PipelineKey, Shader};
use crate::{Gpu, GpuError, GpuTexture};

/// Pixels a side of a tile: 64 MiB of four floats each.
const TILE_SIDE: u32 = 2048;

/// How a decoded image is filtered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Filter {
    /// The texel that a pixel's centre lies in.
    #[default]
    Nearest,
    /// The four texels around it, blended.
    Bilinear,
}

/// What is looked up at a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lookup {
    /// The texel of `level` at the pixel's own column and row, clamped to the level; texture coordinates do not count.
    Fetch {
        /// Mip level.
        level: u32,
    },
    /// The texel of `level` that the coordinate lies in.
    Nearest {
        /// Mip level.
        level: u32,
    },
    /// The four texels of `level` around the coordinate, blended.
    Bilinear {
        /// Mip level.
        level: u32,
    },
    /// As nearest, converted from sRGB to linear light.
    NearestLinear {
        /// Mip level.
        level: u32,
    },
    /// Trilinear at a mip level that may lie between two.
    Level {
        /// Mip level; clamped to those stored.
        lod: f32,
    },
    /// Trilinear at the mip level that fits the distance between pixels.
    Derivative,
}

/// A rectangle of texture coordinates to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Which image.
    pub image: u32,
    /// Columns and rows of the image.
    pub size: (u32, u32),
    /// From the image, (0, 0) its top left corner and (1, 1) its bottom right one, to texture coordinates.
    pub uv: Affine2,
    /// What is looked up at a pixel's centre.
    pub lookup: Lookup,
}

/// The shader's parameters for a [`View`].
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct ViewParams {
    uv_origin: Vec2,
    uv_across: Vec2,
    uv_down: Vec2,
    size: Vec2,
    offset: Vec2,
    lod: f32,
    level: u32,
    image: u32,
    reserved: u32,
}

impl Lookup {
    /// The entry point, its number for the lookup, the level and the fractional level.
    fn shader(self) -> (Entry, u32, u32, f32) {
        match self {
            Lookup::Fetch { level } => (Entry::Decode, 0, level, 0.0),
            Lookup::Nearest { level } => (Entry::Decode, 1, level, 0.0),
            Lookup::Bilinear { level } => (Entry::Decode, 2, level, 0.0),
            Lookup::NearestLinear { level } => (Entry::Decode, 3, level, 0.0),
            Lookup::Derivative => (Entry::Draw, 0, 0, 0.0),
            Lookup::Level { lod } => (Entry::Draw, 1, 0, lod),
        }
    }

    /// The shader for `texture`.
    pub(crate) fn shader_of(self, texture: &GpuTexture) -> Shader {
        let (entry, lookup, ..) = self.shader();
        Shader::View { module: texture.module(), entry, lookup, switches: texture.switches() }
    }
}

impl View {
    /// The whole of an image.
    #[must_use]
    pub fn whole(image: u32, size: (u32, u32), lookup: Lookup) -> View {
        View { image, size, uv: Affine2::IDENTITY, lookup }
    }

    /// The shader's parameters for the tile that starts at `offset`.
    pub(crate) fn params(&self, place: u32, offset: (u32, u32)) -> ViewParams {
        let (_, _, level, lod) = self.lookup.shader();
        ViewParams {
            uv_origin: self.uv.translation,
            uv_across: self.uv.matrix2.x_axis,
            uv_down: self.uv.matrix2.y_axis,
            size: Vec2::new(self.size.0 as f32, self.size.1 as f32),
            offset: Vec2::new(offset.0 as f32, offset.1 as f32),
            lod,
            level,
            image: place,
            reserved: 0,
        }
    }
}

impl GpuTexture {
    /// A bit for each of the module's switches that an image needs.
    pub(super) fn switches(&self) -> u32 {
        self.bound.switches
    }

    /// Whether a plane may be smaller than its source.
    pub(super) fn reduced(&self) -> bool {
        self.module.may_be_reduced && self.bound.switches & 1 != 0
    }
}

impl Gpu {
    /// Mip level `level` of image `image`, scaled to `size` pixels: the level's own size gives its texels.
    ///
    /// # Errors
    /// [`GpuError`] where there is no such image or level, or the device fails.
    pub fn decode(
        &self,
        texture: &GpuTexture,
        image: u32,
        level: u32,
        size: (u32, u32),
        filter: Filter,
    ) -> Result<Vec<[f32; 4]>, GpuError> {
        self.read_view(texture, &View::whole(image, size, lookup(filter, level)))
    }

    /// As [`Gpu::decode`], rounded to bytes.
    ///
    /// # Errors
    /// As [`Gpu::decode`].
    pub fn decode_rgba8(
        &self,
        texture: &GpuTexture,
        image: u32,
        level: u32,
        size: (u32, u32),
        filter: Filter,
    ) -> Result<Vec<[u8; 4]>, GpuError> {
        self.read_view_rgba8(texture, &View::whole(image, size, lookup(filter, level)))
    }

    /// The pixels of a view, row by row, as computed.
    ///
    /// # Errors
    /// [`GpuError`] where there is no such image or level, or the device fails.
    pub fn read_view(&self, texture: &GpuTexture, view: &View) -> Result<Vec<[f32; 4]>, GpuError> {
        self.tiles(texture, view, TextureFormat::Rgba32Float)
    }

    /// The pixels of a view, row by row, rounded to bytes.
    ///
    /// # Errors
    /// As [`Gpu::read_view`].
    pub fn read_view_rgba8(&self, texture: &GpuTexture, view: &View) -> Result<Vec<[u8; 4]>, GpuError> {
        self.tiles(texture, view, TextureFormat::Rgba8Unorm)
    }

    fn tiles<P: bytemuck::Pod>(
        &self,
        texture: &GpuTexture,
        view: &View,
        format: TextureFormat,
    ) -> Result<Vec<P>, GpuError> {
        check(texture, view)?;
        let (width, height) = view.size;
        let shader = view.lookup.shader_of(texture);
        let pipeline = self.pipeline(PipelineKey { shader, target: format })?;
        let mut pixels = vec![P::zeroed(); width as usize * height as usize];
        for top in (0..height).step_by(TILE_SIDE as usize) {
            for left in (0..width).step_by(TILE_SIDE as usize) {
                let size = ((width - left).min(TILE_SIDE), (height - top).min(TILE_SIDE));
                self.guarded(|| {
                    let target = self.target(format, size);
                    let (textures, place) = texture.bind_group(view.image)?;
                    let job = self.job_group(bytemuck::bytes_of(&view.params(place, (left, top))));
                    let mut encoder =
                        self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                    cover(
                        &mut encoder,
                        &target.create_view(&wgpu::TextureViewDescriptor::default()),
                        &pipeline,
                        [textures, &job],
                    );
                    self.read_rows(encoder, &target, |y, line| {
                        let start = (top + y) as usize * width as usize + left as usize;
                        let line = line.chunks_exact(size_of::<P>()).map(bytemuck::pod_read_unaligned);
                        pixels[start..start + size.0 as usize]
                            .iter_mut()
                            .zip(line)
                            .for_each(|(to, from)| *to = from);
                    })
                })?;
            }
        }
        Ok(pixels)
    }
}

fn lookup(filter: Filter, level: u32) -> Lookup {
    match filter {
        Filter::Nearest => Lookup::Nearest { level },
        Filter::Bilinear => Lookup::Bilinear { level },
    }
}

/// Whether image, level and size exist.
pub(crate) fn check(texture: &GpuTexture, view: &View) -> Result<(), GpuError> {
    let levels = texture.levels(view.image)?;
    let (_, _, level, _) = view.lookup.shader();
    if level >= levels {
        return Err(GpuError::NoSuchLevel { level, levels });
    }
    let (width, height) = view.size;
    if width == 0 || height == 0 || u64::from(width) * u64::from(height) > u64::from(u32::MAX) {
        return Err(GpuError::ImageSize { width, height, limit: u32::from(u16::MAX) });
    }
    Ok(())
}

/// Draws over the whole of `target`.
pub(crate) fn cover(
    encoder: &mut CommandEncoder,
    target: &TextureView,
    pipeline: &RenderPipeline,
    groups: [&BindGroup; 2],
) {
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("cover"),
        color_attachments: &[Some(clear(target))],
        ..Default::default()
    });
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, groups[0], &[]);
    pass.set_bind_group(1, groups[1], &[]);
    pass.draw(0..3, 0..1);
}

/// `target`, cleared to transparent black first.
pub(crate) fn clear(target: &TextureView) -> wgpu::RenderPassColorAttachment<'_> {
    wgpu::RenderPassColorAttachment {
        view: target,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations {
            load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
            store: wgpu::StoreOp::Store,
        },
    }
}
