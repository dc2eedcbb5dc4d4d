//! Whole regions of level 0 decoded leaf by leaf: what [`crate::decode::texfold_epitome_fetch`] finds texel by texel,
//! with what does not change within a leaf found once.

use glam::{UVec2, Vec2, Vec4};
use texfold_core::address::{TexfoldTap, texfold_level_size};
use texfold_core::sample::{TEXFOLD_NORMAL, texfold_bilinear};
use texfold_core::{Rect, Texel};

use crate::decode::{
    EpitomeView, TexfoldEpitomeLeaf, TexfoldEpitomeSource, plane_of, tap_at, texfold_epitome_leaf,
    texfold_epitome_place, texfold_epitome_plane_level, texfold_epitome_read, texfold_epitome_source,
};
use crate::format::MAX_BLOCK;

/// All leaves of an image that touch `rect` of its level 0.
pub(crate) fn leaves(view: &EpitomeView<'_>, rect: Rect) -> Vec<TexfoldEpitomeLeaf> {
    let block = view.params.block;
    let mut leaves = Vec::new();
    for y in (rect.y / block * block..rect.y + rect.height).step_by(block as usize) {
        for x in (rect.x / block * block..rect.x + rect.width).step_by(block as usize) {
            collect_leaves(view, UVec2::new(x, y), block, &mut leaves);
        }
    }
    leaves.retain(|leaf| {
        leaf.corner.x + leaf.side > rect.x
            && leaf.corner.y + leaf.side > rect.y
            && leaf.corner.x < rect.x + rect.width
            && leaf.corner.y < rect.y + rect.height
    });
    leaves
}

/// The leaves of the square at `corner`.
fn collect_leaves(view: &EpitomeView<'_>, corner: UVec2, side: u32, leaves: &mut Vec<TexfoldEpitomeLeaf>) {
    let size = UVec2::from(view.params.size);
    if corner.x >= size.x || corner.y >= size.y {
        return;
    }
    let leaf = texfold_epitome_leaf(view, corner);
    if leaf.side == side {
        leaves.push(leaf);
        return;
    }
    let half = side / 2;
    for quarter in 0..4 {
        collect_leaves(view, corner + UVec2::new(quarter % 2, quarter / 2) * half, half, leaves);
    }
}

/// The texels of a leaf that `region` of level 0 asks for, as [`texfold_epitome_fetch`] finds them one by one.
pub(crate) fn decode_leaf(view: &EpitomeView<'_>, leaf: TexfoldEpitomeLeaf, region: Rect, out: &mut [Texel]) {
    let source = texfold_epitome_source(view, leaf.entry);
    let (left, right) =
        (leaf.corner.x.max(region.x), (leaf.corner.x + leaf.side).min(region.x + region.width));
    let (top, bottom) =
        (leaf.corner.y.max(region.y), (leaf.corner.y + leaf.side).min(region.y + region.height));
    let part = Rect { x: left, y: top, width: right - left, height: bottom - top, ..region };
    let upright = source.matrix.y == 0.0 && source.matrix.z == 0.0;
    if upright && view.params.swizzle != TEXFOLD_NORMAL {
        return decode_upright(view, &source, leaf, (part, region), out);
    }
    let plane_level = texfold_epitome_plane_level(view, source.matrix, 0);
    for y in top..bottom {
        for (x, texel) in (left..right).zip(line_of(out, part, region, y)) {
            let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let place = texfold_epitome_place(&source, leaf, at, plane_level);
            let content = texfold_epitome_read(view, source.plane, place, plane_level);
            *texel = (content * source.gain + source.offset).clamp(Vec4::ZERO, Vec4::ONE);
        }
    }
}

/// Row `y` of `part` in the texels of `region`.
fn line_of(out: &mut [Texel], part: Rect, region: Rect, y: u32) -> &mut [Texel] {
    let start = (y - region.y) as usize * region.width as usize + (part.x - region.x) as usize;
    &mut out[start..start + part.width as usize]
}

/// As [`decode_leaf`] where columns of the leaf are columns of the epitome: places along one axis do not depend on
/// the other, and are found once.
fn decode_upright(
    view: &EpitomeView<'_>,
    source: &TexfoldEpitomeSource,
    leaf: TexfoldEpitomeLeaf,
    (part, region): (Rect, Rect),
    out: &mut [Texel],
) {
    let level = texfold_epitome_plane_level(view, source.matrix, 0);
    let (size, planes) = plane_of(view, source.plane);
    let size = texfold_level_size(size, level);
    let texels = &planes[level as usize];
    let tap = |x: u32, y: u32| {
        let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        tap_at(texfold_epitome_place(source, leaf, at, level), size, level)
    };
    let mut columns = [(0usize, 0usize, 0.0f32); MAX_BLOCK];
    let columns = &mut columns[..part.width as usize];
    for (x, column) in (part.x..).zip(columns.iter_mut()) {
        let tap = tap(x, part.y);
        *column = (tap.low.x as usize, tap.high.x as usize, tap.weight.x);
    }
    let whole = columns.iter().all(|&(_, _, weight)| weight == 0.0);
    let gain_offset = |content: Vec4| (content * source.gain + source.offset).clamp(Vec4::ZERO, Vec4::ONE);
    for y in part.y..part.y + part.height {
        let TexfoldTap { low, high, weight } = tap(part.x, y);
        let row = |y: u32| &texels[(y * size.x) as usize..((y + 1) * size.x) as usize];
        let (upper, lower) = (row(low.y), row(high.y));
        let line = line_of(out, part, region, y);
        if whole && weight.y == 0.0 {
            // Blending by 0 leaves a texel as it is.
            for (texel, &(low, ..)) in line.iter_mut().zip(columns.iter()) {
                *texel = gain_offset(upper[low]);
            }
            continue;
        }
        for (texel, &(low, high, across)) in line.iter_mut().zip(columns.iter()) {
            let around = [upper[low], upper[high], lower[low], lower[high]];
            *texel = gain_offset(texfold_bilinear(around, Vec2::new(across, weight.y)));
        }
    }
}
