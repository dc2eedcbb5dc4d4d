//! Albedo, normal and roughness of one codec, and three textures of other codecs, in one pipeline.
//!
//! `cargo run -p texfold-gpu --example material -- [image.png]` encodes fixtures and draws them on a lit quad. [`check`] is the test:
//! what the pipeline draws of each texture is what that texture alone draws.

#[path = "support/offscreen.rs"]
mod offscreen;

use std::error::Error;

use texfold::core::container::SectionWriter;
use texfold::core::image::{Alpha, ColorSpace, ImageSet};
use texfold::{
    Encoded, Job,
    bc::{Bc, BcParams},
    core::{Encoder, Image2d},
    epitome::{Epitome, EpitomeParams, EpitomeSource},
    progressive::{Progressive, ProgressiveParams},
    vq::{Vq, VqParams, VqSource},
};
use texfold_gpu::{AddressMode, Gpu, GpuTexture, Layer, Lod, Material, Policy, wgpu};

/// Columns and rows of the image; rows of 256 bytes need no padding when they are read back.
const SIZE: (u32, u32) = (256, 256);
const COLOUR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// The renderer's own shader. It knows one function of each texture; group 0 holds what these functions read.
const SHADER: &str = "
// Which texture is drawn alone; above the last one, all of them, lit.
override DRAWN: u32 = 6u;

@vertex
fn vs(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(f32(index & 1u), f32(index >> 1u)) * 4.0 - vec2<f32>(1.0);
    return vec4<f32>(corner, 0.0, 1.0);
}

@fragment
fn fs(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let uv = position.xy / 256.0;
    let albedo = albedo_sample(uv);
    let normal = normal_sample(uv);
    let roughness = roughness_sample(uv);
    let detail = detail_sample(uv);
    let dirt = dirt_sample(uv);
    let sign = sign_sample(uv);
    switch DRAWN {
        case 0u: { return albedo; }
        case 1u: { return normal; }
        case 2u: { return roughness; }
        case 3u: { return detail; }
        case 4u: { return dirt; }
        case 5u: { return sign; }
        default: {}
    }
    let facing = max(dot(normalize(normal.xyz * 2.0 - 1.0), normalize(vec3<f32>(-0.4, 0.5, 0.8))), 0.0);
    let base = mix(albedo.rgb * detail.rgb * 2.0, dirt.rgb, 0.2);
    let lit = base * (0.3 + 0.7 * facing) + vec3<f32>((1.0 - roughness.r) * pow(facing, 16.0) * 0.3);
    return vec4<f32>(mix(lit, sign.rgb, sign.a * 0.5), 1.0);
}
";

/// What each texture is called in the shader, the codec, and the fixture that it is made of.
const TEXTURES: [(&str, &str, &str); 6] = [
    ("albedo", "vq", "facade"),
    ("normal", "vq", "normal_map"),
    ("roughness", "vq", "gray"),
    ("detail", "epitome", "odd_37x61"),
    ("dirt", "progressive", "facade"),
    ("sign", "bc", "cutout"),
];

/// A `.txf` file, and what its functions are called in the shader.
struct TextureFile {
    prefix: &'static str,
    bytes: Vec<u8>,
}

/// The colours of an image, row by row.
type Pixels = Vec<[u8; 4]>;

// README: from here
/// Uploads files of any codecs and binds them in group 0 of one shader. The prefix of a file names its functions there: the
/// renderer's own shader calls `albedo_sample(uv)`, whatever codec the albedo is in.
fn bind(gpu: &Gpu, files: &[TextureFile]) -> Result<(Vec<GpuTexture>, Material), Box<dyn Error>> {
    let mut textures = Vec::new();
    for file in files {
        let texture = texfold::open(&file.bytes)?.into_image()?;
        textures.push(gpu.upload(&texture.as_encoded().gpu())?.with_address_mode(AddressMode::Repeat));
    }
    let named = files.iter().zip(&textures);
    let layers: Vec<_> =
        named.map(|(file, texture)| Layer { prefix: file.prefix, texture, image: 0 }).collect();
    let material = gpu.material(0, &layers)?;
    Ok((textures, material))
}

/// The renderer's own shader behind the functions of the textures. Its pipeline layout takes `material.layout()` for group 0, and
/// each draw `pass.set_bind_group(0, material.bind_group(), &[])`.
fn shader(gpu: &Gpu, material: &Material, own: &str) -> wgpu::ShaderModule {
    let source = wgpu::ShaderSource::Wgsl([material.wgsl(), own].concat().into());
    gpu.device().create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source })
}
// README: to here

fn main() -> Result<(), Box<dyn Error>> {
    let output = std::env::args().nth(1).unwrap_or_else(|| "material.png".to_owned());
    let gpu = Gpu::new(Policy::from_env())?;
    let (_, material) = bind(&gpu, &files()?)?;
    let pixels = draw(&gpu, &material, TEXTURES.len())?;
    image::save_buffer(&output, pixels.as_flattened(), SIZE.0, SIZE.1, image::ExtendedColorType::Rgba8)?;
    println!("{}: wrote {output}", gpu.info().name);
    Ok(())
}

/// The largest difference, in steps of 8 bits, between what the pipeline of all textures draws of each and what that texture alone
/// draws; and the images.
///
/// # Errors
/// Where the device fails.
#[allow(dead_code, reason = "tests/material.rs calls it")]
pub(crate) fn differences(gpu: &Gpu) -> Result<(u8, Vec<Pixels>), Box<dyn Error>> {
    let (textures, material) = bind(gpu, &files()?)?;
    let (mut largest, mut images) = (0, Vec::new());
    for (number, texture) in textures.iter().enumerate() {
        let together = draw(gpu, &material, number)?;
        let alone = gpu.draw_quad(texture, 0, SIZE, glam::Affine2::IDENTITY, Lod::Derivative)?;
        let pairs = together.as_flattened().iter().zip(alone.as_flattened());
        largest = pairs.map(|(a, b)| a.abs_diff(*b)).fold(largest, u8::max);
        images.push(together);
    }
    images.push(draw(gpu, &material, TEXTURES.len())?);
    Ok((largest, images))
}

/// The files of [`TEXTURES`].
fn files() -> Result<Vec<TextureFile>, Box<dyn Error>> {
    let file = |&(prefix, codec, fixture)| Ok(TextureFile { prefix, bytes: encode(codec, fixture)? });
    TEXTURES.iter().map(file).collect()
}

fn encode(codec: &str, fixture: &str) -> Result<Vec<u8>, Box<dyn Error>> {
    let image = texfold_testkit::image(fixture);
    let color = if fixture == "normal_map" { ColorSpace::Normal } else { ColorSpace::Srgb };
    let image = image.tagged(color, Alpha::Straight);
    let (set, mut job) = (ImageSet::single(image), Job::default());
    Ok(match codec {
        "vq" => bytes(&Vq::encode(VqSource::new(&set), &VqParams::default(), &mut job)?),
        "epitome" => bytes(&Epitome::encode(EpitomeSource::new(&set), &EpitomeParams::default(), &mut job)?),
        "progressive" => bytes(&Progressive::encode(&set, &ProgressiveParams::default(), &mut job)?),
        _ => bytes(&Bc::encode(&set, &BcParams::default(), &mut job)?),
    })
}

fn bytes(texture: &dyn Encoded<Domain = Image2d>) -> Vec<u8> {
    let mut out = SectionWriter::new(texture.codec());
    texture.store(&mut out);
    out.finish().bytes
}

/// The image that the pipeline of all textures draws: texture `drawn` alone, or all of them.
fn draw(gpu: &Gpu, material: &Material, drawn: usize) -> Result<Pixels, Box<dyn Error>> {
    let mut constants = material.constants();
    constants.push(("DRAWN", drawn as f64));
    let shader = shader(gpu, material, SHADER);
    let pipeline = offscreen::pipeline(gpu, &shader, &[Some(material.layout())], &constants, COLOUR);
    let target = offscreen::target(gpu, SIZE, COLOUR);
    let texels = offscreen::draw(gpu, &pipeline, &[material.bind_group()], &target)?;
    Ok(bytemuck::cast_slice(&texels).to_vec())
}
