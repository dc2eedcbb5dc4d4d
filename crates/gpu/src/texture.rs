//! A texture on the GPU: what is bound to draw its images.

use texfold_core::{ImageBinding, ImageSize};
use texfold_shaders::{Binding, ModuleInfo, Slot};
use wgpu::{BindGroup, BindGroupEntry, BindingResource, Buffer, Queue, Texture, TextureView};

#[cfg(doc)]
use crate::Gpu;
use crate::GpuError;

/// Format of textures that blocks are decoded to; `rgba32float` for samples of more than 8 bits.
pub(crate) const DECODED_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// What lies outside of [0, 1) in texture coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum AddressMode {
    /// The image again.
    Repeat,
    /// The texels of its edge.
    Clamp,
}

impl AddressMode {
    /// The shaders' number for it.
    fn number(self) -> u32 {
        match self {
            AddressMode::Repeat => texfold_core::address::TEXFOLD_REPEAT,
            AddressMode::Clamp => texfold_core::address::TEXFOLD_CLAMP,
        }
    }
}

/// A texture on the GPU.
#[derive(Debug)]
pub struct GpuTexture {
    pub(crate) module: &'static ModuleInfo,
    pub(crate) planes: Vec<GpuPlane>,
    pub(crate) bound: Bound,
    /// The mode that was set last; before that the one of the parameters.
    pub(crate) address_mode: Option<AddressMode>,
    pub(crate) queue: Queue,
}

/// A plane with its mip levels.
#[derive(Debug, Clone)]
pub(crate) struct GpuPlane {
    /// The part of the texture that it holds.
    pub(crate) part: &'static str,
    pub(crate) texture: Texture,
    /// Bytes of its texels.
    pub(crate) bytes: u64,
}

/// The images of a texture, and what is bound to draw them.
#[derive(Debug, Default)]
pub(crate) struct Bound {
    pub(crate) groups: Vec<Group>,
    pub(crate) images: Vec<Surface>,
    /// A bit for each of the module's switches that an image needs.
    pub(crate) switches: u32,
    /// The bindings of the form that it was made from.
    pub(crate) bindings: Vec<ImageBinding>,
}

/// What is bound to draw some of the images.
#[derive(Debug)]
pub(crate) struct Group {
    /// The blocks of parameters, in the order of the module's bindings.
    pub(crate) params: Vec<Buffer>,
    /// Bytes of all blocks.
    pub(crate) params_bytes: u64,
    /// The planes, in the order of the module's bindings.
    pub(crate) views: Vec<TextureView>,
    pub(crate) bind_group: BindGroup,
}

/// One image.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Surface {
    pub(crate) group: usize,
    /// The shader's `image` argument.
    pub(crate) place: u32,
    pub(crate) size: ImageSize,
    pub(crate) levels: u32,
    /// The plane that holds the image's own texels, decoded.
    pub(crate) decoded: Option<usize>,
}

/// The entries of a bind group for one texture, numbered from `first` on.
pub(crate) fn entries<'g>(
    module: &ModuleInfo,
    params: &'g [Buffer],
    views: &'g [TextureView],
    first: u32,
) -> Vec<BindGroupEntry<'g>> {
    let (mut params, mut views) = (params.iter(), views.iter());
    let resource = |binding: &Binding| match binding {
        Binding::Params { .. } => params.next().map(Buffer::as_entire_binding),
        Binding::Uint | Binding::Float => views.next().map(BindingResource::TextureView),
    };
    (first..)
        .zip(module.bindings.iter().filter_map(resource))
        .map(|(binding, resource)| BindGroupEntry { binding, resource })
        .collect()
}

impl GpuTexture {
    /// The WGSL module that samples it.
    #[must_use]
    pub fn module(&self) -> &'static ModuleInfo {
        self.module
    }

    /// The module's switches as they are named in `slot`, each with 1 where an image of this texture needs it and 0 elsewhere: for
    /// `PipelineCompilationOptions::constants` of pipelines that draw this texture. Without them a pipeline draws the same, and
    /// more slowly on software renderers.
    #[must_use]
    pub fn constants(&self, slot: &Slot<'_>) -> Vec<(String, f64)> {
        let of = |(bit, switch): (u32, &texfold_shaders::Switch)| {
            (slot.name(switch.constant), f64::from(self.bound.switches >> bit & 1))
        };
        (0..).zip(self.module.switches).map(of).collect()
    }

    /// Number of images.
    #[must_use]
    pub fn images(&self) -> usize {
        self.bound.images.len()
    }

    /// Bytes of texels and parameters on the GPU.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let planes: u64 = self.planes.iter().map(|plane| plane.bytes).sum();
        planes + self.bound.groups.iter().map(|group| group.params_bytes).sum::<u64>()
    }

    /// What to bind to draw image `image`, and the `image` argument of the module's functions for it.
    ///
    /// # Errors
    /// [`GpuError::NoSuchImage`].
    pub fn bind_group(&self, image: u32) -> Result<(&BindGroup, u32), GpuError> {
        let found = self.image(image)?;
        Ok((&self.bound.groups[found.group].bind_group, found.place))
    }

    /// As [`GpuTexture::bind_group`], for a bind group of a renderer's own: the entries of image `image`, numbered as in `slot`.
    ///
    /// # Errors
    /// [`GpuError::NoSuchImage`].
    pub fn bind_entries(&self, image: u32, slot: &Slot<'_>) -> Result<Vec<BindGroupEntry<'_>>, GpuError> {
        let group = &self.bound.groups[self.image(image)?.group];
        Ok(entries(self.module, &group.params, &group.views, slot.bindings().start))
    }

    /// Plain texels of image `image`, which [`Gpu::upload`] has decoded from blocks, with its mip levels: a view for samplers of any
    /// kind, anisotropic ones among them, and for WGSL of the renderer's own (`textureSample`). With `srgb` the sampler converts colours
    /// to linear light before it filters; normals and other data take `false`. Filterable; images of more than 8 bits a
    /// sample are `rgba32float`, which samplers filter on devices with [`wgpu::Features::FLOAT32_FILTERABLE`], and have no sRGB view.
    ///
    /// # Errors
    /// [`GpuError::NoSuchImage`]; [`GpuError::NotDecoded`] where texels are read from the compressed form, and for sRGB views of
    /// more than 8 bits.
    pub fn decoded_view(&self, image: u32, srgb: bool) -> Result<TextureView, GpuError> {
        let plane = self.image(image)?.decoded.and_then(|plane| self.planes.get(plane));
        let texture = &plane.ok_or(GpuError::NotDecoded { image, module: self.module.name })?.texture;
        if srgb && texture.format() != DECODED_FORMAT {
            return Err(GpuError::NotDecoded { image, module: self.module.name });
        }
        Ok(texture.create_view(&wgpu::TextureViewDescriptor {
            format: Some(if srgb { DECODED_FORMAT.add_srgb_suffix() } else { texture.format() }),
            usage: Some(wgpu::TextureUsages::TEXTURE_BINDING),
            ..Default::default()
        }))
    }

    /// Columns and rows of image `image`, level 0.
    ///
    /// # Errors
    /// [`GpuError::NoSuchImage`].
    pub fn size(&self, image: u32) -> Result<ImageSize, GpuError> {
        Ok(self.image(image)?.size)
    }

    /// Mip levels of image `image`.
    ///
    /// # Errors
    /// [`GpuError::NoSuchImage`].
    pub fn levels(&self, image: u32) -> Result<u32, GpuError> {
        Ok(self.image(image)?.levels)
    }

    /// The same texture with another address mode for all of its images.
    #[must_use]
    pub fn with_address_mode(mut self, mode: AddressMode) -> GpuTexture {
        self.address_mode = Some(mode);
        self.write_address_mode();
        self
    }

    /// Writes the mode that was set, if any, into all parameters.
    pub(crate) fn write_address_mode(&self) {
        let (Some(mode), Some(offsets)) = (self.address_mode, self.module.image()) else { return };
        for params in self.bound.groups.iter().filter_map(|group| group.params.first()) {
            self.queue.write_buffer(params, offsets.address_mode as u64, &mode.number().to_le_bytes());
        }
    }

    pub(crate) fn image(&self, image: u32) -> Result<&Surface, GpuError> {
        let images = self.bound.images.len();
        self.bound.images.get(image as usize).ok_or(GpuError::NoSuchImage { image, images })
    }
}
