//! How many bits the coefficients of a block get, by rate class and subband.

use crate::axes::Axes;
use crate::decode::{BLOCK_CELLS, SUBBANDS};

/// Coefficients of each subband in a cell of 4x4 texels: mean of luma; its coarse horizontal, vertical and diagonal
/// ones; horizontal and vertical ones of each 2x2; diagonal ones of each 2x2; means of both chroma axes; their coarse
/// ones; and those of each 2x2 of chroma.
pub const SUBBAND_COUNTS: [u32; SUBBANDS] = [1, 3, 8, 4, 2, 6, 24];
/// Most bits of a coefficient by subband. The coefficients of a cell's means and coarse subbands, and those of a 2x2,
/// are read at once from 64 bits and taken apart 32 bits at a time, luma's, then chroma's, with
/// [`crate::decode::TEXFOLD_RESIDUAL_STATE_BITS`] bits before their own.
pub const MAX_RATES: [u32; SUBBANDS] = [5, 5, 5, 5, 5, 2, 3];
/// Rate classes.
pub const RATE_CLASSES: usize = 16;
/// Number that stands for a subband's weight of 1.
pub const WEIGHT_ONE: f32 = 1024.0;

/// Bits of a coefficient of each subband.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, PartialOrd, Ord)]
pub struct Rates(pub [u8; SUBBANDS]);

impl Rates {
    /// Bits of a block.
    #[must_use]
    pub fn bits(self) -> u32 {
        let of_cell = |(&rate, count): (&u8, u32)| u32::from(rate) * count;
        BLOCK_CELLS * self.0.iter().zip(SUBBAND_COUNTS).map(of_cell).sum::<u32>()
    }

    /// As the shader reads them, 4 bits a subband.
    #[must_use]
    pub fn packed(self) -> u32 {
        (0..).zip(self.0).map(|(subband, rate)| u32::from(rate) << (4 * subband)).sum()
    }

    /// From what [`Rates::packed`] gives; `None` where a subband has more bits than [`MAX_RATES`].
    #[must_use]
    pub fn unpacked(word: u32) -> Option<Rates> {
        let rates = Rates(std::array::from_fn(|subband| (word >> (4 * subband) & 15) as u8));
        let fits = rates.0.iter().zip(MAX_RATES).all(|(&rate, most)| u32::from(rate) <= most);
        (fits && word >> (4 * SUBBANDS) == 0).then_some(rates)
    }
}

/// What all blocks of a residual plane share: the rates of each class, and how large the subbands' coefficients are.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RateModel {
    /// Bits of a block of class 1: 16 or 32; class k has k times as many. 0 where there is no residual plane.
    pub class_bits: u32,
    /// Rates by class. No block is of a class without bits, but of class 0.
    pub classes: [Rates; RATE_CLASSES],
    /// Weight of each subband in units of 1/1024.
    pub weights: [u16; SUBBANDS],
    /// How luma and chroma are turned.
    pub axes: Axes,
}

impl RateModel {
    /// With residuals along such axes.
    #[must_use]
    pub fn with_axes(self, axes: Axes) -> Self {
        RateModel { axes, ..self }
    }

    /// The weights as the shader reads them.
    #[must_use]
    pub fn scales(&self) -> [f32; SUBBANDS] {
        self.weights.map(|weight| f32::from(weight) / WEIGHT_ONE)
    }

    /// Whether blocks of that class may stand in a plane.
    #[must_use]
    pub fn allows(&self, class: u8) -> bool {
        class == 0 || self.classes.get(usize::from(class)).is_some_and(|rates| rates.bits() > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_packed_and_read_again() {
        let rates = Rates([5, 4, 3, 2, 1, 0, 3]);
        assert_eq!(Rates::unpacked(rates.packed()), Some(rates));
        assert_eq!(rates.bits(), 4 * (5 + 12 + 24 + 8 + 2 + 72));
        // A subband above its most bits, and bits behind the last subband.
        assert_eq!(Rates::unpacked(3 << 20), None);
        assert_eq!(Rates::unpacked(1 << 28), None);
    }
}
