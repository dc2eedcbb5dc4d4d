//! By block or by texel: blocks first, and the other form where they miss the goal.

use texfold_core::image::{ImageSet, MipFilter, mip_chain_cancellable};
use texfold_core::metric::{measure_cancellable, quality_cancellable};
use texfold_core::target::{Measured, excess, search_step};
use texfold_core::{
    Access, BLOCK_LEVELS, CancelCheck, EncodeError, Encoded, Goal, Job, Metric, Notes, Params, SourceError,
};
use texfold_residual::RESIDUAL_PART;
use texfold_residual::block::encode::{BlockParams, BlockSetEncoder, BlockSource, STEPS};

use super::report::settings;
use crate::{BlockImages, ProgressiveParams, ProgressiveTexture, TexelTexture};

/// Encodes in the form that the parameters name, or by texel where that answers the goal better.
pub(crate) fn encode(
    source: &ImageSet,
    params: &ProgressiveParams,
    by_texel: impl FnOnce(&mut Job<'_>) -> Result<TexelTexture, EncodeError>,
    job: &mut Job<'_>,
) -> Result<ProgressiveTexture, EncodeError> {
    params.check()?;
    source.check_sides()?;
    if !params.tries_blocks() {
        return by_texel(job).map(ProgressiveTexture::from);
    }
    let (images, measured) = job.within(0.0, 0.5, |job| by_block(source, params, job))?;
    let met = params.goal.is_met(&measured);
    // A tolerance is that of the worst block, which may be worth bits that all others would have to take, too.
    if met && !matches!(params.goal, Goal::Tolerance(_)) {
        let notes = notes(source, &images, params, met, job)?;
        job.stage("done", 1.0)?;
        return Ok(ProgressiveTexture::Block(images.with_notes(notes)));
    }
    let texture = job.within(0.5, 1.0, by_texel)?;
    let check = job.cancel_check();
    let other = job.install(|| measure_cancellable(source, &texture, check))?;
    if !params.goal.prefers(&other, &measured) {
        let notes = notes(source, &images, params, met, job)?;
        return Ok(ProgressiveTexture::Block(images.with_notes(notes)));
    }
    let why = if met { "takes fewer bits" } else { "comes nearer to the goal" };
    let mut notes = texture.notes().clone();
    notes.verdict = format!("By texel, which {why} than by block here. {}", notes.verdict);
    Ok(texture.with_notes(notes).into())
}

/// The images in blocks with the step that answers the goal best.
fn by_block(
    source: &ImageSet,
    params: &ProgressiveParams,
    job: &mut Job<'_>,
) -> Result<(BlockImages, Measured), EncodeError> {
    let (info, goal) = (source.info(), params.goal);
    job.stage("transforming", 0.0)?;
    let check = job.cancel_check();
    let block_params = BlockParams::default()
        .with_goal(goal)
        .with_effort(params.effort)
        .with_metric(params.metric_for(info));
    let layout = source.layout(if params.mips { source.full_levels() } else { 1 });
    let sources = job.install(|| stages(source, layout.levels, check))?;
    let encoder = job.install(|| BlockSetEncoder::new(layout, &sources, &block_params, check))?;
    let mut tried = 0u32;
    let found = search_step(goal, STEPS, encoder.first_step(), |step| {
        tried += 1;
        job.stage("coding blocks", tried as f32 / (tried as f32 + 4.0))?;
        let images = BlockImages::new(job.install(|| encoder.at_step(step))?);
        let measured = match goal {
            // Bits need no decoding.
            Goal::Bpp(_) => Measured { bpp: bits(source, &images), psnr: 0.0, worst_block_rms: 0.0 },
            _ => job.install(|| measure_cancellable(source, &images, check))?,
        };
        let by = excess(goal, &measured);
        Ok::<_, EncodeError>(((images, measured), by))
    })?;
    let (images, measured) = found.ok_or(SourceError::Empty)?.value;
    match goal {
        Goal::Bpp(_) => {
            let measured = job.install(|| measure_cancellable(source, &images, check))?;
            Ok((images, measured))
        }
        _ => Ok((images, measured)),
    }
}

/// The stages of all images: mip levels 0, 3, 6 and so on.
fn stages(source: &ImageSet, levels: u32, check: CancelCheck<'_>) -> Result<Vec<BlockSource>, EncodeError> {
    let depth = source.info().depth;
    let mut stages = Vec::new();
    for image in source.images() {
        let levels = levels.min(image.size().full_levels());
        let chain = mip_chain_cancellable(image, levels, MipFilter::Box, check)?;
        let samples =
            chain.iter().step_by(BLOCK_LEVELS as usize).map(|level| BlockSource::from_raster(level, depth));
        stages.extend(samples.collect::<Result<Vec<_>, SourceError>>()?);
    }
    Ok(stages)
}

fn bits(source: &ImageSet, images: &BlockImages) -> f64 {
    images.memory().counted as f64 / source.texel_count() as f64
}

/// Settings, verdict, and the PSNR of the bases alone.
fn notes(
    source: &ImageSet,
    images: &BlockImages,
    params: &ProgressiveParams,
    met: bool,
    job: &Job<'_>,
) -> Result<Notes, EncodeError> {
    let layers = images.layers();
    let mut psnr_without = Vec::new();
    let base_alone = images.first_layers(1);
    if layers.total > 1 {
        let check = job.cancel_check();
        let alone = job.install(|| quality_cancellable(source, &base_alone, check))?;
        psnr_without.push((RESIDUAL_PART.to_owned(), alone.color.psnr() as f32));
    }
    let metric = params.metric_for(source.info());
    let weighted = match metric {
        Metric::Psnr => "errors count alike",
        Metric::Perceptual => "errors count less the finer they are",
    };
    let base = 8.0 * base_alone.content().held_bytes() as f64 / source.texel_count() as f64;
    let missed = if met { "" } else { " The goal is out of reach; this comes nearest." };
    let verdict = format!(
        "By block: {:.3} bits a texel, {base:.3} of them in headers and bases of 1/8 of the width and height; {weighted}.{missed}",
        bits(source, images),
    );
    let access = format!(" --access {} --metric {}", Access::Block.name(), metric.name());
    Ok(Notes { settings: settings(params) + &access, verdict, psnr_without })
}
