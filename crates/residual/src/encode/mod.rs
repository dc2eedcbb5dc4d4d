//! The encoder's steps: bases, residuals, the rate model, and the blocks' bits.
//!
//! A codec that embeds residual content makes [`bases`], collects [`Residuals`] against what it decodes from them, trains
//! a [`RateModel`](crate::RateModel) and lets a [`Coder`] choose a rate class for each block. [`PlaneForm`] does all of it
//! for a single image.

mod axes;
mod base;
mod coder;
mod eye;
mod fit;
mod model;
mod padded;
mod plane;
mod residuals;
mod transform;
mod trellis;

pub use base::bases;
pub use coder::Coder;
pub use eye::{Score, counted_error, counted_error_of, least_share, score};
pub use fit::Enlargement;
pub use model::{Reach, train};
pub use padded::PaddedRaster;
pub use plane::{PlaneForm, TOO_LARGE};
pub use residuals::{CLASS_BITS, CROWDED, Residuals, decode_strips, share_of_largest};
pub use transform::ResidualBlock;
