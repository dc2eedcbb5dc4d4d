//! Pipelines with a depth buffer, and the uniform of a camera in a group of its own.
#![allow(dead_code, reason = "each renderer uses its own part")]

use texfold_gpu::wgpu;

/// Format of depths.
pub(crate) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Layout of a uniform buffer alone in its group.
pub(crate) fn uniform_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("camera"),
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        }],
    })
}

/// A uniform buffer of so many bytes, and its group.
pub(crate) fn uniform(device: &wgpu::Device, bytes: usize) -> (wgpu::Buffer, wgpu::BindGroup) {
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("camera"),
        size: bytes as u64,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &uniform_layout(device),
        entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
    });
    (buffer, group)
}

/// The functions of a pipeline's shader.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Entries<'e> {
    pub(crate) vertex: &'e str,
    pub(crate) fragment: &'e str,
}

/// What a pipeline draws: the layout of its corners, and how they make triangles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Corners<'c> {
    pub(crate) layouts: &'c [Option<wgpu::VertexBufferLayout<'c>>],
    pub(crate) topology: wgpu::PrimitiveTopology,
}

impl Corners<'_> {
    /// Triangles whose corners the shader finds by their numbers.
    pub(crate) const NUMBERED: Corners<'static> =
        Corners { layouts: &[], topology: wgpu::PrimitiveTopology::TriangleList };
}

/// A pipeline that draws what is nearest.
pub(crate) fn pipeline(
    device: &wgpu::Device,
    (source, entries): (String, Entries<'_>),
    groups: &[Option<&wgpu::BindGroupLayout>],
    constants: &[(&str, f64)],
    corners: Corners<'_>,
    format: wgpu::TextureFormat,
) -> wgpu::RenderPipeline {
    let source = wgpu::ShaderSource::Wgsl(source.into());
    let shader = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
    let layout = wgpu::PipelineLayoutDescriptor { bind_group_layouts: groups, ..Default::default() };
    let options = wgpu::PipelineCompilationOptions { constants, ..Default::default() };
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: Some(&device.create_pipeline_layout(&layout)),
        vertex: wgpu::VertexState {
            module: &shader,
            entry_point: Some(entries.vertex),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: corners.layouts,
        },
        primitive: wgpu::PrimitiveState { topology: corners.topology, ..Default::default() },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Less),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &shader,
            entry_point: Some(entries.fragment),
            compilation_options: options,
            targets: &[Some(format.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Begins a pass of which image and depths are clear.
pub(crate) fn pass<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    (image, depth): (&wgpu::TextureView, &wgpu::TextureView),
    sky: wgpu::Color,
) -> wgpu::RenderPass<'e> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: image,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(sky), store: wgpu::StoreOp::Store },
        })],
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: depth,
            depth_ops: Some(wgpu::Operations {
                load: wgpu::LoadOp::Clear(1.0),
                store: wgpu::StoreOp::Discard,
            }),
            stencil_ops: None,
        }),
        ..Default::default()
    })
}
