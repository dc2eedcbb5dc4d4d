//! How many bits the coefficients of a block get, by class.

/// Kinds of coefficients, and how many of each a cell of 4x4 texels has: mean of luma; its coarse, across, down and diagonal;
/// edges across and down of each 2x2; their diagonals; mean of both axes of chroma; their coarse ones; and their edges and diagonals of each 2x2.
pub(crate) const COUNTS: [u32; 7] = [1, 3, 8, 4, 2, 6, 24];
/// Kinds of coefficients.
pub(crate) const KINDS: usize = COUNTS.len();
/// Most bits of a coefficient by kind: those of a cell's mean and coarse ones, and of a 2x2, are read in one go of 64 bits and taken 32 at a
/// time, luma's and then chroma's, [`crate::decode::TEXFOLD_PROGRESSIVE_STATE_BITS`] of them before their own.
pub(crate) const MOST: [u32; KINDS] = [5, 5, 5, 5, 5, 2, 3];
/// Classes of blocks.
pub(crate) const CLASSES: usize = 16;
/// Cells of a block.
pub(crate) const CELLS: u32 = 4;

/// Bits of a coefficient of each kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, PartialOrd, Ord)]
pub struct Rates(pub [u8; KINDS]);

impl Rates {
    /// Bits of a block.
    #[must_use]
    pub fn bits(self) -> u32 {
        CELLS * self.0.iter().zip(COUNTS).map(|(&rate, count)| u32::from(rate) * count).sum::<u32>()
    }

    /// As the shader reads them, 4 bits a kind.
    pub(crate) fn packed(self) -> u32 {
        (0..).zip(self.0).map(|(kind, rate)| u32::from(rate) << (4 * kind)).sum()
    }

    /// From what [`Rates::packed`] gives; `None` where a kind has more bits than it may.
    pub(crate) fn unpacked(word: u32) -> Option<Rates> {
        let rates = Rates(std::array::from_fn(|kind| (word >> (4 * kind) & 15) as u8));
        let fits = rates.0.iter().zip(MOST).all(|(&rate, most)| u32::from(rate) <= most);
        (fits && word >> (4 * KINDS) == 0).then_some(rates)
    }
}

/// What all blocks of a texture share.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Model {
    /// Bits of a block of class 1, a multiple of 16; class k has k times as many. 0 where there is no error map.
    pub class_bits: u32,
    /// Bits of the coefficients by class. No block is of a class without bits, but the first.
    pub classes: [Rates; CLASSES],
    /// Weight of each kind in units of 1/1024.
    pub weights: [u16; KINDS],
}

impl Model {
    /// The weights as the shader reads them.
    pub(crate) fn scales(&self) -> [f32; 8] {
        let mut scales = [0.0; 8];
        for (scale, weight) in scales.iter_mut().zip(self.weights) {
            *scale = f32::from(weight) / WEIGHT_ONE;
        }
        scales
    }
}

/// Number of a weight of 1.
pub(crate) const WEIGHT_ONE: f32 = 1024.0;
