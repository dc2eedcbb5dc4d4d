//! Criterion benches of encoding, CPU decoding and shader decoding
