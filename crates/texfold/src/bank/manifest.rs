//! `bank.json`, the list of a bank. A foreign file: all of it is checked before it is used.

use std::collections::HashSet;
use std::path::Path;

use serde::de::{DeserializeOwned, IgnoredAny};
use serde::{Deserialize, Deserializer, Serialize};
use texfold_core::container::MAX_GEOREFERENCE;
use texfold_core::{ImageSize, MAX_IMAGE_SIDE, Rect};

/// Name of the manifest in a bank's folder.
pub const MANIFEST: &str = "bank.json";
/// The version of a manifest whose images are all read by texel.
const BY_TEXEL: u32 = 1;
/// The version of one that has images by block.
const WITH_BLOCKS: u32 = 2;

/// Most of what numbers of files and of tiles count to: far from where adding to them wraps.
const MOST_NUMBER: u32 = 1 << 31;
/// Most rows of a codebook and cells of a tile.
const MOST_ROWS: u32 = 1 << 20;
/// Shares of colours of a category.
const COLOURS: usize = 64;
/// Most letters of a georeference.
const MOST_BASE64: usize = MAX_GEOREFERENCE.div_ceil(3) * 4;

/// List of a bank's categories and images. `Row` is the report of each image, of the program that added it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest<Row = Unread> {
    /// Version of the format: 1, or 2 where images are stored by block.
    pub version: u32,
    /// Number of the next file, so that no name is used twice.
    pub next: u32,
    /// Groups of tiles that look alike.
    pub categories: Vec<Category>,
    /// Images in the order in which they were added.
    pub images: Vec<Image<Row>>,
}

impl<Row> Default for Manifest<Row> {
    fn default() -> Self {
        Manifest { version: BY_TEXEL, next: 0, categories: Vec::new(), images: Vec::new() }
    }
}

/// A row that is not read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unread;

impl<'de> Deserialize<'de> for Unread {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        IgnoredAny::deserialize(from).map(|_| Unread)
    }
}

/// Images that look alike share a public codebook.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Category {
    /// Name that the user gave it; `None` where colours alone made it.
    #[serde(default)]
    pub name: Option<String>,
    /// Shares of 4 x 4 x 4 ranges of red, green and blue.
    pub colours: Vec<f32>,
    /// Tiles that joined it.
    pub tiles: u32,
    /// File of its codebook; `None` while nothing recurs.
    pub file: Option<String>,
    /// Rows of texels of the codebook.
    pub rows: u32,
}

/// One image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Image<Row = Unread> {
    /// Name of its file without folder and extension.
    pub name: String,
    /// Hash of its file and of the settings.
    pub key: String,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Channels, 1 to 4; tiles that are opaque have no alpha.
    pub channels: u8,
    /// Mip levels that all tiles have, 1 to 16.
    pub levels: u32,
    /// Bytes of its georeference, as a texture's notes hold them, in base64; empty where there is none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub georeference: String,
    /// Tiles, row by row.
    pub tiles: Vec<Tile>,
    /// Its report.
    pub row: Row,
}

/// A part of an image, in a file of its own. Its corner is a multiple of 1024 texels.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tile {
    /// File in the bank's folder.
    pub file: String,
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Number of its category.
    pub category: u32,
    /// Rows of texels that it added to the public codebook.
    pub grown_rows: u32,
    /// Cells of its own codebook.
    pub own_cells: u32,
    /// Blocks that use the public codebook, its own, and all of them.
    pub blocks: [u64; 3],
}

impl Tile {
    /// Its rectangle in a level of its image.
    #[must_use]
    pub fn at_level(&self, level: u32) -> Rect {
        let ImageSize { width, height } =
            ImageSize { width: self.width, height: self.height }.at_level(level);
        let [x, y] = [self.x, self.y].map(|start| start.checked_shr(level).unwrap_or(0));
        Rect { image: 0, level, x, y, width, height }
    }
}

/// True for text without control characters.
#[doc(hidden)]
#[must_use]
pub fn is_printable(text: &str) -> bool {
    !text.chars().any(char::is_control)
}

/// True for the name of a file in the bank's own folder.
fn is_plain(name: &str) -> bool {
    Path::new(name).file_name() == Some(name.as_ref()) && is_printable(name) && !is_device(name)
}

/// True for the name of a device on Windows, which may have an extension: a bank goes from one system to another.
#[doc(hidden)]
#[must_use]
pub fn is_device(name: &str) -> bool {
    let stem = name.split('.').next().unwrap_or_default().trim_end().to_ascii_uppercase();
    let numbered = ["COM", "LPT"].iter().filter_map(|device| stem.strip_prefix(device));
    matches!(stem.as_str(), "CON" | "PRN" | "AUX" | "NUL")
        || numbered.into_iter().any(|number| matches!(number.as_bytes(), [b'1'..=b'9']))
}

/// The number of a file of the bank: `image-000012.txf`, `category-001-000012.txf`.
fn number_of(name: &str) -> Option<u32> {
    name.strip_suffix(".txf")?.rsplit_once('-')?.1.parse().ok()
}

impl<Row: DeserializeOwned> Manifest<Row> {
    /// Reads and checks a manifest.
    ///
    /// # Errors
    /// The first fault, in words.
    pub fn parse(json: &[u8]) -> Result<Manifest<Row>, String> {
        let manifest: Manifest<Row> = serde_json::from_slice(json).map_err(|error| error.to_string())?;
        if !(BY_TEXEL..=WITH_BLOCKS).contains(&manifest.version) {
            return Err(format!("version {} is not read", manifest.version));
        }
        match manifest.fault() {
            Some(fault) => Err(fault),
            None => Ok(manifest),
        }
    }
}

impl<Row> Manifest<Row> {
    /// Sets the version that a manifest with images by block has, or without.
    #[doc(hidden)]
    pub fn set_version(&mut self, has_blocks: bool) {
        self.version = if has_blocks { WITH_BLOCKS } else { BY_TEXEL };
    }

    /// The first content that no bank has.
    pub(super) fn fault(&self) -> Option<String> {
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
            if image.georeference.len() > MOST_BASE64 {
                return Some(format!(
                    "image {} has a georeference that cannot be",
                    image.name.escape_debug()
                ));
            }
            if !sides || !plain || !(1..=4).contains(&image.channels) || !(1..=16).contains(&image.levels) {
                return Some(format!("image {} cannot be", image.name.escape_debug()));
            }
        }
        let area = |width: u32, height: u32| u64::from(width) * u64::from(height);
        let covers = |image: &&Image<Row>| {
            // Some 2^31 tiles of 2^30 texels do not wrap.
            let tiles: u64 = image.tiles.iter().map(|tile| area(tile.width, tile.height)).sum();
            tiles == area(image.width, image.height)
        };
        if let Some(image) = self.images.iter().find(|image| !covers(image)) {
            return Some(format!("the tiles of image {} do not cover it", image.name));
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
}
