//! Shader decoding beside a shader that only makes the same loads and beside a plain textured draw, in one run.
//!
//! `cargo bench -p texfold-benches --bench shader`. Needs an adapter; software Vulkan serves. With a word behind `--`
//! only the textures whose names hold it are drawn.

use std::time::{Duration, Instant};

use texfold::Effort;
use texfold::core::image::ImageSet;
use texfold::{AnyImage, Content};
use texfold_benches::{bc, epitome, epitome_params, image_of, paper_params, progressive, vq};
use texfold_gpu::{Gpu, GpuError, Lookup, Policy, Probe, View};

/// Pixels a side of the drawn image: one for each texel.
const SIDE: u32 = 1024;
/// Draws a measurement, and measurements of which the median counts.
const DRAWS: u32 = 8;
const ROUNDS: usize = 5;
/// Draws before those that count.
const WARM_UP: Duration = Duration::from_millis(200);

/// A texture of an image; `None` where it cannot be encoded.
type Make = fn(&ImageSet) -> Option<AnyImage>;

const TEXTURES: [(&str, Make); 8] = [
    ("vq raw", |set| vq(set, &paper_params())),
    ("vq bc1", |set| vq(set, &paper_params().with_content(Content::Bc1))),
    ("epitome raw", |set| epitome(set, &epitome_params(Some(Content::Raw)))),
    ("epitome bc1", |set| epitome(set, &epitome_params(Some(Content::Bc1)))),
    ("epitome bc1+bc7", |set| epitome(set, &epitome_params(None))),
    ("progressive", |set| progressive(set, 2.7, Effort::Fast)),
    ("plain raw", |set| bc(set, Content::Raw)),
    ("plain bc1", |set| bc(set, Content::Bc1)),
];

fn main() -> Result<(), GpuError> {
    let gpu = match Gpu::new(Policy::from_env()) {
        Ok(gpu) => gpu,
        Err(error) => {
            println!("skipped: {error}");
            return Ok(());
        }
    };
    println!(
        "{}: megatexels a second, and speed over that of a shader with the same loads only",
        gpu.info().name
    );
    println!("{:<15} {:<9} {:>8} {:>8} {:>8} {:>7}", "texture", "lookup", "ours", "loads", "plain", "ratio");
    let set = image_of(&texfold_testkit::image("terrain"), SIDE);
    let wanted = std::env::args().skip(1).find(|word| !word.starts_with('-')).unwrap_or_default();
    for (name, make) in TEXTURES.into_iter().filter(|(name, _)| name.contains(&wanted)) {
        let Some(texture) = make(&set) else { continue };
        let uploaded = gpu.upload(&texture.as_encoded().gpu())?;
        for (lookup_name, lookup) in
            [("nearest", Lookup::Nearest { level: 0 }), ("bilinear", Lookup::Bilinear { level: 0 })]
        {
            let view = View { image: 0, size: (SIDE, SIDE), uv: glam::Affine2::IDENTITY, lookup };
            // GPUs raise their clock with the load.
            let start = Instant::now();
            while start.elapsed() < WARM_UP {
                gpu.time(&uploaded, &view, Probe::Lookup, DRAWS)?;
            }
            let mut speeds = [Vec::new(), Vec::new(), Vec::new()];
            for _ in 0..ROUNDS {
                for (speed, probe) in speeds.iter_mut().zip([Probe::Lookup, Probe::LoadsOnly, Probe::Plain]) {
                    let seconds = gpu.time(&uploaded, &view, probe, DRAWS)?;
                    speed.push(f64::from(SIDE * SIDE) / seconds / 1e6);
                }
            }
            let [ours, loads_only, plain] = speeds.map(median);
            println!(
                "{name:<15} {lookup_name:<9} {ours:>8.1} {loads_only:>8.1} {plain:>8.1} {:>7.2}",
                ours / loads_only
            );
        }
    }
    Ok(())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
