//! `bank.json`: what a bank holds.

use std::collections::HashSet;
use std::path::Path;

use base64::prelude::{BASE64_STANDARD, Engine};
use serde::{Deserialize, Serialize};
use texfold_core::container::MAX_GEOREFERENCE;
use texfold_core::{Access, MAX_IMAGE_SIDE};

use super::category::{COLOURS, Category};
use crate::error::CliError;
use crate::files;
use crate::input::georeference::Georeference;
use crate::output::write_whole;
use crate::report::Row;

/// Name of the manifest in a bank's folder.
pub(crate) const MANIFEST: &str = "bank.json";
/// The version of a manifest whose images are all read by texel.
const BY_TEXEL: u32 = 1;
/// The version of one that has images by block.
const WITH_BLOCKS: u32 = 2;

/// Most of what numbers of files and of tiles count to: far from where adding to them wraps.
const MOST_NUMBER: u32 = 1 << 31;
/// Most rows of a codebook and cells of a tile.
const MOST_ROWS: u32 = 1 << 20;
/// Most letters of a georeference.
const MOST_BASE64: usize = MAX_GEOREFERENCE.div_ceil(3) * 4;

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
    /// Bytes of its georeference, as a texture's notes hold them, in base64; empty where there is none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub(crate) georeference: String,
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

/// True for text without control characters.
pub(super) fn is_printable(text: &str) -> bool {
    !text.chars().any(char::is_control)
}

/// True for the name of a file in the bank's own folder.
fn is_plain(name: &str) -> bool {
    Path::new(name).file_name() == Some(name.as_ref()) && is_printable(name) && !is_device(name)
}

/// True for the name of a device on Windows, which may have an extension: a bank goes from one system to another.
pub(super) fn is_device(name: &str) -> bool {
    let stem = name.split('.').next().unwrap_or_default().trim_end().to_ascii_uppercase();
    let numbered = ["COM", "LPT"].iter().filter_map(|device| stem.strip_prefix(device));
    matches!(stem.as_str(), "CON" | "PRN" | "AUX" | "NUL")
        || numbered.into_iter().any(|number| matches!(number.as_bytes(), [b'1'..=b'9']))
}

/// The number of a file of the bank: `image-000012.txf`, `category-001-000012.txf`.
fn number_of(name: &str) -> Option<u32> {
    name.strip_suffix(".txf")?.rsplit_once('-')?.1.parse().ok()
}

impl Image {
    /// How its texels are reached.
    pub(crate) fn access(&self) -> Access {
        if self.row.access == Access::Block.name() { Access::Block } else { Access::Texel }
    }

    /// Its place on Earth and the meaning of its bands, where they are known.
    pub(crate) fn georeference(&self) -> Option<Georeference> {
        Georeference::parse(&BASE64_STANDARD.decode(&self.georeference).ok()?)
    }
}

impl Manifest {
    /// Reads the manifest of the bank in `dir`.
    pub(crate) fn read(dir: &Path) -> Result<Manifest, CliError> {
        let path = dir.join(MANIFEST);
        let text = files::read(&path)?;
        let bad = |what: String| CliError::BankManifest { path: path.clone(), what };
        let manifest: Manifest = serde_json::from_slice(&text).map_err(|error| bad(error.to_string()))?;
        if !(BY_TEXEL..=WITH_BLOCKS).contains(&manifest.version) {
            return Err(bad(format!("version {} is not read", manifest.version)));
        }
        if let Some(fault) = manifest.fault() {
            return Err(bad(fault));
        }
        Ok(manifest)
    }

    /// The first content that this program does not write.
    fn fault(&self) -> Option<String> {
        let (mut files, mut names) = (HashSet::new(), HashSet::new());
        for category in &self.categories {
            let file = category.file.as_deref();
            let known = category.name.as_deref().is_none_or(is_printable)
                && category.colours.len() == COLOURS
                && category.colours.iter().all(|share| share.is_finite())
                && category.tiles <= MOST_NUMBER
                && category.rows <= MOST_ROWS
                && file.is_none_or(|file| is_plain(file) && files.insert(file));
            if !known {
                let name = category.name.as_deref().unwrap_or("without a name");
                return Some(format!("category {} cannot be", name.escape_debug()));
            }
        }
        for image in &self.images {
            let sides = [image.width, image.height].iter().all(|side| (1..=MAX_IMAGE_SIDE).contains(side));
            let plain = is_plain(&image.name) && names.insert(image.name.as_str());
            let is_placed = image.georeference.is_empty()
                || (image.georeference.len() <= MOST_BASE64 && image.georeference().is_some());
            if !is_placed {
                return Some(format!("image {} has a georeference that cannot be", image.name));
            }
            if !sides || !plain || !(1..=4).contains(&image.channels) || !(1..=16).contains(&image.levels) {
                return Some(format!("image {} cannot be", image.name.escape_debug()));
            }
        }
        let tiles = self.images.iter().flat_map(|image| image.tiles.iter().map(move |tile| (image, tile)));
        for (image, tile) in tiles {
            let inside = |start: u32, length: u32, whole: u32| {
                length > 0 && u64::from(start) + u64::from(length) <= u64::from(whole)
            };
            let counts = tile.grown_rows <= MOST_ROWS
                && tile.own_cells <= MOST_ROWS
                && tile.blocks.iter().all(|&count| count <= u64::from(MOST_NUMBER));
            if !inside(tile.x, tile.width, image.width)
                || !inside(tile.y, tile.height, image.height)
                || !counts
                || !is_plain(&tile.file)
                || !files.insert(&tile.file)
                || tile.category as usize >= self.categories.len()
            {
                return Some(format!("image {} has a tile that cannot be", image.name));
            }
        }
        let listed = files.iter().filter_map(|name| number_of(name)).max();
        let free = listed.is_none_or(|listed| listed < self.next) && self.next <= MOST_NUMBER;
        (!free).then(|| format!("{} is no number for the next file", self.next))
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
