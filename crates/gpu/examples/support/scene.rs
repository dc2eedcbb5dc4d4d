//! A scene of textured rectangles, drawn from a cache of tiles in one draw or from plain textures in one for each.
#![allow(dead_code, reason = "each renderer uses its own part")]

#[path = "pipeline.rs"]
pub(crate) mod pipeline;

use bytemuck::{Pod, Zeroable};
use glam::camera::rh::proj::directx::perspective;
use glam::camera::rh::view::look_at_mat4;
use glam::{Mat4, Vec3};
use texfold_gpu::{Gpu, TileCache, wgpu};

use pipeline::{Corners, Entries};

/// Format of what is drawn into.
pub(crate) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;

/// A rectangle: its corner at texture coordinates (0, 0) and its sides, along which coordinates grow to `repeats`.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Quad {
    pub(crate) corner: Vec3,
    pub(crate) across: Vec3,
    pub(crate) down: Vec3,
    pub(crate) repeats: [f32; 2],
    pub(crate) texture: u32,
}

const ATTRIBUTES: [wgpu::VertexAttribute; 5] =
    wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Float32x3, 3 => Float32x2, 4 => Uint32];

const VERTICES: &str = "
struct Varying { @builtin(position) clip: vec4<f32>, @location(0) uv: vec2<f32>, @location(1) @interpolate(flat) texture: u32 }

@group(1) @binding(0) var<uniform> camera: mat4x4<f32>;

@vertex
fn vs(
    @builtin(vertex_index) index: u32,
    @location(0) corner: vec3<f32>,
    @location(1) across: vec3<f32>,
    @location(2) down: vec3<f32>,
    @location(3) repeats: vec2<f32>,
    @location(4) texture: u32,
) -> Varying {
    let at = vec2<f32>(f32(index & 1u), f32(index >> 1u));
    let place = corner + across * at.x + down * at.y;
    return Varying(camera * vec4<f32>(place, 1.0), at * repeats, texture);
}
";

const TILED: &str = "
@fragment
fn fs(in: Varying) -> @location(0) vec4<f32> {
    return texfold_tile_sample(in.texture, in.uv);
}
";

/// Rectangles and what draws them.
pub(crate) struct Scene {
    pipeline: wgpu::RenderPipeline,
    quads: wgpu::Buffer,
    count: u32,
    camera: wgpu::Buffer,
    camera_group: wgpu::BindGroup,
    target: wgpu::Texture,
    depth: wgpu::TextureView,
}

impl Scene {
    /// A scene whose rectangles are drawn from a cache of tiles.
    pub(crate) fn tiled(gpu: &Gpu, cache: &TileCache, quads: &[Quad], size: (u32, u32)) -> Scene {
        // All of them are colours: the other half of each lookup is left out.
        let constants = [("TEXFOLD_TILE_COLOURS", 1.0)];
        Scene::new(gpu, &[&cache.wgsl(0), TILED].concat(), cache.bind_group_layout(), &constants, quads, size)
    }

    /// A scene with fragments of its own, `fs`, the layout of its group 0 and constants.
    pub(crate) fn new(
        gpu: &Gpu,
        fragments: &str,
        textures: &wgpu::BindGroupLayout,
        constants: &[(&str, f64)],
        quads: &[Quad],
        (width, height): (u32, u32),
    ) -> Scene {
        let device = gpu.device();
        let buffer = |bytes: &[u8], usage| {
            let buffer = device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: bytes.len() as u64,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            gpu.queue().write_buffer(&buffer, 0, bytes);
            buffer
        };
        let uniform = pipeline::uniform_layout(device);
        let groups = [Some(textures), Some(&uniform)];
        let quads_layout = wgpu::VertexBufferLayout {
            array_stride: size_of::<Quad>() as u64,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: &ATTRIBUTES,
        };
        let corners =
            Corners { layouts: &[Some(quads_layout)], topology: wgpu::PrimitiveTopology::TriangleStrip };
        let entries = Entries { vertex: "vs", fragment: "fs" };
        let shader = ([VERTICES, fragments].concat(), entries);
        let pipeline = pipeline::pipeline(device, shader, &groups, constants, corners, FORMAT);
        let (camera, camera_group) = pipeline::uniform(device, size_of::<Mat4>());
        let texture = |format, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let attached = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let depth = texture(pipeline::DEPTH, attached).create_view(&wgpu::TextureViewDescriptor::default());
        Scene {
            pipeline,
            quads: buffer(bytemuck::cast_slice(quads), wgpu::BufferUsages::VERTEX),
            count: quads.len() as u32,
            camera,
            camera_group,
            target: texture(FORMAT, attached | wgpu::TextureUsages::COPY_SRC),
            depth,
        }
    }

    /// The drawn image.
    pub(crate) fn target(&self) -> &wgpu::Texture {
        &self.target
    }

    /// Records a frame: all rectangles with one group, or each with its own.
    pub(crate) fn draw(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        camera: Mat4,
        groups: &[wgpu::BindGroup],
    ) {
        self.draw_in(gpu, &mut self.pass(encoder), camera, groups);
    }

    /// Begins the pass of a frame, whose image and depths are clear.
    pub(crate) fn pass<'e>(&self, encoder: &'e mut wgpu::CommandEncoder) -> wgpu::RenderPass<'e> {
        let view = self.target.create_view(&wgpu::TextureViewDescriptor::default());
        let sky = wgpu::Color { r: 0.3, g: 0.45, b: 0.7, a: 1.0 };
        pipeline::pass(encoder, (&view, &self.depth), sky)
    }

    /// Draws the rectangles in a pass that may draw other things, too.
    pub(crate) fn draw_in(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass<'_>,
        camera: Mat4,
        groups: &[wgpu::BindGroup],
    ) {
        gpu.queue().write_buffer(&self.camera, 0, bytemuck::bytes_of(&camera));
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(1, &self.camera_group, &[]);
        pass.set_vertex_buffer(0, self.quads.slice(..));
        if let [all] = groups {
            pass.set_bind_group(0, all, &[]);
            pass.draw(0..4, 0..self.count);
            return;
        }
        for (number, group) in (0..self.count).zip(groups) {
            pass.set_bind_group(0, group, &[]);
            pass.draw(0..4, number..number + 1);
        }
    }
}

/// Anisotropy of samplers: none in software, where it takes seconds a frame.
pub(crate) fn anisotropy(gpu: &Gpu) -> u16 {
    if gpu.info().device_type == wgpu::DeviceType::Cpu { 1 } else { 4 }
}

/// A camera at `eye` that looks at `at`, 60 degrees from top to bottom.
pub(crate) fn camera(eye: Vec3, at: Vec3, (width, height): (u32, u32)) -> Mat4 {
    perspective(60f32.to_radians(), width as f32 / height as f32, 0.05, 500.0)
        * look_at_mat4(eye, at, Vec3::Y)
}
