//! Goals, and the searches for what meets one: [`search`] among settings in order, [`search_step`] along a quantiser's step.

mod search;
mod step;

use crate::image::ColorSpace;

pub use search::{Found, search};
pub use step::{FoundStep, StepScale, search_step, search_step_estimated};

/// How long an encoder may look for a better result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, PartialOrd, Ord)]
pub enum Effort {
    /// Previews: the first acceptable result.
    Fast,
    /// The usual trade.
    #[default]
    Normal,
    /// Several times slower for a few tenths of a dB.
    High,
}

/// Which errors an encoder holds against each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum Metric {
    /// Squared errors: the highest PSNR.
    Psnr,
    /// What the eye sees: errors of fine detail count less. PSNR is 0.5 to 1 dB lower, SSIMULACRA2 higher.
    #[default]
    Perceptual,
}

impl Metric {
    /// What counts where nobody says: the eye where colours are sRGB and bits are the goal, else PSNR.
    #[must_use]
    pub fn for_goal(goal: Goal, color: ColorSpace) -> Self {
        let is_seen = color == ColorSpace::Srgb && matches!(goal, Goal::Bpp(_));
        if is_seen { Metric::Perceptual } else { Metric::Psnr }
    }

    /// Its name: "psnr", "perceptual".
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Metric::Psnr => "psnr",
            Metric::Perceptual => "perceptual",
        }
    }
}

/// What a user asks an encoder for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Goal {
    /// The smallest result of at least this PSNR in dB.
    Psnr(f64),
    /// The best result within this many bits of compressed form per source texel ([`crate::MemoryBits::goal`]); what textures in
    /// blocks are decoded to does not count.
    Bpp(f64),
    /// The smallest result whose every block has at most this RMS error, in 8-bit units.
    Tolerance(f64),
}

impl Default for Goal {
    fn default() -> Self {
        Goal::Psnr(34.0)
    }
}

impl Goal {
    /// The command line's option for it: "--psnr 34".
    #[must_use]
    pub fn option(&self) -> String {
        match self {
            Goal::Psnr(psnr) => format!("--psnr {psnr}"),
            Goal::Bpp(bpp) => format!("--bpp {bpp}"),
            Goal::Tolerance(tolerance) => format!("--tolerance {tolerance}"),
        }
    }

    /// Checks the number.
    ///
    /// # Errors
    /// [`crate::ParamError`] where it is not a positive finite number.
    pub fn check(self) -> Result<(), crate::ParamError> {
        let (field, value) = match self {
            Goal::Psnr(value) => ("psnr", value),
            Goal::Bpp(value) => ("bpp", value),
            Goal::Tolerance(value) => ("tolerance", value),
        };
        if value.is_finite() && value > 0.0 {
            return Ok(());
        }
        Err(crate::ParamError::new(field, value, "positive finite numbers"))
    }

    /// Whether a result meets the goal.
    #[must_use]
    pub fn is_met(self, by: &Measured) -> bool {
        match self {
            Goal::Psnr(psnr) => by.psnr >= psnr,
            Goal::Bpp(bpp) => by.bpp <= bpp,
            Goal::Tolerance(tolerance) => by.worst_block_rms <= tolerance,
        }
    }

    /// Whether `a` is the better answer to the goal than `b`: met before missed, then the smaller or, for bits
    /// per texel, the finer one, the smaller of equals; among misses the one that comes nearer.
    #[must_use]
    pub fn prefers(self, a: &Measured, b: &Measured) -> bool {
        let (met_a, met_b) = (self.is_met(a), self.is_met(b));
        if met_a != met_b {
            return met_a;
        }
        match self {
            Goal::Bpp(_) if met_a => a.psnr > b.psnr || a.psnr >= b.psnr && a.bpp < b.bpp,
            Goal::Bpp(_) => a.bpp < b.bpp,
            _ if met_a => a.bpp < b.bpp,
            Goal::Psnr(_) => a.psnr > b.psnr,
            Goal::Tolerance(_) => a.worst_block_rms < b.worst_block_rms,
        }
    }
}

/// What a candidate turned out to be.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Measured {
    /// PSNR in dB of the decoded form.
    pub psnr: f64,
    /// Bits of compressed form per source texel ([`crate::MemoryBits::goal`]).
    pub bpp: f64,
    /// RMS error of the worst 4x4 block, 8-bit units.
    pub worst_block_rms: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_equal_quality_the_smaller_one_is_better() {
        let of = |psnr, bpp| Measured { psnr, bpp, worst_block_rms: 0.0 };
        let goal = Goal::Bpp(1.0);
        assert!(
            goal.prefers(&of(40.0, 0.2), &of(40.0, 0.9)) && !goal.prefers(&of(40.0, 0.9), &of(40.0, 0.2))
        );
        assert!(
            goal.prefers(&of(40.1, 0.9), &of(40.0, 0.2)) && !goal.prefers(&of(40.0, 0.9), &of(40.0, 0.9))
        );
        assert!(goal.prefers(&of(9.0, 1.0), &of(40.0, 1.1)));
    }

    #[test]
    fn bad_goals_are_named() {
        assert_eq!(Goal::Bpp(f64::NAN).check().map_err(|e| e.field), Err("bpp"));
        assert_eq!(Goal::Psnr(-1.0).check().map_err(|e| e.field), Err("psnr"));
        assert!(Goal::Tolerance(2.0).check().is_ok());
    }
}
