//! Bytes that a texture takes of a cache.

use texfold_core::{Encoded, Image2d};

use super::rows::{SIDE, tail_of};
use super::{stage_words, stages_of, tiles_of};
use crate::upload::PLAIN_MODULE;

/// A texture's share of a [`TileCache`](crate::TileCache), in bytes of GPU memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileBytes {
    /// The source of its tiles: streams and tables, part of [`stream_bytes`](crate::TileOptions::stream_bytes), for superblocks,
    /// else the texture as [`Gpu::upload`](crate::Gpu::upload) holds it.
    pub held: u64,
    /// All of its tiles decoded: the most of the pool that it takes. Textures that share a pool take no more than that together.
    pub decoded: u64,
}

impl TileBytes {
    /// The share of all images of a texture.
    #[must_use]
    pub fn of(texture: &dyn Encoded<Domain = Image2d>) -> TileBytes {
        let (form, layout) = (texture.gpu(), texture.layout());
        let in_superblocks = !form.blocks.is_empty() && form.module == PLAIN_MODULE;
        let (mut tiles, mut words) = (0, 0);
        for (image, &size) in (0..).zip(&layout.images) {
            let own = layout.levels.min(size.full_levels()).min(tail_of(size));
            let count = |level| tiles_of(size, level).into_iter().map(u64::from).product::<u64>();
            tiles += (0..own).map(count).sum::<u64>();
            words += stages_of(&form.blocks, image, own).flat_map(stage_words).sum::<usize>() as u64;
        }
        let held = if in_superblocks { 4 * words } else { form.memory().resident.div_ceil(8) };
        let tails = (layout.images.len() as u64).div_ceil(4);
        TileBytes { held, decoded: 4 * u64::from(SIDE).pow(2) * (tiles + tails) }
    }
}
