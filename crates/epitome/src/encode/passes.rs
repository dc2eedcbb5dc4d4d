//! The search in rounds: matches are looked for in what was kept of the round before, and palettes fitted to all of
//! them.

use texfold_core::{CancelCheck, Effort, EncodeError, Goal, Job, SourceError};

use super::candidate::{Rules, ScaleErrors};
use super::choose::{choose_well, most_errors};
use super::lambda_index::lambda_index_of;
use super::leaf::Node;
use super::models::MOST_LINEARS;
use super::options::direct_options;
use super::relative;
use super::search::{Allowed, Reach, search};
use super::searched::{ENTRY_BITS, EpitomeSearch};
use super::state::{Choice, Options};
use crate::ToleranceKind;

/// Times that matches are searched for.
const PASSES: usize = 2;
/// Times that matches are searched for within a tolerance, by effort: each search is in what the one before has led
/// to.
const TOLERANCE_PASSES: [usize; 3] = [2, 3, 6];
/// Part of the cells that several leaves read after the first search below which a second one is left out where time is short, and
/// a search that must find shared content ends.
const LEAST_SHARED: f64 = 1.0 / 32.0;
/// Largest step of that lambda at once, as a factor.
const MOST_RETUNED: f64 = 4.0;
/// Least change of that lambda for which content is stored anew, as a factor.
const LEAST_RETUNED: f32 = 1.05;
/// The same where time is short.
const LEAST_RETUNED_QUICK: f32 = 1.6;

impl EpitomeSearch {
    /// Looks for matches in the content that is kept so far, then again in what is kept with them. Within a
    /// tolerance, and where content is restricted, any content may be kept.
    pub(super) fn search(&mut self, job: &mut Job<'_>) -> Result<(), EncodeError> {
        if !self.params.transforms.references {
            return Ok(());
        }
        let cancel = job.cancel_check();
        let (direct, own) =
            job.install(|| direct_options(&self.space, &self.grid, &Rules::default(), cancel));
        job.checkpoint()?;
        if self.covers_blocks() || self.allowed.is_some() {
            self.search_any(&own, job)
        } else {
            self.search_kept(&direct, &own, job)
        }
    }

    /// Matches in any content that is allowed; within a tolerance then again in what covers the images with them.
    fn search_any(&mut self, own: &[ScaleErrors], job: &mut Job<'_>) -> Result<(), EncodeError> {
        let reach = Reach::of(&self.params, self.images.texel_count());
        let errors = self.any_errors();
        let allowed = Allowed { cells: self.allowed.as_deref(), shared: None, errors: &errors, own };
        // The part that content is to come from may lie anywhere.
        let reach = Reach { part: reach.part.filter(|_| self.allowed.is_none()), ..reach };
        search(&self.space, &self.grid, reach, &allowed, &mut self.matches, job)?;
        let (Goal::Tolerance(tolerance), None) = (self.params.goal, &self.allowed) else { return Ok(()) };
        let cancel = job.cancel_check();
        for _ in 1..TOLERANCE_PASSES[self.params.effort as usize] {
            let rules = self.rules(Some(tolerance as f32));
            let kept = job.install(|| {
                let covers = self.covers(&self.whole(MOST_LINEARS, &rules, cancel).options, cancel);
                Kept::of(covers.smallest())
            });
            job.checkpoint()?;
            let reach = Reach { part: None, ..reach };
            search(&self.space, &self.grid, reach, &kept.allowed(&errors, own), &mut self.matches, job)?;
        }
        Ok(())
    }

    /// Matches in what is kept of each image's own content, then again in what is kept with them.
    fn search_kept(
        &mut self,
        direct: &Options,
        own: &[ScaleErrors],
        job: &mut Job<'_>,
    ) -> Result<(), EncodeError> {
        let reach = Reach::of(&self.params, self.images.texel_count());
        let cancel = job.cancel_check();
        for pass in 0..PASSES {
            let share = |pass: usize| pass as f32 / PASSES as f32;
            job.stage("choosing content", share(pass))?;
            if pass > 0 {
                job.install(|| self.retune(cancel))?;
            }
            let (kept, errors) = job.install(|| {
                let whole = (pass > 0).then(|| self.whole(MOST_LINEARS, &self.rules(None), cancel).options);
                let options = whole.as_ref().unwrap_or(direct);
                let lambda_index = self.likely_lambda_index(self.params.goal, |lambda_index| {
                    self.choose(options, lambda_index, cancel)
                });
                let costs = self.costs(ENTRY_BITS, lambda_index);
                let choice = choose_well(self.problem(options, costs, cancel));
                (Kept::of(&choice), most_errors(self.problem(direct, costs, cancel)))
            });
            job.checkpoint()?;
            if pass > 0 && kept.shared_part() < LEAST_SHARED {
                if self.needs_shared {
                    return Err(SourceError::OutOfReach { what: "hardly any content recurs" }.into());
                }
                if self.is_quick() {
                    break;
                }
            }
            // What parts of large images keep of their own is then searched as a whole.
            let reach = Reach { part: reach.part.filter(|_| pass == 0), ..reach };
            job.within(share(pass), share(pass + 1), |job| {
                search(&self.space, &self.grid, reach, &kept.allowed(&errors, own), &mut self.matches, job)
            })?;
        }
        job.install(|| self.retune(cancel))?;
        job.checkpoint()
    }

    /// Whether time is short, and content in blocks of variable length.
    fn is_quick(&self) -> bool {
        self.params.effort == Effort::Fast && self.params.is_by_block()
    }

    /// Where cells of content differ in bits: codes it anew at the lambda that the goal seems to ask for.
    fn retune(&mut self, cancel: CancelCheck<'_>) -> Result<(), EncodeError> {
        let Some(lambda) = self.coded_lambda else { return Ok(()) };
        let texels = self.images.texel_count() as f64;
        let whole = self.whole(MOST_LINEARS, &self.rules(None), cancel).options;
        let choice = self.choose(&whole, lambda_index_of(lambda), cancel);
        let factor = match self.params.goal {
            Goal::Psnr(wanted) => 10f64.powf((choice.psnr(texels) - wanted) / 10.0),
            Goal::Bpp(bpp) => (choice.bits / texels / bpp).powi(2),
            Goal::Tolerance(_) => 1.0,
        };
        let factor = factor.clamp(1.0 / MOST_RETUNED, MOST_RETUNED) as f32;
        let least = if self.is_quick() { LEAST_RETUNED_QUICK } else { LEAST_RETUNED };
        cancel.checkpoint()?;
        if factor.max(1.0 / factor) >= least && self.space.store_again(lambda * factor, cancel)? {
            self.cell_bits = self.space.cell_bits();
            self.shares = self.space.shares();
            self.coded_lambda = Some(lambda * factor);
        }
        Ok(())
    }

    /// For each node the squared error that a match may have: what the tolerance allows, or any.
    fn any_errors(&self) -> Vec<f32> {
        let most = |node: Node| match (self.params.goal, self.params.tolerance_kind) {
            (Goal::Tolerance(tolerance), ToleranceKind::Absolute) => (tolerance * tolerance) as f32,
            (Goal::Tolerance(tolerance), ToleranceKind::Relative) => {
                tolerance as f32 * relative::scale(&node.texels(&self.space)) * 255.0 * 255.0
            }
            (Goal::Psnr(_) | Goal::Bpp(_), _) => 255.0 * 255.0,
        };
        let of_node = |node: Node| 3.0 * most(node) * node.side.pow(2) as f32;
        (0..self.grid.nodes()).map(|index| of_node(self.grid.node(index))).collect()
    }
}

/// Cells that a choice keeps.
struct Kept {
    cells: Vec<bool>,
    /// Those that several leaves read.
    shared: Vec<bool>,
}

impl Kept {
    fn of(choice: &Choice) -> Self {
        Kept {
            cells: choice.users.iter().map(|&users| users > 0).collect(),
            shared: choice.users.iter().map(|&users| users > 1).collect(),
        }
    }

    /// Cells that several leaves read, as a part of all.
    fn shared_part(&self) -> f64 {
        let count = |cells: &[bool]| cells.iter().filter(|&&is| is).count() as f64;
        count(&self.shared) / count(&self.cells).max(1.0)
    }

    /// Content may come from these cells.
    fn allowed<'a>(&'a self, errors: &'a [f32], own: &'a [ScaleErrors]) -> Allowed<'a> {
        Allowed { cells: Some(&self.cells), shared: Some(&self.shared), errors, own }
    }
}
