//! Fixtures, pathological inputs, naive oracles and comparisons for Texfold's own tests

pub mod fixtures;
