//! Factors without signs by multiplicative updates (Lee and Seung 1999; paper, appendix), with missing data.
//!
//! Every value of the mean, the surface maps and the view maps is multiplied by the quotient of what the observations and what the model
//! put there, all terms at a time; none of these updates raises the squared error. Texels of view maps that no observation reaches take
//! after their neighbours. O(observations x terms x rounds).
//!
//! *Deviation*: the mean is a term whose view map is 1. Slower than alternating least squares, for about the same result: beside it to compare
//! with.

use glam::Vec3A;

use super::als::{Tap, taps};
use super::ring::Ring;
use super::{Term, VertexMaps};
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
    surface: Vec<Vec<Vec3A>>,
    view: Vec<Vec<Vec3A>>,
    /// The model's value of each observation.
    shown: Vec<Vec3A>,
}

/// Fits `terms` terms around one vertex.
pub(crate) fn fit(ring: &Ring, params: &LightParams, terms: u32) -> VertexMaps {
    let mut factored = Factored::new(ring, params, terms as usize);
    for _ in 0..if terms > 0 { ROUNDS } else { 1 } {
        factored.show();
        factored.improve_mean();
        for term in 0..terms as usize {
            factored.show();
            factored.improve_surface(term);
            factored.show();
            factored.improve_view(term);
        }
    }
    factored.finish()
}

impl Factored<'_> {
    fn new<'r>(ring: &'r Ring, params: &LightParams, terms: usize) -> Factored<'r> {
        let texels = (params.grid * params.grid) as usize;
        let (rows, share) = (ring.rows.len(), if terms > 0 { 1.0 - TERM_SHARE } else { 1.0 });
        let mut all = (Vec3A::ZERO, 0.0);
        for observation in &ring.observations {
            all = (all.0 + Vec3A::from(observation.colour) * observation.weight, all.1 + observation.weight);
        }
        let colour = all.0 / f32::max(all.1, LEAST);
        // Patterns that no two terms share: alike ones would stay alike.
        let pattern = |term: usize, at: usize| {
            let hash = ((at + 1) * (2 * term + 3)).wrapping_mul(0x9e37_79b9) >> 7 & 0xff;
            0.5 + hash as f32 / 255.0
        };
        let start = |term, count, value: Vec3A| {
            (0..count).map(|at| value * pattern(term, at)).collect::<Vec<Vec3A>>()
        };
        let of_term = colour * (TERM_SHARE / terms.max(1) as f32) + LEAST.sqrt();
        Factored {
            ring,
            grid: params.grid as usize,
            taps: taps(ring, params.grid, |_| true),
            mean: vec![colour * share; rows],
            surface: (0..terms).map(|term| start(term, rows, Vec3A::ONE)).collect(),
            view: (0..terms).map(|term| start(term + terms, texels, of_term)).collect(),
            shown: vec![Vec3A::ZERO; ring.observations.len()],
        }
    }

    fn seen(&self, term: usize, tap: &Tap) -> Vec3A {
        let (view, low) = (&self.view[term], tap.low as usize);
        view[low] * tap.weights[0]
            + view[low + 1] * tap.weights[1]
            + view[low + self.grid] * tap.weights[2]
            + view[low + self.grid + 1] * tap.weights[3]
    }

    fn show(&mut self) {
        let mut shown = std::mem::take(&mut self.shown);
        for (row, (_, range)) in self.ring.of_rows().enumerate() {
            for at in range {
                let terms = (0..self.view.len())
                    .map(|term| self.surface[term][row] * self.seen(term, &self.taps[at]));
                shown[at] = self.mean[row] + terms.sum::<Vec3A>();
            }
        }
        self.shown = shown;
    }

    /// What the observations and what the model put into one value of each row, by `factor`.
    fn quotients(&self, factor: impl Fn(&Tap) -> Vec3A) -> Vec<Vec3A> {
        let quotient = |range: std::ops::Range<usize>| {
            let (mut wanted, mut found) = (Vec3A::ZERO, Vec3A::ZERO);
            for at in range {
                let weighted = factor(&self.taps[at]) * self.taps[at].weight;
                wanted += weighted * Vec3A::from(self.ring.observations[at].colour);
                found += weighted * self.shown[at];
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
        self.surface[term].iter_mut().zip(quotients).for_each(|(value, quotient)| *value *= quotient);
    }

    fn improve_view(&mut self, term: usize) {
        let (grid, texels) = (self.grid, self.grid * self.grid);
        let (mut wanted, mut found) = (vec![Vec3A::ZERO; texels], vec![Vec3A::ZERO; texels]);
        let mut reached = vec![0f32; texels];
        for ((_, range), &surface) in self.ring.of_rows().zip(&self.surface[term]) {
            for at in range {
                let tap = &self.taps[at];
                let weighted = surface * tap.weight;
                let colour = weighted * Vec3A::from(self.ring.observations[at].colour);
                let shown = weighted * self.shown[at];
                for (step, weight) in [0, 1, grid, grid + 1].into_iter().zip(tap.weights) {
                    let texel = tap.low as usize + step;
                    wanted[texel] += colour * weight;
                    found[texel] += shown * weight;
                    reached[texel] += tap.weight * weight;
                }
            }
        }
        let view = &mut self.view[term];
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

    /// The maps with the hat function in the surface maps.
    fn finish(self) -> VertexMaps {
        let rows = &self.ring.rows;
        let with_hats = |values: &[Vec3A]| -> Vec<glam::Vec3> {
            rows.iter().zip(values).map(|(row, &value)| (value * row.hat).into()).collect()
        };
        let terms = self.surface.iter().zip(&self.view);
        let term = |(surface, view): (&Vec<Vec3A>, &Vec<Vec3A>)| Term {
            surface: with_hats(surface),
            view: view.iter().map(|&value| value.into()).collect(),
        };
        VertexMaps {
            rows: rows.iter().map(|row| row.sample).collect(),
            mean: with_hats(&self.mean),
            terms: terms.map(term).collect(),
        }
    }
}
