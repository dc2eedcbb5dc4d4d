//! Fixtures, pathological inputs and helpers for Texfold's own tests.

pub mod cancel;
pub mod capture;
pub mod dct;
pub mod fixtures;
pub mod leaves;
mod load;
pub mod once;
mod strokes;

pub use load::{crop, data_dir, fixtures_dir, frames, image, png};
pub use strokes::strokes;

pub use texfold_core::rng;

/// Whether the long form of tests is to run: where the environment variable `TEXFOLD_FULL` is set.
#[must_use]
pub fn full() -> bool {
    std::env::var_os("TEXFOLD_FULL").is_some()
}
