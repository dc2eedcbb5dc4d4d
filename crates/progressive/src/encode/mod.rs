//! The encoder on one page: bases of several kinds, what each lacks, the model and price of bits under which a base with its error
//! map answers the goal best, and the blocks coded at that price in closed loop on the decoded base.

mod base;
mod coder;
mod details;
mod draft;
mod error;
mod model;
mod plane;
mod report;
mod search;
mod trellis;

use std::sync::Arc;

use texfold_core::image::ImageSet;
use texfold_core::metric::measure;
use texfold_core::target::{Measured, search};
use texfold_core::{Effort, EncodeError, Goal, Job, Params, SourceError, SurfaceSize};

use crate::{ProgressiveParams, ProgressiveTexture, Shared};
pub use plane::PlaneForm;
pub use search::ProgressiveSearch;

use base::{Base, Ground, Kind, kinds, levels};
use coder::Coder;
use draft::{Draft, FIRST_PRICE, PRICES, price};
use report::notes;

/// Longest side of an image in texels that a file can name.
const MAX_SIDE: u32 = 1 << 15;
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
    check_sizes(source)?;
    let chains = job.install(|| levels(source, params.mips));
    let make = |kind: Kind, job: &mut Job<'_>| {
        job.install(|| {
            let ground = Ground::new(source, &chains, kind, (params.effort, shared))?;
            ground.base(source, &chains, ground.own_cells(params.goal)).map(Arc::new)
        })
    };
    encode_with(source, params, make, job)
}

/// `make` gives the base of a kind, where there is one.
fn encode_with(
    source: &ImageSet,
    params: &ProgressiveParams,
    mut make: impl FnMut(Kind, &mut Job<'_>) -> Option<Arc<Base>>,
    job: &mut Job<'_>,
) -> Result<ProgressiveTexture, EncodeError> {
    let kinds = kinds(source.info(), params)?;
    let mut best: Option<(Arc<Base>, Draft)> = None;
    for (index, &kind) in kinds.iter().enumerate() {
        job.stage("trying bases", 0.4 * index as f32 / kinds.len() as f32)?;
        let Some(base) = make(kind, job) else { continue };
        let Some(draft) = best_draft(&base, params.goal, job) else { continue };
        if best.as_ref().is_none_or(|(_, best)| params.goal.prefers(&draft.estimate, &best.estimate)) {
            best = Some((base, draft));
        }
    }
    let (base, draft) = best.ok_or(SourceError::Full { what: "a plane of 8192 x 8192 words" })?;
    let draft = job.install(|| draft.widened(&base, params.goal));
    let largest = draft.model.class_bits == CLASS_BITS[1];
    let mut made = job.within(0.4, 0.8, |job| finish(source, &base, draft, params, job))?;
    let mut met = params.goal.is_met(&own_measure(source, &made));
    if !met && !largest && !matches!(params.goal, Goal::Bpp(_)) {
        // A few blocks need more bits than the estimates say.
        let draft = job.install(|| Draft::new(&base, CLASS_BITS[1], params.goal).widened(&base, params.goal));
        let other = job.within(0.8, 1.0, |job| finish(source, &base, draft, params, job))?;
        let (of_made, of_other) = (own_measure(source, &made), own_measure(source, &other));
        if params.goal.prefers(&of_other, &of_made) {
            (made, met) = (other, params.goal.is_met(&of_other));
        }
    }
    let notes = notes(source, &made, params, met);
    job.stage("done", 1.0)?;
    Ok(made.with_notes(notes))
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

/// The base with its blocks coded at the price that the goal asks for.
fn finish(
    source: &ImageSet,
    base: &Base,
    draft: Draft,
    params: &ProgressiveParams,
    job: &mut Job<'_>,
) -> Result<ProgressiveTexture, EncodeError> {
    // One block can miss a tolerance: each is worth a search for its scale.
    let effort = match params.goal {
        Goal::Tolerance(_) => params.effort.max(Effort::Normal),
        _ => params.effort,
    };
    let mut coder = Coder::new(&base.blocks, draft.model, effort);
    match params.goal {
        Goal::Psnr(_) => by_quality(source, base, &mut coder, draft.number, params.goal, job),
        Goal::Bpp(_) => {
            job.stage("coding blocks", 0.0)?;
            let classes = coder.choose(price(draft.number));
            coder.code(&classes, job)?;
            // What coding has shown of the blocks moves bits among them.
            job.stage("coding blocks", 0.7)?;
            let number = draft::search_price(base, &coder, params.goal).knob;
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

fn check_sizes(source: &ImageSet) -> Result<(), SourceError> {
    for (index, image) in source.images().iter().enumerate() {
        let SurfaceSize { width, height } = image.size();
        if width > MAX_SIDE || height > MAX_SIDE {
            return Err(SourceError::TooLarge { index, width, height, max: MAX_SIDE });
        }
    }
    Ok(())
}
