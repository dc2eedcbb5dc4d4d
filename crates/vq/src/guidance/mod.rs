//! Guidance: where in the image an error would be noticed, as maps of one value in [0, 1] a texel.
//!
//! Method: three of the four terms of the importance-driven choice of samples (paper sections 3.2 to 3.4) live
//! here; how often a sample can be reused is counted by the encoder. [`saliency_map`] says what the eye is drawn
//! to, [`distortion_map`] where a mesh stretches the texture, [`painted_map`] what a person has marked because
//! no bottom-up model can know it (a face in a portrait). The encoder adds them with weights.
//!
//! Cost: linear in the texels, plus the texels that the triangles cover; the maps are single precision.
//!
//! Deviations: a painted map may have another size than the image, and where it is transparent nothing is
//! painted; the paper says neither.

mod distortion;
mod saliency;

pub(crate) use distortion::distortion;
pub use distortion::distortion_map;
pub(crate) use saliency::saliency;
pub use saliency::saliency_map;

use ndarray::Array2;
use rayon::prelude::*;
use texfold_core::image::{Alpha, Raster};
use texfold_core::{CancelCheck, ImageSize, SourceError};

/// One value a texel, indexed by row and column.
pub type Map = Array2<f32>;

/// Largest relative difference of aspect between a painted map and its image. Scaling to whole texels changes
/// the aspect of anything above 50 texels by less; beyond it strokes miss what they were painted on.
const ASPECT_TOLERANCE: f64 = 0.02;

/// Importance as painted: the mean of the colour channels of `raster` for an image of `width` x `height`
/// texels, 0 where nothing is painted (transparent), cut to [0, 1]. A painting of another size but the same
/// aspect is resampled bilinearly, from a mip level where it is more than twice as large.
///
/// # Errors
/// [`SourceError::Guidance`] when the aspects differ by more than 2%.
pub fn painted_map(raster: &Raster, width: u32, height: u32) -> Result<Map, SourceError> {
    painted(raster, ImageSize { width, height }, CancelCheck::default())
}

/// As [`painted_map`]; of no use once the job is cancelled.
pub(crate) fn painted(
    raster: &Raster,
    ImageSize { width, height }: ImageSize,
    cancel: CancelCheck<'_>,
) -> Result<Map, SourceError> {
    let (from, to) = (raster.size(), (f64::from(width.max(1)), f64::from(height.max(1))));
    let (cross, other) = (f64::from(from.width) * to.1, f64::from(from.height) * to.0);
    if (cross - other).abs() > ASPECT_TOLERANCE * cross.min(other) {
        let what = "its aspect differs from the image's by more than 2%";
        return Err(SourceError::Guidance { map: "importance image", what });
    }
    let alpha = raster.info().alpha;
    let value = |y: usize, x: usize| {
        let texel = raster.texel(x as u32, y as u32);
        (texel.truncate().clamp(glam::Vec3::ZERO, glam::Vec3::ONE).element_sum() / 3.0)
            * opacity(texel.w, alpha)
    };
    let mut map = Map::zeros((from.height as usize, from.width as usize));
    fill_rows(&mut map, cancel, |y, line| {
        line.iter_mut().enumerate().for_each(|(x, texel)| *texel = value(y, x));
    });
    let mut step = (f64::from(from.height) / to.1, f64::from(from.width) / to.0);
    while step.0.min(step.1) > 2.0 {
        map = halve(&map, cancel);
        step = (step.0 / 2.0, step.1 / 2.0);
    }
    Ok(resample(&map, (height as usize, width as usize), step, cancel))
}

/// Scales `map` so that its largest value is 1. A map without positive values stays as it is.
pub(crate) fn normalise(map: &mut Map) {
    let max = map.iter().copied().fold(0.0, f32::max);
    if max > 0.0 {
        map.mapv_inplace(|value| value / max);
    }
}

/// How much of a texel is seen.
fn opacity(alpha: f32, reading: Alpha) -> f32 {
    match reading {
        Alpha::Opaque | Alpha::Band => 1.0,
        Alpha::Straight => alpha.clamp(0.0, 1.0),
        Alpha::Cutout(threshold) => f32::from(u8::from(alpha >= threshold)),
    }
}

/// The next coarser level of a Gaussian pyramid: the binomial kernel 1 3 3 1 along both axes, whose centre lies
/// between two texels, so that texel `i` of level `l` is centred on `(i + 1/2) 2^l` and levels stay aligned.
fn halve(map: &Map, cancel: CancelCheck<'_>) -> Map {
    let (rows, columns) = map.dim();
    let mut narrow = Map::zeros((rows, columns.div_ceil(2)));
    fill_rows(&mut narrow, cancel, |y, line| {
        line.iter_mut().enumerate().for_each(|(x, value)| *value = binomial(x, columns, |i| map[[y, i]]));
    });
    let mut half = Map::zeros((rows.div_ceil(2), narrow.ncols()));
    fill_rows(&mut half, cancel, |y, line| {
        line.iter_mut().enumerate().for_each(|(x, value)| *value = binomial(y, rows, |i| narrow[[i, x]]));
    });
    half
}

/// Texel `i` of a line of `len` texels after halving; texels outside repeat the border.
fn binomial(i: usize, len: usize, read: impl Fn(usize) -> f32) -> f32 {
    let tap = |offset: usize| read((2 * i + offset).saturating_sub(1).min(len - 1));
    (tap(0) + 3.0 * (tap(1) + tap(2)) + tap(3)) / 8.0
}

/// What one output coordinate reads along one axis: (1 - weight) of `first` plus weight of `second`.
struct Tap {
    first: usize,
    second: usize,
    weight: f32,
}

/// The taps of `count` outputs that lie `step` texels apart on a line of `len` texels.
fn taps(count: usize, step: f64, len: usize) -> Vec<Tap> {
    let tap = |i: usize| {
        let at = ((i as f64 + 0.5) * step - 0.5).clamp(0.0, (len - 1) as f64);
        let first = at as usize;
        Tap { first, second: (first + 1).min(len - 1), weight: (at - first as f64) as f32 }
    };
    (0..count).map(tap).collect()
}

/// `map` read bilinearly at `dim` (rows, columns) places that lie `step` (rows, columns) of its texels apart.
fn resample(map: &Map, dim: (usize, usize), step: (f64, f64), cancel: CancelCheck<'_>) -> Map {
    let (rows, columns) = (taps(dim.0, step.0, map.nrows()), taps(dim.1, step.1, map.ncols()));
    let mut output = Map::zeros(dim);
    fill_rows(&mut output, cancel, |y, line| {
        let Tap { first, second, weight } = rows[y];
        let (top, bottom) = (map.row(first), map.row(second));
        let blend: Vec<f32> = top.iter().zip(&bottom).map(|(a, b)| a + (b - a) * weight).collect();
        for (value, tap) in line.iter_mut().zip(&columns) {
            let left = blend[tap.first];
            *value = left + (blend[tap.second] - left) * tap.weight;
        }
    });
    output
}

/// Calls `fill` with every row of `output` and its number, in parallel; with none that is not begun when the job is
/// cancelled.
fn fill_rows<T: Send>(
    output: &mut Array2<T>,
    cancel: CancelCheck<'_>,
    fill: impl Fn(usize, &mut [T]) + Sync,
) {
    let columns = output.ncols().max(1);
    debug_assert!(output.is_standard_layout(), "maps are stored row by row");
    if let Some(values) = output.as_slice_mut() {
        values.par_chunks_mut(columns).enumerate().for_each(|(y, line)| {
            if !cancel.is_cancelled() {
                fill(y, line);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::image::PixelInfo;

    fn raster(width: u32, height: u32, channels: u8, texel: impl Fn(u32, u32) -> Vec<f32>) -> Raster {
        let alpha = if channels.is_multiple_of(2) { Alpha::Straight } else { Alpha::Opaque };
        let info = PixelInfo { channels, alpha, ..PixelInfo::default() };
        let data = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).flat_map(|(x, y)| texel(x, y));
        Raster::new(width, height, info, data.collect()).unwrap()
    }

    #[test]
    fn painting_is_the_mean_of_the_colours_where_opaque() {
        let painted = raster(2, 1, 4, |x, _| vec![0.9, 0.3, 0.3, x as f32]);
        let map = painted_map(&painted, 2, 1).unwrap();
        assert_eq!(map[[0, 0]], 0.0);
        assert!((map[[0, 1]] - 0.5).abs() < 1e-6);
    }

    #[test]
    fn a_painting_of_another_size_keeps_its_place() {
        let right_half =
            |side: u32| raster(side, side, 1, move |x, _| vec![f32::from(u8::from(x >= side / 2))]);
        for side in [4, 16, 32, 500] {
            let map = painted_map(&right_half(side), 32, 32).unwrap();
            assert_eq!(map.dim(), (32, 32));
            for y in 0..32 {
                assert!(map[[y, 11]] < 0.01 && map[[y, 20]] > 0.99, "side {side}, row {y}");
            }
            assert!((map.mean().unwrap() - 0.5).abs() < 0.02, "side {side}");
        }
    }

    #[test]
    fn a_painting_of_another_aspect_is_refused() {
        let painted = raster(100, 50, 1, |_, _| vec![1.0]);
        let refused = painted_map(&painted, 100, 52);
        assert!(matches!(refused, Err(SourceError::Guidance { map: "importance image", .. })));
        assert_eq!(painted_map(&painted, 201, 100).unwrap(), Map::ones((100, 201)));
    }

    #[test]
    fn normalised_maps_reach_one_and_zeros_stay() {
        let mut map = Map::from_shape_vec((1, 3), vec![0.0, 1.0, 4.0]).unwrap();
        normalise(&mut map);
        assert_eq!(map.as_slice().unwrap(), [0.0, 0.25, 1.0]);
        let mut empty = Map::zeros((2, 2));
        normalise(&mut empty);
        assert_eq!(empty, Map::zeros((2, 2)));
    }

    #[test]
    fn resampling_a_level_back_stays_aligned() {
        // A ramp is a fixed point of smoothing and of bilinear reading, away from the borders.
        let ramp = Map::from_shape_fn((64, 64), |(y, x)| (x + 2 * y) as f32);
        let cancel = CancelCheck::default();
        let back = resample(&halve(&halve(&ramp, cancel), cancel), (64, 64), (0.25, 0.25), cancel);
        for y in 16..48 {
            for x in 16..48 {
                assert!((back[[y, x]] - ramp[[y, x]]).abs() < 1e-3, "at {x}, {y}");
            }
        }
    }
}
