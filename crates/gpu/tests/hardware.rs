//! Plain texels that blocks are decoded to, as the hardware's samplers see them.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(
    clippy::duplicate_mod,
    reason = "the examples and the other tests' support each draw without a window"
)]

#[path = "../examples/support/offscreen.rs"]
mod offscreen;

use crate::support::{bc, gpu, image};
use texfold::core::image::{ImageSet, Raster};
use texfold::{AnyImage, Choice, EncodeSettings, Goal, Guidance, ImageAddress, Job};
use texfold_bc::Content;
use texfold_gpu::{Gpu, GpuError, wgpu};
use texfold_testkit::crop;

const SHADER: &str = "
@group(0) @binding(0) var colour: texture_2d<f32>;
@group(0) @binding(1) var filtered: sampler;
override LEVEL: f32;

@vertex
fn vs(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn fs(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return textureSampleLevel(colour, filtered, at.xy / vec2<f32>(textureDimensions(colour, u32(LEVEL))), LEVEL);
}
";

/// An image with mip levels in blocks.
fn encode(image: Raster) -> AnyImage {
    let settings = EncodeSettings {
        codec: Choice::named("dct").unwrap(),
        goal: Goal::Bpp(2.0),
        mips: true,
        ..EncodeSettings::default()
    };
    texfold::encode_images(&ImageSet::single(image), Guidance::default(), &settings, &mut Job::default())
        .unwrap()
}

/// The texels of a level of a view at their centres, in rows of `width`, through a filtering sampler.
fn texels(gpu: &Gpu, view: &wgpu::TextureView, level: u32, (width, height): (u32, u32)) -> Vec<[f32; 4]> {
    let device = gpu.device();
    let source = wgpu::ShaderSource::Wgsl(SHADER.into());
    let shader = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
    let format = wgpu::TextureFormat::Rgba32Float;
    let pipeline = offscreen::pipeline(gpu, &shader, &[], &[("LEVEL", f64::from(level))], format);
    let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        mipmap_filter: wgpu::MipmapFilterMode::Linear,
        ..Default::default()
    });
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(view) },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&sampler) },
        ],
    });
    let target = offscreen::target(gpu, (width.next_multiple_of(16), height), format);
    let bytes = offscreen::draw(gpu, &pipeline, &[&group], &target).unwrap();
    bytemuck::pod_collect_to_vec::<u8, [f32; 4]>(&bytes)
}

/// Linear light of an sRGB value (IEC 61966-2-1).
fn linear(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

#[test]
fn samplers_see_the_texels_of_every_level_as_values_or_as_light() {
    let Some(gpu) = gpu() else { return };
    let texture = encode(crop(&image("facade"), (40, 40), (77, 51)));
    let texture = texture.as_encoded();
    let uploaded = gpu.upload(&texture.gpu()).unwrap();
    assert_eq!(texture.layout().levels, 7);
    for srgb in [false, true] {
        let view = uploaded.decoded_view(0, srgb).unwrap();
        for level in 0..7 {
            let size = texture.layout().images[0].at_level(level);
            let found = texels(gpu, &view, level, (size.width, size.height));
            let row = size.width.next_multiple_of(16) as usize;
            for (y, x) in (0..size.height).flat_map(|y| (0..size.width).map(move |x| (y, x))) {
                let wanted = texture.texel(ImageAddress { image: 0, level, x, y }).to_array();
                let wanted = wanted.map(|value| if srgb { linear(value) } else { value });
                let found = found[y as usize * row + x as usize];
                // Samplers place texels in 1/256 of a texel and convert by tables: two steps of 255 at most.
                for (found, wanted) in found[..3].iter().zip(wanted) {
                    assert!(
                        (found - wanted).abs() <= 2.0 / 255.0,
                        "{srgb} {level} {x} {y}: {found} {wanted}"
                    );
                }
            }
        }
    }
}

#[test]
fn textures_without_plain_texels_name_the_module_that_samples_them() {
    let Some(gpu) = gpu() else { return };
    let blocks = bc(vec![image("odd_37x61")], Content::Raw, 0).upload(gpu);
    assert!(matches!(blocks.decoded_view(0, true), Err(GpuError::NotDecoded { image: 0, module: "bc" })));
    assert!(matches!(blocks.decoded_view(1, true), Err(GpuError::NoSuchImage { image: 1, images: 1 })));
}
