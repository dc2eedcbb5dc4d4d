//! A residual plane: the rate class, scale and bits of each block, and the words that a GPU reads them from.

use texfold_core::{ImageLayout, ImageSize, MAX_PLANE_SIDE, WordRows};

use crate::decode::TEXFOLD_RESIDUAL_GROUP_WORDS;

/// Texels a side of a block.
pub const BLOCK_SIDE: u32 = 8;
/// Blocks of a group: those that share a word saying where their bits begin.
pub(crate) const GROUP_BLOCKS: usize = 16;
/// Blocks whose 4-bit numbers fill a word.
const WORD_BLOCKS: usize = 8;

/// Columns and rows of blocks that cover an image of that size.
#[must_use]
pub fn blocks_of(size: ImageSize) -> (u32, u32) {
    (size.width.div_ceil(BLOCK_SIDE), size.height.div_ceil(BLOCK_SIDE))
}

/// Blocks of all levels of an image.
#[must_use]
pub fn level_blocks(size: ImageSize, levels: u32) -> u64 {
    let of_level = |level| {
        let (columns, rows) = blocks_of(size.at_level(level));
        u64::from(columns) * u64::from(rows)
    };
    (0..levels).map(of_level).sum()
}

/// The levels of images that are stored where the finest `shrink_log2` are not.
#[must_use]
pub fn stored_layout(full: &ImageLayout, shrink_log2: u32) -> ImageLayout {
    ImageLayout::new(
        full.images.iter().map(|size| size.at_level(shrink_log2)).collect(),
        full.levels.saturating_sub(shrink_log2).max(1),
        full.pixel,
    )
}

/// The blocks of one image, level after level, each row by row: what an encoder makes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ResidualPlane {
    /// Rate class of each block, 0 to 15.
    pub classes: Vec<u8>,
    /// Scale of each block, 0 to 15: its coefficients are multiplied by 2^(scale / 2).
    pub scales: Vec<u8>,
    /// Bits of all blocks, 16 at a time, the first lowest.
    pub bits: Vec<u16>,
}

impl ResidualPlane {
    /// The words of the plane; `None` where a plane of 8192 x 8192 words cannot hold them. `class_bits`: bits of a block
    /// of class 1.
    #[must_use]
    pub fn words(&self, class_bits: u32) -> Option<PlaneWords> {
        // Room for whole rows, and no more: a loaded texture holds these words.
        let room = plane_words(self.classes.len(), self.bits.len() as u64);
        let mut words = Vec::new();
        words.reserve_exact(usize::try_from(room).ok()?);
        let mut start = 0u32;
        for (classes, scales) in self.classes.chunks(GROUP_BLOCKS).zip(self.scales.chunks(GROUP_BLOCKS)) {
            words.push(start);
            words.extend(nibbles(classes));
            words.extend(nibbles(scales));
            let sum: u32 = classes.iter().map(|&class| u32::from(class)).sum();
            start = start.checked_add(sum.checked_mul(class_bits / 16)?)?;
        }
        let first_bit = u32::try_from(words.len() as u64 * 32).ok()?;
        let word = |pair: &[u16]| u32::from(pair[0]) | u32::from(pair.get(1).copied().unwrap_or(0)) << 16;
        words.extend(self.bits.chunks(2).map(word));
        let (words, WordRows { row_log2, .. }) = WordRows::padded(words);
        let most = (MAX_PLANE_SIDE as usize).pow(2);
        let blocks = self.classes.len();
        (words.len() <= most).then_some(PlaneWords { words, row_log2, first_bit, blocks })
    }
}

/// The 4-bit numbers of a group as two words.
fn nibbles(values: &[u8]) -> [u32; 2] {
    let pack = |values: &[u8]| (0..).zip(values).map(|(n, &v)| u32::from(v) << (4 * n)).sum::<u32>();
    let (low, high) = values.split_at(values.len().min(WORD_BLOCKS));
    [pack(low), pack(high)]
}

/// A residual plane as a GPU reads it: the only form that a loaded texture holds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PlaneWords {
    /// Words of all groups, then the blocks' bits, in whole rows.
    pub words: Vec<u32>,
    /// Binary logarithm of the words in a row.
    pub row_log2: u32,
    /// First bit of the blocks' bits.
    pub first_bit: u32,
    /// Blocks of all levels.
    pub blocks: usize,
}

impl PlaneWords {
    /// The plane that stands for none: GPUs bind one word.
    #[must_use]
    pub(crate) fn empty() -> Self {
        PlaneWords { words: vec![0], row_log2: WordRows::of(1).row_log2, first_bit: 0, blocks: 0 }
    }

    /// The numbers of 4 bits that stand `first` words behind the start of each group.
    fn numbers(&self, first: usize) -> impl Iterator<Item = u8> + '_ {
        (0..self.blocks).map(move |block| {
            let group = block / GROUP_BLOCKS * TEXFOLD_RESIDUAL_GROUP_WORDS as usize;
            let member = block % GROUP_BLOCKS;
            let word = self.words.get(group + first + member / WORD_BLOCKS).copied().unwrap_or(0);
            (word >> (4 * (member % WORD_BLOCKS)) & 15) as u8
        })
    }

    /// Rate class of each block.
    pub fn classes(&self) -> impl Iterator<Item = u8> + '_ {
        self.numbers(1)
    }

    /// Scale of each block.
    pub fn scales(&self) -> impl Iterator<Item = u8> + '_ {
        self.numbers(3)
    }

    /// The bits of all blocks, 16 at a time, where a block of class 1 has `class_bits`.
    pub(crate) fn halves(&self, class_bits: u32) -> impl Iterator<Item = u16> + '_ {
        let count: usize = self.classes().map(|class| usize::from(class) * (class_bits / 16) as usize).sum();
        let words = &self.words[(self.first_bit / 32) as usize..];
        words.iter().flat_map(|&word| [word as u16, (word >> 16) as u16]).take(count)
    }
}

/// Words of the plane of `blocks` blocks that have `halves` times 16 bits.
#[must_use]
pub fn plane_words(blocks: usize, halves: u64) -> u64 {
    let headers = blocks.div_ceil(GROUP_BLOCKS) * TEXFOLD_RESIDUAL_GROUP_WORDS as usize;
    WordRows::of(headers + halves.div_ceil(2) as usize).words as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_gives_back_the_blocks_it_was_made_of() {
        let classes: Vec<u8> = (0..37).map(|n| n * 7 % 16).collect();
        let scales: Vec<u8> = (0..37).map(|n| n * 5 % 16).collect();
        let count: usize = classes.iter().map(|&class| 2 * usize::from(class)).sum();
        let bits: Vec<u16> = (0..count).map(|n| (n * 40503) as u16).collect();
        let plane = ResidualPlane { classes, scales, bits };
        let words = plane.words(32).unwrap();
        assert_eq!(words.words.len() as u64, plane_words(37, count as u64));
        assert_eq!(words.classes().collect::<Vec<_>>(), plane.classes);
        assert_eq!(words.scales().collect::<Vec<_>>(), plane.scales);
        assert_eq!(words.halves(32).collect::<Vec<_>>(), plane.bits);
    }
}
