//! Layers of a layered file: maps from coarse to fine, and which cells of the epitomes each brings.
//!
//! Every layer has a map of its own and reads cells that it or an earlier one has brought, so that the texture can be
//! drawn with the finest map that has arrived: decoders and shaders know nothing of layers.

use texfold_bc::ContentPlanes;
use texfold_core::PlaneFormat;

use crate::map::CoarserMap;

/// Most layers of a file.
pub const MAX_LAYERS: u32 = 8;

/// Texels a side of a cell.
const CELL: u32 = 4;

/// Parts of the ledger that the layers' maps and cells count for.
const NAMES: [(&str, &str); MAX_LAYERS as usize] = [
    ("map, layer 1", "epitome, layer 1"),
    ("map, layer 2", "epitome, layer 2"),
    ("map, layer 3", "epitome, layer 3"),
    ("map, layer 4", "epitome, layer 4"),
    ("map, layer 5", "epitome, layer 5"),
    ("map, layer 6", "epitome, layer 6"),
    ("map, layer 7", "epitome, layer 7"),
    ("map, layer 8", "epitome, layer 8"),
];

/// Names of the parts of layer `layer`, counted from 0.
pub(crate) fn layer_names(layer: u32) -> (&'static str, &'static str) {
    NAMES[(layer as usize).min(NAMES.len() - 1)]
}

/// Which layers of a file are there.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Layering {
    /// Layers of the whole file.
    pub(crate) total: u32,
    /// For each epitome how many rows of texels the finest layer of the file reads.
    pub(crate) rows: Vec<u32>,
    /// Maps of the layers that are there but the finest, coarse to fine, each as what differs from the next finer one.
    pub(crate) coarser: Vec<CoarserMap>,
    /// For each epitome the layer that brings each cell; cells that are not there have the next layer.
    pub(crate) cells: Vec<CellLayers>,
}

impl Layering {
    /// Layers that are there.
    pub(crate) fn loaded(&self) -> u32 {
        self.coarser.len() as u32 + 1
    }
}

/// The layer that brings each cell of an epitome, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct CellLayers {
    packed: Vec<u8>,
    /// Bits of a cell: 1, 2 or 4, so that no cell lies in two bytes.
    bits: u32,
    count: usize,
}

impl CellLayers {
    /// Of a file of `total` layers, which are counted from 0.
    pub(crate) fn new(layers: &[u8], total: u32) -> Self {
        let bits = (u32::BITS - total.saturating_sub(1).leading_zeros()).next_power_of_two();
        let pack =
            |cells: &[u8]| (0..).zip(cells).fold(0, |byte, (place, &layer)| byte | layer << (bits * place));
        CellLayers { packed: layers.chunks(8 / bits as usize).map(pack).collect(), bits, count: layers.len() }
    }

    /// The layer of each cell.
    pub(crate) fn unpacked(&self) -> Vec<u8> {
        let per_byte = 8 / self.bits;
        let mask = ((1u32 << self.bits) - 1) as u8;
        let cells = |&byte: &u8| (0..per_byte).map(move |place| byte >> (self.bits * place) & mask);
        self.packed.iter().flat_map(cells).take(self.count).collect()
    }

    /// Bytes that it holds.
    #[cfg(test)]
    pub(crate) fn held_bytes(&self) -> usize {
        self.packed.capacity()
    }
}

/// Cells in a row of an epitome.
pub(crate) fn columns_of(levels: &[ContentPlanes]) -> usize {
    levels.first().map_or(1, |base| (base.size().0 / CELL) as usize)
}

/// For each cell of mip level `level` the first layer that needs a cell of the full size under it.
pub(crate) fn layers_at(cells: &[u8], columns: usize, level: u32) -> Vec<u8> {
    let (across, rows) = (columns >> level, (cells.len() / columns.max(1)) >> level);
    let mut layers = vec![u8::MAX; across * rows];
    for (row, line) in cells.chunks_exact(columns.max(1)).enumerate() {
        for (column, &layer) in line.iter().enumerate() {
            if let Some(least) = layers.get_mut((row >> level) * across + (column >> level)) {
                *least = layer.min(*least);
            }
        }
    }
    layers
}

/// Numbers of the cells whose layer is wanted.
pub(crate) fn numbers(layers: &[u8], wanted: impl Fn(u8) -> bool) -> Vec<usize> {
    layers.iter().enumerate().filter(|(_, layer)| wanted(**layer)).map(|(number, _)| number).collect()
}

/// Bytes of a plane that hold one row of cell `number`'s blocks each: 1 for block formats, 4 for plain texels.
fn runs(format: PlaneFormat, width: u32, number: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
    let per_cell = (CELL / format.block_side()) as usize;
    let run = per_cell * format.block_bytes() as usize;
    let columns = (width / CELL).max(1) as usize;
    let (column, row) = (number % columns, number / columns);
    (0..per_cell).map(move |line| {
        let start = ((row * per_cell + line) * columns + column) * run;
        start..start + run
    })
}

/// Bytes of a cell in a plane of `format`.
pub(crate) fn cell_bytes(format: PlaneFormat) -> usize {
    (format.bytes(CELL, CELL)) as usize
}

/// Bytes of the cells `numbers` of each plane, one plane after the other.
pub(crate) fn gather(planes: &ContentPlanes, numbers: &[usize], out: &mut Vec<u8>) {
    for (format, bytes) in planes.planes() {
        for run in numbers.iter().flat_map(|&number| runs(*format, planes.size().0, number)) {
            out.extend(bytes.get(run).unwrap_or_default());
        }
    }
}

/// The same planes with the cells `numbers` as `edit` leaves each run of them; it is told where the run starts among
/// all bytes of these cells, one plane after the other.
pub(crate) fn edited(
    planes: &ContentPlanes,
    numbers: &[usize],
    mut edit: impl FnMut(&mut [u8], usize),
) -> ContentPlanes {
    let mut at = 0;
    let mut edited = planes.clone();
    edited.edit(|format, width, bytes| {
        for run in numbers.iter().flat_map(|&number| runs(format, width, number)) {
            let start = at;
            at += run.len();
            if let Some(place) = bytes.get_mut(run) {
                edit(place, start);
            }
        }
    });
    edited
}

#[cfg(feature = "encode")]
#[cfg(test)]
mod tests {
    use std::sync::OnceLock;

    use super::*;
    use crate::map::{MapPlane, same_leaves};
    use crate::parts::Parts;
    use crate::{Epitome, EpitomeParams, EpitomeSource, EpitomeTexture};
    use texfold_core::image::ImageSet;
    use texfold_core::metric::decode_image;
    use texfold_core::{Effort, Encoded, Encoder, Goal, Job};

    /// A texture in layers, made once.
    fn texture() -> &'static EpitomeTexture {
        static TEXTURE: OnceLock<EpitomeTexture> = OnceLock::new();
        TEXTURE.get_or_init(make)
    }

    fn make() -> EpitomeTexture {
        let set = ImageSet::single(texfold_testkit::image("facade"));
        let params = EpitomeParams {
            goal: Goal::Psnr(30.0),
            effort: Effort::Fast,
            mips: true,
            layers: 3,
            ..EpitomeParams::default()
        };
        Epitome::encode(EpitomeSource::new(&set), &params, &mut Job::default()).unwrap()
    }

    #[test]
    fn a_layer_reads_only_what_it_and_those_before_have_brought() {
        let texture = texture();
        for layer in 0..2 {
            // The same map over all cells, and over those that are there then.
            let of = &texture.parts;
            let map = MapPlane::new(&of.format, &of.palettes, &of.map_of(layer));
            let all = Parts { map, layering: None, ..of.clone() };
            let all = EpitomeTexture::new(all, texture.notes.clone());
            let first = texture.first_layers(layer + 1);
            // Content narrower than a texel of a coarse level is blended with what lies beside it; levels 0 to 2 have
            // none.
            for level in 0..3 {
                let (all, first) = (decode_image(&all, 0, level), decode_image(&first, 0, level));
                assert!(all == first, "layer {layer}, level {level}");
            }
        }
    }

    #[test]
    fn the_finest_map_reads_only_the_rows_that_are_drawn() {
        let texture = texture();
        let all =
            EpitomeTexture::new(Parts { layering: None, ..texture.parts.clone() }, texture.notes.clone());
        let rows = |texture: &EpitomeTexture| -> u32 {
            (0..texture.parts.epitomes.len()).map(|epitome| texture.parts.drawn_size(epitome).1).sum()
        };
        assert!(rows(texture) <= rows(&all));
        for level in 0..texture.layout().levels {
            assert!(decode_image(&all, 0, level) == decode_image(texture, 0, level), "level {level}");
        }
    }

    #[test]
    fn layers_of_cells_are_packed_and_read_again() {
        for (total, bytes) in [(2, 5), (3, 10), (4, 10), (5, 19), (8, 19)] {
            let layers: Vec<u8> = (0..37).map(|cell| cell * 5 % total as u8).collect();
            let packed = CellLayers::new(&layers, total);
            assert_eq!(packed.unpacked(), layers, "{total}");
            assert_eq!(packed.held_bytes(), bytes, "{total}");
        }
    }

    #[test]
    fn coarse_cells_come_with_the_first_cell_under_them() {
        // Four columns and two rows: the left half has one cell of layer 0, the right one of layer 1.
        let cells = [2, 0, 2, 2, 2, 2, 1, 2];
        assert_eq!(layers_at(&cells, 4, 0), cells);
        assert_eq!(layers_at(&cells, 4, 1), [0, 1]);
    }

    #[test]
    fn leaves_are_found_again_by_place_and_side() {
        // A whole block and one of quarters, the second of which is split.
        let before = [0, 1 | 2 << 1];
        // The first is split; of the second all quarters are whole.
        let after = [1, 1];
        let same = same_leaves(Some(&before), &after, 8);
        assert_eq!(same, [None, None, None, None, Some(1), None, Some(6), Some(7)]);
        assert_eq!(same_leaves(None, &after, 8), [None; 8]);
        assert_eq!(same_leaves(Some(&[]), &[], 2), [Some(0), Some(1)]);
    }

    #[test]
    fn cells_are_gathered_and_put_back() {
        let texture = texture();
        for levels in &texture.parts.epitomes {
            let planes = &levels[1];
            let count = (planes.size().0 / CELL * planes.size().1 / CELL) as usize;
            let numbers: Vec<usize> = (0..count).step_by(3).collect();
            let mut bytes = Vec::new();
            gather(planes, &numbers, &mut bytes);
            let blank = edited(planes, &numbers, |place, _| place.fill(0));
            assert!(blank != *planes);
            let back = edited(&blank, &numbers, |place, start| {
                place.copy_from_slice(&bytes[start..start + place.len()]);
            });
            assert!(back == *planes);
        }
    }
}
