//! CPU reference of `shaders/wgsl/residual.wgsl`, function for function.
//!
//! A texel is a place of the base, blended from four base texels, plus a residual. Residuals are stored in blocks of 8x8
//! texels, each of four cells of 4x4. A cell's residual, in luma and two axes of chroma, is the inverse of a two-level
//! Haar transform. The residual plane is one plane of 32-bit words: for each group of 16 blocks where their bits begin,
//! then 4 bits of rate class and 4 bits of scale a block; then the bits of all blocks. A coefficient's own bits do not
//! name its value alone: the last [`TEXFOLD_RESIDUAL_STATE_BITS`] bits up to its own last one do, around the block, by a
//! fixed pseudo-random table.
//!
//! Cost: 12 loads of words a texel. `fast.rs` decodes whole blocks with the same arithmetic.
//!
//! Public for the tests that hold the WGSL to it and for what fills its uniform buffers: names follow the shaders and may change
//! with them.

pub(crate) mod fast;

use glam::{IVec2, UVec2, UVec3, Vec2, Vec3, Vec4};
use texfold_core::Texel;
use texfold_core::address::{TexfoldTap, texfold_inside, texfold_level_size};
use texfold_core::sample::texfold_bilinear;

/// Subbands of a block's coefficients.
pub const SUBBANDS: usize = 7;
/// Cells of a block.
pub const BLOCK_CELLS: u32 = 4;
/// Bits that a coefficient's value follows from, its own among them.
pub const TEXFOLD_RESIDUAL_STATE_BITS: u32 = 10;
/// What a value of the table is worth at scale 1 and weight 1: 1 / (255 x the table's RMS).
pub const TEXFOLD_RESIDUAL_UNIT: f32 = 0.00003177627;
/// Bits of each of the three numbers that say how luma and chroma are turned.
pub const TEXFOLD_RESIDUAL_AXES_BITS: u32 = 10;
/// Number of 1 there, the largest: the smallest rotation to given axes, the last two swapped as one likes, has no part above 1.
pub const TEXFOLD_RESIDUAL_AXES_ONE: f32 = 511.0;
/// Words of a group of blocks: where its bits begin, classes, scales.
pub const TEXFOLD_RESIDUAL_GROUP_WORDS: u32 = 5;

/// The parameters of one image, as the shader's uniform block holds them: 52 32-bit numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct TexfoldResidualParams {
    /// Columns and rows of level 0.
    pub size: [u32; 2],
    /// Columns and rows of level 0 of the base.
    pub base_size: [u32; 2],
    /// How texels are read from the base's planes.
    pub swizzle: u32,
    /// Bits of a block of class 1; 0 where there is no residual plane.
    pub class_bits: u32,
    /// Binary logarithm of the words in a row of the residual plane.
    pub row_log2: u32,
    /// First bit of the blocks' bits.
    pub first_bit: u32,
    /// Mip levels of the base.
    pub base_levels: u32,
    /// Base texels a side of a block, where the base is block-isolated (no filtering across blocks); else 0.
    pub base_block: u32,
    /// Texels of level 0 of the base beyond each border of the image.
    pub base_padding: u32,
    /// How luma and chroma are turned: see [`crate::Axes`].
    pub axes: u32,
    /// For each level the number of blocks of the finer levels.
    pub level_start: [u32; 16],
    /// For each rate class the bits of a coefficient of each subband, 4 bits each: see [`crate::Rates`].
    pub classes: [u32; 16],
    /// Weight of each subband.
    pub weights: [f32; SUBBANDS],
    /// Factor of alpha's contrast around one half: see [`texfold_residual_contrast`].
    pub alpha_gain: f32,
}

/// One image: what the shader has bound.
#[derive(Debug, Clone, Copy)]
pub struct ResidualView<'a> {
    /// The uniform block.
    pub params: &'a TexfoldResidualParams,
    /// The residual plane's words.
    pub plane: &'a [u32],
    /// The texels of each level of the base, row by row.
    pub base: &'a [Vec<Texel>],
}

/// A block of the residual plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexfoldResidualBlock {
    /// Its first bit in the residual plane.
    pub start: u32,
    /// Its bits; 0 where there is no residual.
    pub bits: u32,
    /// Bits of a coefficient of each subband, 4 bits each.
    pub rates: u32,
    /// What its coefficients are multiplied by.
    pub scale: f32,
    /// Its last [`TEXFOLD_RESIDUAL_STATE_BITS`] bits, which stand before its first.
    pub tail: u32,
}

/// Word `index` of the residual plane; out-of-range reads return a value that is never used.
#[must_use]
#[inline]
pub fn texfold_residual_word(view: &ResidualView<'_>, index: u32) -> u32 {
    view.plane.get(index as usize).copied().unwrap_or(0)
}

/// The sum of a word's eight numbers of 4 bits.
#[must_use]
#[inline]
pub fn texfold_residual_sum(nibbles: u32) -> u32 {
    let pairs = (nibbles & 0x0f0f_0f0f) + (nibbles >> 4 & 0x0f0f_0f0f);
    pairs.wrapping_mul(0x0101_0101) >> 24
}

/// The block that holds the texel at `at` of level `level`, which lies inside.
#[must_use]
#[inline]
pub fn texfold_residual_block(view: &ResidualView<'_>, at: UVec2, level: u32) -> TexfoldResidualBlock {
    let params = &view.params;
    let columns = texfold_level_size(UVec2::from(params.size), level).x.div_ceil(8);
    let index = params.level_start[level as usize] + at.y / 8 * columns + at.x / 8;
    let group = index / 16 * TEXFOLD_RESIDUAL_GROUP_WORDS;
    let member = index % 16;
    let shift = 4 * (member % 8);
    let before = (1 << shift) - 1;
    let low = texfold_residual_word(view, group + 1);
    let high = texfold_residual_word(view, group + 2);
    let second = member >= 8;
    let own = if second { high } else { low };
    let first = if second { texfold_residual_sum(low) } else { 0 };
    let class = own >> shift & 15;
    let sum = first + texfold_residual_sum(own & before);
    let scales = texfold_residual_word(view, group + 3 + member / 8);
    let scale = scales >> shift & 15;
    let odd = if scale & 1 == 1 { std::f32::consts::SQRT_2 } else { 1.0 };
    let start = params.first_bit
        + texfold_residual_word(view, group).wrapping_mul(16).wrapping_add(sum * params.class_bits);
    let bits = class * params.class_bits;
    let tail =
        texfold_residual_read(view, start.wrapping_add(bits).wrapping_sub(TEXFOLD_RESIDUAL_STATE_BITS));
    TexfoldResidualBlock {
        start,
        bits,
        rates: params.classes[class as usize],
        scale: (1u32 << (scale >> 1)) as f32 * odd * TEXFOLD_RESIDUAL_UNIT,
        tail: tail as u32 & ((1 << TEXFOLD_RESIDUAL_STATE_BITS) - 1),
    }
}

/// 64 bits of the residual plane from bit `start` on, the first of them lowest.
#[must_use]
#[inline]
pub fn texfold_residual_read(view: &ResidualView<'_>, start: u32) -> u64 {
    let word = |away: u32| u128::from(texfold_residual_word(view, (start / 32).wrapping_add(away)));
    ((word(0) | word(1) << 32 | word(2) << 64) >> (start % 32)) as u64
}

/// Bits of a block up to 44 behind its bit `position`, from [`TEXFOLD_RESIDUAL_STATE_BITS`] before it on.
#[must_use]
#[inline]
pub fn texfold_residual_chunk(view: &ResidualView<'_>, block: TexfoldResidualBlock, position: u32) -> u64 {
    // Bits of the tail.
    let missing = TEXFOLD_RESIDUAL_STATE_BITS - position.min(TEXFOLD_RESIDUAL_STATE_BITS);
    let start = block.start.wrapping_add(position + missing - TEXFOLD_RESIDUAL_STATE_BITS);
    let bits = texfold_residual_read(view, start);
    bits << missing | u64::from(block.tail >> (TEXFOLD_RESIDUAL_STATE_BITS - missing))
}

/// 32 bits of a chunk from bit `start`, 0 to 31, on.
#[must_use]
#[inline]
pub fn texfold_residual_behind(chunk: u64, start: u32) -> u32 {
    (chunk >> start) as u32
}

/// What the state that ends `end` bits behind the chunk's position is hashed to. Its four bytes are added to be its
/// value, which is nearly normal, and far apart for states that differ by a bit. Where `flip` is all ones, the value's
/// negative: here the complement.
#[must_use]
#[inline]
pub fn texfold_residual_hash(chunk: u32, end: u32, flip: u32) -> u32 {
    let state = chunk >> end & ((1 << TEXFOLD_RESIDUAL_STATE_BITS) - 1);
    state.wrapping_mul(HASH_FACTOR).wrapping_add(HASH_OFFSET) ^ flip
}

/// A hash's bytes, added in two pairs, one in each half.
#[must_use]
#[inline]
pub fn texfold_residual_pairs(hash: u32) -> u32 {
    (hash & 0x00ff_00ff) + (hash >> 8 & 0x00ff_00ff)
}

/// The sum of the values of `count` states from the sum of their pairs.
#[must_use]
#[inline]
pub fn texfold_residual_value(pairs: u32, count: i32) -> f32 {
    (((pairs & 0xffff) + (pairs >> 16)) as i32 - 510 * count) as f32
}

/// The coefficient whose bits end `end` bits behind the chunk's position.
#[must_use]
#[inline]
pub fn texfold_residual_coefficient(chunk: u32, end: u32) -> f32 {
    texfold_residual_value(texfold_residual_pairs(texfold_residual_hash(chunk, end, 0)), 1)
}

/// The sum of three coefficients whose bits end `ends` bits behind the chunk's position, those negated whose flip is all
/// ones.
#[must_use]
#[inline]
pub fn texfold_residual_three(chunk: u32, ends: UVec3, flips: UVec3) -> f32 {
    let pairs = |end: u32, flip: u32| texfold_residual_pairs(texfold_residual_hash(chunk, end, flip));
    let sum = pairs(ends.x, flips.x) + pairs(ends.y, flips.y) + pairs(ends.z, flips.z);
    texfold_residual_value(sum, 3)
}

/// The rotation that a word of [`crate::Axes`] says.
#[must_use]
#[inline]
pub fn texfold_residual_axes(word: u32) -> Vec3 {
    let part = |shift: u32| (word << shift) as i32 >> (32 - TEXFOLD_RESIDUAL_AXES_BITS);
    Vec3::new(part(22) as f32, part(12) as f32, part(2) as f32) * (1.0 / TEXFOLD_RESIDUAL_AXES_ONE)
}

/// Luma and both axes of chroma, turned by `axes`.
#[must_use]
#[inline]
pub fn texfold_residual_turned(parts: Vec3, axes: Vec3) -> Vec3 {
    let once = axes.cross(parts);
    parts + (once + axes.cross(once)) * (2.0 / (1.0 + axes.dot(axes)))
}

/// The residual of the texel at `at` of level `level`, which lies inside: red, green, blue and 0.
#[must_use]
pub fn texfold_residual_error(view: &ResidualView<'_>, at: UVec2, level: u32) -> Vec4 {
    let block = texfold_residual_block(view, at, level);
    if block.bits == 0 {
        return Vec4::ZERO;
    }
    let rates: [u32; SUBBANDS] = std::array::from_fn(|subband| block.rates >> (4 * subband) & 15);
    // A coefficient without bits is 0.
    let weight = |subband: usize| view.params.weights[subband] * block.scale;
    let scales: [f32; SUBBANDS] =
        std::array::from_fn(|subband| if rates[subband] > 0 { weight(subband) } else { 0.0 });
    let cell = (at.x >> 2 & 1) + (at.y >> 2 & 1) * 2;
    let quad = (at.x >> 1 & 1) + (at.y >> 1 & 1) * 2;

    let flips = flips_of(at >> 1);
    let cell_at = cell * (block.bits / 4);
    let luma_bits = rates[0] + 3 * rates[1];
    let coarse_chunk = texfold_residual_chunk(view, block, cell_at);
    let luma_chunk = texfold_residual_behind(coarse_chunk, 0);
    let mean = texfold_residual_coefficient(luma_chunk, rates[0]);
    let coarse_ends = rates[0] + rates[1] * UVec3::new(1, 2, 3);
    let coarse = texfold_residual_three(luma_chunk, coarse_ends, flips);
    let luma = (mean * scales[0] + coarse * scales[1]) * 0.25;

    let chroma_chunk = texfold_residual_behind(coarse_chunk, luma_bits);
    let means = Vec2::new(
        texfold_residual_coefficient(chroma_chunk, rates[4]),
        texfold_residual_coefficient(chroma_chunk, 2 * rates[4]),
    );
    let chroma_ends = 2 * rates[4] + rates[5] * UVec3::new(1, 3, 5);
    let both_coarse = Vec2::new(
        texfold_residual_three(chroma_chunk, chroma_ends, flips),
        texfold_residual_three(chroma_chunk, chroma_ends + UVec3::splat(rates[5]), flips),
    );
    let chroma = (means * scales[4] + both_coarse * scales[5]) * 0.25;

    let fine_flips = flips_of(at);
    let fine_bits = 2 * rates[2] + rates[3];
    let fine_at = cell_at + luma_bits + 2 * rates[4] + 6 * rates[5];
    let fine_chunk = texfold_residual_chunk(view, block, fine_at + quad * (fine_bits + 6 * rates[6]));
    let edge_chunk = texfold_residual_behind(fine_chunk, 0);
    let pairs = |end: u32, flip: u32| texfold_residual_pairs(texfold_residual_hash(edge_chunk, end, flip));
    let edges = pairs(rates[2], fine_flips.x) + pairs(2 * rates[2], fine_flips.y);
    let diagonal = pairs(fine_bits, fine_flips.z);
    let detail = (texfold_residual_value(edges, 2) * scales[2]
        + texfold_residual_value(diagonal, 1) * scales[3])
        * 0.5;

    let fine_chroma_chunk = texfold_residual_behind(fine_chunk, fine_bits);
    let fine_ends = rates[6] * UVec3::new(1, 3, 5);
    let both_fine = Vec2::new(
        texfold_residual_three(fine_chroma_chunk, fine_ends, fine_flips),
        texfold_residual_three(fine_chroma_chunk, fine_ends + UVec3::splat(rates[6]), fine_flips),
    );
    let colour = chroma + both_fine * (scales[6] * 0.5);
    let parts = Vec3::new(luma + detail, colour.x, colour.y);
    rgb_of(texfold_residual_turned(parts, texfold_residual_axes(view.params.axes)))
}

/// All ones for the right half, for the lower half, and where just one of both is: there horizontal, vertical and
/// diagonal coefficients count negatively.
#[inline]
fn flips_of(half: UVec2) -> UVec3 {
    let x = 0u32.wrapping_sub(half.x & 1);
    let y = 0u32.wrapping_sub(half.y & 1);
    UVec3::new(x, y, x ^ y)
}

/// Red, green, blue and 0 of luma and both axes of chroma, by an orthonormal matrix.
#[inline]
fn rgb_of(parts: Vec3) -> Vec4 {
    let gray = parts.x * INV_SQRT_3;
    let shift = Vec2::new(parts.y, parts.z) * Vec2::new(INV_SQRT_2, INV_SQRT_6);
    Vec4::new(gray + shift.x + shift.y, gray - 2.0 * shift.y, gray - shift.x + shift.y, 0.0)
}

/// Four base texels around the texel at `at`, inside or beyond a border, of an image of `full` texels. The base has
/// `size` texels, of which `padding` lie beyond each border. Where `block` is not 0, only those of the texel's own block
/// are read, which has `block` base texels a side.
#[must_use]
#[inline]
pub fn texfold_residual_tap(at: IVec2, full: UVec2, size: UVec2, block: u32, padding: f32) -> TexfoldTap {
    let last = size - UVec2::ONE;
    let (mut low_end, mut high_end) = (UVec2::ZERO, last);
    if block > 0 {
        low_end = (at.max(IVec2::ZERO).as_uvec2() / 8 * block).min(last);
        high_end = (low_end + (block - 1)).min(last);
    }
    let inner = size.as_vec2() - 2.0 * padding;
    let step = inner / full.as_vec2();
    let wanted = (at.as_vec2() + 0.5) * step + (padding - 0.5);
    let place = wanted.clamp(low_end.as_vec2(), high_end.as_vec2());
    let low = place.as_uvec2();
    TexfoldTap { low, high: (low + 1).min(high_end), weight: place - low.as_vec2() }
}

/// A texel with the contrast of its alpha raised `gain` times around one half.
#[must_use]
#[inline]
pub fn texfold_residual_contrast(texel: Texel, gain: f32) -> Texel {
    if gain > 1.0 { texel.with_w((texel.w * gain - 0.5 * (gain - 1.0)).clamp(0.0, 1.0)) } else { texel }
}

/// Four texels of the base around the texel at `at` of level `level` of the image, or beyond a border, blended.
#[must_use]
#[inline]
pub fn texfold_residual_base(view: &ResidualView<'_>, at: IVec2, level: u32) -> Texel {
    let stored = level.min(view.params.base_levels - 1);
    let size = texfold_level_size(UVec2::from(view.params.base_size), stored);
    let full = texfold_level_size(UVec2::from(view.params.size), level);
    let tap = texfold_residual_tap(at, full, size, view.params.base_block, padding_of(view.params, stored));
    let texels = &view.base[stored as usize];
    let texel = |x: u32, y: u32| texels[(y * size.x + x) as usize];
    let (low, high) = (tap.low, tap.high);
    let four = [texel(low.x, low.y), texel(high.x, low.y), texel(low.x, high.y), texel(high.x, high.y)];
    texfold_residual_contrast(texfold_bilinear(four, tap.weight), view.params.alpha_gain)
}

/// The texel at `at` of level `level`, which lies inside, or up to a texel beyond a border: there the base alone.
#[must_use]
pub fn texfold_residual_load(view: &ResidualView<'_>, at: IVec2, level: u32) -> Texel {
    let inside = texfold_inside(at, texfold_level_size(UVec2::from(view.params.size), level));
    let base = texfold_residual_base(view, at, level);
    if view.params.class_bits == 0 || at != inside.as_ivec2() {
        return base;
    }
    (base + texfold_residual_error(view, inside, level)).clamp(Vec4::ZERO, Vec4::ONE)
}

/// Texels of level `stored` of the base beyond each border.
#[inline]
pub(crate) fn padding_of(params: &TexfoldResidualParams, stored: u32) -> f32 {
    params.base_padding as f32 / (1u32 << stored) as f32
}

/// Entries of the orthonormal matrix from luma and chroma to RGB.
const INV_SQRT_2: f32 = std::f32::consts::FRAC_1_SQRT_2;
const INV_SQRT_3: f32 = 0.57735026;
const INV_SQRT_6: f32 = 0.40824828;

/// Factor and offset of the table's products: the best of some 95 000 pairs by the squared error of coded random numbers.
const HASH_FACTOR: u32 = 3_365_104_771;
const HASH_OFFSET: u32 = 460_760_113;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_four_bits_are_summed() {
        for word in [0, 0xffff_ffff, 0x1234_5678, 0xf0f0_0001u32] {
            let slowly: u32 = (0..8).map(|place| word >> (4 * place) & 15).sum();
            assert_eq!(texfold_residual_sum(word), slowly);
        }
    }

    #[test]
    fn three_are_summed_with_their_signs() {
        for chunk in [0, 0x9e37_79b1, 0xffff_ffff, 0x0123_4567] {
            let ends = UVec3::new(3, 5, 12);
            let each = ends.to_array().map(|end| texfold_residual_coefficient(chunk, end));
            for signs in 0..8u32 {
                let flips = [signs & 1, signs >> 1 & 1, signs >> 2];
                let slowly: f32 =
                    each.iter().zip(flips).map(|(value, flip)| if flip == 1 { -value } else { *value }).sum();
                let sum = texfold_residual_three(chunk, ends, UVec3::from(flips) * u32::MAX);
                assert_eq!(sum, slowly);
            }
        }
    }
}
