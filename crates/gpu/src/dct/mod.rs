//! Textures in blocks of variable length, decoded by compute passes into textures that the hardware samples.
//!
//! [`DctDecoder`] makes its pipelines once; [`DctDecoder::upload`] takes what an encoded texture hands out
//! ([`GpuDct`]) and [`DctDecoder::decode_into`] decodes any rectangle, or the same of two smaller mip levels, into any place of a texture, so that a
//! cache of tiles can be filled with it. An invocation a superblock reads its stream, of all planes that the rectangle needs at once. Then, for
//! each plane from the coarsest on, an invocation a block and axis makes its samples, and where the image is deblocked two more
//! filter its borders to the left and above; last, an invocation a texel makes its
//! channels. All in integers: the texels are the CPU's.
//!
//! Cost: 4.3 bytes of scratch memory a texel and axis, [`MAX_SCRATCH`] at most, kept by the decoder for all textures.
//! An H200 decodes 1.9 gigatexels/s of textures of 2048 texels a side: streams are read symbol by symbol, which takes most of the time.
//! On one core (`examples/dct.rs`, kodim08 and kodim19 at 0.9 to 2 bits) llvmpipe takes 10 to 14 times as long as the
//! CPU's decoder. More in `benches/gpu.md`.
//!
//! *Any bytes decode*: nothing is checked when a texture is uploaded. The shader looks for a stream's end before it reads, and whatever it
//! reads leads to places inside of its buffers and to loops of bounded length.

mod image;
mod pipelines;

use std::sync::{Mutex, PoisonError};

use texfold_core::{GpuDct, ImageSize, Rect, RegionError};
use texfold_shaders::{DctEntry, DctProgram, DctTarget};
use wgpu::{BindingResource, Buffer, BufferBinding, BufferUsages, Texture, TextureUsages};

pub use image::DctImage;
use pipelines::{Pipelines, format_of};
pub use texfold_shaders::{DctChannel, MAX_SCRATCH};

use crate::upload::extent;
use crate::{Gpu, GpuError};

/// Pipelines that decode textures in blocks, and their scratch memory.
#[derive(Debug)]
pub struct DctDecoder {
    pipelines: Pipelines,
    /// Grows to what the largest rectangle needs.
    scratch: Mutex<Option<Buffer>>,
}

impl DctDecoder {
    /// Makes the pipelines.
    ///
    /// # Errors
    /// [`GpuError`] where the device has no compute shaders or refuses them.
    pub fn new(gpu: &Gpu) -> Result<DctDecoder, GpuError> {
        let pipelines = gpu.guarded(|| Ok(Pipelines::new(&gpu.device)))?;
        Ok(DctDecoder { pipelines, scratch: Mutex::new(None) })
    }

    /// Uploads a texture: its streams as they are stored, and 16 kB of tables.
    ///
    /// # Errors
    /// [`GpuError`] where the streams do not fit a buffer of the device, or the device refuses.
    pub fn upload(&self, gpu: &Gpu, blocks: &GpuDct<'_>) -> Result<DctImage, GpuError> {
        DctImage::new(gpu, blocks)
    }

    /// A rectangle as a texture of its own, `rgba8unorm` for samples of 8 bits and `rgba16uint` for more. `rect.level` is a
    /// mip level; `rect.image` is 0.
    ///
    /// # Errors
    /// [`GpuError`] where there is no such level or channel, the rectangle is empty, leaves the level or is larger than a texture
    /// of the device, or the device fails.
    pub fn decode(
        &self,
        gpu: &Gpu,
        image: &DctImage,
        rect: Rect,
        channels: [DctChannel; 4],
    ) -> Result<Texture, GpuError> {
        let (width, height, limit) = (rect.width, rect.height, gpu.side_limit());
        if width == 0 || height == 0 || width > limit || height > limit {
            return Err(GpuError::ImageSize { width, height, limit });
        }
        let texture = gpu.guarded(|| {
            Ok(gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("blocks"),
                size: extent(width, height),
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: format_of(plain(image.layout.depth)),
                usage: TextureUsages::STORAGE_BINDING
                    | TextureUsages::TEXTURE_BINDING
                    | TextureUsages::COPY_SRC,
                view_formats: &[],
            }))
        })?;
        self.decode_into(gpu, image, rect, channels, &texture, [0, 0])?;
        Ok(texture)
    }

    /// A rectangle into a texture of the format that [`DctDecoder::decode`] gives, or `rgba32float`, from `place` on. The texture allows
    /// [`TextureUsages::STORAGE_BINDING`].
    ///
    /// # Errors
    /// As [`DctDecoder::decode`], and where the texture has another format or the rectangle does not fit it.
    pub fn decode_into(
        &self,
        gpu: &Gpu,
        image: &DctImage,
        rect: Rect,
        channels: [DctChannel; 4],
        texture: &Texture,
        place: [u32; 2],
    ) -> Result<(), GpuError> {
        let fits = |place: u32, count: u32, all: u32| place.checked_add(count).is_some_and(|end| end <= all);
        let size = (texture.width(), texture.height());
        if !fits(place[0], rect.width, size.0) || !fits(place[1], rect.height, size.1) {
            return Err(RegionError::Outside { width: size.0, height: size.1 }.into());
        }
        let target = target_of(texture, image.layout.depth)?;
        let program = DctProgram::new(&image.layout, rect, channels, place, MAX_SCRATCH)?;
        gpu.guarded(|| self.submit(gpu, image, &program, target, &[view_of(texture, 0)]))
    }

    /// An image and the levels that are made of it into those of a texture, from mip level `first` on; its streams are read once.
    ///
    /// # Errors
    /// As [`DctDecoder::decode_into`].
    pub fn decode_levels(
        &self,
        gpu: &Gpu,
        image: &DctImage,
        channels: [DctChannel; 4],
        texture: &Texture,
        (first, levels): (u32, u32),
    ) -> Result<(), GpuError> {
        let size = image.layout.size;
        let level_size = ImageSize { width: texture.width(), height: texture.height() }.at_level(first);
        if level_size != size || first + levels > texture.mip_level_count() {
            return Err(RegionError::Outside { width: level_size.width, height: level_size.height }.into());
        }
        let target = target_of(texture, image.layout.depth)?;
        let program = DctProgram::levels(&image.layout, channels, levels, MAX_SCRATCH)?;
        let views: Vec<_> = (first..first + levels).map(|level| view_of(texture, level)).collect();
        gpu.guarded(|| self.submit(gpu, image, &program, target, &views))
    }

    /// Does the dispatches of a program, which writes to levels of a target.
    fn submit(
        &self,
        gpu: &Gpu,
        image: &DctImage,
        program: &DctProgram,
        target: DctTarget,
        levels: &[wgpu::TextureView],
    ) -> Result<(), GpuError> {
        let scratch = self.scratch(gpu, program.scratch);
        let passes = gpu.buffer("passes", &program.passes, BufferUsages::UNIFORM);
        let outputs = gpu.buffer("outputs", &program.outputs, BufferUsages::UNIFORM);
        let group = self.pipelines.pass_group(&gpu.device, &passes, image, &scratch);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        for part in program.dispatches.chunk_by(|_, next| !next.clears) {
            encoder.clear_buffer(&scratch, 0, Some(program.scratch));
            let mut compute = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            for dispatch in part {
                compute.set_pipeline(self.pipelines.of(&gpu.device, dispatch.entry, target));
                compute.set_bind_group(0, &group, &[dispatch.pass]);
                if dispatch.entry == DctEntry::Write {
                    let view = &levels[dispatch.level as usize];
                    let output = (&outputs, u64::from(dispatch.output));
                    compute.set_bind_group(
                        1,
                        &self.pipelines.output_group(&gpu.device, target, output, view),
                        &[],
                    );
                }
                let [x, y, z] = dispatch.groups;
                compute.dispatch_workgroups(x, y, z);
            }
        }
        gpu.queue.submit([encoder.finish()]);
        Ok(())
    }

    /// Scratch memory of at least so many bytes.
    fn scratch(&self, gpu: &Gpu, bytes: u64) -> Buffer {
        let mut kept = self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        match &*kept {
            Some(buffer) if buffer.size() >= bytes => buffer.clone(),
            _ => {
                let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("scratch of blocks"),
                    size: bytes,
                    usage: BufferUsages::STORAGE | BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                });
                kept.insert(buffer).clone()
            }
        }
    }
}

/// What a texture takes, by its format; it must suit samples of that depth.
fn target_of(texture: &Texture, depth: u8) -> Result<DctTarget, GpuError> {
    let suits = |target: &DctTarget| {
        format_of(*target) == texture.format() && (*target == DctTarget::Float32 || *target == plain(depth))
    };
    let found = DctTarget::ALL.into_iter().find(suits);
    let found = found.filter(|_| texture.usage().contains(TextureUsages::STORAGE_BINDING));
    found.ok_or(GpuError::DctTarget { format: format_of(plain(depth)) })
}

/// The target that takes samples of that depth as they are.
fn plain(depth: u8) -> DctTarget {
    if depth > 8 { DctTarget::Uint16 } else { DctTarget::Unorm8 }
}

fn view_of(texture: &Texture, level: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        base_mip_level: level,
        mip_level_count: Some(1),
        array_layer_count: Some(1),
        dimension: Some(wgpu::TextureViewDimension::D2),
        ..Default::default()
    })
}

/// A buffer from a byte on: all of it, or as many bytes as parameters take.
fn bound(buffer: &Buffer, offset: u64, size: Option<usize>) -> BindingResource<'_> {
    let size = size.and_then(|size| std::num::NonZeroU64::new(size as u64));
    BindingResource::Buffer(BufferBinding { buffer, offset, size })
}
