//! The encoder: guidance, samples, codewords, codebook, index.
//!
//! The paper's steps in order: blocks, usability, saliency and distortion, guidance, samples, then vector quantisation
//! of what they do not hold. Beyond the paper: codewords are weighted by importance, and everything is decided on the
//! stored (8-bit or block-compressed) codebook, with rounds that move the codewords to what really uses them; blocks
//! may point across codewords; and images that are nearly gray are stored as gray. A tolerance goal uses the paper's
//! incremental codewords instead, which bound every block's error.
//!
//! Cost: O(blocks x codewords) distances, nearly all of which are rejected after a few numbers. *Not
//! done*: an arrangement of the codewords that makes windows across them more useful.

mod assemble;
mod blocks;
mod estimate;
mod grow;
mod importance;
mod incremental;

mod plan;
mod report;
mod samples;
mod single;
mod usability;

use texfold_bc::Content;
use texfold_core::image::{ColorSpace, ImageSet, PixelInfo};
use texfold_core::metric::{SquaredError, color_error, quality};
use texfold_core::target::{Found, Measured, search};
use texfold_core::{
    Effort, EncodeError, Encoder, Goal, Growable, Job, MAX_PLANE_SIDE, Notes, ParamError, Params, SourceError,
};

use self::plan::{CELL_TEXELS, MAX_CELLS, fixed_bits};
use self::single::{Prepared, Request};
use crate::classes::rows_of;
use crate::grid::Grid;
use crate::{Vq, VqParams, VqSource, VqTexture};

pub use report::part_images;

/// Longest side of an image with mip levels: up to it the index of any image fits a plane, whatever its shape.
const MAX_SIDE_WITH_MIPS: u32 = 16_000;
/// Bytes that encoding holds for each texel, beside those of its channels: importance (4), and one decoded texel (16)
/// while quality is measured.
const BYTES_PER_TEXEL: u64 = 20;
/// Numbers of 4 bytes that encoding holds for each channel of each texel: blocks, the image as gray or with its mip
/// levels, and the decoded image while quality is measured.
const NUMBERS_PER_CHANNEL: u64 = 3;
/// The first, fast search for a quality goal stops within this share of the number of codewords, the second one,
/// at full effort, within the smaller.
const COARSE_STEP: f64 = 0.1;
const FINE_STEP: f64 = 0.02;
/// Full effort needs at least this share of the codewords that the fast search requested.
const FINE_RANGE: f64 = 0.8;
/// What full effort may gain over fast effort, dB: a goal that is missed by more is out of reach.
const EFFORT_GAIN: f64 = 0.7;

/// Raw codewords are tried for colours where the others use less than this share of the bits.
const UNUSED: f64 = 0.95;

/// Largest RMS distance from gray, 8-bit units, at which gray alone is tried too: what 565 colours and chroma noise
/// leave on a gray image.
const NEARLY_GRAY_RMS: f64 = 2.0;

impl Encoder for Vq {
    type Source<'s> = VqSource<'s>;
    type Params = VqParams;

    fn encode(source: VqSource<'_>, params: &VqParams, job: &mut Job<'_>) -> Result<VqTexture, EncodeError> {
        encode(source, params, None, job)
    }
}

impl Growable for Vq {
    fn add(encoded: &mut VqTexture, source: VqSource<'_>, job: &mut Job<'_>) -> Result<(), EncodeError> {
        grow::add(encoded, source, job)
    }
}

impl Vq {
    /// Bits a texel, compressed, that images take at least, whatever the codebook: those of the index.
    #[must_use]
    pub fn least_bpp(images: &ImageSet, params: &VqParams) -> f64 {
        let layout = images.layout(single::levels(images, params));
        fixed_bits(&layout) as f64 / images.texel_count() as f64
    }

    /// As [`Encoder::encode`] for a quality goal, but gives up once `most_bpp` bits a texel, compressed, do not reach
    /// it: for callers that hold a plain form of that size.
    ///
    /// # Errors
    /// As [`Encoder::encode`].
    pub fn encode_within(
        source: VqSource<'_>,
        params: &VqParams,
        most_bpp: f64,
        job: &mut Job<'_>,
    ) -> Result<VqTexture, EncodeError> {
        encode(source, params, Some(most_bpp), job)
    }
}

fn encode(
    source: VqSource<'_>,
    params: &VqParams,
    most_bpp: Option<f64>,
    job: &mut Job<'_>,
) -> Result<VqTexture, EncodeError> {
    params.check()?;
    check_sizes(source.images, single::levels(source.images, params))?;
    job.holding(held_bytes(source.images), |job| encode_checked(source, params, most_bpp, job))
}

/// What encoding `images` holds at a time, in bytes.
fn held_bytes(images: &ImageSet) -> u64 {
    let texel = BYTES_PER_TEXEL + NUMBERS_PER_CHANNEL * 4 * u64::from(images.info().channels);
    images.texel_count().saturating_mul(texel)
}

fn encode_checked(
    source: VqSource<'_>,
    params: &VqParams,
    most_bpp: Option<f64>,
    job: &mut Job<'_>,
) -> Result<VqTexture, EncodeError> {
    let images = source.images;
    job.stage("guidance", 0.0)?;
    let gray = nearly_gray(images, params, job)?;
    let request = Variant { source, reference: images, params, most_bpp };
    let as_gray = |gray| Variant { source: VqSource { images: gray, ..source }, ..request };
    let best = match gray.as_ref().map(|gray| as_gray(gray).encode(job)).transpose()? {
        // Gray needs a third of the numbers of colour: where it meets a quality goal, colour does not do so for less.
        Some(gray) if gray.found.met && !matches!(params.goal, Goal::Bpp(_)) => gray,
        Some(gray) => {
            let colour = request.encode(job)?;
            let better = params.goal.prefers(&colour.found.measured, &gray.found.measured);
            if better { colour } else { gray }
        }
        None => request.encode(job)?,
    };
    let texture = job.install(|| finish(best))?;
    job.stage("done", 1.0)?;
    Ok(texture)
}

/// The images as they came, or as gray.
#[derive(Debug, Clone, Copy)]
struct Variant<'s> {
    source: VqSource<'s>,
    /// What quality is held against: the images as they came.
    reference: &'s ImageSet,
    params: &'s VqParams,
    most_bpp: Option<f64>,
}

/// A variant's best texture.
struct Best<'s> {
    prepared: Prepared<'s>,
    found: Found<VqTexture>,
}

impl<'s> Variant<'s> {
    fn encode<'j: 's>(self, job: &mut Job<'j>) -> Result<Best<'s>, EncodeError> {
        let cancel = job.cancel_check();
        let prepared = job.install(|| Prepared::new(self.source, self.reference, self.params, cancel))?;
        let found = job.within(0.2, 0.95, |job| best_content(&prepared, self.most_bpp, job))?;
        Ok(Best { prepared, found })
    }
}

/// The best of the kinds of content that are worth a trial.
fn best_content(
    prepared: &Prepared<'_>,
    most_bpp: Option<f64>,
    job: &mut Job<'_>,
) -> Result<Found<VqTexture>, EncodeError> {
    let goal = prepared.params.goal;
    let contents = contents(prepared.source.images.info(), &prepared.params)?;
    let at = |share: usize| share as f32 / contents.len() as f32;
    let trial = |index: usize, job: &mut Job<'_>| {
        job.within(at(index), at(index + 1), |job| with_content(prepared, contents[index], most_bpp, job))
    };
    let mut best = trial(0, job)?;
    for (index, &content) in contents.iter().enumerate().skip(1) {
        // Raw content is the last resort: it costs two to six times the bits of the others. A goal of quality tries it where half of the
        // different blocks fit (`most_words` is twice their number), a goal of bits for colours where BC7 and BC1 leave bits unused.
        let most = most_bpp.unwrap_or(f64::INFINITY);
        let has_room = || 4 * grid_for_bpp(prepared, content, most).cells() >= prepared.most_words;
        let is_worth_raw = match goal {
            Goal::Bpp(bpp) => !contents.contains(&Content::Bc1) || best.measured.bpp < UNUSED * bpp,
            _ => !best.met && has_room(),
        };
        if content == Content::Raw && !is_worth_raw {
            break;
        }
        // Where the most codewords miss the quality as BC7, as many with less precision miss it by more.
        if content == Content::Bc1 && !best.met && most_bpp.is_none() && matches!(goal, Goal::Psnr(_)) {
            continue;
        }
        let found = trial(index, job)?;
        if goal.prefers(&found.measured, &best.measured) {
            best = found;
        }
    }
    Ok(best)
}

/// The images as gray, where colour is hardly there and the caller has not fixed the codebook.
fn nearly_gray(images: &ImageSet, params: &VqParams, job: &Job<'_>) -> Result<Option<ImageSet>, EncodeError> {
    let free = params.content.is_none() && params.codebook.is_none();
    if !free || images.info().channels < 3 || images.info().color == ColorSpace::Normal {
        return Ok(None);
    }
    let gray = images.to_gray();
    let mut error = SquaredError::default();
    for (image, gray) in images.images().iter().zip(gray.images()) {
        job.checkpoint()?;
        error = error + color_error(image, gray);
    }
    Ok((error.rms() <= NEARLY_GRAY_RMS).then_some(gray))
}

/// Fails where an image is longer than a file can name, or its index, with `levels` mip levels, fits no plane.
fn check_sizes(images: &ImageSet, levels: u32) -> Result<(), SourceError> {
    images.check_images()?;
    for (index, image) in images.images().iter().enumerate() {
        let size = image.size();
        let (width, height) = (size.width, size.height);
        if rows_of(size, levels) > MAX_PLANE_SIDE {
            return Err(SourceError::TooLarge { index, width, height, max: MAX_SIDE_WITH_MIPS });
        }
    }
    Ok(())
}

/// How the codebook may be stored: the caller's choice, or what is worth trying for such pixels.
fn contents(pixel: PixelInfo, params: &VqParams) -> Result<Vec<Content>, EncodeError> {
    if let Some(content) = params.content {
        if !content.fits(pixel) {
            let range = "what the chosen content format can hold";
            return Err(ParamError::new("channels", pixel.channels, range).into());
        }
        return Ok(vec![content]);
    }
    let exact = matches!(params.goal, Goal::Tolerance(_)) || params.codebook.is_some();
    Ok(match pixel.channels {
        _ if exact => vec![Content::Raw],
        1 => vec![Content::Bc4, Content::Raw],
        2 => vec![Content::Bc5, Content::Raw],
        3 if pixel.color == ColorSpace::Normal => vec![Content::Bc7, Content::Raw],
        3 => vec![Content::Bc7, Content::Bc1, Content::Raw],
        _ => vec![Content::Bc7, Content::Raw],
    })
}

/// The best texture with such content: the size of the codebook follows the goal, within `most_bpp` bits a texel.
fn with_content(
    prepared: &Prepared<'_>,
    content: Content,
    most_bpp: Option<f64>,
    job: &mut Job<'_>,
) -> Result<Found<VqTexture>, EncodeError> {
    let params = &prepared.params;
    let single = |(measured, value): (Measured, VqTexture)| {
        let met = params.goal.is_met(&measured);
        Found { index: 0, measured, value, met, evaluations: 1 }
    };
    let full = |grid: Grid, job: &mut Job<'_>| one(prepared, grid, content, params.effort, job).map(single);
    if let Some(size) = params.codebook {
        return full(Grid::of_texels(size), job);
    }
    match params.goal {
        Goal::Bpp(bpp) => full(grid_for_bpp(prepared, content, bpp), job),
        Goal::Tolerance(tolerance) => {
            let texture = job.install(|| incremental::encode(prepared, content, tolerance))?;
            Ok(single((
                quality(prepared.reference, &texture).judged(params.goal, prepared.reference, &texture),
                texture,
            )))
        }
        Goal::Psnr(psnr) => {
            let most = most_bpp.map_or(MAX_CELLS, |bpp| grid_for_bpp(prepared, content, bpp).cells());
            let most = most.min(prepared.blocks.len() as u32).max(1);
            search_psnr(prepared, content, psnr, most, job)
        }
    }
}

/// One encode, and what it measures.
fn one(
    prepared: &Prepared<'_>,
    grid: Grid,
    content: Content,
    effort: Effort,
    job: &mut Job<'_>,
) -> Result<(Measured, VqTexture), EncodeError> {
    job.stage("codewords", 0.1)?;
    let request = Request { grid, content, effort, seed: job.seed };
    let texture = job.install(|| prepared.encode(&request))?;
    job.checkpoint()?;
    let quality = job.install(|| quality(prepared.reference, &texture));
    Ok((quality.judged(prepared.params.goal, prepared.reference, &texture), texture))
}

/// The smallest codebook of at most `most` cells that reaches a PSNR: found fast, then refined at full effort just
/// below what the fast search requested.
fn search_psnr(
    prepared: &Prepared<'_>,
    content: Content,
    psnr: f64,
    most: u32,
    job: &mut Job<'_>,
) -> Result<Found<VqTexture>, EncodeError> {
    let (goal, usual) = (Goal::Psnr(psnr), prepared.params.effort);
    let mut tried = 0u8;
    let mut at = |cells: u32, effort: Effort, job: &mut Job<'_>| {
        let from = f32::from(tried.min(15)) / 16.0;
        tried += 1;
        // The search goes on as if all were there: its way depends on what it finds.
        let cells = cells.min(prepared.most_words);
        job.within(from, from + 1.0 / 16.0, |job| one(prepared, Grid::within(cells), content, effort, job))
    };
    let fast = search(goal, 1..=most, most, COARSE_STEP, |cells| at(cells, Effort::Fast, job))?;
    if usual == Effort::Fast || fast.measured.psnr < psnr - EFFORT_GAIN {
        return Ok(fast);
    }
    let least = ((f64::from(fast.index) * FINE_RANGE) as u32).max(1);
    let fine = search(goal, least..=fast.index, fast.index, FINE_STEP, |cells| at(cells, usual, job))?;
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
fn finish(Best { prepared, found }: Best<'_>) -> Result<VqTexture, EncodeError> {
    let texture = found.value;
    let notes = Notes {
        settings: report::settings(&prepared.params),
        verdict: report::verdict(&texture, found.met),
        psnr_without: report::ledger(&prepared, &texture)?,
        ..Notes::default()
    };
    Ok(texture.with_notes(notes))
}
