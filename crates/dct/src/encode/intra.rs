//! Choice of blocks' intra modes.

use super::forward::{Block, Forward};
use super::quantise::{Quantising, Trellis, residuals_of};
use super::symbols::{Counts, Levels, Sink, SymbolBits, walk_block};
use crate::context::{FIRST_MODE, MODE_TABLES, Neighbours};
use crate::encode::fit::StopBits;
use crate::intra::{MODES, References, USUAL_NONE, is_from_left, stops, turned};
use crate::scan::COEFFICIENTS;
use crate::tables::{STOP, STOP_VALUES};
use crate::transform::inverse;
use crate::vectors::vectorised;

/// Weight of a mode's bits beside the logarithms of [`size`]. With 0.3 six photographs have 0.02 dB more at 0.5 and 1 bits a texel at effort
/// fast, two of foliage 0.03 less, which is then below means alone; with 0.8 the six have 0.06 dB less at 0.5 bits.
const MODE_WEIGHT: f32 = 0.5;
/// Difference of sizes above which they decide alone, where one mode is tried: bits are those of all tried, within 0.1 %.
const MARGIN: f32 = 4.0;
/// Modes, those of least absolute differences, whose coefficients are compared.
const NEAREST: usize = 3;
/// Blocks of a table that its usual stopping probability counts as.
const USUAL_BLOCKS: f64 = 4.0;

/// A block's mode.
#[derive(Debug, Default)]
pub(super) struct Choice {
    pub mode: u8,
    /// The levels of the first axes of its groups, where they are known.
    pub levels: Vec<Levels>,
}

/// Choice among modes.
pub(super) struct Chooser {
    forward: Forward,
    /// Modes that are quantised beside none; where there are none, [`size`] decides alone.
    tried: usize,
    /// Difference of sizes above which they decide alone.
    margin: f32,
}

/// A block's axis before it is quantised.
pub(super) struct BlockAxis<'a> {
    pub quantising: Quantising<'a>,
    pub coefficients: Block,
    /// Its lowest coefficients, as the means around the block predict them.
    pub predicted: Option<[i32; 6]>,
    pub neighbours: Neighbours<'a>,
    /// Samples next to the block; none where it may not have a mode.
    pub references: Option<References>,
}

impl BlockAxis<'_> {
    /// The samples by a mode.
    #[inline(always)]
    pub(super) fn prediction(&self, mode: u8) -> Option<[i32; COEFFICIENTS]> {
        self.references.as_ref().filter(|_| mode > 0).map(|references| references.predict(mode))
    }
}

impl Chooser {
    /// With so many modes that are quantised beside none.
    pub(super) fn new(tried: usize) -> Chooser {
        let margin = if tried > 1 { f32::INFINITY } else { MARGIN };
        Chooser { forward: Forward::new(), tried, margin }
    }

    /// The mode of least cost for the first axes of a block's groups; `table` codes it.
    pub(super) fn choose(&self, axes: &[BlockAxis<'_>], table: usize, trellis: &mut Trellis) -> Choice {
        let Some(BlockAxis { quantising, .. }) = axes.first() else { return Choice::default() };
        let mode_bits = quantising.symbol_bits.of(table);
        let mut none = 0.0;
        let mut sizes = [(f32::INFINITY, 0u8); NEAREST];
        vectorised(
            #[inline(always)]
            || {
                let steps = quantising.steps;
                let inverses: Block =
                    std::array::from_fn(|at| if at > 0 { 1.0 / steps.size(at) } else { 0.0 });
                let size = |mode: u8| {
                    let mut sum = MODE_WEIGHT * mode_bits[usize::from(mode)];
                    for axis in axes {
                        let (coefficients, predicted) = self.against(axis, axis.prediction(mode).as_ref());
                        sum += size(&residuals_of(&coefficients, predicted), &inverses);
                    }
                    sum
                };
                none = size(0);
                for (found, mode) in sizes.iter_mut().zip(nearest(axes)) {
                    *found = (size(mode), mode);
                }
            },
        );
        sizes.sort_by(|one, other| one.0.total_cmp(&other.0));
        if self.tried == 0 || (sizes[0].0 - none).abs() > self.margin {
            return Choice { mode: if sizes[0].0 < none { sizes[0].1 } else { 0 }, levels: Vec::new() };
        }
        let mut best = self.tried(axes, table, 0, trellis);
        for &(_, mode) in sizes.iter().take(self.tried) {
            let made = self.tried(axes, table, mode, trellis);
            if made.0 < best.0 {
                best = made;
            }
        }
        best.1
    }

    /// Cost of a mode, and the levels that it comes to.
    fn tried(&self, axes: &[BlockAxis<'_>], table: usize, mode: u8, trellis: &mut Trellis) -> (f32, Choice) {
        let mut cost = 0.0;
        let mut choice = Choice { mode, levels: Vec::new() };
        for (number, axis) in axes.iter().enumerate() {
            let BlockAxis { quantising, neighbours, .. } = axis;
            let (coefficients, predicted) = self.against(axis, axis.prediction(mode).as_ref());
            let levels = quantising.block(&coefficients, predicted, neighbours, trellis);
            let mut sink = Bits { of: quantising.symbol_bits, sum: 0.0 };
            if number == 0 {
                sink.symbol(table, mode.into());
            }
            walk_block(&levels, quantising.first, quantising.set, neighbours, &mut sink);
            let residuals = residuals_of(&coefficients, predicted);
            cost += quantising.squared_error(&residuals, &levels, &[1.0; COEFFICIENTS], |_, _| ());
            cost += quantising.lambda * sink.sum;
            choice.levels.push(levels);
        }
        (cost, choice)
    }

    /// A block's coefficients beyond an intra prediction, and what means predict of them.
    #[inline(always)]
    pub(super) fn against(
        &self,
        axis: &BlockAxis<'_>,
        prediction: Option<&[i32; COEFFICIENTS]>,
    ) -> (Block, Option<[i32; 6]>) {
        let Some(prediction) = prediction else { return (axis.coefficients, axis.predicted) };
        let prediction = self.forward.transform(&prediction.map(|sample| sample as f32));
        let rest = std::array::from_fn(|at| axis.coefficients[at] - prediction[at]);
        (rest, axis.predicted.map(|[mean, ..]| [mean, 0, 0, 0, 0, 0]))
    }
}

/// The modes that leave the least absolute differences.
#[inline(always)]
fn nearest(axes: &[BlockAxis<'_>]) -> [u8; NEAREST] {
    let mut sums = [0i32; MODES];
    for axis in axes {
        let Some(references) = &axis.references else { continue };
        let wanted = inverse(axis.coefficients.map(|value| value.round() as i32));
        let by_columns = turned(&wanted);
        for (mode, sum) in (0u8..).zip(&mut sums).skip(1) {
            let wanted = if is_from_left(mode) { &by_columns } else { &wanted };
            let lines = references.lines(mode);
            let away: [i32; COEFFICIENTS] = std::array::from_fn(|at| wanted[at] - lines[at]);
            let mean = away.iter().sum::<i32>() >> 6;
            *sum += away.iter().map(|away| (away - mean).abs()).sum::<i32>();
        }
    }
    let mut nearest = [(i32::MAX, 0); NEAREST];
    for (mode, sum) in (0u8..).zip(sums).skip(1) {
        let mut found = (sum, mode);
        for place in &mut nearest {
            if found.0 < place.0 {
                std::mem::swap(&mut found, place);
            }
        }
    }
    nearest.map(|(_, mode)| mode)
}

/// Sums up the bits of symbols.
struct Bits<'a> {
    of: &'a SymbolBits,
    sum: f32,
}

impl Sink for Bits<'_> {
    fn symbol(&mut self, table: usize, symbol: usize) {
        self.sum += self.of.of(table)[symbol];
    }

    fn bits(&mut self, _value: u32, _count: u32) {
        // Those of symbols have them.
    }
}

/// Sum of the logarithms of a block's coefficients in steps and 1: nearly linear in the bits that they take.
#[inline(always)]
pub(super) fn size(residuals: &Block, inverse: &Block) -> f32 {
    // The exponent and the fraction of a number are its logarithm, within 0.09.
    let mut sums = [0i32; 8];
    for (residuals, inverse) in residuals.chunks_exact(8).zip(inverse.chunks_exact(8)) {
        for lane in 0..8 {
            let value = 1.0 + (residuals[lane] * inverse[lane]).abs().min(1e6);
            sums[lane] += (value.to_bits() as i32 - 1f32.to_bits() as i32) >> 8;
        }
    }
    sums.iter().sum::<i32>() as f32 / (1u32 << 15) as f32
}

/// The stopping probabilities of no prediction that code such modes best, and the bits of all modes; `None` where no block is predicted.
pub(super) fn fit_modes(counts: &Counts, bits: &StopBits) -> Option<([u8; MODE_TABLES], f64)> {
    let tables = counts.get(FIRST_MODE..FIRST_MODE + MODE_TABLES)?;
    if tables.iter().all(|counts| counts[1..].iter().all(|&count| count == 0)) {
        return None;
    }
    let mut none = USUAL_NONE;
    let mut sum = 8.0 * MODE_TABLES as f64;
    for (none, counts) in none.iter_mut().zip(tables) {
        let usual = f64::from(STOP[usize::from(*none)]) / 65536.0;
        let all: u32 = counts.iter().sum();
        let share = (f64::from(counts[0]) + USUAL_BLOCKS * usual) / (f64::from(all) + USUAL_BLOCKS);
        let logistic = (share / (1.0 - share)).ln() / 0.22 + 31.5;
        *none = logistic.round().clamp(0.0, STOP_VALUES as f64 - 1.0) as u8;
        sum += bits.of(&stops(*none), counts);
    }
    Some((none, sum))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_sums_of_logarithms() {
        let residuals: Block =
            std::array::from_fn(|at| if at % 3 == 0 { 0.0 } else { 1.7 * at as f32 - 40.0 });
        let wanted: f32 = residuals.iter().map(|value| (1.0 + (value / 5.0).abs()).log2()).sum();
        let found = size(&residuals, &[0.2; COEFFICIENTS]);
        assert!(found < wanted && wanted - found < 0.09 * 64.0, "{found} {wanted}");
    }
}
