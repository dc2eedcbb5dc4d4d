//! CPU reference of `shaders/wgsl/bc.wgsl`, function for function.
//!
//! Public for the tests that hold the WGSL to it and for what fills its uniform buffers: names follow the shaders and may change
//! with them.

use std::ops::Range;

use glam::{IVec2, UVec2, Vec2, Vec4};
use texfold_core::address::{
    TEXFOLD_CLAMP, TexfoldTap, texfold_inside, texfold_level_size, texfold_lod, texfold_nearest, texfold_tap,
};
use texfold_core::sample::{texfold_bilinear, texfold_mix, texfold_swizzle};
use texfold_core::{PlaneFormat, Texel};

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

/// What the planes of level `level` store at `at`, which lies inside.
fn stored(view: &BcView<'_>, at: UVec2, level: u32) -> [Vec4; 2] {
    let planes = &view.levels[level as usize];
    let value = |index: usize| {
        let (format, bytes) = &planes.planes()[index];
        let side = format.block_side();
        let columns = planes.size().0.div_ceil(side);
        let block = (at.y / side * columns + at.x / side) as usize * format.block_bytes() as usize;
        if side == 1 {
            return decode_plain(*format, bytes.get(block..).unwrap_or_default());
        }
        let texels = decode_block(*format, bytes.get(block..).unwrap_or_default());
        texels[(at.y % side * side + at.x % side) as usize]
    };
    let a = value(0);
    [a, if planes.planes().len() > 1 { value(1) } else { a }]
}

/// The stored texel at `at` of plane level `level`; `at` lies inside.
#[must_use]
pub fn texfold_bc_load(view: &BcView<'_>, at: UVec2, level: u32) -> Texel {
    let [a, b] = stored(view, at, level);
    texfold_swizzle(a, b, view.params.swizzle)
}

/// The four stored texels of `tap` in plane level `level`, blended.
#[must_use]
pub fn texfold_bc_blend(view: &BcView<'_>, tap: TexfoldTap, level: u32) -> Texel {
    let texels = [
        stored(view, tap.low, level),
        stored(view, UVec2::new(tap.high.x, tap.low.y), level),
        stored(view, UVec2::new(tap.low.x, tap.high.y), level),
        stored(view, tap.high, level),
    ];
    let a = texfold_bilinear(texels.map(|[a, _]| a), tap.weight);
    let b = texfold_bilinear(texels.map(|[_, b]| b), tap.weight);
    texfold_swizzle(a, b, view.params.swizzle)
}

/// The texel at `at` of level `level` of the source's size, which lies inside.
#[must_use]
pub fn texfold_bc_texel(view: &BcView<'_>, at: UVec2, level: u32) -> Texel {
    if view.params.reduced != 0 {
        let size = texfold_level_size(UVec2::from(view.params.size), level);
        let uv = (at.as_vec2() + 0.5) / size.as_vec2();
        let plane_size = texfold_level_size(UVec2::from(view.params.plane_size), level);
        return texfold_bc_blend(view, texfold_tap(uv, plane_size, TEXFOLD_CLAMP), level);
    }
    texfold_bc_load(view, at, level)
}

/// The texel at (`x`, `y`) of level `level` of the source's size, clamped to it.
#[must_use]
pub fn texfold_bc_fetch(view: &BcView<'_>, at: IVec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    texfold_bc_texel(view, texfold_inside(at, size), level)
}

/// The texel that `uv` lies in, without filtering.
#[must_use]
pub fn texfold_bc_nearest(view: &BcView<'_>, uv: Vec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    texfold_bc_texel(view, texfold_nearest(uv, size, view.params.address_mode), level)
}

/// Bilinear filtering within one stored level.
#[must_use]
pub fn texfold_bc_bilinear(view: &BcView<'_>, uv: Vec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.plane_size), level);
    texfold_bc_blend(view, texfold_tap(uv, size, view.params.address_mode), level)
}

/// Trilinear filtering at stored level `lod`.
#[must_use]
pub fn texfold_bc_sample_level(view: &BcView<'_>, uv: Vec2, lod: f32) -> Texel {
    let clamped = texfold_lod(lod, view.params.levels);
    let low = clamped.floor();
    let fine = texfold_bc_bilinear(view, uv, low as u32);
    if clamped == low {
        return fine;
    }
    let coarse = texfold_bc_bilinear(view, uv, low as u32 + 1);
    texfold_mix(fine, coarse, clamped - low)
}

/// The texels of plane level `level` right of and below `corner`, `width` a row, as many rows as `out` holds. All of
/// them lie inside.
pub(crate) fn expand(view: &BcView<'_>, level: u32, corner: UVec2, width: u32, out: &mut [Texel]) {
    let planes = &view.levels[level as usize];
    // Planes of plain bytes have no blocks: any number of rows will do.
    let rows = planes.planes().first().map_or(4, |(format, _)| format.block_side().max(4));
    let columns = corner.x..corner.x + width;
    let mut second = Vec::new();
    let mut top = corner.y;
    let mut rest = out;
    while !rest.is_empty() {
        // Rows up to the next border between blocks.
        let bottom = (top / rows + 1) * rows;
        let length = rest.len().min((bottom - top) as usize * width as usize);
        let (band, further) = rest.split_at_mut(length);
        for (index, (format, bytes)) in planes.planes().iter().enumerate() {
            if index == 0 {
                expand_band(*format, bytes, planes.size().0, columns.clone(), top, band);
            } else {
                second.resize(length, Vec4::ZERO);
                expand_band(*format, bytes, planes.size().0, columns.clone(), top, &mut second);
            }
        }
        if second.is_empty() {
            band.iter_mut().for_each(|texel| *texel = texfold_swizzle(*texel, *texel, view.params.swizzle));
        } else {
            let pairs = band.iter_mut().zip(&second);
            pairs.for_each(|(texel, b)| *texel = texfold_swizzle(*texel, *b, view.params.swizzle));
        }
        (top, rest) = (bottom, further);
    }
}

/// One texel of a plane without blocks, as [`decode_block`] gives it.
fn decode_plain(format: PlaneFormat, bytes: &[u8]) -> Vec4 {
    let byte = |index: usize| bytes.get(index).map_or(0.0, |&byte| f32::from(byte));
    match format {
        PlaneFormat::R8Unorm => Vec4::new(byte(0) / 255.0, 0.0, 0.0, 1.0),
        PlaneFormat::Rg8Unorm => Vec4::new(byte(0) / 255.0, byte(1) / 255.0, 0.0, 1.0),
        PlaneFormat::Rgba8Unorm => Vec4::new(byte(0), byte(1), byte(2), byte(3)) / 255.0,
        _ => decode_block(format, bytes)[0],
    }
}

/// The values of one plane of `plane_width` columns, from row `top` on and within one row of blocks.
fn expand_band(
    format: PlaneFormat,
    bytes: &[u8],
    plane_width: u32,
    columns: Range<u32>,
    top: u32,
    band: &mut [Vec4],
) {
    let (side, length) = (format.block_side(), format.block_bytes() as usize);
    let width = columns.len();
    // Bytes of the blocks that hold the columns of row `y`.
    let blocks_of = |y: u32| {
        let first = y / side * plane_width.div_ceil(side);
        let range = first + columns.start / side..first + columns.end.div_ceil(side);
        bytes.get(range.start as usize * length..range.end as usize * length).unwrap_or_default()
    };
    if side == 1 {
        for (y, line) in (top..).zip(band.chunks_exact_mut(width)) {
            for (texel, bytes) in line.iter_mut().zip(blocks_of(y).chunks_exact(length)) {
                *texel = decode_plain(format, bytes);
            }
        }
        return;
    }
    let mut fill = |left: u32, texels: &[Vec4]| {
        let start = left.max(columns.start);
        let run = ((left + side).min(columns.end) - start) as usize;
        let mut place = (start - columns.start) as usize;
        let mut from = (top % side * side + start - left) as usize;
        while let Some(line) = band.get_mut(place..place + run) {
            line.copy_from_slice(&texels[from..from + run]);
            place += width;
            from += side as usize;
        }
    };
    let lefts = (columns.start / side * side..).step_by(side as usize);
    for (left, block) in lefts.zip(blocks_of(top).chunks_exact(length)) {
        fill(left, &decode_block(format, block));
    }
}
