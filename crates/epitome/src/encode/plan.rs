//! What a texture is made of: all that the steps from chosen leaves to the shipped form read.

use texfold_core::image::ImageSet;
use texfold_core::{CancelCheck, Effort};

use super::cell_cache::CellCache;
use super::leaf::Grid;
use super::pyramid::Space;
use super::state::Options;
use crate::format::{GainOffset, IDENTITY, Matrix, NEUTRAL, Palettes};

/// What a texture is made of.
#[derive(Clone, Copy)]
pub(crate) struct Plan<'a> {
    pub(crate) images: &'a ImageSet,
    pub(crate) space: &'a Space,
    pub(crate) grid: &'a Grid,
    pub(crate) options: &'a Options,
    pub(crate) palettes: &'a Palettes,
    /// Bits of an entry as estimated in the rate-distortion cost.
    pub(crate) entry_bits: f32,
    pub(crate) mips: bool,
    pub(crate) effort: Effort,
    /// Whether charts of content may be rotated to fit, which raw content alone can be.
    pub(crate) orientations: bool,
    /// Where content is to be fitted to its readers: what was encoded so before.
    pub(crate) refit: Option<&'a CellCache>,
    pub(crate) cancel: CancelCheck<'a>,
}

impl Palettes {
    /// The 2x2 matrix of that number.
    pub(crate) fn matrix(&self, number: u16) -> Matrix {
        self.matrices.get(usize::from(number)).copied().unwrap_or(IDENTITY)
    }

    /// The gain-offset pair of that number.
    pub(crate) fn gain_offset(&self, number: u16) -> GainOffset {
        self.gain_offsets.get(usize::from(number)).copied().unwrap_or(NEUTRAL)
    }
}
