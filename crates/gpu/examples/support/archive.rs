//! A bank in a cache of tiles: each tile of an image is a texture, whose file is read whole once draws look closely.
#![allow(dead_code, reason = "each renderer uses its own part")]

use std::error::Error;

use glam::{Vec2, Vec3};
use texfold::bank::{Bank, Tile};
use texfold_gpu::{AddressMode, Gpu, GpuError, TileCache, TileLook, TileOptions, TileTexture, TileUse, wgpu};

/// Files that are read whole in a frame, at most. A program that draws frames on time reads them in another thread.
const FILES: usize = 4;
/// Texels along a unit of the scene.
const UNIT: f32 = 1024.0;
/// Units between images.
const GAP: f32 = 0.1;

/// The tiles of a bank's images, which lie side by side on the floor.
pub(crate) struct Archive {
    pub(crate) cache: TileCache,
    tiles: Vec<Shelf>,
    /// Middles of the images.
    pub(crate) middles: Vec<Vec3>,
}

/// A tile.
struct Shelf {
    tile: Tile,
    texture: TileTexture,
    /// Its first corner in the scene.
    corner: Vec3,
    /// Where its file has been read whole, the frame in which it was last looked at.
    whole: Option<u32>,
}

/// A tile's rectangle on the floor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed {
    pub(crate) corner: Vec3,
    pub(crate) size: Vec2,
    pub(crate) texture: u32,
}

impl Archive {
    /// All tiles with their smallest levels, in a cache of so many bytes of streams; colours in sRGB are filtered as linear light or as they are stored.
    pub(crate) fn new(
        gpu: &Gpu,
        bank: &Bank,
        stream_bytes: u64,
        srgb: bool,
    ) -> Result<Archive, Box<dyn Error>> {
        let count = bank.images().iter().map(|image| image.tiles.len()).sum::<usize>() as u32;
        let is_software = gpu.info().device_type == wgpu::DeviceType::Cpu;
        let options = TileOptions {
            stream_bytes,
            textures: count,
            // A tile of an image has at most 1279 texels a side.
            pages: 160 * count,
            // A quarter of a tile each.
            pool_bytes: (64 << 20) + (u64::from(count) << 14),
            anisotropy: if is_software { 1 } else { 4 },
            ..TileOptions::default()
        };
        let mut cache = TileCache::new(gpu, &options)?;
        let look = TileLook { address: AddressMode::Clamp, srgb };
        let (mut tiles, mut middles, mut left) = (Vec::new(), Vec::new(), 0.0);
        for image in bank.images() {
            let at = |x: u32, y: u32| Vec3::new(left + x as f32 / UNIT, 0.0, y as f32 / UNIT);
            for tile in &image.tiles {
                let added = cache.add_coarse(gpu, bank.coarse_tile(tile)?.as_encoded(), look)?;
                let texture = *added.first().ok_or("no image")?;
                tiles.push(Shelf { tile: tile.clone(), texture, corner: at(tile.x, tile.y), whole: None });
            }
            middles.push(at(image.width / 2, image.height / 2));
            left += image.width as f32 / UNIT + GAP;
        }
        Ok(Archive { cache, tiles, middles })
    }

    /// Rectangles of all tiles.
    pub(crate) fn placed(&self) -> Vec<Placed> {
        let placed = |shelf: &Shelf| Placed {
            corner: shelf.corner,
            size: Vec2::new(shelf.tile.width as f32, shelf.tile.height as f32) / UNIT,
            texture: shelf.texture.index(),
        };
        self.tiles.iter().map(placed).collect()
    }

    /// Reads files of tiles that were looked at in the last frame, those looked at closest first, and lets go of others where there is no room; how
    /// many of each.
    pub(crate) fn read(
        &mut self,
        gpu: &Gpu,
        bank: &Bank,
        uses: &[TileUse],
        now: u32,
    ) -> Result<[usize; 2], Box<dyn Error>> {
        let (mut wanted, mut counts) = (Vec::new(), [0, 0]);
        for used in uses {
            let place = self.tiles.iter().position(|shelf| shelf.texture == used.texture);
            let place = place.ok_or("not a tile of the bank")?;
            match &mut self.tiles[place].whole {
                Some(last) => *last = (*last).max(now.saturating_sub(used.frames)),
                None if used.frames == 0 => wanted.push((used.level, place)),
                None => {}
            }
        }
        wanted.sort_unstable();
        for (_, place) in wanted.into_iter().take(FILES) {
            let whole = bank.tile(&self.tiles[place].tile)?;
            while !self.is_whole(gpu, place, &whole, now)? {
                // What this frame looks at stays: the rest of it shows coarse.
                let others = self.tiles.iter_mut().filter(|shelf| shelf.whole.is_some_and(|last| last < now));
                let Some(oldest) = others.min_by_key(|shelf| shelf.whole) else { return Ok(counts) };
                self.cache.make_coarse(gpu, oldest.texture);
                oldest.whole = None;
                counts[1] += 1;
            }
            counts[0] += 1;
        }
        Ok(counts)
    }

    /// Brings a tile whole; false where there is no room.
    fn is_whole(
        &mut self,
        gpu: &Gpu,
        place: usize,
        whole: &texfold::AnyImage,
        now: u32,
    ) -> Result<bool, GpuError> {
        let shelf = &mut self.tiles[place];
        match self.cache.replace(gpu, &[shelf.texture], whole.as_encoded()) {
            Ok(()) => {
                shelf.whole = Some(now);
                Ok(true)
            }
            Err(GpuError::TilesFull { option: "stream_bytes", .. }) => Ok(false),
            Err(error) => Err(error),
        }
    }
}
