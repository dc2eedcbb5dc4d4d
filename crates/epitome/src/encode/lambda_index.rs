//! The scale of lambda: a number of steps, 32 an octave, for searches by index.

use std::ops::RangeInclusive;

/// Lambda indices in an octave.
const INDICES_AN_OCTAVE: f32 = 32.0;
/// Binary logarithm of lambda at lambda index 0, above which nothing is coded any more.
const LARGEST_LOG2: f32 = 14.0;
/// Lambda indices.
pub(super) const LAMBDA_INDICES: RangeInclusive<u32> = 1..=544;
/// The setting under which only bits count, for tolerances: within them errors are free.
pub(super) const TOLERANCE_LAMBDA_INDEX: u32 = 96;

/// Error that a bit may cost at lambda index `lambda_index`, 8-bit squared units.
pub(super) fn lambda(lambda_index: u32) -> f32 {
    (LARGEST_LOG2 - lambda_index as f32 / INDICES_AN_OCTAVE).exp2()
}

/// The setting nearest to a lambda.
pub(super) fn lambda_index_of(lambda: f32) -> u32 {
    let lambda_index = (INDICES_AN_OCTAVE * (LARGEST_LOG2 - lambda.log2())).round().max(0.0) as u32;
    lambda_index.clamp(*LAMBDA_INDICES.start(), *LAMBDA_INDICES.end())
}
