//! Images that arrive over time: a small base first, then what it leaves. The base is a prefix of the file.
//!
//! [`texfold_residual`] content, drawn texel by texel at random access: a
//! base of half, a quarter or an eighth of the width and height in plain blocks, drawn with bilinear filtering, and a residual
//! plane of none to some 7 bits a texel. Between base and residual stand codebooks ([`Codebook`]): blocks of 8x8 or 16x16
//! texels use an atom of a public codebook, which many textures share, or of the texture's own, at a place, rotation and gain
//! that the block's map entry names. Up to about half a bit a texel that is worth more than its bits; above, residual planes
//! alone are better, and codebooks are not tried.
//!
//! Source: "Progressive compression of large-scale remote sensing images with GSR descriptors", 2012, sections 4 and 4.3.
//! Cost: encoding a trellis search a block and class, a k-d tree query and some hundred patches a block where codebooks
//! are tried; decoding 12 loads a texel, 6 more with codebooks.
//!
//! The residual plane has no alpha: the base alone holds it, fitted to what decoders read, with its contrast raised up to eight
//! times where that lessens the error, as it does for outlines.
//!
//! *Not done*: colour in codebooks.

mod codebook;
pub mod decode;
#[cfg(feature = "encode")]
mod encode;
#[cfg(feature = "encode")]
mod params;
mod part_images;
#[cfg(feature = "encode")]
mod shared;
mod texel;
mod wire;

#[doc(hidden)]
pub use codebook::PUBLIC_PART;
pub use codebook::{CELL_SIDE, Codebook, Details, Entry, EntryMap, MapForm};
#[cfg(feature = "encode")]
pub use encode::ProgressiveSearch;
#[cfg(feature = "encode")]
pub use params::ProgressiveParams;
pub use part_images::part_images;
#[cfg(feature = "encode")]
pub use shared::Shared;
pub use texel::ProgressiveTexture;
pub use texfold_residual::APRON;

use texfold_core::container::{SectionWriter, Sections};
use texfold_core::{Budget, CodecId, Image2d, LoadError, TextureCodec};

/// Residual content with details from codebooks.
#[derive(Debug, Clone, Copy)]
pub enum Progressive {}

impl TextureCodec for Progressive {
    const ID: CodecId = CodecId { number: 4, name: "progressive" };
    type Domain = Image2d;
    type Encoded = ProgressiveTexture;

    fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<ProgressiveTexture, LoadError> {
        ProgressiveTexture::load(file, None, budget)
    }
}

impl Progressive {
    /// As [`TextureCodec::load`], for a texture that may use a public codebook: the one that it was made with, or one that
    /// grew from it.
    ///
    /// # Errors
    /// [`LoadError`] as there, and where the codebook is another.
    pub fn load_shared(
        file: &Sections<'_>,
        public: Option<&Codebook>,
        budget: &mut Budget,
    ) -> Result<ProgressiveTexture, LoadError> {
        ProgressiveTexture::load(file, public, budget)
    }

    /// Writes a public codebook as a separate file.
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
