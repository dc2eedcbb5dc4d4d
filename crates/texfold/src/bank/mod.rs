//! Banks: folders of many large images, each in tiles of about 1024 texels a side, which are files of their own (the public codebooks and the tiles of the
//! progressive paper, sections 4 and 5).
//!
//! A [`Bank`] is a list until something of it is asked for: opening one of a gigatexel reads `bank.json` alone. [`Bank::decode`] reads
//! the tiles that a rectangle of a level touches; a renderer reads those in view itself, one by one ([`Bank::tile`]).
//!
//! ```no_run
//! use texfold::bank::Bank;
//! use texfold::{Rect, Texel};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let bank: Bank = Bank::open("target/bank".as_ref())?;
//! for (number, image) in bank.images().iter().enumerate() {
//!     println!("{}: {} x {}, {} tiles", image.name, image.width, image.height, image.tiles.len());
//!     let rect = Rect { image: 0, level: image.levels - 1, x: 0, y: 0, width: 1, height: 1 };
//!     let mut texels = [Texel::ZERO];
//!     bank.decode(number, rect, &mut texels)?;
//! }
//! # Ok(())
//! # }
//! ```

mod files;
mod manifest;
#[cfg(feature = "encode")]
mod write;

use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use serde::de::DeserializeOwned;
use texfold_core::container::Sections;
use texfold_core::image::ImageLayout;
use texfold_core::{Budget, ImageSize, Limits, LoadError, Rect, RegionError, Texel, TextureCodec};
use texfold_progressive::{Codebook, Progressive};

use crate::{AnyImage, Arrived, Arriving, Registration};
#[doc(hidden)]
pub use files::{irregular, open as open_file};
pub use manifest::{Category, Image, MANIFEST, Manifest, Tile, Unread};
#[doc(hidden)]
pub use manifest::{is_device, is_printable};
#[cfg(feature = "encode")]
pub use write::*;

/// Bytes that are read at a time of a file whose first ones may suffice.
const PIECE: usize = 4096;

/// Causes for which a bank, or a part of it, cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BankError {
    /// A file cannot be read.
    #[error("{}: cannot be read; check the path and its permissions", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// `bank.json` holds what no bank has.
    #[error("{}: the bank's list of images cannot be read ({what}); restore it from a copy, or create the bank again", path.display())]
    Manifest {
        /// The manifest.
        path: PathBuf,
        /// The fault.
        what: String,
    },
    /// A tile or codebook is no file that can be loaded.
    #[error("{}: cannot be loaded", path.display())]
    Load {
        /// The file.
        path: PathBuf,
        /// The fault.
        source: LoadError,
    },
    /// An image, tile, level or rectangle is asked for that the bank does not have.
    #[error(transparent)]
    Region(#[from] RegionError),
}

/// A bank that is read. `Row` is the type of the report that its maker keeps of each image; [`Unread`] skips it.
#[derive(Debug)]
pub struct Bank<Row = Unread> {
    dir: PathBuf,
    manifest: Manifest<Row>,
    /// Public codebooks that have been read, by category.
    codebooks: Vec<OnceLock<Option<Arc<Codebook>>>>,
}

/// The part of a rectangle that lies in one tile.
#[derive(Debug, Clone, Copy)]
pub struct Part<'b> {
    /// The tile.
    pub tile: &'b Tile,
    /// The part, in texels of the tile's level.
    pub rect: Rect,
    /// The part's first column and row in the rectangle.
    pub corner: (u32, u32),
}

impl<Row: DeserializeOwned> Bank<Row> {
    /// Opens the bank in a folder: reads its list.
    ///
    /// # Errors
    /// [`BankError::Read`] and [`BankError::Manifest`].
    pub fn open(dir: &Path) -> Result<Bank<Row>, BankError> {
        let path = dir.join(MANIFEST);
        let json = read(&path)?;
        let manifest = Manifest::parse(&json).map_err(|what| BankError::Manifest { path, what })?;
        Ok(Bank::of(dir, manifest))
    }
}

impl<Row> Bank<Row> {
    /// The bank in a folder, with that list.
    #[doc(hidden)]
    #[must_use]
    pub fn of(dir: &Path, manifest: Manifest<Row>) -> Bank<Row> {
        let codebooks = manifest.categories.iter().map(|_| OnceLock::new()).collect();
        Bank { dir: dir.to_owned(), manifest, codebooks }
    }

    /// Its folder.
    #[must_use]
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Its list of categories and images.
    #[must_use]
    pub fn manifest(&self) -> &Manifest<Row> {
        &self.manifest
    }

    /// Its images, in the order in which they were added.
    #[must_use]
    pub fn images(&self) -> &[Image<Row>] {
        &self.manifest.images
    }

    /// The path of a tile's file.
    #[must_use]
    pub fn path_of(&self, tile: &Tile) -> PathBuf {
        self.dir.join(&tile.file)
    }

    /// The public codebook of a category, where it has one. Read once.
    ///
    /// # Errors
    /// [`BankError::Read`], [`BankError::Load`].
    pub fn codebook(&self, category: usize) -> Result<Option<Arc<Codebook>>, BankError> {
        let known = self.codebooks.get(category);
        if let Some(book) = known.and_then(OnceLock::get) {
            return Ok(book.clone());
        }
        let file = self.manifest.categories.get(category).and_then(|category| category.file.as_ref());
        let Some(file) = file else { return Ok(None) };
        let path = self.dir.join(file);
        let bytes = read(&path)?;
        let mut budget = Budget::default();
        let book = Sections::parse(&bytes, &mut budget)
            .and_then(|file| Progressive::load_codebook(&file, &mut budget))
            .map_err(|source| BankError::Load { path, source })?;
        let book = Some(Arc::new(book));
        Ok(known.map_or(book.clone(), |known| known.get_or_init(|| book).clone()))
    }

    /// A tile's texture, with the levels that it has.
    ///
    /// # Errors
    /// [`BankError::Read`], [`BankError::Load`], [`BankError::Manifest`] where the file is not the tile that is listed.
    pub fn tile(&self, tile: &Tile) -> Result<AnyImage, BankError> {
        let path = self.path_of(tile);
        let bytes = read(&path)?;
        let book = self.codebook(tile.category as usize)?;
        let texture = load(&bytes, book.as_deref()).map_err(|source| BankError::Load { path, source })?;
        self.checked(tile, texture)
    }

    /// The texture of a tile's file, if it is of its size.
    fn checked(&self, tile: &Tile, texture: AnyImage) -> Result<AnyImage, BankError> {
        let ImageLayout { images, .. } = texture.as_encoded().layout();
        if images.as_slice() != [ImageSize { width: tile.width, height: tile.height }] {
            let what = format!("{} is not the tile that is listed", tile.file);
            return Err(BankError::Manifest { path: self.dir.join(MANIFEST), what });
        }
        Ok(texture)
    }

    /// A tile's texture from as few bytes of its file as can be drawn: by block from the first layer, which shows coarse levels as [`Bank::tile`] does and fine ones blurred; by
    /// texel from all of them.
    ///
    /// # Errors
    /// As [`Bank::tile`].
    pub fn coarse_tile(&self, tile: &Tile) -> Result<AnyImage, BankError> {
        let path = self.path_of(tile);
        let failed = |source| BankError::Read { path: path.clone(), source };
        let mut file = files::open(&path).map_err(failed)?;
        let (mut arriving, mut piece) = (Arriving::new(Limits::default()), vec![0; PIECE]);
        loop {
            let length = file.read(&mut piece).map_err(failed)?;
            match arriving.push(&piece[..length]) {
                Ok(Arrived::Nothing) if length > 0 => {}
                Ok(Arrived::Nothing) | Err(_) => return self.tile(tile),
                Ok(_) => break,
            }
        }
        match arriving.into_texture() {
            Some(texture) => self.checked(tile, texture),
            None => self.tile(tile),
        }
    }

    /// The parts of a rectangle of a level, tile by tile; `rect.image` is the number of the image.
    ///
    /// # Errors
    /// [`RegionError`] where the bank has no such image, the image no such level, or that no such rectangle.
    pub fn parts(&self, rect: Rect) -> Result<impl Iterator<Item = Part<'_>>, RegionError> {
        let images = self.manifest.images.len();
        let image = self.manifest.images.get(rect.image as usize);
        let image = image.ok_or(RegionError::NoSuchImage { image: rect.image, images })?;
        let (level, levels) = (rect.level, image.levels);
        if level >= levels {
            return Err(RegionError::NoSuchLevel { level, levels });
        }
        let ImageSize { width, height } =
            ImageSize { width: image.width, height: image.height }.at_level(level);
        let inside = |start: u32, length: u32, whole: u32| {
            length > 0 && u64::from(start) + u64::from(length) <= u64::from(whole)
        };
        if !inside(rect.x, rect.width, width) || !inside(rect.y, rect.height, height) {
            return Err(RegionError::Outside { width, height });
        }
        Ok(image.tiles.iter().filter_map(move |tile| {
            let (part, corner) = shared(rect, tile.at_level(level))?;
            Some(Part { tile, rect: part, corner })
        }))
    }

    /// Decodes a rectangle of a level of an image, row by row, from the tiles that it touches; what no tile covers stays as it is. Tiles are read for each
    /// call: keep those ([`Bank::tile`]) that are needed again.
    ///
    /// # Errors
    /// [`BankError`] where the rectangle is not there, or a tile cannot be read; `texels` may have changed then.
    pub fn decode(&self, image: usize, rect: Rect, texels: &mut [Texel]) -> Result<(), BankError> {
        let rect = Rect { image: u32::try_from(image).unwrap_or(u32::MAX), ..rect };
        let parts: Vec<Part<'_>> = self.parts(rect)?.collect();
        let (found, needed) = (texels.len(), rect.width as usize * rect.height as usize);
        if needed != found {
            return Err(RegionError::OutputLength { found, needed }.into());
        }
        for Part { tile, rect: part, corner } in parts {
            let texture = self.tile(tile)?;
            let mut decoded = vec![Texel::ZERO; part.width as usize * part.height as usize];
            texture.as_encoded().decode(part, &mut decoded)?;
            let rows = texels.chunks_mut(rect.width as usize).skip(corner.1 as usize);
            for (row, decoded) in rows.zip(decoded.chunks(part.width as usize)) {
                row[corner.0 as usize..][..decoded.len()].copy_from_slice(decoded);
            }
        }
        Ok(())
    }
}

/// The bytes of a regular file.
fn read(path: &Path) -> Result<Vec<u8>, BankError> {
    let failed = |source| BankError::Read { path: path.to_owned(), source };
    let limit = Limits::default().bytes;
    let mut bytes = Vec::new();
    let file = files::open(path).map_err(failed)?;
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes).map_err(failed)?;
    Ok(bytes)
}

/// A tile from the bytes of its file.
fn load(bytes: &[u8], book: Option<&Codebook>) -> Result<AnyImage, LoadError> {
    let mut budget = Budget::default();
    let file = Sections::parse(bytes, &mut budget)?;
    if file.codec() == Progressive::ID.number {
        return Progressive::load_shared(&file, book, &mut budget).map(AnyImage::new);
    }
    let codec = Registration::by_number(file.codec());
    codec.ok_or(LoadError::NotThisCodec { found: file.codec() })?.load(&file, &mut budget)?.into_image()
}

/// The intersection of two rectangles: relative to the second's corner, and its corner relative to the first's.
fn shared(area: Rect, tile: Rect) -> Option<(Rect, (u32, u32))> {
    let (left, top) = (area.x.max(tile.x), area.y.max(tile.y));
    let width = (area.x + area.width).min(tile.x + tile.width).checked_sub(left).filter(|&side| side > 0)?;
    let height =
        (area.y + area.height).min(tile.y + tile.height).checked_sub(top).filter(|&side| side > 0)?;
    let part = Rect { x: left - tile.x, y: top - tile.y, width, height, ..tile };
    Some((part, (left - area.x, top - area.y)))
}
