//! Bind group layouts and pipelines, each made once.

use std::sync::PoisonError;

use texfold_shaders::{Binding, Entry, MODULES, ModuleInfo, Switch};
use wgpu::{
    BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry, BindingType, BufferBindingType, Device,
    RenderPipeline, SamplerBindingType, ShaderStages, TextureFormat, TextureSampleType, TextureViewDimension,
};

use crate::{Gpu, GpuError};

/// Depth buffer of meshes.
pub(crate) const DEPTH_FORMAT: TextureFormat = TextureFormat::Depth32Float;

/// Position (three floats) and texture coordinate (two floats) of a mesh's corner.
const CORNER_LAYOUT: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
    array_stride: 20,
    step_mode: wgpu::VertexStepMode::Vertex,
    attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x2],
};

/// Which shader a pipeline runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Shader {
    /// One of ours over a rectangle of texture coordinates.
    View {
        module: &'static ModuleInfo,
        entry: Entry,
        /// The number of its lookup.
        lookup: u32,
        /// A bit for each of the module's switches that is on.
        switches: u32,
    },
    /// A mesh with a module's texture.
    Mesh(&'static ModuleInfo),
    /// A light field on its mesh.
    Light(&'static ModuleInfo),
    /// A plain texture and a sampler.
    Plain,
}

/// What tells pipelines apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct PipelineKey {
    pub(crate) shader: Shader,
    pub(crate) target: TextureFormat,
}

/// Layouts of all bind groups.
#[derive(Debug)]
pub(crate) struct Layouts {
    /// One for each row of [`MODULES`].
    modules: Vec<BindGroupLayout>,
    /// A plain texture and a sampler.
    pub(crate) plain: BindGroupLayout,
    /// The parameters of an entry point.
    pub(crate) job: BindGroupLayout,
}

impl Layouts {
    pub(crate) fn new(device: &Device) -> Self {
        let modules = MODULES.iter().map(|module| module_layout(device, module)).collect();
        let float = TextureSampleType::Float { filterable: true };
        let plain = [texture(float), BindingType::Sampler(SamplerBindingType::Filtering)];
        let plain = layout(device, "plain", plain.into_iter());
        let job = layout(device, "job", [uniform(None)].into_iter());
        Layouts { modules, plain, job }
    }

    pub(crate) fn of(&self, module: &'static ModuleInfo) -> &BindGroupLayout {
        // Every module there is is a row of the table.
        let row = MODULES.iter().position(|row| row == module).unwrap_or_default();
        &self.modules[row]
    }
}

fn nearest_in_front() -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format: DEPTH_FORMAT,
        depth_write_enabled: Some(true),
        depth_compare: Some(wgpu::CompareFunction::Less),
        stencil: wgpu::StencilState::default(),
        bias: wgpu::DepthBiasState::default(),
    }
}

fn module_layout(device: &Device, module: &ModuleInfo) -> BindGroupLayout {
    layout(device, module.name, module.bindings.iter().map(binding_type))
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

fn layout(device: &Device, label: &str, types: impl Iterator<Item = BindingType>) -> BindGroupLayout {
    let entry = |(binding, ty)| BindGroupLayoutEntry {
        binding,
        visibility: ShaderStages::VERTEX_FRAGMENT | ShaderStages::COMPUTE,
        ty,
        count: None,
    };
    let entries: Vec<_> = (0..).zip(types).map(entry).collect();
    device.create_bind_group_layout(&BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

fn uniform(min_binding_size: Option<std::num::NonZeroU64>) -> BindingType {
    BindingType::Buffer { ty: BufferBindingType::Uniform, has_dynamic_offset: false, min_binding_size }
}

fn texture(sample_type: TextureSampleType) -> BindingType {
    BindingType::Texture { sample_type, view_dimension: TextureViewDimension::D2, multisampled: false }
}

impl Gpu {
    /// The pipeline of `key`, made on first use.
    pub(crate) fn pipeline(&self, key: PipelineKey) -> Result<RenderPipeline, GpuError> {
        let mut known = self.pipelines.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(pipeline) = known.get(&key) {
            return Ok(pipeline.clone());
        }
        let made = self.guarded(|| Ok(self.make_pipeline(key)))?;
        known.insert(key, made.clone());
        Ok(made)
    }

    fn make_pipeline(&self, PipelineKey { shader, target }: PipelineKey) -> RenderPipeline {
        let (source, textures) = match shader {
            Shader::View { module, entry, .. } => {
                (texfold_shaders::entry(module, entry), self.layouts.of(module))
            }
            Shader::Mesh(module) => (texfold_shaders::entry(module, Entry::Mesh), self.layouts.of(module)),
            Shader::Light(module) => (texfold_shaders::light(module), self.layouts.of(module)),
            Shader::Plain => (texfold_shaders::plain(), &self.layouts.plain),
        };
        let is_mesh = matches!(shader, Shader::Mesh(_));
        let has_depth = is_mesh || matches!(shader, Shader::Light(_));
        let constants: Vec<(&str, f64)> = match shader {
            Shader::View { module, lookup, switches, .. } => {
                let on = |(bit, switch): (u32, &Switch)| (switch.constant, f64::from(switches >> bit & 1));
                let switches = (0..).zip(module.switches).map(on);
                std::iter::once(("LOOKUP", f64::from(lookup))).chain(switches).collect()
            }
            Shader::Mesh(_) | Shader::Light(_) | Shader::Plain => Vec::new(),
        };
        let module = self.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("texfold"),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let layout = self.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("texfold"),
            bind_group_layouts: &[Some(textures), Some(&self.layouts.job)],
            immediate_size: 0,
        });
        let corners = [Some(CORNER_LAYOUT)];
        self.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("texfold"),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vertex_main"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: if is_mesh { &corners } else { &[] },
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: has_depth.then(nearest_in_front),
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("fragment_main"),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &constants,
                    ..Default::default()
                },
                targets: &[Some(target.into())],
            }),
            multiview_mask: None,
            cache: None,
        })
    }

    /// The bind group of an entry point's parameters.
    pub(crate) fn job_group(&self, params: &[u8]) -> wgpu::BindGroup {
        let buffer = self.buffer("job", params, wgpu::BufferUsages::UNIFORM);
        self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("job"),
            layout: &self.layouts.job,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
        })
    }

    /// A buffer that holds `bytes`.
    pub(crate) fn buffer(&self, label: &str, bytes: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.len() as u64,
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }
}
