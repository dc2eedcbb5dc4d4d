//! Numbers of a block's coefficients with the least squared error + lambda x bits.
//!
//! Errors are in squared steps, in which all coefficients count alike. A coefficient is first rounded; then, from the last
//! one to the first, its magnitude is lowered by one or to zero where that costs less, with the bits of its own symbol
//! and of the five symbols whose contexts look at it; at last the end of the block is set where it costs least.
//! *Not done*: bits of the blocks to the right and below, whose contexts change, too.

use super::forward::Block;
use super::symbols::{Levels, end_symbol, magnitude_bits};
use crate::context::{FIRST_END, FIRST_LAST, LEVELS, Magnitudes, Neighbours, held};
use crate::form::Steps;
use crate::plane::PREDICTED;
use crate::scan::{COEFFICIENTS, PADDED, SCAN};
use crate::tables::SYMBOLS;

/// Largest magnitude: what escaped values can say, and what 16-bit samples reach at the finest step.
const MAX_MAGNITUDE: f32 = 16_000_000.0;
/// How far above its magnitude a value may lie for a lower magnitude to be tried.
const TRIED: f32 = 0.35;
/// Rounding where bits of symbols are not known yet.
const PLAIN_ROUNDING: f32 = 0.38;

/// What quantises the blocks of an axis of a plane.
pub(super) struct Quantising<'a> {
    pub steps: &'a Steps,
    /// Reconstruction offsets in steps.
    pub offsets: [f32; 2],
    /// First coefficient that is coded: 1 where the mean comes from a base.
    pub first: usize,
    /// Squared steps that a bit is worth.
    pub lambda: f32,
    /// Times that coefficients are lowered.
    pub rounds: usize,
    /// Bits of symbols in the axis' set of tables; none for plain rounding.
    pub symbol_bits: Option<&'a [[f32; SYMBOLS]]>,
}

/// What is left of a block's coefficients beyond what is predicted of them.
pub(super) fn residuals_of(block: &Block, predicted: Option<[i32; 6]>) -> Block {
    let mut residuals = *block;
    if let Some(predicted) = predicted {
        PREDICTED.iter().zip(predicted).for_each(|(&at, value)| residuals[at] -= value as f32);
    }
    residuals
}

/// A block on its way.
struct Trial<'a> {
    /// Absolute coefficients in steps, in coding order.
    values: [f32; COEFFICIENTS],
    /// Their numbers, in coding order.
    levels: [u32; COEFFICIENTS],
    /// The same, padded.
    magnitudes: Magnitudes,
    symbol_bits: &'a [[f32; SYMBOLS]],
    neighbours: &'a Neighbours<'a>,
}

impl Quantising<'_> {
    /// The numbers of a block's coefficients beyond what is predicted of them.
    pub(super) fn block(
        &self,
        block: &Block,
        predicted: Option<[i32; 6]>,
        neighbours: &Neighbours<'_>,
    ) -> Levels {
        let residuals = residuals_of(block, predicted);
        let rounding = if self.symbol_bits.is_some() { 0.5 } else { PLAIN_ROUNDING };
        let mut values = [0.0; COEFFICIENTS];
        let mut levels = [0; COEFFICIENTS];
        for number in self.first..COEFFICIENTS {
            let raster = usize::from(SCAN[number].raster);
            values[number] = (residuals[raster].abs() / self.steps.size(raster)).min(MAX_MAGNITUDE);
            levels[number] = (values[number] + rounding) as u32;
        }
        if let Some(symbol_bits) = self.symbol_bits {
            let padded = padded(&levels);
            let mut trial = Trial { values, levels, magnitudes: padded, symbol_bits, neighbours };
            (0..self.rounds).for_each(|_| self.lower(&mut trial));
            self.cut(&mut trial);
            levels = trial.levels;
        }
        let mut signed = [0; COEFFICIENTS];
        for (place, level) in SCAN.iter().zip(levels) {
            let raster = usize::from(place.raster);
            signed[raster] = if residuals[raster] < 0.0 { -(level as i32) } else { level as i32 };
        }
        signed
    }

    /// Squared error of a value that is coded as `level`.
    #[inline(always)]
    fn error(&self, value: f32, level: u32) -> f32 {
        let rebuilt = if level == 0 { 0.0 } else { level as f32 - self.offsets[usize::from(level > 1)] };
        (value - rebuilt) * (value - rebuilt)
    }

    /// Lowers magnitudes where that costs less.
    fn lower(&self, trial: &mut Trial<'_>) {
        let Some(last) = (self.first..COEFFICIENTS).rev().find(|&number| trial.levels[number] > 0) else {
            return;
        };
        for number in (self.first..=last).rev() {
            let level = trial.levels[number];
            let value = trial.values[number];
            if level == 0 || value > level as f32 + TRIED {
                continue;
            }
            let cost = |trial: &mut Trial<'_>, level: u32| {
                self.error(value, level) + self.lambda * trial.bits_with(self.first, number, level, last)
            };
            let (now, below) = (cost(trial, level), level - 1);
            // The last coefficient's magnitude is above zero; the cut decides on it.
            let mut best = (now, level);
            if below > 0 || number != last {
                best = lesser(best, (cost(trial, below), below));
            }
            if below == 1 && number != last {
                best = lesser(best, (cost(trial, 0), 0));
            }
            trial.set(number, best.1);
        }
    }

    /// Ends the block where that costs least.
    fn cut(&self, trial: &mut Trial<'_>) {
        let count = (self.first..COEFFICIENTS).rev().find(|&number| trial.levels[number] > 0);
        let Some(last) = count else { return };
        let mut best = (f32::INFINITY, last + 1);
        // Error of what lies beyond the end.
        let mut beyond = 0.0;
        let mut kept = trial.levels;
        let mut end = last + 1;
        loop {
            let cost = beyond + self.lambda * trial.bits(self.first, end) + self.inside(trial, end);
            best = lesser(best, (cost, end));
            if end == self.first || beyond > best.0 {
                break;
            }
            // Without the last one, up to the next that is not zero.
            end -= 1;
            beyond += trial.values[end] * trial.values[end];
            trial.set(end, 0);
            while end > self.first && trial.levels[end - 1] == 0 {
                end -= 1;
                beyond += trial.values[end] * trial.values[end];
            }
        }
        kept[best.1..].fill(0);
        trial.levels = kept;
    }

    /// Squared error of the coefficients before `end`.
    fn inside(&self, trial: &Trial<'_>, end: usize) -> f32 {
        (self.first..end).map(|number| self.error(trial.values[number], trial.levels[number])).sum()
    }
}

impl Trial<'_> {
    fn set(&mut self, number: usize, level: u32) {
        self.levels[number] = level;
        self.magnitudes[usize::from(SCAN[number].padded)] = held(level);
    }

    /// Bits of the symbol of a coefficient.
    #[inline(always)]
    fn bits_of(&self, number: usize, last: usize) -> f32 {
        let place = SCAN[number];
        let zone = usize::from(place.zone);
        if number == last {
            return magnitude_bits(&self.symbol_bits[FIRST_LAST + zone], self.levels[number] - 1);
        }
        let class = self.neighbours.level(&self.magnitudes, usize::from(place.padded));
        magnitude_bits(&self.symbol_bits[zone * LEVELS + class], self.levels[number])
    }

    /// Bits of a coefficient of that level and of those whose contexts look at it.
    fn bits_with(&mut self, first: usize, number: usize, level: u32, last: usize) -> f32 {
        self.set(number, level);
        let (column, row) = (SCAN[number].raster as usize / 8, SCAN[number].raster as usize % 8);
        let mut bits = self.bits_of(number, last);
        for (left, up) in [(1, 0), (0, 1), (1, 1), (2, 0), (0, 2)] {
            if column >= left && row >= up {
                let dependent = usize::from(NUMBERS[(column - left) * 8 + row - up]);
                if dependent >= first {
                    bits += self.bits_of(dependent, last);
                }
            }
        }
        bits
    }

    /// Bits of the block that ends there.
    fn bits(&self, first: usize, end: usize) -> f32 {
        let count = end - first;
        let ends = self.symbol_bits[FIRST_END + self.neighbours.end][end_symbol(count)];
        (first..end).map(|number| self.bits_of(number, end - 1)).sum::<f32>() + ends
    }
}

fn lesser<T>(one: (f32, T), other: (f32, T)) -> (f32, T) {
    if other.0 < one.0 { other } else { one }
}

fn padded(levels: &[u32; COEFFICIENTS]) -> Magnitudes {
    let mut magnitudes = [0; PADDED];
    for (place, &level) in SCAN.iter().zip(levels) {
        magnitudes[usize::from(place.padded)] = held(level);
    }
    magnitudes
}

/// Number in coding order of each coefficient, column by column.
static NUMBERS: [u8; COEFFICIENTS] = numbers();

const fn numbers() -> [u8; COEFFICIENTS] {
    let mut numbers = [0; COEFFICIENTS];
    let mut number = 0;
    while number < COEFFICIENTS {
        numbers[SCAN[number].raster as usize] = number as u8;
        number += 1;
    }
    numbers
}
