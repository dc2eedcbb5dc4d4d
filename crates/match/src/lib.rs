//! Search for similar patches: descriptors, a k-d tree and affine refinement.
//!
//! For encoders only; decoders never link it. A [`Field`] is an image to search in. [`PatchIndex`] finds the patches of
//! one size that look most like a query under the four mirrorings, whatever their brightness and contrast; [`OrientedIndex`] those
//! of several sizes that do so however they are rotated; [`GsrIndex`] does so by the gray values of a rotated grid, as
//! the descriptor GSR has them; [`SpectrumIndex`] by their low frequencies, in all orientations at once;
//! [`Refiner`] then moves, rotates, scales and shears a match until its error stops falling.

mod bounded;
mod descriptor;
mod field;
mod groups;
mod gsr;
mod index;
mod oriented;
mod refine;
mod spectrum;

pub use descriptor::{DESCRIPTOR_LENGTH, Descriptor, Mirror, describe};
pub use field::{Field, LumaSums};
pub use gsr::{GSR_SIDES, GrayPlane, GsrIndex, GsrInput, GsrMatch};
pub use index::{Neighbour, PatchIndex, Place};
pub use oriented::{OrientedIndex, OrientedPatch};
pub use refine::{Freedom, Refined, Refiner, Transform};
pub use spectrum::{SpectrumIndex, SpectrumMatch};
