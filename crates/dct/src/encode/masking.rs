//! Local masking: where much goes on, errors are seen less.
//!
//! A block's errors count by its activity to the power of minus [`MASKING`], against the geometric mean of all blocks of the image.
//! The decoder knows nothing of it: all blocks have one quantiser, and a bit is worth more squared error where activity is high.
//! Source of the power law: Watson, "DCT quantization matrices visually optimized for individual images", 1993.
//! *Not taken*: a step for each superblock of 32x32 texels, by its activity to a power. With a
//! power of 0.3, SSIMULACRA2 gains no more than by a slope that loses as many dB. In twelve atlases of dark tiles beside loud ones, the
//! 64x64 texels that are farthest below ASTC are so by 3.5 dB in the mean at 0.9 and at 2 bits, and by 1.9 and 2.6 with that power; a
//! power of 1 for loud superblocks leaves 0.5 and 1.0, and costs photographs 0.5 to 1.2 points and 1.2 to 1.6 dB.

use super::forward::Block;

/// Power of the activity. SSIMULACRA2 at 0.89, 1.28, 2 and 3.56 bits on four photographs, with a slope of 12 (0.56 dB below the
/// form for PSNR): 68.4, 77.3, 85.3, 91.4; with a slope of 17 and no masking (0.61 dB below) 68.1, 77.1, 85.1, 91.3. A power of 0.3
/// with a slope of 8, activities of blocks around, or those of high frequencies alone are no better.
const MASKING: f32 = 0.2;
/// Activity in squared steps below which blocks are alike.
const LEAST_ACTIVITY: f32 = 4.0;
/// Most that errors may count more or less.
const MOST: f32 = 4.0;

/// Energy of a block's coefficients beside the mean.
pub(super) fn energy(block: &Block) -> f32 {
    block.iter().skip(1).map(|coefficient| coefficient * coefficient).sum()
}

/// For each block of an image, row by row, how much more squared error a bit is worth; 1 in the geometric mean but for the limits.
/// `step` is the quantiser's, in the coefficients' units; `energies` are those of the blocks of first axes.
pub(super) fn masking(energies: &[f32], step: f32) -> Vec<f32> {
    let activity = |energy: &f32| (energy / (step * step) + LEAST_ACTIVITY).ln();
    let activities: Vec<f32> = energies.iter().map(activity).collect();
    let mean = activities.iter().sum::<f32>() / activities.len().max(1) as f32;
    activities
        .into_iter()
        .map(|activity| (MASKING * (activity - mean)).exp().clamp(1.0 / MOST, MOST))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan::COEFFICIENTS;

    fn energies(amplitudes: &[f32]) -> Vec<f32> {
        let of = |&amplitude: &f32| {
            let mut block = [0.0; COEFFICIENTS];
            (block[0], block[5]) = (1000.0, amplitude);
            energy(&block)
        };
        amplitudes.iter().map(of).collect()
    }

    #[test]
    fn a_bit_is_worth_more_error_where_more_goes_on() {
        assert_eq!(masking(&energies(&[30.0; 6]), 10.0), [1.0; 6]);
        let found = masking(&energies(&[0.0, 20.0, 200.0, 1000.0]), 10.0);
        assert!(found.windows(2).all(|pair| pair[0] < pair[1]), "{found:?}");
        let product: f32 = found.iter().product();
        assert!((product - 1.0).abs() < 1e-4, "{product}");
        // 100 times the activity, far above the least: 100^0.2.
        let found = masking(&energies(&[400.0, 4000.0]), 1.0);
        assert!((found[1] / found[0] - 2.512).abs() < 0.01, "{found:?}");
        let extreme = masking(&energies(&[0.0, 1e9]), 1.0);
        assert_eq!(extreme, [0.25, 4.0]);
    }
}
