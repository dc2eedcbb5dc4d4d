//! The encoder on one page: content at all scales, leaves from their own place, matches elsewhere, palettes, and
//! leaves chosen by rate and distortion; then a second search among the content that was kept. Images above 2
//! megapixels are searched part by part at first (paper section 4.5).

mod assemble;
mod candidate;
mod cell_cache;
mod choose;
mod estimate;
mod formats;
mod gain_offset;
mod goal;
mod growth;
mod in_blocks;
mod ladder;
mod lambda;
mod lambda_index;
mod leaf;
mod mask;
mod matrix;
mod models;
mod options;
mod orientation;
mod pack;
mod passes;
mod plan;
mod pyramid;
mod reading;
mod refit;
mod regroup;
mod relative;
mod report;
mod seam;
mod search;
mod searched;
mod state;
mod tolerance;

use texfold_core::metric::measure_for;
use texfold_core::{Access, Effort, EncodeError, Encoder, Goal, Job, Params, SharedSearch};

use searched::Shape;

pub use relative::worst_relative_error;
pub use searched::EpitomeSearch;

use crate::{Epitome, EpitomeParams, EpitomeSource, EpitomeTexture};

impl Encoder for Epitome {
    type Source<'s> = EpitomeSource<'s>;
    type Params = EpitomeParams;

    fn encode(
        source: EpitomeSource<'_>,
        params: &EpitomeParams,
        job: &mut Job<'_>,
    ) -> Result<EpitomeTexture, EncodeError> {
        encode(source, params, false, job)
    }
}

impl Epitome {
    /// As [`Encoder::encode`], for callers that have another codec's texture: an error after the first search where fewer than 1 in 32 cells
    /// of content have several readers, since without these an epitome has no advantage over blocks of variable length.
    ///
    /// # Errors
    /// As there, and [`texfold_core::SourceError::OutOfReach`] where hardly any content recurs.
    pub fn encode_shared(
        source: EpitomeSource<'_>,
        params: &EpitomeParams,
        job: &mut Job<'_>,
    ) -> Result<EpitomeTexture, EncodeError> {
        encode(source, params, true, job)
    }
}

fn encode(
    source: EpitomeSource<'_>,
    params: &EpitomeParams,
    needs_shared: bool,
    job: &mut Job<'_>,
) -> Result<EpitomeTexture, EncodeError> {
    let searched = job.within(0.0, 0.7, |job| search_all(source, params, needs_shared, job))?;
    job.within(0.7, 1.0, |job| encode_from(&searched, params.goal, job))
}

impl SharedSearch for Epitome {
    type Search = EpitomeSearch;

    /// The goal of `params` says how fine the content is that matches are searched in, and whether blocks have one
    /// side (for tolerances) or several; goals of the same kind share a search.
    fn search(
        source: EpitomeSource<'_>,
        params: &EpitomeParams,
        job: &mut Job<'_>,
    ) -> Result<EpitomeSearch, EncodeError> {
        search_all(source, params, false, job)
    }

    fn encode_from(
        search: &EpitomeSearch,
        goal: Goal,
        job: &mut Job<'_>,
    ) -> Result<EpitomeTexture, EncodeError> {
        encode_from(search, goal, job)
    }
}

/// Searches `source` with the goal of `params` in mind; an error where content must be shared and hardly any is.
fn search_all(
    source: EpitomeSource<'_>,
    params: &EpitomeParams,
    needs_shared: bool,
    job: &mut Job<'_>,
) -> Result<EpitomeSearch, EncodeError> {
    params.check()?;
    // Blocks that are taken over stay planes.
    let texel = source.blocks.map(|_| params.clone().with_access(Access::Texel));
    let params = texel.as_ref().unwrap_or(params);
    if params.is_by_block() && params.effort == Effort::High {
        // Where edges are hard, plain blocks that several leaves read may be smaller.
        let planes = params.clone().with_access(Access::Texel);
        return search_both(source, [params, &planes], needs_shared, job);
    }
    search_one(source, params, needs_shared, job)
}

/// Searches for both settings, of which the goal will choose.
fn search_both(
    source: EpitomeSource<'_>,
    [first, second]: [&EpitomeParams; 2],
    needs_shared: bool,
    job: &mut Job<'_>,
) -> Result<EpitomeSearch, EncodeError> {
    let mut searched = job.within(0.0, 0.5, |job| search_one(source, first, needs_shared, job))?;
    let other = job.within(0.5, 1.0, |job| search_one(source, second, false, job))?;
    searched.other = Some(Box::new(other));
    Ok(searched)
}

/// As [`search_all`], with the content of `params` or what is usual.
fn search_one(
    source: EpitomeSource<'_>,
    params: &EpitomeParams,
    needs_shared: bool,
    job: &mut Job<'_>,
) -> Result<EpitomeSearch, EncodeError> {
    source.images.check_images()?;
    let shape = Shape::of(source.images, params)?;
    job.holding(shape.bytes, |job| {
        let mut searched = job.within(0.0, 0.3, |job| EpitomeSearch::new(source, params, shape, job))?;
        searched.needs_shared = needs_shared;
        job.within(0.3, 1.0, |job| searched.search(job))?;
        Ok(searched)
    })
}

/// The shipped form for a goal.
fn encode_from(
    searched: &EpitomeSearch,
    goal: Goal,
    job: &mut Job<'_>,
) -> Result<EpitomeTexture, EncodeError> {
    goal.check()?;
    searched.params.clone().with_goal(goal).check()?;
    let Some(other) = &searched.other else { return encode_one(searched, goal, job) };
    let first = job.within(0.0, 0.5, |job| encode_one(searched, goal, job))?;
    let second = job.within(0.5, 1.0, |job| encode_one(other, goal, job))?;
    let of_first = measure_for(goal, &searched.images, &first, job.cancel_check())?;
    let of_second = measure_for(goal, &searched.images, &second, job.cancel_check())?;
    Ok(if goal.prefers(&of_second, &of_first) { second } else { first })
}

/// As [`encode_from`], with the content of one search.
fn encode_one(
    searched: &EpitomeSearch,
    goal: Goal,
    job: &mut Job<'_>,
) -> Result<EpitomeTexture, EncodeError> {
    job.stage("fitting palettes", 0.0)?;
    job.holding(searched.bytes, |job| match goal {
        Goal::Tolerance(tolerance) => searched.within(tolerance, job),
        Goal::Psnr(_) | Goal::Bpp(_) => searched.reaching(goal, job),
    })
}
