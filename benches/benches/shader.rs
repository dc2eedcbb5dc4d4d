//! Shader decoding beside a shader that only makes the same loads and beside a plain textured draw, in one run.
//!
//! `cargo bench -p texfold-benches --bench shader`. Needs an adapter; software Vulkan serves.

use texfold::Content;
use texfold_benches::{bc, paper_params, picture_of, vq};
use texfold_gpu::{Gpu, GpuError, Lookup, Policy, Probe, View};

/// Pixels a side of the drawn picture: one for each texel.
const SIDE: u32 = 1024;
/// Draws a measurement, and measurements of which the median counts.
const DRAWS: u32 = 8;
const ROUNDS: usize = 5;

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
    println!("{:<10} {:<9} {:>8} {:>8} {:>8} {:>7}", "texture", "lookup", "ours", "bare", "plain", "ratio");
    let set = picture_of(&texfold_testkit::picture("terrain"), SIDE);
    let textures = [
        ("vq raw", vq(&set, &paper_params())),
        ("vq bc1", vq(&set, &texfold::VqParams { content: Some(Content::Bc1), ..paper_params() })),
        ("plain raw", bc(&set, Content::Raw)),
        ("plain bc1", bc(&set, Content::Bc1)),
    ];
    for (name, texture) in textures {
        let Some(texture) = texture else { continue };
        let uploaded = gpu.upload(&texture.as_encoded().gpu())?;
        for (lookup_name, lookup) in
            [("nearest", Lookup::Nearest { level: 0 }), ("bilinear", Lookup::Bilinear { level: 0 })]
        {
            let view = View { surface: 0, size: (SIDE, SIDE), uv: glam::Affine2::IDENTITY, lookup };
            let mut speeds = [Vec::new(), Vec::new(), Vec::new()];
            for _ in 0..ROUNDS {
                for (speed, probe) in speeds.iter_mut().zip([Probe::Lookup, Probe::Bare, Probe::Plain]) {
                    let seconds = gpu.time(&uploaded, &view, probe, DRAWS)?;
                    speed.push(f64::from(SIDE * SIDE) / seconds / 1e6);
                }
            }
            let [ours, bare, plain] = speeds.map(median);
            println!("{name:<10} {lookup_name:<9} {ours:>8.1} {bare:>8.1} {plain:>8.1} {:>7.2}", ours / bare);
        }
    }
    Ok(())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
