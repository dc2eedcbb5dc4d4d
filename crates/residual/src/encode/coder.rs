//! The blocks of a texture, the rate classes that a lambda gives them, and their bits.
//!
//! A block takes the class with the least squared error + lambda x bits. Errors are estimates until a block has been coded
//! in a class; what is then known of it corrects the estimates of its other classes. Coded bits are kept, so that a search
//! for the right lambda codes a block once for each class that it is given. Cost: a trellis search a block and class,
//! some 0.5 ms.

use rayon::prelude::*;
use texfold_core::{CancelCheck, Effort, EncodeError};

use super::model::{left, scale_of};
use super::transform::{ResidualBlock, SUBBAND_OF};
use super::trellis::{Step, Trellis, pack};
use crate::decode::fast::VALUES;
use crate::decode::{BLOCK_CELLS, SUBBANDS};
use crate::rates::{RATE_CLASSES, RateModel, Rates, SUBBAND_COUNTS, WEIGHT_ONE};

/// Largest number of a scale.
const MOST_SCALE: f32 = 15.0;
/// Least weight that is told from smaller ones.
const LEAST_WEIGHT: f32 = 1e-3;
/// Blocks that one task codes: enough to be worth its room.
const TASK_BLOCKS: usize = 64;

/// A block coded in one class.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Coded {
    class: u8,
    /// Number of its scale.
    pub(crate) scale: u8,
    /// Squared error of the whole block, before values are cut to 8 bits.
    error: f32,
    /// That of the worst cell.
    worst: f32,
    /// Its bits, 16 at a time.
    pub(crate) halves: Vec<u16>,
}

/// Share of the blocks that may be coded again for the sake of their worst cells.
const FEW: f64 = 0.02;

/// All blocks with a model.
#[derive(Debug)]
pub struct Coder<'b> {
    blocks: &'b [ResidualBlock],
    /// What the blocks share.
    pub model: RateModel,
    effort: Effort,
    weights: [f32; SUBBANDS],
    /// Squared error of each block by class, estimated or known; infinite where there is no such class.
    errors: Vec<[f32; RATE_CLASSES]>,
    coded: Vec<Vec<Coded>>,
    /// How errors of each block count when classes are chosen; alike where there are none.
    importance: &'b [f32],
}

impl<'b> Coder<'b> {
    /// Nothing is coded yet.
    #[must_use]
    pub fn new(blocks: &'b [ResidualBlock], model: RateModel, effort: Effort) -> Self {
        let estimate = |block: &ResidualBlock| {
            std::array::from_fn(|class| match model.classes[class] {
                rates if class > 0 && rates.bits() == 0 => f32::INFINITY,
                rates => left(&block.energy, rates),
            })
        };
        let errors = blocks.par_iter().map(estimate).collect();
        let weights = model.weights.map(|weight| f32::from(weight) / WEIGHT_ONE);
        let coded = vec![Vec::new(); blocks.len()];
        Coder { blocks, model, effort, weights, errors, coded, importance: &[] }
    }

    /// The same where errors of each block count by its importance; alike where there are none.
    #[must_use]
    pub fn with_importance(self, importance: &'b [f32]) -> Self {
        Coder { importance, ..self }
    }

    /// The class of each block where a bit is worth `lambda`.
    #[must_use]
    pub fn choose(&self, lambda: f32) -> Vec<u8> {
        self.choose_weighted(lambda, &[])
    }

    /// The same where the errors of each block count by its weight, too; alike where there are none.
    #[must_use]
    pub fn choose_weighted(&self, lambda: f32, weights: &[f32]) -> Vec<u8> {
        let counts = |of: &[f32], index: usize| of.get(index).map_or(1.0, |count| count.max(LEAST_WEIGHT));
        let best = |(index, errors): (usize, _)| {
            self.cheapest(errors, lambda / (counts(weights, index) * counts(self.importance, index)))
        };
        self.errors.par_iter().enumerate().map(best).collect()
    }

    fn cheapest(&self, errors: &[f32; RATE_CLASSES], lambda: f32) -> u8 {
        let step = lambda * self.model.class_bits as f32;
        let cost = |class: usize| errors[class] + step * class as f32;
        (0..RATE_CLASSES).min_by(|&a, &b| cost(a).total_cmp(&cost(b))).unwrap_or(0) as u8
    }

    /// The first class of each block whose error is at most `limit`, as far as is known; the last where there is none.
    #[must_use]
    pub fn likely(&self, limit: f32) -> Vec<u8> {
        let first = |errors: &[f32; RATE_CLASSES]| {
            (0..RATE_CLASSES).find(|&class| errors[class] <= limit).unwrap_or(RATE_CLASSES - 1) as u8
        };
        self.errors.iter().map(first).collect()
    }

    /// Squared error of such classes, as far as is known, summed over the `counted` blocks.
    #[must_use]
    pub fn error_of(&self, classes: &[u8], counted: &[bool]) -> f64 {
        let known = |index: usize| f64::from(self.errors[index][usize::from(classes[index])]);
        (0..classes.len()).filter(|&index| counted[index]).map(known).sum()
    }

    /// Codes every block in its class, where that has not been done.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] within a few blocks of the caller's wish.
    pub fn code(&mut self, classes: &[u8], check: CancelCheck<'_>) -> Result<(), EncodeError> {
        let Coder { blocks, model, effort, weights, errors, coded, .. } = self;
        let (blocks, model, effort, weights) = (*blocks, &*model, *effort, &*weights);
        let tasks = coded
            .par_chunks_mut(TASK_BLOCKS)
            .zip(errors.par_chunks_mut(TASK_BLOCKS))
            .zip(blocks.par_chunks(TASK_BLOCKS))
            .zip(classes.par_chunks(TASK_BLOCKS));
        tasks.for_each(|(((coded, errors), blocks), classes)| {
            let mut trellis = Trellis::default();
            for (((coded, errors), block), &class) in coded.iter_mut().zip(errors).zip(blocks).zip(classes) {
                if check.is_cancelled() {
                    return;
                }
                if coded.iter().all(|found| found.class != class) {
                    let found = code_block(block, class, model, weights, effort, &mut trellis);
                    correct(errors, &found);
                    coded.push(found);
                }
            }
        });
        check.checkpoint()
    }

    /// For each block the first class whose worst cell has at most `limit` of squared error, coding it in one after another;
    /// the last class where none has, at the scale that its worst cell is best at.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] within a few blocks of the caller's wish.
    pub fn within(&mut self, limit: f32, check: CancelCheck<'_>) -> Result<Vec<u8>, EncodeError> {
        let mut classes = vec![0u8; self.blocks.len()];
        loop {
            self.code(&classes, check)?;
            let mut again = false;
            let mut failed = Vec::new();
            for (index, class) in classes.iter_mut().enumerate() {
                let worst = self.found(index, *class).map_or(f32::MAX, |found| found.worst);
                let errors = &self.errors[index];
                let further =
                    || (*class + 1..RATE_CLASSES as u8).filter(|&next| errors[usize::from(next)].is_finite());
                // Classes that cannot do are passed over: the mean cell is no worse than the worst.
                let likely = further().find(|&next| errors[usize::from(next)] <= BLOCK_CELLS as f32 * limit);
                match likely.or(further().next_back()) {
                    Some(next) if worst > limit => {
                        *class = next;
                        again = true;
                    }
                    None if worst > limit && *class > 0 => failed.push(index),
                    _ => {}
                }
            }
            if !again {
                // Where many fail no scale will help them all.
                if failed.len() as f64 <= FEW * self.blocks.len() as f64 {
                    self.lessen_worst(&failed, &classes, check)?;
                }
                return Ok(classes);
            }
        }
    }

    /// Codes blocks anew, at the scale of which the worst cell is least: one with all of a block's error in one cell is beyond the largest
    /// values of the scale that suits the block's mean.
    fn lessen_worst(
        &mut self,
        failed: &[usize],
        classes: &[u8],
        check: CancelCheck<'_>,
    ) -> Result<(), EncodeError> {
        let better: Vec<Option<Coded>> = failed
            .par_iter()
            .map(|&index| {
                let (block, class) = (&self.blocks[index], classes[index]);
                let coded = |number: u8| code_at(block, class, &self.model, &self.weights, number);
                let scales = (0..=MOST_SCALE as u8).take_while(|_| !check.is_cancelled());
                scales.map(coded).min_by(|a, b| a.worst.total_cmp(&b.worst))
            })
            .collect();
        check.checkpoint()?;
        for (&index, better) in failed.iter().zip(better) {
            for found in self.coded[index].iter_mut().filter(|found| found.class == classes[index]) {
                if let Some(better) = better.clone().filter(|better| better.worst < found.worst) {
                    *found = better;
                }
            }
        }
        Ok(())
    }

    /// A block as it is coded in that class.
    pub(crate) fn found(&self, index: usize, class: u8) -> Option<&Coded> {
        self.coded[index].iter().find(|found| found.class == class)
    }
}

/// Takes over what coding has measured: the error in this class, and how far estimates were off.
fn correct(errors: &mut [f32; RATE_CLASSES], found: &Coded) {
    let class = usize::from(found.class);
    if class == 0 {
        return;
    }
    let off = found.error / errors[class].max(1e-6);
    for error in &mut errors[1..] {
        *error *= off;
    }
}

fn code_block(
    block: &ResidualBlock,
    class: u8,
    model: &RateModel,
    weights: &[f32; SUBBANDS],
    effort: Effort,
    trellis: &mut Trellis,
) -> Coded {
    let rates = model.classes[usize::from(class)];
    let zero = rates.bits() == 0;
    if zero {
        let errors = block.cells.map(|cell| cell.iter().map(|value| value * value).sum::<f32>());
        let worst = errors.iter().copied().fold(0.0, f32::max);
        return Coded { class, scale: 0, error: errors.iter().sum(), worst, halves: Vec::new() };
    }
    let scale = scale_of(&block.energy, rates, weights) * headroom(rates);
    let number = (2.0 * scale.max(1e-3).log2()).round().clamp(0.0, MOST_SCALE);
    let mut open = |number: f32| {
        let steps = steps(block, rates.0, weights, number);
        let (end, error) = trellis.open(&steps);
        Opened { number, steps, end, error }
    };
    let mut best = open(number);
    // Errors have one least scale in all but a few blocks: where a larger one is better, no smaller one is tried.
    for direction in if effort == Effort::Fast { &[][..] } else { &[1.0, -1.0] } {
        let first = best.number;
        while (0.0..=MOST_SCALE).contains(&(best.number + direction)) {
            let next = open(best.number + direction);
            if next.error >= best.error {
                break;
            }
            best = next;
        }
        if best.number != first {
            break;
        }
    }
    close(block, class, rates, &best, trellis)
}

/// A block as it is coded in a class that has bits, at that scale.
fn code_at(
    block: &ResidualBlock,
    class: u8,
    model: &RateModel,
    weights: &[f32; SUBBANDS],
    number: u8,
) -> Coded {
    let rates = model.classes[usize::from(class)];
    let mut trellis = Trellis::default();
    let number = f32::from(number);
    let steps = steps(block, rates.0, weights, number);
    let (end, error) = trellis.open(&steps);
    close(block, class, rates, &Opened { number, steps, end, error }, &mut trellis)
}

/// A block's best path without the rule that it ends where it begins.
struct Opened {
    /// Number of the scale.
    number: f32,
    steps: Vec<Step>,
    end: u16,
    error: f32,
}

/// The block with a path that ends where it begins.
fn close(block: &ResidualBlock, class: u8, rates: Rates, opened: &Opened, trellis: &mut Trellis) -> Coded {
    let steps = &opened.steps;
    let path = trellis.ring(steps, opened.end);
    let halves = pack(steps, path);
    let mut coded = Coded { class, scale: opened.number as u8, error: 0.0, worst: 0.0, halves };
    let mut left = steps.iter().zip(path);
    for cell in &block.cells {
        let mut error = 0.0;
        for (value, subband) in cell.iter().zip(SUBBAND_OF) {
            let decoded = match rates.0[usize::from(subband)] {
                0 => 0.0,
                _ => left.next().map_or(0.0, |(step, &state)| step.weight * VALUES[usize::from(state)]),
            };
            error += (value - decoded) * (value - decoded);
        }
        coded.error += error;
        coded.worst = coded.worst.max(error);
    }
    coded
}

/// How much larger than a block's RMS its scale should be: the more bits, the more the values beyond the table's largest
/// count. Between what suits normal numbers and what suits those of mixed scales.
fn headroom(rates: Rates) -> f32 {
    const BY_RATE: [f32; 6] = [1.0, 1.0, 1.2, 1.4, 1.55, 1.6];
    let coded = || rates.0.into_iter().zip(SUBBAND_COUNTS).filter(|&(rate, _)| rate > 0);
    let coefficients: u32 = coded().map(|(_, count)| count).sum();
    let sum: f32 = coded().map(|(rate, count)| BY_RATE[usize::from(rate)] * count as f32).sum();
    sum / coefficients.max(1) as f32
}

/// RMS of the table: one over 255 times the unit.
const TABLE_RMS: f32 = 1.0 / (255.0 * crate::decode::TEXFOLD_RESIDUAL_UNIT);

/// The coefficients that get bits, in the order of these.
fn steps(
    block: &ResidualBlock,
    rates: [u8; SUBBANDS],
    weights: &[f32; SUBBANDS],
    scale_number: f32,
) -> Vec<Step> {
    let scale = (scale_number / 2.0).exp2() / TABLE_RMS;
    let mut steps = Vec::new();
    for cell in &block.cells {
        for (&target, subband) in cell.iter().zip(SUBBAND_OF) {
            let subband = usize::from(subband);
            if rates[subband] > 0 {
                steps.push(Step {
                    target,
                    weight: weights[subband] * scale,
                    rate: u32::from(rates[subband]),
                });
            }
        }
    }
    steps
}
