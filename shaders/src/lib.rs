//! Texfold's WGSL: decode functions to paste into a renderer, and the entry points that use them.
//!
//! [`paste`] gives the functions of any number of textures with the bindings and names that the renderer chooses; the renderer's own
//! shader then calls, say, `texfold_vq_sample(uv)`, or `albedo_sample(uv)` of a slot with the prefix `albedo`. Nothing is fetched but
//! with `textureLoad`, so every adapter gives the same texels, no sampler is bound and the functions may be called from any
//! control flow (those that take derivatives say so).
//!
//! What is public and stable: [`MODULES`], which says what to bind, [`paste`] with [`Slot`], and the functions of each module whose
//! names end in `_fetch`, `_nearest`, `_bilinear`, `_sample_level`, `_sample_grad`, `_sample` and `_sample_image`. Members of
//! parameter blocks, further functions and what planes hold may change with any version: they are written by the encoded texture
//! and read by the WGSL of the same version.

mod module;
mod parts;
mod plan;
mod program;
mod slot;
mod table;
mod tiles;

pub use module::{Binding, ImageOffsets, LightOffsets, ModuleInfo, Offsets, Switch};
pub use parts::PARTS;
pub use plan::{BLOCK_NOTES, BLOCK_STREAMS, BLOCK_WORDS, DCT_TABLES, DctPass, DctPlan};
pub use program::{
    DctChannel, DctDispatch, DctEntry, DctProgram, DctProgramError, MAX_SCRATCH, OUTPUT_BYTES,
    PARAMETER_STRIDE, PASS_BYTES, streams,
};
pub use slot::{PasteError, Slot, paste};
pub use table::{MODULES, image_modules, module};
pub use tiles::{tile_drawing, tile_passes, tile_plan, tiles};

/// A shader that this project draws with, around a module's functions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Entry {
    /// Lookups within a given level, over a rectangle of texture coordinates.
    Decode,
    /// Trilinear lookups over a rectangle of texture coordinates.
    Draw,
    /// A textured mesh.
    Mesh,
    /// The loads of a lookup without its arithmetic, to compare times with.
    LoadsOnly,
}

impl Entry {
    /// All of them.
    pub const ALL: [Entry; 4] = [Entry::Decode, Entry::Draw, Entry::Mesh, Entry::LoadsOnly];
}

const ADDRESS: &str = include_str!("../wgsl/shared/address.wgsl");
const SAMPLE: &str = include_str!("../wgsl/shared/sample.wgsl");
const BLOCK_PASS: &str = include_str!("../wgsl/block_pass.wgsl");
const BLOCK: &str =
    concat!(include_str!("../wgsl/block.wgsl"), "\n", include_str!("../wgsl/block_intra.wgsl"));
const BLOCK_TEXEL: &str = include_str!("../wgsl/entry/block_texel.wgsl");
const BLOCK_SHARE: &str = include_str!("../wgsl/entry/block_share.wgsl");
const VIEW: &str = include_str!("../wgsl/entry/view.wgsl");

/// The functions that all modules share: [`paste`] includes them once.
#[must_use]
pub fn shared() -> String {
    [ADDRESS, SAMPLE].join("\n")
}

/// A whole shader: `module`, one of [`image_modules`], in group 0, the entry's parameters in group 1; its functions are
/// `vertex_main` and `fragment_main`.
#[must_use]
pub fn entry(module: &'static ModuleInfo, entry: Entry) -> String {
    let body = match entry {
        Entry::Decode => [VIEW, include_str!("../wgsl/entry/decode.wgsl")].join("\n"),
        Entry::Draw => [VIEW, include_str!("../wgsl/entry/draw.wgsl")].join("\n"),
        Entry::Mesh => include_str!("../wgsl/entry/mesh.wgsl").to_owned(),
        Entry::LoadsOnly => [VIEW, include_str!("../wgsl/entry/loads_only.wgsl")].join("\n"),
    };
    [whole(module, 0), body].join("\n")
}

/// A whole shader that draws a light field on its mesh: `module` in group 0, the camera in group 1; its functions are
/// `vertex_main` and `fragment_main`.
#[must_use]
pub fn light(module: &'static ModuleInfo) -> String {
    whole(module, 0)
}

/// A whole shader that draws a plain texture (group 0: texture, sampler) with the parameters of [`Entry::Draw`].
#[must_use]
pub fn plain() -> String {
    [VIEW, include_str!("../wgsl/entry/plain.wgsl")].join("\n")
}

/// Samples of the texture that [`block`] writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DctTarget {
    /// `rgba8unorm`.
    Unorm8,
    /// `rgba16uint`.
    Uint16,
    /// `rgba32float`: samples from 0 to 1.
    Float32,
}

impl DctTarget {
    /// All of them.
    pub const ALL: [DctTarget; 3] = [DctTarget::Unorm8, DctTarget::Uint16, DctTarget::Float32];
}

/// A whole compute shader that decodes textures in blocks of variable length. Group 0: [`DctPass`]es, 256 bytes each and six bound, words,
/// streams and scratch memory; group 1, of `write_texels` alone: where texels go, and the target. Its functions, in their order, are
/// `read_superblocks` for all planes, a row of workgroups each, `transform_blocks` for each plane; for the last one `predict_blocks` where its
/// blocks have intra modes, `deblock_columns` and `deblock_rows` where it is deblocked; then `write_texels`.
#[must_use]
pub fn block(target: DctTarget) -> String {
    let target = match target {
        DctTarget::Unorm8 => include_str!("../wgsl/entry/block_unorm.wgsl"),
        DctTarget::Uint16 => include_str!("../wgsl/entry/block_uint.wgsl"),
        DctTarget::Float32 => include_str!("../wgsl/entry/block_float.wgsl"),
    };
    [BLOCK_PASS, BLOCK, BLOCK_TEXEL, BLOCK_SHARE, include_str!("../wgsl/entry/block.wgsl"), target].join("\n")
}

/// The module in a group by its own names, and what entry points call.
fn whole(module: &'static ModuleInfo, group: u32) -> String {
    [shared(), Slot::new(module, group, 0).source(), module.entry_source.to_owned()].join("\n")
}
