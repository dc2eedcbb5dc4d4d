//! Search for similar patches: descriptors, a k-d tree and affine refinement.
//!
//! For encoders only; decoders never link it. A [`Field`] is an image to search in. [`PatchIndex`] finds the patches of
//! one size that look most like a query under the four mirrorings, whatever their brightness and contrast; [`TurnedIndex`] those
//! of several sizes that do so however they are turned; [`GsrIndex`] does so by the gray values of a turned grid, as
//! the descriptor GSR has them; [`SpectrumIndex`] by their low frequencies, in all turns at once;
//! [`Refiner`] then moves, turns, scales and shears a match until its error stops falling.

mod bounded;
mod descriptor;
mod field;
mod groups;
mod gsr;
mod index;
mod refine;
mod spectrum;
mod turned;

pub use descriptor::{DESCRIPTOR_LENGTH, Descriptor, Mirror, describe};
pub use field::{Field, LumaSums};
pub use gsr::{GSR_SIDES, GrayPlane, GsrIndex, GsrMatch, GsrTone};
pub use index::{Neighbour, PatchIndex, Place};
pub use refine::{Freedom, Refined, Refiner, Transform};
pub use spectrum::{SpectrumIndex, SpectrumMatch};
pub use turned::{Turned, TurnedIndex};
