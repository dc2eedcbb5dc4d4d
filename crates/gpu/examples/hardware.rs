//! A renderer of its own that draws a Texfold texture with an anisotropic hardware sampler and WGSL of its own alone.
//!
//! `cargo run --release -p texfold-gpu --example hardware -- [image.png [texture.txf]]`; without a file it encodes a test image.

#[path = "support/offscreen.rs"]
mod offscreen;

use std::error::Error;

use texfold::{EncodeSettings, Goal, Guidance, ImageSet, Job};
use texfold_gpu::{Gpu, Policy, wgpu};

/// Columns and rows of the image; rows of 4 * 960 bytes need no padding when they are read back.
const SIZE: (u32, u32) = (960, 640);
const TARGET: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;

/// A floor to the horizon: the renderer's own shader, which knows nothing of Texfold.
const SHADER: &str = "
@group(0) @binding(0) var colour: texture_2d<f32>;
@group(0) @binding(1) var filtered: sampler;

struct Varying { @builtin(position) clip: vec4<f32>, @location(0) uv: vec2<f32> }

@vertex
fn vs(@builtin(vertex_index) index: u32) -> Varying {
    let corners = array(vec2<f32>(-400.0, 1.0), vec2<f32>(400.0, 1.0), vec2<f32>(0.0, 400.0));
    let at = corners[index]; // to the right, and away from the camera
    return Varying(vec4<f32>(at.x, 0.6 * at.y - 1.6, 0.0, at.y), 0.5 * at);
}

@fragment
fn fs(in: Varying) -> @location(0) vec4<f32> {
    return textureSample(colour, filtered, in.uv);
}
";

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let output = arguments.next().unwrap_or_else(|| "hardware.png".to_owned());
    let file = match arguments.next() {
        Some(path) => std::fs::read(path)?,
        None => encode_test_image()?,
    };
    // A renderer with a device of its own calls Gpu::from_device.
    let gpu = Gpu::new(Policy::from_env())?;
    let source = wgpu::ShaderSource::Wgsl(SHADER.into());
    let shader = gpu.device().create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
    let pipeline = offscreen::pipeline(&gpu, &shader, &[], &[], TARGET);
    let group = bind(&gpu, &file, &pipeline.get_bind_group_layout(0))?;
    let pixels = offscreen::draw(&gpu, &pipeline, &[&group], &offscreen::target(&gpu, SIZE, TARGET))?;
    image::save_buffer(&output, &pixels, SIZE.0, SIZE.1, image::ExtendedColorType::Rgba8)?;
    println!("{}: wrote {output}", gpu.info().name);
    Ok(())
}

// README: from here
/// Decodes a file into plain texels on the GPU and binds them with an anisotropic sampler, for WGSL of the renderer's own that has
/// `@group(0) @binding(0) var colour: texture_2d<f32>` and `@group(0) @binding(1) var filtered: sampler`.
fn bind(gpu: &Gpu, file: &[u8], layout: &wgpu::BindGroupLayout) -> Result<wgpu::BindGroup, Box<dyn Error>> {
    let texture = texfold::open(file)?.into_image()?;
    let uploaded = gpu.upload(&texture.as_encoded().gpu())?;
    // Image 0 with its mip levels; the sampler converts sRGB to linear light before it filters.
    let view = uploaded.decoded_view(0, true)?;
    let sampler = gpu.device().create_sampler(&wgpu::SamplerDescriptor {
        address_mode_u: wgpu::AddressMode::Repeat,
        address_mode_v: wgpu::AddressMode::Repeat,
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        mipmap_filter: wgpu::MipmapFilterMode::Linear,
        anisotropy_clamp: 16,
        ..Default::default()
    });
    Ok(gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout,
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&sampler) },
        ],
    }))
}
// README: to here

fn encode_test_image() -> Result<Vec<u8>, Box<dyn Error>> {
    let images = ImageSet::single(texfold_testkit::image("facade"));
    let settings = EncodeSettings { goal: Goal::Bpp(2.0), mips: true, ..EncodeSettings::default() };
    Ok(texfold::encode_images(&images, Guidance::default(), &settings, &mut Job::default())?.to_bytes())
}
