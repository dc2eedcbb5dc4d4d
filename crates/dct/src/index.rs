//! Where each superblock's bytes lie: groups of 32, each a word with the first byte and 32 lengths of equal width.
//!
//! Any superblock is found with the loads of one group. Cost: one bit a superblock and the bits of the longest one.

use crate::Bytes;

/// Superblocks of a group.
const GROUP: usize = 32;

/// The lengths of all superblocks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Index {
    /// Bits of a length.
    width: u32,
    words: Vec<u32>,
    /// True where a file holds the lengths alone, and not these words.
    is_packed: bool,
}

impl Index {
    /// Words of an index of `count` superblocks whose lengths have `width` bits.
    pub(super) fn words_of(count: usize, width: u32) -> usize {
        count.div_ceil(GROUP) * (width as usize + 1)
    }

    /// An index of such words.
    pub(super) fn new(width: u32, words: Vec<u32>) -> Index {
        Index { width, words, is_packed: false }
    }

    /// The index of superblocks of such lengths; `None` where their sum has more than 32 bits.
    #[cfg(feature = "encode")]
    pub(super) fn of_lengths(lengths: &[usize]) -> Option<Index> {
        let longest = u32::try_from(lengths.iter().copied().max().unwrap_or(0)).ok()?;
        Index::of_width(32 - longest.leading_zeros(), lengths.len(), |number| lengths[number] as u32)
    }

    /// Bytes of `count` lengths of `width` bits.
    pub(super) fn packed_bytes(count: usize, width: u32) -> usize {
        (count * width as usize).div_ceil(8)
    }

    /// The lengths of `count` superblocks, the lowest bits first.
    pub(super) fn packed(&self, count: usize) -> Vec<u8> {
        let mut bytes = vec![0u8; Index::packed_bytes(count, self.width)];
        for number in 0..count {
            let bit = number * self.width as usize;
            let shifted = u64::from(self.length(number)) << (bit % 8);
            // 24 bits and a shift of 7 lie in four bytes.
            let parts = shifted.to_le_bytes();
            bytes.iter_mut().skip(bit / 8).zip(parts).for_each(|(byte, part)| *byte |= part);
        }
        bytes
    }

    /// The index of `count` superblocks from their lengths; `None` where their sum has more than 32 bits.
    pub(super) fn unpacked(width: u32, bytes: &[u8], count: usize) -> Option<Index> {
        let length = |number: usize| {
            let bit = number * width as usize;
            let parts = bytes.iter().skip(bit / 8).take(4).enumerate();
            let word = parts.fold(0u64, |word, (at, &byte)| word | u64::from(byte) << (8 * at));
            ((word >> (bit % 8)) & ((1 << width) - 1)) as u32
        };
        Index::of_width(width, count, length)
    }

    /// True where a file holds the lengths alone.
    pub(super) fn is_packed(&self) -> bool {
        self.is_packed
    }

    /// The index of `count` superblocks of such lengths, each of `width` bits; `None` where their sum has more than 32 bits.
    fn of_width(width: u32, count: usize, length: impl Fn(usize) -> u32) -> Option<Index> {
        // The last group ends with its last length.
        let (whole, rest) = (count / GROUP, count % GROUP);
        let last = if rest > 0 { 1 + (rest * width as usize).div_ceil(32) } else { 0 };
        let mut words = vec![0u32; Self::words_of(whole * GROUP, width) + last];
        let mut start = 0u32;
        for number in 0..count {
            let length = length(number);
            let group = number / GROUP * (width as usize + 1);
            if number.is_multiple_of(GROUP) {
                words[group] = start;
            }
            let bit = number % GROUP * width as usize;
            let shifted = u64::from(length) << (bit % 32);
            let parts = [shifted as u32, (shifted >> 32) as u32];
            // Lengths of no bits have no words.
            words.iter_mut().skip(group + 1 + bit / 32).zip(parts).for_each(|(word, part)| *word |= part);
            start = start.checked_add(length)?;
        }
        Some(Index { width, words, is_packed: true })
    }

    /// Bits of a length.
    pub(super) fn width(&self) -> u32 {
        self.width
    }

    /// The words.
    pub(super) fn words(&self) -> &[u32] {
        &self.words
    }

    fn length(&self, number: usize) -> u32 {
        let group = number / GROUP * (self.width as usize + 1);
        let bit = number % GROUP * self.width as usize;
        let word = |at: usize| u64::from(self.words.get(group + 1 + at).copied().unwrap_or(0));
        let pair = word(bit / 32) | word(bit / 32 + 1) << 32;
        ((pair >> (bit % 32)) & ((1 << self.width) - 1)) as u32
    }

    /// First byte of a superblock, of those of all.
    pub(super) fn start(&self, number: usize) -> u64 {
        let first = number / GROUP * GROUP;
        let start = self.words.get(number / GROUP * (self.width as usize + 1)).copied().unwrap_or(0);
        let before: u64 = (first..number).map(|number| u64::from(self.length(number))).sum();
        u64::from(start) + before
    }

    /// The bytes of a superblock, of those of all; none where they are missing.
    pub(super) fn of<'a>(&self, bytes: &'a Bytes, number: usize) -> &'a [u8] {
        let start = self.start(number);
        let end = start + u64::from(self.length(number));
        bytes.get(start as usize..end as usize).unwrap_or(&[])
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    #[test]
    fn superblocks_are_found_where_they_lie() {
        for lengths in [vec![0; 3], (0..100).map(|n| n * 37 % 90).collect::<Vec<_>>(), vec![70_000, 1]] {
            let index = Index::of_lengths(&lengths).unwrap();
            let bytes: Bytes =
                lengths.iter().enumerate().flat_map(|(n, &length)| vec![n as u8; length]).collect();
            for (number, &length) in lengths.iter().enumerate() {
                assert_eq!(index.of(&bytes, number), vec![number as u8; length]);
            }
            let packed = index.packed(lengths.len());
            assert_eq!(packed.len(), (lengths.len() * index.width() as usize).div_ceil(8));
            assert_eq!(Index::unpacked(index.width(), &packed, lengths.len()), Some(index));
        }
    }

    #[test]
    fn forged_places_are_empty() {
        let index = Index::new(9, vec![u32::MAX; 10]);
        assert!(index.of(&vec![1; 50], 31).is_empty());
        assert!(index.of(&vec![1; 50], 1000).is_empty());
    }
}
