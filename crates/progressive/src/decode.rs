//! CPU reference of `shaders/wgsl/progressive.wgsl`, function for function.
//!
//! A texel is a place of the base, blended from four texels, plus an error. Errors are stored in blocks of 8x8 texels, each
//! of four cells of 4x4. A cell's error, in luma and two axes of chroma, is the inverse of a two-level Haar transform. The map is one plane of 32-bit words: for each group of 16 blocks where their bits begin, 4 bits of class
//! and 4 bits of scale a block; then the bits of all blocks. Bits of a coefficient do not name its value alone: the last
//! [`TEXFOLD_PROGRESSIVE_STATE_BITS`] bits up to its own do, around the block, by a fixed pseudo-random table.

use glam::{IVec2, UVec2, UVec3, Vec2, Vec3, Vec4};
use texfold_core::Texel;
use texfold_core::address::{
    TEXFOLD_CLAMP, TexfoldTap, texfold_inside, texfold_level_size, texfold_lod, texfold_nearest, texfold_tap,
};
use texfold_core::sample::{texfold_bilinear, texfold_mix};

/// Bits that a coefficient's value follows from, its own among them.
pub const TEXFOLD_PROGRESSIVE_STATE_BITS: u32 = 10;
/// What a value of the table is worth at scale 1 and weight 1: 1 / (255 x the table's RMS).
pub const TEXFOLD_PROGRESSIVE_UNIT: f32 = 0.00003177627;
/// Words of a group of blocks: where its bits begin, classes, scales.
pub const TEXFOLD_PROGRESSIVE_GROUP_WORDS: u32 = 5;
/// Most levels of a texture.
pub const TEXFOLD_PROGRESSIVE_LEVELS: u32 = 16;
/// Cosine of a quarter of a quarter turn.
pub const TEXFOLD_PROGRESSIVE_COS: f32 = 0.9238795;
/// Sine of it.
pub const TEXFOLD_PROGRESSIVE_SIN: f32 = 0.38268343;
/// Cosine and sine of half a quarter turn.
pub const TEXFOLD_PROGRESSIVE_DIAGONAL: f32 = 0.70710677;

/// Size of a coefficient's step in chroma and luma: rows of an orthonormal matrix from RGB.
const SQRT_2: f32 = 0.70710677;
const SQRT_3: f32 = 0.57735026;
const SQRT_6: f32 = 0.40824828;

/// The parameters of one image, as the shader's uniform block holds them: 64 32-bit numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct TexfoldProgressiveParams {
    /// Columns and rows of level 0.
    pub size: [u32; 2],
    /// Mip levels, those among them that are not stored.
    pub levels: u32,
    /// [`texfold_core::address::TEXFOLD_REPEAT`] or `TEXFOLD_CLAMP`.
    pub address_mode: u32,
    /// Columns and rows of level 0 of the base.
    pub base_size: [u32; 2],
    /// How texels are read from the base's planes.
    pub swizzle: u32,
    /// Bits of a block of class 1; 0 where there is no error map.
    pub class_bits: u32,
    /// Binary logarithm of the words in a row of the map plane.
    pub row_log2: u32,
    /// First bit of the blocks' bits.
    pub first_bit: u32,
    /// Mip levels of the base.
    pub base_levels: u32,
    /// How entries of the map are laid out, 4 bits each: binary logarithm of a block's side, bits of a column, of a row and of a
    /// turn; 0 where there is no map.
    pub map_form: u32,
    /// For each level the number of blocks of the levels above it.
    pub level_start: [u32; 16],
    /// For each class the bits of a coefficient of each kind, 4 bits each: see [`crate::Rates`].
    pub classes: [u32; 16],
    /// Weight of each kind of coefficient.
    pub weights: [f32; 8],
    /// Columns and rows of the public and the private codebook; 0 where there is none.
    pub codebooks: [u32; 4],
    /// The least gain above none.
    pub gain_unit: f32,
    /// Binary logarithm of the words in a row of the map plane.
    pub entry_row_log2: u32,
    /// Texels of the base a side of a block, where it is not blended across blocks; else 0.
    pub base_cell: u32,
    /// Levels that are not stored: the largest one that is is enlarged for them.
    pub shrink_log2: u32,
    /// Columns and rows of the largest level that is stored.
    pub stored_size: [u32; 2],
    /// Texels of level 0 of the base beyond each border of the image.
    pub base_margin: u32,
    /// Always 0.
    pub reserved: u32,
}

/// One image: what the shader has bound.
#[derive(Debug, Clone, Copy)]
pub struct ProgressiveView<'a> {
    /// The uniform block.
    pub params: TexfoldProgressiveParams,
    /// The error map plane's words.
    pub map: &'a [u32],
    /// The map plane's words.
    pub entries: &'a [u32],
    /// Values of the public and the private codebook, row by row.
    pub codebooks: [&'a [f32]; 2],
    /// The texels of each level of the base, row by row.
    pub base: &'a [Vec<Texel>],
}

/// A block of the error map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexfoldProgressiveBlock {
    /// Its first bit in the map plane.
    pub start: u32,
    /// Its bits; 0 where there is no error.
    pub bits: u32,
    /// Bits of a coefficient of each kind, 4 bits each.
    pub rates: u32,
    /// What its coefficients are multiplied by.
    pub scale: f32,
    /// Its last [`TEXFOLD_PROGRESSIVE_STATE_BITS`] bits, which stand before its first.
    pub tail: u32,
}

/// Four texels around a place, up to a texel beyond a border, and how far the place lies from the first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexfoldProgressiveTap {
    /// Left column and upper row.
    pub low: IVec2,
    /// Right column and lower row.
    pub high: IVec2,
    /// Weight of the right column and of the lower row, 0 to 1.
    pub weight: Vec2,
}

/// Word `index` of the map.
#[must_use]
#[inline]
pub fn texfold_progressive_word(view: &ProgressiveView<'_>, index: u32) -> u32 {
    view.map.get(index as usize).copied().unwrap_or(0)
}

/// The sum of a word's eight numbers of 4 bits.
#[must_use]
#[inline]
pub fn texfold_progressive_sum(nibbles: u32) -> u32 {
    let pairs = (nibbles & 0x0f0f_0f0f) + (nibbles >> 4 & 0x0f0f_0f0f);
    pairs.wrapping_mul(0x0101_0101) >> 24
}

/// The block that holds the texel at `at` of level `level`, which lies inside.
#[must_use]
#[inline]
pub fn texfold_progressive_block(
    view: &ProgressiveView<'_>,
    at: UVec2,
    level: u32,
) -> TexfoldProgressiveBlock {
    let params = &view.params;
    let columns = texfold_level_size(UVec2::from(params.stored_size), level).x.div_ceil(8);
    let index = params.level_start[level as usize] + at.y / 8 * columns + at.x / 8;
    let group = index / 16 * TEXFOLD_PROGRESSIVE_GROUP_WORDS;
    let member = index % 16;
    let shift = 4 * (member % 8);
    let before = (1 << shift) - 1;
    let low = texfold_progressive_word(view, group + 1);
    let high = texfold_progressive_word(view, group + 2);
    let second = member >= 8;
    let own = if second { high } else { low };
    let first = if second { texfold_progressive_sum(low) } else { 0 };
    let class = own >> shift & 15;
    let sum = first + texfold_progressive_sum(own & before);
    let scales = texfold_progressive_word(view, group + 3 + member / 8);
    let scale = scales >> shift & 15;
    let odd = if scale & 1 == 1 { std::f32::consts::SQRT_2 } else { 1.0 };
    let start = params.first_bit
        + texfold_progressive_word(view, group).wrapping_mul(16).wrapping_add(sum * params.class_bits);
    let bits = class * params.class_bits;
    let tail =
        texfold_progressive_read(view, start.wrapping_add(bits).wrapping_sub(TEXFOLD_PROGRESSIVE_STATE_BITS));
    TexfoldProgressiveBlock {
        start,
        bits,
        rates: params.classes[class as usize],
        scale: (1u32 << (scale >> 1)) as f32 * odd * TEXFOLD_PROGRESSIVE_UNIT,
        tail: tail as u32 & ((1 << TEXFOLD_PROGRESSIVE_STATE_BITS) - 1),
    }
}

/// 64 bits of the map from bit `start` on, the first of them lowest.
#[must_use]
#[inline]
pub fn texfold_progressive_read(view: &ProgressiveView<'_>, start: u32) -> u64 {
    let word = |away: u32| u128::from(texfold_progressive_word(view, (start / 32).wrapping_add(away)));
    ((word(0) | word(1) << 32 | word(2) << 64) >> (start % 32)) as u64
}

/// Bits of a block up to 44 behind its bit `position`, from [`TEXFOLD_PROGRESSIVE_STATE_BITS`] before it on.
#[must_use]
#[inline]
pub fn texfold_progressive_chunk(
    view: &ProgressiveView<'_>,
    block: TexfoldProgressiveBlock,
    position: u32,
) -> u64 {
    // Bits of the tail.
    let missing = TEXFOLD_PROGRESSIVE_STATE_BITS - position.min(TEXFOLD_PROGRESSIVE_STATE_BITS);
    let start = block.start.wrapping_add(position + missing - TEXFOLD_PROGRESSIVE_STATE_BITS);
    let bits = texfold_progressive_read(view, start);
    bits << missing | u64::from(block.tail >> (TEXFOLD_PROGRESSIVE_STATE_BITS - missing))
}

/// 32 bits of a chunk from bit `start`, 0 to 31, on.
#[must_use]
#[inline]
pub fn texfold_progressive_behind(chunk: u64, start: u32) -> u32 {
    (chunk >> start) as u32
}

/// What the state that ends `end` bits behind the chunk's position is hashed to; its four bytes are added to be its value, which is
/// nearly normal, and far apart for states that differ by a bit. Where `flip` is all ones, its negative: here the complement.
#[must_use]
#[inline]
pub fn texfold_progressive_hash(chunk: u32, end: u32, flip: u32) -> u32 {
    let state = chunk >> end & ((1 << TEXFOLD_PROGRESSIVE_STATE_BITS) - 1);
    state.wrapping_mul(HASH_FACTOR).wrapping_add(HASH_OFFSET) ^ flip
}

/// A hash's bytes, added in two pairs, one in each half.
#[must_use]
#[inline]
pub fn texfold_progressive_pairs(hash: u32) -> u32 {
    (hash & 0x00ff_00ff) + (hash >> 8 & 0x00ff_00ff)
}

/// The sum of the values of `count` states from the sum of their pairs.
#[must_use]
#[inline]
pub fn texfold_progressive_value(pairs: u32, count: i32) -> f32 {
    (((pairs & 0xffff) + (pairs >> 16)) as i32 - 510 * count) as f32
}

/// The coefficient whose bits end `end` bits behind the chunk's position.
#[must_use]
#[inline]
pub fn texfold_progressive_coefficient(chunk: u32, end: u32) -> f32 {
    VALUES[(chunk >> end) as usize % STATES]
}

/// The sum of three coefficients whose bits end `ends` bits behind the chunk's position, those negated whose flip is all ones.
#[must_use]
#[inline]
pub fn texfold_progressive_three(chunk: u32, ends: UVec3, flips: UVec3) -> f32 {
    let pairs = |end: u32, flip: u32| texfold_progressive_pairs(texfold_progressive_hash(chunk, end, flip));
    let sum = pairs(ends.x, flips.x) + pairs(ends.y, flips.y) + pairs(ends.z, flips.z);
    texfold_progressive_value(sum, 3)
}

/// The error of the texel at `at` of level `level`, which lies inside: red, green, blue and 0.
#[must_use]
pub fn texfold_progressive_error(view: &ProgressiveView<'_>, at: UVec2, level: u32) -> Vec4 {
    let block = texfold_progressive_block(view, at, level);
    if block.bits == 0 {
        return Vec4::ZERO;
    }
    let cell = cell(view, block, at.x / 4 % 2 + at.y / 4 % 2 * 2);
    let quad = at.x / 2 % 2 + at.y / 2 % 2 * 2;
    let coarse = coarse(&cell, quad);
    let fine = fine(view, block, &cell, quad);
    error(coarse, &fine, at.x % 2 + at.y % 2 * 2)
}

/// Four texels of the base, of `size` texels, around the texel at `at`, inside or beyond a border, of an image of `full`, beyond whose borders
/// `margin` texels of the base lie; of those of its block alone, which has `cell` texels of the base a side, where that is not 0.
#[must_use]
#[inline]
pub fn texfold_progressive_tap(at: IVec2, full: UVec2, size: UVec2, cell: u32, margin: f32) -> TexfoldTap {
    let last = size - UVec2::ONE;
    let (mut low_end, mut high_end) = (UVec2::ZERO, last);
    if cell > 0 {
        low_end = (at.max(IVec2::ZERO).as_uvec2() / 8 * cell).min(last);
        high_end = (low_end + (cell - 1)).min(last);
    }
    let inner = size.as_vec2() - 2.0 * margin;
    let step = inner / full.as_vec2();
    let wanted = (at.as_vec2() + 0.5) * step + (margin - 0.5);
    let place = wanted.clamp(low_end.as_vec2(), high_end.as_vec2());
    let low = place.as_uvec2();
    TexfoldTap { low, high: (low + 1).min(high_end), weight: place - low.as_vec2() }
}

/// Four texels of the base around the texel at `at` of level `level` of the image, or beyond a border, blended.
#[must_use]
#[inline]
pub fn texfold_progressive_base(view: &ProgressiveView<'_>, at: IVec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.stored_size), level);
    let stored = level.min(view.params.base_levels - 1);
    let base = texfold_level_size(UVec2::from(view.params.base_size), stored);
    let tap = texfold_progressive_tap(at, size, base, view.params.base_cell, margin(&view.params, stored));
    blend(&view.base[stored as usize], base.x, tap)
}

/// Word `index` of the map.
#[must_use]
#[inline]
pub fn texfold_progressive_entry_word(view: &ProgressiveView<'_>, index: u32) -> u32 {
    view.entries.get(index as usize).copied().unwrap_or(0)
}

/// What carries places of a block to places of the codebook: the rows of a matrix, for turn `number` of `bits` bits.
#[must_use]
#[inline]
pub fn texfold_progressive_turn(number: u32, bits: u32) -> Vec4 {
    let part = (number >> 3) << (5 - bits);
    let mut turn = Vec2::new(1.0, 0.0);
    if part == 1 {
        turn = Vec2::new(TEXFOLD_PROGRESSIVE_COS, TEXFOLD_PROGRESSIVE_SIN);
    } else if part == 2 {
        turn = Vec2::new(TEXFOLD_PROGRESSIVE_DIAGONAL, TEXFOLD_PROGRESSIVE_DIAGONAL);
    } else if part == 3 {
        turn = Vec2::new(TEXFOLD_PROGRESSIVE_SIN, TEXFOLD_PROGRESSIVE_COS);
    }
    if number & 2 != 0 {
        turn = Vec2::new(-turn.y, turn.x);
    }
    if number & 4 != 0 {
        turn = -turn;
    }
    let flip = if number & 1 != 0 { -1.0 } else { 1.0 };
    Vec4::new(turn.x, -turn.y * flip, turn.y, turn.x * flip)
}

/// The codebook at (`x`, `y`) in texels, blended from four; rows behind those of the public one are the private one's.
#[must_use]
#[inline]
pub fn texfold_progressive_content(view: &ProgressiveView<'_>, place: Vec2, private: bool) -> f32 {
    let sizes = view.params.codebooks;
    let size = if private { UVec2::new(sizes[2], sizes[3]) } else { UVec2::new(sizes[0], sizes[1]) };
    let last = size.as_vec2() - Vec2::ONE;
    let at = (place - Vec2::splat(0.5)).clamp(Vec2::ZERO, last);
    let low = at.as_uvec2();
    let high = (low + UVec2::ONE).min(size - UVec2::ONE);
    let weight = at - low.as_vec2();
    let values = view.codebooks[usize::from(private)];
    let value = |x: u32, y: u32| values[(y * size.x + x) as usize];
    let upper = value(low.x, low.y) + (value(high.x, low.y) - value(low.x, low.y)) * weight.x;
    let lower = value(low.x, high.y) + (value(high.x, high.y) - value(low.x, high.y)) * weight.x;
    upper + (lower - upper) * weight.y
}

/// What the codebook adds to the texel at `at` of level `level`, which lies inside.
#[must_use]
pub fn texfold_progressive_detail(view: &ProgressiveView<'_>, at: UVec2, level: u32) -> f32 {
    let form = view.params.map_form;
    let side_log2 = form & 15;
    let (column_bits, row_bits, turn_bits) = (form >> 4 & 15, form >> 8 & 15, form >> 12 & 15);
    let side = 1 << side_log2;
    let columns = (texfold_level_size(UVec2::from(view.params.stored_size), level).x + side - 1) >> side_log2;
    let mut index = (at.y >> side_log2) * columns + (at.x >> side_log2);
    for above in 0..level.min(TEXFOLD_PROGRESSIVE_LEVELS) {
        let size = texfold_level_size(UVec2::from(view.params.stored_size), above);
        let blocks = (size + UVec2::splat(side - 1)) >> side_log2;
        index += blocks.x * blocks.y;
    }
    let bit = index * (column_bits + row_bits + turn_bits + 5);
    let low = texfold_progressive_entry_word(view, bit / 32);
    let high = texfold_progressive_entry_word(view, bit / 32 + 1);
    let entry = low >> (bit % 32) | high << 1 << (31 - bit % 32);
    let gain = entry >> (column_bits + row_bits + turn_bits) & 31;
    if gain & 15 == 0 {
        return 0.0;
    }
    let column = entry & ((1 << column_bits) - 1);
    let row = entry >> column_bits & ((1 << row_bits) - 1);
    let number = entry >> (column_bits + row_bits) & ((1 << turn_bits) - 1);
    let turn = texfold_progressive_turn(number, turn_bits);
    let away =
        UVec2::new(at.x & (side - 1), at.y & (side - 1)).as_vec2() + Vec2::splat(0.5 - 0.5 * side as f32);
    let private = row >= view.params.codebooks[1];
    let first = if private { view.params.codebooks[1] } else { 0 };
    let centre = UVec2::new(column, row - first).as_vec2();
    let moved = Vec2::new(turn.x * away.x + turn.y * away.y, turn.z * away.x + turn.w * away.y);
    let value = texfold_progressive_content(view, centre + moved, private);
    let step = (gain & 15) - 1;
    let odd = if step & 1 == 1 { std::f32::consts::SQRT_2 } else { 1.0 };
    let size = view.params.gain_unit * (1u32 << (step >> 1)) as f32 * odd;
    if gain & 16 != 0 { -size * value } else { size * value }
}

/// The texel at `at` of level `level`, which lies inside, or up to a texel beyond a border: there the base alone.
#[must_use]
pub fn texfold_progressive_load(view: &ProgressiveView<'_>, at: IVec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.stored_size), level);
    let inside = texfold_inside(at, size);
    let mut shown = texfold_progressive_base(view, at, level);
    if at != inside.as_ivec2() {
        return shown;
    }
    if view.params.map_form != 0 {
        let detail = texfold_progressive_detail(view, inside, level);
        shown = (shown + Vec4::new(detail, detail, detail, 0.0)).clamp(Vec4::ZERO, Vec4::ONE);
    }
    if view.params.class_bits == 0 {
        return shown;
    }
    (shown + texfold_progressive_error(view, inside, level)).clamp(Vec4::ZERO, Vec4::ONE)
}

/// The four texels around `uv` in a stored level of `size` texels, by address mode, and how far the place lies from the first. Those beyond a
/// border are the outermost, but where addresses are clamped and the base goes on.
#[must_use]
#[inline]
pub fn texfold_progressive_taps(
    view: &ProgressiveView<'_>,
    uv: Vec2,
    size: UVec2,
    address_mode: u32,
) -> TexfoldProgressiveTap {
    if view.params.base_margin > 0 && address_mode == TEXFOLD_CLAMP {
        let place = uv.clamp(Vec2::ZERO, Vec2::ONE) * size.as_vec2() - 0.5;
        let low = place.floor();
        let weight = place - low;
        let low = low.as_ivec2();
        return TexfoldProgressiveTap { low, high: low + 1, weight: weight.max(Vec2::ZERO) };
    }
    let tap = texfold_tap(uv, size, address_mode);
    TexfoldProgressiveTap { low: tap.low.as_ivec2(), high: tap.high.as_ivec2(), weight: tap.weight }
}

/// Bilinear filtering of stored level `stored`.
#[must_use]
pub fn texfold_progressive_filtered(
    view: &ProgressiveView<'_>,
    uv: Vec2,
    stored: u32,
    address_mode: u32,
) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.stored_size), stored);
    let tap = texfold_progressive_taps(view, uv, size, address_mode);
    let texels = [
        texfold_progressive_load(view, tap.low, stored),
        texfold_progressive_load(view, IVec2::new(tap.high.x, tap.low.y), stored),
        texfold_progressive_load(view, IVec2::new(tap.low.x, tap.high.y), stored),
        texfold_progressive_load(view, tap.high, stored),
    ];
    texfold_bilinear(texels, tap.weight)
}

/// The texel at `at` of level `level`, which lies inside: as it is stored, or between four of those.
#[must_use]
pub fn texfold_progressive_shown(view: &ProgressiveView<'_>, at: UVec2, level: u32) -> Texel {
    if level >= view.params.shrink_log2 {
        return texfold_progressive_load(view, at.as_ivec2(), level - view.params.shrink_log2);
    }
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    let uv = (at.as_vec2() + 0.5) / size.as_vec2();
    texfold_progressive_filtered(view, uv, 0, TEXFOLD_CLAMP)
}

/// The texel at (`x`, `y`) of level `level`, clamped to it.
#[must_use]
pub fn texfold_progressive_fetch(view: &ProgressiveView<'_>, at: IVec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    texfold_progressive_shown(view, texfold_inside(at, size), level)
}

/// The texel that `uv` lies in, without filtering.
#[must_use]
pub fn texfold_progressive_nearest(view: &ProgressiveView<'_>, uv: Vec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    texfold_progressive_shown(view, texfold_nearest(uv, size, view.params.address_mode), level)
}

/// Bilinear filtering within one level; where that is not stored, of the largest that is.
#[must_use]
pub fn texfold_progressive_bilinear(view: &ProgressiveView<'_>, uv: Vec2, level: u32) -> Texel {
    let shrink = view.params.shrink_log2;
    texfold_progressive_filtered(view, uv, level.max(shrink) - shrink, view.params.address_mode)
}

/// Trilinear filtering at level `lod`.
#[must_use]
pub fn texfold_progressive_sample_level(view: &ProgressiveView<'_>, uv: Vec2, lod: f32) -> Texel {
    let clamped = texfold_lod(lod, view.params.levels);
    let low = clamped.floor();
    let fine = texfold_progressive_bilinear(view, uv, low as u32);
    if clamped == low {
        return fine;
    }
    let coarse = texfold_progressive_bilinear(view, uv, low as u32 + 1);
    texfold_mix(fine, coarse, clamped - low)
}

/// Factor and offset of the table's products: the best of some 95 000 pairs by the squared error of coded random numbers.
const HASH_FACTOR: u32 = 3_365_104_771;
const HASH_OFFSET: u32 = 460_760_113;

/// Number of states.
pub(crate) const STATES: usize = 1 << TEXFOLD_PROGRESSIVE_STATE_BITS;

/// The values of all states.
pub(crate) static VALUES: [f32; STATES] = {
    let mut values = [0.0; STATES];
    let mut state = 0;
    while state < STATES {
        let hash = (state as u32).wrapping_mul(HASH_FACTOR).wrapping_add(HASH_OFFSET);
        let pairs = (hash & 0x00ff_00ff) + (hash >> 8 & 0x00ff_00ff);
        values[state] = ((pairs & 0xffff) + (pairs >> 16)) as f32 - 510.0;
        state += 1;
    }
    values
};

/// Three coefficients whose bits end `ends` bits behind the chunk's position: cells are decoded once, for all of their texels.
#[inline]
fn three(chunk: u32, ends: UVec3) -> Vec3 {
    Vec3::from_array(ends.to_array().map(|end| texfold_progressive_coefficient(chunk, end)))
}

/// Bits of a coefficient of kind `kind`.
#[inline]
fn rate(rates: u32, kind: u32) -> u32 {
    rates >> (4 * kind) & 15
}

/// The coarser coefficients of a cell, times their weights and the block's scale.
struct Cell {
    /// Mean, across, down, diagonal.
    luma: Vec4,
    /// The same for both axes of chroma.
    chroma: [Vec4; 2],
    /// Bit of the block where the cell's finer coefficients begin.
    fine: u32,
}

/// What coefficients of a kind are multiplied by: one without bits is 0.
#[inline]
fn scale(view: &ProgressiveView<'_>, block: TexfoldProgressiveBlock, kind: u32) -> f32 {
    if rate(block.rates, kind) > 0 { view.params.weights[kind as usize] * block.scale } else { 0.0 }
}

#[inline]
fn cell(view: &ProgressiveView<'_>, block: TexfoldProgressiveBlock, number: u32) -> Cell {
    let position = number * (block.bits / 4);
    let [mean, coarse, chroma, chroma_coarse] = [0, 1, 4, 5].map(|kind| rate(block.rates, kind));
    let luma_bits = mean + 3 * coarse;
    let chunk = texfold_progressive_chunk(view, block, position);
    let behind = texfold_progressive_behind(chunk, luma_bits);
    let chunk = texfold_progressive_behind(chunk, 0);
    let (first, further) = (scale(view, block, 0), scale(view, block, 1));
    let ends = UVec3::splat(mean) + UVec3::new(1, 2, 3) * coarse;
    let rest = three(chunk, ends) * further;
    let luma = Vec4::new(texfold_progressive_coefficient(chunk, mean) * first, rest.x, rest.y, rest.z);
    let mut both = [Vec4::ZERO; 2];
    if chroma + chroma_coarse > 0 {
        let (first, further) = (scale(view, block, 4), scale(view, block, 5));
        for (axis, values) in (0..).zip(&mut both) {
            let means = texfold_progressive_coefficient(behind, chroma * (axis + 1));
            let ends = UVec3::splat(2 * chroma) + UVec3::new(1, 3, 5) * chroma_coarse + axis * chroma_coarse;
            let rest = three(behind, ends) * further;
            *values = Vec4::new(means * first, rest.x, rest.y, rest.z);
        }
    }
    Cell { luma, chroma: both, fine: position + luma_bits + 2 * chroma + 6 * chroma_coarse }
}

/// Luma and both axes of chroma of a quarter of a cell, 2x2 texels.
#[inline]
fn coarse(cell: &Cell, quad: u32) -> [f32; 3] {
    let (across, down) = (sign(quad & 1), sign(quad >> 1));
    let mean = |c: Vec4| (c.x + across * c.y + down * c.z + across * down * c.w) * 0.25;
    [mean(cell.luma), mean(cell.chroma[0]), mean(cell.chroma[1])]
}

/// The finer coefficients of a quarter of a cell, of luma and of both axes of chroma: across, down, diagonal.
#[inline]
fn fine(view: &ProgressiveView<'_>, block: TexfoldProgressiveBlock, cell: &Cell, quad: u32) -> [[f32; 3]; 3] {
    let [edge, diagonal, chroma] = [2, 3, 6].map(|kind| rate(block.rates, kind));
    let luma_bits = 2 * edge + diagonal;
    let mut fine = [[0.0; 3]; 3];
    if luma_bits + chroma == 0 {
        return fine;
    }
    let chunk = texfold_progressive_chunk(view, block, cell.fine + quad * (luma_bits + 6 * chroma));
    let behind = texfold_progressive_behind(chunk, luma_bits);
    let chunk = texfold_progressive_behind(chunk, 0);
    let (edges, diagonals) = (scale(view, block, 2), scale(view, block, 3));
    fine[0] = [
        texfold_progressive_coefficient(chunk, edge) * edges,
        texfold_progressive_coefficient(chunk, 2 * edge) * edges,
        texfold_progressive_coefficient(chunk, luma_bits) * diagonals,
    ];
    if chroma > 0 {
        let scale = scale(view, block, 6);
        for (axis, values) in (1..).zip(&mut fine[1..]) {
            let ends = UVec3::new(axis, 2 + axis, 4 + axis) * chroma;
            *values = (three(behind, ends) * scale).to_array();
        }
    }
    fine
}

/// The error of one of the four texels of a quarter of a cell.
#[inline]
fn error(coarse: [f32; 3], fine: &[[f32; 3]; 3], texel: u32) -> Vec4 {
    let (across, down) = (sign(texel & 1), sign(texel >> 1));
    let sum = |axis: usize| {
        let [a, b, c] = fine[axis];
        coarse[axis] + (across * a + down * b + across * down * c) * 0.5
    };
    let gray = sum(0) * SQRT_3;
    let (warm, green) = (sum(1) * SQRT_2, sum(2) * SQRT_6);
    Vec4::new(gray + warm + green, gray - 2.0 * green, gray - warm + green, 0.0)
}

/// 1 for 0, -1 for 1.
#[inline]
fn sign(bit: u32) -> f32 {
    1.0 - 2.0 * bit as f32
}

/// Texels of level `stored` of the base beyond each border.
pub(crate) fn margin(params: &TexfoldProgressiveParams, stored: u32) -> f32 {
    params.base_margin as f32 / (1u32 << stored) as f32
}

fn blend(texels: &[Texel], width: u32, tap: TexfoldTap) -> Texel {
    let at = |x: u32, y: u32| texels[(y * width + x) as usize];
    let four = [
        at(tap.low.x, tap.low.y),
        at(tap.high.x, tap.low.y),
        at(tap.low.x, tap.high.y),
        at(tap.high.x, tap.high.y),
    ];
    texfold_bilinear(four, tap.weight)
}

/// Adds the errors of one block to `texels`, its 8x8 texels row by row, and clamps them; as [`texfold_progressive_load`] does
/// texel by texel.
pub(crate) fn add_block(
    view: &ProgressiveView<'_>,
    block: TexfoldProgressiveBlock,
    mut add: impl FnMut(u32, u32, Vec4),
) {
    for number in 0..4 {
        let cell = cell(view, block, number);
        for quad in 0..4 {
            let coarse = coarse(&cell, quad);
            let fine = fine(view, block, &cell, quad);
            let (left, top) = (number % 2 * 4 + quad % 2 * 2, number / 2 * 4 + quad / 2 * 2);
            for texel in 0..4 {
                add(left + texel % 2, top + texel / 2, error(coarse, &fine, texel));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_that_of_the_function_and_has_the_stated_rms() {
        let sum: f64 = (0..STATES).map(|state| f64::from(VALUES[state]).powi(2)).sum();
        let rms = (sum / STATES as f64).sqrt();
        assert!((1.0 / (255.0 * rms) / f64::from(TEXFOLD_PROGRESSIVE_UNIT) - 1.0).abs() < 1e-5, "{rms}");
        for state in 0..STATES {
            let pairs = texfold_progressive_pairs(texfold_progressive_hash(state as u32, 0, 0));
            assert_eq!(VALUES[state], texfold_progressive_value(pairs, 1));
        }
    }

    #[test]
    fn three_are_summed_with_their_signs() {
        for chunk in [0, 0x9e37_79b1, 0xffff_ffff, 0x0123_4567] {
            let ends = UVec3::new(3, 5, 12);
            let each = three(chunk, ends);
            for signs in 0..8u32 {
                let flips = UVec3::new(signs & 1, signs >> 1 & 1, signs >> 2);
                let signs = Vec3::ONE - 2.0 * flips.as_vec3();
                let sum = texfold_progressive_three(chunk, ends, flips * u32::MAX);
                assert_eq!(sum, each.dot(signs));
            }
        }
    }

    #[test]
    fn numbers_of_four_bits_are_summed() {
        for word in [0, 0xffff_ffff, 0x1234_5678, 0xf0f0_0001u32] {
            let slowly: u32 = (0..8).map(|place| word >> (4 * place) & 15).sum();
            assert_eq!(texfold_progressive_sum(word), slowly);
        }
    }
}
