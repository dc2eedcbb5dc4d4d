//! What a base with a residual plane would come to, before a block is coded: its rate model and the lambda that the goal
//! asks for.

use std::convert::Infallible;

use texfold_core::metric::SquaredError;
use texfold_core::target::{Found, Measured, search};
use texfold_core::{CancelCheck, Effort, EncodeError, Goal};

use texfold_residual::RateModel;
use texfold_residual::encode::{CROWDED, Coder, Reach, share_of_largest, train};

use super::base::Base;

/// Lambdas that are told apart: steps of half a percent from the highest to the lowest.
pub(crate) const LAMBDAS: u32 = 4000;
/// Where the indices of lambdas start, so that a geometric middle is nearly an arithmetic one.
pub(crate) const FIRST_LAMBDA: u32 = 1 << 14;
/// Highest lambda: no block of 8-bit values is worth its bits at it.
const HIGHEST_LAMBDA: f32 = 1e5;
/// Factor between lambdas.
const LAMBDA_STEP: f32 = 0.9953;
/// Lambda that models are first made for.
const FIRST_GUESS: f32 = 40.0;
/// Times that a model is made for the price found with the one before.
const ROUNDS: usize = 2;
/// Squared error of rounding to 8 bits, a value.
const ROUNDING: f64 = 1.0 / 12.0;
/// Colour channels of a texel that squared errors are summed over.
const CHANNELS: f64 = 3.0;
/// Values of a 4x4 cell.
const CELL_VALUES: f32 = 48.0;
/// How much more a block's worst cell is off than its mean one.
const WORST_TO_MEAN: f32 = 2.0;

/// Squared error that a bit is worth, by index: the higher, the finer.
pub(crate) fn lambda_of(index: u32) -> f32 {
    HIGHEST_LAMBDA * LAMBDA_STEP.powi(index.saturating_sub(FIRST_LAMBDA) as i32)
}

/// Squared error of a cell within a tolerance.
pub(crate) fn cell_limit(tolerance: f64) -> f32 {
    (tolerance * tolerance) as f32 * CELL_VALUES
}

/// A base's rate model and lambda.
#[derive(Debug)]
pub(crate) struct Draft {
    pub(crate) model: RateModel,
    /// Lambda that the model was made for.
    lambda: f32,
    /// Index of the lambda.
    pub(crate) index: u32,
    /// What it should come to.
    pub(crate) estimate: Measured,
    /// Whether many blocks are of the largest class.
    pub(crate) crowded: bool,
}

impl Draft {
    pub(crate) fn new(
        base: &Base,
        class_bits: u32,
        goal: Goal,
        check: CancelCheck<'_>,
    ) -> Result<Draft, EncodeError> {
        let mut lambda = match goal {
            // Where each bit halves the error's root, one is worth 1.4 times a coefficient's squared error.
            Goal::Psnr(psnr) => (1.4 * 255.0 * 255.0 * CHANNELS / 10f64.powf(psnr / 10.0)) as f32,
            Goal::Tolerance(tolerance) => (1.4 * CHANNELS * tolerance * tolerance / 4.0) as f32,
            Goal::Bpp(_) => FIRST_GUESS,
        };
        let mut draft = Draft::priced(base, class_bits, goal, lambda, Reach::Near, check)?;
        for _ in 0..ROUNDS {
            lambda = match goal {
                Goal::Tolerance(_) => lambda,
                _ => lambda_of(draft.index),
            };
            let next = Draft::priced(base, class_bits, goal, lambda, Reach::Near, check)?;
            if goal.prefers(&next.estimate, &draft.estimate) {
                draft = next;
            }
        }
        Ok(draft)
    }

    /// The same with a model for lambdas far from its own.
    pub(crate) fn widened(
        self,
        base: &Base,
        goal: Goal,
        check: CancelCheck<'_>,
    ) -> Result<Draft, EncodeError> {
        Draft::priced(base, self.model.class_bits, goal, self.lambda, Reach::Far, check)
    }

    fn priced(
        base: &Base,
        class_bits: u32,
        goal: Goal,
        lambda: f32,
        reach: Reach,
        check: CancelCheck<'_>,
    ) -> Result<Draft, EncodeError> {
        check.checkpoint()?;
        let model = train(&base.residuals.blocks, class_bits, lambda, reach);
        let coder = base.residuals.coder(model, Effort::Fast);
        let (index, estimate, classes) = match goal {
            Goal::Tolerance(tolerance) => {
                let classes = coder.likely(cell_limit(tolerance) * 4.0 / WORST_TO_MEAN);
                let mut estimate = estimate(base, &coder, &classes, goal);
                let crowded = share_of_largest(&classes) > CROWDED;
                estimate.worst_block_rms = if crowded { f64::MAX } else { tolerance };
                (FIRST_LAMBDA, estimate, classes)
            }
            _ => {
                let found = search_lambda(base, &coder, goal);
                (found.index, found.measured, found.value)
            }
        };
        let crowded = share_of_largest(&classes) > CROWDED;
        Ok(Draft { model: coder.model, lambda, index, estimate, crowded })
    }
}

/// The lambda that answers the goal best by what is known of the blocks.
pub(crate) fn search_lambda(base: &Base, coder: &Coder<'_>, goal: Goal) -> Found<Vec<u8>> {
    let range = FIRST_LAMBDA..=FIRST_LAMBDA + LAMBDAS;
    let found = search(goal, range, FIRST_LAMBDA + LAMBDAS / 2, 0.0, |number| {
        let classes = coder.choose(lambda_of(number));
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
    let sum = coder.error_of(classes, &base.residuals.counted);
    let count = CHANNELS * base.texels as f64;
    let error = SquaredError { sum: sum + ROUNDING * count + alpha, count: count as u64 };
    Measured {
        psnr: error.psnr(),
        bpp: base.bits(coder, classes) as f64 / base.texels as f64,
        worst_block_rms: 0.0,
    }
}
