//! The smallest form whose every block is within a tolerance (paper section 4).

use texfold_bc::Content;
use texfold_core::metric::measure_for;
use texfold_core::target::Measured;
use texfold_core::{CancelCheck, EncodeError, Goal, Job};

use super::assemble::assemble;
use super::choose::improve;
use super::growth::grow;
use super::lambda_index::TOLERANCE_LAMBDA_INDEX;
use super::models::{MOST_LINEARS, Model};
use super::plan::Plan;
use super::relative::worst_relative_error;
use super::report;
use super::searched::{ENTRY_BITS, EpitomeSearch};
use super::state::{Choice, Options};
use crate::{EpitomeTexture, ToleranceKind};

/// Most 2x2 matrices where charts are rotated to fit: each may be needed in eight orientations.
const ROTATED_LINEARS: usize = 32;
/// Shares of the tolerance that candidates are held to.
const TOLERANCE_SHARES: [f32; 3] = [1.0, 0.75, 0.4];

/// Choices that cover every block of all images.
pub(super) struct Covers {
    by_cost: Choice,
    /// Where blocks have one side.
    grown: Option<Choice>,
}

impl Covers {
    /// The one of fewer bits.
    pub(super) fn smallest(&self) -> &Choice {
        self.grown.as_ref().filter(|grown| grown.bits < self.by_cost.bits).unwrap_or(&self.by_cost)
    }
}

/// A form and what it measures.
struct Candidate {
    measured: Measured,
    texture: EpitomeTexture,
}

/// Which candidates leaves may have, and whether charts are rotated.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Trial {
    /// Share of the tolerance that candidates are held to.
    share: f32,
    orientations: bool,
}

impl EpitomeSearch {
    /// The smallest form whose every block is within a tolerance. Charts of more candidates may pack worse than
    /// charts of fewer, so several sets of candidates are packed, and each set is covered in two ways; raw charts
    /// also rotated to fit, which takes bits for 2x2 matrices.
    pub(super) fn within(&self, tolerance: f64, job: &mut Job<'_>) -> Result<EpitomeTexture, EncodeError> {
        let goal = Goal::Tolerance(tolerance);
        let [first, others @ ..] = TOLERANCE_SHARES;
        let mut trial = Trial { share: first, orientations: false };
        let mut best = self.covered(tolerance, trial, job)?;
        let mut improve = |tried: Trial, best: &mut Candidate| {
            let made = self.covered(tolerance, tried, job)?;
            let is_better = goal.prefers(&made.measured, &best.measured);
            if is_better {
                *best = made;
            }
            Ok::<bool, EncodeError>(is_better)
        };
        for share in others {
            let tried = Trial { share, ..trial };
            if improve(tried, &mut best)? {
                trial = tried;
            }
        }
        // Charts are rotated for the candidates that are best as they are: all of them would take twice the time.
        if self.space.stored.iter().all(|stored| stored.content == Content::Raw) {
            improve(Trial { orientations: true, ..trial }, &mut best)?;
        }
        Ok(best.texture)
    }

    /// The better form of such candidates whose every block is within a tolerance.
    fn covered(&self, tolerance: f64, trial: Trial, job: &mut Job<'_>) -> Result<Candidate, EncodeError> {
        job.checkpoint()?;
        let cancel = job.cancel_check();
        job.install(|| {
            let matrices = if trial.orientations { ROTATED_LINEARS } else { MOST_LINEARS };
            let rules = self.rules(Some(tolerance as f32 * trial.share));
            let Model { options, palettes, entry_bits } = self.whole(matrices, &rules, cancel);
            let plan = Plan {
                orientations: trial.orientations,
                ..self.plan(&options, &palettes, entry_bits, cancel)
            };
            let Covers { by_cost, grown } = self.covers(&options, cancel);
            let mut best = self.made(&plan, by_cost, tolerance)?;
            if let Some(grown) = grown {
                let other = self.made(&plan, grown, tolerance)?;
                if Goal::Tolerance(tolerance).prefers(&other.measured, &best.measured) {
                    best = other;
                }
            }
            Ok(best)
        })
    }

    fn made(&self, plan: &Plan<'_>, choice: Choice, tolerance: f64) -> Result<Candidate, EncodeError> {
        let verdict = report::verdict(&self.grid, plan.options, &choice, true);
        let texture = assemble(plan, &[choice], 0.0)?;
        let texture = texture.with_notes(report::notes(&self.params, Goal::Tolerance(tolerance), verdict));
        let mut measured = measure_for(Goal::Tolerance(tolerance), &self.images, &texture, plan.cancel)?;
        if self.params.tolerance_kind == ToleranceKind::Relative {
            measured.worst_block_rms =
                worst_relative_error(&self.images, &texture, self.params.tolerance_block());
        }
        Ok(Candidate { measured, texture })
    }

    /// Few cells that cover every block: chosen by costs, and, where blocks have one side, grown greedily and
    /// improved.
    pub(super) fn covers(&self, options: &Options, cancel: CancelCheck<'_>) -> Covers {
        let by_cost = self.choose(options, TOLERANCE_LAMBDA_INDEX, cancel);
        let grown = (!self.grid.split).then(|| {
            let side = self.space.stored[0].cell;
            let grown = grow(&self.grid, options, self.space.cells(), side * side, cancel);
            improve(self.problem(options, self.costs(ENTRY_BITS, TOLERANCE_LAMBDA_INDEX), cancel), &grown)
        });
        Covers { by_cost, grown }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Epitome, EpitomeParams, EpitomeSource};
    use texfold_core::SharedSearch;
    use texfold_core::image::ImageSet;

    #[test]
    fn rotated_charts_show_what_they_hold() {
        let images = ImageSet::single(texfold_testkit::image("facade"));
        let goal = Goal::Tolerance(20.0);
        let params = EpitomeParams::new(goal).with_effort(texfold_core::Effort::Fast);
        let mut job = Job::default();
        let searched = Epitome::search(EpitomeSource::new(&images), &params, &mut job).unwrap();
        let made = searched.covered(20.0, Trial { share: 1.0, orientations: true }, &mut job).unwrap();
        assert!(goal.is_met(&made.measured), "{:?}", made.measured);
        // Columns of a leaf lie in rows of the epitome: nothing is rotated so far in a search at effort fast.
        let rotated =
            made.texture.matrices().iter().filter(|matrix| matrix[0].abs() < matrix[1].abs()).count();
        assert!(rotated > 0);
    }
}
