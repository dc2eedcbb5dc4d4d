//! Zipmaps: how fast a texture of many patches is drawn.
//!
//! `cargo run --release -p texfold-benches --bin zipmap`.

use glam::{Affine2, DMat3, DVec2};
use texfold::{
    AnyImage, Content, Effort, Goal, Job, Texel,
    core::Encoder,
    zipmap::{PatchSource, PatchStack, ZipParams, Zipmap},
};

use texfold_gpu::{Gpu, Lookup, Policy, Probe, View};
use texfold_testkit::leaves::{Leaves, Lens, close_up, photograph};

/// Pixels of a draw.
const DRAWN: u32 = 1024;
/// One level of each patch, four texels; two levels, eight.
const LOOKUPS: [(&str, Lookup); 2] =
    [("one level", Lookup::Bilinear { level: 0 }), ("two levels", Lookup::Level { lod: 0.5 })];

/// `count` patches on a root, so that at most six lie over one another.
fn texture(count: usize) -> Option<AnyImage> {
    let leaves = Leaves::new(1, 60_000);
    let lens = Lens { exposure: 1.0, noise: 0.0, seed: 1 };
    let view = |matrix: &DMat3, size| photograph(&leaves.view(matrix, size, 1), size, lens);
    let size = if count > 6 { (128, 128) } else { (512, 512) };
    let columns = (count as f64 / 6.0).sqrt().ceil().max(1.0);
    let mut stack =
        PatchStack { root: view(&DMat3::IDENTITY, (512, 512)), images: Vec::new(), patches: Vec::new() };
    for index in 0..count {
        let cell = (index / 6) as f64;
        let middle = (DVec2::new(cell % columns, (cell / columns).floor() % columns) + 0.5) / columns;
        let matrix = close_up(middle, columns, 0.0, DVec2::ZERO);
        stack.images.push(view(&matrix, size));
        // Half shown, so that none is hidden.
        let mask = Some(photograph(&vec![Texel::splat(0.5); (size.0 * size.1) as usize], size, lens));
        stack.patches.push(PatchSource { image: index, matrix, mask, parent: None });
    }
    let params = ZipParams::default()
        .with_goal(Goal::Bpp(1e6))
        .with_content(Content::Raw)
        .with_tau(0.05)
        .with_drop_rms(0.0)
        .with_effort(Effort::Fast);
    let made = Zipmap::encode(&stack, &params, &mut Job::default()).ok()?;
    println!("{} patches of {count} are kept", made.patches());
    Some(AnyImage::new(made))
}

fn main() {
    let gpu = match Gpu::new(Policy::from_env()) {
        Ok(gpu) => gpu,
        Err(error) => return println!("skipped: {error}"),
    };
    println!(
        "{}: megatexels a second; loads only: the same loads, without what is computed between them",
        gpu.info().name
    );
    for count in [0, 1, 6, 200] {
        let Some(texture) = texture(count) else { continue };
        let Ok(uploaded) = gpu.upload(&texture.as_encoded().gpu()) else { continue };
        for (name, lookup) in LOOKUPS {
            let view = View { image: 0, size: (DRAWN, DRAWN), uv: Affine2::IDENTITY, lookup };
            let speed = |probe| {
                let mut times: Vec<f64> =
                    (0..5).filter_map(|_| gpu.time(&uploaded, &view, probe, 4).ok()).collect();
                times.sort_by(f64::total_cmp);
                // The least: what else runs on the machine only adds.
                f64::from(DRAWN * DRAWN) / times.first().copied().unwrap_or(f64::INFINITY) / 1e6
            };
            let (ours, loads_only) = (speed(Probe::Lookup), speed(Probe::LoadsOnly));
            println!(
                "{count:>4} patches, {name}: {ours:>7.2}, loads only {loads_only:>7.2}, ratio {:.2}",
                ours / loads_only
            );
        }
    }
}
