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
    tree: Tree,
    dims: usize,
}

/// Vectors that a leaf holds: fewer cost more steps down the tree, more are compared in vain.
const LEAF: usize = 12;

/// Rotated vectors in a k-d tree over their first [`CHUNK`] numbers (Friedman, Bentley and Finkel 1977; distances to
/// cells kept incrementally after Arya and Mount 1993).
#[derive(Debug, Clone)]
pub(crate) struct Tree {
    /// Inner nodes in the order of a walk that takes the lower side first.
    nodes: Vec<Node>,
    /// First chunk of each vector, in the order of the leaves: what nearly every comparison ends with.
    heads: Vec<f32>,
    /// The further chunks.
    tails: Vec<f32>,
    /// Row in the codebook, for each place.
    rows: Vec<u32>,
    padded: usize,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    axis: u32,
    split: f32,
    /// Node of the upper side, as far as it is no leaf.
    upper: u32,
}

/// A search on its way.
struct Query<'a> {
    vector: &'a [f32],
    /// Distance to the cell along each axis.
    offset: [f32; CHUNK],
    best: &'a mut Match,
}

/// Length of a vector padded with zeros to whole chunks.
pub(crate) fn padded_dims(dims: usize) -> usize {
    dims.next_multiple_of(CHUNK)
}

impl Tree {
    /// Sorts those rows of `rotated` (padded rows) that `rows` names.
    pub(crate) fn new(rotated: &[f32], padded: usize, mut rows: Vec<u32>) -> Self {
        let mut nodes = Vec::new();
        split(rotated, padded, &mut rows, &mut nodes);
        let part = |range: std::ops::Range<usize>| -> Vec<f32> {
            let of_row = |row: u32| &rotated[row as usize * padded..(row as usize + 1) * padded];
            rows.iter().flat_map(|&row| &of_row(row)[range.clone()]).copied().collect()
        };
        let head = CHUNK.min(padded);
        Tree { nodes, heads: part(0..head), tails: part(head..padded), rows, padded }
    }

    /// Improves `best` over all vectors; on equal distance the smaller row wins.
    pub(crate) fn improve(&self, vector: &[f32], best: &mut Match) {
        let mut query = Query { vector, offset: [0.0; CHUNK], best };
        self.visit(0, 0..self.rows.len(), 0.0, &mut query);
    }

    /// Looks into the cell of `node`, whose vectors are at `range` and at least the squared distance `bound` away.
    fn visit(&self, node: usize, range: std::ops::Range<usize>, bound: f32, query: &mut Query<'_>) {
        if range.len() <= LEAF {
            return range.for_each(|place| self.try_place(place, query));
        }
        let Node { axis, split, upper } = self.nodes[node];
        let axis = axis as usize;
        let middle = range.start + range.len() / 2;
        let (lower, upper) = ((node + 1, range.start..middle), (upper as usize, middle..range.end));
        let gap = query.vector[axis] - split;
        let (near, far) = if gap < 0.0 { (lower, upper) } else { (upper, lower) };
        self.visit(near.0, near.1, bound, query);
        let before = query.offset[axis];
        let far_bound = bound - before * before + gap * gap;
        if far_bound <= query.best.distance {
            query.offset[axis] = gap;
            self.visit(far.0, far.1, far_bound, query);
            query.offset[axis] = before;
        }
    }

    fn try_place(&self, place: usize, query: &mut Query<'_>) {
        let (head, tail) = (CHUNK.min(self.padded), self.padded.saturating_sub(CHUNK));
        let mut distance =
            chunk_distance(&query.vector[..head], &self.heads[place * head..(place + 1) * head]);
        if distance > query.best.distance {
            return;
        }
        let tails = &self.tails[place * tail..(place + 1) * tail];
        for (a, b) in query.vector[head..].chunks_exact(CHUNK).zip(tails.chunks_exact(CHUNK)) {
            distance += chunk_distance(a, b);
            if distance > query.best.distance {
                return;
            }
        }
        let index = self.rows[place];
        if distance < query.best.distance || index < query.best.index {
            *query.best = Match { index, distance };
        }
    }
}

/// Splits `rows` at the median of the axis on which they spread most, down to leaves.
fn split(rotated: &[f32], padded: usize, rows: &mut [u32], nodes: &mut Vec<Node>) {
    if rows.len() <= LEAF {
        return;
    }
    let value = |row: u32, axis: usize| rotated[row as usize * padded + axis];
    let spread = |axis: usize| {
        let ends = rows.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &row| {
            (low.min(value(row, axis)), high.max(value(row, axis)))
        });
        ends.1 - ends.0
    };
    let spreads: Vec<f32> = (0..CHUNK.min(padded)).map(spread).collect();
    let axis =
        (0..spreads.len()).fold(0, |best, axis| if spreads[axis] > spreads[best] { axis } else { best });
    let middle = rows.len() / 2;
    rows.select_nth_unstable_by(middle, |&a, &b| value(a, axis).total_cmp(&value(b, axis)).then(a.cmp(&b)));
    let node = nodes.len();
    nodes.push(Node { axis: axis as u32, split: value(rows[middle], axis), upper: 0 });
    let (lower, upper) = rows.split_at_mut(middle);
    split(rotated, padded, lower, nodes);
    nodes[node].upper = nodes.len() as u32;
    split(rotated, padded, upper, nodes);
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
        Search { tree: Tree::new(&rotated, padded_dims(dims), rows), rotation, dims }
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
        self.tree.improve(rotated, &mut best);
        (best.index != u32::MAX).then_some(best)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn naive(codewords: &Array2<f32>, vector: &[f32]) -> f32 {
        let distance = |row: ndarray::ArrayView1<'_, f32>| {
            row.iter().zip(vector).map(|(a, b)| (a - b) * (a - b)).sum::<f32>()
        };
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
