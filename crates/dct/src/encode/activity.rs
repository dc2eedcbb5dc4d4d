//! Activity of superblocks at a step, which scales bits and errors of a part of an image's superblocks to those of all.
//!
//! Source: He and Mitra, "Optimum bit allocation and accurate rate control for video coding via rho-domain source modeling", 2002: bits are
//! nearly proportional to the number of coefficients that are not zero. The part's bits are multiplied by that number of the whole image,
//! divided by that of the part; squared errors likewise, by the errors of a quantiser with a dead zone.

use super::forward::Block;
use crate::scan::COEFFICIENTS;
use crate::vectors::vectorised;

/// Value from which on a coefficient is not coded as zero, mostly, in steps.
const DEAD_ZONE: f32 = 0.6;
/// Squared error of a coefficient that is not zero, in squared steps: that of an even spread over a step.
const CODED_ERROR: f32 = 1.0 / 12.0;
/// Sums side by side: in a fixed order for any width of vectors.
const LANES: usize = 8;

/// Sums over blocks.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Activity {
    /// Coefficients beyond the dead zone.
    pub coded: f64,
    /// Squared error of a quantiser with that dead zone, times the weights.
    pub error: f64,
}

impl Activity {
    /// Adds the coefficients of a block. `inverse` has 1 / step of each, 0 for those that are not coded; `weights` those of squared steps.
    pub(super) fn add(
        &mut self,
        block: &Block,
        inverse: &[f32; COEFFICIENTS],
        weights: &[f32; COEFFICIENTS],
    ) {
        let (mut coded, mut error) = ([0.0f32; LANES], [0.0f32; LANES]);
        vectorised(
            #[inline(always)]
            || {
                for row in 0..COEFFICIENTS / LANES {
                    for lane in 0..LANES {
                        let at = row * LANES + lane;
                        let value = (block[at] * inverse[at]).abs();
                        let is_coded = value > DEAD_ZONE;
                        coded[lane] += if is_coded { 1.0 } else { 0.0 };
                        error[lane] += weights[at] * if is_coded { CODED_ERROR } else { value * value };
                    }
                }
            },
        );
        self.coded += f64::from(coded.iter().sum::<f32>());
        self.error += f64::from(error.iter().sum::<f32>());
    }

    /// Factors of this part's bits and errors, for estimates of those of `all`; `usual` where one of them has none.
    pub(super) fn factors(&self, all: &Activity, usual: f64) -> (f64, f64) {
        let ratio = |part: f64, all: f64| if part > 0.0 && all > 0.0 { all / part } else { usual };
        (ratio(self.coded, all.coded), ratio(self.error, all.error))
    }
}

impl std::iter::Sum for Activity {
    fn sum<I: Iterator<Item = Activity>>(all: I) -> Activity {
        all.fold(Activity::default(), |sum, own| Activity {
            coded: sum.coded + own.coded,
            error: sum.error + own.error,
        })
    }
}
