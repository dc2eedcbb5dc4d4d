//! CPU reference of `shaders/wgsl/zipmap.wgsl`, function for function.
//!
//! A colour is that of the root at the texture coordinate, and over it that of each patch that its tile names, in their order:
//! by its alpha, at the place that the patch's matrix leads to, from the mip level that fits. A patch has no colour where its
//! own texture coordinates leave 0 to 1, and fades out behind its last mip level.

use glam::{IVec2, Mat3, UVec2, UVec4, Vec2, Vec3, Vec4};
use texfold_core::Texel;
use texfold_core::address::{
    TEXFOLD_CLAMP, texfold_fold, texfold_inside, texfold_level, texfold_level_size, texfold_lod,
    texfold_nearest, texfold_tap,
};
use texfold_core::sample::{texfold_bilinear, texfold_mix};

/// Most patches that a tile names.
pub const TEXFOLD_ZIPMAP_MOST: u32 = 2048;
/// Texels of the table that describe a patch.
pub const TEXFOLD_ZIPMAP_RECORD: u32 = 6;
/// Least third coordinate of a place that a patch shows: nearer to its horizon, or behind it, it shows nothing.
pub const TEXFOLD_ZIPMAP_HORIZON: f32 = 0.0001;

/// The parameters of a texture, as the shader's uniform block holds them: 16 32-bit numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct TexfoldZipmapParams {
    /// Columns and rows of level 0, as fine as the finest patch.
    pub size: [u32; 2],
    /// Mip levels.
    pub levels: u32,
    /// [`texfold_core::address::TEXFOLD_REPEAT`] or `TEXFOLD_CLAMP`.
    pub address_mode: u32,
    /// Columns and rows of level 0 of the root.
    pub root_size: [u32; 2],
    /// Mip levels of the root.
    pub root_levels: u32,
    /// How texels are read from the root's planes.
    pub root_swizzle: u32,
    /// Columns and rows of tiles.
    pub tiles: [u32; 2],
    /// First texel of the table that describes patches.
    pub record_start: u32,
    /// How texels are read from the patches' plane.
    pub patch_swizzle: u32,
    /// Binary logarithm of the texels in a row of the table.
    pub row_log2: u32,
    /// Always 0.
    pub reserved: [u32; 3],
}

/// A texture: what the shader has bound.
#[derive(Debug, Clone, Copy)]
pub struct ZipmapView<'a> {
    /// The uniform block.
    pub params: TexfoldZipmapParams,
    /// The table's texels.
    pub table: &'a [UVec4],
    /// The texels of each level of the root, row by row.
    pub root: &'a [Vec<[u8; 4]>],
    /// The texels of each level of each patch, row by row: the shader finds them in one plane.
    pub patches: &'a [Vec<Vec<[u8; 4]>>],
}

/// A patch as the table describes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexfoldZipmapPatch {
    /// From the root's texture coordinates to the patch's, column by column.
    pub matrix: Mat3,
    /// Columns and rows of level 0.
    pub size: UVec2,
    /// Mip levels.
    pub levels: u32,
    /// Its number.
    pub index: u32,
}

fn texel(bytes: [u8; 4]) -> Texel {
    Vec4::from_array(bytes.map(f32::from)) / 255.0
}

/// Texel `index` of the table; beyond its end nothing that counts.
#[must_use]
#[inline]
pub fn texfold_zipmap_entry(view: &ZipmapView<'_>, index: u32) -> UVec4 {
    view.table.get(index as usize).copied().unwrap_or(UVec4::ZERO)
}

/// The patch of that number.
#[must_use]
#[inline]
pub fn texfold_zipmap_patch(view: &ZipmapView<'_>, index: u32) -> TexfoldZipmapPatch {
    let start = view.params.record_start + index * TEXFOLD_ZIPMAP_RECORD;
    let [x, y, z] = [0, 1, 2].map(|row| texfold_zipmap_entry(view, start + row));
    let row = |row: UVec4| Vec3::from_array([row.x, row.y, row.z].map(f32::from_bits));
    TexfoldZipmapPatch {
        matrix: Mat3::from_cols(row(x), row(y), row(z)).transpose(),
        size: UVec2::new(x.w & 0xffff, x.w >> 16),
        levels: y.w,
        index,
    }
}

/// Four texels of level `level` of a patch around `uv`, blended.
#[must_use]
#[inline]
pub fn texfold_zipmap_blend(view: &ZipmapView<'_>, patch: &TexfoldZipmapPatch, uv: Vec2, level: u32) -> Vec4 {
    let size = texfold_level_size(patch.size, level);
    let texels = view.patches.get(patch.index as usize).and_then(|levels| levels.get(level as usize));
    let Some(texels) = texels else { return Vec4::ZERO };
    four(texels, uv, size, TEXFOLD_CLAMP)
}

/// What a patch shows at `uv` of the root, which moves by `dx` and `dy` to the pixels right and below: its colour and how much of it.
#[must_use]
#[inline]
pub fn texfold_zipmap_layer(view: &ZipmapView<'_>, index: u32, uv: Vec2, dx: Vec2, dy: Vec2) -> Vec4 {
    let patch = texfold_zipmap_patch(view, index);
    let place = patch.matrix * uv.extend(1.0);
    let at = place.truncate() / place.z;
    let inside = at.cmpge(Vec2::ZERO).all() && at.cmple(Vec2::ONE).all();
    if !inside || place.z.is_nan() || place.z < TEXFOLD_ZIPMAP_HORIZON {
        return Vec4::ZERO;
    }
    let across = patch.matrix * dx.extend(0.0);
    let down = patch.matrix * dy.extend(0.0);
    let across = (across.truncate() - at * across.z) / place.z;
    let down = (down.truncate() - at * down.z) / place.z;
    let wanted = texfold_level(across, down, patch.size);
    let lod = if wanted > 0.0 { wanted } else { 0.0 };
    if lod >= patch.levels as f32 {
        return Vec4::ZERO;
    }
    let low = lod.floor();
    let fine = texfold_zipmap_blend(view, &patch, at, low as u32);
    if lod == low {
        return fine;
    }
    let mut coarse = Vec4::new(fine.x, fine.y, fine.z, 0.0);
    if low as u32 + 1 < patch.levels {
        coarse = texfold_zipmap_blend(view, &patch, at, low as u32 + 1);
    }
    texfold_mix(fine, coarse, lod - low)
}

/// Four texels of level `level` of the root around `uv`, blended.
#[must_use]
#[inline]
pub fn texfold_zipmap_root_blend(view: &ZipmapView<'_>, uv: Vec2, level: u32) -> Vec4 {
    let size = texfold_level_size(UVec2::from(view.params.root_size), level);
    four(&view.root[level as usize], uv, size, view.params.address_mode)
}

/// The root's colour at `uv`, which moves by `dx` and `dy` to the pixels right and below.
#[must_use]
#[inline]
pub fn texfold_zipmap_root(view: &ZipmapView<'_>, uv: Vec2, dx: Vec2, dy: Vec2) -> Vec4 {
    let wanted = texfold_level(dx, dy, UVec2::from(view.params.root_size));
    let lod = texfold_lod(wanted, view.params.root_levels);
    let low = lod.floor();
    let fine = texfold_zipmap_root_blend(view, uv, low as u32);
    if lod == low {
        return fine;
    }
    texfold_mix(fine, texfold_zipmap_root_blend(view, uv, low as u32 + 1), lod - low)
}

/// The colour at `uv`, which moves by `dx` and `dy` to the pixels right and below: 0 to 1 from the top left of the root, and beyond by
/// the address mode.
#[must_use]
pub fn texfold_zipmap_sample_grad(view: &ZipmapView<'_>, uv: Vec2, dx: Vec2, dy: Vec2) -> Texel {
    let mut colour = texfold_zipmap_root(view, uv, dx, dy);
    let at = texfold_fold(uv, view.params.address_mode);
    let tiles = UVec2::from(view.params.tiles);
    let tile = texfold_inside((at * tiles.as_vec2()).floor().as_ivec2(), tiles);
    let number = tile.y * tiles.x + tile.x;
    let found = texfold_zipmap_entry(view, number / 4)[number as usize % 4];
    let count = found >> 20;
    let mut names = UVec4::ZERO;
    for k in 0..count.min(TEXFOLD_ZIPMAP_MOST) {
        if k % 8 == 0 {
            names = texfold_zipmap_entry(view, (found & 0xfffff) + k / 8);
        }
        let index = names[k as usize / 2 % 4] >> (16 * (k % 2)) & 0xffff;
        let layer = texfold_zipmap_layer(view, index, at, dx, dy);
        colour = texfold_mix(colour, Vec4::new(layer.x, layer.y, layer.z, 1.0), layer.w);
    }
    colour
}

/// The colour at `uv` where pixels are as large as the texels of level `lod`, clamped to those that there are.
#[must_use]
pub fn texfold_zipmap_sample_level(view: &ZipmapView<'_>, uv: Vec2, lod: f32) -> Texel {
    let step = texfold_lod(lod, view.params.levels).exp2() / UVec2::from(view.params.size).as_vec2();
    texfold_zipmap_sample_grad(view, uv, Vec2::new(step.x, 0.0), Vec2::new(0.0, step.y))
}

/// The colour at `uv` where pixels are the texels of level `level`.
#[must_use]
pub fn texfold_zipmap_bilinear(view: &ZipmapView<'_>, uv: Vec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level).as_vec2();
    texfold_zipmap_sample_grad(view, uv, Vec2::new(1.0 / size.x, 0.0), Vec2::new(0.0, 1.0 / size.y))
}

/// The texel at column `at.x` and row `at.y` of level `level`, clamped to it.
#[must_use]
pub fn texfold_zipmap_fetch(view: &ZipmapView<'_>, at: IVec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    let place = texfold_inside(at, size).as_vec2() + 0.5;
    texfold_zipmap_bilinear(view, place / size.as_vec2(), level)
}

/// The texel of level `level` that `uv` lies in.
#[must_use]
pub fn texfold_zipmap_nearest(view: &ZipmapView<'_>, uv: Vec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    let at = texfold_nearest(uv, size, view.params.address_mode);
    texfold_zipmap_fetch(view, at.as_ivec2(), level)
}

#[inline]
fn four(texels: &[[u8; 4]], uv: Vec2, size: UVec2, mode: u32) -> Vec4 {
    let tap = texfold_tap(uv, size, mode);
    let at = |x: u32, y: u32| texel(texels[(y * size.x + x) as usize]);
    let around = [
        at(tap.low.x, tap.low.y),
        at(tap.high.x, tap.low.y),
        at(tap.low.x, tap.high.y),
        at(tap.high.x, tap.high.y),
    ];
    texfold_bilinear(around, tap.weight)
}
