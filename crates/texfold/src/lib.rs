//! Texture codecs whose memory grows with what is unique in a scene.
//!
//! This is the crate for embedding: [`open`] a `.txf` file of any codec, [`Encode`] images with a codec by name or the
//! one that answers a goal best. Types of the codecs are in modules of their names ([`dct`], [`vq`], ...), the rest of the shared
//! vocabulary in [`core`], tables and generic encoders in [`encoding`]; [`guide`] has how-tos.
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
//! | `bank` (default) | [`bank`]s: folders of many large images in tiles |
//!
//! # Addresses, colour and alpha
//!
//! - A texel has an image, a mip level, a column and a row; an address outside is clamped to the nearest texel. How
//!   texture coordinates outside 0 to 1 are read (repeat, mirror, clamp) is the renderer's choice at drawing, not the file's.
//! - Values are as they were stored: an image in sRGB ([`ColorSpace::Srgb`]) gives sRGB values, to be converted by
//!   [`core::image::srgb_to_linear`] or an sRGB view. Filtering is done on stored values, as the shaders do.
//! - Normals ([`ColorSpace::Normal`]) are unit vectors in 0 to 1; alpha is straight, never multiplied into colours.
//! - With [`Alpha::Band`] the last channel is a band of its own, such as near infrared: a renderer takes such texels as opaque.
//! - A [`Texel`] is a `glam::Vec4` of red, green, blue and alpha; gray is in all three colours, alpha that is not there
//!   is 1.

mod any;
mod arriving;
#[cfg(feature = "bank")]
pub mod bank;
mod codecs;
#[cfg(feature = "encode")]
pub mod encoding;
#[cfg(feature = "encode")]
pub mod guide;
mod open;

pub use any::{AnyImage, AnyTexture, BytesError, file_of};
pub use arriving::{Arrived, Arriving};
pub use codecs::{CODECS, Input, Registration};
#[cfg(feature = "encode")]
pub use encoding::{Choice, Encode, EncodeSettings, Guidance, add_images, encode_images};
pub use open::{OpenError, open, open_from, open_with};
pub use texfold_bc::{self as bc, Content, Family};
pub use texfold_core::image::{Alpha, ColorSpace, Depth, ImageSet, MapInfo, MapKind, PixelInfo, Raster};
pub use texfold_core::{
    self as core, Access, Effort, Encoded, Goal, ImageAddress, Limits, LoadError, Metric, Rect, RegionError,
    Texel,
};
#[cfg(feature = "encode")]
pub use texfold_core::{Cancel, EncodeError, Job};
pub use texfold_dct as dct;
pub use texfold_epitome as epitome;
pub use texfold_lightfield as lightfield;
pub use texfold_progressive as progressive;
pub use texfold_vq as vq;
pub use texfold_zipmap as zipmap;
