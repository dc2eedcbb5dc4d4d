//! CPU reference of `shaders/wgsl/vq.wgsl`, function for function.
//!
//! The index plane of a size class has one texel a block. Each image fills `rows` rows of `ceil(width / 4)`
//! texels: level 0 row by row, then the further levels one after the other without gaps. Images stand below one
//! another in `columns` columns.

use glam::{IVec2, UVec2, Vec2};
use texfold_core::Texel;
use texfold_core::address::{texfold_level_size, texfold_nearest, texfold_tap, texfold_wrap};
use texfold_core::sample::{texfold_bilinear, texfold_mix};

/// Most mip levels: images have up to 32768 texels a side.
pub const TEXFOLD_VQ_LEVELS: usize = 16;

/// The parameters of one size class, as the shader's uniform block holds them: 24 32-bit numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct TexfoldVqParams {
    /// Columns and rows of level 0 in texels.
    pub size: [u32; 2],
    /// Stored mip levels.
    pub levels: u32,
    /// [`texfold_core::address::TEXFOLD_REPEAT`] or `TEXFOLD_CLAMP`.
    pub address_mode: u32,
    /// How texels are read from the codebook's planes.
    pub swizzle: u32,
    /// Images side by side in the index plane.
    pub columns: u32,
    /// Rows of the index plane that one image fills.
    pub rows: u32,
    /// Always 0.
    pub reserved: u32,
    /// For each level the number of blocks of the levels above it.
    pub level_start: [u32; TEXFOLD_VQ_LEVELS],
}

/// One size class: what the shader has bound.
#[derive(Debug, Clone, Copy)]
pub struct VqView<'a> {
    /// The uniform block.
    pub params: TexfoldVqParams,
    /// Index plane: column and row in the codebook for each block, row by row.
    pub index: &'a [[u8; 2]],
    /// Columns of the index plane.
    pub index_width: u32,
    /// All texels of the codebook, row by row.
    pub codebook: &'a [Texel],
    /// Columns of the codebook.
    pub codebook_width: u32,
}

/// Where the block at column `block.x` and row `block.y` of a level lies in the codebook, in texels.
#[must_use]
pub fn texfold_vq_block(view: &VqView<'_>, surface: u32, level: u32, block: UVec2) -> UVec2 {
    let width = view.params.size[0].div_ceil(4);
    let origin =
        UVec2::new(surface % view.params.columns * width, surface / view.params.columns * view.params.rows);
    let mut at = block;
    if level > 0 {
        let level_width = texfold_level_size(UVec2::from(view.params.size), level).x.div_ceil(4);
        let linear = view.params.level_start[level as usize] + block.y * level_width + block.x;
        at = UVec2::new(linear % width, linear / width);
    }
    let [x, y] = view.index[((origin.y + at.y) * view.index_width + origin.x + at.x) as usize];
    UVec2::new(u32::from(x), u32::from(y))
}

/// The codebook's texel at `at`.
#[must_use]
pub fn texfold_vq_texel(view: &VqView<'_>, at: UVec2) -> Texel {
    view.codebook[(at.y * view.codebook_width + at.x) as usize]
}

/// The texel at `at` of level `level`, which lies inside.
#[must_use]
pub fn texfold_vq_load(view: &VqView<'_>, surface: u32, at: UVec2, level: u32) -> Texel {
    let corner = texfold_vq_block(view, surface, level, at / 4);
    texfold_vq_texel(view, corner + at % 4)
}

/// The texel at `at` of level `level`, clamped to it.
#[must_use]
pub fn texfold_vq_fetch(view: &VqView<'_>, surface: u32, at: IVec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    let inside = at.clamp(IVec2::ZERO, size.as_ivec2() - 1).as_uvec2();
    texfold_vq_load(view, surface, inside, level)
}

/// The texel that `uv` lies in, without filtering.
#[must_use]
pub fn texfold_vq_nearest(view: &VqView<'_>, surface: u32, uv: Vec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    let at = texfold_nearest(uv, size);
    let mode = view.params.address_mode;
    let inside = UVec2::new(texfold_wrap(at.x, size.x, mode), texfold_wrap(at.y, size.y, mode));
    texfold_vq_load(view, surface, inside, level)
}

/// Bilinear filtering within one level, across blocks.
#[must_use]
pub fn texfold_vq_bilinear(view: &VqView<'_>, surface: u32, uv: Vec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    let tap = texfold_tap(uv, size);
    let mode = view.params.address_mode;
    let (left, right) = (texfold_wrap(tap.low.x, size.x, mode), texfold_wrap(tap.low.x + 1, size.x, mode));
    let (upper, lower) = (texfold_wrap(tap.low.y, size.y, mode), texfold_wrap(tap.low.y + 1, size.y, mode));
    let texels = [
        texfold_vq_load(view, surface, UVec2::new(left, upper), level),
        texfold_vq_load(view, surface, UVec2::new(right, upper), level),
        texfold_vq_load(view, surface, UVec2::new(left, lower), level),
        texfold_vq_load(view, surface, UVec2::new(right, lower), level),
    ];
    texfold_bilinear(texels, tap.weight)
}

/// Trilinear filtering at level `lod`.
#[must_use]
pub fn texfold_vq_sample_level(view: &VqView<'_>, surface: u32, uv: Vec2, lod: f32) -> Texel {
    let clamped = lod.clamp(0.0, (view.params.levels - 1) as f32);
    let low = clamped.floor();
    let fine = texfold_vq_bilinear(view, surface, uv, low as u32);
    if clamped == low {
        return fine;
    }
    let coarse = texfold_vq_bilinear(view, surface, uv, low as u32 + 1);
    texfold_mix(fine, coarse, clamped - low)
}
