//! CPU reference of `shaders/wgsl/bc.wgsl`, function for function.

use glam::{IVec2, UVec2, Vec2, Vec4};
use texfold_core::Texel;
use texfold_core::address::{texfold_level_size, texfold_nearest, texfold_tap, texfold_wrap};
use texfold_core::sample::{texfold_bilinear, texfold_mix, texfold_swizzle};

use crate::ContentPlanes;
use crate::blocks::decode_block;

/// The parameters of one image, as the shader's uniform block holds them: eight 32-bit numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct TexfoldBcParams {
    /// Columns and rows of the source.
    pub size: [u32; 2],
    /// Columns and rows of the stored plane.
    pub plane_size: [u32; 2],
    /// Stored mip levels.
    pub levels: u32,
    /// [`texfold_core::address::TEXFOLD_REPEAT`] or `TEXFOLD_CLAMP`.
    pub address_mode: u32,
    /// How texels are read from the planes.
    pub swizzle: u32,
    /// 1 where the plane is smaller than the source.
    pub reduced: u32,
}

/// One image: what the shader has bound.
#[derive(Debug, Clone, Copy)]
pub struct BcView<'a> {
    /// The uniform block.
    pub params: TexfoldBcParams,
    /// The planes of each stored level.
    pub levels: &'a [ContentPlanes],
}

/// The stored texel at `at` of plane level `level`; `at` lies inside.
#[must_use]
pub fn texfold_bc_load(view: &BcView<'_>, at: UVec2, level: u32) -> Texel {
    let planes = &view.levels[level as usize];
    let value = |index: usize| {
        let (format, bytes) = &planes.planes()[index];
        let side = format.block_side();
        let columns = planes.size().0.div_ceil(side);
        let block = (at.y / side * columns + at.x / side) as usize * format.block_bytes() as usize;
        let texels = decode_block(*format, bytes.get(block..).unwrap_or_default());
        texels[(at.y % side * side + at.x % side) as usize]
    };
    let a = value(0);
    let b = if planes.planes().len() > 1 { value(1) } else { a };
    texfold_swizzle(a, b, view.params.swizzle)
}

/// The texel at (`x`, `y`) of level `level` of the source's size, clamped to it.
#[must_use]
pub fn texfold_bc_fetch(view: &BcView<'_>, at: IVec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    let inside = at.clamp(IVec2::ZERO, size.as_ivec2() - 1).as_uvec2();
    if view.params.reduced == 0 {
        return texfold_bc_load(view, inside, level);
    }
    let uv = (inside.as_vec2() + 0.5) / size.as_vec2();
    let tap = texfold_tap(uv, texfold_level_size(UVec2::from(view.params.plane_size), level));
    texfold_bc_blend(view, tap.low, tap.weight, level, texfold_core::address::TEXFOLD_CLAMP)
}

/// The four stored texels right of and below `low`, blended.
#[must_use]
pub fn texfold_bc_blend(view: &BcView<'_>, low: IVec2, weight: Vec2, level: u32, mode: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.plane_size), level);
    let (left, right) = (texfold_wrap(low.x, size.x, mode), texfold_wrap(low.x + 1, size.x, mode));
    let (upper, lower) = (texfold_wrap(low.y, size.y, mode), texfold_wrap(low.y + 1, size.y, mode));
    let texels = [
        texfold_bc_load(view, UVec2::new(left, upper), level),
        texfold_bc_load(view, UVec2::new(right, upper), level),
        texfold_bc_load(view, UVec2::new(left, lower), level),
        texfold_bc_load(view, UVec2::new(right, lower), level),
    ];
    texfold_bilinear(texels, weight)
}

/// The texel that `uv` lies in, without filtering.
#[must_use]
pub fn texfold_bc_nearest(view: &BcView<'_>, uv: Vec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    let at = texfold_nearest(uv, size);
    let mode = view.params.address_mode;
    let wrapped = UVec2::new(texfold_wrap(at.x, size.x, mode), texfold_wrap(at.y, size.y, mode));
    texfold_bc_fetch(view, wrapped.as_ivec2(), level)
}

/// Bilinear filtering within one stored level.
#[must_use]
pub fn texfold_bc_bilinear(view: &BcView<'_>, uv: Vec2, level: u32) -> Texel {
    let tap = texfold_tap(uv, texfold_level_size(UVec2::from(view.params.plane_size), level));
    texfold_bc_blend(view, tap.low, tap.weight, level, view.params.address_mode)
}

/// Trilinear filtering at stored level `lod`.
#[must_use]
pub fn texfold_bc_sample_level(view: &BcView<'_>, uv: Vec2, lod: f32) -> Texel {
    let clamped = lod.clamp(0.0, (view.params.levels - 1) as f32);
    let low = clamped.floor();
    let fine = texfold_bc_bilinear(view, uv, low as u32);
    if clamped == low {
        return fine;
    }
    let coarse = texfold_bc_bilinear(view, uv, low as u32 + 1);
    texfold_mix(fine, coarse, clamped - low)
}

/// All texels of plane level `level`, row by row.
pub(crate) fn expand_level(view: &BcView<'_>, level: u32) -> Vec<Vec4> {
    view.levels[level as usize].decode()
}
