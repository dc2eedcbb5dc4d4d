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
use texfold_core::CancelCheck;

use super::maps::{TermFit, VertexMaps};
use super::pattern::pattern;
use super::ring::{Ring, Row};
use super::system::System;
use super::taps::{Tap, taps};
use crate::kinds::Factors;
use crate::params::LightParams;

/// Rounds of a term before the next is begun.
const ROUNDS: usize = 4;
/// Rounds over all terms in the end.
const REFINEMENTS: usize = 3;
/// Gauss-Seidel sweeps a view map: each starts from the last map, so few do.
const SWEEPS: usize = 8;
/// The largest value of a surface map in units of its root mean square. A map of which a single sample is not 0 comes to the root of its
/// number of samples, at most 110 around a vertex of six patches of 64; numbers beyond are those of channels that are 0 but for
/// rounding, and would overflow where they are squared.
const LARGEST_SURFACE: f32 = 1e6;
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
/// Weight of the ring's mean in a sample's surface map, in mean weights of a sample's observations: samples that few photographs
/// see take after their neighbours.
const SHARED: f32 = 0.05;

/// The maps of one vertex while they are fitted.
pub(super) struct VertexFit<'r> {
    ring: &'r Ring,
    /// Rounds do nothing once the job is cancelled: what they would find is thrown away.
    cancel: CancelCheck<'r>,
    grid: usize,
    /// The least value of a map.
    floor: Vec3A,
    taps: Vec<Tap>,
    /// Colours less all that is fitted.
    rest: Vec<Vec3A>,
    pub(super) mean: Vec<Vec3A>,
    pub(super) terms: Vec<TermFit>,
}

/// Error in photographs that a fit has not seen.
#[derive(Debug, Clone, Copy, Default)]
struct HeldOut {
    /// Weighted sum of squared errors, all channels.
    squares: f64,
    /// Sum of the weights.
    weights: f64,
}

/// The least value of a map.
pub(super) fn floor(params: &LightParams) -> f32 {
    match params.model.factors {
        Factors::Signed => f32::NEG_INFINITY,
        Factors::NonNegative => 0.0,
    }
}

/// Fits `terms` terms around one vertex.
pub(super) fn fit(ring: &Ring, params: &LightParams, terms: u32, cancel: CancelCheck<'_>) -> VertexMaps {
    let mut fit = VertexFit::new(ring, params, cancel, |_| true);
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
pub(super) fn choose(ring: &Ring, params: &LightParams, cancel: CancelCheck<'_>) -> u32 {
    let mut views: Vec<u16> = ring.observations.iter().map(|observation| observation.view).collect();
    views.sort_unstable();
    views.dedup();
    if views.len() < ENOUGH_VIEWS {
        return params.terms.min((views.len() as u32).saturating_sub(1));
    }
    let folds = if ring.observations.len() < FEW_OBSERVATIONS { HELD_OUT } else { 1 };
    let mut errors = vec![HeldOut::default(); params.terms as usize + 1];
    for fold in 0..folds {
        // Neighbouring photographs often have neighbouring numbers: left out are those in every fifth place.
        let is_left_out = |view: &u16| {
            let place = views.binary_search(view).unwrap_or(0) as u16 % HELD_OUT;
            place == (fold + HELD_OUT / 2) % HELD_OUT
        };
        let mut fit = VertexFit::new(ring, params, cancel, |view| !is_left_out(&view));
        for (term, sums) in errors.iter_mut().enumerate() {
            if let Some(term) = term.checked_sub(1) {
                fit.begin(term);
                (0..ROUNDS).for_each(|_| fit.improve(term));
            }
            let found = fit.error(is_left_out);
            *sums = HeldOut { squares: sums.squares + found.squares, weights: sums.weights + found.weights };
        }
    }
    let mut best = (0, f64::INFINITY);
    for (terms, HeldOut { squares, weights }) in (0..).zip(errors) {
        let error = squares / weights.max(f64::MIN_POSITIVE);
        if terms == 0 || (error < best.1 * (1.0 - LEAST_GAIN) && error < best.1 - LEAST_STEP) {
            best = (terms, error);
        }
    }
    best.0
}

impl VertexFit<'_> {
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
        self.terms.push(TermFit { surface, view: view.to_vec() });
        self.subtract(self.terms.len() - 1, 1.0);
    }

    /// With a first mean, to the photographs that `counts` admits.
    pub(super) fn new<'r>(
        ring: &'r Ring,
        params: &LightParams,
        cancel: CancelCheck<'r>,
        counts: impl Fn(u16) -> bool,
    ) -> VertexFit<'r> {
        let grid = params.maps.grid;
        let mut fit = VertexFit {
            ring,
            cancel,
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
    fn error(&self, counts: impl Fn(&u16) -> bool) -> HeldOut {
        let mut found = HeldOut::default();
        for (row, range) in self.ring.of_rows() {
            for (rest, observation) in self.rest[range.clone()].iter().zip(&self.ring.observations[range]) {
                if counts(&observation.view) {
                    let weight = f64::from(observation.weight * row.hat * row.hat);
                    found.squares += f64::from(rest.length_squared()) * weight;
                    found.weights += 3.0 * weight;
                }
            }
        }
        found
    }

    /// Moves what all observations of a row have in common into the mean.
    pub(super) fn fit_mean(&mut self) {
        if self.cancel.is_cancelled() {
            return;
        }
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
        if self.cancel.is_cancelled() {
            return;
        }
        let start = |(index, row): (usize, &Row)| match term {
            0 => 1.0,
            1 => row.place.x,
            2 => row.place.y,
            _ => pattern(index * term) * 2.0 - 1.0,
        };
        let lowest = self.floor;
        // Patterns of both signs, moved to where none is below 0 where that is requested.
        let from = |value: f32| if lowest.x < 0.0 { value } else { 0.5 + 0.5 * value };
        let surface =
            self.ring.rows.iter().enumerate().map(start).map(|value| Vec3A::splat(from(value))).collect();
        self.terms.push(TermFit { surface, view: vec![Vec3A::ZERO; self.grid * self.grid] });
        self.solve_view(term);
        self.subtract(term, 1.0);
    }

    /// One round of a term.
    fn improve(&mut self, term: usize) {
        if self.cancel.is_cancelled() || term >= self.terms.len() {
            return;
        }
        self.subtract(term, -1.0);
        self.solve_surface(term);
        self.solve_view(term);
        self.subtract(term, 1.0);
    }

    /// Takes `sign` times the term out of the rest.
    pub(super) fn subtract(&mut self, term: usize, sign: f32) {
        let mut rest = std::mem::take(&mut self.rest);
        let TermFit { surface, view } = &self.terms[term];
        for ((_, range), &surface) in self.ring.of_rows().zip(surface) {
            for at in range {
                rest[at] -= self.taps[at].read(view, self.grid) * surface * sign;
            }
        }
        self.rest = rest;
    }

    /// The best surface map for the view map.
    pub(super) fn best_surface(&self, term: usize) -> Vec<Vec3A> {
        let view = &self.terms[term].view;
        let (mut products, mut squares) = (Vec::new(), Vec::new());
        for (_, range) in self.ring.of_rows() {
            let (mut product, mut square) = (Vec3A::ZERO, Vec3A::ZERO);
            for at in range {
                let value = self.taps[at].read(view, self.grid);
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
        self.terms[term].surface =
            surface.into_iter().map(|value| (value * scale).min(Vec3A::splat(LARGEST_SURFACE))).collect();
        let unscale = scale.recip();
        self.terms[term].view.iter_mut().for_each(|value| *value *= unscale);
    }

    /// The best view map for the surface map.
    fn solve_view(&mut self, term: usize) {
        let mut system = System::new(self.grid);
        self.add_to(&mut system, term);
        system.smooth();
        let view = &mut self.terms[term].view;
        let floor = self.floor;
        (0..SWEEPS).for_each(|_| system.sweep(view, floor));
    }

    /// Adds what a term's view map should be to a system.
    pub(super) fn add_to(&self, system: &mut System, term: usize) {
        let surface = &self.terms[term].surface;
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
        VertexMaps::new(self.ring, &self.mean, &self.terms)
    }
}
