//! Images in DCT superblocks: a transform coder that is read at random, as a codec ([`Dct`]) and as content of other codecs
//! ([`DctContent`]).
//!
//! An image is rotated to axes learned from its gradients, cut into 8x8 blocks and transformed by a DCT. The blocks' means are
//! an image of an eighth of the size, which is coded in the same way, down to a single block; a block's lowest coefficients
//! are predicted from the means around it (JPEG, T.81, K.8). Coefficients are quantised by one step a texture and coded by
//! rANS with static tables, which are chosen by what is decoded of the block and of its superblock.
//!
//! *Random access*: a superblock of 16x16, 32x32 or 64x64 texels has a stream of its own, found by an index. It needs the
//! means of its blocks and of those around them: 1 to 4 superblocks of the base, a 64th of the image, which need as many of
//! the next base. So an image of 768x512 texels has bases of 6, 1 and 1 superblocks, and a lone texel needs at most 7
//! superblocks.
//!
//! Entropy decoding, dequantisation and transform are in 32-bit integers and wrap, so that a shader gives the same texels.
//! Cost of decoding: one table lookup for each coefficient up to a block's last, some 200 additions and 80 multiplications
//! for a block's axis.
//!
//! Borders between the blocks of a superblock are filtered, as strongly as the encoder has found best.
//!
//! *Not done*: a choice of transforms, filters across the borders of superblocks.

mod average;
mod bits;
mod channels;
mod content;
mod context;
mod deblock;
mod decode;
#[cfg(feature = "encode")]
pub mod encode;
mod form;
mod gpu;
mod images;
mod index;
mod intra;
#[cfg(feature = "encode")]
mod params;
mod part_images;
mod plane;
mod rans;
#[cfg(feature = "encode")]
mod rans_encode;
mod scan;
#[cfg(test)]
mod shader_tests;
mod tables;
#[cfg(test)]
mod tests;
mod transform;
mod vectors;
mod wire;

pub use channels::DctSample;
pub use content::{DctContent, stage_sizes};
pub use deblock::MAX_DEBLOCKING;
pub use decode::DctTexture;
pub use form::{DctForm, Group, MAX_CHANNELS, MAX_GROUP, MAX_STEP, Quantiser};
pub use gpu::{FormatConstants, Stage};
pub use images::{Dct, DctImages};
#[cfg(feature = "encode")]
pub use params::DctParams;
pub use part_images::part_images;

/// Bytes of all superblocks.
type Bytes = Vec<u8>;
