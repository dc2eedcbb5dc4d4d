//! Rasters, sets of them, mip chains and colour.

mod colour;
mod mip;
mod raster;

pub use colour::{ColorSpace, linear_to_srgb, srgb_to_linear};
pub use mip::{MipFilter, mip_chain};
pub use raster::{Alpha, Depth, ImageSet, PixelInfo, Raster, to_u8};
