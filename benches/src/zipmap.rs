//! Zipmaps: how many close-ups of known place registration finds, how many pairs it falsely takes for a match, and how fast a texture
//! of many patches is drawn.
//!
//! `cargo run --release -p texfold-benches --bin zipmap [register|reject|draw]`.

use glam::{Affine2, DMat3, DVec2};
use texfold::core::image::Raster;
use texfold::{
    AnyImage, Content, Effort, Goal, Job, Texel,
    core::Encoder,
    zipmap::{PatchSource, PatchStack, ZipParams, Zipmap, register},
};

use texfold_gpu::{Gpu, Lookup, Policy, Probe, View};
use texfold_testkit::leaves::{Leaves, Lens, close_up, photograph};
use texfold_testkit::rng::Rng;

/// Pixels of a photograph.
const SIZE: (u32, u32) = (480, 400);
/// Photographs at each zoom.
const TRIALS: u64 = 25;
/// Zooms.
const ZOOMS: [f64; 6] = [2.0, 3.0, 4.0, 6.0, 8.0, 12.0];
/// Pairs that show nothing in common.
const PAIRS: u64 = 200;
/// Pixels of a draw.
const DRAWN: u32 = 1024;
/// One level of each patch, four texels; two levels, eight.
const LOOKUPS: [(&str, Lookup); 2] =
    [("one level", Lookup::Bilinear { level: 0 }), ("two levels", Lookup::Level { lod: 0.5 })];

fn main() {
    let wanted = std::env::args().nth(1).unwrap_or_default();
    for (name, run) in [("register", registered as fn()), ("reject", rejected), ("draw", drawn)] {
        if wanted.is_empty() || wanted == name {
            run();
        }
    }
}

fn shot(leaves: &Leaves, matrix: &DMat3, rng: &mut Rng) -> Raster {
    let lens = Lens { exposure: rng.between(0.7, 1.3), noise: rng.between(0.0, 0.03), seed: rng.seed() };
    photograph(&leaves.view(matrix, SIZE, 2), SIZE, lens)
}

/// The matrix of the only placed photograph.
fn found(photos: &[Raster]) -> Option<DMat3> {
    let found = register(photos, &mut Job::default()).ok()?;
    found.placed.first().map(|placed| placed.matrix)
}

fn registered() {
    println!(
        "zoom   found within 1 pixel of the close-up, of {TRIALS}; exposure 0.7 to 1.3, noise to 3%, turned and slanted"
    );
    for zoom in ZOOMS {
        let mut rng = Rng::new(zoom as u64);
        let (mut near, mut worst) = (0, 0f64);
        for trial in 0..TRIALS {
            let leaves = Leaves::new(trial, 60_000);
            let middle = DVec2::new(rng.between(0.3, 0.7), rng.between(0.3, 0.7));
            let slant = DVec2::new(rng.between(-0.1, 0.1), rng.between(-0.1, 0.1));
            let truth = close_up(middle, zoom, rng.between(-0.6, 0.6), slant);
            let photos = [shot(&leaves, &DMat3::IDENTITY, &mut rng), shot(&leaves, &truth, &mut rng)];
            let Some(matrix) = found(&photos) else { continue };
            let size = DVec2::new(f64::from(SIZE.0), f64::from(SIZE.1));
            let to = |matrix: DMat3, place: DVec2| {
                let moved = matrix * place.extend(1.0);
                moved.truncate() / moved.z
            };
            let corners = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE];
            let off = |corner: DVec2| ((to(matrix * truth.inverse(), corner) - corner) * size).length();
            let mean = corners.map(off).into_iter().sum::<f64>() / 4.0;
            worst = worst.max(mean);
            near += u32::from(mean < 1.0);
        }
        println!("{zoom:>4}   {near:>3}   largest distance of those found {worst:.2} pixels");
    }
}

fn rejected() {
    let mut rng = Rng::new(99);
    let mut taken = 0;
    for pair in 0..PAIRS {
        // By turns two surfaces, two parts of one, and a tile that repeats.
        let first = Leaves::new(1000 + pair, 60_000);
        let photos = match pair % 3 {
            0 => {
                let second = Leaves::new(5000 + pair, 60_000);
                [shot(&first, &DMat3::IDENTITY, &mut rng), shot(&second, &DMat3::IDENTITY, &mut rng)]
            }
            1 => [DVec2::splat(0.2), DVec2::splat(0.8)]
                .map(|middle| shot(&first, &close_up(middle, 3.0, 0.0, DVec2::ZERO), &mut rng)),
            _ => [(0.0, 48.0), (0.4, 100.0)].map(|(shift, side)| {
                let colour = |i: u32| {
                    let at = DVec2::new(f64::from(i % SIZE.0), f64::from(i / SIZE.0)) / side + shift;
                    first.colour(at - at.floor())
                };
                let texels: Vec<_> = (0..SIZE.0 * SIZE.1).map(colour).collect();
                photograph(&texels, SIZE, Lens { exposure: 1.0, noise: 0.01, seed: pair })
            }),
        };
        taken += u32::from(found(&photos).is_some());
    }
    println!("{taken} of {PAIRS} pairs with nothing in common, or that repeat, are taken for a match");
}

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

fn drawn() {
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
            let view = View { surface: 0, size: (DRAWN, DRAWN), uv: Affine2::IDENTITY, lookup };
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
