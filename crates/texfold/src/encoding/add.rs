//! Further images for a texture that is there.

use texfold_core::image::ImageSet;
use texfold_core::{EncodeError, Job};

use super::{ENCODINGS, Encoding, Guidance};
use crate::AnyImage;

/// Adds images to an encoded set or sequence; those already there keep every texel.
///
/// # Errors
/// [`EncodeError`] where the codec cannot grow or the images do not fit; the texture is then as it was.
pub fn add_images(
    texture: &mut AnyImage,
    images: &ImageSet,
    guidance: Guidance<'_>,
    job: &mut Job<'_>,
) -> Result<(), EncodeError> {
    let codec = texture.codec();
    let add = ENCODINGS.iter().find(|encoding| encoding.id == codec).and_then(Encoding::add_fn);
    // Of the codecs that grow the first serves any images.
    let instead =
        ENCODINGS.iter().find(|encoding| encoding.grows()).map_or("another", |encoding| encoding.id.name);
    add.ok_or(EncodeError::CannotGrow { codec, instead })?(texture, images, guidance, job)
}
