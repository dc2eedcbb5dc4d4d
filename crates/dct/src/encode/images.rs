//! Sets of images: with the step that answers a goal, or with one that the caller names.

use std::cell::RefCell;

use super::goal::{DctSettings, STEPS, first_step};
use super::set::{DctSetEncoder, MapStage};
use super::source::DctSource;
use crate::{Dct, DctImages, DctParams};
use texfold_core::RESIDUAL_PART;
use texfold_core::image::{Depth, ImageSet, MapInfo, MipFilter, PixelInfo, Raster, mip_chain_cancellable};
use texfold_core::metric::{measure_for, quality_cancellable};
use texfold_core::target::{FoundStep, Measured, search_step, search_step_estimated};
use texfold_core::{
    CancelCheck, DCT_LEVELS, Effort, EncodeError, Encoded, Encoder, Goal, ImageLayout, Job, Metric, Notes,
    Params, SourceError,
};

impl Encoder for Dct {
    type Source<'s> = &'s ImageSet;
    type Params = DctParams;

    fn encode(source: &ImageSet, params: &DctParams, job: &mut Job<'_>) -> Result<DctImages, EncodeError> {
        params.check()?;
        source.check_sides()?;
        let (images, measured) = best(source, params, job)?;
        let notes = notes(source, &images, params, params.goal.is_met(&measured), job)?;
        job.stage("done", 1.0)?;
        Ok(images.with_notes(notes))
    }
}

impl Dct {
    /// As [`Encoder::encode`], with a step that the caller names instead of a goal: tiles of an image that share one have errors
    /// alike. The result has no notes; [`DctImages::described`] gives it some.
    ///
    /// # Errors
    /// [`EncodeError`] as there.
    pub fn encode_at_step(
        source: &ImageSet,
        params: &DctParams,
        step: u16,
        job: &mut Job<'_>,
    ) -> Result<DctImages, EncodeError> {
        params.check()?;
        source.check_sides()?;
        job.stage("transforming", 0.0)?;
        let check = job.cancel_check();
        let layout = layout_of(source, params);
        let encoder = job.install(|| set_encoder(source, layout, params, check))?;
        job.stage("coding blocks", 0.3)?;
        let images = DctImages::new(job.install(|| encoder.at_step(step))?);
        job.stage("done", 1.0)?;
        Ok(images)
    }

    /// Searches the step for [`Dct::encode_at_step`] with which several tiles together just meet a goal. `at_step` makes
    /// something of them with a step, and measures them together; of what meets the goal, what it made with the fewest bits, or
    /// with the most for a goal of bits. `None` where nothing is tried.
    ///
    /// # Errors
    /// Whatever `at_step` returns, at once.
    pub fn search_step<T, E>(
        goal: Goal,
        effort: Effort,
        depth: Depth,
        at_step: impl FnMut(u16) -> Result<(T, Measured), E>,
    ) -> Result<Option<FoundStep<T>>, E> {
        search_step(goal, STEPS.at(effort), first_of(depth), at_step)
    }

    /// As [`Dct::search_step`], where `estimate` measures bits and PSNR at a step at a fraction of the cost, of a part of the tiles for instance: mostly
    /// `at_step` makes two. Goals of single blocks' errors are searched without estimates.
    ///
    /// # Errors
    /// Whatever `estimate` or `at_step` returns, at once.
    pub fn search_step_estimated<T, E>(
        goal: Goal,
        effort: Effort,
        depth: Depth,
        estimate: impl FnMut(u16) -> Result<Measured, E>,
        at_step: impl FnMut(u16) -> Result<(T, Measured), E>,
    ) -> Result<Option<FoundStep<T>>, E> {
        search_step_estimated(goal, STEPS.at(effort), first_of(depth), estimate, at_step)
    }
}

/// Where a search begins.
fn first_of(depth: Depth) -> u16 {
    first_step(if depth == Depth::Eight { 8 } else { 16 })
}

impl DctImages {
    /// With notes of how they were made, and of what they show without their second layer.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] where the caller asked to stop.
    pub fn described(
        self,
        source: &ImageSet,
        params: &DctParams,
        met: bool,
        job: &Job<'_>,
    ) -> Result<DctImages, EncodeError> {
        let notes = notes(source, &self, params, met, job)?;
        Ok(self.with_notes(notes))
    }
}

/// The images with the step that answers the goal best.
fn best(
    source: &ImageSet,
    params: &DctParams,
    job: &mut Job<'_>,
) -> Result<(DctImages, Measured), EncodeError> {
    let goal = params.goal;
    job.stage("transforming", 0.0)?;
    let check = job.cancel_check();
    let layout = layout_of(source, params);
    let encoder = job.install(|| set_encoder(source, layout, params, check))?;
    let (texels, mut tried) = (source.texel_count(), 0u32);
    // Estimating and making take turns.
    let job = RefCell::new(job);
    let found = search_step_estimated(
        goal,
        STEPS.at(params.effort),
        encoder.first_step(goal),
        |step| Ok::<_, EncodeError>(job.borrow().install(|| encoder.estimate(step))?.measured(texels)),
        |step| {
            let mut job = job.borrow_mut();
            tried += 1;
            job.stage("coding blocks", tried as f32 / (tried as f32 + 1.0))?;
            match goal {
                // Bits need no decoding.
                Goal::Bpp(_) => {
                    let images = DctImages::new(job.install(|| encoder.measurable_at_step(step))?);
                    let bpp = bits(source, &images);
                    Ok((images, Measured { bpp, ..Measured::default() }))
                }
                _ => {
                    let images = DctImages::new(job.install(|| encoder.at_step(step))?);
                    let measured = job.install(|| measure_for(goal, source, &images, check))?;
                    Ok((images, measured))
                }
            }
        },
    )?;
    let FoundStep { value, measured, .. } = found.ok_or(SourceError::Empty)?;
    let images = match goal {
        Goal::Bpp(_) => DctImages::new(job.borrow().install(|| encoder.deblocked(value.into_content()))?),
        _ => value,
    };
    Ok((images, measured))
}

fn layout_of(source: &ImageSet, params: &DctParams) -> ImageLayout {
    source.layout(if params.mips { source.full_levels() } else { 1 })
}

fn coder_settings(pixel: PixelInfo, params: &DctParams) -> DctSettings {
    DctSettings::default()
        .with_goal(params.goal)
        .with_effort(params.effort)
        .with_metric(params.metric_for(pixel))
}

fn set_encoder<'a>(
    source: &ImageSet,
    layout: ImageLayout,
    params: &DctParams,
    check: CancelCheck<'a>,
) -> Result<DctSetEncoder<'a>, EncodeError> {
    let of_image = |(index, image): (u32, &Raster)| {
        let pixel = layout.pixel_of(index);
        let settings = coder_settings(pixel, params);
        let weight = layout.maps.get(index as usize).map_or(1.0, |map| params.weight_of(map.kind));
        match stages(image, pixel.depth, layout.levels, check) {
            Ok(stages) => {
                stages.into_iter().map(|source| Ok(MapStage { source, settings, weight })).collect()
            }
            Err(error) => vec![Err(error)],
        }
    };
    let stages = (0..).zip(source.images()).flat_map(of_image);
    DctSetEncoder::of_maps(layout.clone(), stages, check)
}

/// The stages of an image: mip levels 0, 3, 6 and so on.
fn stages(
    image: &Raster,
    depth: Depth,
    levels: u32,
    check: CancelCheck<'_>,
) -> Result<Vec<DctSource>, EncodeError> {
    let levels = levels.min(image.size().full_levels());
    if levels <= DCT_LEVELS {
        return Ok(vec![source_of(image, depth)?]);
    }
    let chain = mip_chain_cancellable(image, levels, MipFilter::Box, check)?;
    let stages = chain.iter().step_by(DCT_LEVELS as usize);
    Ok(stages.map(|level| source_of(level, depth)).collect::<Result<_, SourceError>>()?)
}

/// A stage, with colours that cost next to nothing where alpha hides them.
fn source_of(image: &Raster, depth: Depth) -> Result<DctSource, SourceError> {
    let source = DctSource::from_raster(image, depth)?;
    let alpha = source.channels() - 1;
    Ok(if image.info().hides_colors() { source.with_free_colours(alpha) } else { source })
}

fn bits(source: &ImageSet, images: &DctImages) -> f64 {
    images.memory().goal as f64 / source.texel_count() as f64
}

/// Settings, verdict, and the PSNR of the bases alone.
fn notes(
    source: &ImageSet,
    images: &DctImages,
    params: &DctParams,
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
    let details = match source.maps() {
        [] => weighted.to_owned(),
        maps => {
            let bits =
                |image| 8.0 * images.content().held_bytes_of(image) as f64 / source.texel_count() as f64;
            let of_map = |(image, map): (u32, &MapInfo)| format!("{} {:.3}", map.name, bits(image));
            let of_maps: Vec<String> = (0..).zip(maps).map(of_map).collect();
            format!("{} maps: {}", maps.len(), of_maps.join(", "))
        }
    };
    let verdict = format!(
        "{:.3} bits a texel, {base:.3} of them in headers and bases of 1/8 of the width and height; {details}.{missed}",
        bits(source, images),
    );
    let mips = if params.mips { " --mips" } else { "" };
    let goal = params.goal.option();
    let settings = if source.maps().is_empty() {
        format!("--codec dct {goal}{mips} --metric {}", metric.name())
    } else {
        let metric = params.metric.map_or(String::new(), |metric| format!(" --metric {}", metric.name()));
        let weights: Vec<String> =
            params.weights.iter().map(|(kind, weight)| format!("{}={weight}", kind.name())).collect();
        let weights =
            if weights.is_empty() { String::new() } else { format!(" --weights {}", weights.join(",")) };
        format!("--as material {goal}{mips}{metric}{weights}")
    };
    Ok(Notes { settings, verdict, psnr_without, ..Notes::default() })
}
