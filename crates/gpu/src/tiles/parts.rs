//! Images that the tiles of a texture are decoded from: one, or the maps of a material.

use texfold_core::image::{ColorSpace, MapKind};
use texfold_core::{Encoded, Image2d, ImageLayout};

use super::rows::PartsRow;
use super::{TileCache, TileLook, TileSource, TileTexture};
use crate::{Gpu, GpuError};

/// Most halvings from the largest image's sides to those of another.
const MOST_HALVINGS: u32 = 3;
/// Most images of a tile.
pub(super) const MOST_PARTS: u32 = 8;

/// Layers of a material's tile, as `shaders/wgsl/tiles/tables.wgsl` names them.
const COLOR: u32 = 0;
const NORMAL: u32 = 1;
const PACKED: u32 = 2;
const EMISSIVE: u32 = 3;

/// An image, and the channels of a tile that it fills.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Part {
    /// Its number in the texture's layout.
    pub(super) image: u32,
    layer: u32,
    channel: u32,
    /// Whether it fills that channel alone, else all four.
    is_single: bool,
    /// Halvings from the texture's sides to its own, 0 to 3.
    pub(super) halvings: u32,
}

impl Part {
    /// An image by itself.
    pub(super) fn whole(image: u32) -> Part {
        Part { image, layer: COLOR, channel: 0, is_single: false, halvings: 0 }
    }

    /// Its levels in tiles of their own, of a texture that has `own` of these.
    pub(super) fn own_levels(&self, own: u32) -> u32 {
        own.saturating_sub(self.halvings).max(own.min(1))
    }

    /// Puts the texels of this image into a layer, where they belong there.
    pub(super) fn fill(&self, layer: u32, texels: &mut [[u8; 4]], from: &[[u8; 4]]) {
        if self.layer != layer {
            return;
        }
        for (texel, from) in texels.iter_mut().zip(from) {
            if self.is_single {
                texel[self.channel as usize] = from[0];
            } else {
                *texel = *from;
            }
        }
    }
}

/// The row of these images.
pub(super) fn row(parts: &[Part]) -> PartsRow {
    let mut row = PartsRow { channels: 0, shape: parts.len() as u32 };
    for (number, part) in (0..).zip(parts) {
        row.channels |= (4 * part.layer + part.channel) << (4 * number);
        row.shape |= 1 << (4 + part.layer);
        row.shape |= u32::from(part.is_single) << (8 + number);
        row.shape |= part.halvings << (16 + 2 * number);
    }
    row
}

/// The maps of a material by their channels, those that fill whole layers first; and whether its colours are sRGB.
pub(super) fn of_material(layout: &ImageLayout, layers: u32) -> Result<(Vec<Part>, bool), GpuError> {
    let refused = |what| Err(GpuError::Material { what });
    if layout.maps.is_empty() {
        return refused("the texture has no maps");
    }
    let largest = layout.images.iter().max_by_key(|size| size.texels()).unwrap_or(&layout.images[0]);
    let has_normals = layout.maps.iter().any(|map| map.kind == MapKind::Normal);
    let (mut parts, mut color) = (Vec::new(), None);
    for (image, map) in (0..).zip(&layout.maps) {
        let (layer, single) = match map.kind {
            MapKind::BaseColor => (COLOR, None),
            MapKind::Opacity => (COLOR, Some(3)),
            MapKind::Normal => (NORMAL, None),
            MapKind::Height if has_normals => (NORMAL, Some(3)),
            MapKind::Height => (PACKED, Some(3)),
            MapKind::OcclusionRoughnessMetalness => (PACKED, None),
            MapKind::Occlusion => (PACKED, Some(0)),
            MapKind::Roughness => (PACKED, Some(1)),
            MapKind::Metalness => (PACKED, Some(2)),
            MapKind::Emissive => (EMISSIVE, None),
            // Kinds that this cache does not know.
            _ => return refused("one of its maps is of another kind"),
        };
        if layer >= layers {
            return refused("the cache has no layers for such a map");
        }
        if matches!(map.kind, MapKind::BaseColor | MapKind::Emissive) {
            let own = map.pixel.color == ColorSpace::Srgb;
            if *color.get_or_insert(own) != own {
                return refused("one of its colours is sRGB, the other one is not");
            }
        }
        let own = layout.images[image as usize];
        let doubled = |times: &u32| (own.width << times, own.height << times);
        let is_largest = |times: &u32| doubled(times) == (largest.width, largest.height);
        let Some(halvings) = (0..=MOST_HALVINGS).find(is_largest) else {
            return refused("the sides of a map are not those of the largest, halves, quarters or eighths");
        };
        let is_single = single.is_some();
        let part = Part { image, layer, channel: single.unwrap_or(0), is_single, halvings };
        let is_same = |other: &Part| Part { image, halvings, ..*other } == part;
        if parts.iter().any(is_same) {
            return refused("two of its maps are of the same kind");
        }
        parts.push(part);
    }
    parts.sort_by_key(|part| (part.is_single, part.image));
    if parts.len() > MOST_PARTS as usize {
        return refused("it has more than eight maps");
    }
    Ok((parts, color.unwrap_or(false)))
}

impl TileCache {
    /// Adds a material, whose maps `texfold_tile_sample_material(material: u32, uv: vec2<f32>) -> TexfoldTileMaterial` looks up together: in a cache of
    /// [`TileContents::Materials`](crate::TileContents::Materials), from a texture in superblocks (codec `dct`). A tile's maps are decoded together, and share places of the pool: opacity lies in
    /// the alpha of the base colour, height in that of normals, occlusion, roughness and metalness in one layer. Maps that are missing read as 1, normals
    /// as (0, 0, 1). Maps may have half, a quarter or an eighth of the sides of the largest: levels that they lack are enlarged. `texfold_tile_sample` of a material gives base colour and opacity.
    ///
    /// # Errors
    /// [`GpuError::Material`] for maps of other sizes, of the kind [`MapKind::Other`], or two of a kind, which [`TileCache::add`] takes;
    /// [`GpuError`] as there. Nothing is added then.
    pub fn add_material(
        &mut self,
        gpu: &Gpu,
        material: &dyn Encoded<Domain = Image2d>,
        look: TileLook,
    ) -> Result<TileTexture, GpuError> {
        let source = TileSource::new(gpu, material)?;
        let index = self.free_index()?;
        self.put_material(gpu, &source, (index, look))
    }

    /// Puts a material under a number, in place of what has it.
    pub(super) fn put_material(
        &mut self,
        gpu: &Gpu,
        source: &TileSource<'_>,
        (index, look): (usize, TileLook),
    ) -> Result<TileTexture, GpuError> {
        let (parts, is_srgb) = of_material(source.texture.layout(), self.layers())?;
        if source.uploaded.is_some() {
            return Err(GpuError::Material { what: "the texture is not in superblocks" });
        }
        let look = TileLook { srgb: look.srgb && is_srgb, ..look };
        let put = self.put(gpu, source, &parts, (index, look))?;
        self.held[index].iter_mut().for_each(|held| held.is_material = true);
        Ok(put)
    }
}
