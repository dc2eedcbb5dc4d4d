//! stub
use texfold_core::{EncodeError, Job};
use crate::{VqParams, VqSource, VqTexture};
pub(crate) mod grow { use super::*; pub(crate) fn add(_t:&mut VqTexture,_s:VqSource<'_>,_j:&mut Job<'_>)->Result<(),EncodeError>{Err(EncodeError::Cancelled)} }
pub mod report {
    //! Pictures.
    use texfold_core::image::Raster;
    /// Pictures of the parts of a vq texture, for a person to look at.
    #[derive(Debug, Clone)]
    pub struct PartPictures { /// Codebook with samples framed.
        pub codebook: Raster, /// For each image, block positions in the codebook as colours (red = column, green = row, blue = 1 where a sample).
        pub index: Vec<Raster>, /// For each image, blocks shown by samples bright, by codewords dark.
        pub usage: Vec<Raster> }
    /// Draws the parts.
    pub fn pictures(_texture: &crate::VqTexture) -> Option<PartPictures> { None }
}
pub(crate) fn encode(_s:VqSource<'_>,_p:&VqParams,_j:&mut Job<'_>)->Result<VqTexture,EncodeError>{Err(EncodeError::Cancelled)}
