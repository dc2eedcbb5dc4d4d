//! Errors of blocks in relation to their contrast (paper section 4, Eq. 1): in smooth regions small ones count.
//!
//! `e(B) = mean squared error of B / (variance of B ^ alpha + beta)`, values in a range of 1. The paper gives neither alpha (0 to
//! 2) nor beta (small), nor whether it sums over texels or takes the mean. Here it is the mean, with alpha 0.25 and beta 0.01: the
//! tolerance 0.004, of its Figure 18, leads to an RMS error of 2.1 % on a photograph of a facade, near those of its table; with alpha 0.5
//! to 0.8 %.

use glam::Vec4;
use rayon::prelude::*;
use texfold_core::image::{ImageSet, Raster};
use texfold_core::metric::decode_image;
use texfold_core::{Encoded, Image2d};

/// Added to the power of the variance, so that blocks of one colour may have some error.
const BETA: f32 = 0.01;

/// The greatest relative error among all blocks of `side` x `side` texels, those at the right and lower edge with what is inside:
/// what [`crate::ToleranceKind::Relative`] bounds. Infinite where `encoded` does not hold the images.
#[must_use]
pub fn worst_relative_error(images: &ImageSet, encoded: &dyn Encoded<Domain = Image2d>, side: u32) -> f64 {
    let of_image = |(index, image): (u32, &Raster)| {
        let decoded = decode_image(encoded, index, 0).filter(|decoded| decoded.size() == image.size());
        decoded.map_or(f32::INFINITY, |decoded| worst_of(image, &decoded, side.max(1)))
    };
    f64::from((0..).zip(images.images()).map(of_image).fold(0.0, f32::max))
}

fn worst_of(image: &Raster, decoded: &Raster, side: u32) -> f32 {
    let size = image.size();
    let (columns, rows) = (size.width.div_ceil(side), size.height.div_ceil(side));
    let block = |index: u32| {
        let (left, top) = (index % columns * side, index / columns * side);
        let texels = |raster: &Raster| -> Vec<Vec4> {
            let row = |y| (left..(left + side).min(size.width)).map(move |x| raster.texel(x, y) * 255.0);
            (top..(top + side).min(size.height)).flat_map(row).collect()
        };
        error(&texels(image), &texels(decoded))
    };
    (0..columns * rows).into_par_iter().map(block).reduce(|| 0.0, f32::max)
}

/// Relative error of a block whose texels (0 to 255) are decoded so; of values rounded to 8 bits.
pub(super) fn error(texels: &[Vec4], decoded: &[Vec4]) -> f32 {
    let rounded = |texel: Vec4| (texel + 0.5).floor();
    let squared = texels.iter().zip(decoded).map(|(&a, &b)| (rounded(a) - rounded(b)).length_squared());
    squared.sum::<f32>() / (channels(texels) * texels.len() as f32 * 255.0 * 255.0) / scale(texels)
}

/// Divisor of a block's mean squared error: a power of the variance of its channels together, in a range of 1, and [`BETA`].
pub(super) fn scale(texels: &[Vec4]) -> f32 {
    let count = texels.len().max(1) as f32;
    let mean = texels.iter().sum::<Vec4>() / count;
    let squared = texels.iter().map(|&texel| (texel - mean).length_squared()).sum::<f32>();
    let variance = squared / (channels(texels) * count * 255.0 * 255.0);
    // To the power of alpha, by operations that round alike everywhere.
    variance.sqrt().sqrt() + BETA
}

/// Channels that count: opaque alpha does not.
fn channels(texels: &[Vec4]) -> f32 {
    if texels.iter().all(|texel| texel.w >= 255.0) { 3.0 } else { 4.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_counts_by_contrast() {
        let gray = |value: f32| Vec4::new(value, value, value, 255.0);
        let block = |low, high| [gray(low), gray(high)];
        let moved = |of: [Vec4; 2]| of.map(|texel| texel + Vec4::new(5.0, 5.0, 5.0, 0.0));
        let squared = (5.0f32 / 255.0).powi(2);
        for (low, high) in [(100.0, 100.0), (100.0, 120.0), (0.0, 200.0)] {
            let texels = block(low, high);
            let wanted = squared / (((high - low) / 2.0 / 255.0).sqrt() + 0.01);
            let found = error(&texels, &moved(texels));
            assert!((found - wanted).abs() < 1e-6, "{low} to {high}: {found} for {wanted}");
        }
        assert!(error(&block(9.2, 70.4), &block(9.0, 70.0)) == 0.0, "of values rounded to 8 bits");
    }
}
