//! Texture codecs whose memory grows with what is unique in a scene.
//!
//! This is the crate for embedding: [`open`] a `.txf` file of any codec, `encode_images` with a codec by name or the
//! one that answers a goal best, and everything of the shared vocabulary. [`CODECS`] lists the codecs; the module
//! `guide` has how-tos.
//!
//! # Cargo.toml
//!
//! ```toml
//! [dependencies]
//! # Encoding, reading and sampling.
//! texfold = "0.1"
//! # Only reading and sampling: no threads, no C compiler.
//! # texfold = { version = "0.1", default-features = false }
//! # Drawing with wgpu; other renderers take the WGSL of texfold-shaders and the planes of `Encoded::gpu`.
//! # texfold-gpu = "0.1"
//! ```
//!
//! | feature | brings |
//! |---|---|
//! | `encode` (default) | encoders, goals and metrics |
//! | `astc` | ASTC content; needs a C++ compiler |
//!
//! # Addresses, colour and alpha
//!
//! - A texel has an image, a mip level, a column and a row; an address outside is clamped to the nearest texel. How
//!   texture coordinates outside 0 to 1 are read (repeat, mirror, clamp) is the renderer's choice at drawing, not the file's.
//! - Values are as they were stored: an image in sRGB ([`ColorSpace::Srgb`]) gives sRGB values, to be converted by
//!   [`image::srgb_to_linear`] or an sRGB view. Filtering is done on stored values, as the shaders do.
//! - Normals ([`ColorSpace::Normal`]) are unit vectors in 0 to 1; alpha is straight, never multiplied into colours.
//! - A [`Texel`] is a `glam::Vec4` of red, green, blue and alpha; gray is in all three colours, alpha that is not there
//!   is 1.

mod any;
mod arriving;
mod codecs;
#[cfg(feature = "encode")]
mod encode;
#[cfg(feature = "encode")]
pub mod guide;
mod open;

pub use any::{AnyImage, AnyTexture, BytesError, file_of};
pub use arriving::{Arrived, Arriving};
pub use codecs::{CODECS, Input, Registration};
#[cfg(feature = "encode")]
pub use encode::*;
pub use open::{OpenError, open, open_from, open_image, open_light};
pub use texfold_bc::{Bc, BcTexture, Content, Family};
pub use texfold_core::image::{Alpha, ColorSpace, Depth, ImageSet, PixelInfo, Raster};
pub use texfold_core::*;
pub use texfold_dct::{Dct, DctImages};
pub use texfold_epitome::{Epitome, EpitomeTexture, MAX_LAYERS};
pub use texfold_lightfield::{
    Camera, Directions, Factors, LightTexture, Lightfield, MAX_TERMS, Mesh, Renderer,
};
pub use texfold_progressive::{Progressive, ProgressiveTexture};
pub use texfold_vq::{Vq, VqTexture};
pub use texfold_zipmap::{ZipTexture, Zipmap};
