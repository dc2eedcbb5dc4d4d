//! The form that answers a goal of quality or size: of several models the one that the goal prefers.

use texfold_core::{EncodeError, Goal, Job};

use super::choose::choose_well;
use super::ladder::Answer;
use super::lambda::Made;
use super::models::{Form, Model};
use super::report;
use super::seam::with_widest_seam;
use super::searched::EpitomeSearch;
use crate::EpitomeTexture;

impl EpitomeSearch {
    /// The form that answers a goal of quality or size.
    pub(super) fn reaching(&self, goal: Goal, job: &mut Job<'_>) -> Result<EpitomeTexture, EncodeError> {
        let (first, others) = self.models();
        let share = |index: usize| index as f32 / (1 + others.len()) as f32;
        let mut best = job.within(0.0, share(1), |job| self.answer(goal, first, None, job))?;
        for (index, &model) in (1..).zip(others) {
            let beaten = Some(&best.made);
            let answer =
                job.within(share(index), share(index + 1), |job| self.answer(goal, model, beaten, job))?;
            if goal.prefers(&answer.made.measured, &best.made.measured) {
                best = answer;
            }
        }
        if self.params.layers > 1 {
            return self.in_layers(goal, best, job);
        }
        let cancel = job.cancel_check();
        let made = job.install(|| with_widest_seam(&self.images, best.made.texture, cancel))?;
        Ok(made.with_notes(report::notes(&self.params, goal, best.verdict)))
    }

    /// The best that one model makes for a goal.
    fn answer(
        &self,
        goal: Goal,
        model: Form,
        beaten: Option<&Made>,
        job: &mut Job<'_>,
    ) -> Result<Answer, EncodeError> {
        let cancel = job.cancel_check();
        let Model { options, palettes, entry_bits } = job.install(|| self.model(model, cancel));
        job.checkpoint()?;
        let made = self.setting(goal, &self.plan(&options, &palettes, entry_bits, cancel), beaten, job)?;
        let choice = choose_well(self.problem(&options, self.costs(entry_bits, made.lambda_index), cancel));
        job.checkpoint()?;
        let verdict = report::verdict(&self.grid, &options, &choice, goal.is_met(&made.measured));
        Ok(Answer { model, made, verdict })
    }
}
