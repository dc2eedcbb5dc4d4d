//! Images as a reduced base and a residual plane, decoded at random access: texel data for codecs, as `texfold-bc` has it.
//!
//! The base is a reduced image of half, a quarter or an eighth of the width and height in plain blocks, drawn with
//! bilinear filtering. Its residual is coded in blocks of 8x8 texels, none to some 7 bits a texel each. A block's texels
//! are turned into luma and chroma, or axes of a texture's own ([`Axes`]), and transformed by a two-level Haar transform in cells of 4x4; subbands get bits by the
//! block's rate class and are coded by a trellis: of the bit string around the block, a window of ten bits that ends with
//! a coefficient's own bits names its value. So any coefficient is read with two loads, and yet two bits a coefficient
//! come within 1.1 dB of what any code of two bits can do, where four levels stay 2.7 dB below.
//!
//! Source of the residual plane: "Progressive compression of large-scale remote sensing images with GSR descriptors",
//! 2012, section 4.3, which calls it an error map and has two end colours and 2-bit selectors a block over codebooks; of
//! trellis codes that are read by a window: Mao and Gray, "Stationary and trellis encoding for iid sources and
//! simulation", DCC 2010. Cost: encoding a trellis search of 1024 states a coefficient, block and class; decoding 12
//! loads of words a texel.
//!
//! *Not done*: alpha in the residual plane. The base alone holds it, and is reduced no further than alpha allows.
//!
//! [`ResidualContent`] is what a codec embeds: it stores itself in sections of its own ([`texfold_core::container::ContentId`]), pushes its planes
//! and parameters into a GPU form, and decodes regions. Its WGSL is `residual.wgsl`; the CPU twins are in [`decode`].

mod axes;
mod content;
pub mod decode;
#[cfg(feature = "encode")]
pub mod encode;
mod plane;
mod rates;
mod wire;

pub use axes::Axes;
pub use content::{APRON, BaseForm, MAX_REDUCE_LOG2, MAX_SHRINK_LOG2, PADDING, ResidualContent};
pub use decode::{BLOCK_CELLS, SUBBANDS};
pub use plane::{BLOCK_SIDE, PlaneWords, ResidualPlane, blocks_of, level_blocks, plane_words, stored_layout};
pub use rates::{MAX_RATES, RATE_CLASSES, RateModel, Rates, SUBBAND_COUNTS, WEIGHT_ONE};
