//! Factors from scattered observations: alternating least squares in which what no photograph shows is missing data.
//!
//! Around a vertex the observations (r, d, y) - sample, direction, colour - are fitted by
//! y = mean_r + sum_k g_rk h_k(d), with h_k a bilinear map over the directions. Each term alternates between its surface map
//! (a quotient a row) and its view map (a sparse system over the map's texels: neighbours of bilinear blending, and a
//! smoothness term that fills what no photograph shows); terms are found one after the other, then refined together.
//! All three channels run side by side. Maps without signs are the same with a floor of 0 under every quotient and every
//! texel: non-negative factors by hierarchical alternating least squares (Cichocki and Phan 2009).
//! O(observations x terms x sweeps).
//!
//! *Deviation* from the paper, which resamples every view of every triangle on the grid first and factors the full
//! matrix: with samples as close as these, neighbours see highlights from directions of their own, and the view map is
//! finer than the photographs' spacing.

use glam::Vec3A;

use super::ring::Ring;
use super::{Term, VertexMaps, multiplicative};
use crate::params::{Factors, LightParams, Updates};

/// Rounds of a term before the next is begun.
const ROUNDS: usize = 4;
/// Rounds over all terms in the end.
const REFINEMENTS: usize = 3;
/// Gauss-Seidel sweeps a view map: each starts from the last map, so few do.
const SWEEPS: usize = 8;
/// One photograph of so many is left out of the first fit, which chooses the number of terms.
const HELD_OUT: u16 = 5;
/// Observations below which each photograph is left out once: a highlight that few of them show may miss a fifth of them.
const FEW_OBSERVATIONS: usize = 6000;
/// Photographs around a vertex from which on some can be left out.
const ENOUGH_VIEWS: usize = 10;
/// Share of the error in photographs left out that a term must take away to be kept: less buys nothing that the eye sees.
const LEAST_GAIN: f64 = 0.002;
/// Mean square error that a term must take away as well: one step of 255. Photographs of diffuse objects differ by less, as pixels cover more
/// of the surface at an angle.
const LEAST_STEP: f64 = 1.0 / 65025.0;
/// Where the mean starts below which no term can reach: share of a sample's observations that are darker.
const DARKER_SHARE: f32 = 0.2;
/// Weight of the difference of two neighbouring texels of a view map, in mean weights of a texel's observations: less leaves noise and
/// holes, more blurs highlights.
const SMOOTHNESS: f32 = 0.005;
/// Weight of the ring's mean in a sample's surface map, in mean weights of a sample's observations: samples that few photographs
/// see take after their neighbours.
const SHARED: f32 = 0.05;

/// Where an observation lies in a view map of `grid` texels a side.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tap {
    /// The upper left of four texels.
    pub(super) low: u32,
    /// Weights of the four.
    pub(super) weights: [f32; 4],
    /// How much the observation counts.
    pub(super) weight: f32,
}

pub(super) struct Fit<'r> {
    ring: &'r Ring,
    grid: usize,
    /// The least value of a map.
    floor: Vec3A,
    taps: Vec<Tap>,
    /// Colours less all that is fitted.
    rest: Vec<Vec3A>,
    pub(super) mean: Vec<Vec3A>,
    /// Surface and view maps.
    pub(super) terms: Vec<(Vec<Vec3A>, Vec<Vec3A>)>,
}

/// The least value of a map.
pub(super) fn floor(params: &LightParams) -> f32 {
    match params.model.factors {
        Factors::Signed => f32::NEG_INFINITY,
        Factors::NonNegative => 0.0,
    }
}

/// Where all observations lie in view maps of `grid` texels a side; those of photographs that `counts` does not admit weigh nothing.
pub(super) fn taps(ring: &Ring, grid: u32, counts: impl Fn(u16) -> bool) -> Vec<Tap> {
    let mut taps = Vec::new();
    for (row, range) in ring.of_rows() {
        for observation in &ring.observations[range] {
            let at = observation.at * (grid - 1) as f32;
            let low = at.as_uvec2().min(glam::UVec2::splat(grid - 2));
            let part = at - low.as_vec2();
            let (left, upper) = (1.0 - part.x, 1.0 - part.y);
            taps.push(Tap {
                low: low.y * grid + low.x,
                weights: [left * upper, part.x * upper, left * part.y, part.x * part.y],
                weight: if counts(observation.view) { observation.weight * row.hat * row.hat } else { 0.0 },
            });
        }
    }
    taps
}

/// Fits the terms around one vertex.
pub(crate) fn fit(ring: &Ring, params: &LightParams) -> VertexMaps {
    let terms = if params.model.chosen { choose(ring, params) } else { params.terms };
    if params.model.updates == Updates::Multiplicative {
        return multiplicative::fit(ring, params, terms);
    }
    let mut fit = Fit::new(ring, params, |_| true);
    for term in 0..terms as usize {
        fit.begin(term);
        (0..ROUNDS).for_each(|_| fit.improve(term));
    }
    for _ in 0..if terms > 0 { REFINEMENTS } else { 0 } {
        (0..terms as usize).for_each(|term| fit.improve(term));
        fit.fit_mean();
    }
    fit.finish()
}

/// As many terms as photographs that the fit has not seen gain by; where there are too few to leave some out, one less than
/// there are photographs, which no larger rank could serve.
fn choose(ring: &Ring, params: &LightParams) -> u32 {
    let mut views: Vec<u16> = ring.observations.iter().map(|observation| observation.view).collect();
    views.sort_unstable();
    views.dedup();
    if views.len() < ENOUGH_VIEWS {
        return params.terms.min((views.len() as u32).saturating_sub(1));
    }
    let folds = if ring.observations.len() < FEW_OBSERVATIONS { HELD_OUT } else { 1 };
    let mut errors = vec![(0.0, 0.0); params.terms as usize + 1];
    for fold in 0..folds {
        // Neighbouring photographs often have neighbouring numbers: left out are those in every fifth place.
        let is_left_out = |view: &u16| {
            let place = views.binary_search(view).unwrap_or(0) as u16 % HELD_OUT;
            place == (fold + HELD_OUT / 2) % HELD_OUT
        };
        let mut fit = Fit::new(ring, params, |view| !is_left_out(&view));
        for (term, sums) in errors.iter_mut().enumerate() {
            if let Some(term) = term.checked_sub(1) {
                fit.begin(term);
                (0..ROUNDS).for_each(|_| fit.improve(term));
            }
            let (error, weight) = fit.error(is_left_out);
            *sums = (sums.0 + error, sums.1 + weight);
        }
    }
    let mut best = (0, f64::INFINITY);
    for (terms, (error, weight)) in (0..).zip(errors) {
        let error = error / weight.max(f64::MIN_POSITIVE);
        if terms == 0 || (error < best.1 * (1.0 - LEAST_GAIN) && error < best.1 - LEAST_STEP) {
            best = (terms, error);
        }
    }
    best.0
}

impl Fit<'_> {
    /// Takes a mean that is known already.
    pub(super) fn set_mean(&mut self, mean: &[Vec3A]) {
        for (row, (_, range)) in self.ring.of_rows().enumerate() {
            let step = mean[row] - self.mean[row];
            self.mean[row] = mean[row];
            self.rest[range].iter_mut().for_each(|rest| *rest -= step);
        }
    }

    /// Takes a term that is known already.
    pub(super) fn add_term(&mut self, surface: Vec<Vec3A>, view: &[Vec3A]) {
        self.terms.push((surface, view.to_vec()));
        self.subtract(self.terms.len() - 1, 1.0);
    }

    /// With a first mean, to the photographs that `counts` admits.
    pub(super) fn new<'r>(ring: &'r Ring, params: &LightParams, counts: impl Fn(u16) -> bool) -> Fit<'r> {
        let grid = params.grid;
        let mut fit = Fit {
            ring,
            grid: grid as usize,
            floor: Vec3A::splat(floor(params)),
            taps: taps(ring, grid, counts),
            rest: ring.observations.iter().map(|observation| observation.colour.into()).collect(),
            mean: vec![Vec3A::ZERO; ring.rows.len()],
            terms: Vec::new(),
        };
        if params.model.factors == Factors::NonNegative && params.terms > 0 {
            fit.begin_mean();
        } else {
            fit.fit_mean();
        }
        fit
    }

    /// A mean that most observations lie above, as terms can only add to it.
    fn begin_mean(&mut self) {
        for (index, (_, range)) in self.ring.of_rows().enumerate() {
            let mut values: [Vec<f32>; 3] = std::array::from_fn(|channel| {
                let counted = range.clone().filter(|&at| self.taps[at].weight > 0.0);
                counted.map(|at| self.rest[at][channel]).collect()
            });
            let low = values.each_mut().map(|values| {
                let at = (values.len() as f32 * DARKER_SHARE) as usize;
                values.get(at).copied().map_or(0.0, |_| *values.select_nth_unstable_by(at, f32::total_cmp).1)
            });
            let low = Vec3A::from(low);
            self.mean[index] = low;
            self.rest[range].iter_mut().for_each(|rest| *rest -= low);
        }
    }

    /// Sum of squares of what is left in the photographs that `counts` admits, and of their weights.
    fn error(&self, counts: impl Fn(&u16) -> bool) -> (f64, f64) {
        let (mut sum, mut weights) = (0.0, 0.0);
        for (row, range) in self.ring.of_rows() {
            for (rest, observation) in self.rest[range.clone()].iter().zip(&self.ring.observations[range]) {
                if counts(&observation.view) {
                    let weight = f64::from(observation.weight * row.hat * row.hat);
                    sum += f64::from(rest.length_squared()) * weight;
                    weights += 3.0 * weight;
                }
            }
        }
        (sum, weights)
    }

    /// Moves what all observations of a row have in common into the mean.
    pub(super) fn fit_mean(&mut self) {
        let (mut all, mut count) = (Vec3A::ZERO, 0.0);
        let mut unseen = Vec::new();
        let rest = &mut self.rest;
        for (index, (row, range)) in self.ring.of_rows().enumerate() {
            let (mut sum, mut weights) = (Vec3A::ZERO, 0.0);
            for at in range.clone() {
                sum += rest[at] * self.taps[at].weight;
                weights += self.taps[at].weight;
            }
            if weights <= 0.0 {
                unseen.push(index);
                continue;
            }
            let mean = (self.mean[index] + sum / weights).max(self.floor.max(-Vec3A::ONE));
            let step = mean - self.mean[index];
            self.mean[index] = mean;
            rest[range].iter_mut().for_each(|rest| *rest -= step);
            all += self.mean[index] * row.hat;
            count += row.hat;
        }
        let common = all / f32::max(count, f32::MIN_POSITIVE);
        for (index, (_, range)) in self.ring.of_rows().enumerate().filter(|(index, _)| unseen.contains(index))
        {
            let step = common - self.mean[index];
            self.mean[index] = common;
            rest[range].iter_mut().for_each(|rest| *rest -= step);
        }
    }

    /// A new term: the same for all samples, then those that change along the ring, then any.
    fn begin(&mut self, term: usize) {
        let start = |(index, row): (usize, &super::ring::Row)| match term {
            0 => 1.0,
            1 => row.place.x,
            2 => row.place.y,
            // Bits of a multiplicative hash: a pattern that no ring follows.
            _ => ((index * term).wrapping_mul(0x9e37_79b9) >> 7 & 0xff) as f32 / 127.5 - 1.0,
        };
        let lowest = self.floor;
        // Patterns of both signs, moved to where none is below 0 where that is asked for.
        let from = |value: f32| if lowest.x < 0.0 { value } else { 0.5 + 0.5 * value };
        let surface =
            self.ring.rows.iter().enumerate().map(start).map(|value| Vec3A::splat(from(value))).collect();
        self.terms.push((surface, vec![Vec3A::ZERO; self.grid * self.grid]));
        self.solve_view(term);
        self.subtract(term, 1.0);
    }

    /// One round of a term.
    fn improve(&mut self, term: usize) {
        self.subtract(term, -1.0);
        self.solve_surface(term);
        self.solve_view(term);
        self.subtract(term, 1.0);
    }

    fn value(&self, view: &[Vec3A], tap: &Tap) -> Vec3A {
        let low = tap.low as usize;
        view[low] * tap.weights[0]
            + view[low + 1] * tap.weights[1]
            + view[low + self.grid] * tap.weights[2]
            + view[low + self.grid + 1] * tap.weights[3]
    }

    /// Takes `sign` times the term out of the rest.
    pub(super) fn subtract(&mut self, term: usize, sign: f32) {
        let mut rest = std::mem::take(&mut self.rest);
        let (surface, view) = &self.terms[term];
        for ((_, range), &surface) in self.ring.of_rows().zip(surface) {
            for at in range {
                rest[at] -= self.value(view, &self.taps[at]) * surface * sign;
            }
        }
        self.rest = rest;
    }

    /// The best surface map for the view map.
    pub(super) fn best_surface(&self, term: usize) -> Vec<Vec3A> {
        let (_, view) = &self.terms[term];
        let (mut products, mut squares) = (Vec::new(), Vec::new());
        for (_, range) in self.ring.of_rows() {
            let (mut product, mut square) = (Vec3A::ZERO, Vec3A::ZERO);
            for at in range {
                let value = self.value(view, &self.taps[at]);
                product += value * self.rest[at] * self.taps[at].weight;
                square += value * value * self.taps[at].weight;
            }
            products.push(product);
            squares.push(square);
        }
        let product: Vec3A = products.iter().sum();
        let square: Vec3A = squares.iter().sum();
        let common = product / square.max(Vec3A::splat(f32::MIN_POSITIVE));
        let shared = square / squares.len().max(1) as f32 * SHARED + f32::MIN_POSITIVE;
        let surface = products.iter().zip(&squares);
        let floor = self.floor;
        let value = |(&p, &s): (&Vec3A, &Vec3A)| ((p + common * shared) / (s + shared)).max(floor);
        surface.map(value).collect()
    }

    /// Replaces a surface map by the best one.
    fn solve_surface(&mut self, term: usize) {
        let surface = self.best_surface(term);
        // In units of its mean square, so that smoothness weighs the same whatever the term's size.
        let energy = surface.iter().map(|&value| value * value).sum::<Vec3A>() / surface.len().max(1) as f32;
        let scale = energy.max(Vec3A::splat(f32::MIN_POSITIVE)).powf(-0.5);
        self.terms[term].0 =
            surface.into_iter().map(|value| (value * scale).min(Vec3A::splat(1e6))).collect();
        let unscale = scale.recip();
        self.terms[term].1.iter_mut().for_each(|value| *value *= unscale);
    }

    /// The best view map for the surface map.
    fn solve_view(&mut self, term: usize) {
        let mut system = System::new(self.grid);
        self.add_to(&mut system, term);
        system.smooth();
        let view = &mut self.terms[term].1;
        let floor = self.floor;
        (0..SWEEPS).for_each(|_| system.sweep(view, floor));
    }

    /// Adds what a term's view map should be to a system.
    pub(super) fn add_to(&self, system: &mut System, term: usize) {
        let (surface, _) = &self.terms[term];
        for ((_, range), &surface) in self.ring.of_rows().zip(surface) {
            let square = surface * surface;
            for at in range {
                let tap = &self.taps[at];
                system.add(tap, square * tap.weight, surface * self.rest[at] * tap.weight);
            }
        }
    }

    /// The maps with the hat function in the surface maps.
    pub(super) fn finish(self) -> VertexMaps {
        let rows = &self.ring.rows;
        let with_hats = |values: &[Vec3A]| -> Vec<glam::Vec3> {
            rows.iter().zip(values).map(|(row, &value)| (value * row.hat).into()).collect()
        };
        VertexMaps {
            rows: rows.iter().map(|row| row.sample).collect(),
            mean: with_hats(&self.mean),
            terms: self
                .terms
                .iter()
                .map(|(surface, view)| Term {
                    surface: with_hats(surface),
                    view: view.iter().map(|&value| value.into()).collect(),
                })
                .collect(),
        }
    }
}

/// The normal equations of a view map: a symmetric matrix with the eight neighbours of each texel.
pub(super) struct System {
    grid: usize,
    /// Each texel with itself, and with those right, lower left, below and lower right.
    matrix: Vec<[Vec3A; 5]>,
    right: Vec<Vec3A>,
}

impl System {
    pub(super) fn new(grid: usize) -> System {
        let texels = grid * grid;
        System { grid, matrix: vec![[Vec3A::ZERO; 5]; texels], right: vec![Vec3A::ZERO; texels] }
    }

    fn add(&mut self, tap: &Tap, square: Vec3A, product: Vec3A) {
        let low = tap.low as usize;
        let [a, b, c, d] = tap.weights;
        let (square_a, square_b) = (square * a, square * b);
        let first = &mut self.matrix[low];
        first[0] += square_a * a;
        first[1] += square_a * b;
        first[3] += square_a * c;
        first[4] += square_a * d;
        let second = &mut self.matrix[low + 1];
        second[0] += square_b * b;
        second[2] += square_b * c;
        second[3] += square_b * d;
        let square_c = square * c;
        let third = &mut self.matrix[low + self.grid];
        third[0] += square_c * c;
        third[1] += square_c * d;
        self.matrix[low + self.grid + 1][0] += square * (d * d);
        for (at, weight) in [(low, a), (low + 1, b), (low + self.grid, c), (low + self.grid + 1, d)] {
            self.right[at] += product * weight;
        }
    }

    /// Adds the weight of differences between neighbours.
    pub(super) fn smooth(&mut self) {
        let total: Vec3A = self.matrix.iter().map(|row| row[0]).sum();
        let weight = total / self.matrix.len() as f32 * SMOOTHNESS + f32::MIN_POSITIVE;
        for at in 0..self.matrix.len() {
            for (step, entry, exists) in
                [(1, 1, at % self.grid + 1 < self.grid), (self.grid, 3, at + self.grid < self.matrix.len())]
            {
                if exists {
                    self.matrix[at][0] += weight;
                    self.matrix[at + step][0] += weight;
                    self.matrix[at][entry] -= weight;
                }
            }
        }
    }

    /// One Gauss-Seidel sweep.
    pub(super) fn sweep(&self, view: &mut [Vec3A], floor: Vec3A) {
        let grid = self.grid;
        for at in 0..view.len() {
            let (x, y) = (at % grid, at / grid);
            let mut sum = self.right[at];
            let own = &self.matrix[at];
            if x + 1 < grid {
                sum -= own[1] * view[at + 1];
            }
            if x > 0 {
                sum -= self.matrix[at - 1][1] * view[at - 1];
            }
            if y + 1 < grid {
                sum -= own[3] * view[at + grid];
                if x > 0 {
                    sum -= own[2] * view[at + grid - 1];
                }
                if x + 1 < grid {
                    sum -= own[4] * view[at + grid + 1];
                }
            }
            if y > 0 {
                sum -= self.matrix[at - grid][3] * view[at - grid];
                if x + 1 < grid {
                    sum -= self.matrix[at - grid + 1][2] * view[at - grid + 1];
                }
                if x > 0 {
                    sum -= self.matrix[at - grid - 1][4] * view[at - grid - 1];
                }
            }
            view[at] = (sum / own[0].max(Vec3A::splat(f32::MIN_POSITIVE))).max(floor);
        }
    }
}
