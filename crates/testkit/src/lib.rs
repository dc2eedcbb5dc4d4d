//! Fixtures, pathological inputs and helpers for Texfold's own tests.

pub mod cancel;
pub mod capture;
pub mod fixtures;
pub mod leaves;
mod load;

pub use load::{data_dir, fixtures_dir, frames, image, png};

pub use texfold_core::rng;
