//! Epitome factoring: images as a transform map into a small epitome that holds their content once.
//!
//! An image is covered by square leaves. Each says where in the epitome its content lies, how it is oriented,
//! mirrored and scaled, and which gain and offset it gets. What repeats, under deformation and lighting, is stored
//! once; what is smooth, or smooth in one direction, is stored at a fraction of its size.
//!
//! Source: Wang, Wexler, Ofek, Hoppe, "Factoring repeated content within and among images", ACM Transactions on
//! Graphics 27 (3), 2008. Beyond the paper: leaves of several sizes chosen by rate and distortion on the stored
//! content, palettes of 2x2 matrices and gain-offset pairs, content at reduced width or height and fitted to all who
//! read it, BC1 and BC7 content side by side.

pub mod decode;
mod draw;
#[cfg(feature = "encode")]
mod encode;
mod encoded;
mod fast;
mod format;
mod layers;
mod map;
#[cfg(feature = "encode")]
mod params;
mod part_images;
mod parts;
mod uniforms;
mod wire;

#[cfg(feature = "encode")]
pub use encode::{EpitomeSearch, worst_relative_error};
pub use encoded::EpitomeTexture;
pub use format::{Entry, GainOffset, IDENTITY, MapFormat, Matrix, NEUTRAL};
pub use layers::MAX_LAYERS;
#[cfg(feature = "encode")]
pub use params::{EpitomeParams, EpitomeSource, ToleranceKind, Transforms};
pub use part_images::part_images;

use texfold_core::container::Sections;
use texfold_core::{Budget, CodecId, Image2d, LoadError, Notes, TextureCodec};

/// Epitome factoring.
#[derive(Debug, Clone, Copy)]
pub enum Epitome {}

impl TextureCodec for Epitome {
    const ID: CodecId = CodecId { number: 3, name: "epitome" };
    type Domain = Image2d;
    type Encoded = EpitomeTexture;

    fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<EpitomeTexture, LoadError> {
        let notes = Notes::read(file, budget)?;
        Ok(EpitomeTexture::new(wire::load(file, budget)?, notes))
    }
}
