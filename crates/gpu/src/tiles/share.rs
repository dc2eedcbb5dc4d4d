//! Bytes that a texture takes of a cache.

use texfold_core::{Encoded, Image2d};

use super::parts::{Part, of_material};
use super::rows::{SIDE, tail_of};
use super::{TileContents, stage_words, stages_of, tiles_of};
use crate::GpuError;
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
        let images = (0..texture.layout().images.len() as u32).map(|image| vec![Part::whole(image)]);
        share(texture, &images.collect::<Vec<_>>(), 1)
    }

    /// The share of a material, in a cache of such contents.
    ///
    /// # Errors
    /// [`GpuError::Material`] for what [`TileCache::add_material`](crate::TileCache::add_material) does not take.
    pub fn of_material(
        material: &dyn Encoded<Domain = Image2d>,
        contents: TileContents,
    ) -> Result<TileBytes, GpuError> {
        let layers = contents.layers();
        Ok(share(material, &[of_material(material.layout(), layers)?.0], layers))
    }
}

/// The share of textures of such parts each, whose tiles take so many layers.
fn share(texture: &dyn Encoded<Domain = Image2d>, textures: &[Vec<Part>], layers: u32) -> TileBytes {
    let (form, layout) = (texture.gpu(), texture.layout());
    let in_superblocks = !form.blocks.is_empty() && form.module == PLAIN_MODULE;
    let (mut tiles, mut words) = (0, 0);
    for parts in textures {
        let Some(largest) = parts.iter().min_by_key(|part| part.halvings) else { continue };
        let size = layout.images[largest.image as usize];
        let own = layout.levels.min(size.full_levels()).min(tail_of(size));
        let count = |level| tiles_of(size, level).into_iter().map(u64::from).product::<u64>();
        tiles += (0..own).map(count).sum::<u64>();
        let stages = parts.iter().flat_map(|part| stages_of(&form.blocks, part.image, part.own_levels(own)));
        words += stages.flat_map(stage_words).sum::<usize>() as u64;
    }
    let held = if in_superblocks { 4 * words } else { form.memory().resident.div_ceil(8) };
    let tails = (textures.len() as u64).div_ceil(4);
    TileBytes { held, decoded: 4 * u64::from(layers) * u64::from(SIDE).pow(2) * (tiles + tails) }
}
