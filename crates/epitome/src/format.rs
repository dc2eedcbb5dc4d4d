//! What a map says: its form, entries and palettes, and how blocks are split.

use texfold_core::ImageSize;

use crate::decode::{TEXFOLD_EPITOME_GAIN_ONE, TEXFOLD_EPITOME_LINEAR_ONE};

/// Most texels a side of a block.
pub(crate) const MAX_BLOCK: usize = 64;

/// How the map is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MapFormat {
    /// Texels a side of a block.
    pub block: u32,
    /// Whether blocks are split into leaves of a half and a quarter of their side.
    pub split: bool,
    /// Bits of a position's column.
    pub x_bits: u32,
    /// Bits of a position's row.
    pub y_bits: u32,
    /// How many of them are a fraction of a texel.
    pub fraction_bits: u32,
    /// Bits of a gain-offset pair's number.
    pub gain_offset_bits: u32,
    /// Bits of a matrix's number.
    pub matrix_bits: u32,
    /// Whether there are two epitomes.
    pub mixed: bool,
    /// Half the width of the seam along borders of leaves in which both are blended, in eighths of a texel; at least
    /// 4.
    pub seam_width: u32,
}

/// Half a texel, in eighths: leaves are blended between their outermost texels' centres.
pub(crate) const LEAST_SEAM_WIDTH: u32 = 4;

impl MapFormat {
    /// Texels a side of the smallest leaf.
    #[must_use]
    pub fn cell(&self) -> u32 {
        if self.split { self.block / 4 } else { self.block }
    }

    /// Bytes of an entry.
    #[must_use]
    pub fn entry_bytes(&self) -> u32 {
        let bits =
            self.x_bits + self.y_bits + self.gain_offset_bits + self.matrix_bits + u32::from(self.mixed);
        bits.div_ceil(8).max(2)
    }
}

/// One leaf's entry of the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Entry {
    /// Column of the leaf's centre in the epitome, in fractions of a texel as the format says.
    pub x: u32,
    /// Row of the leaf's centre.
    pub y: u32,
    /// Number of its gain-offset pair.
    pub gain_offset: u32,
    /// Number of its 2x2 matrix.
    pub matrix: u32,
    /// Which epitome.
    pub plane: u32,
}

/// Rows of a 2x2 matrix in units of 1/8192.
pub type Matrix = [i16; 4];
/// Gain in units of 1/128 and offset plus 128 in units of 1/255, for red, green and blue each.
pub type GainOffset = [u8; 6];

/// Number of a matrix's coefficient that stands for 1.
pub(crate) const LINEAR_ONE: i16 = TEXFOLD_EPITOME_LINEAR_ONE as i16;
/// Number of a gain that stands for 1.
pub(crate) const GAIN_ONE: u8 = TEXFOLD_EPITOME_GAIN_ONE as u8;
/// Number of an offset that stands for 0.
pub(crate) const OFFSET_ZERO: u8 = 128;

/// The 2x2 matrix that changes nothing.
pub const IDENTITY: Matrix = [LINEAR_ONE, 0, 0, LINEAR_ONE];
/// The gain-offset pair that changes nothing.
pub const NEUTRAL: GainOffset = [GAIN_ONE, GAIN_ONE, GAIN_ONE, OFFSET_ZERO, OFFSET_ZERO, OFFSET_ZERO];

/// Trees and entries of a layer.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct LayerMap {
    /// For each block of all images, row by row: bit 0 whether it is split, bits 1 to 4 which of its quarters are.
    /// Nothing where blocks are not split.
    pub(crate) trees: Vec<u8>,
    /// For each leaf, block by block.
    pub(crate) entries: Vec<Entry>,
}

/// What entries point into.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Palettes {
    pub(crate) matrices: Vec<Matrix>,
    pub(crate) gain_offsets: Vec<GainOffset>,
}

/// Columns and rows of blocks that cover an image.
pub(crate) fn blocks_of(size: ImageSize, block: u32) -> (u32, u32) {
    (size.width.div_ceil(block), size.height.div_ceil(block))
}

/// Squares of a block: itself, its four quarters, and theirs.
pub(crate) const NODES: usize = 21;

/// Squares of a block of that tree byte that are leaves, in the order of their entries.
pub(crate) fn nodes_of(tree: u8) -> impl Iterator<Item = usize> {
    let quarter = move |quarter: usize| {
        let split = tree >> (1 + quarter) & 1 == 1;
        let (first, count) = if split { (5 + 4 * quarter, 4) } else { (1 + quarter, 1) };
        first..first + count
    };
    let quarters = if tree & 1 == 0 { 0 } else { 4 };
    let whole = if tree & 1 == 0 { 0..1 } else { 0..0 };
    whole.chain((0..quarters).flat_map(quarter))
}

/// Leaves of a block of that tree byte.
pub(crate) fn leaves_of(tree: u8) -> u32 {
    if tree & 1 == 0 { 1 } else { 4 + 3 * (tree >> 1 & 15).count_ones() }
}
