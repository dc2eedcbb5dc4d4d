//! Importance-driven vector quantisation on image samples.
//!
//! An image is cut into 4x4 blocks; each block is two bytes that point at a 4x4 window of a codebook texture. The
//! codebook holds rectangular *samples* cut from the image, addressable at every texel, and codewords from
//! vector quantisation for blocks that no sample holds. What the samples are is decided by how often they can be
//! reused and by how much the eye cares: saliency, distortion of the parameterisation, or a painted map.
//!
//! Source: Tang, Zhang, Wang, Bao, "Importance-driven texture encoding based on samples", 2005. Beyond the
//! paper: importance weighs the codewords too, the codebook may itself be BC1 or BC7, its size follows a goal,
//! mip levels share it, and sets of unlike sizes share it.

mod classes;
pub mod decode;
#[cfg(feature = "encode")]
mod encode;
mod encoded;
mod grid;
#[cfg(feature = "encode")]
mod guidance;
#[cfg(feature = "encode")]
mod params;
mod parts;
mod wire;

#[cfg(feature = "encode")]
pub use encode::part_images;
pub use encoded::VqTexture;
pub use grid::CodebookPart;
#[cfg(feature = "encode")]
pub use guidance::{Map, distortion_map, painted_map, saliency_map};
#[cfg(feature = "encode")]
pub use params::{GuidanceWeights, VqParams, VqSource};

use texfold_core::container::Sections;
use texfold_core::{Budget, CodecId, Image2d, LoadError, TextureCodec};

/// Importance-driven vector quantisation.
#[derive(Debug, Clone, Copy)]
pub enum Vq {}

impl TextureCodec for Vq {
    const ID: CodecId = CodecId { number: 2, name: "vq" };
    type Domain = Image2d;
    type Encoded = VqTexture;

    fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<VqTexture, LoadError> {
        VqTexture::load(file, budget)
    }
}
