//! Plain encoding: the smallest of a short list of formats and sizes that meets the goal.
//!
//! The list runs from one eighth of the width and height in BC1 to plain bytes, in the order of its bits. Cost: one block
//! compression for each entry that the search tries, at most five.

mod blocks;
mod content;
mod params;

pub use blocks::encode_plane;
pub use params::BcParams;

use texfold_core::image::{ColorSpace, ImageSet, MipFilter, PixelInfo, Raster, mip_chain_cancellable};
use texfold_core::metric::measure_for;
use texfold_core::target::search;
use texfold_core::{
    CancelCheck, EncodeError, Encoder, Goal, ImageLayout, ImageSize, Job, Notes, ParamError, Params,
    SourceError,
};

use crate::parts::Parts;
use crate::wire::MAX_REDUCE_LOG2;
use crate::{Bc, BcTexture, Content, ContentPlanes};

/// Bytes a source texel that one candidate takes at most: a mip chain of values (8, and a third of 16), the linear colours that it is
/// made from (16), bytes to be compressed (2 times 4), and planes (up to 10).
const BYTES_PER_TEXEL: u64 = 56;

#[derive(Debug, Clone, Copy, PartialEq)]
struct Candidate {
    content: Content,
    reduce_log2: u32,
    bpp: f64,
}

impl Encoder for Bc {
    type Source<'s> = &'s ImageSet;
    type Params = BcParams;

    fn encode(source: &ImageSet, params: &BcParams, job: &mut Job<'_>) -> Result<BcTexture, EncodeError> {
        encode(source, params, job)
    }
}

impl Bc {
    /// The images reduced to the largest size that blocks of so many bits a texel have, without compression: no such blocks are nearer to them, but for
    /// errors that happen to cancel. `None` where that is the full size, or blocks have more bits at any size.
    ///
    /// # Errors
    /// [`EncodeError`] for images or parameters that [`Encoder::encode`] refuses, and where the job was cancelled.
    pub fn reduced(
        source: &ImageSet,
        params: &BcParams,
        bpp: f64,
        job: &mut Job<'_>,
    ) -> Result<Option<BcTexture>, EncodeError> {
        params.check()?;
        source.check_images()?;
        let candidates = candidates(source.info(), params)?;
        let within = candidates.iter().filter(|candidate| candidate.bpp <= bpp);
        let Some(reduce_log2 @ 1..) = within.map(|candidate| candidate.reduce_log2).min() else {
            return Ok(None);
        };
        let candidate = Candidate { content: Content::Raw, reduce_log2, bpp };
        let params = BcParams { mips: false, ..params.clone() };
        job.holding(source.texel_count().saturating_mul(BYTES_PER_TEXEL), |job| {
            let cancel = job.cancel_check();
            job.install(|| compress(source, candidate, &params, cancel)).map(Some)
        })
    }
}

fn encode(source: &ImageSet, params: &BcParams, job: &mut Job<'_>) -> Result<BcTexture, EncodeError> {
    params.check()?;
    source.check_images()?;
    let candidates = candidates(source.info(), params)?;
    let guess = match params.goal {
        Goal::Bpp(bpp) => candidates.partition_point(|candidate| candidate.bpp <= bpp),
        _ => candidates.iter().position(|candidate| candidate.bpp >= 4.0).unwrap_or(0) + 1,
    };
    let mut tried = 0u32;
    let found = search(params.goal, 1..=candidates.len() as u32, guess as u32, 0.0, |index| {
        job.stage("compressing blocks", f32::from(tried as u16) / 5.0)?;
        tried += 1;
        let candidate = candidates[index as usize - 1];
        // The planes, and the padded bytes that one of them is made from.
        let bytes = source.texel_count().saturating_mul(BYTES_PER_TEXEL);
        job.holding(bytes, |job| {
            let cancel = job.cancel_check();
            job.install(|| {
                let texture = compress(source, candidate, params, cancel)?;
                Ok((measure_for(params.goal, source, &texture, cancel)?, texture))
            })
        })
    })?;
    let mut texture = found.value;
    texture.notes = Notes {
        settings: settings(params),
        verdict: verdict(&texture, params.goal, found.met),
        ..Notes::default()
    };
    job.stage("done", 1.0)?;
    Ok(texture)
}

/// Formats and sizes that fit the pixels and the caller's choice, by rising bits.
fn candidates(pixel: PixelInfo, params: &BcParams) -> Result<Vec<Candidate>, ParamError> {
    let suits = |content: Content| match params.content {
        Some(chosen) => content == chosen,
        None => usual(content, pixel),
    };
    let mut list: Vec<Candidate> = Content::ALL
        .into_iter()
        .filter(|&content| suits(content) && content.fits(pixel))
        .flat_map(|content| (0..=MAX_REDUCE_LOG2).map(move |reduce_log2| (content, reduce_log2)))
        .filter(|&(_, reduce_log2)| params.reduce_log2.is_none_or(|chosen| chosen == reduce_log2))
        .map(|(content, reduce_log2)| {
            let bpp = content.bits_per_texel(pixel) / f64::from(1u32 << (2 * reduce_log2));
            Candidate { content, reduce_log2, bpp }
        })
        .filter(|candidate| candidate.reduce_log2 == 0 || candidate.content != Content::Raw)
        .collect();
    list.sort_by(|a, b| a.bpp.total_cmp(&b.bpp).then(a.reduce_log2.cmp(&b.reduce_log2)));
    // Equal bits: the one that keeps the full size.
    list.dedup_by(|b, a| a.bpp == b.bpp && params.content.is_none());
    if list.is_empty() {
        return Err(ParamError::new("channels", pixel.channels, "what the chosen content format can hold"));
    }
    Ok(list)
}

/// Formats worth trying without a choice of the caller's.
fn usual(content: Content, pixel: PixelInfo) -> bool {
    match content {
        Content::Raw => true,
        Content::Bc1 => pixel.channels == 3 && pixel.color != ColorSpace::Normal,
        Content::Bc3 => false,
        Content::Bc4 => pixel.channels == 1,
        Content::Bc5 => pixel.channels == 2 || pixel.color == ColorSpace::Normal,
        Content::Bc7 => pixel.channels >= 3,
    }
}

fn compress(
    source: &ImageSet,
    candidate: Candidate,
    params: &BcParams,
    cancel: CancelCheck<'_>,
) -> Result<BcTexture, EncodeError> {
    let stored_levels = if params.mips { source.full_levels().min(16) } else { 1 };
    let planes = |image: &Raster| -> Result<Vec<ContentPlanes>, EncodeError> {
        cancel.checkpoint()?;
        let levels = candidate.reduce_log2 + stored_levels;
        let chain = mip_chain_cancellable(image, levels, MipFilter::Box, cancel)?;
        chain[candidate.reduce_log2 as usize..]
            .iter()
            .map(|level| ContentPlanes::encode_image(candidate.content, level, params.effort, cancel))
            .collect()
    };
    let parts = Parts {
        layout: source.layout(stored_levels),
        content: candidate.content,
        reduce_log2: candidate.reduce_log2,
        images: source.images().iter().map(planes).collect::<Result<_, _>>()?,
    };
    Ok(BcTexture { parts, notes: Notes::default() })
}

fn settings(params: &BcParams) -> String {
    let goal = params.goal.option();
    let content = params.content.map_or(String::new(), |content| format!(" --content {}", content.name()));
    let mips = if params.mips { " --mips" } else { "" };
    format!("--codec bc {goal}{content}{mips}")
}

fn verdict(texture: &BcTexture, goal: Goal, met: bool) -> String {
    let size = match texture.parts.reduce_log2 {
        0 => "at full size".to_owned(),
        log2 => format!("at 1/{} of width and height", 1 << log2),
    };
    let outcome = match (goal, met) {
        (Goal::Bpp(_), true) => "the best plain form within the bits asked for",
        (_, true) => "the smallest plain form that reaches the goal",
        (_, false) => "the nearest plain form to a goal that none reaches",
    };
    format!(
        "Plain {} {size}: {outcome}; no repetition is modelled.",
        texture.parts.content.name().to_uppercase()
    )
}

/// An image that is BC1 already, as DDS and KTX2 files hold it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Bc1Blocks {
    /// Columns and rows in texels.
    pub size: ImageSize,
    /// Blocks row by row, 8 bytes each.
    pub blocks: Vec<u8>,
}

impl BcTexture {
    /// Takes over images that are BC1 already, block for block.
    ///
    /// # Errors
    /// [`SourceError`] where there is none, or one has another number of bytes than its size asks for.
    pub fn from_bc1(images: Vec<Bc1Blocks>, pixel: PixelInfo) -> Result<BcTexture, SourceError> {
        let sizes: Vec<ImageSize> = images.iter().map(|image| image.size).collect();
        if sizes.is_empty() {
            return Err(SourceError::Empty);
        }
        let mut planes = Vec::new();
        for (index, Bc1Blocks { size, blocks }) in images.into_iter().enumerate() {
            let ImageSize { width, height } = size;
            if width == 0 || height == 0 {
                return Err(SourceError::ZeroSize { index, width, height });
            }
            let needed = texfold_core::PlaneFormat::Bc1.bytes(width, height) as usize;
            let found = blocks.len();
            let content = ContentPlanes::from_planes(Content::Bc1, pixel, (width, height), vec![blocks]);
            planes.push(vec![content.ok_or(SourceError::Length { found, needed })?]);
        }
        let verdict = "The input is BC1 already: its blocks are kept as they are.".to_owned();
        let layout = ImageLayout::new(sizes, 1, pixel);
        Ok(BcTexture {
            parts: Parts { layout, content: Content::Bc1, reduce_log2: 0, images: planes },
            notes: Notes { settings: "--codec bc".to_owned(), verdict, ..Notes::default() },
        })
    }
}
