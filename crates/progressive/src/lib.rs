//! Images as a small base picture and an error map, drawn at random access; the base is a prefix of the file.
//!
//! The base is a picture of half, a quarter or an eighth of the width and height in plain blocks, drawn with bilinear
//! filtering. What it lacks is coded in blocks of 8x8 texels, none to some 7 bits a texel each. A block's texels are turned
//! into luma and chroma and transformed by a two-level Haar transform in cells of 4x4; kinds of coefficients get bits by the
//! block's class and are coded by a trellis: of the bit string around the block, a window of ten bits that ends with a
//! coefficient's own bits names its value. So any coefficient is read with two loads, and yet two bits a coefficient come
//! within 1.1 dB of what any code of two bits can do, where four levels stay 2.7 dB below.
//!
//! Source of the error map: "Progressive compression of large-scale remote sensing images with GSR descriptors", 2012,
//! section 4.3, which has two end colours and 2-bit selectors a block over codebooks; of trellis codes that are read by a
//! window: Mao and Gray, "Stationary and trellis encoding for iid sources and simulation", DCC 2010.
//! *Not done*: alpha in the error map: the base alone holds it, and is no smaller than alpha allows; colours of texels that are wholly
//! transparent are kept as they are; colour in codebooks.
//!
//! Between base and error map stand codebooks ([`Codebook`]): blocks of 8x8 or 16x16 texels show detail from a public
//! codebook, that many textures share, or from the texture's own, at a place, turn and gain of their own. Up to about
//! half a bit a texel that is worth more than its bits; above, error maps alone are better, and codebooks are not tried.

mod codebook;
pub mod decode;
mod encode;
mod encoded;
mod params;
mod pictures;
mod rates;
mod wire;

pub use codebook::{CELL_SIDE, Codebook, Details, Entry, MapForm};
pub use encode::{PlaneForm, ProgressiveSearch};
pub use encoded::{BASE_PART, BLOCK_SIDE, ERROR_PART, ProgressiveTexture};
pub use params::ProgressiveParams;
pub use pictures::{PartPictures, pictures};
pub use rates::{Model, Rates};

use std::sync::Arc;

use texfold_core::container::{SectionWriter, Sections};
use texfold_core::image::{ImageSet, Raster};
use texfold_core::{
    Budget, CodecId, EncodeError, Encoder, Goal, Image2d, Job, LoadError, SharedSearch, TextureCodec,
};

/// Base and error map.
#[derive(Debug, Clone, Copy)]
pub enum Progressive {}

impl TextureCodec for Progressive {
    const ID: CodecId = CodecId { number: 4, name: "progressive" };
    type Domain = Image2d;
    type Encoded = ProgressiveTexture;

    fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<ProgressiveTexture, LoadError> {
        wire::load(file, None, budget)
    }
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

/// Texels around a tile that its base may go on over.
pub const AROUND: u32 = encoded::MARGIN << (params::MAX_REDUCE_LOG2 + params::MAX_SHRINK_LOG2);

/// A public codebook that textures show and add to, and what surrounds a tile.
#[derive(Debug, Clone, Default)]
pub struct Shared {
    /// What it holds; `None` while that is nothing.
    pub public: Option<Arc<Codebook>>,
    /// Rows of texels that it may grow to, at most 2048; 0 where nothing is to be shared.
    pub most_rows: u32,
    /// The single image that is encoded and [`AROUND`] texels more on each side, of a larger image of which it is a tile: its base then goes on beyond
    /// its borders, as the base of the tile beside it does, and no step is seen between them.
    pub around: Option<Raster>,
}

impl Progressive {
    /// As [`Encoder::encode`], with a public codebook. [`ProgressiveTexture::details`] of the result names the codebook
    /// that it shows: the same, or one that grew from it. A goal of bits counts the texture's own.
    ///
    /// # Errors
    /// [`EncodeError`] as there.
    pub fn encode_shared(
        source: &ImageSet,
        params: &ProgressiveParams,
        shared: &Shared,
        job: &mut Job<'_>,
    ) -> Result<ProgressiveTexture, EncodeError> {
        let most_rows = shared.most_rows.min(codebook::MAX_CODEBOOK_SIDE / 2);
        encode::encode(source, params, &Shared { most_rows, ..shared.clone() }, job)
    }

    /// As [`TextureCodec::load`], for a texture that shows a public codebook: the one that it was made with, or one that grew
    /// from it.
    ///
    /// # Errors
    /// [`LoadError`] as there, and where the codebook is another.
    pub fn load_shared(
        file: &Sections<'_>,
        public: &Codebook,
        budget: &mut Budget,
    ) -> Result<ProgressiveTexture, LoadError> {
        wire::load(file, Some(public), budget)
    }

    /// Writes a public codebook as a file of its own.
    pub fn store_codebook(book: &Codebook, out: &mut SectionWriter) {
        wire::store_public(book, out);
    }

    /// Reads what [`Progressive::store_codebook`] wrote.
    ///
    /// # Errors
    /// [`LoadError`] names what is wrong with it.
    pub fn load_codebook(file: &Sections<'_>, budget: &mut Budget) -> Result<Codebook, LoadError> {
        wire::load_public(file, budget)
    }
}
