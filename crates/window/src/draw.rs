//! Pipelines and passes of a window.

use glam::{Mat4, Vec2, Vec3};
use texfold_gpu::{Gpu, wgpu};

/// Format of depths.
pub(crate) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// A corner of a mesh; the texture is one of a cache of tiles.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct Corner {
    pub(crate) position: Vec3,
    pub(crate) uv: Vec2,
    pub(crate) texture: u32,
}

/// Parameters of all shaders here: those of light fields take the eye, the others an image.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct Params {
    pub(crate) projection: Mat4,
    pub(crate) rest: [u32; 4],
}

impl Params {
    pub(crate) fn of_eye(projection: Mat4, eye: Vec3) -> Params {
        let [x, y, z] = eye.to_array().map(f32::to_bits);
        Params { projection, rest: [x, y, z, 0] }
    }

    pub(crate) fn of_image(projection: Mat4, image: u32) -> Params {
        Params { projection, rest: [image, 0, 0, 0] }
    }
}

/// Textures of a cache of tiles on a mesh; the cache's functions stand before it.
pub(crate) const TILED: &str = "
struct Scene { projection: mat4x4<f32>, image: u32 }
@group(1) @binding(0) var<uniform> scene: Scene;

struct Varying { @builtin(position) clip: vec4<f32>, @location(0) uv: vec2<f32>, @location(1) @interpolate(flat) texture: u32 }

@vertex
fn vertex_main(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>, @location(2) texture: u32) -> Varying {
    return Varying(scene.projection * vec4<f32>(position, 1.0), uv, texture + scene.image);
}

@fragment
fn fragment_main(in: Varying) -> @location(0) vec4<f32> {
    return vec4<f32>(texfold_tile_sample(in.texture, in.uv).xyz, 1.0);
}
";

/// What is drawn by one shader: a pipeline, and the parameters in its group 1.
pub(crate) struct Drawing {
    pub(crate) pipeline: wgpu::RenderPipeline,
    pub(crate) params: wgpu::Buffer,
    pub(crate) group: wgpu::BindGroup,
}

impl Drawing {
    /// A shader with `vertex_main` and `fragment_main`, textures in group 0 and [`Params`] in group 1.
    pub(crate) fn new(
        gpu: &Gpu,
        source: String,
        textures: &wgpu::BindGroupLayout,
        has_corners: bool,
        format: wgpu::TextureFormat,
    ) -> Drawing {
        let device = gpu.device();
        let params = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("camera"),
            size: size_of::<Params>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let uniform = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
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
        });
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &uniform,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: params.as_entire_binding() }],
        });
        let shader = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let groups = [Some(textures), Some(&uniform)];
        let layout = wgpu::PipelineLayoutDescriptor { bind_group_layouts: &groups, ..Default::default() };
        let attributes = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x2, 2 => Uint32];
        let corners = [Some(wgpu::VertexBufferLayout {
            array_stride: size_of::<Corner>() as u64,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &attributes,
        })];
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: None,
            layout: Some(&device.create_pipeline_layout(&layout)),
            vertex: wgpu::VertexState {
                module: &shader,
                entry_point: Some("vertex_main"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: if has_corners { &corners } else { &[] },
            },
            primitive: wgpu::PrimitiveState::default(),
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
                entry_point: Some("fragment_main"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(format.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        Drawing { pipeline, params, group }
    }

    /// Sets pipeline and parameters of a pass.
    pub(crate) fn begin(&self, gpu: &Gpu, pass: &mut wgpu::RenderPass<'_>, params: &Params) {
        gpu.queue().write_buffer(&self.params, 0, bytemuck::bytes_of(params));
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(1, &self.group, &[]);
    }
}

/// A mesh on the GPU.
pub(crate) struct Mesh {
    corners: wgpu::Buffer,
    indices: wgpu::Buffer,
    count: u32,
}

impl Mesh {
    pub(crate) fn new(gpu: &Gpu, corners: &[Corner], triangles: &[[u32; 3]]) -> Mesh {
        let buffer = |bytes: &[u8], usage| {
            let buffer = gpu.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some("mesh"),
                size: bytes.len() as u64,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            gpu.queue().write_buffer(&buffer, 0, bytes);
            buffer
        };
        Mesh {
            corners: buffer(bytemuck::cast_slice(corners), wgpu::BufferUsages::VERTEX),
            indices: buffer(bytemuck::cast_slice(triangles), wgpu::BufferUsages::INDEX),
            count: 3 * triangles.len() as u32,
        }
    }

    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_vertex_buffer(0, self.corners.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..self.count, 0, 0..1);
    }
}

/// The pass of a frame, whose image and depths are clear.
pub(crate) fn pass<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    view: &wgpu::TextureView,
    depth: &wgpu::TextureView,
) -> wgpu::RenderPass<'e> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color { r: 0.2, g: 0.22, b: 0.25, a: 1.0 }),
                store: wgpu::StoreOp::Store,
            },
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
