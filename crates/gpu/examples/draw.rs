//! A renderer of its own that draws a Texfold texture: the module's WGSL pasted into its shader, its bind group beside
//! the renderer's own.
//!
//! `cargo run -p texfold-gpu --example draw -- [texture.txf [image.png]]`; without a file it encodes a test image.

#[path = "support/offscreen.rs"]
mod offscreen;

use std::error::Error;

use glam::Vec3;
use glam::camera::rh::proj::directx::perspective;
use glam::camera::rh::view::look_at_mat4;
use offscreen::{read_back, target, view_of};
use texfold::{
    Goal, Job, Limits,
    bc::{Bc, BcParams},
    core::Encoder,
};
use texfold_core::image::ImageSet;
use texfold_gpu::{AddressMode, Gpu, GpuTexture, Policy, wgpu};
use texfold_shaders::{Slot, paste};

/// Columns and rows of the image; rows of 4 * 960 bytes need no padding when they are read back.
const SIZE: (u32, u32) = (960, 640);
const COLOUR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Quads a side of the sheet.
const GRID: u32 = 96;

/// The renderer's own shader. It knows one function of Texfold; group 1 holds what that function reads.
const SHADER: &str = "
struct Camera { view_projection: mat4x4<f32> }
@group(0) @binding(0) var<uniform> camera: Camera;

struct Varying {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv: vec2<f32>,
    @location(1) normal: vec3<f32>,
}

@vertex
fn vs(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>, @location(2) uv: vec2<f32>) -> Varying {
    return Varying(camera.view_projection * vec4<f32>(position, 1.0), uv, normal);
}

@fragment
fn fs(in: Varying) -> @location(0) vec4<f32> {
    let texel = SAMPLE(in.uv);
    let light = 0.35 + 0.65 * max(dot(normalize(in.normal), normalize(vec3<f32>(-0.5, 0.8, 0.6))), 0.0);
    return vec4<f32>(texel.rgb * light, 1.0);
}
";

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let texture = match arguments.next() {
        Some(path) => texfold::open(&std::fs::read(path)?)?.into_image()?.into_encoded(),
        None => encode_test_image()?,
    };
    let output = arguments.next().unwrap_or_else(|| "draw.png".to_owned());
    // A renderer with a device of its own calls Gpu::from_device.
    let gpu = Gpu::new(Policy::from_env())?;
    let uploaded = gpu.upload(&texture.gpu())?.with_address_mode(AddressMode::Repeat);
    println!("{}: module {}, {} bytes uploaded", gpu.info().name, uploaded.module().name, uploaded.bytes());
    let pixels = render(&gpu, &uploaded)?;
    image::save_buffer(&output, &pixels, SIZE.0, SIZE.1, image::ExtendedColorType::Rgba8)?;
    println!("wrote {output}");
    Ok(())
}

fn encode_test_image() -> Result<Box<dyn texfold::Encoded<Domain = texfold::core::Image2d>>, Box<dyn Error>> {
    let image = texfold_testkit::image("facade");
    let params = BcParams::default().with_goal(Goal::Bpp(6.0)).with_mips(true);
    let encoded = Bc::encode(&ImageSet::single(image), &params, &mut Job::new(Limits::default()))?;
    println!("{}", texfold::Encoded::notes(&encoded).verdict);
    Ok(Box::new(encoded))
}

fn render(gpu: &Gpu, texture: &GpuTexture) -> Result<Vec<u8>, Box<dyn Error>> {
    let device = gpu.device();
    let pipeline = pipeline(gpu, texture)?;
    let view_projection = perspective(0.8, SIZE.0 as f32 / SIZE.1 as f32, 0.1, 50.0)
        * look_at_mat4(Vec3::new(0.0, 1.5, 3.4), Vec3::new(0.0, -0.1, 0.0), Vec3::Y);
    let camera = buffer(gpu, bytemuck::bytes_of(&view_projection), wgpu::BufferUsages::UNIFORM);
    let camera = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[wgpu::BindGroupEntry { binding: 0, resource: camera.as_entire_binding() }],
    });
    let (vertices, indices) = sheet();
    let count = indices.len() as u32;
    let vertices = buffer(gpu, bytemuck::cast_slice(&vertices), wgpu::BufferUsages::VERTEX);
    let indices = buffer(gpu, bytemuck::cast_slice(&indices), wgpu::BufferUsages::INDEX);
    let (colour, depth) = (target(gpu, SIZE, COLOUR), target(gpu, SIZE, DEPTH));
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    {
        let (colour, depth) = (view_of(&colour), view_of(&depth));
        let mut pass = begin(&mut encoder, &colour, &depth);
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &camera, &[]);
        // The textures and parameters of image 0.
        pass.set_bind_group(1, texture.bind_group(0)?.0, &[]);
        pass.set_vertex_buffer(0, vertices.slice(..));
        pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..count, 0, 0..1);
    }
    read_back(gpu, encoder, &colour)
}

/// The renderer's pipeline: its camera in group 0, Texfold's bindings in group 1.
fn pipeline(gpu: &Gpu, texture: &GpuTexture) -> Result<wgpu::RenderPipeline, Box<dyn Error>> {
    let (device, module) = (gpu.device(), texture.module());
    let slot = Slot::new(module, 1, 0);
    let own = SHADER.replace("SAMPLE", &slot.sample_function());
    let shader = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(format!("{}\n{own}", paste(&[slot])?).into()),
    });
    let camera = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::VERTEX,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        }],
    });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(&camera), Some(gpu.bind_group_layout(module))],
        immediate_size: 0,
    });
    let vertices = [Some(wgpu::VertexBufferLayout {
        array_stride: 32,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Float32x2],
    })];
    Ok(device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &shader,
            entry_point: Some("vs"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &vertices,
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
            entry_point: Some("fs"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(COLOUR.into())],
        }),
        multiview_mask: None,
        cache: None,
    }))
}

/// A waved sheet: position, normal and texture coordinate of each corner, and the triangles. The texture repeats twice
/// across it.
fn sheet() -> (Vec<[f32; 8]>, Vec<u32>) {
    let height = |x: f32, z: f32| 0.22 * (2.6 * x).sin() * (1.7 * z).cos();
    let corner = |column: u32, row: u32| {
        let (s, t) = (column as f32 / GRID as f32, row as f32 / GRID as f32);
        let (x, z) = (4.0 * s - 2.0, 4.0 * t - 2.2);
        let normal = Vec3::new(
            height(x - 0.01, z) - height(x + 0.01, z),
            0.02,
            height(x, z - 0.01) - height(x, z + 0.01),
        );
        let normal = normal.normalize();
        [x, height(x, z), z, normal.x, normal.y, normal.z, 2.0 * s, 2.0 * t]
    };
    let vertices = (0..=GRID).flat_map(|row| (0..=GRID).map(move |column| corner(column, row))).collect();
    let quad = |column: u32, row: u32| {
        let at = row * (GRID + 1) + column;
        [at, at + GRID + 1, at + 1, at + 1, at + GRID + 1, at + GRID + 2]
    };
    (vertices, (0..GRID).flat_map(|row| (0..GRID).flat_map(move |column| quad(column, row))).collect())
}

fn begin<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    colour: &wgpu::TextureView,
    depth: &wgpu::TextureView,
) -> wgpu::RenderPass<'e> {
    let sky = wgpu::Color { r: 0.10, g: 0.12, b: 0.16, a: 1.0 };
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: None,
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: colour,
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

fn buffer(gpu: &Gpu, bytes: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let buffer = gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: bytes.len() as u64,
        usage: usage | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    gpu.queue().write_buffer(&buffer, 0, bytes);
    buffer
}
