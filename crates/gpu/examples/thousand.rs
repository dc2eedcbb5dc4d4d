//! A thousand textures of 2048 texels a side, 4.2 gigatexels, drawn from one cache of tiles in one draw with one bind group.
//!
//! `cargo run --release -p texfold-gpu --example thousand -- target/thousand` writes a flight over them, a jump to another place and the
//! frames after it. Four textures are drawn and encoded; each is added 250 times with memory of its own.

#[path = "support/offscreen.rs"]
mod offscreen;
#[path = "support/scene.rs"]
mod scene;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::{Mat4, Vec3};
use scene::{Quad, Scene, camera};
use texfold::core::image::{ColorSpace, ImageSet, Raster};
use texfold::{AnyImage, Choice, Effort, EncodeSettings, Goal, Guidance, Job};
use texfold_gpu::{Gpu, Policy, TileCache, TileLook, TileOptions, wgpu};

const SIZE: (u32, u32) = (640, 360);
const TEXTURES: usize = 1000;
const DRAWN: u32 = 4;
const SIDE: u32 = 2048;
/// Frames of the flight, and after the jump.
const FRAMES: u32 = 8;
const AFTER: u32 = 9;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "target/thousand".to_owned()));
    std::fs::create_dir_all(&folder)?;
    let gpu = Gpu::new(Policy::from_env())?;
    let options = TileOptions {
        pool_bytes: 64 << 20,
        stream_bytes: 128 << 20,
        scratch_bytes: 64 << 20,
        textures: TEXTURES as u32,
        pages: 450 * TEXTURES as u32,
        anisotropy: scene::anisotropy(&gpu),
        ..TileOptions::default()
    };
    let mut cache = TileCache::new(&gpu, &options)?;
    let textures = (0..DRAWN).map(encoded).collect::<Result<Vec<_>, _>>()?;
    let mut quads = Vec::new();
    for number in 0..TEXTURES {
        let texture = textures[number % textures.len()].as_encoded();
        let added = cache.add(&gpu, texture, TileLook::default())?;
        let (column, row) = ((number % 25) as f32, (number / 25) as f32);
        quads.push(Quad {
            corner: Vec3::new(column, 0.0, row),
            across: Vec3::new(0.98, 0.0, 0.0),
            down: Vec3::new(0.0, 0.0, 0.98),
            repeats: [1.0, 1.0],
            texture: added.first().ok_or("no image")?.index(),
        });
    }
    println!(
        "{}: {TEXTURES} textures, {:.1} gigatexels, {:.0} MB on the GPU with the pool",
        gpu.info().name,
        TEXTURES as f64 * f64::from(SIDE * SIDE) / 1e9,
        cache.bytes() as f64 / 1e6,
    );
    let scene = Scene::tiled(&gpu, &cache, &quads, SIZE);
    for number in 0..FRAMES {
        let along = number as f32 / FRAMES as f32;
        let eye = Vec3::new(5.0 + 3.0 * along, 0.6, 2.0 + 3.0 * along);
        let name = (number % 4 == 3).then(|| format!("flight-{number:02}.png"));
        frame(&gpu, &cache, &scene, ahead(eye), name.map(|name| folder.join(name)).as_deref())?;
    }
    println!("| frame after the jump | ms | tiles decoded | still missing |\n|---|---|---|---|");
    for number in 0..AFTER {
        let path = folder.join(format!("jump-{number}.png"));
        let start = Instant::now();
        let report = frame(&gpu, &cache, &scene, ahead(Vec3::new(18.0, 0.5, 30.0)), Some(&path))?;
        let time = 1e3 * start.elapsed().as_secs_f64();
        println!("| {number} | {time:.0} | {} | {} |", report.decoded, report.missing);
    }
    println!("wrote {}", folder.display());
    Ok(())
}

fn ahead(eye: Vec3) -> Mat4 {
    camera(eye, eye + Vec3::new(0.2, -0.35, 1.0), SIZE)
}

/// Draws a frame, updates the cache behind it, and writes what was drawn.
fn frame(
    gpu: &Gpu,
    cache: &TileCache,
    scene: &Scene,
    view: Mat4,
    path: Option<&Path>,
) -> Result<texfold_gpu::TileReport, Box<dyn Error>> {
    let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    scene.draw(gpu, &mut encoder, view, &[cache.bind_group().clone()]);
    cache.update(&mut encoder);
    let pixels = offscreen::read_back(gpu, encoder, scene.target())?;
    if let Some(path) = path {
        image::save_buffer(path, &pixels, SIZE.0, SIZE.1, image::ExtendedColorType::Rgba8)?;
    }
    Ok(cache.report(gpu)?)
}

/// Land that no other number has, in superblocks.
fn encoded(number: u32) -> Result<AnyImage, Box<dyn Error>> {
    let samples = texfold_testkit::fixtures::land::land((number * SIDE, 3 * SIDE), (SIDE, SIDE));
    let image = Raster::from_u8(SIDE, SIDE, 3, ColorSpace::Srgb, &samples)?;
    let settings = EncodeSettings {
        codec: Choice::named("dct").ok_or("no such codec")?,
        goal: Goal::Bpp(0.12),
        effort: Effort::Fast,
        mips: true,
        ..EncodeSettings::default()
    };
    let set = ImageSet::single(image);
    Ok(texfold::encode_images(&set, Guidance::default(), &settings, &mut Job::default())?)
}
