//! Rasters, sets of them, mip chains and colour.

#[cfg(feature = "encode")]
mod cancel;
mod colour;
mod layout;
mod maps;
mod mip;
mod parts;
mod pixel;
mod raster;
mod set;

#[cfg(feature = "encode")]
pub use cancel::mip_chain_cancellable;
pub use colour::{ColorSpace, linear_to_srgb, srgb_to_linear};
pub use layout::{ImageLayout, ImageSize};
pub use maps::{MapInfo, MapKind};
pub use mip::{MipFilter, mip_chain};
pub use parts::PartImages;
pub use pixel::{Alpha, Depth, PixelInfo};
#[cfg(feature = "encode")]
pub(crate) use raster::write_texels;
pub use raster::{Raster, to_rgba8, to_u8};
pub use set::ImageSet;
