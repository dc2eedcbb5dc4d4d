//! `bank.json`: what a bank holds.

use std::path::Path;

use serde::{Deserialize, Serialize};
use texfold_core::{Access, MAX_IMAGE_SIDE};

use super::category::Category;
use crate::error::CliError;
use crate::output::write_whole;
use crate::report::Row;

/// Name of the manifest in a bank's folder.
pub(crate) const MANIFEST: &str = "bank.json";
/// The version of a manifest whose images are all read by texel.
const BY_TEXEL: u32 = 1;
/// The version of one that has images by block.
const WITH_BLOCKS: u32 = 2;

/// What a bank holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Manifest {
    version: u32,
    /// Number of the next file, so that no name is used twice.
    pub(crate) next: u32,
    pub(crate) categories: Vec<Category>,
    pub(crate) images: Vec<Image>,
}

impl Default for Manifest {
    fn default() -> Self {
        Manifest { version: BY_TEXEL, next: 0, categories: Vec::new(), images: Vec::new() }
    }
}

/// One image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Image {
    /// Name of its file without folder and extension.
    pub(crate) name: String,
    /// Hash of its file and of the settings.
    pub(crate) key: String,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) channels: u8,
    pub(crate) levels: u32,
    pub(crate) tiles: Vec<Tile>,
    /// Row of the report.
    pub(crate) row: Row,
}

/// A part of an image, in a file of its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Tile {
    pub(crate) file: String,
    pub(crate) x: u32,
    pub(crate) y: u32,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) category: u32,
    /// Rows of texels that it added to the public codebook.
    pub(crate) grown_rows: u32,
    /// Cells of its own codebook.
    pub(crate) own_cells: u32,
    /// Blocks that use the public codebook, its own, and all of them.
    pub(crate) blocks: [u64; 3],
}

impl Image {
    /// How its texels are reached.
    pub(crate) fn access(&self) -> Access {
        if self.row.access == Access::Block.name() { Access::Block } else { Access::Texel }
    }
}

impl Manifest {
    /// Reads the manifest of the bank in `dir`.
    pub(crate) fn read(dir: &Path) -> Result<Manifest, CliError> {
        let path = dir.join(MANIFEST);
        let text = std::fs::read(&path).map_err(|source| CliError::Read { path: path.clone(), source })?;
        let bad = |what: String| CliError::BankManifest { path: path.clone(), what };
        let manifest: Manifest = serde_json::from_slice(&text).map_err(|error| bad(error.to_string()))?;
        if !(BY_TEXEL..=WITH_BLOCKS).contains(&manifest.version) {
            return Err(bad(format!("version {} is not read", manifest.version)));
        }
        for image in &manifest.images {
            let sides = [image.width, image.height].iter().all(|side| (1..=MAX_IMAGE_SIDE).contains(side));
            let plain = Path::new(&image.name).file_name() == Some(image.name.as_ref());
            if !sides || !plain || !(1..=4).contains(&image.channels) || !(1..=16).contains(&image.levels) {
                return Err(bad(format!("image {} cannot be", image.name)));
            }
        }
        let tiles =
            manifest.images.iter().flat_map(|image| image.tiles.iter().map(move |tile| (image, tile)));
        for (image, tile) in tiles {
            let inside = |start: u32, length: u32, whole: u32| {
                length > 0 && u64::from(start) + u64::from(length) <= u64::from(whole)
            };
            let plain = Path::new(&tile.file).file_name() == Some(tile.file.as_ref());
            if !inside(tile.x, tile.width, image.width)
                || !inside(tile.y, tile.height, image.height)
                || !plain
                || tile.category as usize >= manifest.categories.len()
            {
                return Err(bad(format!("image {} has a tile that cannot be", image.name)));
            }
        }
        Ok(manifest)
    }

    /// Makes this the manifest of the bank in `dir`: from then on it counts.
    pub(crate) fn commit(&mut self, dir: &Path) -> Result<(), CliError> {
        let path = dir.join(MANIFEST);
        let by_block = |image: &Image| image.access() == Access::Block;
        self.version = if self.images.iter().any(by_block) { WITH_BLOCKS } else { BY_TEXEL };
        let text = serde_json::to_vec(self)
            .map_err(|source| CliError::Write { path: path.clone(), source: source.into() })?;
        write_whole(&path, &text)?;
        // The rename itself reaches the disk with the folder.
        if let Ok(folder) = std::fs::File::open(dir) {
            let _ = folder.sync_all();
        }
        Ok(())
    }
}
