//! Lambda, the error that a bit may cost, and the setting of it that reaches a goal.

use std::cell::RefCell;

use texfold_core::metric::measure_for;
use texfold_core::target::{Measured, search as find, search_step_estimated};
use texfold_core::{EncodeError, Goal, Job, SourceError};
use texfold_dct::encode::{STEPS, lambda_of, step_of};

use super::assemble::{assemble, draft};
use super::choose::{choose, choose_well};
use super::lambda_index::{LAMBDA_INDICES, TOLERANCE_LAMBDA_INDEX, lambda, lambda_index_of};
use super::plan::Plan;
use super::searched::EpitomeSearch;
use super::state::Choice;
use crate::EpitomeTexture;

/// Steps beyond the lambda index that reaches a goal at which smaller results are looked for.
const FINER: [u32; 4] = [6, 16, 40, 90];
/// Finer settings are not tried where a model's texture is larger than that of the best model by this factor, or
/// worse by so many dB: four crops came out the same without them.
const FAR_FACTOR: f64 = 1.03;
const FAR_DB: f64 = 0.3;
/// Steps where cells of content differ in bits: it is coded anew at each setting.
const FINER_WITH_ERRORS: [u32; 1] = [12];
/// A setting, what it measures and what it makes.
pub(super) struct Made {
    pub(super) lambda_index: u32,
    pub(super) measured: Measured,
    pub(super) texture: EpitomeTexture,
}

impl EpitomeSearch {
    /// The lambda index that should reach a goal.
    pub(super) fn likely_lambda_index(&self, goal: Goal, mut choose: impl FnMut(u32) -> Choice) -> u32 {
        if let Some(lambda) = self.coded_lambda {
            return lambda_index_of(lambda);
        }
        let texels = self.images.texel_count() as f64;
        match goal {
            Goal::Psnr(wanted) => {
                first_lambda_index(|lambda_index| choose(lambda_index).psnr(texels) >= wanted)
            }
            Goal::Bpp(bpp) => first_lambda_index(|lambda_index| choose(lambda_index).bits / texels >= bpp),
            // Within it errors are free, whatever the setting.
            Goal::Tolerance(_) => TOLERANCE_LAMBDA_INDEX,
        }
    }

    /// The lambda index that reaches a goal with one layer, and what it makes.
    ///
    /// It is looked for around that of another model's answer, `beaten`; where it is far from that one, finer
    /// settings are not tried.
    pub(super) fn setting(
        &self,
        goal: Goal,
        plan: &Plan<'_>,
        beaten: Option<&Made>,
        job: &mut Job<'_>,
    ) -> Result<Made, EncodeError> {
        if self.params.is_by_block() {
            return self.setting_in_blocks(goal, plan, job);
        }
        let cancel = plan.cancel;
        let problem =
            |lambda_index: u32| self.problem(plan.options, self.costs(plan.entry_bits, lambda_index), cancel);
        let nearly = |lambda_index: u32| choose(problem(lambda_index));
        let guess = beaten.map_or_else(
            || job.install(|| self.likely_lambda_index(goal, nearly)),
            |before| before.lambda_index,
        );
        job.checkpoint()?;
        let mut tried = 0u16;
        let make =
            |lambda_index: u32| assemble(plan, &[choose_well(problem(lambda_index))], lambda(lambda_index));
        let found = find(goal, LAMBDA_INDICES, guess, 0.0, |lambda_index| {
            job.stage("packing", (0.5 + 0.05 * f32::from(tried)).min(0.95))?;
            tried += 1;
            let made = job.install(|| make(lambda_index))?;
            Ok::<_, EncodeError>((measure_for(goal, &self.images, &made, cancel)?, made))
        })?;
        let mut best = Made { lambda_index: found.index, measured: found.measured, texture: found.value };
        if beaten.is_some_and(|before| is_far(goal, &best.measured, &before.measured)) {
            return Ok(best);
        }
        // What repeats is sometimes gathered better at a finer setting, and is smaller there.
        for &step in if self.coded_lambda.is_some() { &FINER_WITH_ERRORS[..] } else { &FINER } {
            job.checkpoint()?;
            let lambda_index = (found.index + step).min(*LAMBDA_INDICES.end());
            let texture = job.install(|| make(lambda_index))?;
            let measured = measure_for(goal, &self.images, &texture, cancel)?;
            if goal.prefers(&measured, &best.measured) {
                best = Made { lambda_index, measured, texture };
            }
        }
        Ok(best)
    }
}

impl EpitomeSearch {
    /// As [`EpitomeSearch::setting`] where content is in blocks of variable length: leaves are chosen at the lambda that content was
    /// searched at, and then the step is found that answers the goal.
    fn setting_in_blocks(&self, goal: Goal, plan: &Plan<'_>, job: &mut Job<'_>) -> Result<Made, EncodeError> {
        let cancel = plan.cancel;
        let problem =
            |lambda_index: u32| self.problem(plan.options, self.costs(plan.entry_bits, lambda_index), cancel);
        let lambda_index = self.likely_lambda_index(goal, |lambda_index| choose(problem(lambda_index)));
        let choices = [job.install(|| choose_well(problem(lambda_index)))];
        job.checkpoint()?;
        let first = step_of(f64::from(lambda(lambda_index)), 1.0);
        let draft = job.install(|| draft(plan, &choices, lambda(lambda_index)))?;
        let mut tried = 0u16;
        // Estimating and making take turns.
        let job = RefCell::new(job);
        let found = search_step_estimated(
            goal,
            STEPS.at(plan.effort),
            first,
            |step| job.borrow().install(|| draft.estimate(lambda_of(step) as f32)),
            |step| {
                let mut job = job.borrow_mut();
                job.stage("packing", (0.5 + 0.05 * f32::from(tried)).min(0.95))?;
                tried += 1;
                let made = job.install(|| draft.texture(lambda_of(step) as f32))?;
                let measured = measure_for(goal, &self.images, &made, cancel)?;
                Ok((made, measured))
            },
        )?;
        let found = found.ok_or(SourceError::Empty)?;
        Ok(Made { lambda_index, measured: found.measured, texture: found.value })
    }
}

/// Whether `measured` cannot become better than `other` by what finer settings gain.
fn is_far(goal: Goal, measured: &Measured, other: &Measured) -> bool {
    match goal {
        Goal::Bpp(_) => measured.psnr < other.psnr - FAR_DB,
        Goal::Psnr(_) | Goal::Tolerance(_) => measured.bpp > other.bpp * FAR_FACTOR,
    }
}

/// The first setting that is enough, or the last one.
fn first_lambda_index(mut is_enough: impl FnMut(u32) -> bool) -> u32 {
    let (mut low, mut high) = (*LAMBDA_INDICES.start(), *LAMBDA_INDICES.end());
    while low < high {
        let middle = (low + high) / 2;
        if is_enough(middle) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    low
}
