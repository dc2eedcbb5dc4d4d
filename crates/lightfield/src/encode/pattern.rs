//! Values that terms start from where nothing better is known: the same on every machine and for any number of threads.

/// 2^32 over the golden ratio (Knuth, The Art of Computer Programming 3, section 6.4): products with it spread successive numbers evenly.
const GOLDEN: usize = 0x9e37_79b9;
/// The lowest bits of a product depend on few bits of the number.
const SKIPPED_BITS: u32 = 7;

/// The number of a place as one of 256 values from 0 to 1 that follow no order of places.
pub(super) fn pattern(number: usize) -> f32 {
    (number.wrapping_mul(GOLDEN) >> SKIPPED_BITS & 0xff) as f32 / 255.0
}
