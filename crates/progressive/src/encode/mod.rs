//! The encoder on one page: the images, or smaller ones that are enlarged; bases of several kinds, what each lacks, the model and price of bits under which a base with its error
//! map answers the goal best, and the blocks coded at that price in closed loop on the decoded base.

mod around;
mod base;
mod coder;
mod details;
mod draft;
mod error;
mod frame;
mod model;
mod plane;
mod report;
mod search;
mod trellis;

use std::sync::Arc;

use texfold_core::image::{ImageSet, PixelInfo};
use texfold_core::metric::{SquaredError, alpha_error, color_error, decode_surface, measure};
use texfold_core::target::{Measured, search};
use texfold_core::{Effort, EncodeError, Goal, Job, Params, SourceError};

use crate::{ProgressiveParams, ProgressiveTexture, Shared};
pub use plane::PlaneForm;
pub use search::ProgressiveSearch;

pub(crate) use base::tries_codebooks;
use base::{Base, Ground, Kind, kinds};
use coder::Coder;
use draft::{Draft, FIRST_PRICE, PRICES, price};
use frame::{Frame, shrinks};
use report::notes;

/// How far, in prices, a quality goal is looked for around the estimate, until it is met.
const REACHES: [u32; 3] = [24, 240, PRICES];
/// Prices that need not be told apart by coding: 2%, some 0.02 dB.
const CODED_STEP: f64 = 4.0 / FIRST_PRICE as f64;
/// Bits of a block of class 1 that are tried.
const CLASS_BITS: [u32; 2] = [16, 32];
/// Parts of the limit by which tolerances fall short of it, until rounding to 8 bits keeps to it.
const SLACKS: u32 = 8;

/// `shared` is a public codebook that may be shown and added to.
pub(crate) fn encode(
    source: &ImageSet,
    params: &ProgressiveParams,
    shared: &Shared,
    job: &mut Job<'_>,
) -> Result<ProgressiveTexture, EncodeError> {
    params.check()?;
    source.check_sides()?;
    let frame = |shrink_log2: u32, job: &Job<'_>| {
        Arc::new(job.install(|| Frame::new(source, params.mips, shrink_log2, shared.around.as_ref())))
    };
    let base = |frame: &Frame, kind: Kind, goal: Goal, job: &Job<'_>| {
        job.install(|| {
            let ground = Ground::new(frame, kind, (params.effort, shared))?;
            ground.base(frame, ground.own_cells(goal)).map(Arc::new)
        })
    };
    encode_with(source, params, (&frame, &base), job)
}

/// Makes the images as they are coded, so many levels of them left out.
type MakeFrame<'m> = dyn Fn(u32, &Job<'_>) -> Arc<Frame> + 'm;
/// Makes the base of a kind for a goal for what is stored, where there is one.
type MakeBase<'m> = dyn Fn(&Frame, Kind, Goal, &Job<'_>) -> Option<Arc<Base>> + 'm;

/// The best of the sizes that are tried.
fn encode_with(
    source: &ImageSet,
    params: &ProgressiveParams,
    (frame, base): (&MakeFrame<'_>, &MakeBase<'_>),
    job: &mut Job<'_>,
) -> Result<ProgressiveTexture, EncodeError> {
    let sizes = shrinks(source, params);
    let share = |index: usize| index as f32 / sizes.len() as f32;
    let mut best: Option<(ProgressiveTexture, Measured)> = None;
    // The smallest first: where it answers, codebooks of the whole need not be tried.
    for (index, &shrink_log2) in sizes.iter().rev().enumerate() {
        let rival = best.as_ref().map(|(_, measured)| *measured);
        let made = job.within(share(index), share(index + 1), |job| {
            let frame = frame(shrink_log2, job);
            let goal = frame.inner_goal(params.goal);
            goal.map(|goal| encode_frame(source, params, (&frame, goal, rival), base, job))
        });
        let Some(made) = made else { continue };
        let made = made?;
        let measured = job.install(|| judged(source, &made, params.goal));
        if best.as_ref().is_none_or(|(_, best)| params.goal.prefers(&measured, best)) {
            best = Some((made, measured));
        }
    }
    let (made, measured) = best.ok_or(SourceError::Empty)?;
    let notes = notes(source, &made, params, params.goal.is_met(&measured));
    job.stage("done", 1.0)?;
    Ok(made.with_notes(notes))
}

/// `inner` is the goal for what is stored, `rival` what another size has come to.
fn encode_frame(
    source: &ImageSet,
    params: &ProgressiveParams,
    (frame, inner, rival): (&Frame, Goal, Option<Measured>),
    make: &MakeBase<'_>,
    job: &mut Job<'_>,
) -> Result<ProgressiveTexture, EncodeError> {
    let mut kinds = kinds(source.info(), &ProgressiveParams { goal: inner, ..params.clone() })?;
    // Codebooks hold detail of one scale.
    kinds.retain(|kind| frame.shrink_log2 == 0 || kind.side_log2.is_none());
    let mut best: Option<(Kind, Arc<Base>, Draft)> = None;
    for (index, &kind) in kinds.iter().enumerate() {
        job.stage("trying bases", 0.4 * index as f32 / kinds.len() as f32)?;
        let known = best.as_ref().map(|(_, _, draft)| draft.estimate);
        if [known, rival].iter().flatten().any(|known| kind.is_outdone(source.info(), params.goal, known)) {
            continue;
        }
        let Some(base) = make(frame, kind, inner, job) else { continue };
        // Where none shows alpha as well as it should, the largest does so best.
        if kind.reduce_log2 > 1 && !base.shows_alpha(inner) {
            continue;
        }
        let Some(draft) = best_draft(&base, inner, job) else { continue };
        if best.as_ref().is_none_or(|(_, _, best)| inner.prefers(&draft.estimate, &best.estimate)) {
            best = Some((kind, base, draft));
        }
    }
    let (kind, base, draft) = best.ok_or(SourceError::Full { what: "a plane of 8192 x 8192 words" })?;
    let draft = job.install(|| draft.widened(&base, inner));
    let largest = draft.model.class_bits == CLASS_BITS[1];
    let goals = (params.goal, inner);
    let made = job.within(0.4, 0.7, |job| finish(source, &base, draft, (params.effort, goals), job))?;
    if matches!(inner, Goal::Bpp(_)) {
        return Ok(made);
    }
    // A few blocks may need more bits than the estimates say; for a tolerance then a base that lacks less, and models for finer ones.
    let finest = finest(&kinds, source.info());
    // As it is, a base serves once.
    let other = finest.filter(|&finest| finest != kind);
    let attempts = [(Some(kind), 1.0), (other, 1.0), (finest, 0.5), (finest, 0.25)];
    let count = if matches!(inner, Goal::Tolerance(_)) { attempts.len() } else { 1 };
    let mut best = (own_measure(source, &made), made);
    for (number, (attempt, share)) in (0u8..).zip(attempts).take(count).skip(usize::from(largest)) {
        if params.goal.is_met(&best.0) {
            break;
        }
        let base = match attempt {
            Some(attempt) if attempt == kind => Some(base.clone()),
            Some(attempt) => make(frame, attempt, inner, job),
            None => None,
        };
        let Some(base) = base else { continue };
        let finer = finer(inner, share);
        let draft = job.install(|| Draft::new(&base, CLASS_BITS[1], finer).widened(&base, finer));
        let start = 0.7 + 0.075 * f32::from(number);
        let made = job
            .within(start, start + 0.075, |job| finish(source, &base, draft, (params.effort, goals), job))?;
        let measured = own_measure(source, &made);
        if params.goal.prefers(&measured, &best.0) {
            best = (measured, made);
        }
    }
    Ok(best.1)
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
fn best_draft(base: &Base, goal: Goal, job: &Job<'_>) -> Option<Draft> {
    let mut drafts = Vec::new();
    for class_bits in CLASS_BITS {
        let draft = job.install(|| Draft::new(base, class_bits, goal));
        let crowded = draft.crowded;
        drafts.push(draft);
        // Larger classes are for blocks that the largest of these is too small for.
        if !crowded {
            break;
        }
    }
    let better = |a: &Draft, b: &Draft| goal.prefers(&a.estimate, &b.estimate);
    drafts.into_iter().reduce(|a, b| if better(&b, &a) { b } else { a })
}

/// Quality and size, without what is shared.
fn own_measure(source: &ImageSet, texture: &ProgressiveTexture) -> Measured {
    let mut measured = measure(source, texture);
    measured.bpp -= texture.shared_bits() as f64 / source.texel_count() as f64;
    measured
}

/// The same, and where bits are given with alpha's error beside that of the colours.
fn judged(source: &ImageSet, texture: &ProgressiveTexture, goal: Goal) -> Measured {
    let measured = own_measure(source, texture);
    if !matches!(goal, Goal::Bpp(_)) || !source.info().has_alpha() {
        return measured;
    }
    let mut sum = SquaredError::default();
    for (surface, image) in (0..).zip(source.images()) {
        let Some(shown) = decode_surface(texture, surface, 0) else { continue };
        let alpha = alpha_error(image, &shown).map_or(0.0, |error| error.sum);
        sum = sum + color_error(image, &shown) + SquaredError { sum: alpha, count: 0 };
    }
    Measured { psnr: sum.psnr(), ..measured }
}

/// The base with its blocks coded at the price that the goal for the images asks for; the other is the one for what is stored.
fn finish(
    source: &ImageSet,
    base: &Base,
    draft: Draft,
    (effort, (goal, inner)): (Effort, (Goal, Goal)),
    job: &mut Job<'_>,
) -> Result<ProgressiveTexture, EncodeError> {
    // One block can miss a tolerance: each is worth a search for its scale.
    let effort = match goal {
        Goal::Tolerance(_) => effort.max(Effort::Normal),
        _ => effort,
    };
    let mut coder = Coder::new(&base.blocks, draft.model, effort);
    match goal {
        Goal::Psnr(_) => by_quality(source, base, &mut coder, draft.number, goal, job),
        Goal::Bpp(_) => {
            job.stage("coding blocks", 0.0)?;
            let classes = coder.choose(price(draft.number));
            coder.code(&classes, job)?;
            // What coding has shown of the blocks moves bits among them.
            job.stage("coding blocks", 0.7)?;
            let number = draft::search_price(base, &coder, inner).knob;
            let classes = coder.choose(price(number));
            coder.code(&classes, job)?;
            base.assemble(&coder, &classes)
        }
        Goal::Tolerance(tolerance) => within(source, base, &mut coder, tolerance, job),
    }
}

/// The highest price at which the decoded texture reaches the goal.
fn by_quality(
    source: &ImageSet,
    base: &Base,
    coder: &mut Coder<'_>,
    guess: u32,
    goal: Goal,
    job: &mut Job<'_>,
) -> Result<ProgressiveTexture, EncodeError> {
    let mut guess = guess;
    let mut tried = 0u32;
    let mut last = None;
    for reach in REACHES {
        let range = guess.saturating_sub(reach).max(FIRST_PRICE)..=(guess + reach).min(FIRST_PRICE + PRICES);
        let end = *range.end();
        let start = *range.start();
        let found = search(goal, range, guess, CODED_STEP, |number| {
            job.stage("coding blocks", tried as f32 / (tried as f32 + 4.0))?;
            tried += 1;
            let classes = coder.choose(price(number));
            coder.code(&classes, job)?;
            let made = base.assemble(coder, &classes)?;
            let measured = job.install(|| own_measure(source, &made));
            Ok::<_, EncodeError>((measured, made))
        })?;
        // The best price of a range lies inside it.
        let inside = found.met && found.knob > start || start == FIRST_PRICE;
        guess = found.knob;
        let done = inside && (found.met || end == FIRST_PRICE + PRICES);
        last = Some(found.value);
        if done {
            break;
        }
    }
    last.ok_or(SourceError::Empty.into())
}

/// The least class for each block within the tolerance.
fn within(
    source: &ImageSet,
    base: &Base,
    coder: &mut Coder<'_>,
    tolerance: f64,
    job: &mut Job<'_>,
) -> Result<ProgressiveTexture, EncodeError> {
    let goal = Goal::Tolerance(tolerance);
    let found = search(goal, 1..=SLACKS, 1, 0.0, |slack| {
        job.stage("coding blocks", (slack - 1) as f32 / SLACKS as f32)?;
        let limit = draft::cell_limit(tolerance) * (1.0 - 0.05 * slack as f32);
        let classes = coder.within(limit, job)?;
        let made = base.assemble(coder, &classes)?;
        let measured = job.install(|| own_measure(source, &made));
        Ok::<_, EncodeError>((measured, made))
    })?;
    Ok(found.value)
}
