//! Several textures in one bind group and one shader.

use texfold_shaders::{Slot, paste};
use wgpu::{BindGroup, BindGroupLayout};

use crate::layouts::layout_of;
use crate::{Gpu, GpuError, GpuTexture};

/// One texture of a material.
#[derive(Debug, Clone, Copy)]
pub struct Layer<'a> {
    /// What its names in the shader begin with, in snake case: `albedo` for `albedo_sample(uv)`.
    pub prefix: &'a str,
    /// The texture.
    pub texture: &'a GpuTexture,
    /// Which of its images.
    pub image: u32,
}

/// Textures of any codecs, bound together.
#[derive(Debug)]
pub struct Material {
    layout: BindGroupLayout,
    bind_group: BindGroup,
    wgsl: String,
    constants: Vec<(String, f64)>,
    places: Vec<u32>,
}

impl Material {
    /// The layout of the bind group, for the renderer's pipeline layout.
    #[must_use]
    pub fn layout(&self) -> &BindGroupLayout {
        &self.layout
    }

    /// What to bind.
    #[must_use]
    pub fn bind_group(&self) -> &BindGroup {
        &self.bind_group
    }

    /// The functions of all textures, to put before the renderer's own shader.
    #[must_use]
    pub fn wgsl(&self) -> &str {
        &self.wgsl
    }

    /// For `PipelineCompilationOptions::constants`: 0 for every switch that no texture needs. Pipelines without them draw the
    /// same; software renderers draw it more slowly.
    #[must_use]
    pub fn constants(&self) -> Vec<(&str, f64)> {
        self.constants.iter().map(|(name, value)| (name.as_str(), *value)).collect()
    }

    /// The `image` argument of the functions of each texture that have one.
    #[must_use]
    pub fn places(&self) -> &[u32] {
        &self.places
    }
}

impl Gpu {
    /// Binds textures together, in group `group` of the renderer's shader. A texture that [`Gpu::update`] rebinds needs a new material.
    ///
    /// # Errors
    /// [`GpuError`] where an image does not exist, names collide, or the device binds fewer textures in one shader.
    pub fn material(&self, group: u32, layers: &[Layer<'_>]) -> Result<Material, GpuError> {
        let mut first_binding = 0;
        let (mut slots, mut entries) = (Vec::new(), Vec::new());
        let (mut constants, mut places) = (Vec::new(), Vec::new());
        for layer in layers {
            let slot = Slot::new(layer.texture.module, group, first_binding).named(layer.prefix);
            entries.extend(layer.texture.bind_entries(layer.image, &slot)?);
            constants.extend(layer.texture.constants(&slot));
            places.push(layer.texture.image(layer.image)?.place);
            first_binding = slot.bindings().end;
            slots.push(slot);
        }
        let textures: usize = slots.iter().map(|slot| slot.module().textures()).sum();
        let limit = self.device.limits().max_sampled_textures_per_shader_stage;
        if textures > limit as usize {
            return Err(GpuError::TooManyTextures { textures, limit });
        }
        let wgsl = paste(&slots)?;
        self.guarded(|| {
            let layout = layout_of(&self.device, slots.iter().map(Slot::module));
            let bind_group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("material"),
                layout: &layout,
                entries: &entries,
            });
            Ok(Material { layout, bind_group, wgsl, constants, places })
        })
    }
}
