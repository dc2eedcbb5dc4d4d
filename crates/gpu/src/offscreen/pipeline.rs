//! Pipelines of off-screen drawing, each made once.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use texfold_shaders::{Entry, ModuleInfo, Switch};
use wgpu::{
    BindGroupLayout, BindingType, Device, RenderPipeline, SamplerBindingType, TextureFormat,
    TextureSampleType,
};

use crate::layouts::{layout, texture, uniform};
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

/// Pipelines made so far, and the layouts of their bind groups beside those of modules.
#[derive(Debug)]
pub(crate) struct Pipelines {
    known: Mutex<HashMap<PipelineKey, RenderPipeline>>,
    /// A plain texture and a sampler.
    pub(crate) plain: BindGroupLayout,
    /// The parameters of an entry point.
    job: BindGroupLayout,
}

impl Pipelines {
    pub(crate) fn new(device: &Device) -> Self {
        let float = TextureSampleType::Float { filterable: true };
        let plain = [texture(float), BindingType::Sampler(SamplerBindingType::Filtering)];
        let plain = layout(device, "plain", plain.into_iter());
        let job = layout(device, "job", [uniform(None)].into_iter());
        Pipelines { known: Mutex::default(), plain, job }
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

impl Gpu {
    /// The pipeline of `key`, made on first use.
    pub(crate) fn pipeline(&self, key: PipelineKey) -> Result<RenderPipeline, GpuError> {
        let mut known = self.offscreen.known.lock().unwrap_or_else(PoisonError::into_inner);
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
            Shader::Plain => (texfold_shaders::plain(), &self.offscreen.plain),
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
            bind_group_layouts: &[Some(textures), Some(&self.offscreen.job)],
            immediate_size: 0,
        });
        let corners = [CORNER_LAYOUT.into()];
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
            layout: &self.offscreen.job,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
        })
    }
}
