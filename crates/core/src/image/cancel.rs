//! What is done to whole images for an encoder, which may be asked to stop meanwhile.

use super::mip::chain_while;
use super::{MipFilter, Raster};
use crate::{CancelCheck, EncodeError};

/// As [`super::mip_chain`], with a look every few thousand texels at whether to stop.
///
/// # Errors
/// [`EncodeError::Cancelled`] where the caller asked to stop.
pub fn mip_chain_cancellable(
    image: &Raster,
    levels: u32,
    filter: MipFilter,
    cancel: CancelCheck<'_>,
) -> Result<Vec<Raster>, EncodeError> {
    chain_while(image, levels, filter, &|| !cancel.is_cancelled()).ok_or(EncodeError::Cancelled)
}
