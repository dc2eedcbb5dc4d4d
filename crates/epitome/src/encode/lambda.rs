//! Lambda, the error that a bit may cost, and the setting of it that reaches a goal.

use std::ops::RangeInclusive;

use texfold_core::metric::measure;
use texfold_core::target::{Measured, search as find};
use texfold_core::{EncodeError, Goal, Job};

use super::assemble::assemble;
use super::choose::{choose, choose_well};
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
/// Steps where content has a residual plane: it is coded anew at each setting.
const FINER_WITH_ERRORS: [u32; 1] = [12];
/// Lambda indices in an octave.
const KNOBS_AN_OCTAVE: f32 = 32.0;
/// Binary logarithm of lambda at lambda index 0, above which nothing is coded any more.
const LARGEST_LOG2: f32 = 14.0;
/// Lambda indices.
pub(super) const KNOBS: RangeInclusive<u32> = 1..=544;
/// The setting under which only bits count, for tolerances: within them errors are free.
pub(super) const TOLERANCE_KNOB: u32 = 96;

/// A setting, what it measures and what it makes.
pub(super) struct Made {
    pub(super) knob: u32,
    pub(super) measured: Measured,
    pub(super) texture: EpitomeTexture,
}

/// Error that a bit may cost at lambda index `knob`, 8-bit squared units.
pub(super) fn lambda(knob: u32) -> f32 {
    (LARGEST_LOG2 - knob as f32 / KNOBS_AN_OCTAVE).exp2()
}

/// The setting nearest to a price.
pub(super) fn knob_of(lambda: f32) -> u32 {
    let knob = (KNOBS_AN_OCTAVE * (LARGEST_LOG2 - lambda.log2())).round().max(0.0) as u32;
    knob.clamp(*KNOBS.start(), *KNOBS.end())
}

impl EpitomeSearch {
    /// The lambda index that should reach a goal.
    pub(super) fn likely_knob(&self, goal: Goal, mut choose: impl FnMut(u32) -> Choice) -> u32 {
        if let Some(price) = self.price {
            return knob_of(price);
        }
        let texels = self.images.texel_count() as f64;
        match goal {
            Goal::Psnr(wanted) => first_knob(|knob| choose(knob).psnr(texels) >= wanted),
            Goal::Bpp(bpp) => first_knob(|knob| choose(knob).bits / texels >= bpp),
            // Within it errors are free, whatever the setting.
            Goal::Tolerance(_) => TOLERANCE_KNOB,
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
        let cancel = plan.cancel;
        let problem = |knob: u32| self.problem(plan.options, self.costs(plan.entry_bits, knob), cancel);
        let nearly = |knob: u32| choose(problem(knob));
        let guess =
            beaten.map_or_else(|| job.install(|| self.likely_knob(goal, nearly)), |before| before.knob);
        job.checkpoint()?;
        let mut tried = 0u16;
        let make = |knob: u32| assemble(plan, &[choose_well(problem(knob))], lambda(knob));
        let found = find(goal, KNOBS, guess, 0.0, |knob| {
            job.stage("packing", (0.5 + 0.05 * f32::from(tried)).min(0.95))?;
            tried += 1;
            let made = job.install(|| make(knob))?;
            Ok::<_, EncodeError>((measure(&self.images, &made), made))
        })?;
        let mut best = Made { knob: found.knob, measured: found.measured, texture: found.value };
        if beaten.is_some_and(|before| is_far(goal, &best.measured, &before.measured)) {
            return Ok(best);
        }
        // What repeats is sometimes gathered better at a finer setting, and is smaller there.
        for &step in if self.price.is_some() { &FINER_WITH_ERRORS[..] } else { &FINER } {
            job.checkpoint()?;
            let knob = (found.knob + step).min(*KNOBS.end());
            let texture = job.install(|| make(knob))?;
            let measured = measure(&self.images, &texture);
            if goal.prefers(&measured, &best.measured) {
                best = Made { knob, measured, texture };
            }
        }
        Ok(best)
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
fn first_knob(mut is_enough: impl FnMut(u32) -> bool) -> u32 {
    let (mut low, mut high) = (*KNOBS.start(), *KNOBS.end());
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
