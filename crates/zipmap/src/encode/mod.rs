//! The method on one screen: check, lay patch by patch on a canvas (crop, fit colours, mask, mip levels, trim), leave out what
//! is hidden, store in the content that the goal asks for.

mod canvas;
mod levels;
mod mask;
mod merge;
mod multigrid;
mod report;
mod trim;

use glam::{DMat3, DVec2};
use rayon::prelude::*;
use texfold_bc::{Content, ContentPlanes};
use texfold_core::image::{Alpha, PixelInfo, Raster};
use texfold_core::metric::SquaredError;
use texfold_core::{EncodeError, Goal, ImageLayout, Job, Notes, Params, SurfaceSize, Texel, TextureCodec};

use crate::encoded::{MAX_PATCHES, MAX_PLANE_SIDE, Parts, PatchForm};
use crate::linear::{normalised, seen_in};
use crate::wire::{patch_pixel, suits_patches};
use crate::{PatchSource, PatchStack, ZipError, ZipParams, ZipTexture, Zipmap};
use canvas::{Canvas, Laid};
use merge::Bare;
pub use report::{Fidelity, fidelity};

/// Most levels of a file.
const MAX_LEVELS: u32 = 16;
/// Longest side of the finest level.
const MAX_SIDE: u32 = 1 << 15;
/// Least share of a patch that the root shows.
const LEAST_SHARE: f64 = 1e-6;

/// What was left out, for the report.
#[derive(Debug, Clone, Default)]
pub(crate) struct Dropped {
    pub(crate) levels: usize,
    pub(crate) level_texels: u64,
    pub(crate) nothing_new: Vec<usize>,
    pub(crate) hidden: Vec<usize>,
    pub(crate) cropped_texels: u64,
}

fn fault(error: ZipError) -> EncodeError {
    EncodeError::Codec { codec: Zipmap::ID, source: Box::new(error) }
}

pub(crate) fn encode(
    stack: &PatchStack,
    params: &ZipParams,
    job: &mut Job<'_>,
) -> Result<ZipTexture, EncodeError> {
    params.check()?;
    check(stack).map_err(fault)?;
    let order = stack.order().map_err(fault)?;
    let pixel = pixel_of(stack);
    let deep = deep_levels(stack);
    let size = stack.root.size();
    let root_levels = size.full_levels().min(MAX_LEVELS - deep);
    let root = stack.root.with_channels(pixel.channels);
    let mut canvas = Canvas {
        root_size: (size.width, size.height),
        root: job.install(|| levels::of_root(&root, root_levels)),
        laid: Vec::new(),
        levels: Vec::new(),
    };
    let mut dropped = Dropped::default();
    for (step, &index) in order.iter().enumerate() {
        job.stage("merging patches", 0.6 * step as f32 / order.len() as f32)?;
        job.install(|| lay(stack, index, params, &mut canvas, &mut dropped));
    }
    job.stage("hidden patches", 0.6)?;
    dropped.hidden = job.install(|| remove_hidden(&mut canvas));
    let mut best = None;
    let contents = contents(pixel, params);
    for (index, &content) in contents.iter().enumerate() {
        job.stage("compressing blocks", 0.65 + 0.3 * index as f32 / contents.len() as f32)?;
        let (texture, loss) = job
            .install(|| {
                let texture = store(&canvas, pixel, deep, root_levels, content, params)?;
                let loss = loss(&canvas, &texture).psnr();
                Some((texture, loss))
            })
            .ok_or(fault(ZipError::Full))?;
        let met = !matches!(params.goal, Goal::Psnr(wanted) if loss < wanted);
        best = Some((texture, loss));
        if met {
            break;
        }
    }
    let (texture, loss) = best.ok_or(fault(ZipError::Full))?;
    job.stage("measuring", 0.95)?;
    let notes = job.install(|| report::notes(stack, params, &texture, &dropped, loss));
    job.stage("done", 1.0)?;
    Ok(texture.with_notes(notes))
}

fn check(stack: &PatchStack) -> Result<(), ZipError> {
    if stack.patches.len() > MAX_PATCHES {
        return Err(ZipError::TooMany { patches: stack.patches.len(), max: MAX_PATCHES });
    }
    for image in stack.images.iter().chain([&stack.root]) {
        let SurfaceSize { width, height } = image.size();
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
    (0..=wanted).rev().find(|&deep| u64::from(longest) << deep <= u64::from(MAX_SIDE)).unwrap_or(0)
}

/// Lays one patch on the canvas, or says why not.
fn lay(stack: &PatchStack, index: usize, params: &ZipParams, canvas: &mut Canvas, dropped: &mut Dropped) {
    let source = &stack.patches[index];
    let image = &stack.images[source.image];
    let zoom = stack.zoom(source);
    let under = source.parent.and_then(|parent| canvas.laid.iter().find(|laid| laid.source == parent));
    let step = zoom / under.map_or(1.0, |laid| laid.zoom);
    let (mut bare, mask, cut) = cropped(image, source, step);
    dropped.cropped_texels += cut;
    if params.merge {
        merge::merge(&mut bare, canvas, image);
    }
    let (width, height) = bare.size;
    let alpha = match &mask {
        Some(mask) => mask.clone(),
        None => mask::geodesic(&bare.texels, width as usize, height as usize, params.tau),
    };
    let mut levels = levels::of_patch(&bare.texels, &alpha, bare.size, image.info());
    let laid = Laid { source: index, matrix: bare.matrix, size: bare.size, zoom };
    let all = levels.clone();
    let color = stack.root.info().color;
    trim::drop_levels(&laid, &mut levels, canvas, color, f64::from(params.drop_rms));
    if levels.is_empty() {
        dropped.nothing_new.push(index);
        return;
    }
    dropped.levels += all.len() - levels.len();
    dropped.level_texels += all[levels.len()..].iter().map(|level| level.len() as u64).sum::<u64>();
    canvas.laid.push(laid);
    canvas.levels.push(levels);
}

/// The part of an image that the root and its mask show, its mask, and how many texels were cut off.
fn cropped(image: &Raster, source: &PatchSource, step: f64) -> (Bare, Option<Vec<f32>>, u64) {
    let size = image.size();
    let extent = DVec2::new(f64::from(size.width), f64::from(size.height));
    let polygon = seen_in(&source.matrix, DVec2::ONE, DVec2::ONE);
    let low = polygon.iter().copied().reduce(DVec2::min).unwrap_or(DVec2::ZERO) * extent;
    let high = polygon.iter().copied().reduce(DVec2::max).unwrap_or(DVec2::ONE) * extent;
    let (mut left, mut top) = (low.x.floor() as u32, low.y.floor() as u32);
    let (mut right, mut bottom) = (
        (high.x.ceil() as u32).clamp(left + 1, size.width.max(left + 1)),
        (high.y.ceil() as u32).clamp(top + 1, size.height.max(top + 1)),
    );
    if let Some(mask) = &source.mask {
        let shown = |x: u32, y: u32| mask.texel(x, y).x > 0.0;
        let columns = (left..right).filter(|&x| (top..bottom).any(|y| shown(x, y)));
        let rows = (top..bottom).filter(|&y| (left..right).any(|x| shown(x, y)));
        let (columns, rows): (Vec<u32>, Vec<u32>) = (columns.collect(), rows.collect());
        if let (Some(x), Some(y), Some(r), Some(b)) =
            (columns.first(), rows.first(), columns.last(), rows.last())
        {
            // A texel more on each side: the border is not shown.
            (left, top) = (x.saturating_sub(1).max(left), y.saturating_sub(1).max(top));
            (right, bottom) = ((r + 2).min(right), (b + 2).min(bottom));
        }
    }
    let (width, height) = (right - left, bottom - top);
    let places = || (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y)));
    let texels: Vec<Texel> = places().map(|(x, y)| image.texel(x, y).truncate().extend(1.0)).collect();
    let own = image.info().has_alpha();
    let mask = match &source.mask {
        None if !own => None,
        mask => {
            let painted = |x: u32, y: u32| mask.as_ref().map_or(1.0, |mask| mask.texel(x, y).x);
            Some(places().map(|(x, y)| painted(x, y) * image.texel(x, y).w).collect())
        }
    };
    let corner = DVec2::new(f64::from(left), f64::from(top)) / extent;
    let share = DVec2::new(f64::from(width), f64::from(height)) / extent;
    let matrix =
        normalised(DMat3::from_scale(share.recip()) * DMat3::from_translation(-corner) * source.matrix);
    let cut = size.texels() - u64::from(width) * u64::from(height);
    (Bare { texels, size: (width, height), matrix, step }, mask, cut)
}

/// Takes hidden patches off the canvas; which of the stack they are.
fn remove_hidden(canvas: &mut Canvas) -> Vec<usize> {
    let hidden = trim::hidden(canvas);
    let sources = hidden.iter().map(|&index| canvas.laid[index].source).collect();
    for &index in hidden.iter().rev() {
        canvas.laid.remove(index);
        canvas.levels.remove(index);
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

fn store(
    canvas: &Canvas,
    pixel: PixelInfo,
    deep: u32,
    root_levels: u32,
    content: Content,
    params: &ZipParams,
) -> Option<ZipTexture> {
    let (width, height) = canvas.root_size;
    let of_patches = patch_pixel(pixel);
    let patch_content = match (content, params.content) {
        (Content::Raw, _) => Content::Raw,
        (_, Some(Content::Bc3)) if suits_patches(Content::Bc3, of_patches) => Content::Bc3,
        _ if of_patches.channels == 2 => Content::Bc5,
        _ => Content::Bc7,
    };
    let texels = |level: &[[u8; 4]]| -> Vec<Texel> {
        level.iter().map(|bytes| Texel::from_array(bytes.map(f32::from)) / 255.0).collect()
    };
    let encode = |(content, pixel), level: usize, size: (u32, u32), bytes: &[[u8; 4]]| {
        let size = ((size.0 >> level).max(1), (size.1 >> level).max(1));
        ContentPlanes::encode(content, pixel, size, &texels(bytes), params.effort)
    };
    let root =
        canvas.root.iter().enumerate().map(|(k, level)| encode((content, pixel), k, canvas.root_size, level));
    let patch = |(laid, levels): (&Laid, &Vec<Vec<[u8; 4]>>)| PatchForm {
        matrix: laid.rows(),
        levels: levels
            .iter()
            .enumerate()
            .map(|(k, level)| encode((patch_content, of_patches), k, laid.size, level))
            .collect(),
    };
    let layout = ImageLayout {
        surfaces: vec![SurfaceSize { width: width << deep, height: height << deep }],
        levels: deep + root_levels,
        pixel,
    };
    let patches = canvas.laid.par_iter().zip(&canvas.levels).map(patch).collect();
    ZipTexture::new(Parts { layout, deep, root: root.collect(), patches }, Notes::default())
}

/// What compression changes, at texels of the root and of all patches.
fn loss(canvas: &Canvas, texture: &ZipTexture) -> SquaredError {
    let names: Vec<u16> = (0..canvas.laid.len() as u16).collect();
    let mut error = SquaredError::default();
    let places = std::iter::once((None, canvas.root_size))
        .chain(canvas.laid.iter().map(|laid| (Some(laid), laid.size)));
    for (laid, size) in places {
        let matrix = laid.map_or(DMat3::IDENTITY, |laid| laid.matrix);
        let names = if laid.is_some() { canvas.touching(&matrix) } else { names.clone() };
        let table = canvas.table(&names);
        error = error + report::compare(&canvas.view(&table), &texture.view(), &matrix.inverse(), size);
    }
    error
}
