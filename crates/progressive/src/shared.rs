//! How textures are made: alone, or with a public codebook and with what surrounds a tile.

use std::sync::Arc;

use texfold_core::image::{ImageSet, Raster};
use texfold_core::{EncodeError, Encoder, Goal, Job, SharedSearch};

use crate::codebook::MAX_CODEBOOK_SIDE;
use crate::{Codebook, Progressive, ProgressiveParams, ProgressiveSearch, ProgressiveTexture, encode};

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
        encode::encode(source, params, &Shared::default(), job)
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
    /// As [`Encoder::encode`], with a public codebook. [`ProgressiveTexture::details`] of the result names the codebook
    /// that it uses: the same, or one that grew from it. A goal of bits counts the texture's own.
    ///
    /// # Errors
    /// [`EncodeError`] as there.
    pub fn encode_shared(
        source: &ImageSet,
        params: &ProgressiveParams,
        shared: &Shared,
        job: &mut Job<'_>,
    ) -> Result<ProgressiveTexture, EncodeError> {
        let most_rows = shared.most_rows.min(MAX_CODEBOOK_SIDE / 2);
        encode::encode(source, params, &Shared { most_rows, ..shared.clone() }, job)
    }
}
