//! A flight over a bank: images that are larger than the memory which is given to them, read from their files as they are looked at.
//!
//! `cargo run --release -p texfold-gpu --example bank -- BANK [FOLDER]` draws the images of a bank (`texfold bank add IMAGES --mips --out
//! BANK`) side by side, from high above all of them down to one, then at once to another. Each tile of an image is a texture of the cache. It begins with the first
//! bytes of its file, whose smallest levels are always there; tiles that are looked at closer are read whole, and those that were not looked at
//! for longest give way where `STREAM_BYTES` do not suffice. Frames are written to the folder, `target/bank-flight` where none is named.

#[path = "support/offscreen.rs"]
mod offscreen;
#[path = "support/scene.rs"]
mod scene;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::Vec3;
use scene::{Quad, Scene, camera};
use texfold::bank::{Bank, Tile};
use texfold_gpu::{
    AddressMode, Gpu, GpuError, Policy, TileCache, TileLook, TileOptions, TileTexture, TileUse, wgpu,
};

const SIZE: (u32, u32) = (960, 540);
/// Compressed streams and their tables, of all tiles that are read.
const STREAM_BYTES: u64 = 4 << 20;
/// Files that are read whole in a frame, at most. A program that draws frames on time reads them in another thread.
const FILES: usize = 4;
/// Frames of the flight, and after the jump.
const FLIGHT: u32 = 24;
const AFTER: u32 = 12;
/// Texels along a unit of the scene.
const UNIT: f32 = 1024.0;

/// The tiles of a bank in a cache.
struct Shown<'b> {
    bank: &'b Bank,
    cache: TileCache,
    tiles: Vec<Shelf<'b>>,
}

/// A tile, its texture in the cache, and the frame in which it was last looked at where it is there whole.
struct Shelf<'b> {
    tile: &'b Tile,
    texture: TileTexture,
    whole: Option<u32>,
}

impl<'b> Shown<'b> {
    fn new(gpu: &Gpu, bank: &'b Bank) -> Result<Self, Box<dyn Error>> {
        let tiles: Vec<&Tile> = bank.images().iter().flat_map(|image| &image.tiles).collect();
        let options = TileOptions {
            stream_bytes: STREAM_BYTES,
            textures: tiles.len() as u32,
            pages: 160 * tiles.len() as u32,
            anisotropy: scene::anisotropy(gpu),
            ..TileOptions::default()
        };
        let mut cache = TileCache::new(gpu, &options)?;
        let look = TileLook { address: AddressMode::Clamp, srgb: true };
        let mut shelves = Vec::new();
        for tile in tiles {
            let added = cache.add_coarse(gpu, bank.coarse_tile(tile)?.as_encoded(), look)?;
            shelves.push(Shelf { tile, texture: *added.first().ok_or("no image")?, whole: None });
        }
        Ok(Shown { bank, cache, tiles: shelves })
    }

    /// Reads files of tiles that were looked at, the latest first, and lets go of others where there is no room; how many of each.
    fn read(&mut self, gpu: &Gpu, uses: &[TileUse], now: u32) -> Result<[usize; 2], Box<dyn Error>> {
        let (mut wanted, mut counts) = (Vec::new(), [0, 0]);
        for used in uses {
            let place = self.tiles.iter().position(|shelf| shelf.texture == used.texture);
            let place = place.ok_or("not a tile of the bank")?;
            match &mut self.tiles[place].whole {
                Some(last) => *last = (*last).max(now.saturating_sub(used.frames)),
                None if used.frames == 0 => wanted.push((used.level, place)),
                None => {}
            }
        }
        wanted.sort_unstable();
        for (_, place) in wanted.into_iter().take(FILES) {
            let Shelf { tile, texture, .. } = self.tiles[place];
            let whole = self.bank.tile(tile)?;
            loop {
                match self.cache.replace(gpu, &[texture], whole.as_encoded()) {
                    Ok(()) => break,
                    Err(GpuError::TilesFull { option: "stream_bytes", .. }) => {}
                    Err(error) => return Err(error.into()),
                }
                // What this frame looks at stays: the rest of it shows coarse.
                let oldest = self.tiles.iter_mut().filter(|shelf| shelf.whole.is_some_and(|last| last < now));
                let Some(oldest) = oldest.min_by_key(|shelf| shelf.whole) else { return Ok(counts) };
                self.cache.make_coarse(gpu, oldest.texture);
                oldest.whole = None;
                counts[1] += 1;
            }
            self.tiles[place].whole = Some(now);
            counts[0] += 1;
        }
        Ok(counts)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let bank =
        arguments.next().ok_or("name a bank: the folder that `texfold bank add --mips --out` wrote")?;
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "target/bank-flight".to_owned()));
    std::fs::create_dir_all(&folder)?;
    let bank: Bank = Bank::open(bank.as_ref())?;
    let gpu = Gpu::new(Policy::from_env())?;
    let start = Instant::now();
    let mut shown = Shown::new(&gpu, &bank)?;
    let texels: f64 =
        bank.images().iter().map(|image| f64::from(image.width) * f64::from(image.height)).sum();
    println!(
        "{}: {} images, {} tiles, {:.0} megatexels; {:.0} MB on the GPU with the pool; coarse after {:.1} s",
        gpu.info().name,
        bank.images().len(),
        shown.tiles.len(),
        texels / 1e6,
        shown.cache.bytes() as f64 / 1e6,
        start.elapsed().as_secs_f64(),
    );
    let (quads, places) = quads(&shown);
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
        let [read, gone] = shown.read(&gpu, &uses, number)?;
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

/// A rectangle for each tile, images side by side; the middle of each image.
fn quads(shown: &Shown<'_>) -> (Vec<Quad>, Vec<Vec3>) {
    let mut textures = shown.tiles.iter().map(|shelf| shelf.texture.index());
    let (mut quads, mut places, mut left) = (Vec::new(), Vec::new(), 0.0);
    for image in shown.bank.images() {
        let corner = |x: u32, y: u32| Vec3::new(left + x as f32 / UNIT, 0.0, y as f32 / UNIT);
        for (tile, texture) in image.tiles.iter().zip(&mut textures) {
            quads.push(Quad {
                corner: corner(tile.x, tile.y),
                across: Vec3::new(tile.width as f32 / UNIT, 0.0, 0.0),
                down: Vec3::new(0.0, 0.0, tile.height as f32 / UNIT),
                repeats: [1.0, 1.0],
                texture,
            });
        }
        places.push(corner(image.width / 2, image.height / 2));
        left += image.width as f32 / UNIT + 0.1;
    }
    (quads, places)
}
