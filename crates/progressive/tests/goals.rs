//! Goals of bits of the form that is read by texel: what more of them buy.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use texfold_core::image::{Alpha, ImageSet, PixelInfo, Raster};
use texfold_core::metric::{SquaredError, quality};
use texfold_core::{Effort, Encoder, Goal, Job, Texel};
use texfold_progressive::{Progressive, ProgressiveParams};
use texfold_testkit::full;

/// Columns and rows of the images here: an encoding takes a tenth of a second.
const SIDE: u32 = 128;
/// Decibels by which a texture may be worse than one of fewer bits: the rate model and lambda of each goal are their own, and
/// what blocks then come to differs by so much from what was estimated.
const NOISE: f64 = 0.05;

/// The middle of the terrain, its left fifth transparent where `collar` says so.
fn terrain(channels: u8, collar: bool) -> ImageSet {
    let whole = texfold_testkit::image("terrain").with_channels(channels);
    let texels: Vec<Texel> = (0..SIDE * SIDE)
        .map(|i| {
            let texel = whole.texel(64 + i % SIDE, 64 + i / SIDE);
            if collar && i % SIDE < SIDE / 5 { texel.truncate().extend(0.0) } else { texel }
        })
        .collect();
    let alpha = if channels == 4 { Alpha::Straight } else { Alpha::Opaque };
    let info = PixelInfo { channels, alpha, ..whole.info() };
    ImageSet::single(Raster::from_texels(SIDE, SIDE, info, &texels).unwrap())
}

/// PSNR of colours and alpha by the sum of their squared errors, which is what goals of bits lessen.
fn reached(set: &ImageSet, bpp: f64) -> f64 {
    let params = ProgressiveParams::default().with_goal(Goal::Bpp(bpp)).with_effort(Effort::Fast);
    let texture = Progressive::encode(set, &params, &mut Job::default()).unwrap();
    let found = quality(set, &texture);
    let alpha = found.alpha.map_or(0.0, |alpha| alpha.sum);
    (found.color + SquaredError { sum: alpha, count: 0 }).psnr()
}

#[test]
fn more_bits_are_never_worse_with_alpha_or_without() {
    for (name, set) in [
        ("collar", terrain(4, true)),
        ("opaque, four channels", terrain(4, false)),
        ("three channels", terrain(3, false)),
    ] {
        let mut best = (0.0, f64::MIN);
        for step in (2..=40).step_by(if full() { 1 } else { 4 }) {
            let bpp = 0.05 * f64::from(step);
            let psnr = reached(&set, bpp);
            assert!(
                psnr > best.1 - NOISE,
                "{name}: {psnr:.2} dB at {bpp:.2} bits per texel, {:.2} dB at {:.2}",
                best.1,
                best.0
            );
            if psnr > best.1 {
                best = (bpp, psnr);
            }
        }
    }
}
