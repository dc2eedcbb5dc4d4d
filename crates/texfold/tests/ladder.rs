//! More bits are never worse, and a lower goal never takes more: every codec of images over a ladder of goals, on images that none was
//! tuned on.

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use texfold::core::image::{ColorSpace, ImageSet, Raster};
use texfold::core::metric::measure;
use texfold::core::rng::Rng;
use texfold::encoding::{ENCODINGS, Encoding};
use texfold::{Effort, EncodeSettings, Goal, Guidance, Job, Metric};
use texfold_testkit::full;

/// Bits a texel.
const BITS: [f64; 8] = [0.4, 0.7, 1.0, 1.5, 2.2, 3.2, 4.5, 6.5];
/// Loss of PSNR in dB with more bits that is borne.
const LOSS: f64 = 0.05;
/// PSNR in dB.
const QUALITIES: [f64; 8] = [22.0, 25.0, 28.0, 31.0, 34.0, 37.0, 40.0, 43.0];

/// Images made from a number: overlapping discs, waves and grain, in shapes that blocks do not divide.
fn drawn(seed: u64) -> ImageSet {
    let mut rng = Rng::new(seed);
    let (width, height) = (40 + rng.below(50), 40 + rng.below(50));
    let mut unit = || rng.below(1 << 16) as f32 / 65536.0;
    let discs: Vec<[f32; 6]> = (0..9)
        .map(|_| [unit() * width as f32, unit() * height as f32, 4.0 + 14.0 * unit(), unit(), unit(), unit()])
        .collect();
    let (across, down, grain) = (unit() * 0.8, unit() * 0.8, unit() * 0.15);
    let mut bytes = Vec::new();
    for place in 0..width * height {
        let (x, y) = ((place % width) as f32, (place / width) as f32);
        let wave = 0.5 + 0.2 * (across * x + down * y).sin();
        let near = |disc: &&[f32; 6]| (x - disc[0]).hypot(y - disc[1]) < disc[2];
        let colour =
            discs.iter().rev().find(near).map_or([wave, 0.6, wave * 0.8], |&[.., r, g, b]| [r, g, b]);
        let noise = grain * (unit() - 0.5);
        bytes.extend(colour.map(|value| ((value + noise).clamp(0.0, 1.0) * 255.0).round() as u8));
    }
    ImageSet::single(Raster::from_u8(width, height, 3, ColorSpace::Srgb, &bytes).unwrap())
}

/// An image of one row of texels.
fn line() -> ImageSet {
    let bytes: Vec<u8> =
        (0..1024u32).flat_map(|x| [x / 4, (x * 7) % 251, 40 + x % 3].map(|v| v as u8)).collect();
    ImageSet::single(Raster::from_u8(1024, 1, 3, ColorSpace::Srgb, &bytes).unwrap())
}

fn images() -> Vec<(String, ImageSet)> {
    let seeds = if full() { 12 } else { 1 };
    let drawn = (0..seeds).map(|seed| (format!("drawn {seed}"), drawn(1000 + seed)));
    drawn.chain([("line".to_owned(), line())]).collect()
}

fn measured(encoding: &Encoding, set: &ImageSet, goal: Goal) -> (f64, f64) {
    let settings = EncodeSettings {
        goal,
        metric: Some(Metric::Psnr),
        effort: Effort::Fast,
        ..EncodeSettings::default()
    };
    let made = encoding.encode(set, Guidance::default(), &settings, &mut Job::default()).unwrap();
    let found = measure(set, made.as_encoded());
    (found.psnr, found.bpp)
}

#[test]
fn more_bits_are_never_worse() {
    let mut faults = Vec::new();
    for (name, set) in images() {
        for encoding in &ENCODINGS {
            let mut best: (f64, f64) = (0.0, 0.0);
            for bits in BITS {
                let (psnr, bpp) = measured(encoding, &set, Goal::Bpp(bits));
                if psnr < best.0 - LOSS {
                    faults.push(format!(
                        "{} of {name}: {psnr:.2} dB at {bits} bits ({bpp:.2}), {:.2} at {}",
                        encoding.id, best.0, best.1
                    ));
                }
                if psnr > best.0 {
                    best = (psnr, bits);
                }
            }
        }
    }
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}

#[test]
fn a_lower_goal_takes_no_more_bits() {
    let mut faults = Vec::new();
    for (name, set) in images() {
        for encoding in &ENCODINGS {
            let mut before: Option<(f64, f64, f64)> = None;
            for goal in QUALITIES {
                let (psnr, bpp) = measured(encoding, &set, Goal::Psnr(goal));
                // A goal that cannot be met says nothing of the bits.
                if let Some((other, bits, reached)) = before.filter(|&(.., reached)| reached <= psnr + LOSS)
                    && bpp < bits * 0.999
                {
                    faults.push(format!("{} of {name}: {bpp:.3} bits for {goal} dB ({psnr:.2}), {bits:.3} for {other} ({reached:.2})", encoding.id));
                }
                before = Some((goal, bpp, psnr));
            }
        }
    }
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}
