//! Root and patch images in blocks of variable length: one step for all of them, which the goal decides. No fine level is left out,
//! as detail that a step does not reach costs next to nothing. Two of three levels are means of the one before, which blocks give.

use std::cell::RefCell;

use texfold_core::metric::SquaredError;
use texfold_core::target::{Measured, search_step_estimated};
use texfold_core::{
    Access, CancelCheck, DCT_LEVELS, EncodeError, Encoded, Goal, ImageLayout, ImageSize, Job, Notes,
    SourceError,
};
use texfold_dct::encode::{DctSetEncoder, DctSettings, DctSource, Estimate, STEPS};

use super::enlarge::change;
use super::fault;
use super::fit::{Fitted, Maker, fit};
use super::trim;
use crate::atlas::{Packing, pack};
use crate::parts::{
    BLOCK_SIDE, ImageForm, Parts, Payload, atlas_layout, atlas_mips, patch_pixel, root_layout,
};
use crate::{ZipError, ZipTexture};

/// The texture in the form that the parameters name, or in planes where these answer the goal better.
pub(crate) fn choose(
    maker: &mut Maker<'_>,
    contents: &[texfold_bc::Content],
    source_texels: f64,
    job: &mut Job<'_>,
) -> Result<(Measured, Fitted), EncodeError> {
    let goal = maker.params.goal;
    if maker.params.access == Access::Texel || maker.params.content.is_some() {
        return fit(maker, contents, source_texels, job);
    }
    let (measured, fitted) = by_block(maker, source_texels, job)?;
    // A tolerance is that of the worst block, which may be worth bits that all others would have to take, too.
    if goal.is_met(&measured) && !matches!(goal, Goal::Tolerance(_)) {
        return Ok((measured, fitted));
    }
    let (other, planes) = fit(maker, contents, source_texels, job)?;
    Ok(if goal.prefers(&other, &measured) { (other, planes) } else { (measured, fitted) })
}

/// The texture in blocks with the step that answers the goal best.
fn by_block(
    maker: &Maker<'_>,
    source_texels: f64,
    job: &mut Job<'_>,
) -> Result<(Measured, Fitted), EncodeError> {
    let (goal, check) = (maker.params.goal, maker.cancel);
    job.stage("transforming", 0.65)?;
    let mut sources = job.install(|| Sources::of(maker))?;
    let encoders = job.install(|| sources.encoders(maker, check))?;
    let estimate = |step: u16| {
        let parts = encoders.iter().map(|encoder| encoder.estimate(step));
        let sum = parts.sum::<Result<Estimate, EncodeError>>()?;
        Ok::<_, EncodeError>(sum.measured(source_texels as u64))
    };
    let mut tried = 0u32;
    // Estimating and making take turns.
    let turns = RefCell::new(&mut *job);
    let found = search_step_estimated(
        goal,
        STEPS.at(maker.params.effort),
        encoders[0].first_step(goal),
        |step| turns.borrow().install(|| estimate(step)),
        |step| {
            let mut job = turns.borrow_mut();
            tried += 1;
            job.stage("coding blocks", 0.65 + 0.3 * tried as f32 / (tried as f32 + 1.0))?;
            let texture = job.install(|| sources.texture(maker, &encoders, step))?;
            let measured = match goal {
                // Bits need no decoding.
                Goal::Bpp(_) => {
                    let bpp = texture.memory().goal as f64 / source_texels;
                    Measured { bpp, ..Measured::default() }
                }
                _ => job.install(|| measured(maker, &texture, source_texels))?.0,
            };
            Ok((texture, measured))
        },
    )?;
    let texture = found.ok_or(SourceError::Empty)?.value;
    let (measured, losses) = job.install(|| measured(maker, &texture, source_texels))?;
    let cuts = vec![0; maker.canvas.levels.len()];
    let zooms = maker.canvas.laid.iter().map(|laid| laid.zoom).collect();
    Ok((measured, Fitted { texture, losses, cuts, zooms }))
}

/// What is coded: the stages of the root, and the image of all patch images.
struct Sources {
    root: (ImageLayout, Vec<DctSource>),
    atlas: Option<(ImageLayout, Vec<DctSource>)>,
    images: Vec<ImageForm>,
}

impl Sources {
    fn of(maker: &Maker<'_>) -> Result<Sources, EncodeError> {
        let canvas = maker.canvas;
        let of_image = |(index, levels): (usize, &Vec<Vec<[u8; 4]>>)| {
            let (width, height) = maker.size_of(Some(index));
            ImageForm { size: ImageSize { width, height }, levels: levels.len() as u32 }
        };
        let images: Vec<ImageForm> = canvas.levels.iter().enumerate().map(of_image).collect();
        let mips = atlas_mips(&images);
        let packing = pack(&images, BLOCK_SIDE, mips).ok_or(fault(ZipError::Full))?;
        let (width, height) = canvas.root_size;
        let size = ImageSize { width, height };
        let layout = root_layout(size, canvas.root.len() as u32, maker.pixel);
        let stages = (0u32..).zip(&canvas.root).step_by(DCT_LEVELS as usize);
        let root = stages
            .map(|(level, texels)| source(size.at_level(level), maker.pixel.channels, texels))
            .collect::<Result<Vec<_>, SourceError>>()?;
        let atlas = if images.is_empty() {
            None
        } else {
            let layout = atlas_layout(packing.1, mips, maker.pixel);
            let channels = patch_pixel(maker.pixel).channels;
            Some((layout, vec![atlas_source(maker, (&images, mips), &packing, channels)?]))
        };
        Ok(Sources { root: (layout, root), atlas, images })
    }

    /// Of the root, and of the patch images where there are any. Their samples go.
    fn encoders<'a>(
        &mut self,
        maker: &Maker<'_>,
        check: CancelCheck<'a>,
    ) -> Result<Vec<DctSetEncoder<'a>>, EncodeError> {
        let params = DctSettings::default()
            .with_goal(maker.params.goal)
            .with_effort(maker.params.effort)
            .with_metric(maker.params.metric_for(maker.pixel));
        let sources = [Some(&mut self.root), self.atlas.as_mut()].into_iter().flatten();
        let encoder = |(layout, sources): &mut (ImageLayout, Vec<DctSource>)| {
            let sources = std::mem::take(sources).into_iter().map(Ok);
            DctSetEncoder::new(layout.clone(), sources, &params, check)
        };
        sources.map(encoder).collect()
    }

    /// The texture of that step.
    fn texture(
        &self,
        maker: &Maker<'_>,
        encoders: &[DctSetEncoder<'_>],
        step: u16,
    ) -> Result<ZipTexture, EncodeError> {
        let contents = encoders.iter().map(|encoder| encoder.at_step(step));
        let mut contents = contents.collect::<Result<Vec<_>, EncodeError>>()?.into_iter();
        let root = contents.next().ok_or(SourceError::Empty)?;
        let numbers: Vec<Option<usize>> = (0..self.images.len()).map(Some).collect();
        let parts = Parts {
            layout: maker.layout(),
            deep: maker.deep,
            payload: Payload::Blocks { root, atlas: contents.next().map(Box::new) },
            images: self.images.clone(),
            patches: maker.patches(&numbers),
        };
        ZipTexture::new(parts, Notes::default()).ok_or(fault(ZipError::Full))
    }
}

/// What a texture measures, and what compression changes at the texels of the root and of each patch.
fn measured(
    maker: &Maker<'_>,
    texture: &ZipTexture,
    source_texels: f64,
) -> Result<(Measured, Vec<SquaredError>), EncodeError> {
    maker.measured(texture, source_texels, || worst_block(maker, texture))
}

/// RMS error of the worst 4x4 block of the root and of all patch images, in 8-bit units, of the finest level of each.
fn worst_block(maker: &Maker<'_>, texture: &ZipTexture) -> f64 {
    let view = texture.view();
    let of = |index, source: &[Vec<[u8; 4]>], decoded: &[Vec<[u8; 4]>]| {
        let (Some(source), Some(decoded)) = (source.first(), decoded.first()) else { return 0.0 };
        change(source, maker.size_of(index), (decoded, 0), 0.0, maker.cancel).worst_block
    };
    let images = maker.canvas.levels.iter().zip(view.patches).enumerate();
    let images = images.map(|(index, (source, decoded))| of(Some(index), source, decoded));
    images.fold(of(None, &maker.canvas.root, view.root), f64::max)
}

/// Texels of that many channels.
fn source(size: ImageSize, channels: u8, texels: &[[u8; 4]]) -> Result<DctSource, SourceError> {
    let (groups, places): (&[u8], &[usize]) = match channels {
        1 => (&[1], &[0]),
        2 => (&[1, 1], &[0, 3]),
        3 => (&[3], &[0, 1, 2]),
        _ => (&[3, 1], &[0, 1, 2, 3]),
    };
    let samples: Vec<u8> =
        texels.iter().flat_map(|texel| places.iter().map(move |&place| texel[place])).collect();
    DctSource::from_u8(size, groups, &samples)
}

/// Patch images in one image, transparent between them: the levels that are stored. Colours are free where filtering reads no visible
/// texel of these or of the levels made of them.
fn atlas_source(
    maker: &Maker<'_>,
    (images, mips): (&[ImageForm], u32),
    (origins, (width, height)): &Packing,
    channels: u8,
) -> Result<DctSource, SourceError> {
    let canvas = maker.canvas;
    // A tolerance holds for every block.
    let hides = !matches!(maker.params.goal, Goal::Tolerance(_));
    let (width, height) = (*width as usize, *height as usize);
    let mut texels = vec![[0u8; 4]; width * height];
    let mut is_read = vec![false; width * height];
    for (content, ((levels, image), origins)) in canvas.levels.iter().zip(images).zip(origins).enumerate() {
        let index = canvas.laid.iter().position(|laid| laid.content == content).filter(|_| hides);
        for (level, (from, &origin)) in (0..).zip(levels.iter().zip(origins)) {
            let (size, mip) = (image.size.at_level(level), level % mips);
            let across = size.width as usize;
            let (left, top) = ((origin.0 << mip) as usize, (origin.1 << mip) as usize);
            if mip == 0 {
                for (row, line) in from.chunks_exact(across).enumerate() {
                    let start = (top + row) * width + left;
                    texels[start..start + across].copy_from_slice(line);
                }
            }
            let is_seen = match index {
                Some(index) => trim::seen_texels(canvas, index, level, maker.cancel),
                None => from.iter().map(|texel| texel[3] > 0).collect(),
            };
            for at in (0..from.len()).filter(|&at| is_seen[at]) {
                // Bilinear filtering reads a visible texel together with those around it, each a mean of those of a stored level.
                let around =
                    |at: usize, count: usize| at.saturating_sub(1) << mip..(at + 2).min(count) << mip;
                let columns = around(at % across, across);
                for y in around(at / across, size.height as usize) {
                    let start = (top + y) * width + left;
                    is_read[start + columns.start..start + columns.end].fill(true);
                }
            }
        }
    }
    let size = ImageSize { width: width as u32, height: height as u32 };
    Ok(source(size, channels, &texels)?.with_free_colours_but(usize::from(channels) - 1, &is_read))
}
