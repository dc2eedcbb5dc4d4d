//! CPU reference of `shaders/wgsl/vq.wgsl`, function for function.
//!
//! The index plane of a size class has one texel a block. Each image fills `rows` rows of `ceil(width / 4)`
//! texels: level 0 row by row, then the further levels one after the other without gaps. Images stand below one
//! another, in several columns where one would be too long.
//!
//! `image` is what [`VqTexture::view`](crate::VqTexture::view) gives beside the view: the row and 8192 times the
//! column where the image begins in the index plane.
//!
//! Public for the tests that hold the WGSL to it and for what fills its uniform buffers: names follow the shaders and may change
//! with them.

use glam::{IVec2, UVec2, Vec2};
use texfold_core::Texel;
use texfold_core::address::{
    TexfoldTap, texfold_divide, texfold_inside, texfold_level_size, texfold_lod, texfold_nearest, texfold_tap,
};
use texfold_core::sample::{TEXFOLD_NORMAL, texfold_bilinear, texfold_mix, texfold_swizzle};

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
    /// Rows of the index plane that one image fills.
    pub rows: u32,
    /// Always 0.
    pub reserved: [u32; 2],
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

/// Where the texel at `at` of level `level`, which lies inside, is in the codebook.
#[must_use]
pub fn texfold_vq_place(view: &VqView<'_>, image: u32, at: UVec2, level: u32) -> UVec2 {
    let width = view.params.size[0].div_ceil(4);
    let level_width = texfold_level_size(UVec2::from(view.params.size), level).x.div_ceil(4);
    let start = view.params.level_start[level as usize];
    let block = texfold_divide(start + at.y / 4 * level_width + at.x / 4, width);
    let origin = UVec2::new(image / 8192, image % 8192);
    let block = origin + block;
    UVec2::from(view.index[(block.y * view.index_width + block.x) as usize].map(u32::from)) + at % 4
}

/// The texel at `at` of level `level`, which lies inside.
#[must_use]
pub fn texfold_vq_load(view: &VqView<'_>, image: u32, at: UVec2, level: u32) -> Texel {
    let place = texfold_vq_place(view, image, at, level);
    view.codebook[(place.y * view.codebook_width + place.x) as usize]
}

/// The four texels of `tap` in level `level`, blended.
#[must_use]
pub fn texfold_vq_blend(view: &VqView<'_>, image: u32, tap: TexfoldTap, level: u32) -> Texel {
    let texels = [
        texfold_vq_load(view, image, tap.low, level),
        texfold_vq_load(view, image, UVec2::new(tap.high.x, tap.low.y), level),
        texfold_vq_load(view, image, UVec2::new(tap.low.x, tap.high.y), level),
        texfold_vq_load(view, image, tap.high, level),
    ];
    let blended = texfold_bilinear(texels, tap.weight);
    // The codebook's texels are swizzled already. The shader swizzles after blending: the same but for normals.
    if view.params.swizzle == TEXFOLD_NORMAL {
        texfold_swizzle(blended, blended, TEXFOLD_NORMAL)
    } else {
        blended
    }
}

/// The texel at `at` of level `level`, clamped to it.
#[must_use]
pub fn texfold_vq_fetch(view: &VqView<'_>, image: u32, at: IVec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    texfold_vq_load(view, image, texfold_inside(at, size), level)
}

/// The texel that `uv` lies in, without filtering.
#[must_use]
pub fn texfold_vq_nearest(view: &VqView<'_>, image: u32, uv: Vec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    texfold_vq_load(view, image, texfold_nearest(uv, size, view.params.address_mode), level)
}

/// Bilinear filtering within one level, across blocks.
#[must_use]
pub fn texfold_vq_bilinear(view: &VqView<'_>, image: u32, uv: Vec2, level: u32) -> Texel {
    let size = texfold_level_size(UVec2::from(view.params.size), level);
    texfold_vq_blend(view, image, texfold_tap(uv, size, view.params.address_mode), level)
}

/// Trilinear filtering at level `lod`.
#[must_use]
pub fn texfold_vq_sample_level(view: &VqView<'_>, image: u32, uv: Vec2, lod: f32) -> Texel {
    let clamped = texfold_lod(lod, view.params.levels);
    let low = clamped.floor();
    let fine = texfold_vq_bilinear(view, image, uv, low as u32);
    if clamped == low {
        return fine;
    }
    let coarse = texfold_vq_bilinear(view, image, uv, low as u32 + 1);
    texfold_mix(fine, coarse, clamped - low)
}
