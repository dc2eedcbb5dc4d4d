//! CPU reference of `shaders/wgsl/progressive.wgsl`, function for function.
//!
//! A texel is one of residual content (see `texfold_residual::decode`), to whose base detail from codebooks is added
//! before the residual. Where the finest levels are not stored it is filtered from the finest stored one.
//!
//! Public for the tests that hold the WGSL to it and for what fills its uniform buffers: names follow the shaders and may change
//! with them.

use glam::{IVec2, UVec2, Vec2, Vec4};
use texfold_core::Texel;
use texfold_core::address::{
    TEXFOLD_CLAMP, texfold_inside, texfold_level_size, texfold_lod, texfold_nearest, texfold_tap,
};
use texfold_core::sample::{texfold_bilinear, texfold_mix};
use texfold_residual::decode::{ResidualView, texfold_residual_base, texfold_residual_error};

/// Most levels of a texture.
pub const TEXFOLD_PROGRESSIVE_LEVELS: u32 = 16;
/// Cosine of a quarter of a quarter turn.
pub const TEXFOLD_PROGRESSIVE_COS: f32 = 0.9238795;
/// Sine of it.
pub const TEXFOLD_PROGRESSIVE_SIN: f32 = 0.38268343;
/// Cosine and sine of half a quarter turn.
pub const TEXFOLD_PROGRESSIVE_DIAGONAL: f32 = 0.70710677;

/// The parameters of one image, as the shader's uniform block holds them, before those of its residual content: 12
/// 32-bit numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct TexfoldProgressiveParams {
    /// Columns and rows of level 0.
    pub size: [u32; 2],
    /// Mip levels, those among them that are not stored.
    pub levels: u32,
    /// [`texfold_core::address::TEXFOLD_REPEAT`] or `TEXFOLD_CLAMP`.
    pub address_mode: u32,
    /// Number of finest mip levels not stored; they are upsampled from the finest stored one.
    pub shrink_log2: u32,
    /// How entries of the map are laid out, 4 bits each: binary logarithm of a block's side, bits of a column, of a row
    /// and of a rotation; 0 where there is no map.
    pub map_form: u32,
    /// The least gain above none.
    pub gain_unit: f32,
    /// Binary logarithm of the words in a row of the map plane.
    pub entry_row_log2: u32,
    /// Columns and rows of the public and the private codebook; 0 where there is none.
    pub codebooks: [u32; 4],
}

/// One image: what the shader has bound.
#[derive(Debug, Clone, Copy)]
pub struct ProgressiveView<'a> {
    /// The uniform block.
    pub params: TexfoldProgressiveParams,
    /// Base and residual plane.
    pub residual: ResidualView<'a>,
    /// The map plane's words.
    pub entries: &'a [u32],
    /// Values of the public and the private codebook, row by row.
    pub codebooks: [&'a [f32]; 2],
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

/// Word `index` of the map; out-of-range reads return a value that is never used.
#[must_use]
#[inline]
pub fn texfold_progressive_entry_word(view: &ProgressiveView<'_>, index: u32) -> u32 {
    view.entries.get(index as usize).copied().unwrap_or(0)
}

/// What carries places of a block to places of the codebook: the rows of a matrix, for rotation `number` of `bits` bits.
#[must_use]
#[inline]
pub fn texfold_progressive_rotation(number: u32, bits: u32) -> Vec4 {
    let part = (number >> 3) << (5 - bits);
    let mut rotation = Vec2::new(1.0, 0.0);
    if part == 1 {
        rotation = Vec2::new(TEXFOLD_PROGRESSIVE_COS, TEXFOLD_PROGRESSIVE_SIN);
    } else if part == 2 {
        rotation = Vec2::new(TEXFOLD_PROGRESSIVE_DIAGONAL, TEXFOLD_PROGRESSIVE_DIAGONAL);
    } else if part == 3 {
        rotation = Vec2::new(TEXFOLD_PROGRESSIVE_SIN, TEXFOLD_PROGRESSIVE_COS);
    }
    if number & 2 != 0 {
        rotation = Vec2::new(-rotation.y, rotation.x);
    }
    if number & 4 != 0 {
        rotation = -rotation;
    }
    let flip = if number & 1 != 0 { -1.0 } else { 1.0 };
    Vec4::new(rotation.x, -rotation.y * flip, rotation.y, rotation.x * flip)
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
    let (column_bits, row_bits, rotation_bits) = (form >> 4 & 15, form >> 8 & 15, form >> 12 & 15);
    let side = 1 << side_log2;
    let columns =
        (texfold_level_size(UVec2::from(view.residual.params.size), level).x + side - 1) >> side_log2;
    let mut index = (at.y >> side_log2) * columns + (at.x >> side_log2);
    for above in 0..level.min(TEXFOLD_PROGRESSIVE_LEVELS) {
        let size = texfold_level_size(UVec2::from(view.residual.params.size), above);
        let blocks = (size + UVec2::splat(side - 1)) >> side_log2;
        index += blocks.x * blocks.y;
    }
    let bit = index * (column_bits + row_bits + rotation_bits + 5);
    let low = texfold_progressive_entry_word(view, bit / 32);
    let high = texfold_progressive_entry_word(view, bit / 32 + 1);
    let entry = low >> (bit % 32) | high << 1 << (31 - bit % 32);
    let gain = entry >> (column_bits + row_bits + rotation_bits) & 31;
    if gain & 15 == 0 {
        return 0.0;
    }
    let column = entry & ((1 << column_bits) - 1);
    let row = entry >> column_bits & ((1 << row_bits) - 1);
    let number = entry >> (column_bits + row_bits) & ((1 << rotation_bits) - 1);
    let rotation = texfold_progressive_rotation(number, rotation_bits);
    let away =
        UVec2::new(at.x & (side - 1), at.y & (side - 1)).as_vec2() + Vec2::splat(0.5 - 0.5 * side as f32);
    let private = row >= view.params.codebooks[1];
    let first = if private { view.params.codebooks[1] } else { 0 };
    let centre = UVec2::new(column, row - first).as_vec2();
    let moved =
        Vec2::new(rotation.x * away.x + rotation.y * away.y, rotation.z * away.x + rotation.w * away.y);
    let value = texfold_progressive_content(view, centre + moved, private);
    let step = (gain & 15) - 1;
    let odd = if step & 1 == 1 { std::f32::consts::SQRT_2 } else { 1.0 };
    let size = view.params.gain_unit * (1u32 << (step >> 1)) as f32 * odd;
    if gain & 16 != 0 { -size * value } else { size * value }
}

/// The texel at `at` of level `level`, which lies inside, or up to a texel beyond a border: there the base alone.
#[must_use]
pub fn texfold_progressive_load(view: &ProgressiveView<'_>, at: IVec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.residual.params.size), level);
    let inside = texfold_inside(at, size);
    let mut texel = texfold_residual_base(&view.residual, at, level);
    if at != inside.as_ivec2() {
        return texel;
    }
    if view.params.map_form != 0 {
        let detail = texfold_progressive_detail(view, inside, level);
        texel = (texel + Vec4::new(detail, detail, detail, 0.0)).clamp(Vec4::ZERO, Vec4::ONE);
    }
    if view.residual.params.class_bits == 0 {
        return texel;
    }
    (texel + texfold_residual_error(&view.residual, inside, level)).clamp(Vec4::ZERO, Vec4::ONE)
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
    if view.residual.params.base_padding > 0 && address_mode == TEXFOLD_CLAMP {
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
    let size = texfold_level_size(UVec2::from(view.residual.params.size), stored);
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
pub fn texfold_progressive_texel(view: &ProgressiveView<'_>, at: UVec2, level: u32) -> Texel {
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
    texfold_progressive_texel(view, texfold_inside(at, size), level)
}

/// The texel that `uv` lies in, without filtering.
#[must_use]
pub fn texfold_progressive_nearest(view: &ProgressiveView<'_>, uv: Vec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    texfold_progressive_texel(view, texfold_nearest(uv, size, view.params.address_mode), level)
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
