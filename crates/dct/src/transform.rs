//! The inverse transform of a block: an 8x8 DCT in 32-bit integers.
//!
//! Source: Arai, Agui and Nakajima, "A fast DCT-SQ scheme for images", 1988: five multiplications for eight values, as the
//! rest of the DCT's scales is in the quantiser's steps. Constants have 8 fractional bits; the encoder inverts the
//! transform as it is, so that their rounding costs nothing but 0.001 of orthogonality. Arithmetic wraps, as in WGSL.
//! Samples have 6 fractional bits (2 above 8 bits of depth), so that no intermediate value of a stream that an encoder wrote
//! leaves 32 bits. Coefficients lie column by column and samples row by row, so that one transposition between both passes is
//! enough.
//!
//! *Not taken*: the multiplierless 8x8 transform of H.264, 0.05 to 0.11 dB worse on seven photographs; four transforms of 4x4 in its
//! place where a block costs less so, with a bit for blocks of four coefficients or more: 0.0 dB, and 0.9, 0.6 and 0.2 points of SSIMULACRA2 at
//! 0.5, 1 and 2 bits on eight images, for twice the time of encoding.

use crate::scan::COEFFICIENTS;
use crate::vectors::vectorised;

/// Fractional bits of the constants.
const CONSTANT_BITS: u32 = 8;
/// Square root of 2.
const ROOT: i32 = 362;
/// 2 cos(pi / 8).
const ROTATE_BOTH: i32 = 473;
/// 2 (cos(pi / 8) - cos(3 pi / 8)).
const ROTATE_FIRST: i32 = 277;
/// 2 (cos(pi / 8) + cos(3 pi / 8)).
const ROTATE_SECOND: i32 = 669;

/// Times a constant of 8 fractional bits, rounded.
#[inline(always)]
fn times(value: i32, constant: i32) -> i32 {
    value.wrapping_mul(constant).wrapping_add(1 << (CONSTANT_BITS - 1)) >> CONSTANT_BITS
}

/// The eight values of which `input` has the frequencies.
#[inline(always)]
fn transform(input: [i32; 8]) -> [i32; 8] {
    let (sum, difference) = (input[0].wrapping_add(input[4]), input[0].wrapping_sub(input[4]));
    let both = input[2].wrapping_add(input[6]);
    let rotated = times(input[2].wrapping_sub(input[6]), ROOT).wrapping_sub(both);
    let even0 = sum.wrapping_add(both);
    let even1 = difference.wrapping_add(rotated);
    let even2 = difference.wrapping_sub(rotated);
    let even3 = sum.wrapping_sub(both);

    let (z13, z10) = (input[5].wrapping_add(input[3]), input[5].wrapping_sub(input[3]));
    let (z11, z12) = (input[1].wrapping_add(input[7]), input[1].wrapping_sub(input[7]));
    let odd0 = z11.wrapping_add(z13);
    let z5 = times(z10.wrapping_add(z12), ROTATE_BOTH);
    let odd1 = z5.wrapping_sub(times(z10, ROTATE_SECOND)).wrapping_sub(odd0);
    let odd2 = times(z11.wrapping_sub(z13), ROOT).wrapping_sub(odd1);
    let odd3 = times(z12, ROTATE_FIRST).wrapping_sub(z5).wrapping_add(odd2);
    [
        even0.wrapping_add(odd0),
        even1.wrapping_add(odd1),
        even2.wrapping_add(odd2),
        even3.wrapping_sub(odd3),
        even3.wrapping_add(odd3),
        even2.wrapping_sub(odd2),
        even1.wrapping_sub(odd1),
        even0.wrapping_sub(odd0),
    ]
}

/// Eight transforms side by side: value `at` of transform `lane` is at `8 at + lane`, before and after.
#[inline(never)]
fn transform_lanes(values: &mut [i32; COEFFICIENTS]) {
    vectorised(
        #[inline(always)]
        move || {
            // The loop over lanes is what compilers turn into vectors.
            for lane in 0..8 {
                let mut one = [0; 8];
                for (at, value) in one.iter_mut().enumerate() {
                    *value = values[8 * at + lane];
                }
                let out = transform(one);
                for at in 0..8 {
                    values[8 * at + lane] = out[at];
                }
            }
        },
    );
}

/// The 64 samples of a block, row by row, from its coefficients, column by column; the first one is the mean.
#[inline(always)]
pub(super) fn inverse(mut values: [i32; COEFFICIENTS]) -> [i32; COEFFICIENTS] {
    transform_lanes(&mut values);
    let mut samples = [0; COEFFICIENTS];
    for row in 0..8 {
        for column in 0..8 {
            samples[8 * row + column] = values[8 * column + row];
        }
    }
    transform_lanes(&mut samples);
    samples
}
