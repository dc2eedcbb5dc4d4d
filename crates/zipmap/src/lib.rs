//! Zoom-into-parts texture maps: photographs of one surface at several scales as one texture that can be zoomed into.
//!
//! The root covers all of the surface; patches cover parts of it in more detail, each by a matrix from the root's texture
//! coordinates to its own and by its alpha. A lookup reads the root and blends over it, in order, the patches that the
//! root's tile names; so any number of patches takes one pass. [`register`] finds root and matrices of an unordered
//! folder of photographs; colours of patches are fitted to those below them, and alpha follows edges of the image.
//!
//! Source: Eisemann and Magnor, "ZIPMAPS: zoom-into-parts texture maps", 2010. Beyond the paper: per-tile lists of
//! patches, exposure and refinement in registration, checks that leave out photographs that do not agree, mip levels
//! left out where what lies below decodes to the same, content in blocks, lookups of several places for pixels that are
//! longer than wide. An image of several patches is stored once, and its colours are fitted to none of the
//! places.
//!
//! There are two forms ([`Access`](texfold_core::Access)). *By block*: the root and one image of all patch images are
//! [`texfold_dct`] content, which is decoded into plain textures with their mip levels before it is drawn. *By texel*: planes of
//! [`texfold_bc`], drawn as they are; 13 times the bits for the boat's six photographs at 34 dB. *Not done*: patches that are decoded one by one as
//! they come into view.

mod atlas;
pub mod decode;
#[cfg(feature = "encode")]
mod encode;
mod encoded;
#[cfg(feature = "encode")]
mod error;
mod geometry;
#[cfg(feature = "encode")]
mod linear;
#[cfg(feature = "encode")]
mod params;
mod parts;
#[cfg(feature = "encode")]
mod register;
#[cfg(feature = "encode")]
mod stack;
mod table;
mod wire;

#[cfg(feature = "encode")]
pub use encode::{Fidelity, fidelity, masks};
pub use encoded::{PatchInfo, ZipTexture};
#[cfg(feature = "encode")]
pub use error::ZipError;
#[cfg(feature = "encode")]
pub use params::ZipParams;
#[cfg(feature = "encode")]
pub use register::{Agreement, Fault, LeftOut, Link, Placed, Registration, register};
#[cfg(feature = "encode")]
pub use stack::{PatchSource, PatchStack};

use texfold_core::container::Sections;
use texfold_core::{Budget, CodecId, Image2d, LoadError, TextureCodec};

/// A root and patches.
#[derive(Debug, Clone, Copy)]
pub enum Zipmap {}

impl TextureCodec for Zipmap {
    const ID: CodecId = CodecId { number: 6, name: "zipmap" };
    type Domain = Image2d;
    type Encoded = ZipTexture;

    fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<ZipTexture, LoadError> {
        ZipTexture::load(file, budget)
    }
}
