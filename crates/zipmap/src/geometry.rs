//! Homographies as matrices, and which part of a rectangle they cover: what decoding needs of them.

use glam::{DMat3, DVec2, DVec3};

/// A matrix whose last element is below this share of its length has its horizon there: it is scaled to length 1
/// instead.
const LEAST_LAST: f64 = 1e-9;
/// Share of the third coordinate at a rectangle's middle below which a place is too near to the horizon to count.
const HORIZON_SHARE: f64 = 1e-3;
/// Divisors are at least this.
const TINY: f64 = 1e-300;

/// The homography's derivative at a place: columns are the changes along x and y.
pub(crate) fn slope(matrix: &DMat3, place: DVec2) -> (DVec2, DVec2) {
    let moved = *matrix * place.extend(1.0);
    let at = moved.truncate() / moved.z;
    let column = |column: DVec3| (column.truncate() - at * column.z) / moved.z;
    (column(matrix.x_axis), column(matrix.y_axis))
}

/// The same homography with a last element of 1, or of length 1 where that is 0.
pub(crate) fn normalised(matrix: DMat3) -> DMat3 {
    let last = matrix.z_axis.z;
    let length = matrix.to_cols_array().iter().map(|value| value * value).sum::<f64>().sqrt();
    if last.abs() > LEAST_LAST * length { matrix * (1.0 / last) } else { matrix * (1.0 / length.max(TINY)) }
}

/// Corners of a rectangle from (0, 0) to `extent`, in turn.
pub(crate) fn corners(extent: DVec2) -> [DVec2; 4] {
    [DVec2::ZERO, DVec2::new(extent.x, 0.0), extent, DVec2::new(0.0, extent.y)]
}

/// The part of a polygon that a homography gives a positive third coordinate of at least `least`, as homogeneous
/// points.
fn in_front(matrix: &DMat3, polygon: &[DVec2], least: f64) -> Vec<DVec3> {
    let moved: Vec<DVec3> = polygon.iter().map(|point| *matrix * point.extend(1.0)).collect();
    clip(&moved, |point| point.z - least)
}

/// Cuts a polygon of homogeneous points to where `side` is not negative.
fn clip(polygon: &[DVec3], side: impl Fn(&DVec3) -> f64) -> Vec<DVec3> {
    let mut kept = Vec::new();
    for (index, &point) in polygon.iter().enumerate() {
        let next = polygon[(index + 1) % polygon.len()];
        let (here, there) = (side(&point), side(&next));
        if here >= 0.0 {
            kept.push(point);
        }
        if (here >= 0.0) != (there >= 0.0) {
            kept.push(point + (next - point) * (here / (here - there)));
        }
    }
    kept
}

/// What of a rectangle from (0, 0) to `extent` a homography leads into the rectangle from (0, 0) to `window`, as a
/// polygon in the latter; empty where nothing does.
pub(crate) fn seen_in(matrix: &DMat3, extent: DVec2, window: DVec2) -> Vec<DVec2> {
    let middle = (*matrix * (extent * 0.5).extend(1.0)).z;
    let matrix = if middle < 0.0 { *matrix * -1.0 } else { *matrix };
    let mut polygon = in_front(&matrix, &corners(extent), HORIZON_SHARE * middle.abs().max(TINY));
    polygon = clip(&polygon, |point| point.x);
    polygon = clip(&polygon, |point| point.y);
    polygon = clip(&polygon, |point| window.x * point.z - point.x);
    polygon = clip(&polygon, |point| window.y * point.z - point.y);
    polygon.iter().map(|point| point.truncate() / point.z).filter(|point| point.is_finite()).collect()
}

/// What of a polygon lies in the rectangle from (0, 0) to `window`.
pub(crate) fn cut(polygon: &[DVec2], window: DVec2) -> Vec<DVec3> {
    let mut kept: Vec<DVec3> = polygon.iter().map(|point| point.extend(1.0)).collect();
    kept = clip(&kept, |point| point.x);
    kept = clip(&kept, |point| point.y);
    kept = clip(&kept, |point| window.x - point.x);
    clip(&kept, |point| window.y - point.y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::area;

    #[test]
    fn rectangles_are_cut_to_the_window_and_at_the_horizon() {
        let window = DVec2::new(10.0, 10.0);
        let shifted = DMat3::from_translation(DVec2::new(5.0, -2.0));
        let polygon = seen_in(&shifted, DVec2::new(10.0, 10.0), window);
        assert!((area(&polygon) - 40.0).abs() < 1e-9, "{polygon:?}");
        let away = DMat3::from_translation(DVec2::new(50.0, 0.0));
        assert!(area(&seen_in(&away, DVec2::new(10.0, 10.0), window)) == 0.0);
        // A third coordinate that changes its sign within the rectangle.
        let mut steep = DMat3::IDENTITY;
        steep.x_axis.z = -0.15;
        let polygon = seen_in(&steep, DVec2::new(10.0, 10.0), window);
        assert!(polygon.iter().all(|point| point.is_finite()) && area(&polygon) > 0.0, "{polygon:?}");
    }
}
