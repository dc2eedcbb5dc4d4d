//! Content in blocks of variable length: at all scales for the search, and as the epitome and the coarse mip levels of the file.

use texfold_bc::Content;
use texfold_core::image::{ColorSpace, MipFilter, Raster, mip_chain_cancellable};
use texfold_core::{
    CancelCheck, DCT_LEVELS, Effort, EncodeError, ImageLayout, ImageSize, Metric, Rect, SourceError, Texel,
    parallel,
};
use texfold_dct::encode::{DctEncoder, DctSetEncoder, DctSettings, DctSource, Estimate, STAGE_FINER};
use texfold_dct::{DctContent, DctTexture};
use texfold_match::Field;

use super::plan::Plan;
use super::pyramid::{Coder, SCALES, Space, Stored};
use super::refit::Drawn;
use crate::parts::{BlockParts, TRANSFORM_SIDE, coarse_layout, coarse_levels, epitome_layout};

/// An image's content at a scale: its decoded texels, and the bits of each of its cells.
struct Coded {
    field: Field,
    bits: Vec<f32>,
}

impl Space {
    /// All content in blocks of variable length, where a bit is worth `lambda`.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] where the job was cancelled.
    pub(super) fn store_in_blocks(
        &self,
        lambda: f32,
        metric: Metric,
        first: u32,
        cancel: CancelCheck<'_>,
    ) -> Result<Stored, EncodeError> {
        let scales = self.scales();
        let coded = parallel::map(self.pyramids.len() * scales, |number| {
            let (image, scale) = (number / scales, number % scales);
            let lambda = f64::from(lambda / SCALES[scale].weight());
            self.code(&self.pyramids[image].source[scale], lambda, metric, cancel)
        });
        let coded = coded.into_iter().collect::<Result<Vec<Coded>, EncodeError>>()?;
        let (bases, cells) = self.number_cells(TRANSFORM_SIDE, first);
        let (mut decoded, mut shares) = (Vec::new(), Vec::new());
        for Coded { field, bits } in coded {
            decoded.push(field);
            shares.extend(bits);
        }
        let mut decoded = decoded.into_iter();
        let decoded = self.pyramids.iter().map(|_| decoded.by_ref().take(scales).collect()).collect();
        Ok(Stored {
            content: Content::Raw,
            coder: Some(Coder::Blocks(metric)),
            cell: TRANSFORM_SIDE,
            cell_bits: 1.0,
            shares,
            bases,
            cells,
            planes: Vec::new(),
            decoded,
        })
    }

    fn code(
        &self,
        field: &Field,
        lambda: f64,
        metric: Metric,
        cancel: CancelCheck<'_>,
    ) -> Result<Coded, EncodeError> {
        let texels: Vec<Texel> = field.texels.iter().map(|texel| *texel / 255.0).collect();
        let raster = Raster::from_texels(field.width as u32, field.height as u32, self.pixel, &texels)?;
        let source = DctSource::from_raster(&raster, self.pixel.depth)?;
        let encoder = DctEncoder::new(&source, &params(metric, Effort::Fast), cancel)?;
        let (texture, bits) = encoder.at_step_with_bits(encoder.step_of(lambda / self.repeated()))?;
        Ok(Coded { field: decoded(texture, &raster)?, bits })
    }

    /// How often the error of a sample of colour is counted: gray stands for three channels.
    fn repeated(&self) -> f64 {
        if self.pixel.channels < 3 { 3.0 } else { 1.0 }
    }
}

fn params(metric: Metric, effort: Effort) -> DctSettings {
    DctSettings::default().with_metric(metric).with_effort(effort)
}

/// All texels of a texture of that image's size, in 8-bit units.
fn decoded(texture: DctTexture, image: &Raster) -> Result<Field, EncodeError> {
    let ImageSize { width, height } = image.size();
    let layout = ImageLayout::new(vec![image.size()], 1, image.info());
    let unlike = SourceError::Unlike { index: 0, what: "its size or channels" };
    let content = DctContent::new(layout, vec![texture]).ok_or(unlike)?;
    let mut texels = vec![Texel::ZERO; width as usize * height as usize];
    // The region is the whole image.
    let _ = content.decode(Rect { image: 0, level: 0, x: 0, y: 0, width, height }, &mut texels);
    texels.iter_mut().for_each(|texel| *texel *= 255.0);
    Ok(Field { width: width as usize, height: height as usize, texels })
}

/// The epitome of `drawn` texels with its mip level, and the coarse mip levels of all images, ready to be coded at any lambda.
#[derive(Debug)]
pub(super) struct BlockEncoders<'a> {
    epitome: DctSetEncoder<'a>,
    coarse: Option<DctSetEncoder<'a>>,
    /// Times that the error of a sample is counted.
    repeated: f64,
}

impl<'a> BlockEncoders<'a> {
    /// # Errors
    /// [`EncodeError::Cancelled`] where the job was cancelled.
    pub(super) fn new(
        plan: &Plan<'a>,
        metric: Metric,
        drawn: &Drawn,
        levels: u32,
    ) -> Result<Self, EncodeError> {
        let (space, cancel) = (plan.space, plan.cancel);
        let texels: Vec<Texel> = drawn.texels.iter().map(|texel| *texel / 255.0).collect();
        let image = Raster::from_texels(drawn.size.0, drawn.size.1, space.pixel, &texels)?;
        let source = DctSource::from_raster(&image, space.pixel.depth)?;
        let source = source.with_free_colours_but(usize::from(space.pixel.channels), &drawn.counts);
        let layout = epitome_layout(image.size(), &plan.images.layout(levels));
        let params = params(metric, plan.effort);
        let epitome = DctSetEncoder::new(layout, [Ok(source)], &params, cancel)?;
        Ok(BlockEncoders { epitome, coarse: coarse(plan, &params, levels)?, repeated: space.repeated() })
    }

    fn step_of(&self, lambda: f32) -> u16 {
        self.epitome.step_of(f64::from(lambda) / self.repeated)
    }

    /// The blocks at the step at which a bit is worth `lambda`.
    ///
    /// # Errors
    /// As [`BlockEncoders::new`].
    pub(super) fn at(&self, lambda: f32) -> Result<BlockParts, EncodeError> {
        let step = self.step_of(lambda);
        // Coarse levels are coded finer, as each further stage of an image is.
        let finer = step.saturating_sub(STAGE_FINER);
        let coarse = self.coarse.as_ref().map(|coarse| coarse.at_step(finer)).transpose()?;
        Ok(BlockParts { epitome: self.epitome.at_step(step)?, coarse })
    }

    /// Bits, and the PSNR of the epitome, where a bit is worth `lambda`, estimated.
    ///
    /// # Errors
    /// As [`BlockEncoders::new`].
    pub(super) fn estimate(&self, lambda: f32) -> Result<Estimate, EncodeError> {
        let step = self.step_of(lambda);
        let mut found = self.epitome.estimate(step)?;
        if let Some(coarse) = &self.coarse {
            found.bits += coarse.estimate(step.saturating_sub(STAGE_FINER))?.bits;
        }
        Ok(found)
    }
}

/// The levels that are not read from the epitome, of all images.
fn coarse<'a>(
    plan: &Plan<'a>,
    params: &DctSettings,
    levels: u32,
) -> Result<Option<DctSetEncoder<'a>>, EncodeError> {
    let layout = plan.images.layout(levels);
    let Some(layout) = coarse_layout(&layout) else { return Ok(None) };
    let first = coarse_levels(levels).start as usize;
    let mut sources = Vec::new();
    for (image, size) in plan.images.images().iter().zip(&layout.images) {
        let chain = mip_chain_cancellable(image, levels, MipFilter::Box, plan.cancel)?;
        let count = layout.levels.min(size.full_levels()) as usize;
        for level in chain.iter().skip(first).take(count).step_by(DCT_LEVELS as usize) {
            sources.push(DctSource::from_raster(level, layout.pixel.depth)?);
        }
    }
    DctSetEncoder::new(layout, sources.into_iter().map(Ok), params, plan.cancel).map(Some)
}

/// What content of colours of that space is judged by.
pub(super) fn metric_of(params: &crate::EpitomeParams, color: ColorSpace) -> Metric {
    params.metric.unwrap_or(Metric::for_goal(params.goal, color))
}
