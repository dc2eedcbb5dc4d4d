//! CPU reference of `shaders/wgsl/block_intra.wgsl`, function for function.

use glam::{BVec3, IVec4, UVec2};

use super::*;

/// The intra mode of the block that the one of that number of those that are held belongs to.
pub fn texfold_block_mode(view: &DctView<'_>, slot: u32) -> u32 {
    let [columns, rows] = view.pass.held;
    view.scratch(view.pass.notes + slot % (columns * rows) * TEXFOLD_BLOCK_NOTES) as u32 >> 8
}

/// A sample next to a block whose samples begin at `own`: of the column to its left or the row above, from 1 on; the corner is 0. `has` says
/// whether the blocks to its left, above and to the right of that are there; those that are missing are as the nearest sample.
pub fn texfold_block_beside(view: &DctView<'_>, own: u32, has: BVec3, is_left: bool, place: u32) -> i32 {
    let line = view.pass.held[0] * TEXFOLD_BLOCK_WORDS;
    let from_left = has.x && (is_left || !has.y);
    let index = select(place.max(1), 1, is_left != from_left) - 1;
    let left = own.wrapping_sub(TEXFOLD_BLOCK_WORDS) + 8 * index.min(7) + 7;
    let further = select(index.min(7), TEXFOLD_BLOCK_WORDS + index.max(8) - 8, index > 7 && has.z);
    let above = own.wrapping_sub(line) + 56 + further;
    let is_corner = place == 0 && has.x && has.y;
    view.scratch(select(select(above, left, from_left), own.wrapping_sub(line + 1), is_corner))
}

/// Shift of a direction, 0 to 6, along the side that it comes from, in 1/32 of a sample for each sample away from it.
pub fn texfold_block_angle(direction: u32) -> i32 {
    let angle = (TEXFOLD_BLOCK_ANGLES >> (8 * direction.min(6 - direction)) & 255) as i32;
    select(angle, -angle, direction > 3)
}

/// A sample of the side that a direction comes from; before its corner those of the other side.
pub fn texfold_block_known(
    view: &DctView<'_>,
    own: u32,
    has: BVec3,
    is_left: bool,
    angle: i32,
    place: i32,
) -> i32 {
    let before = (32 * -place - angle / 2) / (-angle).max(1);
    texfold_block_beside(view, own, has, is_left != (place < 0), select(place, before, place < 0) as u32)
}

/// A block's sample by an intra mode.
pub fn texfold_block_predicted(view: &DctView<'_>, own: u32, has: BVec3, mode: u32, at: UVec2) -> i32 {
    if mode == 1 {
        let (x, y) = (at.x as i32, at.y as i32);
        let beside = |is_left, place| texfold_block_beside(view, own, has, is_left, place);
        let between = |one: i32, other: i32, place: i32| {
            one.wrapping_mul(7 - place).wrapping_add(other.wrapping_mul(place + 1))
        };
        let across = between(beside(true, at.y + 1), beside(false, 9), x);
        let down = between(beside(false, at.x + 1), beside(true, 9), y);
        return across.wrapping_add(down).wrapping_add(8) >> 4;
    }
    let is_left = mode < 9;
    let angle = texfold_block_angle(select(mode.wrapping_sub(9), mode - 2, is_left));
    let along = select(at.x, at.y, is_left) as i32;
    let away = (select(at.y, at.x, is_left) + 1) as i32;
    let moved = away * angle;
    let first = along + 1 + (moved >> 5);
    let part = moved & 31;
    let one = texfold_block_known(view, own, has, is_left, angle, first);
    let next = texfold_block_known(view, own, has, is_left, angle, first + 1);
    one.wrapping_mul(32 - part).wrapping_add(next.wrapping_mul(part)).wrapping_add(16) >> 5
}

/// A row of the intra prediction of a block of a superblock: what an invocation adds to its samples.
#[derive(Debug, Clone, Copy)]
pub struct TexfoldBlockRow {
    /// Place of its samples in scratch memory.
    place: u32,
    /// Whether the block is predicted.
    is_predicted: bool,
    left: IVec4,
    right: IVec4,
}

/// A row of the block of that number, row by row of as many as a whole superblock has, of the superblock in that column and row of those
/// to decode.
pub fn texfold_block_row(
    view: &DctView<'_>,
    place: UVec2,
    axis: u32,
    block: u32,
    row: u32,
) -> TexfoldBlockRow {
    let side = view.pass.side;
    let [columns, rows] = view.pass.held;
    let superblock =
        texfold_block_wrapped(UVec2::from(view.pass.first) + place, UVec2::from(view.pass.wrap) / side);
    let blocks = texfold_block_blocks(view, superblock);
    let at = UVec2::new(block % side, block / side);
    let corner = place * side + at;
    let slot = (axis * rows + corner.y) * columns + corner.x;
    let own = view.pass.samples + slot * TEXFOLD_BLOCK_WORDS;
    let mut out =
        TexfoldBlockRow { place: own + 8 * row, is_predicted: false, left: IVec4::ZERO, right: IVec4::ZERO };
    if at.cmpge(blocks).any() {
        return out;
    }
    let mode = texfold_block_mode(view, slot);
    if mode == 0 {
        return out;
    }
    let has = BVec3::new(at.x > 0, at.y > 0, at.x + 1 < blocks.x);
    let sample = |x| texfold_block_predicted(view, own, has, mode, UVec2::new(x, row));
    out.is_predicted = true;
    out.left = IVec4::new(sample(0), sample(1), sample(2), sample(3));
    out.right = IVec4::new(sample(4), sample(5), sample(6), sample(7));
    out
}

/// Sum of a row's samples.
pub fn texfold_block_sum(row: TexfoldBlockRow) -> i32 {
    row.left.wrapping_add(row.right).to_array().into_iter().fold(0, i32::wrapping_add)
}

/// Adds a row of a prediction, less the mean of the whole one, whose sum is `sum`.
pub fn texfold_block_add(view: &mut DctView<'_>, row: TexfoldBlockRow, sum: i32) {
    if !row.is_predicted {
        return;
    }
    let mean = IVec4::splat(sum.wrapping_add(32) >> 6);
    let at = row.place as usize;
    let four = |from: usize| IVec4::from_slice(&view.scratch[from..from + 4]);
    let (left, right) = (
        four(at).wrapping_add(row.left.wrapping_sub(mean)),
        four(at + 4).wrapping_add(row.right.wrapping_sub(mean)),
    );
    texfold_block_put(view, row.place, left, right);
}
