//! Small dense systems of equations, and homographies as matrices.

use glam::{DMat3, DVec2, DVec3};

/// Pivots below this share of the largest count as 0.
const SINGULAR: f64 = 1e-12;

/// Solves `matrix x = right` by elimination with pivots; `None` where the matrix is singular.
pub(crate) fn solve<const N: usize>(mut matrix: [[f64; N]; N], mut right: [f64; N]) -> Option<[f64; N]> {
    let largest = matrix.iter().flatten().fold(0f64, |most, value| most.max(value.abs()));
    for column in 0..N {
        let pivot =
            (column..N).max_by(|&a, &b| matrix[a][column].abs().total_cmp(&matrix[b][column].abs()))?;
        let usable = matrix[pivot][column].abs() > SINGULAR * largest;
        if !usable || !largest.is_finite() {
            return None;
        }
        matrix.swap(column, pivot);
        right.swap(column, pivot);
        let (lead, value) = (matrix[column], right[column]);
        for row in column + 1..N {
            let factor = matrix[row][column] / lead[column];
            for k in column..N {
                matrix[row][k] -= factor * lead[k];
            }
            right[row] -= factor * value;
        }
    }
    for row in (0..N).rev() {
        let known: f64 = (row + 1..N).map(|k| matrix[row][k] * right[k]).sum();
        right[row] = (right[row] - known) / matrix[row][row];
    }
    Some(right)
}

/// Where a homography leads; not finite where that is at infinity.
pub(crate) fn project(matrix: &DMat3, place: DVec2) -> DVec2 {
    let moved = *matrix * place.extend(1.0);
    moved.truncate() / moved.z
}

/// The homography's derivative at a place: columns are the changes along x and y.
pub(crate) fn slope(matrix: &DMat3, place: DVec2) -> (DVec2, DVec2) {
    let moved = *matrix * place.extend(1.0);
    let at = moved.truncate() / moved.z;
    let column = |column: DVec3| (column.truncate() - at * column.z) / moved.z;
    (column(matrix.x_axis), column(matrix.y_axis))
}

/// How many times larger areas become at a place; negative where what is seen is mirrored.
pub(crate) fn area_scale(matrix: &DMat3, place: DVec2) -> f64 {
    let (across, down) = slope(matrix, place);
    across.perp_dot(down)
}

/// The same homography with a last element of 1, or of length 1 where that is 0.
pub(crate) fn normalised(matrix: DMat3) -> DMat3 {
    let last = matrix.z_axis.z;
    let length = matrix.to_cols_array().iter().map(|value| value * value).sum::<f64>().sqrt();
    if last.abs() > 1e-9 * length { matrix * (1.0 / last) } else { matrix * (1.0 / length.max(1e-300)) }
}

/// Corners of a rectangle from (0, 0) to `extent`, in turn.
pub(crate) fn corners(extent: DVec2) -> [DVec2; 4] {
    [DVec2::ZERO, DVec2::new(extent.x, 0.0), extent, DVec2::new(0.0, extent.y)]
}

/// The part of a polygon that a homography gives a positive third coordinate of at least `least`, as homogeneous points.
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

/// What of a rectangle from (0, 0) to `extent` a homography leads into the rectangle from (0, 0) to `window`, as a polygon in the
/// latter; empty where nothing does.
pub(crate) fn seen_in(matrix: &DMat3, extent: DVec2, window: DVec2) -> Vec<DVec2> {
    // A share of the third coordinate at the middle: what is nearer to the horizon is cut off.
    let middle = (*matrix * (extent * 0.5).extend(1.0)).z;
    let matrix = if middle < 0.0 { *matrix * -1.0 } else { *matrix };
    let mut polygon = in_front(&matrix, &corners(extent), 1e-3 * middle.abs().max(1e-300));
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

/// The area of a polygon, positive whichever way it runs.
pub(crate) fn area(polygon: &[DVec2]) -> f64 {
    let pairs = polygon.iter().zip(polygon.iter().cycle().skip(1));
    0.5 * pairs.map(|(a, b)| a.perp_dot(*b)).sum::<f64>().abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systems_are_solved_and_singular_ones_refused() {
        let matrix = [[0.0, 2.0, 1.0], [1.0, 1.0, 0.0], [3.0, 0.0, -1.0]];
        let found = solve(matrix, [5.0, 3.0, 2.0]).unwrap();
        for (row, right) in matrix.iter().zip([5.0, 3.0, 2.0]) {
            let value: f64 = row.iter().zip(&found).map(|(a, b)| a * b).sum();
            assert!((value - right).abs() < 1e-12);
        }
        assert_eq!(solve([[1.0, 2.0], [2.0, 4.0]], [1.0, 2.0]), None);
        assert_eq!(solve([[0.0; 2]; 2], [1.0, 2.0]), None);
        assert_eq!(solve([[f64::NAN; 2]; 2], [1.0, 2.0]), None);
    }

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

    #[test]
    fn slopes_are_differences() {
        let matrix = DMat3::from_cols_array(&[1.2, 0.1, 1e-3, -0.2, 0.9, 2e-3, 3.0, 4.0, 1.0]);
        let (place, step) = (DVec2::new(7.0, -3.0), 1e-6);
        let (across, down) = slope(&matrix, place);
        let by_steps = |by: DVec2| (project(&matrix, place + by) - project(&matrix, place)) / step;
        assert!((by_steps(DVec2::X * step) - across).length() < 1e-5);
        assert!((by_steps(DVec2::Y * step) - down).length() < 1e-5);
    }
}
