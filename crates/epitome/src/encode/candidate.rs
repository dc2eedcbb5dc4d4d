//! What a leaf could be: content somewhere, laid and given gain and offset in some way, with its error and the cells
//! it needs.

use glam::{Mat2, Vec2, Vec4};
use texfold_match::Field;

use super::leaf::Node;
use super::pyramid::{LEAST_SIDE, SCALES, Space};
use super::reading::{FRACTION_BITS, Reading};
use crate::ToleranceKind;
use crate::format::{GainOffset, LINEAR_ONE, Matrix, NEUTRAL};

/// One way to draw a leaf.
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
    pub(crate) matrix: u16,
    pub(crate) gain_offset: u16,
    pub(crate) scale: u8,
    pub(crate) format: u8,
}

#[cfg(test)]
impl Candidate {
    /// One of that error and those cells, for tests of what is chosen.
    pub(crate) fn of_cells(error: f32, cells: (u32, u32)) -> Self {
        Candidate { error, cells, x: 0, y: 0, image: 0, matrix: 0, gain_offset: 0, scale: 0, format: 0 }
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
    pub(crate) matrix: Mat2,
    /// Squared error of luma left by the search; only to compare matches with.
    pub(crate) error: f32,
}

/// Whether a 2x2 matrix draws content as it stands or mirrored, not rotated or sheared. Refinement never leaves it
/// so, unless positions alone are refined.
pub(crate) fn is_upright(matrix: Mat2) -> bool {
    matrix.x_axis.y == 0.0 && matrix.y_axis.x == 0.0
}

/// Matches nearer than this in texels, and in each number of their 2x2 matrices, are alike.
const ALIKE: (f32, f32) = (0.25, 0.02);

impl Match {
    /// Whether both say the same.
    pub(crate) fn is_like(&self, other: &Match) -> bool {
        let matrix = Vec4::from_array((self.matrix - other.matrix).to_cols_array());
        (self.image, self.scale) == (other.image, other.scale)
            && self.position.distance(other.position) < ALIKE.0
            && matrix.abs().max_element() < ALIKE.1
    }
}

/// Largest stored number of a 2x2 matrix: what can be negated.
const LINEAR_MOST: f32 = i16::MAX as f32;

/// The 2x2 matrix of content at a scale, upright.
pub(crate) fn scale_linear(scale: usize) -> Matrix {
    let scale = SCALES[scale];
    [LINEAR_ONE >> scale.across, 0, 0, LINEAR_ONE >> scale.down]
}

/// The stored numbers nearest to a 2x2 matrix.
pub(crate) fn quantise(matrix: Mat2) -> Matrix {
    let number = |value: f32| (value * f32::from(LINEAR_ONE)).round().clamp(-LINEAR_MOST, LINEAR_MOST) as i16;
    [matrix.x_axis.x, matrix.y_axis.x, matrix.x_axis.y, matrix.y_axis.y].map(number)
}

/// The 2x2 matrix of stored numbers.
pub(crate) fn matrix(matrix: Matrix) -> Mat2 {
    let value = |index: usize| f32::from(matrix[index]) / f32::from(LINEAR_ONE);
    Mat2::from_cols(Vec2::new(value(0), value(2)), Vec2::new(value(1), value(3)))
}

/// What is left of a leaf's error beyond that of its own content, once the content elsewhere is fitted to its
/// readers. With one other reader it is a half at most, but then the other has as much; 0.85 made three photographs
/// 0.3 to 1.6 % smaller, 0.7 and 0.55 were no better than 1.
const NEARER: f32 = 0.85;

/// Which candidates may be taken.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Rules<'a> {
    /// Cells that content may come from, of all formats; all of them where there is no restriction.
    pub(crate) cells: Option<&'a [bool]>,
    /// Most error that a block may have.
    pub(crate) tolerance: Option<f32>,
    /// The error that it bounds.
    pub(crate) kind: ToleranceKind,
    /// Whether content will be fitted to all who read it.
    pub(crate) refits: bool,
    /// Whether content of a fraction of its size is left out.
    pub(crate) full_size: bool,
}

impl Rules<'_> {
    /// Whether content may come from all of `cells`.
    pub(crate) fn allow(&self, cells: &[u32]) -> bool {
        self.cells.is_none_or(|allowed| cells.iter().all(|&cell| allowed[cell as usize]))
    }

    /// The error that a leaf with content elsewhere will have, from its `error` now and that of its own content:
    /// fitted content comes nearer to it.
    pub(crate) fn hoped(&self, error: f32, own: f32) -> f32 {
        if self.refits && error > own { own + NEARER * (error - own) } else { error }
    }

    /// Whether a reading of `field` under `gain_offset` keeps every block within the tolerance.
    pub(crate) fn accept(
        &self,
        reading: &Reading,
        field: &Field,
        target: &[Vec4],
        gain_offset: &GainOffset,
    ) -> bool {
        self.tolerance.is_none_or(|most| match self.kind {
            ToleranceKind::Absolute => reading.worst_block(field, target, gain_offset) <= most,
            ToleranceKind::Relative => reading.relative_error(field, target, gain_offset) <= most,
        })
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
    let scales = if rules.full_size { 1 } else { space.scales() };
    for scale in 0..scales {
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
                matrix: scale as u16,
                gain_offset: 0,
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
