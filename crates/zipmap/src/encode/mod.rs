//! The method on one screen: check, lay patch by patch on a canvas (crop, fit colours, mask, mip levels, trim), leave
//! out what is hidden, store as finely and in the content that the goal asks for.

mod blocks;
mod canvas;
mod compare;
mod enlarge;
mod fit;
mod levels;
mod mask;
mod merge;
mod multigrid;
mod report;
mod trim;

use glam::{DMat3, DVec2};
use rayon::prelude::*;
use texfold_bc::Content;
use texfold_core::image::{Alpha, ColorSpace, PixelInfo, Raster};
use texfold_core::target::Measured;
use texfold_core::{
    CancelCheck, EncodeError, Encoder, ImageSize, Job, MAX_IMAGE_SIDE, MAX_PLANE_SIDE, Params, Texel,
    TextureCodec,
};

use crate::geometry::{normalised, seen_in};
use crate::parts::MAX_PATCHES;
use crate::{PatchSource, PatchStack, ZipError, ZipParams, ZipTexture, Zipmap};
use canvas::{Canvas, Laid};
use fit::Maker;
use merge::PatchTexels;
pub use report::{Fidelity, fidelity};

/// Most levels of a file.
const MAX_LEVELS: u32 = 16;
/// Bytes that are held for each texel of root and images: all levels of what is laid, and what is stored of it in each
/// content that the goal tries.
const BYTES_PER_TEXEL: u64 = 24;
/// Bytes that are held for each texel of the largest image while its patch is cut out, masked and reduced: colours and
/// alpha (20), the same as images (16) with their mip levels (22), in linear light (20 for each chain), levels twice (11).
const BYTES_PER_LARGEST: u64 = 112;
/// Least share of a patch that lies on the root.
const LEAST_SHARE: f64 = 1e-6;

/// What was left out, for the report.
#[derive(Debug, Clone, Default)]
pub(crate) struct Dropped {
    pub(crate) levels: usize,
    pub(crate) level_texels: u64,
    pub(crate) nothing_new: Vec<usize>,
    pub(crate) hidden: Vec<usize>,
    /// Texels of the patches of both kinds, all levels.
    pub(crate) patch_texels: u64,
    pub(crate) cropped_texels: u64,
    /// Images that are stored without their finest levels, patches whose image is not stored, and the texels of both.
    pub(crate) coarser: usize,
    pub(crate) spared: Vec<usize>,
    pub(crate) fine_texels: u64,
}

/// Texels of all levels.
fn texels_of(levels: &[Vec<[u8; 4]>]) -> u64 {
    levels.iter().map(|level| level.len() as u64).sum()
}

impl Dropped {
    /// Counts the levels behind the first `kept` of all; none where nothing is kept, as that is told otherwise.
    fn note_levels(&mut self, all: &[Vec<[u8; 4]>], kept: usize) {
        if kept > 0 {
            self.levels += all.len() - kept;
            self.level_texels += texels_of(&all[kept..]);
        }
    }

    /// Counts the finest levels that are not stored.
    fn note_cuts(&mut self, canvas: &Canvas, cuts: &[usize]) {
        let is_left = |content: usize| cuts[content] < canvas.levels[content].len();
        self.coarser = (0..cuts.len()).filter(|&content| cuts[content] > 0 && is_left(content)).count();
        self.spared =
            canvas.laid.iter().filter(|laid| !is_left(laid.content)).map(|laid| laid.source).collect();
        self.fine_texels =
            canvas.levels.iter().zip(cuts).map(|(levels, &cut)| texels_of(&levels[..cut])).sum();
    }
}

/// Patches of one image with one mask: it is stored once, so its colours are not fitted to any of the places.
struct Stamp {
    patches: Vec<usize>,
    /// All levels, once the first of them is laid.
    levels: Vec<Vec<[u8; 4]>>,
    /// Which of the canvas's levels it is, once one of them is laid.
    content: Option<usize>,
}

/// The images that several patches share.
fn stamps(stack: &PatchStack) -> Vec<Stamp> {
    let mut found: Vec<Stamp> = Vec::new();
    for (index, patch) in stack.patches.iter().enumerate() {
        let same = |stamp: &&mut Stamp| {
            let first = &stack.patches[stamp.patches[0]];
            first.image == patch.image && first.mask == patch.mask
        };
        match found.iter_mut().find(same) {
            Some(stamp) => stamp.patches.push(index),
            None => found.push(Stamp { patches: vec![index], levels: Vec::new(), content: None }),
        }
    }
    found.retain(|stamp| stamp.patches.len() > 1);
    found
}

fn fault(error: ZipError) -> EncodeError {
    EncodeError::Codec { codec: Zipmap::ID, source: Box::new(error) }
}

/// A stack as it is laid: what is stored of it.
struct Laying {
    canvas: Canvas,
    dropped: Dropped,
    pixel: PixelInfo,
    /// Levels finer than the root.
    deep: u32,
}

impl Encoder for Zipmap {
    type Source<'s> = &'s PatchStack;
    type Params = ZipParams;

    fn encode(source: &PatchStack, params: &ZipParams, job: &mut Job<'_>) -> Result<ZipTexture, EncodeError> {
        encode(source, params, job).map(|(texture, _)| texture)
    }
}

impl Zipmap {
    /// As [`Encoder::encode`], and what the goal is about: errors against the merged images, for goals of PSNR those of the
    /// worst of them.
    ///
    /// # Errors
    /// As [`Encoder::encode`].
    pub fn encode_measured(
        source: &PatchStack,
        params: &ZipParams,
        job: &mut Job<'_>,
    ) -> Result<(ZipTexture, Measured), EncodeError> {
        encode(source, params, job)
    }
}

/// What encoding a stack holds at a time, in bytes, as an upper bound: for each texel of root and images, and for each of
/// the largest of them while its patch is laid. `texfold/tests/memory.rs` holds it to what the allocator counts.
fn held_bytes(stack: &PatchStack) -> u64 {
    let texels = || stack.images.iter().chain([&stack.root]).map(|image| image.size().texels());
    let largest = texels().max().unwrap_or(0);
    let all = texels().sum::<u64>();
    all.saturating_mul(BYTES_PER_TEXEL).saturating_add(largest.saturating_mul(BYTES_PER_LARGEST))
}

fn encode(
    stack: &PatchStack,
    params: &ZipParams,
    job: &mut Job<'_>,
) -> Result<(ZipTexture, Measured), EncodeError> {
    params.check()?;
    check(stack).map_err(fault)?;
    job.holding(held_bytes(stack), |job| encode_checked(stack, params, job))
}

fn encode_checked(
    stack: &PatchStack,
    params: &ZipParams,
    job: &mut Job<'_>,
) -> Result<(ZipTexture, Measured), EncodeError> {
    let Laying { canvas, mut dropped, pixel, deep } = lay_all(stack, params, job)?;
    let source_texels: u64 =
        stack.images.iter().chain([&stack.root]).map(|image| image.size().texels()).sum();
    let (cancel, encoded) = (job.cancel_check(), std::collections::HashMap::new());
    let mut maker = Maker { canvas: &canvas, pixel, deep, params, encoded, cancel };
    let (measured, fitted) = blocks::choose(&mut maker, &contents(pixel, params), source_texels as f64, job)?;
    drop(maker);
    dropped.note_cuts(&canvas, &fitted.cuts);
    job.stage("measuring", 0.95)?;
    let notes = job.install(|| report::notes(stack, params, &fitted, &dropped, cancel));
    job.stage("done", 1.0)?;
    Ok((fitted.texture.with_notes(notes), measured))
}

/// Opacity of every patch, 0 to 1, one channel: what its borders, its mask and the edges in its image leave; 0 where it adds
/// nothing new, or others hide it. Maps of another kind that are laid by these masks
/// (see [`PatchStack::riding`]) appear just where the colours of the patches do, as finely as the goal stores either.
///
/// # Errors
/// As [`texfold_core::Encoder::encode`].
pub fn masks(stack: &PatchStack, params: &ZipParams, job: &mut Job<'_>) -> Result<Vec<Raster>, EncodeError> {
    params.check()?;
    check(stack).map_err(fault)?;
    let canvas = job.holding(held_bytes(stack), |job| lay_all(stack, params, job))?.canvas;
    job.stage("done", 1.0)?;
    let mask = |(index, source): (usize, &PatchSource)| {
        let ImageSize { width, height } = stack.images[source.image].size();
        let mut bytes = vec![0; width as usize * height as usize];
        if let Some(laid) = canvas.laid.iter().find(|laid| laid.source == index) {
            let rows = canvas.levels[laid.content][0].chunks_exact(laid.size.0 as usize);
            for (row, y) in rows.zip(laid.corner.1..) {
                let start = (y * width + laid.corner.0) as usize;
                for (byte, texel) in bytes[start..start + row.len()].iter_mut().zip(row) {
                    *byte = texel[3];
                }
            }
        }
        Raster::from_u8(width, height, 1, ColorSpace::Linear, &bytes)
    };
    let masks = stack.patches.iter().enumerate().map(mask).collect::<Result<_, _>>();
    masks.map_err(EncodeError::Source)
}

fn lay_all(stack: &PatchStack, params: &ZipParams, job: &mut Job<'_>) -> Result<Laying, EncodeError> {
    let order = stack.order().map_err(fault)?;
    let pixel = pixel_of(stack);
    let deep = deep_levels(stack);
    let size = stack.root.size();
    let root_levels = size.full_levels().min(MAX_LEVELS - deep);
    let root = stack.root.with_channels(pixel.channels);
    let cancel = job.cancel_check();
    let mut canvas = Canvas {
        root_size: (size.width, size.height),
        root: job.install(|| levels::of_root(&root, root_levels, cancel))?,
        laid: Vec::new(),
        levels: Vec::new(),
    };
    let mut dropped = Dropped::default();
    let mut stamps = stamps(stack);
    for (step, &index) in order.iter().enumerate() {
        job.stage("merging patches", 0.6 * step as f32 / order.len() as f32)?;
        let mut layer = Layer { stack, params, canvas: &mut canvas, dropped: &mut dropped, cancel };
        job.install(|| match stamps.iter_mut().find(|stamp| stamp.patches.contains(&index)) {
            Some(stamp) => layer.lay_stamp(index, stamp),
            None => layer.lay(index),
        })?;
        job.checkpoint()?;
    }
    for stamp in &stamps {
        dropped.note_levels(&stamp.levels, stamp.content.map_or(0, |content| canvas.levels[content].len()));
    }
    job.stage("hidden patches", 0.6)?;
    let before: u64 = canvas.levels.iter().map(|levels| texels_of(levels)).sum();
    dropped.hidden = job.install(|| remove_hidden(&mut canvas, cancel));
    job.checkpoint()?;
    dropped.patch_texels += before - canvas.levels.iter().map(|levels| texels_of(levels)).sum::<u64>();
    Ok(Laying { canvas, dropped, pixel, deep })
}

fn check(stack: &PatchStack) -> Result<(), ZipError> {
    if stack.patches.len() > MAX_PATCHES {
        return Err(ZipError::TooMany { patches: stack.patches.len(), max: MAX_PATCHES });
    }
    for image in stack.images.iter().chain([&stack.root]) {
        let ImageSize { width, height } = image.size();
        if width > MAX_PLANE_SIDE || height > MAX_PLANE_SIDE {
            return Err(ZipError::TooLarge { width, height });
        }
    }
    for (patch, source) in stack.patches.iter().enumerate() {
        let image = stack.images.get(source.image).ok_or(ZipError::NoImage { patch, image: source.image })?;
        let inverse = source.matrix.inverse();
        let exact = (source.matrix * inverse - DMat3::IDENTITY).to_cols_array();
        if !source.matrix.is_finite() || exact.iter().any(|value| value.is_nan() || value.abs() > 1e-6) {
            return Err(ZipError::Singular { patch });
        }
        let share = crate::linear::area(&seen_in(&source.matrix, DVec2::ONE, DVec2::ONE));
        if share.is_nan() || share < LEAST_SHARE {
            return Err(ZipError::Outside { patch });
        }
        let size = |raster: &Raster| (raster.size().width, raster.size().height);
        if let Some(mask) = source.mask.as_ref().filter(|mask| size(mask) != size(image)) {
            return Err(ZipError::MaskSize { patch, found: size(mask), wanted: size(image) });
        }
    }
    Ok(())
}

/// Channels of the root, as many as hold the colours of all images.
fn pixel_of(stack: &PatchStack) -> PixelInfo {
    let info = stack.root.info();
    let rgb = stack.images.iter().chain([&stack.root]).any(|image| image.info().channels > 2);
    let channels = if rgb { 3 } else { 1 } + u8::from(info.has_alpha());
    let alpha = if info.has_alpha() { Alpha::Straight } else { Alpha::Opaque };
    PixelInfo { channels, alpha, ..info }
}

/// Levels finer than the root, until the finest patch has a texel for each of theirs.
fn deep_levels(stack: &PatchStack) -> u32 {
    let zoom = stack.patches.iter().map(|patch| stack.zoom(patch)).filter(|zoom| zoom.is_finite());
    let wanted = zoom.fold(1.0, f64::max).log2().ceil().clamp(0.0, 15.0) as u32;
    let size = stack.root.size();
    let longest = size.width.max(size.height);
    (0..=wanted).rev().find(|&deep| u64::from(longest) << deep <= u64::from(MAX_IMAGE_SIDE)).unwrap_or(0)
}

/// Lays patches on the canvas. What it leaves is of no use once the job is cancelled.
struct Layer<'a> {
    stack: &'a PatchStack,
    params: &'a ZipParams,
    canvas: &'a mut Canvas,
    dropped: &'a mut Dropped,
    cancel: CancelCheck<'a>,
}

impl Layer<'_> {
    /// Lays one patch, or notes why not.
    fn lay(&mut self, index: usize) -> Result<(), EncodeError> {
        let (stack, source) = (self.stack, &self.stack.patches[index]);
        let image = &stack.images[source.image];
        let zoom = stack.zoom(source);
        let parent = source.parent;
        let under = parent.and_then(|parent| self.canvas.laid.iter().find(|laid| laid.source == parent));
        let step = zoom / under.map_or(1.0, |laid| laid.zoom);
        let Cropped { mut patch, mask, cut } = cropped(image, source, step, true, self.cancel)?;
        self.dropped.cropped_texels += cut;
        if self.params.merge {
            merge::merge(&mut patch, self.canvas, image, self.cancel);
        }
        let alpha = mask.unwrap_or_else(|| self.geodesic(&patch));
        let mut levels = levels::of_patch(&patch.texels, &alpha, patch.size, image.info(), self.cancel)?;
        let content = self.canvas.levels.len();
        let laid = patch.laid(index, zoom, content);
        let all = levels.clone();
        self.drop_levels(&laid, &mut levels);
        if levels.is_empty() {
            self.dropped.nothing_new.push(index);
            self.dropped.patch_texels += texels_of(&all);
            return Ok(());
        }
        self.dropped.note_levels(&all, levels.len());
        self.canvas.laid.push(laid);
        self.canvas.levels.push(levels);
        Ok(())
    }

    /// Lays one of the places of an image that several patches share. All have the levels that one of them needs.
    fn lay_stamp(&mut self, index: usize, stamp: &mut Stamp) -> Result<(), EncodeError> {
        let source = &self.stack.patches[index];
        let image = &self.stack.images[source.image];
        let Cropped { patch, mask, cut } = cropped(image, source, 1.0, false, self.cancel)?;
        if stamp.levels.is_empty() {
            let alpha = mask.unwrap_or_else(|| self.geodesic(&patch));
            stamp.levels = levels::of_patch(&patch.texels, &alpha, patch.size, image.info(), self.cancel)?;
            self.dropped.cropped_texels += cut;
        }
        let content = stamp.content.unwrap_or(self.canvas.levels.len());
        let laid = patch.laid(index, self.stack.zoom(source), content);
        let mut levels = stamp.levels.clone();
        self.drop_levels(&laid, &mut levels);
        if levels.is_empty() {
            self.dropped.nothing_new.push(index);
            return Ok(());
        }
        match stamp.content {
            Some(content) if self.canvas.levels[content].len() >= levels.len() => (),
            Some(content) => self.canvas.levels[content] = levels,
            None => self.canvas.levels.push(levels),
        }
        stamp.content = Some(content);
        self.canvas.laid.push(laid);
        Ok(())
    }

    fn geodesic(&self, patch: &PatchTexels) -> Vec<f32> {
        let size = (patch.size.0 as usize, patch.size.1 as usize);
        mask::geodesic(&patch.texels, size, self.params.tau, self.cancel)
    }

    fn drop_levels(&self, laid: &Laid, levels: &mut Vec<Vec<[u8; 4]>>) {
        let (color, least) = (self.stack.root.info().color, self.params.least_difference());
        trim::drop_levels(laid, levels, self.canvas, color, least, self.cancel);
    }
}

/// The part of an image that is laid.
struct Cropped {
    patch: PatchTexels,
    /// Opacity of each texel; by the image's gradients alone where there is none.
    mask: Option<Vec<f32>>,
    /// Texels that were cut off.
    cut: u64,
}

/// The part of an image that its mask leaves opaque and, where that counts, the root.
fn cropped(
    image: &Raster,
    source: &PatchSource,
    step: f64,
    by_root: bool,
    cancel: CancelCheck<'_>,
) -> Result<Cropped, EncodeError> {
    let size = image.size();
    let extent = DVec2::new(f64::from(size.width), f64::from(size.height));
    let polygon = if by_root { seen_in(&source.matrix, DVec2::ONE, DVec2::ONE) } else { Vec::new() };
    let low = polygon.iter().copied().reduce(DVec2::min).unwrap_or(DVec2::ZERO) * extent;
    let high = polygon.iter().copied().reduce(DVec2::max).unwrap_or(DVec2::ONE) * extent;
    let (mut left, mut top) = (low.x.floor() as u32, low.y.floor() as u32);
    let (mut right, mut bottom) = (
        (high.x.ceil() as u32).clamp(left + 1, size.width.max(left + 1)),
        (high.y.ceil() as u32).clamp(top + 1, size.height.max(top + 1)),
    );
    if let Some(mask) = &source.mask {
        let opaque = |x: u32, y: u32| !cancel.is_cancelled() && mask.texel(x, y).x > 0.0;
        let columns = (left..right).filter(|&x| (top..bottom).any(|y| opaque(x, y)));
        let rows = (top..bottom).filter(|&y| (left..right).any(|x| opaque(x, y)));
        let (columns, rows): (Vec<u32>, Vec<u32>) = (columns.collect(), rows.collect());
        if let (Some(x), Some(y), Some(r), Some(b)) =
            (columns.first(), rows.first(), columns.last(), rows.last())
        {
            // A texel more on each side: the border is transparent.
            (left, top) = (x.saturating_sub(1).max(left), y.saturating_sub(1).max(top));
            (right, bottom) = ((r + 2).min(right), (b + 2).min(bottom));
        }
    }
    let (width, height) = (right - left, bottom - top);
    cancel.checkpoint()?;
    let at = |index: u32| (left + index % width, top + index / width);
    // Of known length; what is left out once the job is cancelled is of no use.
    let texel = |index: u32| {
        let (x, y) = if cancel.is_cancelled() { (left, top) } else { at(index) };
        image.texel(x, y).truncate().extend(1.0)
    };
    let texels: Vec<Texel> = (0..width * height).into_par_iter().map(texel).collect();
    cancel.checkpoint()?;
    let own = image.info().has_alpha();
    let mask = match &source.mask {
        None if !own => None,
        mask => {
            let painted = |x: u32, y: u32| mask.as_ref().map_or(1.0, |mask| mask.texel(x, y).x);
            let opacity = |index: u32| {
                let (x, y) = at(index);
                if cancel.is_cancelled() { 0.0 } else { painted(x, y) * image.texel(x, y).w }
            };
            Some((0..width * height).into_par_iter().map(opacity).collect())
        }
    };
    let corner = DVec2::new(f64::from(left), f64::from(top)) / extent;
    let share = DVec2::new(f64::from(width), f64::from(height)) / extent;
    let matrix =
        normalised(DMat3::from_scale(share.recip()) * DMat3::from_translation(-corner) * source.matrix);
    let cut = size.texels() - u64::from(width) * u64::from(height);
    let patch = PatchTexels { texels, size: (width, height), corner: (left, top), matrix, step };
    cancel.checkpoint()?;
    Ok(Cropped { patch, mask, cut })
}

/// Takes hidden patches off the canvas; which of the stack they are.
fn remove_hidden(canvas: &mut Canvas, cancel: CancelCheck<'_>) -> Vec<usize> {
    let hidden = trim::hidden(canvas, cancel);
    let sources = hidden.iter().map(|&index| canvas.laid[index].source).collect();
    for &index in hidden.iter().rev() {
        canvas.laid.remove(index);
    }
    // Images that no patch has any more.
    for content in (0..canvas.levels.len()).rev() {
        if canvas.laid.iter().all(|laid| laid.content != content) {
            canvas.levels.remove(content);
            for laid in canvas.laid.iter_mut().filter(|laid| laid.content > content) {
                laid.content -= 1;
            }
        }
    }
    sources
}

/// Contents to try for the root, the smallest first.
fn contents(pixel: PixelInfo, params: &ZipParams) -> Vec<Content> {
    if let Some(content) = params.content {
        // Of one or two channels BC1 and BC7 have formats of their own.
        let content = match (content, pixel.channels) {
            (Content::Bc1 | Content::Bc3 | Content::Bc7, 1) => Content::Bc4,
            (Content::Bc1 | Content::Bc3 | Content::Bc7, 2) => Content::Bc5,
            (Content::Bc3, 3) => Content::Bc1,
            _ => content,
        };
        return vec![if content.fits(pixel) { content } else { Content::Raw }];
    }
    match pixel.channels {
        1 => vec![Content::Bc4, Content::Raw],
        2 => vec![Content::Bc5, Content::Raw],
        3 => vec![Content::Bc1, Content::Bc7, Content::Raw],
        _ => vec![Content::Bc7, Content::Raw],
    }
}
