//! What a leaf could be: content somewhere, laid and toned in some way, with its error and the cells it needs.

use glam::{Mat2, Vec2, Vec4};
use texfold_match::Field;

use super::leaf::Node;
use super::pyramid::{CellRows, LEAST_SIDE, SCALES, Space};
use super::tone::Stats;
use crate::decode::{
    TexfoldEpitomeLeaf, TexfoldEpitomeSource, texfold_epitome_linear, texfold_epitome_place,
};
use crate::encoded::{Linear, NEUTRAL, Tone};

/// Fractions of a texel that positions are stored in, as a binary logarithm.
pub(crate) const FRACTION_BITS: u32 = 2;

/// Texels a side of a leaf that are looked at where places are compared.
const SAMPLED_SIDE: u32 = 16;

/// Columns of an upright leaf that are looked at in one go.
const COLUMNS: usize = 64;

/// One way to show a leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Candidate {
    /// Squared error over all channels, 8-bit units.
    pub(crate) error: f32,
    /// Where its cells stand in the list of all.
    pub(crate) cells: (u32, u32),
    /// Column and row of the leaf's centre in its field, in fractions of a texel.
    pub(crate) x: i32,
    pub(crate) y: i32,
    /// Number of the image that the content is from.
    pub(crate) image: u16,
    pub(crate) linear: u16,
    pub(crate) tone: u16,
    pub(crate) scale: u8,
    pub(crate) format: u8,
}

#[cfg(test)]
impl Candidate {
    /// One of that error and those cells, for tests of what is chosen.
    pub(crate) fn of_cells(error: f32, cells: (u32, u32)) -> Self {
        Candidate { error, cells, x: 0, y: 0, image: 0, linear: 0, tone: 0, scale: 0, format: 0 }
    }
}

/// Where a leaf's content lies in a field, before the format is chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Match {
    pub(crate) image: u16,
    pub(crate) scale: u8,
    /// Place of the leaf's centre in texels of the field.
    pub(crate) position: Vec2,
    /// From texels of the leaf to texels of the field.
    pub(crate) linear: Mat2,
    /// Squared error of luma left by the search; only to compare matches with.
    pub(crate) error: f32,
}

/// Whether a linear part shows content as it stands or mirrored, not turned or sheared. Refinement never leaves it so, unless
/// positions alone are refined.
pub(crate) fn is_upright(linear: Mat2) -> bool {
    linear.x_axis.y == 0.0 && linear.y_axis.x == 0.0
}

/// Matches nearer than this in texels, and in each number of their linear parts, are alike.
const ALIKE: (f32, f32) = (0.25, 0.02);

impl Match {
    /// Whether both say the same.
    pub(crate) fn is_like(&self, other: &Match) -> bool {
        let linear = Vec4::from_array((self.linear - other.linear).to_cols_array());
        (self.image, self.scale) == (other.image, other.scale)
            && self.position.distance(other.position) < ALIKE.0
            && linear.abs().max_element() < ALIKE.1
    }
}

/// The linear part of content at a scale, upright.
pub(crate) fn scale_linear(scale: usize) -> Linear {
    let scale = SCALES[scale];
    [8192 >> scale.across, 0, 0, 8192 >> scale.down]
}

/// The stored numbers nearest to a linear part.
pub(crate) fn quantise(linear: Mat2) -> Linear {
    let number = |value: f32| (value * 8192.0).round().clamp(-32767.0, 32767.0) as i16;
    [linear.x_axis.x, linear.y_axis.x, linear.x_axis.y, linear.y_axis.y].map(number)
}

/// The linear part of stored numbers.
pub(crate) fn matrix(linear: Linear) -> Mat2 {
    let value = |index: usize| f32::from(linear[index]) / 8192.0;
    Mat2::from_cols(Vec2::new(value(0), value(2)), Vec2::new(value(1), value(3)))
}

/// A leaf read from a field exactly as the decoder reads it from an epitome.
pub(crate) struct Reading {
    source: TexfoldEpitomeSource,
    leaf: TexfoldEpitomeLeaf,
    node: Node,
}

impl Reading {
    pub(crate) fn new(node: Node, x: i32, y: i32, linear: Linear) -> Self {
        let word = |a: i16, b: i16| u32::from(a as u16) | u32::from(b as u16) << 16;
        let scale = 1.0 / (1 << FRACTION_BITS) as f32;
        let source = TexfoldEpitomeSource {
            position: Vec2::new(x as f32 * scale, y as f32 * scale),
            linear: texfold_epitome_linear(word(linear[0], linear[1]), word(linear[2], linear[3])),
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
        self.source.linear.y == 0.0 && self.source.linear.z == 0.0
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

    /// For each texel of the leaf the four texels that it is blended from, in a field of `width` columns, and their shares;
    /// the bounds must have been checked.
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

    /// Sums from which the error under any tone follows.
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

    /// RMS error in 8-bit units of the worst 4x4 block under a tone, of output rounded to 8 bits.
    pub(crate) fn worst_block(&self, field: &Field, target: &[Vec4], tone: &Tone) -> f32 {
        if self.bounds(field).is_none() {
            return f32::INFINITY;
        }
        let columns = self.node.inside.x as usize;
        let (across, down) = (columns.div_ceil(4), self.node.inside.y.div_ceil(4) as usize);
        let mut blocks = vec![(0.0f32, 0u32); across * down];
        let (gain, offset) = super::tone::values(tone);
        self.read(field, |index, content| {
            let shown = (content * gain + offset).clamp(Vec4::ZERO, Vec4::splat(255.0));
            let step = (shown + 0.5).floor() - (target[index] + 0.5).floor();
            let block = &mut blocks[index / columns / 4 * across + index % columns / 4];
            block.0 += step.length_squared();
            block.1 += 1;
        });
        // Opaque alpha has no error and is not counted.
        let channels = if target.iter().all(|texel| texel.w >= 255.0) { 3.0 } else { 4.0 };
        blocks.iter().map(|&(sum, count)| sum / (channels * count as f32)).fold(0.0, f32::max).sqrt()
    }

    /// Cells that hold the texels that are read, ascending, numbered as `rows` says.
    pub(crate) fn cells(&self, field: &Field, rows: CellRows, out: &mut Vec<u32>) {
        let Some((left, top, right, bottom)) = self.bounds(field) else { return };
        let cell = |at: i32| at as u32 / rows.side;
        let (first, last) = ((cell(left), cell(top)), (cell(right), cell(bottom)));
        let linear = self.source.linear;
        if (linear.y == 0.0 && linear.z == 0.0) || (linear.x == 0.0 && linear.w == 0.0) {
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

/// What is left of a leaf's error beyond that of its own content, once the content elsewhere is fitted to its readers. With
/// one other reader it is a half at most, but then the other has as much; 0.85 made three photographs 0.3 to 1.6 % smaller,
/// 0.7 and 0.55 were no better than 1.
const NEARER: f32 = 0.85;

/// Which candidates may be taken.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Rules<'a> {
    /// Cells that content may come from, of all formats; all of them where there is no restriction.
    pub(crate) cells: Option<&'a [bool]>,
    /// RMS error that every 4x4 block may have at most, 8-bit units.
    pub(crate) tolerance: Option<f32>,
    /// Whether content will be fitted to all who read it.
    pub(crate) refits: bool,
}

impl Rules<'_> {
    /// Whether content may come from all of `cells`.
    pub(crate) fn allow(&self, cells: &[u32]) -> bool {
        self.cells.is_none_or(|allowed| cells.iter().all(|&cell| allowed[cell as usize]))
    }

    /// The error that a leaf with content elsewhere will have, from its `error` now and that of its own content: fitted content
    /// comes nearer to it.
    pub(crate) fn hoped(&self, error: f32, own: f32) -> f32 {
        if self.refits && error > own { own + NEARER * (error - own) } else { error }
    }

    /// Whether a reading of `field` under `tone` keeps every block within the tolerance.
    pub(crate) fn accept(&self, reading: &Reading, field: &Field, target: &[Vec4], tone: &Tone) -> bool {
        self.tolerance.is_none_or(|most| reading.worst_block(field, target, tone) <= most)
    }
}

/// Least error of content from the leaf's own place at each scale; infinite where a scale is too small for the leaf.
pub(crate) type ScaleErrors = [f32; SCALES.len()];

/// Content from the leaf's own place in the image, at each scale and in each format, that no other such content beats
/// in both error and bits. Cells are appended to `cells`.
pub(crate) fn direct(
    space: &Space,
    node: Node,
    rules: &Rules<'_>,
    cells: &mut Vec<u32>,
) -> (Vec<Candidate>, ScaleErrors) {
    let mut errors = [f32::INFINITY; SCALES.len()];
    let target = node.texels(space);
    let centre = node.corner.as_vec2() + node.side as f32 * 0.5;
    let mut found: Vec<(f32, Candidate, Vec<u32>)> = Vec::new();
    for scale in 0..space.scales() {
        let reduced = SCALES[scale];
        if node.side >> reduced.across.max(reduced.down) < LEAST_SIDE {
            continue;
        }
        let unit = (1 << FRACTION_BITS) as f32;
        let x = (centre.x * unit / (1 << reduced.across) as f32) as i32;
        let y = (centre.y * unit / (1 << reduced.down) as f32) as i32;
        let reading = Reading::new(node, x, y, scale_linear(scale));
        for (format, stored) in space.stored.iter().enumerate() {
            let field = &stored.decoded[node.image][scale];
            let Some(stats) = reading.stats(field, &target) else { continue };
            let mut own = Vec::new();
            reading.cells(field, space.rows_of(format, node.image, scale), &mut own);
            if !rules.allow(&own) || !rules.accept(&reading, field, &target, &NEUTRAL) {
                continue;
            }
            let error = stats.plain_error();
            errors[scale] = errors[scale].min(error);
            let candidate = Candidate {
                error,
                cells: (0, 0),
                x,
                y,
                image: node.image as u16,
                linear: scale as u16,
                tone: 0,
                scale: scale as u8,
                format: format as u8,
            };
            let bits = own.iter().map(|&cell| space.bits_of(format, cell)).sum();
            found.push((bits, candidate, own));
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.error.total_cmp(&b.1.error)));
    let mut least = f32::INFINITY;
    found.retain(|(_, candidate, _)| {
        let better = candidate.error < least;
        least = least.min(candidate.error);
        better
    });
    let take = |(_, mut candidate, own): (f32, Candidate, Vec<u32>)| {
        candidate.cells = (cells.len() as u32, (cells.len() + own.len()) as u32);
        cells.extend(own);
        candidate
    };
    (found.into_iter().map(take).collect(), errors)
}
