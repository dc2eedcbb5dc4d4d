//! The map plane: words of the blocks, of the palettes and of the entries.
//!
//! It is the only form in which a texture holds its map: what a GPU takes is lent from it, and what a file stores is
//! unpacked from it.

use texfold_core::{Plane, WordRows, word_plane};

use crate::format::{Entry, LayerMap, MapFormat, Palettes, leaves_of};

/// The map plane's words.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MapPlane {
    words: Vec<u32>,
    /// Words in a row of the plane, as a power of two.
    pub(crate) row_log2: u32,
    /// Words of blocks that may be split.
    blocks: usize,
    /// First word of the 2x2 matrices, of the gain-offset pairs and of the entries.
    pub(crate) linear_start: usize,
    pub(crate) tone_start: usize,
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
        let (blocks, linear_start) = (words.len(), words.len());
        for linear in &palettes.linears {
            let half = |value: i16| u32::from(value as u16);
            words.push(half(linear[0]) | half(linear[1]) << 16);
            words.push(half(linear[2]) | half(linear[3]) << 16);
        }
        let tone_start = words.len();
        for tone in &palettes.tones {
            words.push(u32::from_le_bytes([tone[0], tone[1], tone[2], 0]));
            words.push(u32::from_le_bytes([tone[3], tone[4], tone[5], 0]));
        }
        let entry_start = words.len();
        push_entries(format, &map.entries, &mut words);
        let (words, WordRows { row_log2, .. }) = WordRows::padded(words);
        let entries = map.entries.len();
        MapPlane { words, row_log2, blocks, linear_start, tone_start, entry_start, entries }
    }

    /// Words of a plane, in whole rows.
    pub(crate) fn words_of(format: &MapFormat, palettes: &Palettes, blocks: usize, entries: usize) -> usize {
        let blocks = if format.split { blocks } else { 0 };
        let palettes = 2 * (palettes.linears.len() + palettes.tones.len());
        let entries = (entries * format.entry_bytes() as usize).div_ceil(4) + 1;
        WordRows::of(blocks + palettes + entries).words
    }

    pub(crate) fn words(&self) -> &[u32] {
        &self.words
    }

    /// Bytes that it holds.
    #[cfg(test)]
    pub(crate) fn held_bytes(&self) -> usize {
        4 * self.words.capacity()
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

/// Trees and entries of a layer that is not drawn, packed as in the plane.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PackedMap {
    trees: Vec<u8>,
    entries: Vec<u8>,
    count: usize,
}

impl PackedMap {
    pub(crate) fn new(format: &MapFormat, map: &LayerMap) -> Self {
        let bytes = format.entry_bytes() as usize;
        let mut entries: Vec<u8> =
            map.entries.iter().flat_map(|entry| pack(format, entry).into_iter().take(bytes)).collect();
        entries.shrink_to_fit();
        PackedMap { trees: map.trees.clone(), entries, count: map.entries.len() }
    }

    /// Bytes that it holds.
    #[cfg(test)]
    pub(crate) fn held_bytes(&self) -> usize {
        self.trees.capacity() + self.entries.capacity()
    }

    pub(crate) fn unpacked(&self, format: &MapFormat) -> LayerMap {
        LayerMap { trees: self.trees.clone(), entries: unpack_entries(format, &self.entries, self.count) }
    }
}

/// Fields of an entry and their bits, from the lowest on.
fn fields(format: &MapFormat) -> [u32; 5] {
    [format.x_bits, format.y_bits, format.tone_bits, format.linear_bits, u32::from(format.mixed)]
}

/// The bytes of an entry, the lowest first; those behind [`MapFormat::entry_bytes`] are 0.
fn pack(format: &MapFormat, entry: &Entry) -> [u8; 8] {
    let values = [entry.x, entry.y, entry.tone, entry.linear, entry.plane];
    let (mut packed, mut start) = (0u64, 0);
    for (value, bits) in values.into_iter().zip(fields(format)) {
        packed |= u64::from(value) << start;
        start += bits;
    }
    packed.to_le_bytes()
}

fn unpack(format: &MapFormat, bytes: &[u8]) -> Entry {
    let mut packed = bytes.iter().rev().fold(0u64, |packed, &byte| packed << 8 | u64::from(byte));
    let [x, y, tone, linear, plane] = fields(format).map(|bits| {
        let value = (packed & ((1 << bits) - 1)) as u32;
        packed >>= bits;
        value
    });
    Entry { x, y, tone, linear, plane }
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_packed_is_unpacked(
            x_bits in 0u32..=16,
            y_bits in 0u32..=16,
            tone_bits in 0u32..=7,
            linear_bits in 0u32..=8,
            mixed: bool,
            split: bool,
            values: Vec<(u32, u32, u32, u32, bool)>,
        ) {
            let format = MapFormat {
                block: 32, split, x_bits, y_bits, fraction_bits: 2, tone_bits, linear_bits, mixed, strip: 4,
            };
            let entry = |&(x, y, tone, linear, plane): &(u32, u32, u32, u32, bool)| Entry {
                x: x & ((1 << x_bits) - 1),
                y: y & ((1 << y_bits) - 1),
                tone: tone & ((1 << tone_bits) - 1),
                linear: linear & ((1 << linear_bits) - 1),
                plane: u32::from(plane && mixed),
            };
            let trees = if split { vec![0; values.len()] } else { Vec::new() };
            let map = LayerMap { trees, entries: values.iter().map(entry).collect() };
            let palettes = Palettes { linears: vec![[1, -2, 3, -4]], tones: vec![[9, 8, 7, 6, 5, 4]] };
            let plane = MapPlane::new(&format, &palettes, &map);
            prop_assert_eq!(plane.unpacked(&format), map.clone());
            prop_assert_eq!(PackedMap::new(&format, &map).unpacked(&format), map.clone());
            let words = MapPlane::words_of(&format, &palettes, map.trees.len(), map.entries.len());
            prop_assert_eq!(plane.words().len(), words);
        }
    }
}
