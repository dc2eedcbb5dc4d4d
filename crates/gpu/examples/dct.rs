//! Times the decoder of textures in blocks against the CPU's: `cargo run --release --example dct -- IMAGE [BITS] [SIDE_LOG2]`.
//!
//! Prints megatexels a second of wall clock; a software renderer uses all cores of the machine and the CPU's decoder, without
//! the feature `encode`, one: with `RAYON_NUM_THREADS=1` both figures are of one core where the process is pinned to one.

use std::error::Error;
use std::time::Instant;

use texfold_core::{CancelCheck, Goal, ImageSize, Rect};
use texfold_dct::Stage;
use texfold_dct::encode::{DctEncoder, DctSettings, DctSource};
use texfold_gpu::{DctDecoder, Gpu, Policy, wgpu};

/// How often each decoder runs; the best time counts.
const REPEATS: u32 = 5;

/// The least seconds of some runs.
fn seconds(mut work: impl FnMut() -> Result<(), Box<dyn Error>>) -> Result<f64, Box<dyn Error>> {
    let mut least = f64::INFINITY;
    for _ in 0..REPEATS {
        let start = Instant::now();
        work()?;
        least = least.min(start.elapsed().as_secs_f64());
    }
    Ok(least)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("name an image")?;
    let bits: f64 = arguments.next().map_or(Ok(1.28), |bits| bits.parse())?;
    let log2: u8 = arguments.next().map_or(Ok(5), |side| side.parse())?;
    let image = image::open(path)?.to_rgb8();
    let (width, height) = image.dimensions();
    let size = ImageSize { width, height };
    let source = DctSource::from_u8(size, &[3], image.as_raw())?;
    let params = DctSettings::default().with_goal(Goal::Bpp(bits)).with_superblock_log2(log2);
    let texture = DctEncoder::new(&source, &params, CancelCheck::default())?.encode()?;
    let megatexels = size.texels() as f64 / 1e6;

    let rect = Rect { image: 0, level: 0, x: 0, y: 0, width, height };
    let mut samples = vec![0u8; 3 * size.texels() as usize];
    let cpu = seconds(|| Ok(texture.decode(rect, &mut samples)?))?;
    println!("CPU: {:.1} megatexels/s", megatexels / cpu);

    let gpu = Gpu::new(Policy::from_env())?;
    let decoder = DctDecoder::new(&gpu)?;
    let image = decoder.upload(&gpu, &texture.gpu(Stage::default()))?;
    println!("{}: {} bytes for {} of streams", gpu.info().name, image.bytes(), texture.to_bytes().len());
    let target = decoder.decode(&gpu, &image, rect, image.colours())?;
    let drawn = seconds(|| {
        decoder.decode_into(&gpu, &image, rect, image.colours(), &target, [0, 0])?;
        gpu.device().poll(wgpu::PollType::wait_indefinitely())?;
        Ok(())
    })?;
    println!("GPU: {:.1} megatexels/s", megatexels / drawn);
    Ok(())
}
