//! A flight over a bank: images that are larger than the memory which is given to them, read from their files as they are looked at.
//!
//! `cargo run --release -p texfold-gpu --example bank -- BANK [FOLDER]` draws the images of a bank (`texfold bank add IMAGES --mips --out
//! BANK`) side by side, from high above all of them down to one, then at once to another. Each tile of an image is a texture of the cache. It begins with the first
//! bytes of its file, whose smallest levels are always there; tiles that are looked at closer are read whole, and those that were not looked at
//! for longest are dropped where `STREAM_BYTES` do not suffice. Frames are written to the folder, `target/bank-flight` where none is named.

#[path = "support/archive.rs"]
mod archive;
#[path = "support/offscreen.rs"]
mod offscreen;
#[path = "support/scene.rs"]
mod scene;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

use archive::Archive;
use glam::Vec3;
use scene::{Quad, Scene, camera};
use texfold::bank::Bank;
use texfold_gpu::{Gpu, Policy, wgpu};

const SIZE: (u32, u32) = (960, 540);
/// Compressed streams and their tables, of all tiles that are read.
const STREAM_BYTES: u64 = 4 << 20;
/// Frames of the flight, and after the jump.
const FLIGHT: u32 = 24;
const AFTER: u32 = 12;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let bank =
        arguments.next().ok_or("name a bank: the folder that `texfold bank add --mips --out` wrote")?;
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "target/bank-flight".to_owned()));
    std::fs::create_dir_all(&folder)?;
    let bank: Bank = Bank::open(bank.as_ref())?;
    let gpu = Gpu::new(Policy::from_env())?;
    let start = Instant::now();
    let mut shown = Archive::new(&gpu, &bank, STREAM_BYTES, true)?;
    let texels: f64 =
        bank.images().iter().map(|image| f64::from(image.width) * f64::from(image.height)).sum();
    println!(
        "{}: {} images, {} tiles, {:.0} megatexels; {:.0} MB on the GPU with the pool; coarse after {:.1} s",
        gpu.info().name,
        bank.images().len(),
        shown.placed().len(),
        texels / 1e6,
        shown.cache.bytes() as f64 / 1e6,
        start.elapsed().as_secs_f64(),
    );
    let quad = |placed: archive::Placed| Quad {
        corner: placed.corner,
        across: Vec3::new(placed.size.x, 0.0, 0.0),
        down: Vec3::new(0.0, 0.0, placed.size.y),
        repeats: [1.0, 1.0],
        texture: placed.texture,
    };
    let quads: Vec<Quad> = shown.placed().into_iter().map(quad).collect();
    let places = shown.middles.clone();
    let scene = Scene::tiled(&gpu, &shown.cache, &quads, SIZE);
    let [Some(&first), Some(&last)] = [places.first(), places.last()] else { return Err("no image".into()) };
    let middle = (first + last) / 2.0;
    println!(
        "| frame | ms | files read | let go | tiles decoded | still missing |\n|---|---|---|---|---|---|"
    );
    for number in 0..FLIGHT + AFTER {
        let along = (number as f32 / (FLIGHT - 1) as f32).min(1.0);
        let (at, height) = if number < FLIGHT {
            (middle.lerp(first, along), 0.6 + 1.2 * (last - first).length() * (1.0 - along).powi(2))
        } else {
            (last, 0.6)
        };
        let view = camera(at + Vec3::new(0.0, height, 0.3 * height), at, SIZE);
        let start = Instant::now();
        let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        scene.draw(&gpu, &mut encoder, view, &[shown.cache.bind_group().clone()]);
        shown.cache.update(&mut encoder);
        let pixels = offscreen::read_back(&gpu, encoder, scene.target())?;
        let watch = shown.cache.watch(&gpu)?;
        // A renderer asks again in its next frames.
        let uses = loop {
            if let Some(uses) = watch.poll(&gpu)? {
                break uses;
            }
        };
        let [read, gone] = shown.read(&gpu, &bank, &uses, number)?;
        let time = 1e3 * start.elapsed().as_secs_f64();
        let report = shown.cache.report(&gpu)?;
        println!("| {number} | {time:.0} | {read} | {gone} | {} | {} |", report.decoded, report.missing);
        if number % 4 == 3 || number == FLIGHT {
            save(&folder.join(format!("flight-{number:02}.png")), &pixels)?;
        }
    }
    println!("wrote {}", folder.display());
    Ok(())
}

fn save(path: &Path, pixels: &[u8]) -> Result<(), Box<dyn Error>> {
    Ok(image::save_buffer(path, pixels, SIZE.0, SIZE.1, image::ExtendedColorType::Rgba8)?)
}
