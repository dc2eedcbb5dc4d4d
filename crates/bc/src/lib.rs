//! BC1, BC3, BC4, BC5 and BC7: content planes for other codecs, and the plain baseline codec `bc`.
//!
//! The baseline is what every other method has to beat: the image itself in a format that GPUs draw directly,
//! at full, half or quarter size. Input that is already BC1 is taken over block for block.
//!
//! BC1 comes from texpresso (cluster fit), the other formats from the `dds` crate. *Not done*: BC6H (no HDR
//! sources yet), BC2 (BC3 is never worse), ASTC (few desktop GPUs draw it, its encoder is C++).

mod blocks;
mod content;
pub mod decode;
#[cfg(feature = "encode")]
mod encode;
mod encoded;
mod parts;
mod wire;

pub use blocks::decode_block;
pub use content::{Content, ContentPlanes, Family, Swizzle};
#[cfg(feature = "encode")]
pub use encode::{Bc1Blocks, BcParams, encode_plane};
pub use encoded::BcTexture;

use texfold_core::container::Sections;
use texfold_core::{Budget, CodecId, Image2d, LoadError, TextureCodec};

/// The plain block-compression codec.
#[derive(Debug, Clone, Copy)]
pub enum Bc {}

impl TextureCodec for Bc {
    const ID: CodecId = CodecId { number: 1, name: "bc" };
    type Domain = Image2d;
    type Encoded = BcTexture;

    fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<BcTexture, LoadError> {
        BcTexture::load(file, budget)
    }
}
