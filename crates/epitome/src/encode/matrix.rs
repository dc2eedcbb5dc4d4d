//! The palette of 2x2 matrices.

use std::collections::BTreeMap;

use glam::Vec4;
use texfold_core::CancelCheck;

use super::candidate::{quantise, scale_linear};
use crate::format::Matrix;

/// Steps a unit in which 2x2 matrices are counted to find where many lie together.
const SEED_STEPS: f32 = 24.0;
/// Rounds of Lloyd's iteration.
const ROUNDS: usize = 10;

/// 2x2 matrices of upright content at each scale, as it stands first, then mirrored.
pub(crate) fn upright(scales: usize, mirrored: bool) -> Vec<Matrix> {
    let signs = [(1, 1), (-1, 1), (1, -1), (-1, -1)];
    let signs = if mirrored { &signs[..] } else { &signs[..1] };
    let of = |&(across, down): &(i16, i16)| {
        let signed = move |[x, _, _, y]: Matrix| [across * x, 0, 0, down * y];
        (0..scales).map(move |scale| signed(scale_linear(scale)))
    };
    signs.iter().flat_map(of).collect()
}

/// At most `count` 2x2 matrices: those of upright content at each scale first, then those that lie nearest to
/// `found`, each with its weight.
pub(crate) fn fitted(
    found: &[(glam::Mat2, f32)],
    scales: usize,
    count: usize,
    cancel: CancelCheck<'_>,
) -> Vec<Matrix> {
    let mut palette = upright(scales, false);
    let mut buckets: BTreeMap<[i32; 4], (f32, Vec4)> = BTreeMap::new();
    for &(matrix, weight) in found {
        let point = Vec4::from_array(matrix.to_cols_array());
        let key = (point * SEED_STEPS).round().as_ivec4().to_array();
        let bucket = buckets.entry(key).or_default();
        bucket.0 += weight;
        bucket.1 += point * weight;
    }
    let mut seeds: Vec<(f32, Vec4)> =
        buckets.into_values().map(|(weight, sum)| (weight, sum / weight)).collect();
    seeds.sort_by(|a, b| b.0.total_cmp(&a.0));
    seeds.truncate(count.saturating_sub(palette.len()));
    let fixed: Vec<Vec4> = palette.iter().map(|&matrix| to_point(matrix)).collect();
    let mut centres: Vec<Vec4> = fixed.iter().copied().chain(seeds.iter().map(|seed| seed.1)).collect();
    for _ in 0..ROUNDS {
        let mut sums = vec![(0.0f32, Vec4::ZERO); centres.len()];
        for &(matrix, weight) in found {
            if cancel.is_cancelled() {
                return palette;
            }
            let point = Vec4::from_array(matrix.to_cols_array());
            let sum = &mut sums[nearest_point(&centres, point)];
            sum.0 += weight;
            sum.1 += point * weight;
        }
        for (centre, (weight, sum)) in centres.iter_mut().zip(sums).skip(fixed.len()) {
            if weight > 0.0 {
                *centre = sum / weight;
            }
        }
    }
    let matrix = |point: &Vec4| glam::Mat2::from_cols_array(&point.to_array());
    palette.extend(centres.iter().skip(fixed.len()).map(|point| quantise(matrix(point))));
    palette
}

/// The palette's entry nearest to a 2x2 matrix.
pub(crate) fn nearest(palette: &[Vec4], matrix: glam::Mat2) -> usize {
    nearest_point(palette, Vec4::from_array(matrix.to_cols_array()))
}

/// The columns of a stored 2x2 matrix.
pub(crate) fn to_point(matrix: Matrix) -> Vec4 {
    Vec4::from_array(super::candidate::matrix(matrix).to_cols_array())
}

fn nearest_point(centres: &[Vec4], point: Vec4) -> usize {
    let mut best = (0, f32::INFINITY);
    for (index, centre) in centres.iter().enumerate() {
        let distance = (*centre - point).length_squared();
        if distance < best.1 {
            best = (index, distance);
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Mat2;

    #[test]
    fn frequent_matrices_are_kept_exactly() {
        let mirror = Mat2::from_diagonal(glam::Vec2::new(-1.0, 1.0));
        let rotated = Mat2::from_angle(0.3);
        let found = [(mirror, 5.0), (rotated, 2.0), (Mat2::IDENTITY, 9.0)];
        let palette = fitted(&found, 2, 16, CancelCheck::default());
        assert_eq!(palette[..2], [[8192, 0, 0, 8192], [4096, 0, 0, 8192]]);
        assert!(palette.contains(&quantise(mirror)) && palette.contains(&quantise(rotated)));
        let points: Vec<Vec4> = palette.iter().map(|&matrix| to_point(matrix)).collect();
        assert_eq!(palette[nearest(&points, mirror)], quantise(mirror));
    }
}
