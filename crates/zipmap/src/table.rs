//! The table that a shader reads: which patches touch each tile of the root, and a record of each patch.

use std::collections::HashMap;

use glam::{DMat3, DVec2, UVec4};
use texfold_core::ImageSize;
use texfold_core::parallel::map;

use crate::decode::TEXFOLD_ZIPMAP_RECORD;
use crate::geometry::{cut, normalised, seen_in, slope};
use crate::parts::{Parts, PatchForm};

/// Tiles for each patch: few enough to be small, many enough that a tile names few patches beyond those that a pixel
/// reads.
const TILES_PER_PATCH: f64 = 64.0;
/// Most tiles a side.
const MAX_TILES: u32 = 128;
/// Most tiles times patches, so that the longest lists fit 20 bits.
const MAX_NAMES: usize = 1 << 22;
/// By how much of a tile a patch may miss it and is yet named, against rounding.
const TILE_MARGIN: f64 = 0.01;

pub(crate) fn matrix_of(rows: &[f32; 9]) -> DMat3 {
    DMat3::from_cols_array(&rows.map(f64::from)).transpose()
}

pub(crate) fn tiles_a_side(patches: usize) -> u32 {
    let wanted = (TILES_PER_PATCH * patches as f64).sqrt().ceil() as u32;
    let most = (MAX_NAMES / patches.max(1)).isqrt() as u32;
    let power = |side: u32| 1 << side.max(1).ilog2();
    wanted.max(1).next_power_of_two().min(power(most)).min(MAX_TILES)
}

/// Bytes of a list of patches beside its names, and of its entry among those that are known.
const LIST_BYTES: u64 = 48;
/// Bytes of a patch as seen from the root: its polygon has up to nine corners.
const OUTLINE_BYTES: u64 = 512;

/// Most bytes that the tiles and lists of so many patches take, while they are made too.
pub(crate) fn most_table_bytes(patches: usize) -> u64 {
    let (tiles, patches) = (u64::from(tiles_a_side(patches)).pow(2), patches as u64);
    let table = 16 * (tiles * (patches / 8 + 3) + u64::from(TEXFOLD_ZIPMAP_RECORD) * patches);
    // The lists, two bytes a name, stand beside the table while it is made, and the table may grow to twice its length.
    2 * table + tiles * (2 * patches + 2 * LIST_BYTES) + OUTLINE_BYTES * patches
}

/// A patch as seen from the root.
struct Outline {
    /// In the root's texture coordinates.
    polygon: Vec<DVec2>,
    low: DVec2,
    high: DVec2,
    /// From texels of the root to texels of the patch.
    texels: DMat3,
}

impl Outline {
    fn of(patch: &PatchForm, ImageSize { width, height }: ImageSize, root: DVec2) -> Outline {
        let matrix = matrix_of(&patch.matrix);
        let inverse = matrix.inverse();
        let polygon = if inverse.is_finite() {
            seen_in(&normalised(inverse), DVec2::ONE, DVec2::ONE)
        } else {
            Vec::new()
        };
        let (low, high) =
            polygon.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), &point| {
                (low.min(point), high.max(point))
            });
        let own = DVec2::new(f64::from(width), f64::from(height));
        Outline {
            polygon,
            low,
            high,
            texels: DMat3::from_scale(own) * matrix * DMat3::from_scale(root.recip()),
        }
    }

    /// The square of the most texels of the patch along a texel of the root, where it shares the square from `corner`
    /// on; `None` where it shares none. Told at the corners of what is shared: a homography has its largest scale at
    /// one of them, or very near.
    fn fineness(&self, corner: DVec2, side: f64, root: DVec2) -> Option<f64> {
        if self.low.cmpgt(corner + side).any() || self.high.cmplt(corner).any() {
            return None;
        }
        let polygon: Vec<DVec2> = self.polygon.iter().map(|&point| point - corner).collect();
        let shared = cut(&polygon, DVec2::splat(side));
        let of = |point: &glam::DVec3| {
            let (across, down) = slope(&self.texels, (point.truncate() + corner) * root);
            // The larger of the two eigenvalues of the product with the transpose.
            let (trace, det) = (across.length_squared() + down.length_squared(), across.perp_dot(down));
            0.5 * (trace + (trace * trace - 4.0 * det * det).max(0.0).sqrt())
        };
        shared.iter().map(of).reduce(f64::max)
    }
}

/// For each tile how many patches touch it and where its list begins, then the lists, each once: the uppermost patch
/// first.
pub(crate) fn directory(parts: &Parts, tiles: u32) -> Vec<UVec4> {
    let size = parts.root_size();
    let root = DVec2::new(f64::from(size.width), f64::from(size.height));
    let outline = |patch: &PatchForm| Outline::of(patch, parts.images[patch.content].size, root);
    let outlines: Vec<Outline> = parts.patches.iter().map(outline).collect();
    let lists: Vec<(Vec<u16>, f32)> = map((tiles * tiles) as usize, |tile| {
        let tile = tile as u32;
        let corner = DVec2::new(f64::from(tile % tiles), f64::from(tile / tiles)) - TILE_MARGIN;
        let corner = corner / f64::from(tiles);
        let side = (1.0 + 2.0 * TILE_MARGIN) / f64::from(tiles);
        let found: Vec<(u16, f64)> = (0u16..)
            .zip(&outlines)
            .filter_map(|(index, outline)| Some((index, outline.fineness(corner, side, root)?)))
            .collect();
        let finest = found.iter().map(|(_, fineness)| *fineness).fold(1.0, f64::max);
        (found.into_iter().rev().map(|(index, _)| index).collect(), step_above(finest))
    });
    let mut known: HashMap<(&[u16], u32), u32> = HashMap::new();
    let mut texels = vec![UVec4::ZERO; lists.len().div_ceil(4)];
    for (tile, (list, finest)) in lists.iter().enumerate() {
        let start = *known.entry((list, finest.to_bits())).or_insert_with(|| {
            let start = texels.len() as u32;
            texels.extend(list_texels(list, *finest));
            start
        });
        texels[tile / 4][tile % 4] = (list.len() as u32) << 20 | start;
    }
    texels
}

/// The next of the powers of the fourth root of two, so that tiles share lists; a little less, so that pixels as large
/// as texels count as such however numbers are rounded.
fn step_above(fineness: f64) -> f32 {
    ((((4.0 * fineness.log2()) - 1e-3).ceil() / 4.0).exp2() * (1.0 - 1e-5)) as f32
}

/// How fine the patches of a list are, then their numbers, eight of 16 bits a texel.
pub(crate) fn list_texels(list: &[u16], finest: f32) -> Vec<UVec4> {
    let bits = finest.to_bits();
    let numbers: Vec<u16> =
        [bits as u16, (bits >> 16) as u16].into_iter().chain(list.iter().copied()).collect();
    let texel = |eight: &[u16]| {
        let number = |k: usize| u32::from(eight.get(k).copied().unwrap_or(0));
        UVec4::from_array([0, 2, 4, 6].map(|k| number(k) | number(k + 1) << 16))
    };
    numbers.chunks(8).map(texel).collect()
}

/// Bits of a column in the plane of all patch images; above it stands the mip level of that plane.
const COLUMN_BITS: u32 = 13;

/// A patch as the table holds it: with the origin of each level in the plane of all patch images, of so many mip levels.
pub(crate) fn record(
    matrix: &[f32; 9],
    (width, height): (u32, u32),
    (levels, content): (usize, usize),
    (origins, mips): (&[(u32, u32)], u32),
) -> [UVec4; TEXFOLD_ZIPMAP_RECORD as usize] {
    let first = origins.first().map_or(0, |&(x, y)| x | y << 16);
    let extra = [width | height << 16, first, levels as u32 | (content as u32) << 8];
    let mut texels = [UVec4::ZERO; TEXFOLD_ZIPMAP_RECORD as usize];
    for (column, texel) in texels[..3].iter_mut().enumerate() {
        let [x, y, z] = [(0, width as f32), (1, height as f32), (2, 1.0)]
            .map(|(row, scale)| (matrix[3 * row + column] * scale).to_bits());
        *texel = UVec4::new(x, y, z, extra[column]);
    }
    for (level, &(x, y)) in origins.iter().enumerate() {
        texels[3 + level / 4][level % 4] = x | (level as u32 % mips) << COLUMN_BITS | y << 16;
    }
    texels
}
