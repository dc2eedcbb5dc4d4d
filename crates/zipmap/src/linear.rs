//! Small dense systems of equations, and what else encoding and registration need of homographies.

use glam::{DMat3, DVec2};

use crate::geometry::slope;

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

/// How many times larger areas become at a place; negative where what is seen is mirrored.
pub(crate) fn area_scale(matrix: &DMat3, place: DVec2) -> f64 {
    let (across, down) = slope(matrix, place);
    across.perp_dot(down)
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
    fn slopes_are_differences() {
        let matrix = DMat3::from_cols_array(&[1.2, 0.1, 1e-3, -0.2, 0.9, 2e-3, 3.0, 4.0, 1.0]);
        let (place, step) = (DVec2::new(7.0, -3.0), 1e-6);
        let (across, down) = slope(&matrix, place);
        let by_steps = |by: DVec2| (project(&matrix, place + by) - project(&matrix, place)) / step;
        assert!((by_steps(DVec2::X * step) - across).length() < 1e-5);
        assert!((by_steps(DVec2::Y * step) - down).length() < 1e-5);
    }
}
