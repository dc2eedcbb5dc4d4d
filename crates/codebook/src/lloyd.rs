//! The generalised Lloyd algorithm with weights.

use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;
use texfold_core::rng::XorShift;

use crate::rotation::Rotation;
use crate::search::{Match, Tree, padded_dims, padded_distance, rotate_padded};
use crate::seeding::seeds;

/// How long to iterate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Most rounds of assignment and averaging.
    pub rounds: u32,
    /// Stops when a round lowers the weighted distortion by less than this share.
    pub least_gain: f64,
    /// Start of the pseudo-random seeding.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { rounds: 20, least_gain: 2e-3, seed: 1 }
    }
}

/// A codebook and what it does to the vectors that it was built from.
#[derive(Debug, Clone)]
pub struct Codebook {
    /// One codeword a row; at most as many as requested, fewer where there are fewer distinct vectors.
    pub codewords: Array2<f32>,
    /// The nearest codeword of each vector.
    pub matches: Vec<Match>,
    /// Sum of weight x squared distance over all vectors, round by round; never rises.
    pub history: Vec<f64>,
}

impl Codebook {
    fn empty(dims: usize) -> Self {
        Codebook { codewords: Array2::zeros((0, dims)), matches: Vec::new(), history: Vec::new() }
    }
}

struct State<'a> {
    points: Vec<f32>,
    padded: usize,
    weights: &'a [f32],
    /// Rotated codewords, padded.
    codewords: Vec<f32>,
    matches: Vec<Match>,
}

/// Builds a codebook of at most `count` codewords for the rows of `vectors`, each of which weighs as `weights` says
/// (not negative; one for each row). Values must be finite.
#[must_use]
pub fn build(vectors: ArrayView2<'_, f32>, weights: &[f32], count: usize, settings: Settings) -> Codebook {
    build_unless(vectors, weights, count, settings, &|| false)
        .unwrap_or_else(|| Codebook::empty(vectors.ncols()))
}

/// As [`build`], but `None` once `stop` says so. It is called on all threads, for each vector of a round and for each seed.
#[must_use]
pub fn build_unless(
    vectors: ArrayView2<'_, f32>,
    weights: &[f32],
    count: usize,
    settings: Settings,
    stop: &(dyn Fn() -> bool + Sync),
) -> Option<Codebook> {
    let (rows, dims) = vectors.dim();
    if rows == 0 || count == 0 || dims == 0 {
        return Some(Codebook::empty(dims));
    }
    let rotation = Rotation::principal(vectors);
    let padded = padded_dims(dims);
    let points = rotate_padded(&rotation, vectors);
    let start = seeds(&points, padded, weights, count, &mut XorShift::new(settings.seed), stop)?;
    let row = |index: u32| &points[index as usize * padded..(index as usize + 1) * padded];
    let codewords: Vec<f32> = start.iter().flat_map(|&index| row(index)).copied().collect();
    let matches = vec![Match { index: u32::MAX, distance: f32::INFINITY }; rows];
    let mut state = State { points, padded, weights, codewords, matches };
    let history = iterate(&mut state, settings, stop)?;
    Some(Codebook { codewords: means(vectors, weights, &state), matches: state.matches, history })
}

fn iterate(state: &mut State<'_>, settings: Settings, stop: &(dyn Fn() -> bool + Sync)) -> Option<Vec<f64>> {
    let count = state.codewords.len() / state.padded;
    let mut moved = vec![true; count];
    let mut history = Vec::new();
    for round in 0..settings.rounds.max(1) {
        state.assign(&moved, stop);
        if stop() {
            return None;
        }
        let distortion = state.distortion();
        let gain = history.last().map_or(f64::INFINITY, |&before: &f64| before - distortion);
        history.push(distortion);
        let small = gain <= settings.least_gain * distortion;
        if small || round + 1 == settings.rounds.max(1) {
            break;
        }
        moved = state.average();
    }
    Some(history)
}

impl State<'_> {
    fn point(&self, row: usize) -> &[f32] {
        &self.points[row * self.padded..(row + 1) * self.padded]
    }

    fn codeword(&self, index: u32) -> &[f32] {
        &self.codewords[index as usize * self.padded..(index as usize + 1) * self.padded]
    }

    /// Finds every point's nearest codeword, knowing which codewords moved since the last time.
    fn assign(&mut self, moved: &[bool], stop: &(dyn Fn() -> bool + Sync)) {
        let all = Tree::new(&self.codewords, self.padded, (0..moved.len() as u32).collect());
        let active: Vec<u32> = (0..moved.len() as u32).filter(|&index| moved[index as usize]).collect();
        let active = Tree::new(&self.codewords, self.padded, active);
        let state = &*self;
        let find = |row: usize| {
            let (point, before) = (state.point(row), state.matches[row]);
            if stop() {
                return before;
            }
            if before.index == u32::MAX {
                let mut best = before;
                all.improve(point, &mut best);
                return best;
            }
            let mut best =
                Match { index: before.index, distance: padded_distance(point, state.codeword(before.index)) };
            // A codeword that came nearer, or stayed, still beats all that stayed.
            let among = if best.distance <= before.distance { &active } else { &all };
            among.improve(point, &mut best);
            best
        };
        self.matches = (0..state.matches.len()).into_par_iter().with_min_len(256).map(find).collect();
    }

    fn distortion(&self) -> f64 {
        self.matches
            .iter()
            .zip(self.weights)
            .map(|(m, &weight)| f64::from(m.distance) * f64::from(weight))
            .sum()
    }

    /// Moves every codeword to the weighted mean of its points, empty ones to the points that are worst off; says
    /// which moved.
    fn average(&mut self) -> Vec<bool> {
        let count = self.codewords.len() / self.padded;
        let mut sums = vec![0f64; self.codewords.len()];
        let mut totals = vec![0f64; count];
        for (row, found) in self.matches.iter().enumerate() {
            let weight = f64::from(self.weights[row]);
            let start = found.index as usize * self.padded;
            totals[found.index as usize] += weight;
            let sum = &mut sums[start..start + self.padded];
            sum.iter_mut().zip(self.point(row)).for_each(|(sum, &value)| *sum += weight * f64::from(value));
        }
        let mut moved = vec![false; count];
        for index in (0..count).filter(|&index| totals[index] > 0.0) {
            let range = index * self.padded..(index + 1) * self.padded;
            for (codeword, sum) in self.codewords[range.clone()].iter_mut().zip(&sums[range]) {
                let mean = (sum / totals[index]) as f32;
                moved[index] |= *codeword != mean;
                *codeword = mean;
            }
        }
        let empty: Vec<usize> = (0..count).filter(|&index| totals[index] <= 0.0).collect();
        for (&index, row) in empty.iter().zip(self.worst_points(empty.len())) {
            let point = self.point(row).to_vec();
            self.codewords[index * self.padded..(index + 1) * self.padded].copy_from_slice(&point);
            moved[index] = true;
        }
        moved
    }

    /// The points with the most weighted distortion, worst first.
    fn worst_points(&self, count: usize) -> Vec<usize> {
        if count == 0 {
            return Vec::new();
        }
        let share = |row: usize| self.matches[row].distance * self.weights[row];
        let mut rows: Vec<usize> = (0..self.matches.len()).filter(|&row| share(row) > 0.0).collect();
        rows.sort_by(|&a, &b| share(b).total_cmp(&share(a)).then(a.cmp(&b)));
        rows.truncate(count);
        rows
    }
}

/// Weighted means of the cells in the unrotated space; a cell without weight keeps the plain mean of its vectors.
fn means(vectors: ArrayView2<'_, f32>, weights: &[f32], state: &State<'_>) -> Array2<f32> {
    let (dims, count) = (vectors.ncols(), state.codewords.len() / state.padded);
    let mut sums = Array2::<f64>::zeros((count, dims));
    let mut totals = vec![0f64; count];
    let mut cell_weight = vec![0f64; count];
    for (found, &weight) in state.matches.iter().zip(weights) {
        cell_weight[found.index as usize] += f64::from(weight);
    }
    for (row, found) in
        vectors.rows().into_iter().zip(&state.matches).zip(weights).map(|((r, m), &w)| ((r, w), m))
    {
        let (row, weight) = row;
        let index = found.index as usize;
        let weight = if cell_weight[index] > 0.0 { f64::from(weight) } else { 1.0 };
        totals[index] += weight;
        sums.row_mut(index).iter_mut().zip(row).for_each(|(sum, &value)| *sum += weight * f64::from(value));
    }
    let used: Vec<usize> = (0..count).filter(|&index| totals[index] > 0.0).collect();
    if used.len() == count {
        return Array2::from_shape_fn((count, dims), |(index, k)| (sums[[index, k]] / totals[index]) as f32);
    }
    // A codeword without vectors repeats the first used one: rows keep their numbers.
    let fallback = used.first().copied().unwrap_or(0);
    Array2::from_shape_fn((count, dims), |(index, k)| {
        let index = if totals[index] > 0.0 { index } else { fallback };
        (sums[[index, k]] / totals[index].max(f64::MIN_POSITIVE)) as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn blocks(count: usize, dims: usize, seed: u32) -> Array2<f32> {
        let value = |i: usize, j: usize| {
            let x = ((i as u32).wrapping_mul(2_654_435).wrapping_add(seed).wrapping_mul(747_796_405) >> 8)
                as f32
                / (1u32 << 24) as f32;
            ((x * 20.0 + j as f32 * 0.4).sin() * 0.5 + 0.5) * 0.8 + ((i * 31 + j * 17) % 13) as f32 * 0.015
        };
        Array2::from_shape_fn((count, dims), |(i, j)| value(i, j))
    }

    /// One round of the textbook algorithm from the same codewords: the oracle of assignment.
    fn naive_distortion(vectors: &Array2<f32>, weights: &[f32], codewords: &Array2<f32>) -> f64 {
        let distance = |a: ndarray::ArrayView1<'_, f32>, b: ndarray::ArrayView1<'_, f32>| -> f64 {
            a.iter().zip(b).map(|(x, y)| f64::from(x - y) * f64::from(x - y)).sum()
        };
        vectors
            .rows()
            .into_iter()
            .zip(weights)
            .map(|(row, &weight)| {
                let nearest =
                    codewords.rows().into_iter().map(|c| distance(row, c)).fold(f64::INFINITY, f64::min);
                nearest * f64::from(weight)
            })
            .sum()
    }

    #[test]
    fn distortion_never_rises_and_agrees_with_the_naive_search() {
        let vectors = blocks(600, 48, 5);
        let weights: Vec<f32> = (0..600).map(|i| 0.5 + (i % 7) as f32).collect();
        let built = build(vectors.view(), &weights, 40, Settings { rounds: 30, least_gain: 0.0, seed: 4 });
        assert!(
            built.history.windows(2).all(|pair| pair[1] <= pair[0] * (1.0 + 1e-6)),
            "{:?}",
            built.history
        );
        let last = *built.history.last().unwrap();
        let naive = naive_distortion(&vectors, &weights, &built.codewords);
        assert!(naive <= last * (1.0 + 1e-4), "{naive} {last}");
    }

    #[test]
    fn threads_do_not_change_the_result() {
        let vectors = blocks(3000, 12, 8);
        let weights = vec![1.0; 3000];
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| build(vectors.view(), &weights, 100, Settings::default()).codewords)
        };
        assert_eq!(with(1), with(3));
    }

    #[test]
    fn building_stops_when_it_is_told_to_and_is_the_same_when_it_is_not() {
        use std::sync::atomic::{AtomicUsize, Ordering};
        let vectors = blocks(3000, 12, 8);
        let weights = vec![1.0; 3000];
        let calls = AtomicUsize::new(0);
        let after = |limit: usize| {
            calls.store(0, Ordering::Relaxed);
            let stop = || calls.fetch_add(1, Ordering::Relaxed) >= limit;
            build_unless(vectors.view(), &weights, 100, Settings::default(), &stop)
        };
        let whole = after(usize::MAX).map(|built| built.codewords);
        assert_eq!(whole, Some(build(vectors.view(), &weights, 100, Settings::default()).codewords));
        let looks = calls.load(Ordering::Relaxed);
        // While seeds are drawn, in the first round and in the last one.
        for limit in [0, 50, 2000, looks - 1] {
            assert!(after(limit).is_none(), "{limit} of {looks}");
        }
    }

    #[test]
    fn fewer_distinct_vectors_than_codewords() {
        let vectors = Array2::from_shape_fn((50, 16), |(i, _)| (i % 3) as f32 * 0.25);
        let built = build(vectors.view(), &[1.0; 50], 20, Settings::default());
        assert_eq!(built.codewords.nrows(), 3);
        assert!(built.matches.iter().all(|m| m.distance < 1e-9));
    }

    #[test]
    fn weight_draws_codewords() {
        let vectors = blocks(400, 16, 2);
        let even = build(vectors.view(), &[1.0; 400], 10, Settings::default());
        let weights: Vec<f32> = (0..400).map(|i| if i < 100 { 20.0 } else { 1.0 }).collect();
        let uneven = build(vectors.view(), &weights, 10, Settings::default());
        let error = |built: &Codebook| built.matches[..100].iter().map(|m| m.distance).sum::<f32>();
        assert!(error(&uneven) < error(&even), "{} {}", error(&uneven), error(&even));
    }

    proptest! {
        #[test]
        fn any_weights_give_finite_codewords(
            values in proptest::collection::vec(0.0f32..1.0, 8 * 30),
            weights in proptest::collection::vec(0.0f32..2.0, 30),
            count in 1usize..40,
        ) {
            let vectors = Array2::from_shape_vec((30, 8), values).unwrap();
            let built = build(vectors.view(), &weights, count, Settings::default());
            prop_assert!(built.codewords.iter().all(|value| value.is_finite()));
            prop_assert!(built.matches.iter().all(|m| (m.index as usize) < built.codewords.nrows()));
        }
    }
}
