//! The codec family: how an encoded texture is loaded.

use crate::container::{CodecId, Sections};
use crate::{Budget, Domain, Encoded, LoadError};

/// A way to store textures: which number it has in files, what its textures are addressed by, how one is loaded.
///
/// This is all that reading and drawing need. A codec whose textures can be made, too, is an `Encoder`; those are
/// compiled with the cargo feature `encode`.
pub trait TextureCodec {
    /// Number and name of the codec in files.
    const ID: CodecId;
    /// What the encoded form is addressed by.
    type Domain: Domain;
    /// The shipped form.
    type Encoded: Encoded<Domain = Self::Domain>;

    /// Reads what [`Encoded::store`] wrote. All checks of foreign bytes happen here: what loads, decodes.
    ///
    /// # Errors
    /// [`LoadError`] names the section and what is wrong with it.
    fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<Self::Encoded, LoadError>;
}
