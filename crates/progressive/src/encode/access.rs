//! By block or by texel: blocks first, and the other form where they miss the goal.

use texfold_core::image::ImageSet;
use texfold_core::metric::measure_for;
use texfold_core::{EncodeError, Encoded, Goal, Job, Params};

use super::blocks::{by_block, notes};
use crate::{ProgressiveParams, ProgressiveTexture, TexelTexture};

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
    let other = job.install(|| measure_for(params.goal, source, &texture, check))?;
    if !params.goal.prefers(&other, &measured) {
        let notes = notes(source, &images, params, met, job)?;
        return Ok(ProgressiveTexture::Block(images.with_notes(notes)));
    }
    let why = if met { "takes fewer bits" } else { "comes nearer to the goal" };
    let mut notes = texture.notes().clone();
    notes.verdict = format!("By texel, which {why} than by block here. {}", notes.verdict);
    Ok(texture.with_notes(notes).into())
}
