//! Magnitudes of a block's coefficients with the least squared error + lambda x bits, by the Viterbi algorithm.
//!
//! Source: Schwarz and others, "Hybrid video coding with trellis-coded quantization", 2019. A path goes through the states of dependent
//! quantisation in the order of coding, from the block's last coefficient to its first. Each path keeps its own magnitudes, so the
//! bits of a symbol are those of its context. Errors are in squared steps, in which all coefficients count alike.
//! *Not done*: bits of the blocks to the right and below, whose contexts change, too.

use super::forward::Block;
use super::symbols::{Levels, SymbolBits, end_symbol, escaped_bits, magnitude_bits, magnitude_symbol};
use crate::context::{
    FIRST_END, FIRST_LAST, LEVELS, NEXT_STATES, Neighbours, SET_TABLES, STATES, State, first_table, held,
};
use crate::form::Steps;
use crate::plane::PREDICTED;
use crate::scan::{COEFFICIENTS, PADDED_SIDE, SCAN};
use crate::tables::SYMBOLS;
use crate::vectors::vectorised;

/// Largest magnitude: what escaped values can say, and what 16-bit samples reach at the finest step.
const MAX_MAGNITUDE: f32 = 16_000_000.0;
/// Largest value that cannot be a block's last coefficient, in steps.
const NEVER_LAST: f32 = 0.5;
/// States of one parity.
const HALF: usize = STATES / 2;
/// Magnitudes that are tried in a state.
const TRIED: usize = 3;

/// What quantises the blocks of an axis of a plane.
pub(super) struct Quantising<'a> {
    pub steps: &'a Steps,
    /// Reconstruction offsets in steps.
    pub offsets: [f32; 2],
    /// First coefficient that is coded: 1 where the mean comes from a base.
    pub first: usize,
    /// Squared steps that a bit is worth.
    pub lambda: f32,
    pub symbol_bits: &'a SymbolBits,
    /// Set of tables of the axis.
    pub set: usize,
}

/// What is left of a block's coefficients beyond what is predicted of them.
#[inline(always)]
pub(super) fn residuals_of(block: &Block, predicted: Option<[i32; 6]>) -> Block {
    let mut residuals = *block;
    if let Some(predicted) = predicted {
        PREDICTED.iter().zip(predicted).for_each(|(&at, value)| residuals[at] -= value as f32);
    }
    residuals
}

/// Absolute coefficients in steps, in coding order.
type Values = [f32; COEFFICIENTS];

/// A path's magnitudes in coding order, of which those from the last coefficient on are there; the last place stays zero.
type Magnitudes = [u8; HELD];
const HELD: usize = 128;
/// Magnitudes behind a coefficient's own that contexts still look at: less than three diagonals.
const LOOKED_AT: usize = 32;

/// The least costs of the paths that end in each state, and their magnitudes as contexts see them.
#[derive(Debug)]
struct Paths {
    costs: [f32; STATES],
    magnitudes: [Magnitudes; STATES],
}

/// What quantising a block fills, kept from block to block.
#[derive(Debug)]
pub(super) struct Trellis {
    /// Paths up to a coefficient, and up to the one before it: by turns, so that none is copied.
    paths: [Paths; 2],
    /// The ways into each state, for all coefficients of the block from its last one on.
    ways: [[Way; STATES]; COEFFICIENTS],
}

impl Default for Trellis {
    fn default() -> Self {
        let paths = || Paths { costs: [f32::INFINITY; STATES], magnitudes: [[0; HELD]; STATES] };
        Trellis { paths: [paths(), paths()], ways: [[Way::default(); STATES]; COEFFICIENTS] }
    }
}

impl Trellis {
    /// Sets the magnitudes of all paths by their ways.
    #[inline(always)]
    fn keep(&mut self, number: usize) {
        let ways = &self.ways[number];
        let [even, odd] = &mut self.paths;
        let (paths, before) = if number.is_multiple_of(2) { (even, &*odd) } else { (odd, &*even) };
        for (own, way) in paths.magnitudes.iter_mut().zip(ways) {
            let from = before.magnitudes.get(way.from()).unwrap_or(&[0; HELD]);
            own[number + 1..][..LOOKED_AT].copy_from_slice(&from[number + 1..][..LOOKED_AT]);
            own[number] = held(way.magnitude());
        }
    }

    /// The magnitudes of the best path down to the coefficient `first`; none where all paths cost more than `nothing`.
    fn traced(&self, first: usize, nothing: f32) -> [u32; COEFFICIENTS] {
        let (mut least, mut state) = (nothing, STATES);
        for (number, &cost) in self.paths[first % 2].costs.iter().enumerate() {
            if cost < least {
                (least, state) = (cost, number);
            }
        }
        let mut magnitudes = [0; COEFFICIENTS];
        for (magnitude, ways) in magnitudes.iter_mut().zip(&self.ways).skip(first) {
            let Some(way) = ways.get(state) else { break };
            *magnitude = way.magnitude();
            state = way.from();
        }
        magnitudes
    }
}

/// A path's way into a state: the state before, [`STATES`] where the path begins here, in the four highest bits; the magnitude below.
#[derive(Debug, Clone, Copy, Default)]
struct Way(u32);

impl Way {
    fn new(from: usize, magnitude: u32) -> Way {
        Way((from as u32) << 28 | magnitude)
    }

    fn from(self) -> usize {
        (self.0 >> 28) as usize
    }

    fn magnitude(self) -> u32 {
        self.0 & 0x0fff_ffff
    }
}

/// The one of lower cost, as a cost and a way; without a branch, as which one that is cannot be foretold.
#[inline(always)]
fn lesser(one: (f32, Way), other: (f32, Way)) -> (f32, Way) {
    let is_less = other.0 < one.0;
    (if is_less { other.0 } else { one.0 }, if is_less { other.1 } else { one.1 })
}

/// The states before each state, with an even and with an odd magnitude.
static BEFORE: [[usize; 2]; STATES] = states_before();

const fn states_before() -> [[usize; 2]; STATES] {
    let mut all = [[0; 2]; STATES];
    let mut state = 0;
    while state < 2 * STATES {
        let (from, parity) = (state / 2, state % 2);
        all[(NEXT_STATES[parity] >> (4 * from) & 7) as usize][parity] = from;
        state += 1;
    }
    all
}

/// For each coefficient in coding order, the five that its context looks at; the last place where there is none.
static TEMPLATES: [[u8; 5]; COEFFICIENTS] = templates();

const fn templates() -> [[u8; 5]; COEFFICIENTS] {
    let mut all = [[HELD as u8 - 1; 5]; COEFFICIENTS];
    let beyond = [1, 2, PADDED_SIDE, 2 * PADDED_SIDE, PADDED_SIDE + 1];
    let (mut number, mut other) = (0, 0);
    while number < COEFFICIENTS {
        let mut tap = 0;
        while tap < 5 {
            if SCAN[other].padded as usize == SCAN[number].padded as usize + beyond[tap] {
                assert!(other > number && other - number <= LOOKED_AT);
                all[number][tap] = other as u8;
            }
            tap += 1;
        }
        other += 1;
        if other == COEFFICIENTS {
            (number, other) = (number + 1, 0);
        }
    }
    all
}

/// Magnitudes that are tried for a coefficient in even or in odd states.
#[derive(Debug, Default)]
struct Tries {
    /// The two next to the value, and the one below them, which has the parity of the upper one.
    magnitudes: [u32; TRIED],
    symbols: [usize; TRIED],
    /// Squared errors, and the bits beside those of the symbols.
    costs: [f32; TRIED],
}

impl Quantising<'_> {
    /// The levels of a block's coefficients beyond what is predicted of them.
    pub(super) fn block(
        &self,
        block: &Block,
        predicted: Option<[i32; 6]>,
        neighbours: &Neighbours<'_>,
        trellis: &mut Trellis,
    ) -> Levels {
        vectorised(
            #[inline(always)]
            || {
                let residuals = residuals_of(block, predicted);
                let mut levels = [0; COEFFICIENTS];
                let mut scaled = [0.0; COEFFICIENTS];
                for at in 0..COEFFICIENTS {
                    scaled[at] = (residuals[at].abs() / self.steps.size(at)).min(MAX_MAGNITUDE);
                }
                let mut values = [0.0; COEFFICIENTS];
                for number in self.first..COEFFICIENTS {
                    values[number] = scaled[usize::from(SCAN[number].raster) % COEFFICIENTS];
                }
                let mut end = COEFFICIENTS;
                while end > self.first && values[end - 1] <= NEVER_LAST {
                    end -= 1;
                }
                if end == self.first {
                    return levels;
                }
                let magnitudes = self.magnitudes(&values, end - 1, neighbours, trellis);
                for number in self.first..end {
                    let at = usize::from(SCAN[number].raster) % COEFFICIENTS;
                    let magnitude = magnitudes[number] as i32;
                    levels[at] = if residuals[at] < 0.0 { -magnitude } else { magnitude };
                }
                levels
            },
        )
    }

    /// The magnitudes of the path of least cost, in coding order; none beyond the coefficient `last`.
    #[inline(always)]
    fn magnitudes(
        &self,
        values: &Values,
        last: usize,
        neighbours: &Neighbours<'_>,
        trellis: &mut Trellis,
    ) -> [u32; COEFFICIENTS] {
        let ends = self.symbol_bits.of(self.set * SET_TABLES + FIRST_END + neighbours.end);
        trellis.paths[(last + 1) % 2].costs = [f32::INFINITY; STATES];
        // Error of the coefficients beyond, where they are zero.
        let mut beyond: f32 = values[last + 1..].iter().map(|value| value * value).sum();
        for number in (self.first..=last).rev() {
            let value = values[number];
            self.go_on(value, number, neighbours, trellis);
            if value > NEVER_LAST {
                let ended = beyond + self.lambda * ends[end_symbol(number + 1 - self.first)];
                self.begin(ended, value, number, trellis);
            }
            trellis.keep(number);
            beyond += value * value;
        }
        trellis.traced(self.first, beyond + self.lambda * ends[0])
    }

    /// Takes ways that begin with a coefficient where they cost less; all coefficients beyond have the cost `ended`.
    #[inline(always)]
    fn begin(&self, ended: f32, value: f32, number: usize, trellis: &mut Trellis) {
        let zone = usize::from(SCAN[number].zone);
        let bits = self.symbol_bits.of(self.set * SET_TABLES + FIRST_LAST + zone);
        let floor = value as u32;
        for magnitude in floor.saturating_sub(1).max(1)..=floor + 1 {
            let error = self.error(value, magnitude, 0.0);
            let cost = ended + error + self.lambda * magnitude_bits(bits, magnitude - 1);
            let state = State::default().after(magnitude).number();
            let costs = &mut trellis.paths[number % 2].costs[state];
            let ways = &mut trellis.ways[number][state];
            (*costs, *ways) = lesser((*costs, *ways), (cost, Way::new(STATES, magnitude)));
        }
    }

    /// Sets the best way on into each state.
    #[inline(always)]
    fn go_on(&self, value: f32, number: usize, neighbours: &Neighbours<'_>, trellis: &mut Trellis) {
        let ways = &mut trellis.ways[number];
        let [even, odd] = &mut trellis.paths;
        let (paths, before) = if number.is_multiple_of(2) { (even, &*odd) } else { (odd, &*even) };
        let beside = neighbours.beside(SCAN[number].padded.into());
        let template = &TEMPLATES[number];
        let zone = usize::from(SCAN[number].zone);
        // The best ways on with an even and with an odd magnitude, from each state.
        let mut on = [([0.0; STATES], [Way(0); STATES]); 2];
        for (parity, half) in [0.0, 0.5].into_iter().enumerate() {
            let tries = self.tries(value, half);
            let rows = self.symbol_bits.levels(first_table(self.set, zone, State::new(parity)));
            let same = tries.magnitudes[0] as usize % 2;
            // Loops fill arrays: closures of arrays would be called.
            let mut places = [0; HALF];
            for at in 0..HALF {
                let own = &before.magnitudes[2 * at + parity];
                let mut sum = 0;
                for &place in template {
                    sum += u32::from(own[usize::from(place) % HELD]);
                }
                places[at] = neighbours.class(sum, beside) % LEVELS;
            }
            for at in 0..HALF {
                let from = 2 * at + parity;
                on[same].0[from] = self.cost(before.costs[from], &tries, 0, &rows[places[at]]);
                on[same].1[from] = Way::new(from, tries.magnitudes[0]);
                on[1 - same].0[from] = self.cost(before.costs[from], &tries, 1, &rows[places[at]]);
                on[1 - same].1[from] = Way::new(from, tries.magnitudes[1]);
            }
            if tries.magnitudes[0] > 0 {
                // The one below has the parity of the one above.
                for at in 0..HALF {
                    let from = 2 * at + parity;
                    let cost = self.cost(before.costs[from], &tries, 2, &rows[places[at]]);
                    let (costs, ways) = &mut on[1 - same];
                    let is_less = cost < costs[from];
                    ways[from] = if is_less { Way::new(from, tries.magnitudes[2]) } else { ways[from] };
                    costs[from] = if is_less { cost } else { costs[from] };
                }
            }
        }
        for (state, [even, odd]) in BEFORE.iter().enumerate() {
            let [evens, odds] = &on;
            let is_less = odds.0[*odd] < evens.0[*even];
            paths.costs[state] = if is_less { odds.0[*odd] } else { evens.0[*even] };
            ways[state] = if is_less { odds.1[*odd] } else { evens.1[*even] };
        }
    }

    /// Cost of a path that goes on with what is tried.
    #[inline(always)]
    fn cost(&self, before: f32, tries: &Tries, tried: usize, bits: &[f32; SYMBOLS]) -> f32 {
        before + (tries.costs[tried] + self.lambda * bits[tries.symbols[tried] % SYMBOLS])
    }

    /// The magnitudes near a value, where they stand for that much less.
    #[inline(always)]
    fn tries(&self, value: f32, half: f32) -> Tries {
        let floor = (value + half) as u32;
        let mut tries = Tries { magnitudes: [floor, floor + 1, floor.saturating_sub(1)], ..Tries::default() };
        for at in 0..TRIED {
            let magnitude = tries.magnitudes[at];
            tries.symbols[at] = magnitude_symbol(magnitude);
            tries.costs[at] = self.error(value, magnitude, half) + self.lambda * escaped_bits(magnitude);
        }
        tries
    }

    /// Squared error of a value that is coded as `magnitude`, which stands for `half` less.
    #[inline(always)]
    fn error(&self, value: f32, magnitude: u32, half: f32) -> f32 {
        let offset = half + self.offsets[usize::from(magnitude > 1)];
        let rebuilt = if magnitude == 0 { 0.0 } else { magnitude as f32 - offset };
        (value - rebuilt) * (value - rebuilt)
    }
}

#[cfg(test)]
mod tests {
    use texfold_core::rng::Rng;

    use super::*;
    use crate::context::Around;
    use crate::encode::symbols::{BlockBits, Superblock, states_of};
    use crate::form::Quantiser;
    use crate::tables::{StoredStops, Table};

    /// Errors in squared steps and bits of a block with such levels, by the walk that files are written by.
    fn costs(quantising: &Quantising<'_>, block: &Block, levels: &Levels, tables: &[Table]) -> (f32, f32) {
        let states = states_of(levels);
        let error = |at: usize| {
            let magnitude = levels[at].unsigned_abs();
            let half = 0.5 * states[at].odd() as f32;
            let rebuilt = if magnitude == 0 {
                0.0
            } else {
                magnitude as f32 - half - quantising.offsets[usize::from(magnitude > 1)]
            };
            let error = block[at] / quantising.steps.size(at) - rebuilt.copysign(levels[at] as f32);
            error * error
        };
        let errors = (1..COEFFICIENTS).map(error).sum();
        let mut superblock = Superblock::new((1, 1));
        superblock.push(levels);
        let mut sink = BlockBits { tables, blocks: Vec::new() };
        superblock.walk(false, 1, &[0], &mut sink);
        (errors, sink.blocks[0])
    }

    /// The nearest levels, one after the other.
    fn nearest(quantising: &Quantising<'_>, block: &Block) -> Levels {
        let mut levels = [0; COEFFICIENTS];
        let mut state = State::default();
        for place in SCAN.iter().skip(1).rev() {
            let at = usize::from(place.raster);
            let value = block[at] / quantising.steps.size(at);
            let magnitude = (value.abs() + 0.5 * state.odd() as f32).round();
            levels[at] = magnitude.copysign(value) as i32;
            state = state.after(magnitude as u32);
        }
        levels
    }

    #[test]
    fn blocks_cost_what_the_trellis_says_and_less_than_the_nearest_levels() {
        let mut rng = Rng::new(6);
        let tables = StoredStops::preset().tables().unwrap();
        let (symbol_bits, steps) = (SymbolBits::new(&tables), Steps::new(&Quantiser::of_step(1600), 0, 6));
        let mut around = Around::default();
        around.reset(1, 1, 1);
        let neighbours = around.of(0, 0, false);
        let (mut trellis, mut sums) = (Trellis::default(), [0.0; 3]);
        for round in 0..400 {
            let lambda = [0.0, 0.075, 0.3][round % 3];
            let offsets = [0.06, 0.03];
            let quantising =
                Quantising { steps: &steps, offsets, first: 1, lambda, symbol_bits: &symbol_bits, set: 0 };
            let scale = [0.3, 2.0, 40.0, 5000.0][rng.below(4) as usize];
            let block: Block = std::array::from_fn(|at| {
                let decay = scale / (1.0 + at as f64 / 8.0 + (at % 8) as f64);
                ((rng.unit() - 0.5) * 2.0 * decay) as f32 * steps.size(at)
            });
            let levels = quantising.block(&block, None, &neighbours, &mut trellis);
            let cost = |levels| {
                let (error, bits) = costs(&quantising, &block, levels, &tables);
                (error + lambda * bits, error)
            };
            let (found, greedy) = (cost(&levels), cost(&nearest(&quantising, &block)));
            if levels != [0; COEFFICIENTS] {
                let said = trellis.paths[1].costs.into_iter().fold(f32::INFINITY, f32::min);
                assert!((found.0 - said).abs() <= 1e-3 * said + 1e-3, "round {round}: {found:?} {said}");
            }
            assert!(found.0 <= greedy.0 * 1.0001 + 1e-3, "round {round}: {found:?} {greedy:?}");
            if lambda == 0.0 && scale == 5000.0 {
                sums = [sums[0] + found.1, sums[1] + greedy.1, sums[2] + 63.0];
            }
        }
        // Uniform quantisers have a twelfth; with states that are chosen well, a decibel less.
        let [found, greedy, count] = sums;
        assert!(found / count < 0.07 && greedy / count > 0.08, "{} {}", found / count, greedy / count);
    }
}
