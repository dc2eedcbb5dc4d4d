//! Factors without signs by multiplicative updates (Lee and Seung 1999; paper, appendix), with missing data.
//!
//! Every value of the mean, the surface maps and the view maps is multiplied by the quotient of what the observations and what the model
//! put there, all terms at a time; none of these updates raises the squared error. Texels of view maps that no observation reaches take
//! after their neighbours. O(observations x terms x rounds).
//!
//! *Deviation*: the mean is a term whose view map is 1. Slower than alternating least squares, for about the same result: beside it to compare
//! with.

use glam::Vec3A;
use texfold_core::CancelCheck;

use super::maps::{TermFit, VertexMaps};
use super::pattern::pattern;
use super::ring::Ring;
use super::taps::{Tap, taps};
use crate::params::LightParams;

/// Rounds over all factors: twice as many take away another hundredth of the error.
const ROUNDS: usize = 80;
/// Keeps quotients finite; far below any weight times a colour.
const LEAST: f32 = 1e-12;
/// Share of the mean that terms start from.
const TERM_SHARE: f32 = 0.3;

struct Factored<'r> {
    ring: &'r Ring,
    grid: usize,
    taps: Vec<Tap>,
    mean: Vec<Vec3A>,
    terms: Vec<TermFit>,
    /// The model's value of each observation.
    decoded: Vec<Vec3A>,
}

/// Fits `terms` terms around one vertex.
pub(super) fn fit(ring: &Ring, params: &LightParams, terms: u32, cancel: CancelCheck<'_>) -> VertexMaps {
    let mut factored = Factored::new(ring, params, terms as usize);
    for _ in 0..if terms > 0 { ROUNDS } else { 1 } {
        factored.reconstruct();
        factored.improve_mean();
        for term in 0..terms as usize {
            if cancel.is_cancelled() {
                return factored.finish();
            }
            factored.reconstruct();
            factored.improve_surface(term);
            factored.reconstruct();
            factored.improve_view(term);
        }
    }
    factored.finish()
}

impl Factored<'_> {
    fn new<'r>(ring: &'r Ring, params: &LightParams, terms: usize) -> Factored<'r> {
        let texels = (params.maps.grid * params.maps.grid) as usize;
        let (rows, share) = (ring.rows.len(), if terms > 0 { 1.0 - TERM_SHARE } else { 1.0 });
        let mut all = (Vec3A::ZERO, 0.0);
        for observation in &ring.observations {
            all = (all.0 + Vec3A::from(observation.colour) * observation.weight, all.1 + observation.weight);
        }
        let colour = all.0 / f32::max(all.1, LEAST);
        // Patterns that no two terms share: alike ones would stay alike.
        let start = |term: usize, count: usize, value: Vec3A| -> Vec<Vec3A> {
            (0..count).map(|at| value * (0.5 + pattern((at + 1) * (2 * term + 3)))).collect()
        };
        let of_term = colour * (TERM_SHARE / terms.max(1) as f32) + LEAST.sqrt();
        Factored {
            ring,
            grid: params.maps.grid as usize,
            taps: taps(ring, params.maps.grid, |_| true),
            mean: vec![colour * share; rows],
            terms: (0..terms)
                .map(|term| TermFit {
                    surface: start(term, rows, Vec3A::ONE),
                    view: start(term + terms, texels, of_term),
                })
                .collect(),
            decoded: vec![Vec3A::ZERO; ring.observations.len()],
        }
    }

    fn seen(&self, term: usize, tap: &Tap) -> Vec3A {
        tap.read(&self.terms[term].view, self.grid)
    }

    fn reconstruct(&mut self) {
        let mut decoded = std::mem::take(&mut self.decoded);
        for (row, (_, range)) in self.ring.of_rows().enumerate() {
            for at in range {
                let terms = (0..self.terms.len())
                    .map(|term| self.terms[term].surface[row] * self.seen(term, &self.taps[at]));
                decoded[at] = self.mean[row] + terms.sum::<Vec3A>();
            }
        }
        self.decoded = decoded;
    }

    /// What the observations and what the model put into one value of each row, by `factor`.
    fn quotients(&self, factor: impl Fn(&Tap) -> Vec3A) -> Vec<Vec3A> {
        let quotient = |range: std::ops::Range<usize>| {
            let (mut wanted, mut found) = (Vec3A::ZERO, Vec3A::ZERO);
            for at in range {
                let weighted = factor(&self.taps[at]) * self.taps[at].weight;
                wanted += weighted * Vec3A::from(self.ring.observations[at].colour);
                found += weighted * self.decoded[at];
            }
            (wanted + LEAST) / (found + LEAST)
        };
        self.ring.of_rows().map(|(_, range)| quotient(range)).collect()
    }

    fn improve_mean(&mut self) {
        let quotients = self.quotients(|_| Vec3A::ONE);
        self.mean.iter_mut().zip(quotients).for_each(|(mean, quotient)| *mean *= quotient);
    }

    fn improve_surface(&mut self, term: usize) {
        let quotients = self.quotients(|tap| self.seen(term, tap));
        self.terms[term].surface.iter_mut().zip(quotients).for_each(|(value, quotient)| *value *= quotient);
    }

    fn improve_view(&mut self, term: usize) {
        let (grid, texels) = (self.grid, self.grid * self.grid);
        let (mut wanted, mut found) = (vec![Vec3A::ZERO; texels], vec![Vec3A::ZERO; texels]);
        let mut reached = vec![0f32; texels];
        for ((_, range), &surface) in self.ring.of_rows().zip(&self.terms[term].surface) {
            for at in range {
                let tap = &self.taps[at];
                let weighted = surface * tap.weight;
                let colour = weighted * Vec3A::from(self.ring.observations[at].colour);
                let decoded = weighted * self.decoded[at];
                for (step, weight) in [0, 1, grid, grid + 1].into_iter().zip(tap.weights) {
                    let texel = tap.low as usize + step;
                    wanted[texel] += colour * weight;
                    found[texel] += decoded * weight;
                    reached[texel] += tap.weight * weight;
                }
            }
        }
        let view = &mut self.terms[term].view;
        for texel in 0..texels {
            if reached[texel] > 0.0 {
                view[texel] *= (wanted[texel] + LEAST) / (found[texel] + LEAST);
                continue;
            }
            let (x, y) = (texel % grid, texel / grid);
            let around = [
                (x > 0).then(|| texel - 1),
                (x + 1 < grid).then_some(texel + 1),
                (y > 0).then(|| texel - grid),
                (y + 1 < grid).then_some(texel + grid),
            ];
            let values = around.into_iter().flatten().map(|at| view[at]);
            view[texel] = values.clone().sum::<Vec3A>() / values.count() as f32;
        }
    }

    fn finish(self) -> VertexMaps {
        VertexMaps::new(self.ring, &self.mean, &self.terms)
    }
}
