//! How textures are made: alone, with a public codebook and with what surrounds a tile, or as tiles that share a step.

use std::sync::Arc;

use texfold_core::image::{Depth, ImageSet, Raster};
use texfold_core::target::{FoundStep, Measured, excess, search_step};
use texfold_core::{EncodeError, Encoder, Goal, Job, SharedSearch};
use texfold_dct::encode::{STEPS, first_step};

use crate::codebook::MAX_CODEBOOK_SIDE;
use crate::{
    Codebook, DctImages, Progressive, ProgressiveParams, ProgressiveSearch, ProgressiveTexture, TexelTexture,
    encode,
};

/// A public codebook that textures use and add to, and what surrounds a tile.
#[derive(Debug, Clone, Default)]
pub struct Shared {
    /// What it holds; `None` while that is nothing.
    pub public: Option<Arc<Codebook>>,
    /// Rows of texels that it may grow to, at most 2048; 0 where nothing is to be shared.
    pub most_rows: u32,
    /// The single image that is encoded and [`crate::APRON`] texels more on each side, of a larger image of which it is a
    /// tile. Its base is padded then, as the base of the tile beside it is, and no step is seen between them.
    pub apron: Option<Raster>,
}

impl Encoder for Progressive {
    type Source<'s> = &'s ImageSet;
    type Params = ProgressiveParams;

    fn encode(
        source: &ImageSet,
        params: &ProgressiveParams,
        job: &mut Job<'_>,
    ) -> Result<ProgressiveTexture, EncodeError> {
        encode::encode(source, params, job)
    }
}

impl SharedSearch for Progressive {
    type Search = ProgressiveSearch;

    fn search(
        source: &ImageSet,
        params: &ProgressiveParams,
        job: &mut Job<'_>,
    ) -> Result<ProgressiveSearch, EncodeError> {
        ProgressiveSearch::new(source, params, &Shared::default(), job)
    }

    fn encode_from(
        search: &ProgressiveSearch,
        goal: Goal,
        job: &mut Job<'_>,
    ) -> Result<ProgressiveTexture, EncodeError> {
        search.encode(goal, job)
    }
}

impl Progressive {
    /// As [`Encoder::encode`] by texel, with a public codebook. [`TexelTexture::details`] of the result names the codebook
    /// that it uses: the same, or one that grew from it. A goal of bits counts the texture's own.
    ///
    /// # Errors
    /// [`EncodeError`] as there.
    pub fn encode_shared(
        source: &ImageSet,
        params: &ProgressiveParams,
        shared: &Shared,
        job: &mut Job<'_>,
    ) -> Result<TexelTexture, EncodeError> {
        let most_rows = shared.most_rows.min(MAX_CODEBOOK_SIDE / 2);
        encode::by_texel(source, params, &Shared { most_rows, ..shared.clone() }, job)
    }
    /// As [`Encoder::encode`] by block, with a step that the caller names instead of a goal: tiles of an image that share
    /// one have errors alike. The result has no notes; [`DctImages::described`] gives it some.
    ///
    /// # Errors
    /// [`EncodeError`] as there.
    pub fn encode_at_step(
        source: &ImageSet,
        params: &ProgressiveParams,
        step: u16,
        job: &mut Job<'_>,
    ) -> Result<DctImages, EncodeError> {
        encode::blocks::at_step(source, params, step, job)
    }

    /// Searches the step for [`Progressive::encode_at_step`] with which several tiles together just meet a goal. `at_step`
    /// makes something of them with a step, and measures them together; of what meets the goal, what it made with the
    /// fewest bits, or with the most for a goal of bits. `None` where nothing is tried.
    ///
    /// # Errors
    /// Whatever `at_step` returns, at once.
    pub fn search_step<T, E>(
        goal: Goal,
        depth: Depth,
        mut at_step: impl FnMut(u16) -> Result<(T, Measured), E>,
    ) -> Result<Option<FoundStep<T>>, E> {
        let first = first_step(if depth == Depth::Eight { 8 } else { 16 });
        search_step(goal, STEPS, first, |step| {
            let (made, measured) = at_step(step)?;
            Ok((made, excess(goal, &measured)))
        })
    }
}

impl DctImages {
    /// With notes of how they were made, and of what they show without their second layer.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] where the caller asked to stop.
    pub fn described(
        self,
        source: &ImageSet,
        params: &ProgressiveParams,
        met: bool,
        job: &Job<'_>,
    ) -> Result<DctImages, EncodeError> {
        let notes = encode::blocks::notes(source, &self, params, met, job)?;
        Ok(self.with_notes(notes))
    }
}
