//! Principal axes of vectors, and rotation of vectors to them.

use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;
use texfold_core::{principal_axes, vectorised};

/// Sweeps of the Jacobi method; it converges quadratically, 3 or 4 are the rule at this accuracy.
const MAX_SWEEPS: u32 = 6;
/// Share of off-diagonal energy below which the axes are good enough: they only steer the order of summation.
const OFF_DIAGONAL: f64 = 1e-3;
/// Vectors that the axes are estimated from; more took longer than their better axes saved.
const MAX_SAMPLES: usize = 2048;

/// An orthonormal basis; columns are axes, by falling variance.
#[derive(Debug, Clone)]
pub(crate) struct Rotation {
    axes: Vec<f32>,
    dims: usize,
}

impl Rotation {
    /// The principal axes of `vectors` (rows).
    pub(crate) fn principal(vectors: ArrayView2<'_, f32>) -> Self {
        let dims = vectors.ncols();
        let mut matrix = second_moments(vectors);
        let axes = principal_axes(matrix.as_mut_slice(), dims, MAX_SWEEPS, OFF_DIAGONAL);
        let columns = (0..dims * dims).map(|at| axes[at % dims * dims + at / dims] as f32);
        Rotation { axes: columns.collect(), dims }
    }

    /// `vector` in the rotated space; distances stay what they were, up to rounding.
    pub(crate) fn apply(&self, vector: &[f32], out: &mut [f32]) {
        vectorised(
            #[inline(always)]
            || {
                out.fill(0.0);
                for (weights, value) in self.axes.chunks_exact(self.dims.max(1)).zip(vector) {
                    out.iter_mut().zip(weights).for_each(|(out, weight)| *out += weight * value);
                }
            },
        );
    }

    /// All rows of `vectors`, rotated.
    pub(crate) fn apply_all(&self, vectors: ArrayView2<'_, f32>) -> Array2<f32> {
        let dims = vectors.ncols();
        let mut out = Array2::zeros(vectors.dim());
        if let Some(values) = out.as_slice_mut() {
            values.par_chunks_mut(dims.max(1)).enumerate().for_each(|(row, line)| {
                let vector = vectors.row(row);
                match vector.as_slice() {
                    Some(vector) => self.apply(vector, line),
                    None => self.apply(&vector.to_vec(), line),
                }
            });
        }
        out
    }
}

/// Covariance matrix of a regular subset of the rows.
fn second_moments(vectors: ArrayView2<'_, f32>) -> Vec<f64> {
    let dims = vectors.ncols();
    let stride = vectors.nrows().div_ceil(MAX_SAMPLES).max(1);
    let rows = || vectors.rows().into_iter().step_by(stride);
    let count = rows().count().max(1) as f64;
    let mut mean = vec![0f64; dims];
    for row in rows() {
        mean.iter_mut().zip(row).for_each(|(sum, &value)| *sum += f64::from(value) / count);
    }
    let mut matrix = vec![0.0; dims * dims];
    let mut centred = vec![0f64; dims];
    for row in rows() {
        centred.iter_mut().zip(row).zip(&mean).for_each(|((c, &value), m)| *c = f64::from(value) - m);
        for p in 0..dims {
            for q in p..dims {
                matrix[p * dims + q] += centred[p] * centred[q];
            }
        }
    }
    for p in 0..dims {
        for q in 0..p {
            matrix[p * dims + q] = matrix[q * dims + p];
        }
    }
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_orthonormal_and_sorted() {
        let vectors = Array2::from_shape_fn((200, 6), |(i, j)| {
            let t = i as f32 * 0.37;
            (t + j as f32).sin() * (6 - j) as f32 + ((i * 7 + j * 13) % 11) as f32 * 0.1
        });
        let rotation = Rotation::principal(vectors.view());
        let axes = Array2::from_shape_vec((6, 6), rotation.axes.clone()).unwrap();
        let gram = axes.t().dot(&axes);
        for ((p, q), value) in gram.indexed_iter() {
            assert!((value - if p == q { 1.0 } else { 0.0 }).abs() < 1e-5, "{p} {q} {value}");
        }
        let rotated = rotation.apply_all(vectors.view());
        let variances: Vec<f32> = rotated.columns().into_iter().map(|column| column.var(0.0)).collect();
        assert!(variances.windows(2).all(|pair| pair[0] >= pair[1] * 0.999), "{variances:?}");
    }
}
