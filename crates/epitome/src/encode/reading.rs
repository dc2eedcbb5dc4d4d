//! A leaf's content as the decoder reads it: from which texels, with which weights, out of which cells.

use glam::{Vec2, Vec4};
use texfold_match::Field;

use super::gain_offset::{self, Stats};
use super::leaf::Node;
use super::pyramid::CellRows;
use super::relative;
use crate::decode::{
    TexfoldEpitomeLeaf, TexfoldEpitomeSource, texfold_epitome_matrix, texfold_epitome_place,
};
use crate::format::{GainOffset, Matrix};

/// Fractions of a texel that positions are stored in, as a binary logarithm.
pub(crate) const FRACTION_BITS: u32 = 2;

/// Texels a side of a leaf that are looked at where places are compared.
const SAMPLED_SIDE: u32 = 16;

/// Columns of an upright leaf that are looked at in one go.
const COLUMNS: usize = 64;

/// A leaf read from a field exactly as the decoder reads it from an epitome.
pub(crate) struct Reading {
    source: TexfoldEpitomeSource,
    leaf: TexfoldEpitomeLeaf,
    node: Node,
}

impl Reading {
    pub(crate) fn new(node: Node, x: i32, y: i32, matrix: Matrix) -> Self {
        let word = |a: i16, b: i16| u32::from(a as u16) | u32::from(b as u16) << 16;
        let scale = 1.0 / (1 << FRACTION_BITS) as f32;
        let source = TexfoldEpitomeSource {
            position: Vec2::new(x as f32 * scale, y as f32 * scale),
            matrix: texfold_epitome_matrix(word(matrix[0], matrix[1]), word(matrix[2], matrix[3])),
            gain: Vec4::ONE,
            offset: Vec4::ZERO,
            plane: 0,
        };
        let leaf = TexfoldEpitomeLeaf { corner: node.corner, side: node.side, entry: 0 };
        Reading { source, leaf, node }
    }

    /// Upper left of the four texels around the content of the leaf's texel (`x`, `y`), and the others' weights.
    #[inline]
    fn tap(&self, x: u32, y: u32) -> (i32, i32, Vec2) {
        let corner = self.leaf.corner;
        let at = Vec2::new((corner.x + x) as f32 + 0.5, (corner.y + y) as f32 + 0.5);
        let place = texfold_epitome_place(&self.source, self.leaf, at, 0) - Vec2::splat(0.5);
        // Without a call of the C library, which rounding down is where processors of all ages must run it.
        let down = |value: f32| {
            let towards_zero = value as i32;
            towards_zero - i32::from(value < towards_zero as f32)
        };
        let (x, y) = (down(place.x), down(place.y));
        (x, y, place - Vec2::new(x as f32, y as f32))
    }

    /// First and last column and row of the texels that are read; `None` where some lie outside of `field`.
    pub(crate) fn bounds(&self, field: &Field) -> Option<(i32, i32, i32, i32)> {
        let (right, bottom) = (self.node.inside.x - 1, self.node.inside.y - 1);
        let (mut low, mut high) = ((i32::MAX, i32::MAX), (i32::MIN, i32::MIN));
        for (x, y) in [(0, 0), (right, 0), (0, bottom), (right, bottom)] {
            let (left, top, weight) = self.tap(x, y);
            low = (low.0.min(left), low.1.min(top));
            high.0 = high.0.max(left + i32::from(weight.x > 0.0));
            high.1 = high.1.max(top + i32::from(weight.y > 0.0));
        }
        let inside = low.0 >= 0 && low.1 >= 0 && high.0 < field.width as i32 && high.1 < field.height as i32;
        inside.then_some((low.0, low.1, high.0, high.1))
    }

    /// Content of the leaf's texels inside the image, row by row; the bounds must have been checked.
    pub(crate) fn read(&self, field: &Field, each: impl FnMut(usize, Vec4)) {
        self.read_some(field, 1, each);
    }

    /// As [`Reading::read`], of every `step`th texel of every `step`th row.
    #[inline]
    fn read_some(&self, field: &Field, step: u32, mut each: impl FnMut(usize, Vec4)) {
        let columns = self.node.inside.x;
        if self.is_upright() && columns.div_ceil(step) as usize <= COLUMNS {
            return self.read_upright(field, step, each);
        }
        for y in (0..self.node.inside.y).step_by(step as usize) {
            for x in (0..columns).step_by(step as usize) {
                let (left, top, weight) = self.tap(x, y);
                let start = top as usize * field.width + left as usize;
                // Weights of 0 need no texel beyond the field.
                let right = usize::from(weight.x > 0.0);
                let below = if weight.y > 0.0 { field.width } else { 0 };
                let texels = &field.texels;
                let upper = texels[start] + (texels[start + right] - texels[start]) * weight.x;
                let lower = texels[start + below]
                    + (texels[start + below + right] - texels[start + below]) * weight.x;
                each((y * columns + x) as usize, upper + (lower - upper) * weight.y);
            }
        }
    }

    /// Whether columns of the leaf lie in columns of the field.
    fn is_upright(&self) -> bool {
        self.source.matrix.y == 0.0 && self.source.matrix.z == 0.0
    }

    /// As [`Reading::read_some`], where all rows of the leaf lie in the same columns of the field: most leaves do.
    #[inline]
    fn read_upright(&self, field: &Field, step: u32, mut each: impl FnMut(usize, Vec4)) {
        let columns = self.node.inside.x;
        let mut taps = [(0usize, 0usize, 0.0f32); COLUMNS];
        let count = columns.div_ceil(step) as usize;
        for (tap, x) in taps.iter_mut().zip((0..columns).step_by(step as usize)) {
            let (left, _, weight) = self.tap(x, 0);
            *tap = (left as usize, left as usize + usize::from(weight.x > 0.0), weight.x);
        }
        let row = |y: usize| &field.texels[y * field.width..(y + 1) * field.width];
        for y in (0..self.node.inside.y).step_by(step as usize) {
            let (_, top, weight) = self.tap(0, y);
            let upper = row(top as usize);
            let lower = row(top as usize + usize::from(weight.y > 0.0));
            for (&(left, right, across), x) in taps[..count].iter().zip((0..columns).step_by(step as usize)) {
                let above = upper[left] + (upper[right] - upper[left]) * across;
                let below = lower[left] + (lower[right] - lower[left]) * across;
                each((y * columns + x) as usize, above + (below - above) * weight.y);
            }
        }
    }

    /// For each texel of the leaf the four texels that it is blended from, in a field of `width` columns, and their
    /// shares; the bounds must have been checked.
    pub(crate) fn taps(&self, width: usize, mut each: impl FnMut(usize, [usize; 4], [f32; 4])) {
        let columns = self.node.inside.x;
        for y in 0..self.node.inside.y {
            for x in 0..columns {
                let (left, top, weight) = self.tap(x, y);
                let start = top as usize * width + left as usize;
                // Weights of 0 need no texel beyond the field.
                let right = usize::from(weight.x > 0.0);
                let below = if weight.y > 0.0 { width } else { 0 };
                let rest = Vec2::ONE - weight;
                let shares = [rest.x * rest.y, weight.x * rest.y, rest.x * weight.y, weight.x * weight.y];
                let at = [start, start + right, start + below, start + below + right];
                each((y * columns + x) as usize, at, shares);
            }
        }
    }

    /// Sums from which the error under any gain-offset pair follows.
    pub(crate) fn stats(&self, field: &Field, target: &[Vec4]) -> Option<Stats> {
        self.bounds(field)?;
        let mut stats = Stats::around(target);
        self.read(field, |index, value| stats.add(value, target[index]));
        Some(stats)
    }

    /// As [`Reading::stats`], of so many of a large leaf's texels as a small one has: enough to compare places with.
    pub(crate) fn sampled_stats(&self, field: &Field, target: &[Vec4]) -> Option<Stats> {
        self.bounds(field)?;
        let step = (self.node.side / SAMPLED_SIDE).max(1);
        let count = self.node.inside.x.div_ceil(step) * self.node.inside.y.div_ceil(step);
        let mut stats = Stats::around(target).of_some(count);
        self.read_some(field, step, |index, value| stats.add(value, target[index]));
        Some(stats)
    }

    /// RMS error in 8-bit units of the worst 4x4 block under a gain-offset pair, of output rounded to 8 bits.
    pub(crate) fn worst_block(&self, field: &Field, target: &[Vec4], gain_offset: &GainOffset) -> f32 {
        if self.bounds(field).is_none() {
            return f32::INFINITY;
        }
        let columns = self.node.inside.x as usize;
        let (across, down) = (columns.div_ceil(4), self.node.inside.y.div_ceil(4) as usize);
        let mut blocks = vec![(0.0f32, 0u32); across * down];
        let (gain, offset) = gain_offset::values(gain_offset);
        self.read(field, |index, content| {
            let decoded = (content * gain + offset).clamp(Vec4::ZERO, Vec4::splat(255.0));
            let step = (decoded + 0.5).floor() - (target[index] + 0.5).floor();
            let block = &mut blocks[index / columns / 4 * across + index % columns / 4];
            block.0 += step.length_squared();
            block.1 += 1;
        });
        // Opaque alpha has no error and is not counted.
        let channels = if target.iter().all(|texel| texel.w >= 255.0) { 3.0 } else { 4.0 };
        blocks.iter().map(|&(sum, count)| sum / (channels * count as f32)).fold(0.0, f32::max).sqrt()
    }

    /// Relative error ([`relative::error`]) under a gain-offset pair, of output rounded to 8 bits.
    pub(crate) fn relative_error(&self, field: &Field, target: &[Vec4], gain_offset: &GainOffset) -> f32 {
        if self.bounds(field).is_none() {
            return f32::INFINITY;
        }
        let (gain, offset) = gain_offset::values(gain_offset);
        let mut decoded = vec![Vec4::ZERO; target.len()];
        self.read(field, |index, content| {
            decoded[index] = (content * gain + offset).clamp(Vec4::ZERO, Vec4::splat(255.0));
        });
        relative::error(target, &decoded)
    }

    /// Cells that hold the texels that are read, ascending, numbered as `rows` says.
    pub(crate) fn cells(&self, field: &Field, rows: CellRows, out: &mut Vec<u32>) {
        let Some((left, top, right, bottom)) = self.bounds(field) else { return };
        let cell = |at: i32| at as u32 / rows.side;
        let (first, last) = ((cell(left), cell(top)), (cell(right), cell(bottom)));
        let matrix = self.source.matrix;
        if (matrix.y == 0.0 && matrix.z == 0.0) || (matrix.x == 0.0 && matrix.w == 0.0) {
            for y in first.1..=last.1 {
                out.extend((first.0..=last.0).map(|x| rows.number(x, y)));
            }
            return;
        }
        let width = (last.0 - first.0 + 1) as usize;
        let mut used = vec![false; width * (last.1 - first.1 + 1) as usize];
        for y in 0..self.node.inside.y {
            for x in 0..self.node.inside.x {
                let (left, top, weight) = self.tap(x, y);
                let (right, bottom) = (left + i32::from(weight.x > 0.0), top + i32::from(weight.y > 0.0));
                for (x, y) in [(left, top), (right, top), (left, bottom), (right, bottom)] {
                    used[(cell(y) - first.1) as usize * width + (cell(x) - first.0) as usize] = true;
                }
            }
        }
        for (index, _) in used.iter().enumerate().filter(|(_, used)| **used) {
            let (x, y) = (first.0 + (index % width) as u32, first.1 + (index / width) as u32);
            out.push(rows.number(x, y));
        }
    }
}
