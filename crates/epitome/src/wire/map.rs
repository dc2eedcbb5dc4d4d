//! Trees and entries of a map.

use texfold_core::container::Reader;
use texfold_core::{Budget, ImageLayout, LoadError, String4};

use super::form::Form;
use crate::format::{Entry, LayerMap, MapFormat, Palettes, blocks_of, leaves_of};
use crate::map::MapPlane;
use crate::map::same_leaves;
use crate::parts::MAX_ENTRIES;

/// `count` bits as [`crate::map::pack_bits`] packs them.
pub(super) fn read_bits(reader: &mut Reader<'_>, count: usize) -> Result<Vec<bool>, LoadError> {
    let bytes = reader.bytes(count.div_ceil(8))?;
    let bit = |index: usize| bytes[index / 8] >> (index % 8) & 1 == 1;
    if (count..8 * bytes.len()).any(bit) {
        return Err(reader.corrupt("bits after the last"));
    }
    Ok((0..count).map(bit).collect())
}

/// The entries of leaves that are `wanted`, byte plane by byte plane: equal bytes stand together, which compresses
/// better.
pub(super) fn entry_bytes(entries: &[Entry], wanted: impl Fn(usize) -> bool) -> Vec<u8> {
    let mut planes: [Vec<u8>; 7] = Default::default();
    let (mut x, mut y) = (0u32, 0u32);
    for (leaf, entry) in entries.iter().enumerate() {
        let across = (entry.x.wrapping_sub(x) as u16).to_le_bytes();
        let down = (entry.y.wrapping_sub(y) as u16).to_le_bytes();
        (x, y) = (entry.x, entry.y);
        if !wanted(leaf) {
            continue;
        }
        let bytes = [
            across[0],
            across[1],
            down[0],
            down[1],
            entry.gain_offset as u8,
            entry.matrix as u8,
            entry.plane as u8,
        ];
        for (plane, byte) in planes.iter_mut().zip(bytes) {
            plane.push(byte);
        }
    }
    planes.concat()
}

/// Checks the tree bytes against the layout; gives the number of leaves.
pub(super) fn count_leaves(
    id: [u8; 4],
    trees: &[u8],
    format: &MapFormat,
    layout: &ImageLayout,
) -> Result<u64, LoadError> {
    let reader = Reader::new(String4(id), trees);
    let blocks: u64 = layout
        .images
        .iter()
        .map(|&size| blocks_of(size, format.block))
        .map(|(columns, rows)| u64::from(columns) * u64::from(rows))
        .sum();
    let wanted = if format.split { blocks } else { 0 };
    if trees.len() as u64 != wanted {
        return Err(reader.corrupt("another number of blocks than the layout has"));
    }
    if trees.iter().any(|&tree| tree > 31 || (tree & 1 == 0 && tree != 0)) {
        return Err(reader.corrupt("a block split in a way that no writer makes"));
    }
    let split_needs = if format.split { 16 } else { 4 };
    if !format.block.is_multiple_of(split_needs) {
        return Err(reader.corrupt("blocks that cannot be split twice"));
    }
    let leaves =
        if format.split { trees.iter().map(|&tree| u64::from(leaves_of(tree))).sum() } else { blocks };
    if leaves > MAX_ENTRIES {
        Err(reader.corrupt("more leaves than an entry's number can tell"))
    } else {
        Ok(leaves)
    }
}

/// Leaves whose entries are read.
pub(super) struct Leaves<'a> {
    /// The map of the layer before, if any.
    pub(super) before: Option<&'a LayerMap>,
    pub(super) trees: &'a [u8],
    /// How many there are.
    pub(super) count: u64,
}

/// The entries of all leaves. Where there is a map before, leaves that stand in it too have a bit each, which says
/// whether the entry is the same.
pub(super) fn read_entries(
    id: [u8; 4],
    raw: &[u8],
    Leaves { before, trees, count: leaves }: Leaves<'_>,
    form: &Form,
    budget: &mut Budget,
) -> Result<Vec<Entry>, LoadError> {
    let mut reader = Reader::new(String4(id), raw);
    if before.is_none() && raw.len() as u64 != 7 * leaves {
        return Err(reader.corrupt("another number of leaves than the blocks have"));
    }
    budget.take(leaves * size_of::<(Entry, Option<usize>)>() as u64)?;
    let mut same = same_leaves(before.map(|before| before.trees.as_slice()), trees, leaves as usize);
    let bits = read_bits(&mut reader, same.iter().flatten().count())?;
    for (leaf, is_same) in same.iter_mut().filter(|leaf| leaf.is_some()).zip(bits) {
        *leaf = leaf.filter(|_| is_same);
    }
    let count = same.iter().filter(|leaf| leaf.is_none()).count();
    let planes = reader.bytes(7 * count)?;
    reader.end()?;
    let byte = |plane: usize, index: usize| u32::from(planes[plane * count + index]);
    let (mut index, mut last) = (0, Entry::default());
    let mut entries = Vec::new();
    for leaf in same {
        let old = leaf.zip(before).and_then(|(leaf, before)| before.entries.get(leaf));
        last = match old {
            Some(old) => *old,
            None => {
                let x = last.x.wrapping_add(byte(0, index) | byte(1, index) << 8) & 0xffff;
                let y = last.y.wrapping_add(byte(2, index) | byte(3, index) << 8) & 0xffff;
                let (gain_offset, matrix, plane) = (byte(4, index), byte(5, index), byte(6, index));
                index += 1;
                Entry { x, y, gain_offset, matrix, plane }
            }
        };
        if !form.holds(&last) {
            return Err(reader.corrupt("an entry outside of what its fields can hold"));
        }
        entries.push(last);
    }
    Ok(entries)
}

/// The plane of a map.
pub(super) fn laid_out(
    format: &MapFormat,
    palettes: &Palettes,
    map: &LayerMap,
    budget: &mut Budget,
) -> Result<MapPlane, LoadError> {
    budget.take(4 * MapPlane::words_of(format, palettes, map.trees.len(), map.entries.len()) as u64)?;
    Ok(MapPlane::new(format, palettes, map))
}
