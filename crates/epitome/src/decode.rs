//! CPU reference of `shaders/wgsl/epitome.wgsl`, function for function.
//!
//! An image is covered by blocks, each split into at most 2 x 2 and again 2 x 2 leaves. A leaf has one entry of the
//! map: where in an epitome its centre lies, by which 2x2 matrix its texels are laid around that place, and which
//! pair of gain and offset its content gets. The map is one plane of 32-bit words: the blocks of all images, the 2x2
//! matrices, the gain-offset pairs, the entries.
//!
//! Public for the tests that hold the WGSL to it and for what fills its uniform buffers: names follow the shaders and may change
//! with them.

use glam::{IVec2, UVec2, Vec2, Vec4};
use texfold_core::Texel;
use texfold_core::address::{
    TexfoldTap, texfold_inside, texfold_level_size, texfold_lod, texfold_nearest, texfold_tap,
};
use texfold_core::sample::{TEXFOLD_NORMAL, texfold_bilinear, texfold_mix, texfold_swizzle};

/// Number of a matrix's coefficient that stands for 1.
pub const TEXFOLD_EPITOME_LINEAR_ONE: f32 = 8192.0;
/// Number of a gain that stands for 1.
pub const TEXFOLD_EPITOME_GAIN_ONE: f32 = 128.0;
/// Mip levels of the image that are read from the epitome; further ones come from the coarse chain.
pub const TEXFOLD_EPITOME_FINE_LEVELS: u32 = 3;

/// The parameters of one image, as the shader's uniform block holds them: 28 32-bit numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct TexfoldEpitomeParams {
    /// Columns and rows of level 0 in texels.
    pub size: [u32; 2],
    /// Stored mip levels.
    pub levels: u32,
    /// [`texfold_core::address::TEXFOLD_REPEAT`] or `TEXFOLD_CLAMP`.
    pub address_mode: u32,
    /// How texels are read from the content planes.
    pub swizzle: u32,
    /// 1: the second plane is a second epitome, and entries say which; 0: it holds further channels or is the first.
    pub mixed: u32,
    /// Texels a side of a block.
    pub block: u32,
    /// 1: blocks are split as their words say; 0: each block is one leaf.
    pub split: u32,
    /// Blocks in a row of the image.
    pub columns: u32,
    /// First word of the image's blocks, or its first entry where blocks are not split.
    pub tree_start: u32,
    /// First word of the entries.
    pub entry_start: u32,
    /// Bytes of an entry, 2 to 6.
    pub entry_bytes: u32,
    /// Bits of the position's column in an entry.
    pub x_bits: u32,
    /// Bits of the position's row in an entry.
    pub y_bits: u32,
    /// How many of them are a fraction of a texel.
    pub fraction_bits: u32,
    /// Bits of the gain-offset pair's number in an entry.
    pub gain_offset_bits: u32,
    /// Bits of the matrix's number in an entry.
    pub matrix_bits: u32,
    /// First word of the 2x2 matrices, two words each.
    pub matrix_start: u32,
    /// First word of the gain-offset pairs, two words each.
    pub gain_offset_start: u32,
    /// Binary logarithm of the words in a row of the map plane.
    pub row_log2: u32,
    /// Columns and rows of the first epitome in texels.
    pub plane_a: [u32; 2],
    /// Columns and rows of the second, or of the first again.
    pub plane_b: [u32; 2],
    /// Mip levels of the epitome.
    pub plane_levels: u32,
    /// How texels are read from the coarse chain.
    pub coarse_swizzle: u32,
    /// Texels a side of the smallest leaf.
    pub cell: u32,
    /// Half the width of the seam along borders of leaves in which both are blended at level 0, in eighths of a
    /// texel.
    pub seam_width: u32,
}

/// One image: what the shader has bound.
#[derive(Debug, Clone, Copy)]
pub struct EpitomeView<'a> {
    /// The uniform block.
    pub params: TexfoldEpitomeParams,
    /// The map plane.
    pub map: &'a [u32],
    /// Texels of the first epitome, level by level.
    pub plane_a: &'a [Vec<Texel>],
    /// Texels of the second epitome; empty where there is none.
    pub plane_b: &'a [Vec<Texel>],
    /// Levels of the image from [`TEXFOLD_EPITOME_FINE_LEVELS`] on.
    pub coarse: &'a [Vec<Texel>],
}

/// A leaf of the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TexfoldEpitomeLeaf {
    /// Its upper left texel.
    pub corner: UVec2,
    /// Texels a side.
    pub side: u32,
    /// Number of its entry.
    pub entry: u32,
}

/// Where a leaf's content comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexfoldEpitomeSource {
    /// Place of the leaf's centre in the epitome, in texels.
    pub position: Vec2,
    /// Rows of the 2x2 matrix: `(xx, xy)` and `(yx, yy)`.
    pub matrix: Vec4,
    /// Factor on each channel.
    pub gain: Vec4,
    /// What is added to each channel.
    pub offset: Vec4,
    /// 1 for the second epitome.
    pub plane: u32,
}

/// Word `index` of the map.
#[must_use]
#[inline]
pub fn texfold_epitome_word(view: &EpitomeView<'_>, index: u32) -> u32 {
    view.map[index as usize]
}

/// The leaf that holds the texel at `at` of level 0, which lies inside.
#[must_use]
#[inline]
pub fn texfold_epitome_leaf(view: &EpitomeView<'_>, at: UVec2) -> TexfoldEpitomeLeaf {
    let params = &view.params;
    let block = at / params.block;
    let corner = block * params.block;
    let number = params.tree_start + block.y * params.columns + block.x;
    if params.split == 0 {
        return TexfoldEpitomeLeaf { corner, side: params.block, entry: number };
    }
    let word = texfold_epitome_word(view, number);
    let first = word >> 5;
    if word & 1 == 0 {
        return TexfoldEpitomeLeaf { corner, side: params.block, entry: first };
    }
    // Entries of a block stand quarter by quarter; a quarter that is split has four.
    let half = params.block / 2;
    let inner = at - corner;
    let quarter = inner / half;
    let number = quarter.y * 2 + quarter.x;
    let splits = word >> 1 & 15;
    let entry = first + number + 3 * (splits & ((1 << number) - 1)).count_ones();
    let corner = corner + quarter * half;
    if splits >> number & 1 == 0 {
        return TexfoldEpitomeLeaf { corner, side: half, entry };
    }
    let sixteenth = (inner - quarter * half) / (half / 2);
    TexfoldEpitomeLeaf {
        corner: corner + sixteenth * (half / 2),
        side: half / 2,
        entry: entry + sixteenth.y * 2 + sixteenth.x,
    }
}

/// Bits `start` to `start + count - 1` of the 64 bits `low`, `high`; `count` is below 32.
#[must_use]
#[inline]
pub fn texfold_epitome_bits(low: u32, high: u32, start: u32, count: u32) -> u32 {
    let mask = (1 << count) - 1;
    if start >= 32 {
        // A field of no bits may start at 64.
        return high.wrapping_shr(start - 32) & mask;
    }
    // Shifted in two steps, as a shift by 32 is none.
    (low >> start | high << 1 << (31 - start)) & mask
}

/// Entry `entry` of the map.
#[must_use]
#[inline]
pub fn texfold_epitome_source(view: &EpitomeView<'_>, entry: u32) -> TexfoldEpitomeSource {
    let params = &view.params;
    let byte = entry * params.entry_bytes;
    let low = texfold_epitome_word(view, params.entry_start + byte / 4);
    let high = texfold_epitome_word(view, params.entry_start + byte / 4 + 1);
    let mut start = byte % 4 * 8;
    let x = texfold_epitome_bits(low, high, start, params.x_bits);
    start += params.x_bits;
    let y = texfold_epitome_bits(low, high, start, params.y_bits);
    start += params.y_bits;
    let gain_offset = texfold_epitome_bits(low, high, start, params.gain_offset_bits);
    start += params.gain_offset_bits;
    let matrix = texfold_epitome_bits(low, high, start, params.matrix_bits);
    start += params.matrix_bits;
    let plane = texfold_epitome_bits(low, high, start, params.mixed);
    let scale = 1.0 / (1u32 << params.fraction_bits) as f32;
    let gain_offset = params.gain_offset_start + 2 * gain_offset;
    let (gain, offset) = texfold_epitome_gain_offset(
        texfold_epitome_word(view, gain_offset),
        texfold_epitome_word(view, gain_offset + 1),
    );
    let matrix = params.matrix_start + 2 * matrix;
    TexfoldEpitomeSource {
        position: Vec2::new(x as f32 * scale, y as f32 * scale),
        matrix: texfold_epitome_matrix(
            texfold_epitome_word(view, matrix),
            texfold_epitome_word(view, matrix + 1),
        ),
        gain,
        offset,
        plane,
    }
}

/// The two signed 16-bit halves of a word, low half first.
#[must_use]
#[inline]
pub fn texfold_epitome_halves(word: u32) -> Vec2 {
    Vec2::new(((word as i32) << 16 >> 16) as f32, ((word as i32) >> 16) as f32)
}

/// The 2x2 matrix that two words hold: its rows, one a word.
#[must_use]
#[inline]
pub fn texfold_epitome_matrix(first: u32, second: u32) -> Vec4 {
    let (first, second) = (texfold_epitome_halves(first), texfold_epitome_halves(second));
    Vec4::new(first.x, first.y, second.x, second.y) * (1.0 / TEXFOLD_EPITOME_LINEAR_ONE)
}

/// Gain and offset that two words hold: bytes for red, green and blue each. Alpha is left as it is.
#[must_use]
#[inline]
pub fn texfold_epitome_gain_offset(first: u32, second: u32) -> (Vec4, Vec4) {
    let byte = |word: u32, shift: u32| (word >> shift & 255) as f32;
    let gain = Vec4::new(byte(first, 0), byte(first, 8), byte(first, 16), TEXFOLD_EPITOME_GAIN_ONE)
        * (1.0 / TEXFOLD_EPITOME_GAIN_ONE);
    let signed = |shift: u32| byte(second, shift) - 128.0;
    let offset = Vec4::new(signed(0), signed(8), signed(16), 0.0) * (1.0 / 255.0);
    (gain, offset)
}

/// Level of the epitome to read for level `level` of the image: one finer, as blending four texels halves once more,
/// and finer still by what the content is stored smaller.
#[must_use]
#[inline]
pub fn texfold_epitome_plane_level(view: &EpitomeView<'_>, matrix: Vec4, level: u32) -> u32 {
    let across = matrix.x * matrix.x + matrix.z * matrix.z;
    let down = matrix.y * matrix.y + matrix.w * matrix.w;
    let squared = across.max(down);
    let octave = i32::from(squared >= 0.125) + i32::from(squared >= 0.5) + i32::from(squared >= 2.0) - 3;
    (level as i32 + octave).clamp(0, view.params.plane_levels as i32 - 1) as u32
}

/// The place in the epitome, in texels of level 0, for the place `at` of the image; kept within the leaf's own
/// content.
#[must_use]
#[inline]
pub fn texfold_epitome_place(
    source: &TexfoldEpitomeSource,
    leaf: TexfoldEpitomeLeaf,
    at: Vec2,
    plane_level: u32,
) -> Vec2 {
    let half = leaf.side as f32 * 0.5;
    let away = at - (leaf.corner.as_vec2() + half);
    let matrix = source.matrix;
    let moved = Vec2::new(matrix.x * away.x + matrix.y * away.y, matrix.z * away.x + matrix.w * away.y);
    let margin = 0.5 * (1u32 << plane_level) as f32;
    let reach = Vec2::new(
        ((matrix.x.abs() + matrix.y.abs()) * half - margin).max(0.0),
        ((matrix.z.abs() + matrix.w.abs()) * half - margin).max(0.0),
    );
    source.position + moved.clamp(-reach, reach)
}

/// Size and levels of the epitome that `plane` names.
#[inline]
pub(crate) fn plane_of<'a>(view: &EpitomeView<'a>, plane: u32) -> (UVec2, &'a [Vec<Texel>]) {
    if plane == 1 && view.params.mixed == 1 {
        (UVec2::from(view.params.plane_b), view.plane_b)
    } else {
        (UVec2::from(view.params.plane_a), view.plane_a)
    }
}

/// The four texels around `place` (in texels of level 0) of level `level`, which has `size` texels.
#[inline]
pub(crate) fn tap_at(place: Vec2, size: UVec2, level: u32) -> TexfoldTap {
    let at = place * (1.0 / (1u32 << level) as f32) - Vec2::splat(0.5);
    let corner = at.floor();
    TexfoldTap {
        low: texfold_inside(corner.as_ivec2(), size),
        high: texfold_inside(corner.as_ivec2() + IVec2::ONE, size),
        weight: at - corner,
    }
}

/// Four texels around `place` (in texels of level 0) of level `level` of an epitome, blended.
#[must_use]
#[inline]
pub fn texfold_epitome_read(view: &EpitomeView<'_>, plane: u32, place: Vec2, level: u32) -> Texel {
    let (size, planes) = plane_of(view, plane);
    let size = texfold_level_size(size, level);
    let TexfoldTap { low, high, weight } = tap_at(place, size, level);
    let texels = &planes[level as usize];
    let texel = |x: u32, y: u32| texels[(y * size.x + x) as usize];
    let texels = [texel(low.x, low.y), texel(high.x, low.y), texel(low.x, high.y), texel(high.x, high.y)];
    let blended = texfold_bilinear(texels, weight);
    // The planes' texels are swizzled already. The shader swizzles after blending: the same but for normals.
    if view.params.swizzle == TEXFOLD_NORMAL {
        texfold_swizzle(blended, blended, TEXFOLD_NORMAL)
    } else {
        blended
    }
}

/// The leaf's colour at the place `at` of the image, in texels of level 0, for level `level` of the image.
#[must_use]
#[inline]
pub fn texfold_epitome_content(
    view: &EpitomeView<'_>,
    leaf: TexfoldEpitomeLeaf,
    at: Vec2,
    level: u32,
) -> Texel {
    let source = texfold_epitome_source(view, leaf.entry);
    let plane_level = texfold_epitome_plane_level(view, source.matrix, level);
    let place = texfold_epitome_place(&source, leaf, at, plane_level);
    let texel = texfold_epitome_read(view, source.plane, place, plane_level);
    (texel * source.gain + source.offset).clamp(Vec4::ZERO, Vec4::ONE)
}

/// The leaf of the texel at `at` of level `level`, one of the levels that are read from the epitome.
#[must_use]
#[inline]
pub fn texfold_epitome_leaf_at(view: &EpitomeView<'_>, at: UVec2, level: u32) -> TexfoldEpitomeLeaf {
    // The texel's centre in texels of level 0, rounded down.
    let centre = ((at * 2 + UVec2::ONE) << level) >> 1u32;
    texfold_epitome_leaf(view, centre.min(UVec2::from(view.params.size) - UVec2::ONE))
}

/// The texel at `at` of level `level`, which lies inside.
#[must_use]
pub fn texfold_epitome_load(view: &EpitomeView<'_>, at: UVec2, level: u32) -> Texel {
    if level >= TEXFOLD_EPITOME_FINE_LEVELS {
        return texfold_epitome_coarse(view, at, level);
    }
    let leaf = texfold_epitome_leaf_at(view, at, level);
    let place = (at.as_vec2() + Vec2::splat(0.5)) * (1u32 << level) as f32;
    texfold_epitome_content(view, leaf, place, level)
}

/// The texel at `at` of level `level`, one of the coarse chain.
#[must_use]
pub fn texfold_epitome_coarse(view: &EpitomeView<'_>, at: UVec2, level: u32) -> Texel {
    let width = texfold_level_size(UVec2::from(view.params.size), level).x;
    view.coarse[(level - TEXFOLD_EPITOME_FINE_LEVELS) as usize][(at.y * width + at.x) as usize]
}

/// The colour that `leaf`, that of texel `at` of level `level`, has at `away` (texels of that level) from that
/// texel's centre; the leaf's nearest texel centre where that is outside of the leaf. The level is one of those that
/// are read from the epitome.
#[must_use]
pub fn texfold_epitome_near(
    view: &EpitomeView<'_>,
    leaf: TexfoldEpitomeLeaf,
    at: UVec2,
    away: Vec2,
    level: u32,
) -> Texel {
    let scale = (1u32 << level) as f32;
    let place = (at.as_vec2() + Vec2::splat(0.5) + away) * scale;
    let corner = leaf.corner.as_vec2();
    let margin = Vec2::splat(0.5 * scale);
    // A leaf at the image's edge ends with the image.
    let end = (corner + Vec2::splat(leaf.side as f32)).min(UVec2::from(view.params.size).as_vec2());
    let low = corner + margin;
    let place = place.min(end - margin).max(low);
    texfold_epitome_content(view, leaf, place, level)
}

/// The texel at `at` of level `level`, clamped to it.
#[must_use]
pub fn texfold_epitome_fetch(view: &EpitomeView<'_>, at: IVec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    texfold_epitome_load(view, texfold_inside(at, size), level)
}

/// The texel that `uv` lies in, without filtering.
#[must_use]
pub fn texfold_epitome_nearest(view: &EpitomeView<'_>, uv: Vec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    texfold_epitome_load(view, texfold_nearest(uv, size, view.params.address_mode), level)
}

/// Two texels along each axis whose leaves are blended at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexfoldEpitomeSeam {
    /// The nearer ones to the image's upper left corner.
    pub low: UVec2,
    /// The others.
    pub high: UVec2,
    /// How far the place lies from the centre of `low`, in texels.
    pub away: Vec2,
    /// Weights of `high`.
    pub weight: Vec2,
}

/// The texels around a place; within a seam along a border of leaves those on both sides of it, at level 0, of `size`
/// texels.
#[must_use]
#[inline]
pub fn texfold_epitome_seam(
    params: &TexfoldEpitomeParams,
    tap: TexfoldTap,
    size: UVec2,
    level: u32,
) -> TexfoldEpitomeSeam {
    let half = params.seam_width as f32 * 0.125;
    let cell = params.cell as f32;
    let at = tap.low.as_vec2() + tap.weight + Vec2::splat(0.5);
    let border = (at * (1.0 / cell) + Vec2::splat(0.5)).floor() * cell;
    let beyond = at - border;
    let is_wide = level == 0 && half > 0.5;
    let is_inside = tap.high.cmpeq(tap.low + UVec2::ONE)
        & border.cmpgt(Vec2::ZERO)
        & border.cmplt(size.as_vec2())
        & beyond.abs().cmplt(Vec2::splat(half));
    if !is_wide || !is_inside.any() {
        return TexfoldEpitomeSeam { low: tap.low, high: tap.high, away: tap.weight, weight: tap.weight };
    }
    // No border inside of the image is 0.
    let behind = border.as_uvec2().max(UVec2::ONE);
    TexfoldEpitomeSeam {
        low: UVec2::select(is_inside, behind - UVec2::ONE, tap.low),
        high: UVec2::select(is_inside, behind, tap.high),
        away: Vec2::select(is_inside, beyond + Vec2::splat(0.5), tap.weight),
        weight: Vec2::select(is_inside, Vec2::splat(0.5) + beyond * (0.5 / half), tap.weight),
    }
}

/// Continuous reconstruction within one level: the leaves of the four nearest texels, or those around a border of
/// leaves, each read at the place itself, blended. Inside a leaf all four are the same, and one of them is read.
#[must_use]
pub fn texfold_epitome_bilinear(view: &EpitomeView<'_>, uv: Vec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    let tap = texfold_tap(uv, size, view.params.address_mode);
    if level >= TEXFOLD_EPITOME_FINE_LEVELS {
        let (low, high) = (tap.low, tap.high);
        let corners = [low, UVec2::new(high.x, low.y), UVec2::new(low.x, high.y), high];
        return texfold_bilinear(corners.map(|at| texfold_epitome_coarse(view, at, level)), tap.weight);
    }
    let TexfoldEpitomeSeam { low, high, away, weight } = texfold_epitome_seam(&view.params, tap, size, level);
    let (upper_right, lower_left) = (UVec2::new(high.x, low.y), UVec2::new(low.x, high.y));
    // At a clamped edge both texels of an axis are the same one, and its centre is read.
    let edge = high.cmpeq(low);
    let ahead = Vec2::select(edge, Vec2::ZERO, away);
    let back = Vec2::select(edge, Vec2::ZERO, away - Vec2::ONE);
    let first = texfold_epitome_leaf_at(view, low, level);
    let last = texfold_epitome_leaf_at(view, high, level);
    let nearest = texfold_epitome_near(view, first, low, ahead, level);
    if high == low + UVec2::ONE && first == last {
        return nearest;
    }
    let near = |at: UVec2, away: Vec2| {
        texfold_epitome_near(view, texfold_epitome_leaf_at(view, at, level), at, away, level)
    };
    let texels = [
        nearest,
        near(upper_right, Vec2::new(back.x, ahead.y)),
        near(lower_left, Vec2::new(ahead.x, back.y)),
        texfold_epitome_near(view, last, high, back, level),
    ];
    texfold_bilinear(texels, weight)
}

/// Trilinear filtering at level `lod`.
#[must_use]
pub fn texfold_epitome_sample_level(view: &EpitomeView<'_>, uv: Vec2, lod: f32) -> Texel {
    let clamped = texfold_lod(lod, view.params.levels);
    let low = clamped.floor();
    let fine = texfold_epitome_bilinear(view, uv, low as u32);
    if clamped == low {
        return fine;
    }
    let coarse = texfold_epitome_bilinear(view, uv, low as u32 + 1);
    texfold_mix(fine, coarse, clamped - low)
}
