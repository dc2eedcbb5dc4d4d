//! Adding images to banks.
//!
//! An image is added by writing files of new names, each whole and on the disk, and then renaming a new `bank.json` over the old: a
//! crash at any time leaves the bank as it was before that image. One process at a time adds, held off by a lock on `bank.lock`
//! that the system gives back when the process ends, however it ends.
//!
//! ```no_run
//! use texfold::bank::{BankWriter, NewImage};
//! use texfold::dct::Dct;
//! use texfold::{ColorSpace, EncodeSettings, Goal, Raster};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let land = Raster::from_u8(4096, 4096, 3, ColorSpace::Srgb, &vec![90; 3 << 24])?;
//! let settings = EncodeSettings { goal: Goal::Psnr(36.0), mips: true, ..EncodeSettings::default() };
//! let mut bank: BankWriter = BankWriter::open("target/bank".as_ref())?;
//! let image = NewImage { name: "land", key: "2026-11-28", ..NewImage::default() };
//! bank.add_blocks(&image, &land, &settings.params::<Dct>())?;
//! # Ok(())
//! # }
//! ```

mod blocks;
mod category;
mod cuts;
mod error;
mod report;
mod texels;
mod whole;

use std::collections::HashSet;
use std::fs::{self, File};
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;
use texfold_core::container::SectionWriter;
use texfold_core::image::{Depth, Raster};
use texfold_core::{Access, Encoded, Image2d, ImageSize, Job, MAX_IMAGE_SIDE};
use texfold_dct::DctParams;
use texfold_progressive::ProgressiveParams;

#[doc(hidden)]
pub use self::blocks::without_plain_alpha;
pub use self::blocks::{
    FoundBlocks, StepErrors, block_source, block_tile, encode_blocks, search_blocks, search_tiles,
    step_errors,
};
pub use self::category::{Categories, colours};
pub use self::cuts::{LEAST_SIDE, TILE_SIDE, around, cuts, tile_rects};
pub use self::error::WriteError;
pub use self::report::{Report, Sums};
pub use self::texels::{Codebooks, Grown, TexelTile, TexelTiles};
use self::whole::write_whole;
#[doc(hidden)]
pub use self::whole::{remove_stale, write_and_rename};
use super::{Bank, BankError, Category, Image, MANIFEST, Manifest, Tile, is_device, is_printable};

/// Name of the file that is locked while images are added.
const LOCK: &str = "bank.lock";

/// An image that can be read from top to bottom, as often as an encoder asks. A [`Raster`] is one.
pub trait TileSource {
    /// Causes for which it cannot be read.
    type Error: From<WriteError>;

    /// Hands its tiles ([`tile_rects`]) to `take`, row by row, with `apron` texels around each; its size.
    ///
    /// # Errors
    /// Its own, and whatever `take` returns, at once.
    fn each_tile(
        &self,
        apron: u32,
        take: &mut dyn FnMut(SourceTile) -> Result<(), Self::Error>,
    ) -> Result<ImageSize, Self::Error>;
}

/// A tile of an image that is added.
#[derive(Debug)]
pub struct SourceTile {
    /// Its first column and row.
    pub place: (u32, u32),
    /// Its texels.
    pub texels: Raster,
    /// The tile with the texels around it ([`around`]), where they are asked for and the image is more than this tile.
    pub around: Option<Raster>,
}

impl TileSource for Raster {
    type Error = WriteError;

    fn each_tile(
        &self,
        apron: u32,
        take: &mut dyn FnMut(SourceTile) -> Result<(), WriteError>,
    ) -> Result<ImageSize, WriteError> {
        let size = self.size();
        for rect in tile_rects(size) {
            let more = apron > 0 && (rect.width, rect.height) != (size.width, size.height);
            let columns = || around((rect.x, rect.width), apron, size.width);
            let rows = || around((rect.y, rect.height), apron, size.height);
            let around = more.then(|| self.pick(&columns(), &rows()));
            take(SourceTile { place: (rect.x, rect.y), texels: self.crop(rect), around })?;
        }
        Ok(size)
    }
}

/// An image that is added.
#[derive(Debug, Clone, Copy, Default)]
pub struct NewImage<'n> {
    /// Its name, unlike those of other images: that of a file without folder and extension.
    pub name: &'n str,
    /// Text that says what its stored form depends on, such as a hash of its texels and settings: an image of the same name and key is there already.
    pub key: &'n str,
    /// The category that all of its tiles join; without one each joins that of the nearest colours.
    pub category: Option<&'n str>,
    /// The TIFF of one texel with its GeoTIFF tags, in base64; empty where there are none.
    pub georeference: &'n str,
    /// Whether it takes the place of an image of its name with another key.
    pub replaces: bool,
}

/// Runs of columns and of rows of the part of a tile that stands for it, and the length of each.
const SAMPLE_RUNS: (u32, u32) = (4, 64);
/// Most parts that stand for an image: they take 34 MB in 16 bits.
const MOST_SAMPLES: usize = 64;

/// Colours, depth, peak and samples of the tiles of an image, which encoding needs before it begins.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Seen {
    /// Shares of colours of each tile, row by row ([`colours`]).
    pub colours: Vec<Vec<f32>>,
    /// Bits of its samples.
    pub depth: Depth,
    /// The largest own peak of its tiles ([`Raster::own_peak`]).
    pub peak: f32,
    /// A part of every tile, or of one in [`sample_stride`]: [`sampled`] columns and rows.
    pub samples: Vec<Raster>,
}

impl Seen {
    /// Takes a tile in.
    pub fn add(&mut self, tile: &Raster) {
        let number = self.colours.len();
        self.colours.push(colours(tile));
        self.depth = tile.info().depth;
        self.peak = self.peak.max(tile.own_peak());
        let (before, stride) = (sample_stride(number), sample_stride(number + 1));
        if stride > before {
            let mut number = 0;
            self.samples.retain(|_| {
                number += 1;
                number % 2 == 1
            });
        }
        if number.is_multiple_of(stride) {
            let ImageSize { width, height } = tile.size();
            self.samples.push(tile.pick(&sampled(width), &sampled(height)));
        }
    }
}

/// The columns that stand for so many columns of a tile, or the rows: all of few, else runs that are spread evenly.
#[must_use]
pub fn sampled(length: u32) -> Vec<u32> {
    let (runs, each) = SAMPLE_RUNS;
    if length <= runs * each {
        return (0..length).collect();
    }
    let first = |run: u32| (2 * run + 1) * length / (2 * runs) - each / 2;
    (0..runs).flat_map(|run| first(run)..first(run) + each).collect()
}

/// Of so many tiles one in how many is sampled, from the first on: a power of two.
#[must_use]
pub fn sample_stride(tiles: usize) -> usize {
    tiles.div_ceil(MOST_SAMPLES).next_power_of_two()
}

/// A bank that images are added to; it is locked while this lives.
#[derive(Debug)]
pub struct BankWriter<Row = Report> {
    bank: Bank<Row>,
    _lock: File,
}

impl<Row: DeserializeOwned> BankWriter<Row> {
    /// Opens or begins the bank in a folder, and takes away what an interrupted process left there.
    ///
    /// # Errors
    /// [`WriteError::Locked`] while another process adds; [`WriteError::Write`], [`WriteError::Bank`].
    pub fn open(dir: &Path) -> Result<BankWriter<Row>, WriteError> {
        fs::create_dir_all(dir).map_err(|source| WriteError::Write { path: dir.to_owned(), source })?;
        let lock = lock(dir)?;
        remove_stale(dir);
        let bank = match dir.join(MANIFEST).exists() {
            true => Bank::open(dir)?,
            false => Bank::of(dir, Manifest::default()),
        };
        let writer = BankWriter { bank, _lock: lock };
        writer.remove_leftovers();
        Ok(writer)
    }
}

impl<Row> BankWriter<Row> {
    /// What is listed.
    #[must_use]
    pub fn bank(&self) -> &Bank<Row> {
        &self.bank
    }

    /// The same bank with categories that are in no file before an image is listed.
    #[doc(hidden)]
    pub fn set_categories(&mut self, categories: Vec<Category>)
    where
        Row: Clone,
    {
        let manifest = Manifest { categories, ..self.bank.manifest().clone() };
        self.bank = Bank::of(self.bank.dir(), manifest);
    }

    /// Removes files of banks that the manifest does not name. Others are left alone.
    fn remove_leftovers(&self) {
        let manifest = self.bank.manifest();
        let tiles = manifest.images.iter().flat_map(|image| &image.tiles).map(|tile| tile.file.as_str());
        let books = manifest.categories.iter().filter_map(|category| category.file.as_deref());
        let named: HashSet<&str> = tiles.chain(books).collect();
        let Ok(entries) = fs::read_dir(self.bank.dir()) else { return };
        for entry in entries.flatten() {
            let name = entry.file_name();
            let ours = name.to_str().is_some_and(|name| {
                (name.starts_with("image-") || name.starts_with("category-")) && name.ends_with(".txf")
            });
            if ours && name.to_str().is_some_and(|name| !named.contains(name)) {
                // A file that cannot be removed does no harm: nothing names it.
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}

impl<Row: Serialize + Clone> BankWriter<Row> {
    /// Lists an image whose files are written, in the place of one of its name: from then on it counts. `grown` are the categories that its tiles
    /// join; `next` is the number of the first file that is not the image's. The tiles of an image before it are removed after that; what it added to
    /// codebooks stays, as others may use it.
    ///
    /// # Errors
    /// [`WriteError::Entry`], [`WriteError::Write`].
    pub fn list(
        &mut self,
        image: Image<Row>,
        next: u32,
        has_blocks: impl Fn(&Image<Row>) -> bool,
        grown: &[Grown],
    ) -> Result<(), WriteError> {
        let mut manifest = self.bank.manifest().clone();
        grown.iter().for_each(|grown| grown.enter(&mut manifest.categories));
        let same = manifest.images.iter_mut().find(|known| known.name == image.name);
        let before = match same {
            Some(known) => std::mem::replace(known, image).tiles,
            None => {
                manifest.images.push(image);
                Vec::new()
            }
        };
        for tile in &before {
            let category = &mut manifest.categories[tile.category as usize];
            category.tiles = category.tiles.saturating_sub(1);
        }
        manifest.next = manifest.next.max(next);
        if let Some(what) = manifest.fault() {
            return Err(WriteError::Entry { what });
        }
        let has_blocks = manifest.images.iter().any(has_blocks);
        manifest.set_version(has_blocks);
        let dir = self.bank.dir().to_owned();
        let path = dir.join(MANIFEST);
        let failed = |source| WriteError::Write { path: path.clone(), source };
        let text = serde_json::to_vec(&manifest).map_err(|source| failed(source.into()))?;
        write_whole(&path, &text).map_err(failed)?;
        // The rename itself reaches the disk with the folder.
        if let Ok(folder) = File::open(&dir) {
            let _ = folder.sync_all();
        }
        self.bank = Bank::of(&dir, manifest);
        for tile in before {
            // A file that cannot be removed does no harm: nothing names it.
            let _ = fs::remove_file(dir.join(tile.file));
        }
        Ok(())
    }
}

impl BankWriter<Report> {
    /// Adds an image by block: all tiles with the step with which the image as a whole meets the goal. It is read some four times: once
    /// for each step that is measured, mostly two, and twice more. False where an image of the same name and key is there already.
    ///
    /// # Errors
    /// [`WriteError`], and those of the source.
    pub fn add_blocks<S: TileSource>(
        &mut self,
        image: &NewImage<'_>,
        source: &S,
        params: &DctParams,
    ) -> Result<bool, S::Error> {
        let Some((seen, categories)) = self.begin(image, source)? else { return Ok(false) };
        let found = search_blocks(source, params, &seen)?;
        let met = found.met;
        let dir = self.bank.dir().to_owned();
        let first = self.bank.manifest().next;
        let (mut sums, mut tiles, mut next) = (Sums::default(), Vec::new(), first);
        let size = encode_blocks(source, params, found, &seen, |place, set, images| {
            let category = *categories.get(tiles.len()).ok_or(WriteError::Changed)?;
            sums.add(&set, &images, 0);
            let size = set.images()[0].size();
            tiles.push(block_tile_entry(write_tile(&images, &dir, &mut next)?, place, size, category));
            Ok(())
        })?;
        let end = first + 2 * categories.len() as u32;
        self.list_blocks(image, (size, tiles), &sums.report(Access::Block, Some(met)), end)?;
        Ok(true)
    }

    /// Adds an image by texel: each tile meets the goal by itself, with the public codebook of its category, which grows by what is new in
    /// it. The image is read twice. False where an image of the same name and key is there already.
    ///
    /// # Errors
    /// [`WriteError`], and those of the source.
    pub fn add_texels<S: TileSource>(
        &mut self,
        image: &NewImage<'_>,
        source: &S,
        params: &ProgressiveParams,
        job: &mut Job<'_>,
    ) -> Result<bool, S::Error> {
        let Some((seen, categories)) = self.begin(image, source)? else { return Ok(false) };
        let books = categories.iter().map(|&number| Ok((number, self.bank.codebook(number)?)));
        let codebooks = books.collect::<Result<Codebooks, BankError>>().map_err(WriteError::from)?;
        let (dir, first) = (self.bank.dir().to_owned(), self.bank.manifest().next);
        let Seen { peak, .. } = seen;
        let encode =
            TexelTiles { params, dir: &dir, first, peak, categories: &categories, codebooks: &codebooks };
        let (mut sums, mut tiles) = (Sums::default(), Vec::new());
        let (size, grown) = encode.encode(source, job, |tile| {
            sums.add(&tile.source, &tile.texture, tile.grown_bits);
            tiles.push(tile.entry);
            Ok(())
        })?;
        let end = first + 2 * categories.len() as u32;
        self.list_tiles(image, (size, tiles), &sums.report(Access::Texel, None), end, &grown)?;
        Ok(true)
    }

    /// Colours and samples of an image that is to be added, and the categories of its tiles; `None` of one that is there already.
    fn begin<S: TileSource>(
        &mut self,
        image: &NewImage<'_>,
        source: &S,
    ) -> Result<Option<(Seen, Vec<usize>)>, S::Error> {
        if !self.is_new(image)? {
            return Ok(None);
        }
        let mut seen = Seen::default();
        let size = source.each_tile(0, &mut |tile| {
            seen.add(&tile.texels);
            Ok(())
        })?;
        check_size(size)?;
        let categories = self.categories_for(image, &seen)?;
        Ok(Some((seen, categories)))
    }

    /// Whether an image is to be added: false where it is there already.
    ///
    /// # Errors
    /// [`WriteError::Name`], [`WriteError::Known`].
    pub fn is_new(&self, image: &NewImage<'_>) -> Result<bool, WriteError> {
        let is_file = Path::new(image.name).file_name() == Some(image.name.as_ref());
        let named = [Some(image.name), image.category].into_iter().flatten();
        if let Some(name) =
            named.into_iter().find(|name| !is_printable(name) || is_device(image.name) || !is_file)
        {
            return Err(WriteError::Name { name: name.to_owned() });
        }
        match self.bank.images().iter().find(|known| known.name == image.name) {
            Some(known) if known.key == image.key => {
                Ok(!known.tiles.iter().all(|tile| self.bank.path_of(tile).exists()))
            }
            Some(_) if !image.replaces => Err(WriteError::Known { name: image.name.to_owned() }),
            _ => Ok(true),
        }
    }

    /// The categories that the tiles of an image join, row by row.
    ///
    /// # Errors
    /// [`WriteError::Categories`].
    pub fn categories_for(&mut self, image: &NewImage<'_>, seen: &Seen) -> Result<Vec<usize>, WriteError> {
        let mut categories = Categories::of(self.bank.manifest().categories.clone());
        if let Some(name) = image.category {
            categories.name(name, &seen.colours);
        } else {
            categories.begin(&seen.colours);
        }
        let joined = categories.join(image.category, &seen.colours)?;
        self.set_categories(categories.into_inner());
        Ok(joined)
    }

    /// Lists an image by block whose tiles are written; `end` is the number of the first file that is not its own.
    ///
    /// # Errors
    /// [`WriteError::Entry`], [`WriteError::Write`].
    pub fn list_blocks(
        &mut self,
        image: &NewImage<'_>,
        (size, tiles): (ImageSize, Vec<Tile>),
        report: &Report,
        end: u32,
    ) -> Result<(), WriteError> {
        let joined: Vec<usize> = tiles.iter().map(|tile| tile.category as usize).collect();
        self.list_tiles(image, (size, tiles), report, end, &Grown::of_tiles(&joined))
    }

    fn list_tiles(
        &mut self,
        image: &NewImage<'_>,
        (size, tiles): (ImageSize, Vec<Tile>),
        report: &Report,
        end: u32,
        grown: &[Grown],
    ) -> Result<(), WriteError> {
        let image = Image {
            name: image.name.to_owned(),
            key: image.key.to_owned(),
            width: size.width,
            height: size.height,
            channels: report.channels,
            levels: report.levels,
            georeference: image.georeference.to_owned(),
            tiles,
            row: report.clone(),
        };
        self.list(image, end, Report::is_by_block, grown)
    }
}

/// Refuses an image that is larger than those of banks, before work is done for it.
///
/// # Errors
/// [`WriteError::Entry`].
pub fn check_size(size: ImageSize) -> Result<(), WriteError> {
    if size.width.max(size.height) <= MAX_IMAGE_SIDE {
        return Ok(());
    }
    let ImageSize { width, height } = size;
    Err(WriteError::Entry { what: format!("{width} x {height} texels; a side has at most {MAX_IMAGE_SIDE}") })
}

/// The entry of a tile by block in the list of a bank.
#[must_use]
pub fn block_tile_entry(file: String, (x, y): (u32, u32), size: ImageSize, category: usize) -> Tile {
    let ImageSize { width, height } = size;
    Tile { file, x, y, width, height, category: category as u32, grown_rows: 0, own_cells: 0, blocks: [0; 3] }
}

/// Name of the file of a tile by its number.
#[must_use]
pub fn tile_file(number: u32) -> String {
    format!("image-{number:06}.txf")
}

/// Writes the file of a tile, whole, and counts its number up; its name.
///
/// # Errors
/// [`WriteError::Write`].
pub fn write_tile(
    texture: &dyn Encoded<Domain = Image2d>,
    dir: &Path,
    next: &mut u32,
) -> Result<String, WriteError> {
    let file = tile_file(*next);
    *next += 1;
    let mut writer = SectionWriter::new(texture.codec());
    texture.store(&mut writer);
    let path = dir.join(&file);
    write_whole(&path, &writer.finish().bytes).map_err(|source| WriteError::Write { path, source })?;
    Ok(file)
}

/// Takes the lock of a bank.
fn lock(dir: &Path) -> Result<File, WriteError> {
    let path = dir.join(LOCK);
    let failed = |source| WriteError::Write { path: path.clone(), source };
    let file = File::options().create(true).append(true).open(&path).map_err(failed)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(fs::TryLockError::WouldBlock) => Err(WriteError::Locked { path: dir.to_owned() }),
        Err(fs::TryLockError::Error(source)) => Err(failed(source)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::image::ColorSpace;

    #[test]
    fn samples_are_of_every_tile_or_of_one_in_some() {
        for (tiles, stride) in [(1, 1), (64, 1), (65, 2), (128, 2), (129, 4), (300, 8)] {
            assert_eq!(sample_stride(tiles), stride);
            let mut seen = Seen::default();
            for number in 0..tiles {
                let bytes = vec![(number % 251) as u8; 300 * 2];
                seen.add(&Raster::from_u8(300, 2, 1, ColorSpace::Srgb, &bytes).unwrap());
            }
            let found: Vec<u8> = seen.samples.iter().map(|sample| sample.to_bytes()[0]).collect();
            let wanted: Vec<u8> = (0..tiles).step_by(stride).map(|number| (number % 251) as u8).collect();
            assert_eq!(found, wanted, "{tiles}");
            assert_eq!(seen.samples[0].size(), ImageSize { width: 256, height: 2 });
        }
        for length in [1, 255, 256, 257, 1024, 1279] {
            let columns = sampled(length);
            assert!(columns.is_sorted() && columns.iter().all(|&column| column < length), "{length}");
            assert_eq!(columns.len() as u32, length.min(256));
            let ends = columns[0].abs_diff(length - 1 - columns[columns.len() - 1]);
            assert!(ends <= 1, "{length}: not in the middle");
        }
    }

    #[test]
    fn one_process_at_a_time_adds() {
        let dir = tempfile::tempdir().unwrap();
        let first: BankWriter = BankWriter::open(dir.path()).unwrap();
        assert!(matches!(BankWriter::<Report>::open(dir.path()), Err(WriteError::Locked { .. })));
        drop(first);
        assert!(BankWriter::<Report>::open(dir.path()).is_ok());
    }

    #[test]
    fn leftovers_of_an_interrupted_run_go_and_other_files_stay() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["image-0007.txf", "category-000-0001.txf", "notes.txt", "photo.txf"] {
            fs::write(dir.path().join(name), b"x").unwrap();
        }
        drop(BankWriter::<Report>::open(dir.path()).unwrap());
        let there = |name: &str| dir.path().join(name).exists();
        assert!(!there("image-0007.txf") && !there("category-000-0001.txf"));
        assert!(there("notes.txt") && there("photo.txf"));
    }
}
