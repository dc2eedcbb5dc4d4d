//! Sizes of a cache, looks of textures and what an update reports.

use super::parts::MOST_PARTS;
use super::rows::{MOST_LEVELS, MOST_TILES};
use crate::AddressMode;

/// Sizes of a cache.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileOptions {
    /// Bytes of decoded tiles, 64 KiB each, of materials 192 or 256. Rounded down to whole layers, of 1, 4 or 16 MiB.
    pub pool_bytes: u64,
    /// Bytes of compressed streams and of what decodes them, 16 kB a stage of three mip levels; at most 4 GiB. The latter, and the streams of
    /// a stage, must fit one binding of the device.
    pub stream_bytes: u64,
    /// Most textures at a time.
    pub textures: u32,
    /// Most tiles of all textures and levels, decoded or not: of a texture of 4096 texels a side 1593.
    pub pages: u32,
    /// Most tiles that an update decodes, 1 to 64.
    pub tiles_per_update: u32,
    /// Bytes of scratch memory of an update: a tile takes 0.4 MB, one of two levels below a stage 4 MB.
    pub scratch_bytes: u64,
    /// Texels that the sampler reads along the longer axis of a pixel's footprint, 1 to 7.
    pub anisotropy: u16,
    /// Of a square of so many pixels a side one marks, in each frame, the tiles that it reads: 1, 2, 4 or 8. Where fewer pixels of a tile
    /// are seen it may be marked `stride` * `stride` frames later.
    pub stride: u32,
    /// Textures, or materials with all maps of a tile together.
    pub contents: TileContents,
}

impl Default for TileOptions {
    fn default() -> Self {
        TileOptions {
            pool_bytes: 64 << 20,
            stream_bytes: 64 << 20,
            textures: 256,
            pages: 1 << 17,
            tiles_per_update: MOST_TILES,
            scratch_bytes: 32 << 20,
            anisotropy: 4,
            stride: 8,
            contents: TileContents::Textures,
        }
    }
}

impl TileOptions {
    /// Stages of all textures.
    pub(super) fn most_stages(&self) -> u32 {
        let images = if self.contents == TileContents::Textures { 1 } else { MOST_PARTS };
        self.textures.saturating_mul(images * (MOST_LEVELS as u32).div_ceil(3))
    }
}

/// Contents of a cache, which decide on the layers of the pool that a tile takes. Textures may lie among materials, in as many layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum TileContents {
    /// Textures, each looked up by itself: one layer a tile.
    #[default]
    Textures,
    /// Materials ([`TileCache::add_material`](crate::TileCache::add_material)).
    Materials {
        /// Whether any emits light: four layers a tile, else three.
        emissive: bool,
    },
}

impl TileContents {
    /// Layers of the pool that a tile takes.
    #[must_use]
    pub fn layers(self) -> u32 {
        match self {
            TileContents::Textures => 1,
            TileContents::Materials { emissive } => 3 + u32::from(emissive),
        }
    }
}

/// Addressing and colours of a texture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileLook {
    /// Texture coordinates outside of [0, 1).
    pub address: AddressMode,
    /// Whether colours are sRGB and become linear light before they are filtered; not for normals and other data. Of a material's maps those
    /// of data stay as they are all the same.
    pub srgb: bool,
}

impl Default for TileLook {
    fn default() -> Self {
        TileLook { address: AddressMode::Repeat, srgb: true }
    }
}

/// A texture of a cache.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct TileTexture(pub(super) u32);

impl TileTexture {
    /// The `texture` argument of the WGSL functions.
    #[must_use]
    pub fn index(self) -> u32 {
        self.0
    }
}

/// The outcome of the last update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TileReport {
    /// Tiles that it decoded.
    pub decoded: u32,
    /// Tiles that were looked at, and that it left for later.
    pub missing: u32,
    /// Mip levels that lookups add so that the pool suffices.
    pub bias: f32,
}
