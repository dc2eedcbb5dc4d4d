//! Incremental codewords: a vector joins a codeword within reach, else it becomes one.
//!
//! The codewords are kept in the order of their first principal coordinate; only those whose coordinate lies within reach
//! are compared. Unlike in [`crate::build`], the number of codewords follows from the reach.

use ndarray::{Array2, ArrayView2};

use crate::rotation::Rotation;
use crate::search::{padded_dims, within_reach};

/// A codebook that grows by the vectors that it does not hold.
#[derive(Debug, Clone)]
pub struct Leaders {
    rotation: Rotation,
    dims: usize,
    padded: usize,
    /// First rotated number and row of each codeword, sorted.
    order: Vec<(f32, u32)>,
    rotated: Vec<f32>,
    codewords: Vec<f32>,
}

impl Leaders {
    /// An empty codebook; `vectors` (rows) tell which directions vary.
    #[must_use]
    pub fn new(vectors: ArrayView2<'_, f32>) -> Self {
        let dims = vectors.ncols();
        Leaders {
            rotation: Rotation::principal(vectors),
            dims,
            padded: padded_dims(dims),
            order: Vec::new(),
            rotated: Vec::new(),
            codewords: Vec::new(),
        }
    }

    /// Number of codewords.
    #[must_use]
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Whether there is no codeword yet.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// The row of a codeword within the squared distance `reach` of `vector`, which is added where there is none.
    pub fn join_or_add(&mut self, vector: &[f32], reach: f32) -> u32 {
        let mut rotated = vec![0.0; self.padded];
        self.rotation.apply(vector, &mut rotated[..self.dims]);
        let first = rotated[0];
        let radius = reach.sqrt();
        let start = self.order.partition_point(|entry| entry.0 < first - radius);
        let near = self.order[start..].iter().take_while(|entry| entry.0 <= first + radius);
        for &(_, row) in near {
            let codeword = &self.rotated[row as usize * self.padded..(row as usize + 1) * self.padded];
            if within_reach(&rotated, codeword, reach) {
                return row;
            }
        }
        let row = self.order.len() as u32;
        let place = self.order.partition_point(|entry| entry.0 < first);
        self.order.insert(place, (first, row));
        self.rotated.extend(rotated);
        self.codewords.extend(vector);
        row
    }

    /// The codewords, one a row, in the order in which they were added.
    #[must_use]
    pub fn into_codewords(self) -> Array2<f32> {
        let (rows, dims) = (self.order.len(), self.dims);
        Array2::from_shape_vec((rows, dims), self.codewords).unwrap_or_else(|_| Array2::zeros((0, dims)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_vector_is_within_reach_and_no_codeword_is_needless(
            values in proptest::collection::vec(0.0f32..1.0, 10 * 60),
            radius in 0.05f32..1.5,
        ) {
            let vectors = Array2::from_shape_vec((60, 10), values).unwrap();
            let mut leaders = Leaders::new(vectors.view());
            let rows: Vec<u32> =
                vectors.rows().into_iter().map(|row| leaders.join_or_add(row.as_slice().unwrap(), radius * radius)).collect();
            let codewords = leaders.into_codewords();
            let distance = |a: ndarray::ArrayView1<'_, f32>, b: ndarray::ArrayView1<'_, f32>| {
                a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f32>().sqrt()
            };
            for (row, vector) in rows.iter().zip(vectors.rows()) {
                prop_assert!(distance(codewords.row(*row as usize), vector) <= radius * 1.001);
            }
            for a in 0..codewords.nrows() {
                for b in 0..a {
                    prop_assert!(distance(codewords.row(a), codewords.row(b)) >= radius * 0.999);
                }
            }
        }
    }
}
