//! Regimes of photographs for zoom stacks, and how registration and stacks depend on what photographs share.

use std::time::Instant;

use glam::{DMat3, DVec2};
use rayon::ThreadPool;
use rayon::prelude::*;
use texfold::core::image::{ImageSize, Raster};
use texfold::core::metric::{SquaredError, decode_image};
use texfold::{
    Cancel, EncodeError, Encoded, Goal, Job, Texel,
    core::Encoder,
    file_of,
    zipmap::{PatchSource, PatchStack, ZipParams, ZipTexture, Zipmap, fidelity, register},
};
use texfold_testkit::leaves::{Leaves, Lens, close_up, photograph};
use texfold_testkit::rng::Rng;

use super::atlas::{Failure, Picture, falls, sentence};
use super::guard::guarded;
use super::page::png;
use super::record::{self, Check, Curve, Point, Row};
use super::{Extent, Outcome, Tools};

/// Pixels of a photograph.
const SIZE: (u32, u32) = (240, 200);
/// What stacks are encoded for.
const GOAL_DB: f64 = 32.0;
/// Largest mean distance at the corners of a close-up, in its pixels, at which it counts as found.
const NEAR: f64 = 2.0;
/// What a close-up may be below the goal, or below what the root alone shows of it, in dB: both are stored.
const SLACK_DB: f64 = 0.1;
/// Bits a pixel of photographs as plain blocks, and bytes that the form says beside.
const PLAIN_BPP: f64 = 8.0;
const HEADER_BYTES: f64 = 4096.0;

/// Photographs, the matrix of the last one where it shows a part of the first, and a stack by hand where they are not registered.
struct Scene {
    photos: Vec<Raster>,
    truth: Option<DMat3>,
    by_hand: Option<PatchStack>,
}

struct Regime {
    name: &'static str,
    about: &'static str,
    scene: fn() -> Scene,
}

const REGIMES: [Regime; 14] = [
    Regime {
        name: "close-up",
        about: "what should work, for comparison",
        scene: || pair(2.5, 1.0, 1.0, 0.01),
    },
    Regime { name: "two places", about: "photographs that show nothing in common", scene: two_places },
    Regime { name: "two parts of one place", about: "photographs that do not overlap", scene: two_parts },
    Regime {
        name: "repeating pattern",
        about: "every shift by a tile fits as well: false homographies",
        scene: repeating,
    },
    Regime {
        name: "exposure by four",
        about: "a jump of exposure between photographs",
        scene: || pair(2.5, 0.4, 1.6, 0.01),
    },
    Regime { name: "noise of 5 %", about: "noise as strong as detail", scene: || pair(2.5, 1.0, 1.0, 0.05) },
    Regime {
        name: "zoom of twelve",
        about: "a pixel of the root is twelve of the close-up",
        scene: || pair(12.0, 1.0, 1.0, 0.0),
    },
    Regime { name: "the same photograph twice", about: "a patch that adds nothing", scene: twice },
    Regime { name: "blank photographs", about: "nothing to be recognised by", scene: blank },
    Regime { name: "photographs of one pixel", about: "nothing to match", scene: one_pixel },
    Regime {
        name: "singular matrix",
        about: "by hand: a matrix without inverse",
        scene: || by_hand(DMat3::ZERO),
    },
    Regime {
        name: "matrix to the horizon",
        about: "by hand: the patch's horizon crosses the root",
        scene: || by_hand(horizon()),
    },
    Regime {
        name: "patch outside of the root",
        about: "by hand: nothing of it is seen",
        scene: || by_hand(DMat3::from_translation(DVec2::splat(50.0))),
    },
    Regime {
        name: "patch smaller than a texel",
        about: "by hand: a zoom of five hundred",
        scene: || by_hand(close_up(DVec2::splat(0.5), 500.0, 0.1, DVec2::ZERO)),
    },
];

fn lens(exposure: f64, noise: f64, seed: u64) -> Lens {
    Lens { exposure, noise, seed }
}

fn shot(leaves: &Leaves, matrix: &DMat3, lens: Lens) -> Raster {
    photograph(&leaves.view(matrix, SIZE, 2), SIZE, lens)
}

/// A whole and a close-up of it.
fn pair(zoom: f64, wide: f64, close: f64, noise: f64) -> Scene {
    let leaves = Leaves::new(5, 60_000);
    let truth = close_up(DVec2::splat(0.5), zoom, 0.2, DVec2::ZERO);
    let photos = vec![
        shot(&leaves, &DMat3::IDENTITY, lens(wide, noise, 1)),
        shot(&leaves, &truth, lens(close, noise, 2)),
    ];
    Scene { photos, truth: Some(truth), by_hand: None }
}

fn apart(photos: Vec<Raster>) -> Scene {
    Scene { photos, truth: None, by_hand: None }
}

fn two_places() -> Scene {
    let view = |seed| shot(&Leaves::new(seed, 60_000), &DMat3::IDENTITY, lens(1.0, 0.01, seed));
    apart(vec![view(1), view(77)])
}

fn two_parts() -> Scene {
    let leaves = Leaves::new(5, 60_000);
    let part = |middle, seed| {
        shot(&leaves, &close_up(DVec2::splat(middle), 3.0, 0.0, DVec2::ZERO), lens(1.0, 0.01, seed))
    };
    apart(vec![part(0.2, 1), part(0.8, 2)])
}

fn repeating() -> Scene {
    let tile = Leaves::new(5, 4000);
    let view = |shift: f64, zoom: f64| {
        let colour = |i: u32| {
            let at = DVec2::new(f64::from(i % SIZE.0), f64::from(i / SIZE.0)) / (40.0 * zoom) + shift;
            tile.colour(at - at.floor())
        };
        photograph(&(0..SIZE.0 * SIZE.1).map(colour).collect::<Vec<_>>(), SIZE, lens(1.0, 0.0, 1))
    };
    apart(vec![view(0.0, 1.0), view(0.37, 2.0)])
}

fn twice() -> Scene {
    let photo = shot(&Leaves::new(5, 60_000), &DMat3::IDENTITY, lens(1.0, 0.0, 1));
    apart(vec![photo.clone(), photo])
}

fn plain(size: (u32, u32), value: f32) -> Raster {
    photograph(&vec![Texel::splat(value); (size.0 * size.1) as usize], size, lens(1.0, 0.0, 1))
}

fn blank() -> Scene {
    apart(vec![plain(SIZE, 0.3), plain(SIZE, 0.6)])
}

fn one_pixel() -> Scene {
    apart(vec![plain((1, 1), 0.3), plain((1, 1), 0.6)])
}

/// A matrix whose third row is zero along a line through the root.
fn horizon() -> DMat3 {
    close_up(DVec2::splat(0.5), 2.0, 0.0, DVec2::new(0.9, 0.4))
}

fn by_hand(matrix: DMat3) -> Scene {
    let Scene { photos, .. } = pair(3.0, 1.0, 1.0, 0.0);
    let patch = PatchSource { image: 0, matrix, mask: None, parent: None };
    let stack = PatchStack { root: photos[0].clone(), images: vec![photos[1].clone()], patches: vec![patch] };
    Scene { photos, truth: None, by_hand: Some(stack) }
}

/// What each regime is about.
pub(super) fn about() -> Vec<(&'static str, &'static str)> {
    REGIMES.iter().map(|regime| (regime.name, regime.about)).collect()
}

/// Every regime of zoom stacks.
///
/// # Errors
/// Where a picture cannot be written.
pub(super) fn rows(tools: &Tools, say: &mut dyn FnMut(Row)) -> Outcome<()> {
    for regime in &REGIMES {
        let start = Instant::now();
        let scene = (regime.scene)();
        let mut pictures = Vec::new();
        let outcome = match guarded(|cancel| made(&scene, &tools.single, cancel)) {
            Err(fault) => record::Outcome::Broken(fault),
            Ok(Err(EncodeError::Cancelled)) => record::Outcome::Broken("does not end in time".to_owned()),
            Ok(Err(error)) => record::Outcome::Refused(record::words(&error)),
            Ok(Ok(found)) => match guarded(|cancel| held(&scene, &found, tools, cancel)) {
                Err(fault) => record::Outcome::Broken(fault),
                Ok(outcome) => {
                    pictures = scene.photos.iter().map(png).collect::<Outcome<_>>()?;
                    outcome
                }
            },
        };
        let seconds = start.elapsed().as_secs_f64();
        say(Row { regime: regime.name, codec: "zipmap".to_owned(), outcome, seconds, pictures });
    }
    Ok(())
}

/// A stack, where registration has put its only close-up, what it says of those left out, and the texture.
struct Made {
    stack: PatchStack,
    placed: Option<DMat3>,
    words: String,
    texture: ZipTexture,
}

fn made(scene: &Scene, pool: &ThreadPool, cancel: &Cancel) -> Result<Made, EncodeError> {
    let mut job = Job::default().with_pool(pool).with_cancel(cancel);
    let (stack, placed, words) = match &scene.by_hand {
        Some(stack) => (stack.clone(), None, String::new()),
        None => {
            let found = register(&scene.photos, &mut job)?;
            let words: Vec<String> =
                found.left_out.iter().map(|(photo, why)| format!("photograph {photo} {why}. ")).collect();
            // A root out of its own photographs is always there.
            let stack = PatchStack::registered(&scene.photos, &found).ok_or(EncodeError::Cancelled)?;
            (stack, found.placed.first().map(|placed| placed.matrix), words.concat())
        }
    };
    let texture = Zipmap::encode(&stack, &params(Goal::Psnr(GOAL_DB)), &mut job)?;
    Ok(Made { stack, placed, words, texture })
}

fn params(goal: Goal) -> ZipParams {
    ZipParams::default().with_goal(goal).with_effort(texfold::Effort::Fast)
}

fn held(scene: &Scene, made: &Made, tools: &Tools, cancel: &Cancel) -> record::Outcome {
    let texture = &made.texture;
    let bytes = file_of(texture);
    let mut checks = vec![strange(texture)];
    if scene.by_hand.is_none() {
        checks.push(placed(scene, made));
    }
    let found = fidelity(&made.stack, texture);
    let worst = found.iter().map(|found| found.error.psnr()).fold(f64::INFINITY, f64::min);
    // The goal is that of the merged photographs. A patch by hand that shows another place than its matrix says is reached by nothing.
    if scene.by_hand.is_none() {
        let of_patches = found.iter().filter(|found| found.patch.is_some());
        checks.extend(of_patches.map(|found| {
            let alone = found.root_alone.psnr().min(GOAL_DB) - SLACK_DB;
            Check::least("PSNR of a close-up beside that of the root alone, dB", found.error.psnr(), alone)
        }));
    }
    let texels: u64 = scene.photos.iter().map(|photo| photo.size().texels()).sum();
    let limit = texels as f64 * PLAIN_BPP / 8.0 + HEADER_BYTES;
    checks.push(Check::most("bytes of the file", bytes.len() as f64, limit));
    let by_two = |pool: &ThreadPool| self::made(scene, pool, cancel);
    checks.extend(tools.is_independent_of_threads(&bytes, by_two, |other| file_of(&other.texture)));
    record::Outcome::Made {
        verdict: format!("{}{}", made.words, texture.notes().verdict),
        psnr: worst,
        bpp: texture.memory().compressed as f64 / texels as f64,
        checks,
    }
}

/// Texels of the finest and of the root's level that are no numbers.
fn strange(texture: &ZipTexture) -> Check {
    let deep = texture.deep_levels();
    let counted = |level: u32| {
        decode_image(texture, 0, level).map_or(f64::INFINITY, |decoded| {
            decoded.texels().filter(|texel| !texel.is_finite()).count() as f64
        })
    };
    // The finest level of a deep zoom does not fit in memory.
    let size = texture.layout().images.first().copied().unwrap_or(ImageSize { width: 1, height: 1 });
    let finest = if size.texels() < 1 << 22 { counted(0) } else { 0.0 };
    Check::most("texels that are no numbers", finest + counted(deep), 0.0)
}

/// Whether what belongs together is found near its place or left out, and what does not is left out.
fn placed(scene: &Scene, made: &Made) -> Check {
    match (&scene.truth, made.placed) {
        (Some(truth), Some(found)) => {
            Check::most("distance from its place, pixels", far(&found, truth), NEAR)
        }
        (None, found) => Check::most(
            "photographs placed that show nothing in common",
            f64::from(u8::from(found.is_some())),
            0.0,
        ),
        // Left out with a word about it; the charts show up to where that is so.
        (Some(_), None) => Check::most(
            "photographs left out without a word",
            f64::from(u8::from(made.words.is_empty())),
            0.0,
        ),
    }
}

/// Mean distance in pixels of the close-up, at its corners, between two matrices from the root.
fn far(found: &DMat3, truth: &DMat3) -> f64 {
    let size = DVec2::new(f64::from(SIZE.0), f64::from(SIZE.1));
    let off = |corner: DVec2| {
        let moved = *found * truth.inverse() * corner.extend(1.0);
        ((moved.truncate() / moved.z - corner) * size).length()
    };
    [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE].map(off).iter().sum::<f64>() / 4.0
}

/// What is varied between a whole and its close-ups.
struct Sweep {
    title: &'static str,
    across: &'static str,
    /// Quick ones first.
    values: [f64; 6],
    /// The photographs, and the place of the second.
    photos: fn(&Leaves, f64, &mut Rng) -> ([Raster; 2], DMat3),
}

/// What charts of pairs have upwards, and their line.
const UP_SHARE: &str = "per cent of pairs found within 2 pixels";
const SHARE_LINE: &str = "pairs found";
/// Values that a quick run takes, and pairs at each value: quick and full.
const QUICK: usize = 3;
const PAIRS: [u64; 2] = [4, 10];

const SWEEPS: [Sweep; 4] = [
    Sweep {
        title: "Zoom in one step",
        across: "pixels of the close-up to a pixel of the root, a side",
        values: [2.0, 4.0, 8.0, 3.0, 6.0, 12.0],
        photos: |leaves, zoom, rng| views(leaves, turned(rng, DVec2::splat(0.5), zoom), (1.0, 1.0, 0.01)),
    },
    Sweep {
        title: "Overlap",
        across: "share of the second photograph within the first",
        values: [0.8, 0.4, 0.2, 1.0, 0.6, 0.1],
        photos: |leaves, share, rng| {
            // Of twice the scale, moved to the right until only that share is left.
            let middle = DVec2::new(1.0 + 0.25 - 0.5 * share, 0.5);
            let truth = turned(rng, middle, 2.0);
            // Both lie within the surface: the first shows its left part.
            let left = DMat3::from_scale(DVec2::new(1.0 / 0.7, 1.0));
            let photos =
                [shot(leaves, &left, lens(1.0, 0.01, 1)), shot(leaves, &(truth * left), lens(1.0, 0.01, 2))];
            (photos, truth)
        },
    },
    Sweep {
        title: "Exposure",
        across: "exposure of the close-up, times that of the whole",
        values: [1.0, 2.0, 4.0, 0.5, 0.25, 6.0],
        photos: |leaves, times, rng| {
            let truth = turned(rng, DVec2::splat(0.5), 2.5);
            views(leaves, truth, (times.sqrt().recip(), times.sqrt(), 0.01))
        },
    },
    Sweep {
        title: "Noise",
        across: "deviation in 8-bit units",
        values: [0.0, 8.0, 32.0, 4.0, 16.0, 24.0],
        photos: |leaves, units, rng| {
            views(leaves, turned(rng, DVec2::splat(0.5), 2.5), (1.0, 1.0, units / 255.0))
        },
    },
];

fn turned(rng: &mut Rng, middle: DVec2, zoom: f64) -> DMat3 {
    close_up(
        middle,
        zoom,
        rng.between(-0.4, 0.4),
        DVec2::new(rng.between(-0.05, 0.05), rng.between(-0.05, 0.05)),
    )
}

fn views(leaves: &Leaves, truth: DMat3, (wide, close, noise): (f64, f64, f64)) -> ([Raster; 2], DMat3) {
    let photos =
        [shot(leaves, &DMat3::IDENTITY, lens(wide, noise, 1)), shot(leaves, &truth, lens(close, noise, 2))];
    (photos, truth)
}

/// All charts of zoom stacks.
///
/// # Errors
/// None: what cannot be encoded has no point.
pub(super) fn curves(extent: Extent) -> Outcome<Vec<Curve>> {
    let mut all: Vec<Curve> = SWEEPS.iter().flat_map(|sweep| registration(sweep, extent)).collect();
    all.push(misplaced(extent));
    Ok(all)
}

/// What registration withstands least, by the charts of [`curves`]; pictures are pairs of photographs.
///
/// # Errors
/// Where a picture cannot be made.
pub(super) fn failure(curves: &[Curve]) -> Outcome<Failure> {
    let falls = falls(curves.iter().filter(|curve| curve.up == UP_SHARE), SHARE_LINE, None);
    let name = |title: &str| title.split(": ").nth(1).unwrap_or_default().to_owned();
    let fallback = match falls.first().and_then(|fall| fall.values_where(|point| point.y < 50.0)) {
        Some(values) => format!("and less than half of the pairs are found at {values}"),
        None => "and half of the pairs and more are found at each value".to_owned(),
    };
    let sentence = sentence("zipmap", &falls, name, "per cent of pairs placed within 2 pixels", &fallback);
    let mut pictures = Vec::new();
    if let Some(fall) = falls.first() {
        for value in [fall.best.x, fall.worst.x] {
            let leaves = Leaves::new(100, 60_000);
            let (photos, _) = (SWEEPS[fall.index].photos)(&leaves, value, &mut Rng::new(0));
            for (photo, what) in photos.iter().zip(["whole", "close-up"]) {
                pictures.push(Picture { png: png(photo)?, caption: format!("{value}: {what}") });
            }
        }
    }
    Ok(Failure { method: "zipmap".to_owned(), sentence, pictures })
}

/// Shares of pairs that are found, and how far off.
fn registration(sweep: &Sweep, extent: Extent) -> [Curve; 2] {
    let full = extent == Extent::Full;
    let count = if full { sweep.values.len() } else { QUICK };
    let mut values = sweep.values[..count].to_vec();
    values.sort_by(f64::total_cmp);
    let pairs = PAIRS[usize::from(full)];
    let found: Vec<Vec<Option<f64>>> = values
        .iter()
        .map(|&value| (0..pairs).into_par_iter().map(|pair| distance(sweep, value, pair)).collect())
        .collect();
    let share = |found: &Vec<Option<f64>>| {
        let near = found.iter().flatten().filter(|&&off| off <= NEAR).count();
        Some(100.0 * near as f64 / found.len() as f64)
    };
    let median = |found: &Vec<Option<f64>>| {
        let mut off: Vec<f64> = found.iter().flatten().copied().collect();
        off.sort_by(f64::total_cmp);
        off.get(off.len() / 2).copied()
    };
    let curve = |up: &'static str, name: &str, of: &dyn Fn(&Vec<Option<f64>>) -> Option<f64>| {
        let point =
            |(&x, found): (&f64, &Vec<Option<f64>>)| of(found).map(|y| Point { x, y, gave_way: false });
        let line = (name.to_owned(), values.iter().zip(&found).filter_map(point).collect());
        Curve {
            title: format!("Registration: {}: {name}", sweep.title),
            across: sweep.across,
            up,
            lines: vec![line],
        }
    };
    [
        curve(UP_SHARE, SHARE_LINE, &share),
        curve("median distance from its place, pixels", "distance of those placed", &median),
    ]
}

/// How far from its place the second photograph of a pair is put; `None` where it is left out.
fn distance(sweep: &Sweep, value: f64, pair: u64) -> Option<f64> {
    let leaves = Leaves::new(100 + pair, 60_000);
    let (photos, truth) = (sweep.photos)(&leaves, value, &mut Rng::new(pair));
    let found = register(&photos, &mut Job::default()).ok()?;
    let placed = found.placed.first()?;
    // The finer one is what is placed; where the first was taken for it, its matrix is the inverse.
    Some(if placed.photo == 1 { far(&placed.matrix, &truth) } else { far(&placed.matrix, &truth.inverse()) })
}

/// PSNR of the zoomed view where the matrix of a patch is off by some of its pixels.
fn misplaced(extent: Extent) -> Curve {
    let mut values = vec![0.0, 1.0, 4.0];
    if extent == Extent::Full {
        values = vec![0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0];
    }
    let Scene { photos, truth, .. } = pair(3.0, 1.0, 1.0, 0.0);
    let truth = truth.unwrap_or(DMat3::IDENTITY);
    let psnr = |off: f64| {
        let moved = DMat3::from_translation(DVec2::new(off / f64::from(SIZE.0), 0.0)) * truth;
        let patch = PatchSource { image: 0, matrix: moved, mask: None, parent: None };
        let stack =
            PatchStack { root: photos[0].clone(), images: vec![photos[1].clone()], patches: vec![patch] };
        let texture = Zipmap::encode(&stack, &params(Goal::Bpp(8.0)), &mut Job::default()).ok()?;
        Some([zoomed(&texture, &truth, &photos[1]), zoomed(&texture.first_patches(0), &truth, &photos[1])])
    };
    let found: Vec<Option<[f64; 2]>> = values.iter().map(|&off| psnr(off)).collect();
    let line = |name: &str, index: usize| {
        let point = |(&x, found): (&f64, &Option<[f64; 2]>)| {
            found.map(|found| Point { x, y: found[index], gave_way: false })
        };
        (name.to_owned(), values.iter().zip(&found).filter_map(point).collect())
    };
    Curve {
        title: "Zoom stack: error of a patch's place".to_owned(),
        across: "pixels of the close-up",
        up: "PSNR of the zoomed view, dB",
        lines: vec![line("root and patch", 0), line("root alone", 1)],
    }
}

/// PSNR of what is drawn where the close-up was taken, in dB.
fn zoomed(texture: &ZipTexture, truth: &DMat3, photo: &Raster) -> f64 {
    let inverse = truth.inverse();
    let pixel = 1.0 / f64::from(SIZE.0);
    let places = (0..SIZE.0 * SIZE.1).map(|i| (i % SIZE.0, i / SIZE.0));
    // Not at the border, where patches fade out.
    let inner = places.filter(|&(x, y)| x > 30 && y > 30 && x + 30 < SIZE.0 && y + 30 < SIZE.1);
    let error = inner.fold(SquaredError::default(), |sum, (x, y)| {
        let at = DVec2::new((f64::from(x) + 0.5) * pixel, (f64::from(y) + 0.5) / f64::from(SIZE.1));
        let moved = inverse * at.extend(1.0);
        let corner = (moved.truncate() / moved.z).as_vec2();
        let extent = (1.0 / 3.0 * DVec2::new(pixel, 1.0 / f64::from(SIZE.1))).as_vec2();
        let drawn = texture.draw(corner - 0.5 * extent, extent, (1, 1));
        let apart = (drawn[0] - photo.texel(x, y)).truncate() * 255.0;
        sum + SquaredError { sum: f64::from(apart.length_squared()), count: 3 }
    });
    error.psnr()
}
