//! Fixtures, pathological inputs and helpers for Texfold's own tests.

use std::hint::black_box;

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

/// So many dependent multiplications: what times are compared with on machines of any speed. Here, as tests' own packages are compiled without
/// optimisation.
pub fn multiply(times: u64) {
    let product =
        (0..times).fold(1u64, |product, i| black_box(product.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ i));
    black_box(product);
}

/// Whether the long form of tests is to run: where the environment variable `TEXFOLD_FULL` is set.
#[must_use]
pub fn full() -> bool {
    std::env::var_os("TEXFOLD_FULL").is_some()
}
