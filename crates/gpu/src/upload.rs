//! From planes in memory to textures, buffers and bind groups.

use std::collections::HashMap;

use texfold_core::{AstcBlock, GpuForm, Plane, PlaneFormat, SurfaceBinding, SurfaceSize};
use texfold_shaders::Binding;
use wgpu::{BindGroup, Buffer, BufferUsages, Queue, Texture, TextureFormat, TextureUsages};

use crate::{Gpu, GpuError, Module};

/// What lies outside of [0, 1) in texture coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum AddressMode {
    /// The image again.
    Repeat,
    /// The texels of its edge.
    Clamp,
}

/// A texture on the GPU.
#[derive(Debug)]
pub struct GpuTexture {
    module: Module,
    groups: Vec<Group>,
    surfaces: Vec<Surface>,
    /// A bit for each of the module's switches that an image needs.
    switches: u32,
    bytes: u64,
    queue: Queue,
}

/// What is bound to draw some of the images.
#[derive(Debug)]
pub(crate) struct Group {
    pub(crate) params: Buffer,
    pub(crate) bind_group: BindGroup,
}

/// One image.
#[derive(Debug, Clone, Copy)]
struct Surface {
    group: usize,
    /// The shader's `surface` argument.
    place: u32,
    size: SurfaceSize,
    levels: u32,
}

impl GpuTexture {
    /// The WGSL module that samples it.
    #[must_use]
    pub fn module(&self) -> Module {
        self.module
    }

    /// A bit for each of the module's switches that an image needs.
    pub(crate) fn switches(&self) -> u32 {
        self.switches
    }

    /// Whether a plane may be smaller than its source.
    pub(crate) fn reduced(&self) -> bool {
        self.module.may_be_reduced() && self.switches & 1 != 0
    }

    /// Number of images.
    #[must_use]
    pub fn surfaces(&self) -> usize {
        self.surfaces.len()
    }

    /// Bytes of texels and parameters that were uploaded.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// What to bind to draw image `surface`, and the `surface` argument of the module's functions for it.
    ///
    /// # Errors
    /// [`GpuError::NoSuchSurface`].
    pub fn bind_group(&self, surface: u32) -> Result<(&BindGroup, u32), GpuError> {
        let found = self.surface(surface)?;
        Ok((&self.groups[found.group].bind_group, found.place))
    }

    /// Columns and rows of image `surface`, level 0.
    ///
    /// # Errors
    /// [`GpuError::NoSuchSurface`].
    pub fn size(&self, surface: u32) -> Result<SurfaceSize, GpuError> {
        Ok(self.surface(surface)?.size)
    }

    /// Mip levels of image `surface`.
    ///
    /// # Errors
    /// [`GpuError::NoSuchSurface`].
    pub fn levels(&self, surface: u32) -> Result<u32, GpuError> {
        Ok(self.surface(surface)?.levels)
    }

    /// The same texture with another address mode for all of its images.
    #[must_use]
    pub fn with_address_mode(self, mode: AddressMode) -> GpuTexture {
        let number = match mode {
            AddressMode::Repeat => texfold_core::address::TEXFOLD_REPEAT,
            AddressMode::Clamp => texfold_core::address::TEXFOLD_CLAMP,
        };
        if let Some(offset) = self.module.address_mode_offset() {
            for group in &self.groups {
                self.queue.write_buffer(&group.params, offset as u64, &number.to_le_bytes());
            }
        }
        self
    }

    fn surface(&self, surface: u32) -> Result<&Surface, GpuError> {
        let surfaces = self.surfaces.len();
        self.surfaces.get(surface as usize).ok_or(GpuError::NoSuchSurface { surface, surfaces })
    }
}

impl Gpu {
    /// Uploads all planes and parameters of an encoded texture.
    ///
    /// # Errors
    /// [`GpuError`] where the device cannot hold or sample it.
    pub fn upload(&self, form: &GpuForm<'_>) -> Result<GpuTexture, GpuError> {
        let module = Module::by_name(form.module).ok_or(GpuError::UnknownModule { module: form.module })?;
        self.guarded(|| {
            let (planes, bytes) = self.upload_planes(form)?;
            let mut texture = GpuTexture {
                module,
                groups: Vec::new(),
                surfaces: Vec::new(),
                switches: 0,
                bytes,
                queue: self.queue.clone(),
            };
            let mut known = HashMap::new();
            for binding in &form.surfaces {
                let key = (binding.uniforms.start, binding.planes.clone());
                let group = *known.entry(key).or_insert(texture.groups.len());
                if group == texture.groups.len() {
                    texture.bytes += binding.uniforms.len() as u64;
                    texture.groups.push(self.bind(module, form, binding, &planes)?);
                }
                texture.surfaces.push(describe(module, group, form, binding)?);
                let params = params_of(module, form, binding)?;
                for (bit, switch) in (0..).zip(module.switches()) {
                    texture.switches |= u32::from(switch.is_needed(params)) << bit;
                }
            }
            Ok(texture)
        })
    }

    /// All planes; also the bytes written.
    pub(crate) fn upload_planes(&self, form: &GpuForm<'_>) -> Result<(Vec<Texture>, u64), GpuError> {
        let (mut planes, mut bytes) = (Vec::new(), 0);
        for plane in &form.planes {
            let (texture, written) = self.upload_plane(plane)?;
            planes.push(texture);
            bytes += written;
        }
        Ok((planes, bytes))
    }

    /// One plane with its mip levels; also the bytes written.
    fn upload_plane(&self, plane: &Plane<'_>) -> Result<(Texture, u64), GpuError> {
        let limit = self.side_limit();
        // WebGPU asks for whole blocks at level 0; the shaders know the true size from the parameters.
        let whole = |side: u32| side.next_multiple_of(plane.format.block_side());
        let (width, height) = (plane.width, plane.height);
        if whole(width) > limit || whole(height) > limit {
            return Err(GpuError::PlaneTooLarge { width, height, limit });
        }
        if !self.can_sample(plane.format) {
            return Err(GpuError::NoBlockCompression { format: plane.format });
        }
        // Levels beyond 1 x 1 repeat the last: a texture cannot hold them, and the shaders do not read them.
        let levels = plane.levels.clamp(1, SurfaceSize { width, height }.full_levels());
        let texture = self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(plane.part),
            size: extent(whole(width), whole(height)),
            mip_level_count: levels,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: texture_format(plane.format),
            usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let mut start = 0;
        for (level, (width, height, length)) in (0..levels).zip(plane.level_sizes()) {
            let end = start + length as usize;
            let data = plane.data.get(start..end).ok_or(GpuError::Form { what: "a plane is too short" })?;
            self.write_level(&texture, plane.format, level, extent(whole(width), whole(height)), data);
            start = end;
        }
        Ok((texture, start as u64))
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

    pub(crate) fn bind(
        &self,
        module: Module,
        form: &GpuForm<'_>,
        binding: &SurfaceBinding,
        planes: &[Texture],
    ) -> Result<Group, GpuError> {
        let mut rest = params_of(module, form, binding)?;
        let mut params = Vec::new();
        for bytes in module.bindings().iter().filter_map(params_bytes) {
            let (own, behind) = rest.split_at(bytes);
            params.push(self.buffer("params", own, BufferUsages::UNIFORM));
            rest = behind;
        }
        let views: Option<Vec<_>> = binding
            .planes
            .iter()
            .map(|&plane| {
                planes.get(plane).map(|plane| plane.create_view(&wgpu::TextureViewDescriptor::default()))
            })
            .collect();
        let views = views.ok_or(GpuError::Form { what: "an image names a plane that does not exist" })?;
        if views.len() + params.len() != module.bindings().len() {
            return Err(GpuError::Form { what: "an image has another number of planes than its shader" });
        }
        let (mut textures, mut buffers) = (views.iter(), params.iter());
        let mut resource = |binding: &Binding| match binding {
            Binding::Params { .. } => buffers.next().map(Buffer::as_entire_binding),
            Binding::Uint | Binding::Float => textures.next().map(wgpu::BindingResource::TextureView),
        };
        let entries: Vec<_> = (0..)
            .zip(module.bindings().iter().filter_map(&mut resource))
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let bind_group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(module.name()),
            layout: self.layouts.of(module),
            entries: &entries,
        });
        let params =
            params.into_iter().next().ok_or(GpuError::Form { what: "a shader without parameters" })?;
        Ok(Group { params, bind_group })
    }
}

/// Bytes of a binding of parameters.
fn params_bytes(binding: &Binding) -> Option<usize> {
    match binding {
        Binding::Params { bytes } => Some(*bytes as usize),
        Binding::Uint | Binding::Float => None,
    }
}

/// The parameters of one image, checked for length.
fn params_of<'f>(
    module: Module,
    form: &'f GpuForm<'_>,
    binding: &SurfaceBinding,
) -> Result<&'f [u8], GpuError> {
    let params = form.uniforms.get(binding.uniforms.clone());
    let wanted: usize = module.bindings().iter().filter_map(params_bytes).sum();
    params
        .filter(|params| params.len() == wanted)
        .ok_or(GpuError::Form { what: "an image has parameters of another length than its shader" })
}

/// Size and levels of one image, from its parameters.
fn describe(
    module: Module,
    group: usize,
    form: &GpuForm<'_>,
    binding: &SurfaceBinding,
) -> Result<Surface, GpuError> {
    let params = params_of(module, form, binding)?;
    let size = SurfaceSize { width: number(params, 0), height: number(params, 4) };
    let levels = module.levels_offset().ok_or(GpuError::Form { what: "a light field is no image" })?;
    Ok(Surface { group, place: binding.surface, size, levels: number(params, levels) })
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
        PlaneFormat::Astc(block) => {
            let block = match block {
                AstcBlock::B4 => wgpu::AstcBlock::B4x4,
                AstcBlock::B5 => wgpu::AstcBlock::B5x5,
                AstcBlock::B6 => wgpu::AstcBlock::B6x6,
                AstcBlock::B8 => wgpu::AstcBlock::B8x8,
                AstcBlock::B10 => wgpu::AstcBlock::B10x10,
                AstcBlock::B12 => wgpu::AstcBlock::B12x12,
            };
            TextureFormat::Astc { block, channel: wgpu::AstcChannel::Unorm }
        }
    }
}
