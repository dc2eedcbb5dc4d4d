//! Two textures beside each other at the texels of an image.

use glam::{DMat3, DVec2};
use rayon::prelude::*;
use texfold_core::image::to_u8;
use texfold_core::metric::SquaredError;
use texfold_core::{CancelCheck, Texel};

use super::canvas::{Footprint, colour};
use crate::decode::ZipmapView;

/// Most texels of an image that are compared: beyond, every n-th row and column.
const SAMPLES: f64 = 262_144.0;
pub(crate) fn places((width, height): (u32, u32)) -> Vec<(u32, u32)> {
    let stride = (f64::from(width) * f64::from(height) / SAMPLES).sqrt().ceil().max(1.0) as usize;
    let rows = (0..height).step_by(stride);
    rows.flat_map(|y| (0..width).step_by(stride).map(move |x| (x, y))).collect()
}

pub(crate) fn footprint(inverse: &DMat3, (x, y): (u32, u32), (width, height): (u32, u32)) -> Footprint {
    let texel = DVec2::new(1.0 / f64::from(width), 1.0 / f64::from(height));
    Footprint::of(inverse, (DVec2::new(f64::from(x), f64::from(y)) + 0.5) * texel, texel)
}

pub(crate) fn step(a: Texel, b: Texel) -> f64 {
    (0..3).map(|k| f64::from(to_u8(a[k]).abs_diff(to_u8(b[k]))).powi(2)).sum()
}

/// What two textures differ by at the texels of an image that `inverse` leads onto the root. Of no use once the job is
/// cancelled.
pub(crate) fn compare(
    a: &ZipmapView<'_>,
    b: &ZipmapView<'_>,
    inverse: &DMat3,
    size: (u32, u32),
    cancel: CancelCheck<'_>,
) -> SquaredError {
    let places = places(size);
    let errors: Vec<f64> = places
        .par_iter()
        .map(|&place| {
            if cancel.is_cancelled() {
                return 0.0;
            }
            let at = footprint(inverse, place, size);
            step(colour(a, &at), colour(b, &at))
        })
        .collect();
    SquaredError { sum: errors.iter().sum(), count: 3 * places.len() as u64 }
}
