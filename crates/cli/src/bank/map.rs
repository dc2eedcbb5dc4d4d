//! Images and tiles of a bank, for a page that shows it as a map.

use std::path::{Path, PathBuf};

use serde::Serialize;
use texfold_core::Access;

use texfold::bank::{MANIFEST, Tile};

use super::manifest::{self, access_of};
use crate::console::warn;
use crate::error::CliError;

/// The images of a bank that are stored by block: their tiles are files of their own.
#[derive(Debug, Serialize)]
pub(crate) struct BankMap {
    #[serde(skip)]
    dir: PathBuf,
    images: Vec<MapImage>,
}

#[derive(Debug, Serialize)]
struct MapImage {
    name: String,
    width: u32,
    height: u32,
    /// Bytes of all tiles on disk, and in memory as they are stored.
    #[serde(rename = "fileBytes")]
    disk: u64,
    #[serde(rename = "compressedBytes")]
    memory: u64,
    tiles: Vec<MapTile>,
}

/// A tile: its file, its place and size in the image.
#[derive(Debug, Serialize)]
struct MapTile {
    file: String,
    x: u32,
    y: u32,
    width: u32,
    height: u32,
}

impl BankMap {
    /// Reads the manifest of a bank; warns of images that are not by block.
    ///
    /// # Errors
    /// [`CliError::BankByTexel`] where no image is by block, and where the manifest is none.
    pub(crate) fn read(dir: &Path) -> Result<BankMap, CliError> {
        let bank = manifest::open(dir)?;
        let (by_block, others): (Vec<_>, Vec<_>) =
            bank.images().iter().partition(|image| access_of(image) == Access::Block);
        if by_block.is_empty() {
            return Err(CliError::BankByTexel { path: dir.join(MANIFEST) });
        }
        for image in others {
            warn(&format!("{}: not on the map, as it is read by texel; add it with --codec dct", image.name));
        }
        let tile = |tile: &Tile| {
            let &Tile { ref file, x, y, width, height, .. } = tile;
            MapTile { file: file.clone(), x, y, width, height }
        };
        let images = by_block.into_iter().map(|image| MapImage {
            disk: image.row.sizes.bits_disk / 8,
            memory: image.row.sizes.bits_memory / 8,
            name: image.name.clone(),
            width: image.width,
            height: image.height,
            tiles: image.tiles.iter().map(tile).collect(),
        });
        Ok(BankMap { dir: dir.to_owned(), images: images.collect() })
    }

    /// Path of the tile in that file; `None` where it is no tile of the map.
    pub(crate) fn tile(&self, file: &str) -> Option<PathBuf> {
        let mut tiles = self.images.iter().flat_map(|image| &image.tiles);
        tiles.find(|tile| tile.file == file).map(|tile| self.dir.join(&tile.file))
    }
}
