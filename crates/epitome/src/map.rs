//! The map plane: words of the blocks, of the palettes and of the entries.
//!
//! It is the only form in which a texture holds its map: what a GPU takes is lent from it, and what a file stores is
//! unpacked from it.

use texfold_core::{Plane, WordRows, word_plane};

use crate::format::{Entry, LayerMap, MapFormat, NODES, Palettes, leaves_of, nodes_of};

/// The map plane's words.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MapPlane {
    words: Vec<u32>,
    /// Words in a row of the plane, as a power of two.
    pub(crate) row_log2: u32,
    /// Words of blocks that may be split.
    blocks: usize,
    /// First word of the 2x2 matrices, of the gain-offset pairs and of the entries.
    pub(crate) matrix_start: usize,
    pub(crate) gain_offset_start: usize,
    pub(crate) entry_start: usize,
    entries: usize,
}

impl MapPlane {
    pub(crate) fn new(format: &MapFormat, palettes: &Palettes, map: &LayerMap) -> Self {
        let mut words = Vec::new();
        words.reserve_exact(MapPlane::words_of(format, palettes, map.trees.len(), map.entries.len()));
        let mut first = 0u32;
        if format.split {
            for &tree in &map.trees {
                words.push(u32::from(tree) | first << 5);
                first += leaves_of(tree);
            }
        }
        let (blocks, matrix_start) = (words.len(), words.len());
        for matrix in &palettes.matrices {
            let half = |value: i16| u32::from(value as u16);
            words.push(half(matrix[0]) | half(matrix[1]) << 16);
            words.push(half(matrix[2]) | half(matrix[3]) << 16);
        }
        let gain_offset_start = words.len();
        for gain_offset in &palettes.gain_offsets {
            words.push(u32::from_le_bytes([gain_offset[0], gain_offset[1], gain_offset[2], 0]));
            words.push(u32::from_le_bytes([gain_offset[3], gain_offset[4], gain_offset[5], 0]));
        }
        let entry_start = words.len();
        push_entries(format, &map.entries, &mut words);
        let (words, WordRows { row_log2, .. }) = WordRows::padded(words);
        let entries = map.entries.len();
        MapPlane { words, row_log2, blocks, matrix_start, gain_offset_start, entry_start, entries }
    }

    /// Words of a plane, in whole rows.
    pub(crate) fn words_of(format: &MapFormat, palettes: &Palettes, blocks: usize, entries: usize) -> usize {
        let blocks = if format.split { blocks } else { 0 };
        let palettes = 2 * (palettes.matrices.len() + palettes.gain_offsets.len());
        let entries = (entries * format.entry_bytes() as usize).div_ceil(4) + 1;
        WordRows::of(blocks + palettes + entries).words
    }

    pub(crate) fn words(&self) -> &[u32] {
        &self.words
    }

    /// What a GPU takes.
    pub(crate) fn plane(&self) -> Plane<'_> {
        word_plane("map", &self.words, self.row_log2)
    }

    /// The trees and entries that were packed.
    pub(crate) fn unpacked(&self, format: &MapFormat) -> LayerMap {
        let trees = self.words[..self.blocks].iter().map(|word| (word & 31) as u8).collect();
        let bytes = self.plane().data;
        LayerMap { trees, entries: unpack_entries(format, &bytes[4 * self.entry_start..], self.entries) }
    }
}

/// The map of a layer that is not drawn: its trees, and those of its entries that the next finer layer has not. Most
/// leaves that stand in both have the same entry.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct CoarserMap {
    trees: Vec<u8>,
    /// For each leaf that stands in the finer map, too, whether its entry is the same.
    same: Vec<u8>,
    /// The other entries, packed as in the plane.
    entries: Vec<u8>,
    count: usize,
}

impl CoarserMap {
    /// What of `map` is not in `finer`.
    pub(crate) fn new(format: &MapFormat, map: &LayerMap, finer: &LayerMap) -> Self {
        let bytes = format.entry_bytes() as usize;
        let (mut same, mut entries) = (Vec::new(), Vec::new());
        let places = same_leaves(Some(&finer.trees), &map.trees, map.entries.len());
        for (place, entry) in places.into_iter().zip(&map.entries) {
            let is_same = place.map(|place| finer.entries.get(place) == Some(entry));
            same.extend(is_same);
            if is_same != Some(true) {
                entries.extend(pack(format, entry).into_iter().take(bytes));
            }
        }
        entries.shrink_to_fit();
        let mut same = pack_bits(same.into_iter());
        same.shrink_to_fit();
        CoarserMap { trees: map.trees.clone(), same, entries, count: map.entries.len() }
    }

    /// The whole map; `finer` is the one that it was made with.
    pub(crate) fn unpacked(&self, format: &MapFormat, finer: &LayerMap) -> LayerMap {
        let mut own = self.entries.chunks_exact(format.entry_bytes() as usize);
        let mut bit =
            (0..).map(|bit: usize| self.same.get(bit / 8).is_some_and(|byte| byte >> (bit % 8) & 1 == 1));
        let places = same_leaves(Some(&finer.trees), &self.trees, self.count);
        let entry = |place: Option<usize>| {
            let kept = place.filter(|_| bit.next() == Some(true)).and_then(|place| finer.entries.get(place));
            kept.copied().or_else(|| own.next().map(|bytes| unpack(format, bytes))).unwrap_or_default()
        };
        LayerMap { entries: places.into_iter().map(entry).collect(), trees: self.trees.clone() }
    }
}

/// Eight bits a byte, the first in bit 0.
pub(crate) fn pack_bits(bits: impl Iterator<Item = bool>) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (index, bit) in bits.enumerate() {
        if index % 8 == 0 {
            bytes.push(0);
        }
        if let Some(byte) = bytes.last_mut() {
            *byte |= u8::from(bit) << (index % 8);
        }
    }
    bytes
}

/// Fields of an entry and their bits, from the lowest on.
fn fields(format: &MapFormat) -> [u32; 5] {
    [format.x_bits, format.y_bits, format.gain_offset_bits, format.matrix_bits, u32::from(format.mixed)]
}

/// The bytes of an entry, the lowest first; those behind [`MapFormat::entry_bytes`] are 0.
fn pack(format: &MapFormat, entry: &Entry) -> [u8; 8] {
    let values = [entry.x, entry.y, entry.gain_offset, entry.matrix, entry.plane];
    let (mut packed, mut start) = (0u64, 0);
    for (value, bits) in values.into_iter().zip(fields(format)) {
        packed |= u64::from(value) << start;
        start += bits;
    }
    packed.to_le_bytes()
}

fn unpack(format: &MapFormat, bytes: &[u8]) -> Entry {
    let mut packed = bytes.iter().rev().fold(0u64, |packed, &byte| packed << 8 | u64::from(byte));
    let [x, y, gain_offset, matrix, plane] = fields(format).map(|bits| {
        let value = (packed & ((1 << bits) - 1)) as u32;
        packed >>= bits;
        value
    });
    Entry { x, y, gain_offset, matrix, plane }
}

fn unpack_entries(format: &MapFormat, bytes: &[u8], count: usize) -> Vec<Entry> {
    bytes.chunks_exact(format.entry_bytes() as usize).take(count).map(|bytes| unpack(format, bytes)).collect()
}

/// The entries in words, with a word behind the last: any entry is read from two words.
fn push_entries(format: &MapFormat, entries: &[Entry], words: &mut Vec<u32>) {
    let bytes = format.entry_bytes();
    let (mut word, mut filled) = (0u128, 0);
    for entry in entries {
        word |= u128::from(u64::from_le_bytes(pack(format, entry))) << filled;
        filled += 8 * bytes;
        while filled >= 32 {
            words.push(word as u32);
            word >>= 32;
            filled -= 32;
        }
    }
    words.push(word as u32);
    if filled > 0 {
        words.push(0);
    }
}

/// For each leaf of a map its number in the map before, where a leaf of that place and side stands there.
pub(crate) fn same_leaves(before: Option<&[u8]>, trees: &[u8], leaves: usize) -> Vec<Option<usize>> {
    let Some(before) = before else { return vec![None; leaves] };
    // Blocks that are not split have no tree bytes: leaves are blocks.
    if trees.is_empty() {
        return (0..leaves).map(Some).collect();
    }
    let mut same = Vec::new();
    let mut first = 0;
    for (&before, &tree) in before.iter().zip(trees) {
        let mut places = [None; NODES];
        for node in nodes_of(before) {
            places[node] = Some(first);
            first += 1;
        }
        same.extend(nodes_of(tree).map(|node| places[node]));
    }
    same
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_packed_is_unpacked(
            x_bits in 0u32..=16,
            y_bits in 0u32..=16,
            gain_offset_bits in 0u32..=7,
            matrix_bits in 0u32..=8,
            mixed: bool,
            split: bool,
            values: Vec<(u32, u32, u32, u32, bool)>,
        ) {
            let format = MapFormat {
                block: 32, split, x_bits, y_bits, fraction_bits: 2, gain_offset_bits, matrix_bits, mixed, seam_width: 4,
            };
            let entry = |&(x, y, gain_offset, matrix, plane): &(u32, u32, u32, u32, bool)| Entry {
                x: x & ((1 << x_bits) - 1),
                y: y & ((1 << y_bits) - 1),
                gain_offset: gain_offset & ((1 << gain_offset_bits) - 1),
                matrix: matrix & ((1 << matrix_bits) - 1),
                plane: u32::from(plane && mixed),
            };
            let trees = if split { vec![0; values.len()] } else { Vec::new() };
            let map = LayerMap { trees, entries: values.iter().map(entry).collect() };
            let palettes = Palettes { matrices: vec![[1, -2, 3, -4]], gain_offsets: vec![[9, 8, 7, 6, 5, 4]] };
            let plane = MapPlane::new(&format, &palettes, &map);
            prop_assert_eq!(plane.unpacked(&format), map.clone());
            // A finer map that has split every other block, and kept every other of the leaves that stand in both.
            let mut finer = LayerMap::default();
            for (block, &kept) in map.entries.iter().enumerate() {
                let is_split = split && block % 2 == 1;
                if split {
                    finer.trees.push(u8::from(is_split));
                }
                let other = Entry { x: kept.x ^ 1, ..kept };
                let entry = if block % 4 < 2 { kept } else { other };
                finer.entries.extend(vec![entry; if is_split { 4 } else { 1 }]);
            }
            prop_assert_eq!(CoarserMap::new(&format, &map, &finer).unpacked(&format, &finer), map.clone());
            let words = MapPlane::words_of(&format, &palettes, map.trees.len(), map.entries.len());
            prop_assert_eq!(plane.words().len(), words);
        }
    }
}
