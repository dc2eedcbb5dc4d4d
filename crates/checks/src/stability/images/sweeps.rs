//! Where methods for images stop working: bits at one quality, and quality at one number of bits, as what recurs becomes less alike.
//!
//! The images are mosaics of one motif, which has detail at all scales: in the first cell as it is, in the n-th n times as much turned,
//! enlarged, brightened. What is stored once serves all cells as long as a method finds and can express how they differ.

use glam::DVec2;
use rayon::prelude::*;
use texfold::core::image::{ImageSet, Raster};
use texfold::core::metric::{decode_image, measure};
use texfold::{
    AnyImage, Choice, EncodeSettings, Goal, Guidance, Job, Texel, encode_images, encoding::ENCODINGS,
};
use texfold_testkit::leaves::{Leaves, Lens, photograph};

use super::settings;
use crate::stability::atlas::{Failure, Picture, falls, sentence};
use crate::stability::page::png;
use crate::stability::record::{Curve, Point};
use crate::stability::{Extent, Outcome};

/// Quality at which bits are taken, in dB.
const AT_DB: f64 = 32.0;
/// Bits a texel at which quality is taken.
const AT_BPP: f64 = 1.0;
/// What charts have upwards at that number.
const UP_AT_BPP: &str = "PSNR at 1 bit a texel, dB";
/// PSNR above which charts would show nothing else.
const CEILING_DB: f64 = 60.0;
/// Cells a side, and texels a side of a cell: no multiple of a block.
const CELLS: u32 = 4;
const CELL: u32 = 54;
/// Part of the surface that a cell shows.
const SHOWN: f64 = 0.2;
/// Places a side whose mean a texel is.
const GRID: u32 = 3;

/// How the cells of a mosaic differ, and what a camera does to it.
#[derive(Debug, Clone, Copy, Default)]
struct Mosaic {
    /// Degrees by which each cell is turned against the one before.
    turn: f64,
    /// Per cent by which the last cell is enlarged against the first.
    enlarged: f64,
    /// Per cent by which the last cell is brighter than the first.
    brighter: f64,
    /// Deviation of the noise in 8-bit units.
    noise: f64,
    /// Radius of a mean over texels.
    blur: u32,
}

/// One property and how far it is varied.
struct Sweep {
    title: &'static str,
    across: &'static str,
    /// Quick ones first; the others are added in full runs.
    values: [f64; 6],
    mosaic: fn(f64) -> Mosaic,
}

/// Values of [`Sweep::values`] that a quick run takes.
const QUICK: usize = 3;

const SWEEPS: [Sweep; 5] = [
    Sweep {
        title: "Rotation of what recurs",
        across: "degrees from cell to cell",
        values: [0.0, 3.0, 22.5, 1.0, 10.0, 45.0],
        mosaic: |turn| Mosaic { turn, ..Mosaic::default() },
    },
    Sweep {
        title: "Scale of what recurs",
        across: "per cent that the last cell is enlarged",
        values: [0.0, 20.0, 100.0, 5.0, 10.0, 50.0],
        mosaic: |enlarged| Mosaic { enlarged, ..Mosaic::default() },
    },
    Sweep {
        title: "Brightness of what recurs",
        across: "per cent that the last cell is brighter",
        values: [0.0, 20.0, 80.0, 5.0, 10.0, 40.0],
        mosaic: |brighter| Mosaic { brighter, ..Mosaic::default() },
    },
    Sweep {
        title: "Noise",
        across: "deviation in 8-bit units",
        values: [0.0, 4.0, 12.0, 1.0, 2.0, 8.0],
        mosaic: |noise| Mosaic { noise, ..Mosaic::default() },
    },
    Sweep {
        title: "Blur",
        across: "radius of the mean in texels",
        values: [0.0, 1.0, 4.0, 2.0, 3.0, 6.0],
        mosaic: |blur| Mosaic { blur: blur as u32, ..Mosaic::default() },
    },
];

/// Tolerances in 8-bit units: quick ones first.
const TOLERANCES: [f64; 6] = [2.0, 8.0, 24.0, 4.0, 12.0, 16.0];

/// All charts of images.
///
/// # Errors
/// Where a mosaic cannot be made.
pub(in crate::stability) fn curves(extent: Extent) -> Outcome<Vec<Curve>> {
    let leaves = Leaves::new(11, 60_000);
    let mut all = Vec::new();
    for sweep in &SWEEPS {
        let values = taken(&sweep.values, extent);
        let mosaics: Vec<ImageSet> =
            values.iter().map(|&value| mosaic(&leaves, (sweep.mosaic)(value))).collect::<Outcome<_>>()?;
        for (goal, up) in [(Goal::Psnr(AT_DB), "bits a texel at 32 dB"), (Goal::Bpp(AT_BPP), UP_AT_BPP)] {
            let at = |index: usize| (&mosaics[index], goal);
            let lines = lines(&values, at);
            all.push(Curve { title: format!("{}: {up}", sweep.title), across: sweep.across, up, lines });
        }
    }
    all.extend(tolerances(&leaves, extent)?);
    Ok(all)
}

/// What each codec withstands least, of what is varied at [`AT_BPP`], by the charts of [`curves`].
///
/// # Errors
/// Where a picture cannot be made.
pub(in crate::stability) fn failures(curves: &[Curve]) -> Outcome<Vec<Failure>> {
    let leaves = Leaves::new(11, 60_000);
    let at_equal_bits = || curves.iter().filter(|curve| curve.up == UP_AT_BPP);
    let mut all = Vec::new();
    for encoding in ENCODINGS {
        let codec = encoding.id.name;
        let falls = falls(at_equal_bits(), codec, Some(0.0));
        let fallback = match falls.first().and_then(|fall| fall.values_where(|point| point.gave_way)) {
            Some(values) => format!("and falls back to a plainer form at {values}"),
            None => "and does not fall back to a plainer form".to_owned(),
        };
        let name = |title: &str| title.split(':').next().unwrap_or_default().to_owned();
        let sentence = sentence(codec, &falls, name, "dB at 1 bit a texel", &fallback);
        let mut pictures = Vec::new();
        if let Some(fall) = falls.first() {
            for value in [fall.best.x, fall.worst.x] {
                let image = mosaic(&leaves, (SWEEPS[fall.index].mosaic)(value))?;
                pictures
                    .push(Picture { png: png(&image.images()[0])?, caption: format!("{value}: encoded") });
                if let Some(made) = made(codec, &image, Goal::Bpp(AT_BPP)) {
                    let caption = format!("{value}: {:.1} dB", measure(&image, made.as_encoded()).psnr);
                    let decoded = decode_image(made.as_encoded(), 0, 0).ok_or("level 0 is missing")?;
                    pictures.push(Picture { png: png(&decoded)?, caption });
                }
            }
        }
        all.push(Failure { method: codec.to_owned(), sentence, pictures });
    }
    Ok(all)
}

/// The values of a run, in order.
fn taken(values: &[f64], extent: Extent) -> Vec<f64> {
    let count = if extent == Extent::Full { values.len() } else { QUICK };
    let mut taken = values[..count].to_vec();
    taken.sort_by(f64::total_cmp);
    taken
}

/// Bits and quality against the tolerance of blocks.
fn tolerances(leaves: &Leaves, extent: Extent) -> Outcome<Vec<Curve>> {
    let image = mosaic(leaves, Mosaic { turn: 3.0, ..Mosaic::default() })?;
    let values = taken(&TOLERANCES, extent);
    let of_goals = lines_of(&values, |index| (&image, Goal::Tolerance(values[index])));
    let curve = |up: &'static str, of: fn(&Found) -> f64| Curve {
        title: format!("Tolerance of blocks: {up}"),
        across: "largest RMS error of a block in 8-bit units",
        up,
        lines: of_goals.iter().map(|(name, found)| (name.clone(), points(&values, found, of))).collect(),
    };
    Ok(vec![curve("bits a texel", |found| found.bpp), curve("PSNR, dB", |found| found.psnr)])
}

/// What an encode came to.
#[derive(Debug, Clone, Copy)]
struct Found {
    psnr: f64,
    bpp: f64,
    gave_way: bool,
}

/// A line for every codec: bits for goals of quality, PSNR for goals of bits.
fn lines<'i>(values: &[f64], at: impl Fn(usize) -> (&'i ImageSet, Goal) + Sync) -> Vec<(String, Vec<Point>)> {
    let is_bits = matches!(at(0).1, Goal::Psnr(_));
    let figure = if is_bits { |found: &Found| found.bpp } else { |found: &Found| found.psnr };
    let found = lines_of(values, at);
    found.into_iter().map(|(name, found)| (name, points(values, &found, figure))).collect()
}

fn points(values: &[f64], found: &[Option<Found>], figure: fn(&Found) -> f64) -> Vec<Point> {
    let point = |(&x, found): (&f64, &Option<Found>)| {
        found.map(|found| Point { x, y: figure(&found), gave_way: found.gave_way })
    };
    values.iter().zip(found).filter_map(point).collect()
}

/// Every codec at every value; nothing where it refuses.
fn lines_of<'i>(
    values: &[f64],
    at: impl Fn(usize) -> (&'i ImageSet, Goal) + Sync,
) -> Vec<(String, Vec<Option<Found>>)> {
    let places: Vec<(usize, usize)> =
        (0..ENCODINGS.len()).flat_map(|codec| (0..values.len()).map(move |value| (codec, value))).collect();
    let found: Vec<Option<Found>> = places
        .into_par_iter()
        .map(|(codec, value)| {
            let (images, goal) = at(value);
            encoded(ENCODINGS[codec].id.name, images, goal)
        })
        .collect();
    let of_codec = |(encoding, found): (&texfold::encoding::Encoding, &[Option<Found>])| {
        (encoding.id.name.to_owned(), found.to_vec())
    };
    ENCODINGS.iter().zip(found.chunks(values.len())).map(of_codec).collect()
}

fn made(codec: &str, images: &ImageSet, goal: Goal) -> Option<AnyImage> {
    // PSNR is what is charted: where bits are the goal, squares are to count.
    let metric = Some(texfold::Metric::Psnr);
    let encoding = ENCODINGS.iter().find(|encoding| encoding.id.name == codec)?;
    let metric = metric.filter(|_| encoding.has_metric);
    let usual = *encoding.accesses.first()?;
    let settings = EncodeSettings { metric, ..settings(&Choice::named(codec)?, usual, goal) };
    encode_images(images, Guidance::default(), &settings, &mut Job::default()).ok()
}

fn encoded(codec: &str, images: &ImageSet, goal: Goal) -> Option<Found> {
    let made = made(codec, images, goal)?;
    let measured = measure(images, made.as_encoded());
    let gave_way = made.as_encoded().codec().name != codec;
    Some(Found { psnr: measured.psnr.min(CEILING_DB), bpp: measured.bpp, gave_way })
}

/// An image of cells that show one motif.
fn mosaic(leaves: &Leaves, kind: Mosaic) -> Outcome<ImageSet> {
    let last = f64::from(CELLS * CELLS - 1);
    let side = CELLS * CELL;
    let texel = |i: u32| {
        let (x, y) = (i % side, i / side);
        let cell = f64::from(y / CELL * CELLS + x / CELL);
        let share = cell / last;
        let turned = DVec2::from_angle((cell * kind.turn).to_radians());
        let scale = SHOWN / f64::from(CELL) / (1.0 + kind.enlarged / 100.0 * share);
        let place = |k: u32| {
            let inside = (DVec2::new(f64::from(k % GRID), f64::from(k / GRID)) + 0.5) / f64::from(GRID);
            let offset =
                DVec2::new(f64::from(x % CELL), f64::from(y % CELL)) + inside - 0.5 * f64::from(CELL);
            leaves.colour(DVec2::splat(0.5) + scale * turned.rotate(offset))
        };
        let mean = (0..GRID * GRID).map(place).sum::<Texel>() / (GRID * GRID) as f32;
        // The brightest cell is as it is: none is cut off.
        let gain = (1.0 + kind.brighter / 100.0 * share) / (1.0 + kind.brighter / 100.0);
        mean * gain as f32
    };
    let texels: Vec<Texel> = (0..side * side).map(texel).collect();
    let lens = Lens { exposure: 1.0, noise: kind.noise / 255.0, seed: 5 };
    let blurred = blurred(&texels, side, kind.blur);
    let image: Raster = photograph(&blurred, (side, side), lens);
    Ok(ImageSet::single(image))
}

/// Means over squares of `2 * radius + 1` texels a side, cut at the border.
fn blurred(texels: &[Texel], side: u32, radius: u32) -> Vec<Texel> {
    let mean = |i: u32| {
        let span = |at: u32| at.saturating_sub(radius)..=(at + radius).min(side - 1);
        let (across, down) = (span(i % side), span(i / side));
        let count = across.clone().count() * down.clone().count();
        let sum: Texel = down
            .flat_map(|y| across.clone().map(move |x| (x, y)))
            .map(|(x, y)| texels[(y * side + x) as usize])
            .sum();
        sum / count as f32
    };
    (0..side * side).map(mean).collect()
}
