//! Pipelines and meshes of a window.

#[path = "../../gpu/examples/support/pipeline.rs"]
pub(crate) mod pipeline;

use glam::{Mat4, Vec2, Vec3};
use texfold_gpu::{Gpu, wgpu};

use pipeline::{Corners, Entries};

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

/// A shader's pipeline, and the parameters in its group 1.
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
        let (params, group) = pipeline::uniform(device, size_of::<Params>());
        let uniform = pipeline::uniform_layout(device);
        let layouts = [Some(wgpu::VertexBufferLayout {
            array_stride: size_of::<Corner>() as u64,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x2, 2 => Uint32],
        })];
        let corners =
            if has_corners { Corners { layouts: &layouts, ..Corners::NUMBERED } } else { Corners::NUMBERED };
        let entries = Entries { vertex: "vertex_main", fragment: "fragment_main" };
        let groups = [Some(textures), Some(&uniform)];
        let pipeline = pipeline::pipeline(device, (source, entries), &groups, &[], corners, format);
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
