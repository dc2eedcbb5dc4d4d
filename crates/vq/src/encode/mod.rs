//! The encoder: guidance, samples, codewords, codebook, index.
//!
//! The paper's steps in order: blocks, usability, saliency and distortion, guidance, samples, then vector quantisation
//! of what they do not show. Beyond the paper: codewords are weighted by importance, and everything is decided on the stored
//! (8-bit or block-compressed) codebook, with rounds that move the codewords to what really uses them; blocks may point
//! across codewords; and pictures that are nearly gray are stored as gray. A tolerance goal uses the paper's
//! incremental codewords instead, which bound every block's error.
//!
//! Cost: O(blocks x codewords) distances, nearly all of which are rejected after a few numbers. *Not
//! done*: an arrangement of the codewords that makes windows across them more useful.

mod assemble;
mod blocks;
pub(crate) mod grow;
mod importance;
mod incremental;
pub(crate) mod plan;
pub(crate) mod report;
mod samples;
mod single;
mod usability;

use texfold_bc::Content;
use texfold_core::image::{ColorSpace, ImageSet, PixelInfo};
use texfold_core::metric::{SquaredError, color_error, measure};
use texfold_core::target::{Found, Measured, search};
use texfold_core::{Effort, EncodeError, Goal, Job, Notes, Params, SourceError};

use self::plan::{CELL_TEXELS, Grid, MAX_CELLS, fixed_bits};
use self::single::{Prepared, Request};
use crate::{VqParams, VqSource, VqTexture};

/// The first, fast search for a quality goal stops within this share of the number of codewords, the second one,
/// at full effort, within the smaller.
const COARSE_STEP: f64 = 0.1;
const FINE_STEP: f64 = 0.02;
/// Full effort needs at least this share of the codewords that the fast search asked for.
const FINE_RANGE: f64 = 0.8;
/// What full effort may gain over fast effort, dB: a goal that is missed by more is out of reach.
const EFFORT_GAIN: f64 = 0.7;

/// Largest RMS distance from gray, 8-bit units, at which gray alone is tried too: what 565 colours and chroma noise
/// leave on a gray picture.
const NEARLY_GRAY_RMS: f64 = 2.0;

pub(crate) fn encode(
    source: VqSource<'_>,
    params: &VqParams,
    most_bpp: Option<f64>,
    job: &mut Job<'_>,
) -> Result<VqTexture, EncodeError> {
    params.check()?;
    source.images.check_sides()?;
    let images = source.images;
    job.budget.take(images.texel_count().saturating_mul(u64::from(images.info().channels) * 4 * 2))?;
    job.stage("guidance", 0.0)?;
    let gray = nearly_gray(images, params);
    let mut variants: Vec<VqSource<'_>> =
        gray.iter().map(|gray| VqSource { images: gray, ..source }).collect();
    variants.push(source);
    let mut best: Option<(Prepared<'_>, Found<VqTexture>)> = None;
    for (index, variant) in variants.into_iter().enumerate() {
        // Gray needs a third of the numbers of colour: where it meets a quality goal, colour does not do so for less.
        if index > 0
            && best.as_ref().is_some_and(|(_, found)| found.met && !matches!(params.goal, Goal::Bpp(_)))
        {
            break;
        }
        let prepared = job.install(|| Prepared::new(variant, images, params))?;
        let found = job.within(0.2, 0.95, |job| best_content(&prepared, params, most_bpp, job))?;
        if best.as_ref().is_none_or(|(_, best)| params.goal.prefers(&found.measured, &best.measured)) {
            best = Some((prepared, found));
        }
    }
    let (prepared, best) = best.ok_or(SourceError::Empty)?;
    let texture = job.install(|| finish(&prepared, params, best));
    job.stage("done", 1.0)?;
    Ok(texture)
}

/// The best of the kinds of content that are worth a trial.
fn best_content(
    prepared: &Prepared<'_>,
    params: &VqParams,
    most_bpp: Option<f64>,
    job: &mut Job<'_>,
) -> Result<Found<VqTexture>, EncodeError> {
    let contents = contents(prepared.source.images.info(), params)?;
    let mut best: Option<Found<VqTexture>> = None;
    for (index, &content) in contents.iter().enumerate() {
        // Raw content is the last resort: it costs two to six times the bits of the others.
        if content == Content::Raw
            && best.as_ref().is_some_and(|found| found.met)
            && !matches!(params.goal, Goal::Bpp(_))
        {
            break;
        }
        let at = |share: usize| share as f32 / contents.len() as f32;
        let found = job.within(at(index), at(index + 1), |job| {
            with_content(prepared, params, (content, most_bpp), job)
        })?;
        if best.as_ref().is_none_or(|best| params.goal.prefers(&found.measured, &best.measured)) {
            best = Some(found);
        }
    }
    best.ok_or(SourceError::Empty.into())
}

/// The images as gray, where colour is hardly there and the caller has not fixed the codebook.
fn nearly_gray(images: &ImageSet, params: &VqParams) -> Option<ImageSet> {
    let free = params.content.is_none() && params.codebook.is_none();
    if !free || images.info().channels < 3 || images.info().color == ColorSpace::Normal {
        return None;
    }
    let gray = images.to_gray();
    let error = images.images().iter().zip(gray.images()).map(|(a, b)| color_error(a, b));
    let error = error.fold(SquaredError::default(), |sum, error| sum + error);
    (error.rms() <= NEARLY_GRAY_RMS).then_some(gray)
}

/// How the codebook may be stored: the caller's choice, or what is worth trying for such pixels.
fn contents(pixel: PixelInfo, params: &VqParams) -> Result<Vec<Content>, EncodeError> {
    if let Some(content) = params.content {
        if !content.fits(pixel) {
            let range = "what the chosen content format can hold";
            return Err(texfold_core::ParamError::new("channels", pixel.channels, range).into());
        }
        return Ok(vec![content]);
    }
    let exact = matches!(params.goal, Goal::Tolerance(_)) || params.codebook.is_some();
    Ok(match pixel.channels {
        _ if exact => vec![Content::Raw],
        1 => vec![Content::Bc4, Content::Raw],
        2 => vec![Content::Bc5, Content::Raw],
        3 if pixel.color == ColorSpace::Normal => vec![Content::Bc7, Content::Raw],
        3 => vec![Content::Bc7, Content::Bc1],
        _ => vec![Content::Bc7, Content::Raw],
    })
}

/// The best texture with such content: the size of the codebook follows the goal, within `most_bpp` bits a texel.
fn with_content(
    prepared: &Prepared<'_>,
    params: &VqParams,
    (content, most_bpp): (Content, Option<f64>),
    job: &mut Job<'_>,
) -> Result<Found<VqTexture>, EncodeError> {
    let single = |(measured, value): (Measured, VqTexture)| {
        let met = params.goal.is_met(&measured);
        Found { knob: 0, measured, value, met, evaluations: 1 }
    };
    let full = |grid: Grid, job: &mut Job<'_>| one(prepared, (grid, content, params.effort), job).map(single);
    if let Some(size) = params.codebook {
        return full(Grid::of_texels(size), job);
    }
    match params.goal {
        Goal::Bpp(bpp) => full(grid_for_bpp(prepared, content, bpp), job),
        Goal::Tolerance(tolerance) => {
            let texture = job.install(|| incremental::encode(prepared, content, tolerance))?;
            Ok(single((measure(prepared.reference, &texture), texture)))
        }
        Goal::Psnr(psnr) => {
            let most = most_bpp.map_or(MAX_CELLS, |bpp| grid_for_bpp(prepared, content, bpp).cells());
            let most = most.min(prepared.blocks.len() as u32).max(1);
            search_psnr(prepared, (content, psnr), most, job)
        }
    }
}

/// One encode, and what it measures.
fn one(
    prepared: &Prepared<'_>,
    (grid, content, effort): (Grid, Content, Effort),
    job: &mut Job<'_>,
) -> Result<(Measured, VqTexture), EncodeError> {
    job.stage("codewords", 0.1)?;
    let request = Request { grid, content, effort, seed: job.seed };
    let texture = job.install(|| prepared.encode(&request));
    Ok((measure(prepared.reference, &texture), texture))
}

/// The smallest codebook of at most `most` cells that reaches a PSNR: found fast, then refined at full effort just
/// below what the fast search asked for.
fn search_psnr(
    prepared: &Prepared<'_>,
    (content, psnr): (Content, f64),
    most: u32,
    job: &mut Job<'_>,
) -> Result<Found<VqTexture>, EncodeError> {
    let goal = Goal::Psnr(psnr);
    let mut tried = 0u8;
    let mut at = |cells: u32, effort: Effort, job: &mut Job<'_>| {
        let from = f32::from(tried.min(15)) / 16.0;
        tried += 1;
        job.within(from, from + 1.0 / 16.0, |job| one(prepared, (Grid::within(cells), content, effort), job))
    };
    let fast = search(goal, 1..=most, most, COARSE_STEP, |cells| at(cells, Effort::Fast, job))?;
    if prepared.params.effort == Effort::Fast || fast.measured.psnr < psnr - EFFORT_GAIN {
        return Ok(fast);
    }
    let least = ((f64::from(fast.knob) * FINE_RANGE) as u32).max(1);
    let fine = search(goal, least..=fast.knob, fast.knob, FINE_STEP, |cells| {
        at(cells, prepared.params.effort, job)
    })?;
    Ok(if goal.prefers(&fast.measured, &fine.measured) { fast } else { fine })
}

/// The largest codebook within a number of bits a texel.
fn grid_for_bpp(prepared: &Prepared<'_>, content: Content, bpp: f64) -> Grid {
    let pixel = prepared.source.images.info();
    let bits = bpp * prepared.source.images.texel_count() as f64 - fixed_bits(&prepared.layout) as f64;
    let cells = bits / (content.bits_per_texel(pixel) * f64::from(CELL_TEXELS));
    Grid::within((cells.max(1.0) as u32).min(prepared.blocks.len().max(1) as u32))
}

/// Adds the notes: settings, verdict, and what each part bought.
fn finish(prepared: &Prepared<'_>, params: &VqParams, found: Found<VqTexture>) -> VqTexture {
    let texture = found.value;
    let notes = Notes {
        settings: report::settings(params),
        verdict: report::verdict(&texture, found.met),
        psnr_without: report::ledger(prepared, &texture),
    };
    texture.with_notes(notes)
}
