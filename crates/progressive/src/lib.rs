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
//! window: Mao and Gray, "Stationary and trellis encoding for iid sources and simulation", DCC 2010. *Not done*: codebooks
//! shared among images; alpha in the error map, which the base holds alone.

pub mod decode;
mod encode;
mod encoded;
mod params;
mod rates;
mod wire;

pub use encode::PlaneForm;
pub use encoded::{BASE_PART, BLOCK_SIDE, MAP_PART, ProgressiveTexture};
pub use params::ProgressiveParams;
pub use rates::{Model, Rates};

use texfold_core::container::Sections;
use texfold_core::image::ImageSet;
use texfold_core::{Budget, CodecId, EncodeError, Image2d, Job, LoadError, TextureCodec};

/// Base and error map.
#[derive(Debug, Clone, Copy)]
pub enum Progressive {}

impl TextureCodec for Progressive {
    const ID: CodecId = CodecId { number: 4, name: "progressive" };
    type Domain = Image2d;
    type Source<'s> = &'s ImageSet;
    type Params = ProgressiveParams;
    type Encoded = ProgressiveTexture;

    fn encode(
        source: &ImageSet,
        params: &ProgressiveParams,
        job: &mut Job<'_>,
    ) -> Result<ProgressiveTexture, EncodeError> {
        encode::encode(source, params, job)
    }

    fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<ProgressiveTexture, LoadError> {
        wire::load(file, budget)
    }
}
