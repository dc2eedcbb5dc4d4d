//! From planes in memory to textures, buffers and bind groups.

use std::collections::HashMap;

use texfold_core::{DecodedImage, GpuDct, GpuForm, ImageBinding, ImageSize, Plane, PlaneFormat, Rect};
use texfold_shaders::{Binding, ModuleInfo};
use wgpu::{BufferUsages, Texture, TextureFormat, TextureUsages};

use crate::texture::{Bound, DECODED_FORMAT, GpuPlane, Group, Surface, entries};
use crate::{Gpu, GpuError, GpuTexture};

/// The module that reads plain texels.
pub(crate) const PLAIN_MODULE: &str = "bc";
/// Name of textures that blocks are decoded to.
const DECODED_PART: &str = "decoded blocks";

impl Gpu {
    /// Uploads all planes and parameters of an encoded texture. Textures in blocks are decoded, all mip levels of all images, into
    /// plain textures: `rgba8unorm`, or `rgba32float` for samples of more than 8 bits.
    ///
    /// # Errors
    /// [`GpuError`] where the device cannot hold or sample it.
    pub fn upload(&self, form: &GpuForm<'_>) -> Result<GpuTexture, GpuError> {
        let module = module_of(form)?;
        let decoded = self.decode_images(form)?;
        self.guarded(|| {
            let planes = self.upload_planes(form, decoded)?;
            let bound = self.bind_all(module, form, &planes)?;
            Ok(GpuTexture { module, planes, bound, address_mode: None, queue: self.queue.clone() })
        })
    }

    /// The images of a form that are in blocks, decoded.
    pub(crate) fn decode_images(&self, form: &GpuForm<'_>) -> Result<Vec<GpuPlane>, GpuError> {
        let stages = form.blocks.chunk_by(|one, other| one.image == other.image);
        stages.map(|stages| self.decode_blocks(stages)).collect()
    }

    /// All planes of a form, and behind them the images that were decoded.
    pub(crate) fn upload_planes(
        &self,
        form: &GpuForm<'_>,
        decoded: Vec<GpuPlane>,
    ) -> Result<Vec<GpuPlane>, GpuError> {
        let planes = form.planes.iter().map(|plane| self.upload_plane(plane));
        planes.chain(decoded.into_iter().map(Ok)).collect()
    }

    /// The mip levels of an image in blocks, decoded from its stages, of which there is at least one; or its only level from
    /// textures one below the other.
    fn decode_blocks(&self, stages: &[GpuDct<'_>]) -> Result<GpuPlane, GpuError> {
        let decoder = self.block_decoder()?;
        let Some(decoded) = DecodedImage::of(stages) else {
            return Err(GpuError::Form { what: "an image has no stage" });
        };
        let ImageSize { width, height } = decoded.size;
        let limit = self.side_limit();
        if width > limit || height > limit {
            return Err(GpuError::PlaneTooLarge { width, height, limit });
        }
        let format = if decoded.depth > 8 { TextureFormat::Rgba32Float } else { DECODED_FORMAT };
        let srgb = (format == DECODED_FORMAT).then(|| format.add_srgb_suffix());
        let texture = self.guarded(|| {
            Ok(self.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(DECODED_PART),
                size: extent(width, height),
                mip_level_count: decoded.levels,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: TextureUsages::TEXTURE_BINDING | TextureUsages::STORAGE_BINDING,
                view_formats: srgb.as_slice(),
            }))
        })?;
        for stage in stages {
            let image = decoder.upload(self, stage)?;
            if decoded.is_stacked {
                let ImageSize { width, height } = stage.layout.size;
                let rect = Rect { image: 0, level: 0, x: 0, y: 0, width, height };
                decoder.decode_into(self, &image, rect, image.colours(), &texture, [0, stage.row])?;
                continue;
            }
            decoder.decode_levels(self, &image, image.colours(), &texture, (stage.level, stage.levels))?;
        }
        Ok(GpuPlane { part: DECODED_PART, texture, bytes: decoded.bits() / 8 })
    }

    /// One plane with its mip levels.
    pub(crate) fn upload_plane(&self, plane: &Plane<'_>) -> Result<GpuPlane, GpuError> {
        let shape = self.shape(plane)?;
        let texture = self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(plane.part),
            size: shape.size,
            mip_level_count: shape.levels,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: shape.format,
            usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let bytes = self.write_plane(&texture, plane)?;
        Ok(GpuPlane { part: plane.part, texture, bytes })
    }

    /// The texture that holds a plane: on this device, if it can.
    pub(crate) fn shape(&self, plane: &Plane<'_>) -> Result<Shape, GpuError> {
        let limit = self.side_limit();
        let (width, height) = (plane.width, plane.height);
        let size = whole_blocks(plane.format, width, height);
        if size.width > limit || size.height > limit {
            return Err(GpuError::PlaneTooLarge { width, height, limit });
        }
        if !self.can_sample(plane.format) {
            return Err(GpuError::NoBlockCompression { format: plane.format });
        }
        Ok(Shape { size, levels: levels_of(plane), format: texture_format(plane.format) })
    }

    /// Writes all levels of a plane into a texture of its shape; returns the bytes written.
    pub(crate) fn write_plane(&self, texture: &Texture, plane: &Plane<'_>) -> Result<u64, GpuError> {
        let mut start = 0;
        for (level, (width, height, length)) in (0..levels_of(plane)).zip(plane.level_sizes()) {
            let end = start + length as usize;
            let data = plane.data.get(start..end).ok_or(GpuError::Form { what: "a plane is too short" })?;
            let size = whole_blocks(plane.format, width, height);
            self.write_level(texture, plane.format, level, size, data);
            start = end;
        }
        Ok(start as u64)
    }

    fn write_level(
        &self,
        texture: &Texture,
        format: PlaneFormat,
        mip_level: u32,
        size: wgpu::Extent3d,
        data: &[u8],
    ) {
        let target = wgpu::TexelCopyTextureInfo { mip_level, ..texture.as_image_copy() };
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(size.width / format.block_side() * format.block_bytes()),
            rows_per_image: None,
        };
        self.queue.write_texture(target, data, layout, size);
    }

    /// The bind groups of all images: images with the same parameters and planes share one.
    pub(crate) fn bind_all(
        &self,
        module: &'static ModuleInfo,
        form: &GpuForm<'_>,
        planes: &[GpuPlane],
    ) -> Result<Bound, GpuError> {
        let mut bound = Bound { bindings: form.images.clone(), ..Bound::default() };
        let mut known = HashMap::new();
        for binding in &form.images {
            let key = (binding.uniforms.start, binding.planes.clone());
            let group = *known.entry(key).or_insert(bound.groups.len());
            if group == bound.groups.len() {
                bound.groups.push(self.bind(module, form, binding, planes)?);
            }
            bound.images.push(describe(module, group, form, binding)?);
            bound.switches |= switches_of(module, params_of(module, form, binding)?);
        }
        Ok(bound)
    }

    pub(crate) fn bind(
        &self,
        module: &'static ModuleInfo,
        form: &GpuForm<'_>,
        binding: &ImageBinding,
        planes: &[GpuPlane],
    ) -> Result<Group, GpuError> {
        let bytes = params_of(module, form, binding)?;
        let params: Vec<_> =
            blocks(module, bytes).map(|block| self.buffer("params", block, BufferUsages::UNIFORM)).collect();
        let view = |&plane: &usize| {
            let plane: &GpuPlane = planes.get(plane)?;
            Some(plane.texture.create_view(&wgpu::TextureViewDescriptor::default()))
        };
        let views: Option<Vec<_>> = binding.planes.iter().map(view).collect();
        let views = views.ok_or(GpuError::Form { what: "an image names a plane that does not exist" })?;
        if views.len() != module.textures() {
            return Err(GpuError::Form { what: "an image has another number of planes than its shader" });
        }
        let bind_group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(module.name),
            layout: self.layouts.of(module),
            entries: &entries(module, &params, &views, 0),
        });
        Ok(Group { params, params_bytes: bytes.len() as u64, views, bind_group })
    }
}

/// Size, mip levels and format of a texture that holds a plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Shape {
    pub(crate) size: wgpu::Extent3d,
    pub(crate) levels: u32,
    pub(crate) format: TextureFormat,
}

impl Shape {
    /// That of a texture.
    pub(crate) fn of(texture: &Texture) -> Self {
        Shape { size: texture.size(), levels: texture.mip_level_count(), format: texture.format() }
    }
}

/// The module that samples a form.
pub(crate) fn module_of(form: &GpuForm<'_>) -> Result<&'static ModuleInfo, GpuError> {
    texfold_shaders::module(form.module).ok_or(GpuError::UnknownModule { module: form.module })
}

/// WebGPU asks for whole blocks at level 0; the shaders know the true size from the parameters.
fn whole_blocks(format: PlaneFormat, width: u32, height: u32) -> wgpu::Extent3d {
    let side = format.block_side();
    extent(width.next_multiple_of(side), height.next_multiple_of(side))
}

/// Levels of the texture of a plane. Levels beyond 1 x 1 repeat the last: a texture cannot hold them, and the shaders do not read
/// them.
fn levels_of(plane: &Plane<'_>) -> u32 {
    plane.levels.clamp(1, ImageSize { width: plane.width, height: plane.height }.full_levels())
}

/// The blocks of parameters that the bytes of one image hold, one behind the other.
pub(crate) fn blocks<'p>(module: &'static ModuleInfo, params: &'p [u8]) -> impl Iterator<Item = &'p [u8]> {
    module.bindings.iter().filter_map(params_bytes).scan(params, |rest, bytes| {
        let (block, behind) = rest.split_at_checked(bytes)?;
        *rest = behind;
        Some(block)
    })
}

/// Bytes of a binding of parameters.
fn params_bytes(binding: &Binding) -> Option<usize> {
    match binding {
        Binding::Params { bytes } => Some(*bytes as usize),
        Binding::Uint | Binding::Float => None,
    }
}

/// A bit for each of the module's switches that an image with these parameters needs.
pub(crate) fn switches_of(module: &ModuleInfo, params: &[u8]) -> u32 {
    (0..).zip(module.switches).map(|(bit, switch)| u32::from(switch.is_needed(params)) << bit).sum()
}

/// The parameters of one image, checked for length.
pub(crate) fn params_of<'f>(
    module: &ModuleInfo,
    form: &'f GpuForm<'_>,
    binding: &ImageBinding,
) -> Result<&'f [u8], GpuError> {
    let params = form.uniforms.get(binding.uniforms.clone());
    let wanted: usize = module.bindings.iter().filter_map(params_bytes).sum();
    params
        .filter(|params| params.len() == wanted)
        .ok_or(GpuError::Form { what: "an image has parameters of another length than its shader" })
}

/// Size and levels of one image, from its parameters.
pub(crate) fn describe(
    module: &ModuleInfo,
    group: usize,
    form: &GpuForm<'_>,
    binding: &ImageBinding,
) -> Result<Surface, GpuError> {
    let params = params_of(module, form, binding)?;
    let size = ImageSize { width: number(params, 0), height: number(params, 4) };
    let offsets = module.image().ok_or(GpuError::Form { what: "a light field is no image" })?;
    // The module of plain texels reads such a texture as it is; others read content from it.
    let decoded = binding.planes.iter().copied().find(|&plane| plane >= form.planes.len());
    let decoded = decoded.filter(|_| module.name == PLAIN_MODULE);
    Ok(Surface { group, place: binding.image, size, levels: number(params, offsets.levels), decoded })
}

/// The 32-bit number at `offset` of the parameters.
pub(crate) fn number(params: &[u8], offset: usize) -> u32 {
    let bytes = params.get(offset..offset + 4).and_then(|bytes| bytes.try_into().ok());
    bytes.map_or(0, u32::from_le_bytes)
}

pub(crate) fn extent(width: u32, height: u32) -> wgpu::Extent3d {
    wgpu::Extent3d { width, height, depth_or_array_layers: 1 }
}

fn texture_format(format: PlaneFormat) -> TextureFormat {
    match format {
        PlaneFormat::Rg8Uint => TextureFormat::Rg8Uint,
        PlaneFormat::R32Uint => TextureFormat::R32Uint,
        PlaneFormat::Rgba32Uint => TextureFormat::Rgba32Uint,
        PlaneFormat::R8Unorm => TextureFormat::R8Unorm,
        PlaneFormat::Rg8Unorm => TextureFormat::Rg8Unorm,
        PlaneFormat::Rgba8Unorm => TextureFormat::Rgba8Unorm,
        PlaneFormat::Bc1 => TextureFormat::Bc1RgbaUnorm,
        PlaneFormat::Bc3 => TextureFormat::Bc3RgbaUnorm,
        PlaneFormat::Bc4 => TextureFormat::Bc4RUnorm,
        PlaneFormat::Bc5 => TextureFormat::Bc5RgUnorm,
        PlaneFormat::Bc7 => TextureFormat::Bc7RgbaUnorm,
    }
}
