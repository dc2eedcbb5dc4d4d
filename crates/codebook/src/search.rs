//! Exact nearest neighbours among codewords.

use ndarray::{Array2, ArrayView2, Axis};

use crate::rotation::Rotation;

/// Numbers compared before the running distance is held against the best: below 8 the tests cost more than they
/// save, above 16 too much is summed.
const CHUNK: usize = 8;

/// The nearest codeword.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Its row in the codebook.
    pub index: u32,
    /// Squared Euclidean distance.
    pub distance: f32,
}

/// Codewords prepared for searching.
#[derive(Debug, Clone)]
pub struct Search {
    rotation: Rotation,
    sorted: Sorted,
    dims: usize,
}

/// Rotated vectors in the order of their first number.
#[derive(Debug, Clone)]
pub(crate) struct Sorted {
    first: Vec<f32>,
    /// Padded to a multiple of [`CHUNK`] numbers each.
    values: Vec<f32>,
    /// Row in the codebook, for each sorted place.
    rows: Vec<u32>,
    padded: usize,
}

/// Length of a vector padded with zeros to whole chunks.
pub(crate) fn padded_dims(dims: usize) -> usize {
    dims.next_multiple_of(CHUNK)
}

impl Sorted {
    /// Sorts those rows of `rotated` (padded rows) that `rows` names.
    pub(crate) fn new(rotated: &[f32], padded: usize, mut rows: Vec<u32>) -> Self {
        let first_of = |row: u32| rotated[row as usize * padded];
        rows.sort_by(|&a, &b| first_of(a).total_cmp(&first_of(b)).then(a.cmp(&b)));
        let first = rows.iter().map(|&row| first_of(row)).collect();
        let values = rows
            .iter()
            .flat_map(|&row| &rotated[row as usize * padded..(row as usize + 1) * padded])
            .copied()
            .collect();
        Sorted { first, values, rows, padded }
    }

    /// Improves `best` over all vectors; on equal distance the smaller row wins.
    pub(crate) fn improve(&self, vector: &[f32], best: &mut Match) {
        let start = self.first.partition_point(|&first| first < vector[0]);
        let (mut low, mut high) = (start, start);
        loop {
            let below = if low > 0 { gap(vector[0], self.first[low - 1]) } else { f32::INFINITY };
            let above = if high < self.first.len() { gap(vector[0], self.first[high]) } else { f32::INFINITY };
            if below.min(above) > best.distance || (low == 0 && high == self.first.len()) {
                return;
            }
            let place = if below < above {
                low -= 1;
                low
            } else {
                high += 1;
                high - 1
            };
            self.try_place(place, vector, best);
        }
    }

    fn try_place(&self, place: usize, vector: &[f32], best: &mut Match) {
        let candidate = &self.values[place * self.padded..(place + 1) * self.padded];
        let mut distance = 0.0;
        for (a, b) in vector.chunks_exact(CHUNK).zip(candidate.chunks_exact(CHUNK)) {
            distance += chunk_distance(a, b);
            if distance > best.distance {
                return;
            }
        }
        let index = self.rows[place];
        if distance < best.distance || index < best.index {
            *best = Match { index, distance };
        }
    }
}

fn gap(a: f32, b: f32) -> f32 {
    (a - b) * (a - b)
}

fn chunk_distance(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0f32; CHUNK];
    for ((lane, x), y) in lanes.iter_mut().zip(a).zip(b) {
        *lane = (x - y) * (x - y);
    }
    let half: [f32; 4] = std::array::from_fn(|i| lanes[i] + lanes[i + 4]);
    (half[0] + half[1]) + (half[2] + half[3])
}

/// Squared distance of two padded vectors, summed as the search sums it.
pub(crate) fn padded_distance(a: &[f32], b: &[f32]) -> f32 {
    a.chunks_exact(CHUNK).zip(b.chunks_exact(CHUNK)).map(|(a, b)| chunk_distance(a, b)).sum()
}

/// Whether two padded vectors are within the squared distance `reach`.
pub(crate) fn within_reach(a: &[f32], b: &[f32], reach: f32) -> bool {
    let mut distance = 0.0;
    a.chunks_exact(CHUNK).zip(b.chunks_exact(CHUNK)).all(|(a, b)| {
        distance += chunk_distance(a, b);
        distance <= reach
    })
}

/// Rows of `vectors`, rotated and padded.
pub(crate) fn rotate_padded(rotation: &Rotation, vectors: ArrayView2<'_, f32>) -> Vec<f32> {
    let rotated: Array2<f32> = rotation.apply_all(vectors);
    let padded = padded_dims(vectors.ncols());
    let mut out = vec![0.0; vectors.nrows() * padded];
    for (row, line) in rotated.axis_iter(Axis(0)).zip(out.chunks_exact_mut(padded.max(1))) {
        line.iter_mut().zip(row).for_each(|(to, &from)| *to = from);
    }
    out
}

impl Search {
    /// Prepares the rows of `codewords` (at least one).
    #[must_use]
    pub fn new(codewords: ArrayView2<'_, f32>) -> Self {
        let rotation = Rotation::principal(codewords);
        let rotated = rotate_padded(&rotation, codewords);
        let rows = (0..codewords.nrows() as u32).collect();
        let dims = codewords.ncols();
        Search { sorted: Sorted::new(&rotated, padded_dims(dims), rows), rotation, dims }
    }

    /// The codeword nearest to `vector`; `None` where none is within the squared distance `within`.
    #[must_use]
    pub fn nearest(&self, vector: &[f32], within: f32) -> Option<Match> {
        let mut rotated = [0.0; 256];
        let padded = padded_dims(self.dims);
        if padded > rotated.len() {
            let mut long = vec![0.0; padded];
            return self.search(vector, &mut long, within);
        }
        self.search(vector, &mut rotated[..padded], within)
    }

    fn search(&self, vector: &[f32], rotated: &mut [f32], within: f32) -> Option<Match> {
        self.rotation.apply(vector, &mut rotated[..self.dims]);
        let mut best = Match { index: u32::MAX, distance: within };
        self.sorted.improve(rotated, &mut best);
        (best.index != u32::MAX).then_some(best)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn naive(codewords: &Array2<f32>, vector: &[f32]) -> f32 {
        let distance =
            |row: ndarray::ArrayView1<'_, f32>| row.iter().zip(vector).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
        codewords.rows().into_iter().map(distance).fold(f32::INFINITY, f32::min)
    }

    proptest! {
        #[test]
        fn equals_the_naive_search(
            values in proptest::collection::vec(0.0f32..1.0, 12 * 40),
            query in proptest::collection::vec(0.0f32..1.0, 12),
        ) {
            let codewords = Array2::from_shape_vec((40, 12), values).unwrap();
            let found = Search::new(codewords.view()).nearest(&query, f32::INFINITY).unwrap();
            let best = naive(&codewords, &query);
            prop_assert!((found.distance - best).abs() < 1e-4, "{} {best}", found.distance);
            let itself = naive(&codewords.select(Axis(0), &[found.index as usize]), &query);
            prop_assert!((itself - best).abs() < 1e-4);
        }
    }

    #[test]
    fn nothing_within_reach_is_none() {
        let codewords = Array2::from_elem((3, 5), 0.5);
        let search = Search::new(codewords.view());
        assert_eq!(search.nearest(&[0.9; 5], 0.01), None);
        assert_eq!(search.nearest(&[0.5; 5], 0.01).map(|m| m.index), Some(0));
    }

    #[test]
    fn thousands_of_identical_codewords_are_no_trouble() {
        let codewords = Array2::from_elem((5000, 48), 0.25);
        let found = Search::new(codewords.view()).nearest(&[0.5; 48], f32::INFINITY).unwrap();
        assert_eq!(found.index, 0);
        assert!((found.distance - 3.0).abs() < 1e-4);
    }
}
