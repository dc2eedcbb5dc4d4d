//! Importance-driven vector quantisation on image samples.
//!
//! An image is cut into 4x4 blocks; each block is two bytes that point at a 4x4 window of a codebook texture. The
//! codebook holds rectangular *samples* cut from the image, addressable at every texel, and codewords from
//! vector quantisation for what no sample shows. What the samples are is decided by how often they can be
//! reused and by how much the eye cares: saliency, distortion of the parameterisation, or a painted map.
//!
//! Source: Tang, Zhang, Wang, Bao, "Importance-driven texture encoding based on samples", 2005. Beyond the
//! paper: importance weighs the codewords too, the codebook may itself be BC1 or BC7, its size follows a goal,
//! mip levels share it, and sets of unlike sizes share it.

pub mod decode;
mod encode;
mod encoded;
mod guidance;
mod params;
mod wire;

pub use encode::report::{PartPictures, pictures};
pub use encoded::{CodebookPart, VqTexture};
pub use guidance::{Map, distortion_map, painted_map, saliency_map};
pub use params::{GuidanceWeights, VqParams, VqSource};

use texfold_core::container::Sections;
use texfold_core::{Budget, CodecId, EncodeError, Encoder, Growable, Image2d, Job, LoadError, TextureCodec};

/// Importance-driven vector quantisation.
#[derive(Debug, Clone, Copy)]
pub enum Vq {}

impl TextureCodec for Vq {
    const ID: CodecId = CodecId { number: 2, name: "vq" };
    type Domain = Image2d;
    type Encoded = VqTexture;

    fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<VqTexture, LoadError> {
        wire::load(file, budget)
    }
}

impl Encoder for Vq {
    type Source<'s> = VqSource<'s>;
    type Params = VqParams;

    fn encode(source: VqSource<'_>, params: &VqParams, job: &mut Job<'_>) -> Result<VqTexture, EncodeError> {
        encode::encode(source, params, None, job)
    }
}

impl Vq {
    /// As [`Encoder::encode`] for a quality goal, but gives up once `most_bpp` bits of GPU memory a texel do not reach it:
    /// for callers that hold a plain form of that size.
    ///
    /// # Errors
    /// As [`Encoder::encode`].
    pub fn encode_within(
        source: VqSource<'_>,
        params: &VqParams,
        most_bpp: f64,
        job: &mut Job<'_>,
    ) -> Result<VqTexture, EncodeError> {
        encode::encode(source, params, Some(most_bpp), job)
    }
}

impl Growable for Vq {
    fn add(encoded: &mut VqTexture, source: VqSource<'_>, job: &mut Job<'_>) -> Result<(), EncodeError> {
        encode::grow::add(encoded, source, job)
    }
}
