//! What whole shaders are put together from, as text: for packages in other languages.

use crate::{ADDRESS, BLOCK, BLOCK_PASS, BLOCK_SHARE, BLOCK_TEXEL, ModuleInfo, SAMPLE, VIEW, tiles};

/// Name and text of all parts that no module has for itself. What [`crate::entry`], [`crate::block`] and the shaders of tiles are
/// put together from, with `TEXFOLD_GROUP`, `TEXFOLD_ANISOTROPY` and `TEXFOLD_STRIDE` in the place of numbers.
pub static PARTS: [(&str, &str); 21] = [
    ("address", ADDRESS),
    ("sample", SAMPLE),
    ("view", VIEW),
    ("decode", include_str!("../wgsl/entry/decode.wgsl")),
    ("draw", include_str!("../wgsl/entry/draw.wgsl")),
    ("mesh", include_str!("../wgsl/entry/mesh.wgsl")),
    ("blockPass", BLOCK_PASS),
    ("block", BLOCK),
    ("blockTexel", BLOCK_TEXEL),
    ("blockShare", BLOCK_SHARE),
    ("blockEntry", include_str!("../wgsl/entry/block.wgsl")),
    ("blockUnorm", include_str!("../wgsl/entry/block_unorm.wgsl")),
    ("blockUint", include_str!("../wgsl/entry/block_uint.wgsl")),
    ("blockFloat", include_str!("../wgsl/entry/block_float.wgsl")),
    ("tileTables", tiles::TABLES),
    ("tilePlace", tiles::PLACE),
    ("tileRequest", tiles::REQUEST),
    ("tileSample", include_str!("../wgsl/tiles/sample.wgsl")),
    ("tileEntry", include_str!("../wgsl/entry/tiles.wgsl")),
    ("tilePlan", include_str!("../wgsl/entry/tiles_plan.wgsl")),
    ("tileDraw", include_str!("../wgsl/entry/tiles_draw.wgsl")),
];

impl ModuleInfo {
    /// Its functions, in files of WGSL: the text of each, in which `TEXFOLD_GROUP` and `TEXFOLD_BINDING_0` and so on stand for numbers,
    /// and the module's binding that is the file's `TEXFOLD_BINDING_0`. Modules may share files.
    pub fn sources(&self) -> impl Iterator<Item = (&'static str, u32)> + '_ {
        self.fragments.iter().map(|fragment| (fragment.text, fragment.first_binding))
    }

    /// The functions that [`crate::entry`] calls.
    #[must_use]
    pub fn entry_source(&self) -> &'static str {
        self.entry_source
    }
}
