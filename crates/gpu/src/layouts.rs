//! Bind group layouts.

use texfold_shaders::{Binding, MODULES, ModuleInfo};
use wgpu::{
    BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry, BindingType, BufferBindingType, Device,
    ShaderStages, TextureSampleType, TextureViewDimension,
};

/// Layouts of the modules' bind groups, one for each row of [`MODULES`].
#[derive(Debug)]
pub(crate) struct Layouts(Vec<BindGroupLayout>);

impl Layouts {
    pub(crate) fn new(device: &Device) -> Self {
        let module =
            |module: &ModuleInfo| layout(device, module.name, module.bindings.iter().map(binding_type));
        Layouts(MODULES.iter().map(module).collect())
    }

    pub(crate) fn of(&self, module: &'static ModuleInfo) -> &BindGroupLayout {
        // Every module there is is a row of the table.
        let row = MODULES.iter().position(|row| row == module).unwrap_or_default();
        &self.0[row]
    }
}

/// What a layout says of a binding.
fn binding_type(binding: &Binding) -> BindingType {
    match binding {
        Binding::Params { bytes } => uniform(std::num::NonZeroU64::new(*bytes)),
        Binding::Uint => texture(TextureSampleType::Uint),
        Binding::Float => texture(TextureSampleType::Float { filterable: false }),
    }
}

/// A layout of bindings of these modules, one module behind the other.
pub(crate) fn layout_of<'m>(
    device: &Device,
    modules: impl Iterator<Item = &'m ModuleInfo>,
) -> BindGroupLayout {
    layout(device, "material", modules.flat_map(|module| module.bindings).map(binding_type))
}

pub(crate) fn layout(
    device: &Device,
    label: &str,
    types: impl Iterator<Item = BindingType>,
) -> BindGroupLayout {
    let entry = |(binding, ty)| BindGroupLayoutEntry {
        binding,
        visibility: ShaderStages::VERTEX_FRAGMENT | ShaderStages::COMPUTE,
        ty,
        count: None,
    };
    let entries: Vec<_> = (0..).zip(types).map(entry).collect();
    device.create_bind_group_layout(&BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

pub(crate) fn uniform(min_binding_size: Option<std::num::NonZeroU64>) -> BindingType {
    BindingType::Buffer { ty: BufferBindingType::Uniform, has_dynamic_offset: false, min_binding_size }
}

pub(crate) fn texture(sample_type: TextureSampleType) -> BindingType {
    BindingType::Texture { sample_type, view_dimension: TextureViewDimension::D2, multisampled: false }
}
