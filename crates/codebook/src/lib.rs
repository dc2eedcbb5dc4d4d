//! Importance-weighted, deterministic codebook building (generalised Lloyd) for vectors of any length
