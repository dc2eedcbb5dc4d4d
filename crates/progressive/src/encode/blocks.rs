//! Images by block: with the step that answers a goal, or with one that the caller names.

use texfold_core::RESIDUAL_PART;
use texfold_core::image::{ImageSet, MipFilter, mip_chain_cancellable};
use texfold_core::metric::{measure_for, quality_cancellable};
use texfold_core::target::{Measured, excess, search_step};
use texfold_core::{
    Access, CancelCheck, DCT_LEVELS, EncodeError, Encoded, Goal, ImageLayout, Job, Metric, Notes, Params,
    SourceError,
};
use texfold_dct::encode::{DctSetEncoder, DctSettings, DctSource, STEPS};

use super::report::settings;
use crate::{DctImages, ProgressiveParams};

/// The images in blocks with the step that answers the goal best.
pub(super) fn by_block(
    source: &ImageSet,
    params: &ProgressiveParams,
    job: &mut Job<'_>,
) -> Result<(DctImages, Measured), EncodeError> {
    let goal = params.goal;
    job.stage("transforming", 0.0)?;
    let check = job.cancel_check();
    let layout = layout_of(source, params);
    let sources = job.install(|| stages(source, layout.levels, check))?;
    let encoder =
        job.install(|| DctSetEncoder::new(layout, &sources, &block_params(source, params), check))?;
    let mut tried = 0u32;
    let found = search_step(goal, STEPS, encoder.first_step(), |step| {
        tried += 1;
        job.stage("coding blocks", tried as f32 / (tried as f32 + 4.0))?;
        let images = DctImages::new(job.install(|| encoder.at_step(step))?);
        let measured = match goal {
            // Bits need no decoding.
            Goal::Bpp(_) => Measured { bpp: bits(source, &images), psnr: 0.0, worst_block_rms: 0.0 },
            _ => job.install(|| measure_for(params.goal, source, &images, check))?,
        };
        let by = excess(goal, &measured);
        Ok::<_, EncodeError>(((images, measured), by))
    })?;
    let (images, measured) = found.ok_or(SourceError::Empty)?.value;
    match goal {
        Goal::Bpp(_) => {
            let measured = job.install(|| measure_for(params.goal, source, &images, check))?;
            Ok((images, measured))
        }
        _ => Ok((images, measured)),
    }
}

/// The images in blocks with that step, whatever the goal; without notes.
pub(crate) fn at_step(
    source: &ImageSet,
    params: &ProgressiveParams,
    step: u16,
    job: &mut Job<'_>,
) -> Result<DctImages, EncodeError> {
    params.check()?;
    source.check_sides()?;
    job.stage("transforming", 0.0)?;
    let check = job.cancel_check();
    let layout = layout_of(source, params);
    let sources = job.install(|| stages(source, layout.levels, check))?;
    let encoder =
        job.install(|| DctSetEncoder::new(layout, &sources, &block_params(source, params), check))?;
    job.stage("coding blocks", 0.3)?;
    let images = DctImages::new(job.install(|| encoder.at_step(step))?);
    job.stage("done", 1.0)?;
    Ok(images)
}

fn layout_of(source: &ImageSet, params: &ProgressiveParams) -> ImageLayout {
    source.layout(if params.mips { source.full_levels() } else { 1 })
}

fn block_params(source: &ImageSet, params: &ProgressiveParams) -> DctSettings {
    DctSettings::default()
        .with_goal(params.goal)
        .with_effort(params.effort)
        .with_metric(params.metric_for(source.info()))
}

/// The stages of all images: mip levels 0, 3, 6 and so on.
fn stages(source: &ImageSet, levels: u32, check: CancelCheck<'_>) -> Result<Vec<DctSource>, EncodeError> {
    let depth = source.info().depth;
    let mut stages = Vec::new();
    for image in source.images() {
        let levels = levels.min(image.size().full_levels());
        let chain = mip_chain_cancellable(image, levels, MipFilter::Box, check)?;
        let samples =
            chain.iter().step_by(DCT_LEVELS as usize).map(|level| DctSource::from_raster(level, depth));
        stages.extend(samples.collect::<Result<Vec<_>, SourceError>>()?);
    }
    Ok(stages)
}

fn bits(source: &ImageSet, images: &DctImages) -> f64 {
    images.memory().goal as f64 / source.texel_count() as f64
}

/// Settings, verdict, and the PSNR of the bases alone.
pub(crate) fn notes(
    source: &ImageSet,
    images: &DctImages,
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
