//! Whole regions at once: base texels row by row, residuals block by block. Every texel is equal, bit for bit, to what
//! [`texfold_residual_load`](super::texfold_residual_load) gives for it alone, as all sums are made in its order; values of the table are
//! whole numbers, whose sums are exact in any order.
//!
//! Cost: the coefficients of a cell are looked up once for its 16 texels, in a table instead of by the hash.

use glam::{UVec2, Vec2, Vec3, Vec4};
use texfold_core::address::texfold_level_size;
use texfold_core::sample::texfold_bilinear;
use texfold_core::{Rect, Texel};

use super::{BLOCK_CELLS, SUBBANDS};
use super::{
    HASH_FACTOR, HASH_OFFSET, ResidualView, TEXFOLD_RESIDUAL_STATE_BITS, TexfoldResidualBlock, padding_of,
    rgb_of, texfold_residual_axes, texfold_residual_behind, texfold_residual_block, texfold_residual_chunk,
    texfold_residual_contrast, texfold_residual_tap, texfold_residual_turned,
};
use crate::plane::BLOCK_SIDE;

/// Number of states.
pub(crate) const STATES: usize = 1 << TEXFOLD_RESIDUAL_STATE_BITS;

/// Mean of the sum of four random bytes, by which the table's values are centred.
const TABLE_MEAN: f32 = 510.0;

/// The values of all states.
pub(crate) static VALUES: [f32; STATES] = {
    let mut values = [0.0; STATES];
    let mut state = 0;
    while state < STATES {
        let hash = (state as u32).wrapping_mul(HASH_FACTOR).wrapping_add(HASH_OFFSET);
        let pairs = (hash & 0x00ff_00ff) + (hash >> 8 & 0x00ff_00ff);
        values[state] = ((pairs & 0xffff) + (pairs >> 16)) as f32 - TABLE_MEAN;
        state += 1;
    }
    values
};

/// Fills `out` with the base's part of `region`, which lies inside.
pub(crate) fn fill_base(view: &ResidualView<'_>, region: Rect, out: &mut [Texel]) {
    let params = view.params;
    let full = texfold_level_size(UVec2::from(params.size), region.level);
    let stored = region.level.min(params.base_levels - 1);
    let size = texfold_level_size(UVec2::from(params.base_size), stored);
    let texels = &view.base[stored as usize];
    let padding = padding_of(params, stored);
    let tap = |x: u32, y: u32| {
        texfold_residual_tap(UVec2::new(x, y).as_ivec2(), full, size, params.base_block, padding)
    };
    let columns: Vec<_> = (region.x..region.x + region.width).map(|x| tap(x, region.y)).collect();
    for (y, line) in (region.y..).zip(out.chunks_exact_mut(region.width as usize)) {
        let rows = tap(region.x, y);
        let row = |y: u32| &texels[(y * size.x) as usize..][..size.x as usize];
        let (upper, lower) = (row(rows.low.y), row(rows.high.y));
        for (texel, tap) in line.iter_mut().zip(&columns) {
            let (left, right) = (tap.low.x as usize, tap.high.x as usize);
            let four = [upper[left], upper[right], lower[left], lower[right]];
            let read = texfold_bilinear(four, Vec2::new(tap.weight.x, rows.weight.y));
            *texel = texfold_residual_contrast(read, params.alpha_gain);
        }
    }
}

/// Adds the residuals of all blocks that touch `region`, which lies inside, and clamps the sums. Nothing happens where
/// there is no residual plane.
pub(crate) fn add_residual(view: &ResidualView<'_>, region: Rect, out: &mut [Texel]) {
    if view.params.class_bits == 0 {
        return;
    }
    let (right, bottom) = (region.x + region.width, region.y + region.height);
    for top in (region.y / BLOCK_SIDE * BLOCK_SIDE..bottom).step_by(BLOCK_SIDE as usize) {
        for left in (region.x / BLOCK_SIDE * BLOCK_SIDE..right).step_by(BLOCK_SIDE as usize) {
            let block = texfold_residual_block(view, UVec2::new(left, top), region.level);
            let mut change = |x: u32, y: u32, residual: Vec4| {
                let (x, y) = (left + x, top + y);
                if x >= region.x && x < right && y >= region.y && y < bottom {
                    let texel = &mut out[((y - region.y) * region.width + x - region.x) as usize];
                    *texel = (*texel + residual).clamp(Vec4::ZERO, Vec4::ONE);
                }
            };
            if block.bits > 0 {
                for_each_texel(view, block, change);
            } else {
                (0..BLOCK_SIDE * BLOCK_SIDE).for_each(|n| change(n % BLOCK_SIDE, n / BLOCK_SIDE, Vec4::ZERO));
            }
        }
    }
}

/// Gives column, row and residual of each texel of a block that has bits.
fn for_each_texel(
    view: &ResidualView<'_>,
    block: TexfoldResidualBlock,
    mut give: impl FnMut(u32, u32, Vec4),
) {
    let form = Form::new(view, block);
    for number in 0..BLOCK_CELLS {
        let cell = form.cell(view, number);
        for quad in 0..4 {
            let coarse = form.coarse(&cell, quad);
            let fine = form.fine(view, &cell, quad);
            let (left, top) = (number % 2 * 4 + quad % 2 * 2, number / 2 * 4 + quad / 2 * 2);
            for texel in 0..4 {
                give(left + texel % 2, top + texel / 2, form.texel(coarse, &fine, texel));
            }
        }
    }
}

/// Horizontal, vertical and diagonal coefficient.
type Three = [f32; 3];

/// What the cells of a block share.
struct Form {
    block: TexfoldResidualBlock,
    rates: [u32; SUBBANDS],
    /// What coefficients of a subband are multiplied by: one without bits is 0.
    scales: [f32; SUBBANDS],
    axes: Vec3,
    is_turned: bool,
}

/// The coarser coefficients of a cell.
struct Cell {
    /// Means of luma and of both axes of chroma.
    means: [f32; 3],
    /// Their coarse coefficients.
    coarse: [Three; 3],
    /// Bit of the block where the cell's finer coefficients begin.
    fine: u32,
}

impl Form {
    fn new(view: &ResidualView<'_>, block: TexfoldResidualBlock) -> Self {
        let rates: [u32; SUBBANDS] = std::array::from_fn(|subband| block.rates >> (4 * subband) & 15);
        let weight = |subband: usize| view.params.weights[subband] * block.scale;
        let scales = std::array::from_fn(|subband| if rates[subband] > 0 { weight(subband) } else { 0.0 });
        let axes = texfold_residual_axes(view.params.axes);
        Form { block, rates, scales, axes, is_turned: view.params.axes != 0 }
    }

    #[inline]
    fn cell(&self, view: &ResidualView<'_>, number: u32) -> Cell {
        let [mean, coarse, _, _, chroma, chroma_coarse, _] = self.rates;
        let position = number * (self.block.bits / BLOCK_CELLS);
        let luma_bits = mean + 3 * coarse;
        let chunk = texfold_residual_chunk(view, self.block, position);
        let behind = texfold_residual_behind(chunk, luma_bits);
        let chunk = texfold_residual_behind(chunk, 0);
        let mut cell = Cell {
            means: [value(chunk, mean), 0.0, 0.0],
            coarse: [[1, 2, 3].map(|n| value(chunk, mean + n * coarse)), [0.0; 3], [0.0; 3]],
            fine: position + luma_bits + 2 * chroma + 6 * chroma_coarse,
        };
        if chroma + chroma_coarse > 0 {
            for axis in 1..3 {
                cell.means[axis as usize] = value(behind, chroma * axis);
                cell.coarse[axis as usize] =
                    [0, 2, 4].map(|n| value(behind, 2 * chroma + (n + axis) * chroma_coarse));
            }
        }
        cell
    }

    /// Luma and both axes of chroma of a quarter of a cell, 2x2 texels.
    #[inline]
    fn coarse(&self, cell: &Cell, quad: u32) -> [f32; 3] {
        const SUBBANDS_OF: [(usize, usize); 3] = [(0, 1), (4, 5), (4, 5)];
        std::array::from_fn(|axis| {
            let (mean, coarse) = SUBBANDS_OF[axis];
            let sum = signed_sum(cell.coarse[axis], quad);
            (cell.means[axis] * self.scales[mean] + sum * self.scales[coarse]) * 0.25
        })
    }

    /// The finer coefficients of a quarter of a cell, of luma and of both axes of chroma.
    #[inline]
    fn fine(&self, view: &ResidualView<'_>, cell: &Cell, quad: u32) -> [Three; 3] {
        let [_, _, edge, diagonal, _, _, chroma] = self.rates;
        let luma_bits = 2 * edge + diagonal;
        let mut fine = [[0.0; 3]; 3];
        if luma_bits + chroma == 0 {
            return fine;
        }
        let chunk = texfold_residual_chunk(view, self.block, cell.fine + quad * (luma_bits + 6 * chroma));
        let behind = texfold_residual_behind(chunk, luma_bits);
        let chunk = texfold_residual_behind(chunk, 0);
        fine[0] = [edge, 2 * edge, luma_bits].map(|end| value(chunk, end));
        if chroma > 0 {
            for (axis, values) in (1..).zip(&mut fine[1..]) {
                *values = [0, 2, 4].map(|n| value(behind, (n + axis) * chroma));
            }
        }
        fine
    }

    /// The residual of one of the four texels of a quarter of a cell.
    #[inline]
    fn texel(&self, coarse: [f32; 3], fine: &[Three; 3], texel: u32) -> Vec4 {
        let (across, down) = (sign(texel & 1), sign(texel >> 1));
        let [horizontal, vertical, diagonal] = fine[0];
        let edges = across * horizontal + down * vertical;
        let detail = (edges * self.scales[2] + across * down * diagonal * self.scales[3]) * 0.5;
        let both = Vec2::new(signed_sum(fine[1], texel), signed_sum(fine[2], texel));
        let chroma = Vec2::new(coarse[1], coarse[2]);
        let chroma = chroma + both * (self.scales[6] * 0.5);
        let parts = Vec3::new(coarse[0] + detail, chroma.x, chroma.y);
        rgb_of(if self.is_turned { texfold_residual_turned(parts, self.axes) } else { parts })
    }
}

/// The coefficient whose bits end `end` bits behind the chunk's position.
#[inline]
fn value(chunk: u32, end: u32) -> f32 {
    VALUES[(chunk >> end) as usize % STATES]
}

/// The three coefficients with the signs that they have in a quarter, summed.
#[inline]
fn signed_sum([horizontal, vertical, diagonal]: Three, quarter: u32) -> f32 {
    let (across, down) = (sign(quarter & 1), sign(quarter >> 1));
    across * horizontal + down * vertical + across * down * diagonal
}

/// 1 for 0, -1 for 1.
#[inline]
fn sign(bit: u32) -> f32 {
    1.0 - 2.0 * bit as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::{
        TEXFOLD_RESIDUAL_UNIT, texfold_residual_coefficient, texfold_residual_error, texfold_residual_load,
    };
    use crate::rates::{RATE_CLASSES, Rates};
    use crate::{Axes, RateModel, ResidualPlane};

    #[test]
    fn the_table_is_that_of_the_function_and_has_the_stated_rms() {
        let sum: f64 = VALUES.iter().map(|&value| f64::from(value).powi(2)).sum();
        let rms = (sum / STATES as f64).sqrt();
        assert!((1.0 / (255.0 * rms) / f64::from(TEXFOLD_RESIDUAL_UNIT) - 1.0).abs() < 1e-5, "{rms}");
        for state in 0..STATES as u32 {
            assert_eq!(VALUES[state as usize], texfold_residual_coefficient(state, 0));
        }
    }

    /// Rates of every kind, of classes that have the bits of their number.
    fn model() -> RateModel {
        let mut classes = [Rates::default(); RATE_CLASSES];
        for rates in [
            [4, 0, 0, 0, 0, 0, 0],
            [1, 1, 0, 0, 0, 0, 0],
            [2, 2, 1, 0, 0, 0, 0],
            [3, 1, 1, 1, 1, 0, 0],
            [3, 3, 1, 0, 1, 1, 0],
            [5, 5, 2, 1, 1, 1, 0],
            [4, 4, 0, 0, 2, 1, 1],
            [2, 2, 2, 2, 2, 2, 0],
        ] {
            let rates = Rates(rates);
            classes[(rates.bits() / 16) as usize] = rates;
        }
        RateModel {
            class_bits: 16,
            classes,
            weights: [1024, 700, 500, 300, 800, 400, 200],
            axes: Axes::nearest(Vec3::new(0.4, -0.9, 0.1)).unwrap(),
        }
    }

    #[test]
    fn blocks_decode_as_their_texels_do_one_by_one() {
        let model = model();
        let usable: Vec<u8> = (0..RATE_CLASSES as u8).filter(|&class| model.allows(class)).collect();
        assert!(usable.len() > 5, "{usable:?}");
        let mut rng = 1u32;
        let mut next = |below: u32| {
            rng = rng.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (rng >> 8) % below
        };
        let (columns, rows) = (7, 5);
        let mut plane = ResidualPlane::default();
        for _ in 0..columns * rows {
            let class = usable[next(usable.len() as u32) as usize];
            plane.classes.push(class);
            plane.scales.push(next(16) as u8);
            plane.bits.extend((0..class).map(|_| next(1 << 16) as u16));
        }
        let words = plane.words(model.class_bits).unwrap();
        let base: Vec<Texel> = (0..28 * 20).map(|_| Texel::splat(next(256) as f32 / 255.0)).collect();
        let params = super::super::TexfoldResidualParams {
            size: [53, 37],
            base_size: [28, 20],
            class_bits: model.class_bits,
            row_log2: words.row_log2,
            first_bit: words.first_bit,
            base_levels: 1,
            classes: model.classes.map(Rates::packed),
            weights: model.scales(),
            axes: model.axes.packed(),
            ..Default::default()
        };
        for base_block in [0, 4] {
            let params = super::super::TexfoldResidualParams { base_block, ..params };
            let view =
                ResidualView { params: &params, plane: &words.words, base: std::slice::from_ref(&base) };
            let region = Rect { image: 0, level: 0, x: 3, y: 2, width: 49, height: 35 };
            let mut out = vec![Texel::ZERO; 49 * 35];
            fill_base(&view, region, &mut out);
            add_residual(&view, region, &mut out);
            let mut errors = 0;
            for (index, found) in (0..).zip(out) {
                let at = UVec2::new(3 + index % 49, 2 + index / 49);
                assert_eq!(found, texfold_residual_load(&view, at.as_ivec2(), 0), "{at}");
                errors += u32::from(texfold_residual_error(&view, at, 0) != Vec4::ZERO);
            }
            assert!(errors > 500, "{errors} residuals that are not 0");
        }
    }
}
