//! What a base with an error map would come to, before a block is coded: its model and the price of bits that the goal asks for.

use std::convert::Infallible;

use texfold_core::metric::SquaredError;
use texfold_core::target::{Found, Measured, search};
use texfold_core::{Effort, Goal};

use super::base::Base;
use super::coder::Coder;
use super::model::{Reach, train};
use crate::rates::{CLASSES, Model};

/// Prices of a bit that are told apart: steps of half a percent from the highest to the lowest.
pub(crate) const PRICES: u32 = 4000;
/// Where the numbers of prices start, so that a geometric middle is nearly an arithmetic one.
pub(crate) const FIRST_PRICE: u32 = 1 << 14;
/// Highest price: no block of 8-bit values is worth its bits at it.
const HIGHEST_PRICE: f32 = 1e5;
/// Factor between prices.
const PRICE_STEP: f32 = 0.9953;
/// Price that models are first made for.
const FIRST_GUESS: f32 = 40.0;
/// Times that a model is made for the price found with the one before.
const ROUNDS: usize = 2;
/// Share of the blocks in the largest class from which larger classes are tried.
pub(crate) const CROWD: f64 = 0.02;
/// Squared error of rounding to 8 bits, a value.
const ROUNDING: f64 = 1.0 / 12.0;
/// Colour channels of a texel that squared errors are summed over.
const CHANNELS: f64 = 3.0;
/// Values of a 4x4 cell.
const CELL_VALUES: f32 = 48.0;
/// How much more a block's worst cell is off than its mean one.
const WORST_TO_MEAN: f32 = 2.0;

/// Squared error that a bit is worth, by number: the higher, the finer.
pub(crate) fn price(number: u32) -> f32 {
    HIGHEST_PRICE * PRICE_STEP.powi(number.saturating_sub(FIRST_PRICE) as i32)
}

/// Squared error of a cell within a tolerance.
pub(crate) fn cell_limit(tolerance: f64) -> f32 {
    (tolerance * tolerance) as f32 * CELL_VALUES
}

/// A base's model and price.
#[derive(Debug)]
pub(crate) struct Draft {
    pub(crate) model: Model,
    /// Price that the model was made for.
    lambda: f32,
    /// Number of the price.
    pub(crate) number: u32,
    /// What it should come to.
    pub(crate) estimate: Measured,
    /// Whether many blocks are of the largest class.
    pub(crate) crowded: bool,
}

impl Draft {
    pub(crate) fn new(base: &Base, class_bits: u32, goal: Goal) -> Draft {
        let mut lambda = match goal {
            // Where each bit halves the error's root, one is worth 1.4 times a coefficient's squared error.
            Goal::Psnr(psnr) => (1.4 * 255.0 * 255.0 * CHANNELS / 10f64.powf(psnr / 10.0)) as f32,
            Goal::Tolerance(tolerance) => (1.4 * CHANNELS * tolerance * tolerance / 4.0) as f32,
            Goal::Bpp(_) => FIRST_GUESS,
        };
        let mut draft = Draft::priced(base, class_bits, goal, lambda, Reach::Near);
        for _ in 0..ROUNDS {
            lambda = match goal {
                Goal::Tolerance(_) => lambda,
                _ => price(draft.number),
            };
            let next = Draft::priced(base, class_bits, goal, lambda, Reach::Near);
            if goal.prefers(&next.estimate, &draft.estimate) {
                draft = next;
            }
        }
        draft
    }

    /// The same with a model for prices far from its own.
    pub(crate) fn widened(self, base: &Base, goal: Goal) -> Draft {
        Draft::priced(base, self.model.class_bits, goal, self.lambda, Reach::Far)
    }

    fn priced(base: &Base, class_bits: u32, goal: Goal, lambda: f32, reach: Reach) -> Draft {
        let coder = Coder::new(&base.blocks, train(&base.blocks, class_bits, lambda, reach), Effort::Fast);
        let (number, estimate, classes) = match goal {
            Goal::Tolerance(tolerance) => {
                let classes = coder.likely(cell_limit(tolerance) * 4.0 / WORST_TO_MEAN);
                let mut estimate = estimate(base, &coder, &classes, goal);
                let crowded = share_of_largest(&classes) > CROWD;
                estimate.worst_block_rms = if crowded { f64::MAX } else { tolerance };
                (FIRST_PRICE, estimate, classes)
            }
            _ => {
                let found = search_price(base, &coder, goal);
                (found.knob, found.measured, found.value)
            }
        };
        let crowded = share_of_largest(&classes) > CROWD;
        Draft { model: coder.model, lambda, number, estimate, crowded }
    }
}

/// Share of the blocks that are of the largest class.
pub(crate) fn share_of_largest(classes: &[u8]) -> f64 {
    let largest = classes.iter().filter(|&&class| usize::from(class) + 1 == CLASSES).count();
    largest as f64 / classes.len() as f64
}

/// The price that answers the goal best by what is known of the blocks.
pub(crate) fn search_price(base: &Base, coder: &Coder<'_>, goal: Goal) -> Found<Vec<u8>> {
    let range = FIRST_PRICE..=FIRST_PRICE + PRICES;
    let found = search(goal, range, FIRST_PRICE + PRICES / 2, 0.0, |number| {
        let classes = coder.choose(price(number));
        Ok::<_, Infallible>((estimate(base, coder, &classes, goal), classes))
    });
    match found {
        Ok(found) => found,
    }
}

/// Bits exactly, error as far as is known.
fn estimate(base: &Base, coder: &Coder<'_>, classes: &[u8], goal: Goal) -> Measured {
    // Goals of quality are those of colours.
    let alpha = if matches!(goal, Goal::Bpp(_)) { base.alpha_error } else { 0.0 };
    let sum = coder.error_of(classes, &base.counted);
    let count = CHANNELS * base.texels as f64;
    let error = SquaredError { sum: sum + ROUNDING * count + alpha, count: count as u64 };
    Measured {
        psnr: error.psnr(),
        bpp: base.bits(coder, classes) as f64 / base.texels as f64,
        worst_block_rms: 0.0,
    }
}
