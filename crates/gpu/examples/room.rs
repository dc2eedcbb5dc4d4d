//! Twenty textures of five codecs on the walls and the floor of a room, drawn from one cache of tiles by one pipeline and one bind group.
//!
//! `cargo run --release -p texfold-gpu --example room -- target/room` writes frames of a moving camera, all in one strip, and prints the
//! memory beside that of BC7. Twelve textures have 4096 texels a side: they take a minute to draw and encode.

#[path = "support/offscreen.rs"]
mod offscreen;
#[path = "support/scene.rs"]
mod scene;

use std::error::Error;
use std::path::PathBuf;

use glam::Vec3;
use scene::{Quad, Scene, camera};
use texfold::core::image::{ColorSpace, ImageSet, Raster};
use texfold::{AnyImage, Choice, Effort, EncodeSettings, Goal, Guidance, Job};
use texfold_gpu::{Gpu, Policy, TileCache, TileLook, TileOptions, wgpu};

const SIZE: (u32, u32) = (960, 540);
/// Frames of the camera's path, and of how many one is written.
const FRAMES: u32 = 32;
const WRITTEN: u32 = 4;
/// Texels a side of the large textures.
const SIDE: u32 = 4096;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "target/room".to_owned()));
    std::fs::create_dir_all(&folder)?;
    let gpu = Gpu::new(Policy::from_env())?;
    println!("{}", gpu.info().name);
    let mut cache = TileCache::new(
        &gpu,
        &TileOptions {
            pool_bytes: 24 << 20,
            stream_bytes: 24 << 20,
            scratch_bytes: 8 << 20,
            textures: 20,
            pages: 1 << 15,
            anisotropy: scene::anisotropy(&gpu),
            ..TileOptions::default()
        },
    )?;
    let (textures, mut bytes) = fill(&gpu, &mut cache)?;
    let scene = Scene::tiled(&gpu, &cache, &room(&textures), SIZE);
    let groups = [cache.bind_group().clone()];
    let mut strip = Vec::new();
    let mut decoded = 0;
    for number in 0..FRAMES {
        let share = number as f32 / FRAMES as f32;
        let angle = share * std::f32::consts::TAU;
        let eye = Vec3::new(2.0 * angle.sin(), 1.6, -3.0 + 2.5 * share);
        let view = camera(eye, eye + Vec3::new((0.9 * angle).sin(), -0.15, (0.9 * angle).cos()), SIZE);
        let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        scene.draw(&gpu, &mut encoder, view, &groups);
        // Once a frame, behind what draws from the cache.
        cache.update(&mut encoder);
        let pixels = offscreen::read_back(&gpu, encoder, scene.target())?;
        let report = cache.report(&gpu)?;
        decoded += report.decoded;
        if number % WRITTEN == WRITTEN - 1 {
            let path = folder.join(format!("{number:02}.png"));
            image::save_buffer(path, &pixels, SIZE.0, SIZE.1, image::ExtendedColorType::Rgba8)?;
            strip.extend(pixels);
        }
    }
    let height = SIZE.1 * (FRAMES / WRITTEN);
    image::save_buffer(folder.join("strip.png"), &strip, SIZE.0, height, image::ExtendedColorType::Rgba8)?;
    bytes.held += cache.bytes();
    println!(
        "{decoded} tiles decoded in {FRAMES} frames; {:.1} MB on the GPU, pool and scratch memory among them; the same textures in BC7: {:.1} MB, \
         {:.2} times as much",
        bytes.held as f64 / 1e6,
        bytes.bc7 as f64 / 1e6,
        bytes.bc7 as f64 / bytes.held as f64,
    );
    println!("wrote {}", folder.display());
    Ok(())
}

// README: from here
/// Adds the first image of a file to a cache of tiles, which is made once with `TileCache::new(&gpu, &TileOptions::default())`. The
/// returned number stands for it in shaders: they have `cache.wgsl(0)` before their own text, `cache.bind_group()` in group 0, and call
/// `texfold_tile_sample(number, uv)`. Behind the passes that draw, each frame records `cache.update(&mut encoder)`, which decodes what
/// they looked at and did not find.
fn add(gpu: &Gpu, cache: &mut TileCache, file: &[u8]) -> Result<u32, Box<dyn Error>> {
    let texture = texfold::open(file)?.into_image()?;
    let images = cache.add(gpu, texture.as_encoded(), TileLook::default())?;
    Ok(images.first().ok_or("a file without an image")?.index())
}
// README: to here

/// Memory of the textures.
#[derive(Default)]
struct Bytes {
    /// Beside the cache: textures that are not in superblocks.
    held: u64,
    /// All of them with mip levels in BC7.
    bc7: u64,
}

/// Adds twelve large textures, of which some are the same, and two of each further codec.
fn fill(gpu: &Gpu, cache: &mut TileCache) -> Result<(Vec<u32>, Bytes), Box<dyn Error>> {
    let (mut numbers, mut bytes) = (Vec::new(), Bytes::default());
    let mut count = |texture: &AnyImage, file: &[u8], is_large: bool| -> Result<(), Box<dyn Error>> {
        let texture = texture.as_encoded();
        let size = texture.layout().images[0];
        let levels = (0..size.full_levels()).map(|level| size.at_level(level));
        let block_bytes = |side: u32| u64::from(side.div_ceil(4));
        bytes.bc7 += levels.map(|size| 16 * block_bytes(size.width) * block_bytes(size.height)).sum::<u64>();
        bytes.held += if is_large { 0 } else { texture.memory().resident / 8 };
        numbers.push(add(gpu, cache, file)?);
        Ok(())
    };
    for number in 0..3 {
        let samples = texfold_testkit::fixtures::land::land((SIDE * number, 7 * SIDE), (SIDE, SIDE));
        let image = Raster::from_u8(SIDE, SIDE, 3, ColorSpace::Srgb, &samples)?;
        let texture = encode("dct", image, 0.5)?;
        let file = texture.to_bytes();
        (0..4).try_for_each(|_| count(&texture, &file, true))?;
    }
    for (codec, bits) in [("bc", 11.0), ("vq", 4.0), ("epitome", 2.0), ("progressive", 4.0)] {
        for name in ["facade", "cloth"] {
            let texture = encode(codec, texfold_testkit::image(name), bits)?;
            count(&texture, &texture.to_bytes(), false)?;
        }
    }
    Ok((numbers, bytes))
}

fn encode(codec: &str, image: Raster, bits: f64) -> Result<AnyImage, Box<dyn Error>> {
    let settings = EncodeSettings {
        codec: Choice::named(codec).ok_or("no such codec")?,
        goal: Goal::Bpp(bits),
        effort: Effort::Fast,
        mips: true,
        ..EncodeSettings::default()
    };
    let set = ImageSet::single(image);
    Ok(texfold::encode_images(&set, Guidance::default(), &settings, &mut Job::default())?)
}

/// Large textures on floor, ceiling and walls, the others on panels before them.
fn room(textures: &[u32]) -> Vec<Quad> {
    let (large, small) = textures.split_at(12.min(textures.len()));
    let quad = |corner: [f32; 3], across: [f32; 3], down: [f32; 3], texture: u32| Quad {
        corner: corner.into(),
        across: across.into(),
        down: down.into(),
        repeats: [1.0, 1.0],
        texture,
    };
    let mut quads = Vec::new();
    for (number, &texture) in (0..).zip(large) {
        let along = (number / 4) as f32 * 4.0 - 6.0;
        quads.push(match number % 4 {
            0 => quad([-4.0, 0.0, along], [8.0, 0.0, 0.0], [0.0, 0.0, 4.0], texture),
            1 => quad([-4.0, 4.0, along], [8.0, 0.0, 0.0], [0.0, 0.0, 4.0], texture),
            2 => quad([-4.0, 4.0, along], [0.0, 0.0, 4.0], [0.0, -4.0, 0.0], texture),
            _ => quad([4.0, 4.0, along], [0.0, 0.0, 4.0], [0.0, -4.0, 0.0], texture),
        });
    }
    for (number, &texture) in (0..).zip(small) {
        let (side, along) = ((number % 2) as f32 * 2.0 - 1.0, (number / 2) as f32 * 2.5 - 5.0);
        quads.push(quad([2.4 * side, 2.4, along], [0.6, 0.0, 1.2], [0.0, -1.6, 0.0], texture));
    }
    quads
}
