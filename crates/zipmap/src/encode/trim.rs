//! Removal of what is not needed: mip levels equal to what lies under them, patches that are transparent or hidden, colours of hidden texels.

use glam::{DVec2, IVec2};
use rayon::prelude::*;
use texfold_core::image::{ColorSpace, linear_to_srgb, srgb_to_linear};
use texfold_core::{CancelCheck, Texel};

use super::canvas::{Canvas, Footprint, Laid, colour, cover};
use crate::decode::{ZipmapView, texfold_zipmap_blend};

/// Most texels of a patch that are looked at.
const SAMPLES: u32 = 1 << 14;
/// Most texels of a level that are held against what lies under it.
const LEVEL_SAMPLES: u32 = 1 << 12;
/// Least and most places a side of a texel that what lies under it is read at.
const PARTS: (f64, f64) = (3.0, 16.0);
/// Places of a level that what lies under it is read at.
const LOOKUPS: u32 = 9 * LEVEL_SAMPLES;
/// What is seen of a hidden patch at most.
const HIDDEN: f32 = 1.0 / 255.0;
/// Sides of pixels that read a level, in its texels.
const PIXELS: [f64; 3] = [0.5, 1.0, 2.0];

/// Places of texels, evenly thinned.
fn places((width, height): (u32, u32), most: u32) -> Vec<(u32, u32)> {
    let stride = (f64::from(width) * f64::from(height) / f64::from(most)).sqrt().ceil().max(1.0) as u32;
    let rows = (stride / 2..height).step_by(stride as usize);
    rows.flat_map(|y| (stride / 2..width).step_by(stride as usize).map(move |x| (x, y))).collect()
}

/// RMS difference in 8-bit units, where the level is opaque, between it and what lies under it, both as means over its
/// texels: a single lookup of what lies under, between its own levels, would be blurred otherwise and differ by that.
/// What lies under in texels as large is blurred by that mean as the level itself would be, so the level counts as it
/// is and blurred, whichever differs less.
fn difference(
    laid: &Laid,
    level: u32,
    texels: &[[u8; 4]],
    (canvas, names): (&Canvas, &[u16]),
    color: ColorSpace,
) -> f64 {
    let size = ((laid.size.0 >> level).max(1), (laid.size.1 >> level).max(1));
    let table = canvas.table(names);
    let view = canvas.view(&table);
    let inverse = laid.matrix.inverse();
    let extent = DVec2::new(f64::from(size.0), f64::from(size.1));
    let places = places(size, LEVEL_SAMPLES);
    // Levels of few texels are read at more places each.
    let parts = (f64::from(LOOKUPS) / places.len() as f64).sqrt().clamp(PARTS.0, PARTS.1) as u32;
    let part = extent.recip() / f64::from(parts);
    let own = |at: DVec2| {
        let size = IVec2::new(size.0 as i32, size.1 as i32);
        light(texfold_zipmap_blend(texels, size, (at * extent).as_vec2()), color)
    };
    let mean = |corner: DVec2, read: &dyn Fn(DVec2) -> Texel| {
        let at = |k: u32| corner + (DVec2::new(f64::from(k % parts), f64::from(k / parts)) + 0.5) * part;
        let sum = (0..parts * parts).map(|k| read(at(k))).sum::<Texel>();
        stored(sum / (parts * parts) as f32, color) * 255.0
    };
    let sums: Vec<[f64; 3]> = places
        .into_par_iter()
        .map(|(x, y)| {
            let corner = DVec2::new(f64::from(x), f64::from(y)) / extent;
            let under = mean(corner, &|at| light(colour(&view, &Footprint::of(&inverse, at, part)), color));
            let texel = Texel::from_array(texels[(y * size.0 + x) as usize].map(f32::from));
            let weight = f64::from(texel.w / 255.0).powi(2);
            let squares = |own: Texel| f64::from((own - under).truncate().length_squared()) / 3.0;
            [weight * squares(texel), weight * squares(mean(corner, &own)), weight]
        })
        .collect();
    let sum = |k: usize| sums.iter().map(|sums| sums[k]).sum::<f64>();
    (sum(0).min(sum(1)) / sum(2).max(1e-9)).sqrt()
}

/// What averages as light does.
fn light(texel: Texel, color: ColorSpace) -> Texel {
    if color != ColorSpace::Srgb {
        return texel;
    }
    glam::Vec3::from(texel.truncate().to_array().map(srgb_to_linear)).extend(texel.w)
}

/// The inverse of [`light`].
fn stored(light: Texel, color: ColorSpace) -> Texel {
    if color != ColorSpace::Srgb {
        return light;
    }
    glam::Vec3::from(light.truncate().to_array().map(linear_to_srgb)).extend(light.w)
}

/// Leaves out coarse levels that equal the canvas, from the coarsest on; all of them where the patch adds
/// nothing.
pub(crate) fn drop_levels(
    laid: &Laid,
    levels: &mut Vec<Vec<[u8; 4]>>,
    canvas: &Canvas,
    color: ColorSpace,
    least: f64,
    cancel: CancelCheck<'_>,
) {
    let names = canvas.touching(&laid.matrix);
    while let Some(last) = levels.last().filter(|_| !cancel.is_cancelled()) {
        if difference(laid, levels.len() as u32 - 1, last, (canvas, &names), color) >= least {
            break;
        }
        levels.pop();
    }
}

/// Sum of squares over texels and channels, 8-bit units, that a patch of the canvas would lose were it left out.
pub(crate) fn lost(canvas: &Canvas, index: usize, color: ColorSpace) -> f64 {
    let laid = &canvas.laid[index];
    let texels = &canvas.levels[laid.content][0];
    let names: Vec<u16> =
        canvas.touching(&laid.matrix).into_iter().filter(|&other| usize::from(other) < index).collect();
    3.0 * seen(texels) * difference(laid, 0, texels, (canvas, &names), color).powi(2)
}

/// Texels of a level, each as far as it is seen.
pub(crate) fn seen(texels: &[[u8; 4]]) -> f64 {
    texels.iter().map(|texel| (f64::from(texel[3]) / 255.0).powi(2)).sum()
}

/// Patches laid later than patch `index` that share some of the root with it.
fn later(canvas: &Canvas, index: usize) -> Vec<u16> {
    let touching = canvas.touching(&canvas.laid[index].matrix);
    touching.into_iter().filter(|&other| usize::from(other) > index).collect()
}

/// Opacity, 0 to 1, that later patches leave of a texel under a footprint.
fn left(view: &ZipmapView<'_>, later: &[u16], alpha: u8, at: &Footprint) -> f32 {
    later.iter().fold(f32::from(alpha) / 255.0, |left, &other| left * (1.0 - cover(view, other, at)))
}

/// Visibility of each texel of a level of a patch: true where later patches leave more than [`HIDDEN`] of it to a pixel of a size that reads the level.
pub(crate) fn seen_texels(canvas: &Canvas, index: usize, level: u32, cancel: CancelCheck<'_>) -> Vec<bool> {
    let laid = &canvas.laid[index];
    let texels = &canvas.levels[laid.content][level as usize];
    let later = later(canvas, index);
    let is_alone = canvas.laid.iter().filter(|other| other.content == laid.content).count() == 1;
    if later.is_empty() || !is_alone || cancel.is_cancelled() {
        return texels.iter().map(|texel| texel[3] > 0).collect();
    }
    let table = canvas.table(&[]);
    let view = canvas.view(&table);
    let inverse = laid.matrix.inverse();
    let (width, height) = ((laid.size.0 >> level).max(1), (laid.size.1 >> level).max(1));
    let size = DVec2::new(f64::from(width), f64::from(height)).recip();
    let is_seen = |(number, texel): (usize, &[u8; 4])| {
        let (x, y) = (number as u32 % width, number as u32 / width);
        let at = (DVec2::new(f64::from(x), f64::from(y)) + 0.5) * size;
        let left = |pixel: DVec2| left(&view, &later, texel[3], &Footprint::of(&inverse, at, pixel));
        texel[3] > 0 && PIXELS.iter().any(|&pixel| left(size * pixel) > HIDDEN)
    };
    texels.par_iter().enumerate().map(is_seen).collect()
}

/// Patches of which those laid later leave nothing to be seen.
pub(crate) fn hidden(canvas: &Canvas, cancel: CancelCheck<'_>) -> Vec<usize> {
    let table = canvas.table(&[]);
    let view = canvas.view(&table);
    let is_hidden = |index: &usize| {
        let laid = &canvas.laid[*index];
        let inverse = laid.matrix.inverse();
        let texel = DVec2::new(1.0 / f64::from(laid.size.0), 1.0 / f64::from(laid.size.1));
        let later = later(canvas, *index);
        if later.is_empty() || cancel.is_cancelled() {
            return false;
        }
        places(laid.size, SAMPLES).into_par_iter().all(|(x, y)| {
            let own = canvas.levels[laid.content][0][(y * laid.size.0 + x) as usize][3];
            let at = Footprint::of(&inverse, (DVec2::new(f64::from(x), f64::from(y)) + 0.5) * texel, texel);
            left(&view, &later, own, &at) <= HIDDEN
        })
    };
    (0..canvas.laid.len()).filter(is_hidden).collect()
}
