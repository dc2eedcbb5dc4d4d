//! WGSL of the cache of tiles: what a renderer pastes to draw from it, and the passes that fill it.

use crate::{BLOCK, BLOCK_PASS, BLOCK_SHARE, BLOCK_TEXEL, ModuleInfo, whole};

pub(crate) const TABLES: &str = include_str!("../wgsl/tiles/tables.wgsl");
pub(crate) const PLACE: &str = include_str!("../wgsl/tiles/place.wgsl");
pub(crate) const REQUEST: &str = include_str!("../wgsl/tiles/request.wgsl");

/// The functions that draw from a cache of tiles, with its bindings in `group`: `texfold_tile_sample(texture, uv)`,
/// `texfold_tile_sample_grad` and `texfold_tile_sample_level`. `anisotropy` is that of the bound sampler, 1 for none; of `stride` x
/// `stride` pixels one marks the tiles that it reads.
#[must_use]
pub fn tiles(group: u32, anisotropy: u16, stride: u32) -> String {
    let sample = include_str!("../wgsl/tiles/sample.wgsl");
    let sample = sample.replace("TEXFOLD_GROUP", &group.to_string());
    let sample = sample.replace("TEXFOLD_ANISOTROPY;", &format!("{anisotropy}.0;"));
    [TABLES, &sample.replace("TEXFOLD_STRIDE;", &format!("{stride}u;"))].join("\n")
}

/// A whole compute shader that chooses the tiles of an update: `plan_tiles`, one workgroup.
#[must_use]
pub fn tile_plan() -> String {
    [TABLES, BLOCK_PASS, REQUEST, include_str!("../wgsl/entry/tiles_plan.wgsl")].join("\n")
}

/// A whole compute shader that decodes tiles of superblocks. Its functions, in their order: `clear_scratch`, `read_superblocks`; for each plane
/// `transform_blocks`; `predict_blocks`, `deblock_columns`, `deblock_rows`, `write_tiles`.
#[must_use]
pub fn tile_passes() -> String {
    let entry = include_str!("../wgsl/entry/tiles.wgsl");
    [TABLES, PLACE, BLOCK_PASS, BLOCK, BLOCK_TEXEL, BLOCK_SHARE, REQUEST, entry].join("\n")
}

/// A whole compute shader that draws tiles of a texture that is not in superblocks, one of [`crate::image_modules`], with its bindings in
/// group 1: `draw_tiles`.
#[must_use]
pub fn tile_drawing(module: &'static ModuleInfo) -> String {
    let entry = include_str!("../wgsl/entry/tiles_draw.wgsl");
    [&whole(module, 1), TABLES, PLACE, BLOCK_PASS, REQUEST, entry].join("\n")
}
