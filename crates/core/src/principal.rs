//! Principal axes of symmetric matrices by the cyclic Jacobi method (Golub and Van Loan, "Matrix computations", section 8.5).

/// Principal axes of a symmetric matrix of `dims` x `dims` numbers, row by row: orthonormal rows, the one with the largest
/// eigenvalue first. Sweeps end when off-diagonal elements have less than that share of the energy, or after `max_sweeps`; the
/// method converges quadratically. Cost: `dims`³ for each sweep. `matrix` is left nearly diagonal.
#[must_use]
pub fn principal_axes(matrix: &mut [f64], dims: usize, max_sweeps: u32, off_diagonal: f64) -> Vec<f64> {
    let mut axes = vec![0.0; dims * dims];
    (0..dims).for_each(|axis| axes[axis * dims + axis] = 1.0);
    for _ in 0..max_sweeps {
        if off_diagonal_share(matrix, dims) < off_diagonal {
            break;
        }
        for p in 0..dims {
            for q in p + 1..dims {
                rotate_pair(matrix, &mut axes, dims, (p, q));
            }
        }
    }
    let mut order: Vec<usize> = (0..dims).collect();
    let value = |axis: usize| matrix[axis * dims + axis];
    order.sort_by(|&a, &b| value(b).total_cmp(&value(a)).then(a.cmp(&b)));
    order.into_iter().flat_map(|axis| axes[axis * dims..(axis + 1) * dims].to_vec()).collect()
}

fn off_diagonal_share(matrix: &[f64], dims: usize) -> f64 {
    let total: f64 = matrix.iter().map(|value| value * value).sum();
    let diagonal: f64 = (0..dims).map(|axis| matrix[axis * dims + axis] * matrix[axis * dims + axis]).sum();
    if total > 0.0 { 1.0 - diagonal / total } else { 0.0 }
}

/// Rotates the plane of axes `p` and `q` so that their covariance vanishes.
fn rotate_pair(matrix: &mut [f64], axes: &mut [f64], dims: usize, (p, q): (usize, usize)) {
    let off = matrix[p * dims + q];
    if off == 0.0 {
        return;
    }
    let theta = (matrix[q * dims + q] - matrix[p * dims + p]) / (2.0 * off);
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let cos = 1.0 / (t * t + 1.0).sqrt();
    let sin = t * cos;
    let rotated = |a: f64, b: f64| (cos * a - sin * b, sin * a + cos * b);
    for k in 0..dims {
        let (one, other) = (k * dims + p, k * dims + q);
        (matrix[one], matrix[other]) = rotated(matrix[one], matrix[other]);
    }
    for k in 0..dims {
        let (one, other) = (p * dims + k, q * dims + k);
        (matrix[one], matrix[other]) = rotated(matrix[one], matrix[other]);
        (axes[one], axes[other]) = rotated(axes[one], axes[other]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    #[test]
    fn axes_are_orthonormal_and_make_the_matrix_diagonal() {
        let mut rng = Rng::new(4);
        for dims in 1..=7 {
            let mut matrix = vec![0.0; dims * dims];
            for (row, column) in (0..dims).flat_map(|row| (0..=row).map(move |column| (row, column))) {
                let value = rng.unit() - 0.5;
                (matrix[row * dims + column], matrix[column * dims + row]) = (value, value);
            }
            let before = matrix.clone();
            let axes = principal_axes(&mut matrix, dims, 20, 1e-20);
            let row = |axis: usize| &axes[axis * dims..(axis + 1) * dims];
            let times = |vector: &[f64]| -> Vec<f64> {
                before
                    .chunks_exact(dims)
                    .map(|line| line.iter().zip(vector).map(|(a, b)| a * b).sum())
                    .collect()
            };
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let values: Vec<f64> = (0..dims).map(|axis| dot(row(axis), &times(row(axis)))).collect();
            assert!(values.windows(2).all(|pair| pair[0] >= pair[1] - 1e-12), "{values:?}");
            for (a, b) in (0..dims).flat_map(|a| (0..dims).map(move |b| (a, b))) {
                let (same, value) = if a == b { (1.0, values[a]) } else { (0.0, 0.0) };
                assert!((dot(row(a), row(b)) - same).abs() < 1e-12);
                assert!((dot(row(a), &times(row(b))) - value).abs() < 1e-9, "{dims}: {a} {b}");
            }
        }
    }
}
