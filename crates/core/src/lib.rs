//! The vocabulary that every Texfold codec shares.
//!
//! A codec turns a source into an [`Encoded`] texture; the encoded form is what ships: it can be sampled
//! at random, decoded by region, stored in a `.txf` file, counted bit by bit and handed to a GPU. This
//! crate knows no codec, no GPU and no file system.
//!
//! Start with [`TextureCodec`] (the family: how textures are loaded), `Encoder` (how they are made) and [`Encoded`] (the shipped form).
//!
//! Without the feature `encode`, which is on by default, there is what reads, samples and draws textures: no rayon and no C compiler.

pub mod address;
mod cached;
pub mod capture;
mod codec;
pub mod container;
mod domain;
mod encoded;
#[cfg(feature = "encode")]
mod encoder;
mod error;
mod footprint;
mod gpu_dct;
mod gpu_form;
mod id;
pub mod image;
#[cfg(feature = "encode")]
mod job;
mod limits;
pub mod mesh;
#[cfg(feature = "encode")]
pub mod metric;
mod names;
pub mod parallel;
#[cfg(feature = "encode")]
mod principal;
pub mod rng;
pub mod sample;
pub mod target;
mod vectors;
mod word_plane;

pub use cached::Cached;
pub use capture::{Camera, Capture, Mesh, Photograph};
pub use codec::TextureCodec;
pub use container::Notes;
pub use domain::{Domain, Image2d, ImageAddress, LightAddress, LightLayout, Rect, SurfaceLight};
pub use encoded::{Encoded, Layers, Refine};
#[cfg(feature = "encode")]
pub use encoder::{Encoder, Growable, Params, SharedSearch};
pub use error::{EncodeError, LoadError, ParamError, ParamValue, RegionError, SourceError};
pub use footprint::{BASE_PART, Footprint, Part, RESIDUAL_PART};
pub use gpu_dct::{DCT_LEVELS, DctLayout, DecodedImage, GpuChannel, GpuDct, MipAverage, dct_planes};
pub use gpu_form::{
    Access, GpuForm, HEADER_BYTES, ImageBinding, MemoryBits, Plane, PlaneFormat, parameter_bits,
};
pub use id::{CodecId, String4};
pub use image::{ImageLayout, ImageSize};
#[cfg(feature = "encode")]
pub use job::{Cancel, CancelCheck, Job, Stage};
pub use limits::{Budget, LimitError, Limits, MAX_IMAGE_SIDE, MAX_PLANE_SIDE};
pub use names::NameError;
#[cfg(feature = "encode")]
pub use principal::principal_axes;
pub use target::{Effort, Goal, Metric};
pub use vectors::vectorised;
pub use word_plane::{WordRows, word_plane};

/// One colour: red, green, blue, alpha, nominally in [0, 1], as stored (no gamma conversion).
pub type Texel = glam::Vec4;
