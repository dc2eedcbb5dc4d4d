//! The encoder on one page: the images, or smaller ones that are upsampled; bases of several kinds, the residuals that each leaves, the rate model and lambda under which a base with its residual plane answers the goal best, and the blocks
//! coded at that lambda in closed loop on the decoded base.

mod base;
mod details;
mod draft;
mod frame;
mod report;
mod search;

use std::sync::Arc;

use texfold_core::image::{ImageSet, PixelInfo};
use texfold_core::metric::{Quality, quality_cancellable};
use texfold_core::target::{Measured, search};
use texfold_core::{CancelCheck, Effort, EncodeError, Encoded, Goal, Job, Metric, Params, SourceError};
use texfold_residual::encode::{CLASS_BITS, Coder, TOO_LARGE, score};

use crate::{ProgressiveParams, ProgressiveTexture, Shared};
pub use search::ProgressiveSearch;

pub(crate) use base::tries_codebooks;
use base::{Base, BaseTexture, Kind, kinds};
use draft::{Draft, FIRST_LAMBDA, LAMBDAS, lambda_of};
use frame::{Frame, shrinks};
use report::notes;

/// PSNR in dB by which the draft of a smaller image with alpha may fall short of the best and still be coded: estimates count
/// alpha's error in the smaller image, where it weighs more beside that of colours than in the enlarged one.
const NEAR_DRAFT: f64 = 2.0;
/// How far, in lambda indices, a quality goal is looked for around the estimate, until it is met.
const REACHES: [u32; 3] = [24, 240, LAMBDAS];
/// Lambda indices that need not be told apart by coding: 2%, some 0.02 dB.
const CODED_STEP: f64 = 4.0 / FIRST_LAMBDA as f64;
/// Steps by which tolerances fall short of their limit, until rounding to 8 bits keeps to it.
const SLACKS: u32 = 8;
/// Share of the squared limit that each of these steps gives up: the last leaves 60% of it, 77% of the tolerance, which
/// is more room than rounding needs for any tolerance of at least 2 steps of 8 bits.
const SLACK_SHARE: f32 = 0.05;
/// Shares of a tolerance that further models are made for, where blocks have missed it: of the base that was tried, of
/// the finest base, and of that again with models for finer tolerances.
const FINER_SHARES: [f64; 4] = [1.0, 1.0, 0.5, 0.25];

/// Where frames and bases come from: made anew, or kept for several goals.
pub(crate) trait Parts {
    /// The images as they are coded, with so many finest levels left out.
    fn frame(&self, shrink_log2: u32, job: &Job<'_>) -> Result<Arc<Frame>, EncodeError>;

    /// The base of a kind for a goal for what is stored; `None` where no content is worth its bits.
    fn base(
        &self,
        frame: &Frame,
        kind: Kind,
        goal: Goal,
        job: &Job<'_>,
    ) -> Result<Option<Arc<Base>>, EncodeError>;
}

/// Parts for one goal.
struct Fresh<'a> {
    source: &'a ImageSet,
    params: &'a ProgressiveParams,
    shared: &'a Shared,
}

impl Parts for Fresh<'_> {
    fn frame(&self, shrink_log2: u32, job: &Job<'_>) -> Result<Arc<Frame>, EncodeError> {
        let (mips, apron, check) = (self.params.mips, self.shared.apron.as_ref(), job.cancel_check());
        job.install(|| Frame::new(self.source, mips, shrink_log2, apron, check)).map(Arc::new)
    }

    fn base(
        &self,
        frame: &Frame,
        kind: Kind,
        goal: Goal,
        job: &Job<'_>,
    ) -> Result<Option<Arc<Base>>, EncodeError> {
        let check = job.cancel_check();
        job.install(|| {
            let base_texture = BaseTexture::new(frame, kind, self.params.effort, self.shared, check)?;
            let metric = self.params.metric_for(self.source.info(), goal);
            Ok(base_texture.base(frame, base_texture.own_cells(goal), metric, check)?.map(Arc::new))
        })
    }
}

/// `shared` is a public codebook that may be used and added to.
pub(crate) fn encode(
    source: &ImageSet,
    params: &ProgressiveParams,
    shared: &Shared,
    job: &mut Job<'_>,
) -> Result<ProgressiveTexture, EncodeError> {
    params.check()?;
    source.check_images()?;
    Encoding { source, params, parts: &Fresh { source, params, shared } }.run(job)
}

/// One encoding.
struct Encoding<'a> {
    source: &'a ImageSet,
    params: &'a ProgressiveParams,
    parts: &'a dyn Parts,
}

impl Encoding<'_> {
    /// The best of the sizes that are tried.
    fn run(&self, job: &mut Job<'_>) -> Result<ProgressiveTexture, EncodeError> {
        let goal = self.params.goal;
        let mut sizes = shrinks(self.source, self.params);
        let by_bits = matches!(goal, Goal::Bpp(_));
        let metric = self.params.metric_for(self.source.info(), goal);
        if !by_bits {
            // The smallest first: where it answers, codebooks of the whole need not be tried.
            sizes.reverse();
        }
        let share = |index: usize| index as f32 / sizes.len() as f32;
        let mut best: Option<(ProgressiveTexture, Measured)> = None;
        for (index, &shrink_log2) in sizes.iter().enumerate() {
            let rival = best.as_ref().map(|(_, measured)| *measured);
            let made = job.within(share(index), share(index + 1), |job| {
                let frame = self.parts.frame(shrink_log2, job)?;
                if by_bits
                    && rival.is_some_and(|rival| goal.is_met(&rival) && !frame.may_beat(rival.psnr, metric))
                {
                    return Ok(None);
                }
                match frame.inner_goal(goal) {
                    Some(inner) => self.frame(&frame, inner, rival, job).map(Some),
                    None => Ok(None),
                }
            })?;
            let Some(made) = made else { continue };
            let check = job.cancel_check();
            let measured = job.install(|| own_score(self.source, &made, (goal, metric), check))?;
            if best.as_ref().is_none_or(|(_, best)| goal.prefers(&measured, best)) {
                best = Some((made, measured));
            }
        }
        let (made, measured) = best.ok_or(SourceError::Empty)?;
        job.checkpoint()?;
        let (met, check) = (goal.is_met(&measured), job.cancel_check());
        let notes = job.install(|| notes(self.source, &made, self.params, met, check))?;
        job.stage("done", 1.0)?;
        Ok(made.with_notes(notes))
    }

    /// The best texture of a frame. `inner` is the goal for what is stored, `rival` what another size has come to.
    fn frame(
        &self,
        frame: &Frame,
        inner: Goal,
        rival: Option<Measured>,
        job: &mut Job<'_>,
    ) -> Result<ProgressiveTexture, EncodeError> {
        let mut kinds = kinds(self.source.info(), &ProgressiveParams { goal: inner, ..self.params.clone() })?;
        // Codebooks hold detail of one scale.
        kinds.retain(|kind| frame.shrink_log2 == 0 || kind.side_log2.is_none());
        let mut drafted = self.drafts(frame, &kinds, inner, rival, job)?;
        if matches!(inner, Goal::Bpp(_)) {
            return self.best_finished(drafted, inner, job);
        }
        let Drafted { kind, base, draft } = drafted.swap_remove(0);
        let check = job.cancel_check();
        let draft = job.install(|| draft.widened(&base, inner, check))?;
        let largest = draft.model.class_bits == CLASS_BITS[1];
        let made = job.within(0.4, 0.7, |job| self.finish(&base, draft, inner, job))?;
        // A few blocks may need more bits than the estimates say; for a tolerance then a base that leaves less, and models
        // for finer ones.
        let finest = finest(&kinds, self.source.info());
        // As it is, a base serves once.
        let other = finest.filter(|&finest| finest != kind);
        let attempts = [Some(kind), other, finest, finest].into_iter().zip(FINER_SHARES);
        let count = if matches!(inner, Goal::Tolerance(_)) { FINER_SHARES.len() } else { 1 };
        let goal = self.params.goal;
        let mut best = (own_measure(self.source, &made, check)?, made);
        for (number, (attempt, share)) in (0u8..).zip(attempts).take(count).skip(usize::from(largest)) {
            if goal.is_met(&best.0) {
                break;
            }
            let base = match attempt {
                Some(attempt) if attempt == kind => Some(base.clone()),
                Some(attempt) => self.parts.base(frame, attempt, inner, job)?,
                None => None,
            };
            let Some(base) = base else { continue };
            let finer = finer(inner, share);
            let draft =
                job.install(|| Draft::new(&base, CLASS_BITS[1], finer, check)?.widened(&base, finer, check))?;
            let start = 0.7 + 0.075 * f32::from(number);
            let made = job.within(start, start + 0.075, |job| self.finish(&base, draft, inner, job))?;
            let measured = own_measure(self.source, &made, check)?;
            if goal.prefers(&measured, &best.0) {
                best = (measured, made);
            }
        }
        Ok(best.1)
    }

    /// The drafts that answer the goal best, the best first: one, but where estimates of alpha are of a smaller image those of
    /// all kinds that are near it.
    fn drafts(
        &self,
        frame: &Frame,
        kinds: &[Kind],
        inner: Goal,
        rival: Option<Measured>,
        job: &mut Job<'_>,
    ) -> Result<Vec<Drafted>, EncodeError> {
        let pixel = self.source.info();
        let enlarged_alpha = frame.shrink_log2 > 0 && pixel.has_extra() && matches!(inner, Goal::Bpp(_));
        let mut best: Option<Drafted> = None;
        let mut others = Vec::new();
        let mut best_holds_alpha = false;
        for (index, &kind) in kinds.iter().enumerate() {
            job.stage("trying bases", 0.4 * index as f32 / kinds.len() as f32)?;
            let known = best.as_ref().map(|best| best.draft.estimate);
            if [known, rival].iter().flatten().any(|known| kind.is_outdone(pixel, self.params.goal, known)) {
                continue;
            }
            let Some(base) = self.parts.base(frame, kind, inner, job)? else { continue };
            // Where none holds alpha as well as it should, the largest does so best.
            let holds_alpha = base.holds_alpha(inner);
            if !holds_alpha && (kind.reduce_log2 > 1 || best_holds_alpha) {
                continue;
            }
            let Some(draft) = best_draft(&base, inner, job)? else { continue };
            let drafted = Drafted { kind, base, draft };
            if holds_alpha && !best_holds_alpha {
                (best, best_holds_alpha) = (None, true);
            }
            let worse = match &best {
                Some(known) if !inner.prefers(&drafted.draft.estimate, &known.draft.estimate) => {
                    Some(drafted)
                }
                _ => best.replace(drafted),
            };
            others.extend(worse.filter(|_| enlarged_alpha));
        }
        let best = best.ok_or(TOO_LARGE)?;
        let least = best.draft.estimate.psnr - NEAR_DRAFT;
        others.retain(|other| inner.is_met(&other.draft.estimate) && other.draft.estimate.psnr > least);
        Ok(std::iter::once(best).chain(others).collect())
    }

    /// Of drafts for a goal of bits, the one that is best once its blocks are coded and it is enlarged.
    fn best_finished(
        &self,
        drafts: Vec<Drafted>,
        inner: Goal,
        job: &mut Job<'_>,
    ) -> Result<ProgressiveTexture, EncodeError> {
        let (goal, check) = (self.params.goal, job.cancel_check());
        let metric = self.params.metric_for(self.source.info(), goal);
        let count = drafts.len();
        let share = |index: usize| 0.4 + 0.6 * index as f32 / count as f32;
        let mut best: Option<(ProgressiveTexture, Measured)> = None;
        for (index, Drafted { base, draft, .. }) in drafts.into_iter().enumerate() {
            let draft = job.install(|| draft.widened(&base, inner, check))?;
            let made =
                job.within(share(index), share(index + 1), |job| self.finish(&base, draft, inner, job))?;
            if count == 1 {
                return Ok(made);
            }
            let measured = job.install(|| own_score(self.source, &made, (goal, metric), check))?;
            if best.as_ref().is_none_or(|(_, best)| goal.prefers(&measured, best)) {
                best = Some((made, measured));
            }
        }
        best.map(|(made, _)| made).ok_or(TOO_LARGE.into())
    }

    /// The base with its blocks coded at the lambda that the goal asks for; `inner` is the goal for what is stored.
    fn finish(
        &self,
        base: &Base,
        draft: Draft,
        inner: Goal,
        job: &mut Job<'_>,
    ) -> Result<ProgressiveTexture, EncodeError> {
        let goal = self.params.goal;
        // One block can miss a tolerance: each is worth a search for its scale.
        let effort = match goal {
            Goal::Tolerance(_) => self.params.effort.max(Effort::Normal),
            _ => self.params.effort,
        };
        let mut coder = base.residuals.coder(draft.model, effort);
        match goal {
            Goal::Psnr(_) => self.by_quality(base, &mut coder, draft.index, job),
            Goal::Bpp(_) => {
                job.stage("coding blocks", 0.0)?;
                code_at(&mut coder, draft.index, job)?;
                // What coding has measured of the blocks moves bits among them.
                job.stage("coding blocks", 0.7)?;
                let index = draft::search_lambda(base, &coder, inner).index;
                let classes = code_at(&mut coder, index, job)?;
                base.assemble(&coder, &classes)
            }
            Goal::Tolerance(tolerance) => self.within(base, &mut coder, tolerance, job),
        }
    }

    /// The highest lambda at which the decoded texture reaches the goal, from a guess of its index.
    fn by_quality(
        &self,
        base: &Base,
        coder: &mut Coder<'_>,
        guess: u32,
        job: &mut Job<'_>,
    ) -> Result<ProgressiveTexture, EncodeError> {
        let mut guess = guess;
        let check = job.cancel_check();
        let mut tried = 0u32;
        let mut last = None;
        for reach in REACHES {
            let start = guess.saturating_sub(reach).max(FIRST_LAMBDA);
            let end = (guess + reach).min(FIRST_LAMBDA + LAMBDAS);
            let found = search(self.params.goal, start..=end, guess, CODED_STEP, |index| {
                job.stage("coding blocks", tried as f32 / (tried as f32 + 4.0))?;
                tried += 1;
                let classes = code_at(coder, index, job)?;
                let made = base.assemble(coder, &classes)?;
                let measured = job.install(|| own_measure(self.source, &made, check))?;
                Ok::<_, EncodeError>((measured, made))
            })?;
            // The best lambda of a range lies inside it.
            let inside = found.met && found.index > start || start == FIRST_LAMBDA;
            guess = found.index;
            let done = inside && (found.met || end == FIRST_LAMBDA + LAMBDAS);
            last = Some(found.value);
            if done {
                break;
            }
        }
        last.ok_or(SourceError::Empty.into())
    }

    /// The least class for each block within the tolerance.
    fn within(
        &self,
        base: &Base,
        coder: &mut Coder<'_>,
        tolerance: f64,
        job: &mut Job<'_>,
    ) -> Result<ProgressiveTexture, EncodeError> {
        let check = job.cancel_check();
        let found = search(self.params.goal, 1..=SLACKS, 1, 0.0, |slack| {
            job.stage("coding blocks", (slack - 1) as f32 / SLACKS as f32)?;
            let limit = draft::cell_limit(tolerance) * (1.0 - SLACK_SHARE * slack as f32);
            let classes = job.install(|| coder.within(limit, check))?;
            let made = base.assemble(coder, &classes)?;
            let measured = job.install(|| own_measure(self.source, &made, check))?;
            Ok::<_, EncodeError>((measured, made))
        })?;
        Ok(found.value)
    }
}

/// A base and what it would come to.
struct Drafted {
    kind: Kind,
    base: Arc<Base>,
    draft: Draft,
}

/// Codes every block in the class that the lambda of that index gives it; the classes.
fn code_at(coder: &mut Coder<'_>, index: u32, job: &Job<'_>) -> Result<Vec<u8>, EncodeError> {
    let check = job.cancel_check();
    job.install(|| {
        let classes = coder.choose(lambda_of(index));
        coder.code(&classes, check).map(|()| classes)
    })
}

/// That share of a tolerance; other goals as they are.
fn finer(goal: Goal, share: f64) -> Goal {
    match goal {
        Goal::Tolerance(tolerance) => Goal::Tolerance(share * tolerance),
        _ => goal,
    }
}

/// The kind whose base has the most bits.
fn finest(kinds: &[Kind], pixel: PixelInfo) -> Option<Kind> {
    let plain = kinds.iter().copied().filter(|kind| kind.side_log2.is_none());
    plain.max_by(|a, b| a.base_bits(pixel).total_cmp(&b.base_bits(pixel)))
}

/// The better of the drafts with small and with large classes.
fn best_draft(base: &Base, goal: Goal, job: &Job<'_>) -> Result<Option<Draft>, EncodeError> {
    let check = job.cancel_check();
    let mut drafts = Vec::new();
    for class_bits in CLASS_BITS {
        let draft = job.install(|| Draft::new(base, class_bits, goal, check))?;
        let crowded = draft.crowded;
        drafts.push(draft);
        // Larger classes are for blocks that the largest of these is too small for.
        if !crowded {
            break;
        }
    }
    let better = |a: &Draft, b: &Draft| goal.prefers(&a.estimate, &b.estimate);
    Ok(drafts.into_iter().reduce(|a, b| if better(&b, &a) { b } else { a }))
}

/// Quality of colours, and size without what is shared: alpha is that of the base, however blocks are coded.
fn own_measure(
    source: &ImageSet,
    texture: &ProgressiveTexture,
    check: CancelCheck<'_>,
) -> Result<Measured, EncodeError> {
    let Quality { color, worst_block_rms, .. } = quality_cancellable(source, texture, check)?;
    Ok(Measured { psnr: color.psnr(), bpp: own_bpp(source, texture), worst_block_rms })
}

/// Bits a texel of the source, without what is shared.
fn own_bpp(source: &ImageSet, texture: &ProgressiveTexture) -> f64 {
    (texture.memory().goal - texture.shared_bits()) as f64 / source.texel_count() as f64
}

/// Measurements for the goal, with the bits of [`own_bpp`].
fn own_score(
    source: &ImageSet,
    texture: &ProgressiveTexture,
    by: (Goal, Metric),
    check: CancelCheck<'_>,
) -> Result<Measured, EncodeError> {
    Ok(Measured { bpp: own_bpp(source, texture), ..score(source, texture, by, check)?.by_goal })
}
