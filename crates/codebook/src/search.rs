//! Nearest neighbours among codewords: exact but where thousands of them are about equally near, as in noise.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::ops::Range;

use ndarray::{Array2, ArrayView2, Axis};
use texfold_core::vectorised;

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

/// Vectors that are compared at once.
const LANES: usize = 8;
/// Vectors that a leaf holds: fewer cost more steps down the tree, more are compared in vain.
const LEAF: usize = 96;
/// Codewords compared for one vector, at most, up to a leaf: so many, and a share of all. Bounds the time on noise, where
/// every codeword is about equally far and no cell can be left out; elsewhere nearly every search ends before.
const MOST_COMPARED: usize = 1024;
const MOST_COMPARED_SHARE: usize = 8;

/// Rotated vectors in a k-d tree over their first [`CHUNK`] numbers (Friedman, Bentley and Finkel 1977), whose cells are
/// searched in the order of their distances (Arya and Mount 1993; Beis and Lowe 1997).
#[derive(Debug, Clone)]
pub(crate) struct Tree {
    /// Inner nodes in the order of a walk that takes the lower side first.
    nodes: Vec<Node>,
    /// First chunk of each vector, in the order of the leaves: what nearly every comparison ends with. Number by number of
    /// [`LANES`] vectors, so that as many are compared at once.
    heads: Vec<[[f32; LANES]; CHUNK]>,
    /// The further chunks, as many of each vector.
    tails: Vec<[f32; CHUNK]>,
    tail: usize,
    /// Row in the codebook, for each place.
    rows: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    axis: u32,
    split: f32,
    /// Node of the upper side, as far as it is no leaf.
    upper: u32,
}

/// A part of a tree, as seen from a vector.
#[derive(Debug, Clone, Copy)]
struct Cell {
    /// Squared distance of the vector to the cell.
    bound: f32,
    /// Its node, as far as it is no leaf.
    node: u32,
    /// Places of its vectors: first, and one past the last.
    start: u32,
    end: u32,
    /// Distance to the cell along each axis.
    offset: [f32; CHUNK],
}

impl Cell {
    /// The whole of a tree of that many vectors.
    fn whole(vectors: usize) -> Cell {
        Cell { bound: 0.0, node: 0, start: 0, end: vectors as u32, offset: [0.0; CHUNK] }
    }

    fn places(&self) -> Range<usize> {
        self.start as usize..self.end as usize
    }

    fn is_leaf(&self) -> bool {
        self.places().len() <= LEAF
    }

    /// The two cells that `node`, its own, splits it into: that of `vector`, and the other.
    fn halves(self, node: Node, vector: &[f32]) -> [Cell; 2] {
        let axis = node.axis as usize;
        let middle = self.start + (self.end - self.start) / 2;
        let lower = Cell { node: self.node + 1, end: middle, ..self };
        let upper = Cell { node: node.upper, start: middle, ..self };
        let gap = vector[axis] - node.split;
        let [near, mut far] = if gap < 0.0 { [lower, upper] } else { [upper, lower] };
        far.bound += gap * gap - self.offset[axis] * self.offset[axis];
        far.offset[axis] = gap;
        [near, far]
    }
}

/// Nearer cells come first.
impl Ord for Cell {
    fn cmp(&self, other: &Self) -> Ordering {
        other.bound.total_cmp(&self.bound).then(other.start.cmp(&self.start))
    }
}

impl PartialOrd for Cell {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Cell {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Cell {}

/// Length of a vector padded with zeros to whole chunks.
pub(crate) fn padded_dims(dims: usize) -> usize {
    dims.next_multiple_of(CHUNK)
}

impl Tree {
    /// Sorts those rows of `rotated` (padded rows) that `rows` names.
    pub(crate) fn new(rotated: &[f32], padded: usize, mut rows: Vec<u32>) -> Self {
        let mut nodes = Vec::new();
        split(rotated, padded, &mut rows, &mut nodes);
        let of_row = |row: u32| chunks(&rotated[row as usize * padded..(row as usize + 1) * padded]);
        let mut heads = vec![[[0.0; LANES]; CHUNK]; rows.len().div_ceil(LANES)];
        for (place, &row) in rows.iter().enumerate() {
            let head = &mut heads[place / LANES];
            head.iter_mut().zip(of_row(row)[0]).for_each(|(lanes, value)| lanes[place % LANES] = value);
        }
        let tails = rows.iter().flat_map(|&row| &of_row(row)[1..]).copied().collect();
        Tree { nodes, heads, tails, tail: padded / CHUNK - 1, rows }
    }

    /// Improves `best` over all vectors, the nearest cells first, within the limit of [`MOST_COMPARED`]; on equal
    /// distance the smaller row wins.
    pub(crate) fn improve(&self, vector: &[f32], best: &mut Match) {
        let mut cells = BinaryHeap::from([Cell::whole(self.rows.len())]);
        let mut left = MOST_COMPARED + self.rows.len() / MOST_COMPARED_SHARE;
        while let Some(mut cell) = cells.pop() {
            if cell.bound > best.distance || left == 0 {
                return;
            }
            while !cell.is_leaf() {
                let [near, far] = cell.halves(self.nodes[cell.node as usize], vector);
                if far.bound <= best.distance {
                    cells.push(far);
                }
                cell = near;
            }
            left = left.saturating_sub(cell.places().len());
            vectorised(
                #[inline(always)]
                || self.try_places(cell.places(), vector, best),
            );
        }
    }

    #[inline(always)]
    fn try_places(&self, places: Range<usize>, vector: &[f32], best: &mut Match) {
        for group in groups(&places) {
            let heads = self.head_distances(group, vector);
            if heads.iter().all(|&distance| distance > best.distance) {
                continue;
            }
            for place in lanes(group, &places) {
                let index = self.rows[place];
                // On equal distance the smaller row wins: `next_up` lets it through.
                let most = if index < best.index { best.distance.next_up() } else { best.distance };
                if let Some(distance) = self.distance_below(place, heads[place % LANES], vector, most) {
                    *best = Match { index, distance };
                }
            }
        }
    }

    /// Squared distances of the first chunks of a group, each summed as [`chunk_distance`] sums it.
    #[inline(always)]
    fn head_distances(&self, group: usize, vector: &[f32]) -> [f32; LANES] {
        let (head, vector) = (&self.heads[group], &chunks(vector)[0]);
        let mut halves = [[0.0; LANES]; CHUNK / 2];
        for (number, half) in halves.iter_mut().enumerate() {
            for (lane, half) in half.iter_mut().enumerate() {
                let one = vector[number] - head[number][lane];
                let other = vector[number + CHUNK / 2] - head[number + CHUNK / 2][lane];
                *half = one * one + other * other;
            }
        }
        let mut distances = [0.0; LANES];
        for (lane, distance) in distances.iter_mut().enumerate() {
            *distance = (halves[0][lane] + halves[1][lane]) + (halves[2][lane] + halves[3][lane]);
        }
        distances
    }

    /// The squared distance of the vector at `place`, of which that of the first chunk is known, where it is less than `most`.
    #[inline(always)]
    fn distance_below(&self, place: usize, head: f32, vector: &[f32], most: f32) -> Option<f32> {
        let mut distance = head;
        for (a, b) in chunks(vector)[1..].iter().zip(&self.tails[place * self.tail..(place + 1) * self.tail])
        {
            if distance >= most {
                return None;
            }
            distance += chunk_distance(a, b);
        }
        (distance < most).then_some(distance)
    }
}

/// Groups of [`LANES`] places that have some of these; none of no places.
fn groups(places: &Range<usize>) -> Range<usize> {
    places.start / LANES..places.end.div_ceil(LANES)
}

/// Those of the places that are of a group.
fn lanes(group: usize, places: &Range<usize>) -> Range<usize> {
    places.start.max(group * LANES)..places.end.min((group + 1) * LANES)
}

/// Squared distances of all vectors of a tree to the nearest of the vectors shown to it.
pub(crate) struct Nearest {
    tree: Tree,
    /// By place; 0 beyond the last.
    distances: Vec<[f32; LANES]>,
    /// Place of each row.
    places: Vec<u32>,
    /// The largest distance in each node's cell.
    largest: Vec<f32>,
}

impl Nearest {
    /// All rows of `rotated` (padded rows), none of which is near anything yet.
    pub(crate) fn new(rotated: &[f32], padded: usize) -> Self {
        let rows = rotated.len() / padded;
        let tree = Tree::new(rotated, padded, (0..rows as u32).collect());
        let mut places = vec![0; rows];
        tree.rows.iter().zip(0..).for_each(|(&row, place)| places[row as usize] = place);
        let mut distances = vec![[0.0; LANES]; rows.div_ceil(LANES)];
        distances.as_flattened_mut()[..rows].fill(f32::INFINITY);
        Nearest { distances, places, largest: vec![f32::INFINITY; tree.nodes.len()], tree }
    }

    /// Squared distance of a row to the nearest vector that was shown.
    pub(crate) fn distance(&self, row: u32) -> f32 {
        let place = self.places[row as usize] as usize;
        self.distances[place / LANES][place % LANES]
    }

    /// Takes `vector` into account and reports the rows that it is the nearest to.
    pub(crate) fn show(&mut self, vector: &[f32], report: &mut impl FnMut(u32)) {
        self.show_cell(Cell::whole(self.places.len()), vector, report);
    }

    /// As [`Nearest::show`], for a cell; returns its largest distance.
    fn show_cell(&mut self, cell: Cell, vector: &[f32], report: &mut impl FnMut(u32)) -> f32 {
        if cell.is_leaf() {
            return vectorised(
                #[inline(always)]
                || self.show_places(&cell.places(), vector, report),
            );
        }
        let node = cell.node as usize;
        // Bounds are sums in another order than distances: what rounding makes of them counts as near.
        if cell.bound * (1.0 - 1e-5) <= self.largest[node] {
            let halves = cell.halves(self.tree.nodes[node], vector);
            let [near, far] = halves.map(|half| self.show_cell(half, vector, report));
            self.largest[node] = near.max(far);
        }
        self.largest[node]
    }

    /// As [`Nearest::show`], for some places; returns their largest distance.
    #[inline(always)]
    fn show_places(&mut self, places: &Range<usize>, vector: &[f32], report: &mut impl FnMut(u32)) -> f32 {
        let mut largest = 0f32;
        for group in groups(places) {
            let heads = self.tree.head_distances(group, vector);
            let distances = &mut self.distances[group];
            if heads.iter().zip(&*distances).any(|(head, distance)| head < distance) {
                for place in lanes(group, places) {
                    let lane = place % LANES;
                    if let Some(nearer) =
                        self.tree.distance_below(place, heads[lane], vector, distances[lane])
                    {
                        distances[lane] = nearer;
                        report(self.tree.rows[place]);
                    }
                }
            }
            for place in lanes(group, places) {
                largest = largest.max(distances[place % LANES]);
            }
        }
        largest
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

/// A padded vector in chunks.
#[inline(always)]
fn chunks(vector: &[f32]) -> &[[f32; CHUNK]] {
    vector.as_chunks().0
}

#[inline(always)]
fn chunk_distance(a: &[f32; CHUNK], b: &[f32; CHUNK]) -> f32 {
    let mut lanes = [0f32; CHUNK];
    for ((lane, x), y) in lanes.iter_mut().zip(a).zip(b) {
        *lane = (x - y) * (x - y);
    }
    let half = |number: usize| lanes[number] + lanes[number + 4];
    (half(0) + half(1)) + (half(2) + half(3))
}

/// Squared distance of two padded vectors, summed as the search sums it.
pub(crate) fn padded_distance(a: &[f32], b: &[f32]) -> f32 {
    chunks(a).iter().zip(chunks(b)).map(|(a, b)| chunk_distance(a, b)).sum()
}

/// Whether two padded vectors are within the squared distance `reach`.
pub(crate) fn within_reach(a: &[f32], b: &[f32], reach: f32) -> bool {
    let mut distance = 0.0;
    chunks(a).iter().zip(chunks(b)).all(|(a, b)| {
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

    /// The codeword nearest to `vector`, or, of more than 1170, the nearest of at least 1024 and an eighth in the cells
    /// around it; `None` where none of these is within the squared distance `within`.
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
    use texfold_core::rng::XorShift;

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

    fn noise(rows: usize, dims: usize, seed: u64) -> Array2<f32> {
        let mut random = XorShift::new(seed);
        Array2::from_shape_simple_fn((rows, dims), || random.unit() as f32)
    }

    #[test]
    fn a_search_of_noise_ends_early_with_a_near_codeword() {
        let (codewords, queries) = (noise(4000, 48, 1), noise(60, 48, 2));
        let search = Search::new(codewords.view());
        let (mut found, mut nearest, mut missed) = (0.0, 0.0, 0);
        for query in queries.rows() {
            let query = query.as_slice().unwrap();
            let (here, best) =
                (search.nearest(query, f32::INFINITY).unwrap().distance, naive(&codewords, query));
            (found, nearest, missed) =
                (found + here, nearest + best, missed + usize::from(here > 1.001 * best));
        }
        assert!(missed > 0, "all codewords were compared");
        assert!(found < 1.1 * nearest, "{found} {nearest}");
    }

    #[test]
    fn vectors_near_a_codeword_find_it_among_thousands() {
        let (codewords, moves) = (noise(4000, 48, 3), noise(400, 48, 4));
        let search = Search::new(codewords.view());
        for (row, step) in moves.rows().into_iter().enumerate() {
            let query: Vec<f32> =
                codewords.row(row * 10).iter().zip(step).map(|(a, b)| a + 0.1 * b).collect();
            assert_eq!(search.nearest(&query, f32::INFINITY).unwrap().index, row as u32 * 10);
        }
    }

    #[test]
    fn distances_to_what_was_shown_are_the_naive_ones() {
        // In heaps, and as long as what bounds are of.
        let mut points = noise(900, 8, 5);
        points.outer_iter_mut().enumerate().for_each(|(row, mut point)| point += (row / 100) as f32);
        let rows = points.as_slice().unwrap();
        let mut nearest = Nearest::new(rows, 8);
        let mut naive = vec![f32::INFINITY; 900];
        // All of a heap, then some of the others, the furthest first.
        for shown in (0..100).chain((100..900).step_by(31).rev()) {
            let vector = &rows[shown * 8..(shown + 1) * 8];
            let mut reported = Vec::new();
            nearest.show(vector, &mut |row| reported.push(row as usize));
            reported.sort_unstable();
            let distance = |row: usize| padded_distance(vector, &rows[row * 8..(row + 1) * 8]);
            let expected: Vec<usize> = (0..900).filter(|&row| distance(row) < naive[row]).collect();
            naive.iter_mut().enumerate().for_each(|(row, least)| *least = least.min(distance(row)));
            assert_eq!(reported, expected);
            let distances: Vec<f32> = (0..900).map(|row| nearest.distance(row)).collect();
            assert_eq!(distances, naive);
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
