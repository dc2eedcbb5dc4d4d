//! Images are added in three steps. First the categories of their tiles are found, for all images in order. Then each
//! is encoded tile by tile against the public codebooks of these: images that share none do not depend on one another
//! and are encoded at a time. Last, each is listed in `bank.json`, in order. What a bank comes to does not depend on
//! how many are encoded at a time.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use texfold_core::container::SectionWriter;
use texfold_core::image::{ImageSet, Raster};
use texfold_core::metric::{SquaredError, decode_surface, quality, ssim};
use texfold_core::{Access, Encoded, Job, Limits, TextureCodec};
use texfold_progressive::{Codebook, Progressive, ProgressiveParams, Shared, TexelTexture};

use super::manifest::{Image, Manifest, Tile};
use super::tiles::Cut;
use super::{Bank, Open, category, tiles};
use crate::compress::add_file;
use crate::error::{CliError, guarded};
use crate::output::write_whole;
use crate::perceptual::{mean, ssimulacra2};
use crate::progress::Share;
use crate::report::{PartRow, Row, peak_bytes};
use crate::settings::Settings;

/// Rows of texels that a public codebook may have: 512 of 256 texels are 64 kB in BC4.
const MOST_ROWS: u32 = 512;
/// Where k-means starts from.
const SEED: u64 = 0x7e8f_01d5;

/// Bytes that a texel of a band takes at most: as it is read, and as it is cut.
const BAND_BYTES: u64 = 12;
/// Bytes that encoding a tile takes: 160 MB for one of 1279 x 1279 texels, as measured, 210 MB with codebooks, and what
/// allocators keep.
const TILE_BYTES: u64 = 280 << 20;

/// An image that is to be in a bank.
#[derive(Debug)]
pub(crate) struct BankTask {
    pub(crate) path: PathBuf,
    pub(crate) name: String,
    /// The category that it is of, where that is said.
    pub(crate) category: Option<String>,
    pub(crate) settings: Settings,
}

/// What is known of the tiles of an image so far.
#[derive(Debug, Default)]
struct Sums {
    tiles: Vec<Tile>,
    color: SquaredError,
    alpha: Option<SquaredError>,
    worst_block_rms: f64,
    ssim: f64,
    /// SSIMULACRA2 and texels of each tile.
    ssimulacra2: Vec<(Option<f64>, f64)>,
    texels: u64,
    parts: Vec<PartRow>,
    channels: u8,
    levels: u32,
}

/// What is to be done with an image.
#[derive(Debug)]
pub(crate) enum Step {
    /// It is there already.
    Known(Box<Row>),
    /// It cannot be added.
    Failed(CliError),
    /// It is to be added, with file names by numbers from `first` on; the categories of its tiles, row by row.
    Add { key: String, first: u32, categories: Vec<usize> },
}

/// What an image is to have in a bank.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slot<'s> {
    /// Hash of all that its stored form depends on, but the codebooks.
    pub(crate) key: &'s str,
    /// Number of its first file.
    pub(crate) first: u32,
    /// Categories of its tiles, row by row.
    pub(crate) categories: &'s [usize],
}

/// An image that has been encoded, all but listed.
#[derive(Debug)]
pub(crate) struct Made {
    image: Image,
    grown: Vec<Grown>,
    /// Number of the first file that is not its own.
    end: u32,
}

/// A category with the codebook that an image leaves it with.
#[derive(Debug)]
struct Grown {
    number: usize,
    tiles: u32,
    book: Option<Arc<Codebook>>,
    /// File and rows, where it has grown.
    file: Option<(String, u32)>,
}

/// The key of an image that is to be added, and the colours of its tiles; else what is to be done with it.
type Seen = Result<(String, Vec<Vec<f32>>), Step>;

/// Finds out what is to be done with each image, and the categories of the tiles.
pub(crate) fn plan(open: &mut Open, tasks: &[&BankTask], limit_bytes: u64) -> Vec<Step> {
    let keys: Vec<Result<String, Step>> = tasks.iter().map(|task| task.key_of_new(open)).collect();
    let colours_of = |task: &BankTask| {
        let mut colours = Vec::new();
        let read = tiles::each(&task.path, &task.settings, limit_bytes, |cut| {
            colours.push(category::colours(&cut.tile));
            Ok(())
        });
        read.map(|_| colours)
    };
    let found = |(task, key): (&&BankTask, Result<String, Step>)| {
        let colours = guarded(&task.path, || colours_of(task));
        key.and_then(|key| Ok((key, colours.map_err(Step::Failed)?)))
    };
    let found: Vec<Seen> = tasks.iter().zip(keys).map(found).collect();
    let manifest = &mut open.bank.manifest;
    let known =
        || tasks.iter().zip(&found).filter_map(|(task, found)| Some((*task, &found.as_ref().ok()?.1)));
    let mut named = Vec::new();
    for (task, _) in known() {
        if let Some(name) = task.category.as_deref().filter(|name| !named.contains(name)) {
            let of_name = known().filter(|(task, _)| task.category.as_deref() == Some(name));
            let tiles: Vec<Vec<f32>> = of_name.flat_map(|(_, colours)| colours).cloned().collect();
            category::named(&mut manifest.categories, name, &tiles);
            named.push(name);
        }
    }
    if manifest.categories.is_empty() {
        let tiles: Vec<Vec<f32>> = known().flat_map(|(_, colours)| colours).cloned().collect();
        manifest.categories = category::divide(&tiles, SEED);
    }
    let mut first = manifest.next;
    let step = |(task, found): (&&BankTask, Seen)| match found {
        Ok((key, colours)) => task.step(manifest, key, &mut first, colours),
        Err(step) => step,
    };
    tasks.iter().zip(found).map(step).collect()
}

impl BankTask {
    /// Where tiles join categories, and which files are the image's: one for each tile, and one for each codebook that
    /// it grows.
    fn step(&self, manifest: &mut Manifest, key: String, next: &mut u32, colours: Vec<Vec<f32>>) -> Step {
        let first = *next;
        *next += 2 * colours.len() as u32;
        let categories: Vec<usize> = match &self.category {
            Some(name) => match category::named(&mut manifest.categories, name, &[]) {
                Some(number) => vec![number; colours.len()],
                None => {
                    let (path, most) = (self.path.clone(), category::MOST_NAMED);
                    return Step::Failed(CliError::BankCategories { path, most });
                }
            },
            None => {
                let join = |colours| category::join(&mut manifest.categories, colours);
                colours.into_iter().map(join).collect()
            }
        };
        Step::Add { key, first, categories }
    }

    /// The key of an image that is not there yet.
    fn key_of_new(&self, open: &Open) -> Result<String, Step> {
        let key = self.key().map_err(Step::Failed)?;
        match open.bank.manifest.images.iter().find(|image| image.name == self.name) {
            None => Ok(key),
            Some(known)
                if known.key == key
                    && known.tiles.iter().all(|tile| open.bank.dir.join(&tile.file).exists()) =>
            {
                Err(Step::Known(Box::new(known.row.clone())))
            }
            Some(_) => Err(Step::Failed(CliError::BankName { path: self.path.clone() })),
        }
    }

    fn params(&self) -> ProgressiveParams {
        self.settings.encode.params::<Progressive>()
    }

    /// About how many bytes it takes to add it: a band of the image, and a tile with all that is made of it.
    pub(crate) fn cost_bytes(&self) -> u64 {
        let width = crate::input::size_of(&self.path).map_or(0, |size| u64::from(size.width));
        width * u64::from(tiles::MOST_ROWS) * BAND_BYTES + TILE_BYTES
    }

    /// Whether it uses what other images have brought.
    pub(crate) fn depends(&self) -> bool {
        self.params().tries_codebooks()
    }

    /// Encodes the image, and writes its files.
    pub(crate) fn make(
        &self,
        bank: &Bank,
        books: &Books,
        slot: Slot<'_>,
        limit_bytes: u64,
        share: &Share<'_>,
    ) -> Result<Made, CliError> {
        let start = Instant::now();
        let Slot { key, first, categories } = slot;
        let mut making =
            Making { task: self, dir: &bank.dir, next: first, grown: Vec::new(), sums: Sums::default() };
        let mut of_tile = categories.iter();
        let size = tiles::each(&self.path, &self.settings, limit_bytes, |cut| {
            // The file has changed since its tiles were counted.
            let changed = || CliError::BankName { path: self.path.clone() };
            let (x, y) = cut.place;
            let at = At { x, y, category: *of_tile.next().ok_or_else(changed)? };
            making.enter(at.category, books);
            making.add_tile(at, cut, share)
        })?;
        let Making { sums, grown, .. } = making;
        let row = self.row(&bank.dir, &sums, (size.width, size.height), start.elapsed().as_secs_f64());
        let image = Image {
            name: self.name.clone(),
            key: key.to_owned(),
            width: size.width,
            height: size.height,
            channels: sums.channels,
            levels: sums.levels,
            tiles: sums.tiles,
            row,
        };
        Ok(Made { image, grown, end: first + 2 * categories.len() as u32 })
    }
}

impl Open {
    /// Lists an image that has been made: from then on it counts.
    pub(crate) fn commit(&mut self, made: Made) -> Result<Row, CliError> {
        let mut manifest = self.bank.manifest.clone();
        for grown in &made.grown {
            let category = &mut manifest.categories[grown.number];
            category.tiles += grown.tiles;
            if let Some((file, rows)) = &grown.file {
                (category.file, category.rows) = (Some(file.clone()), *rows);
            }
        }
        let row = made.image.row.clone();
        manifest.images.push(made.image);
        manifest.next = manifest.next.max(made.end);
        manifest.commit(&self.bank.dir)?;
        self.books.resize(manifest.categories.len(), None);
        for grown in made.grown {
            self.books[grown.number] = grown.book;
        }
        self.bank.manifest = manifest;
        Ok(row)
    }
}

/// Public codebooks by category.
pub(crate) type Books = HashMap<usize, Option<Arc<Codebook>>>;

/// An image that is being encoded.
struct Making<'m> {
    task: &'m BankTask,
    dir: &'m Path,
    /// Number of its next file.
    next: u32,
    grown: Vec<Grown>,
    sums: Sums,
}

impl Making<'_> {
    /// Makes sure that a category is among those of the image.
    fn enter(&mut self, number: usize, books: &Books) {
        if self.grown.iter().all(|grown| grown.number != number) {
            let book = books.get(&number).cloned().flatten();
            self.grown.push(Grown { number, tiles: 0, book, file: None });
        }
    }

    fn add_tile(&mut self, at: At, cut: Cut<'_>, share: &Share<'_>) -> Result<(), CliError> {
        let Making { task, dir, next, grown, sums } = self;
        let Some(grown) = grown.iter_mut().find(|grown| grown.number == at.category) else { return Ok(()) };
        let size = cut.tile.size();
        let around = cut.around()?;
        let set = ImageSet::single(without_plain_alpha(cut.tile));
        let around = around.map(|around| around.with_channels(set.info().channels));
        let shared = Shared { public: grown.book.clone(), most_rows: MOST_ROWS, apron: around };
        let mut progress = |stage| share.report(stage);
        let mut job = Job::new(Limits::default()).with_progress(&mut progress);
        let texture = Progressive::encode_shared(&set, &task.params(), &shared, &mut job)
            .map_err(|source| CliError::Encode { path: task.path.clone(), source })?;
        let grown_rows = grown.grow(dir, &texture, next)?;
        let file = format!("image-{next:06}.txf");
        *next += 1;
        let mut writer = SectionWriter::new(Progressive::ID);
        texture.store(&mut writer);
        write_whole(&dir.join(&file), &writer.finish().bytes)?;
        sums.add(&set, &texture, grown_rows);
        let details = texture.details();
        sums.tiles.push(Tile {
            file,
            x: at.x,
            y: at.y,
            width: size.width,
            height: size.height,
            category: at.category as u32,
            grown_rows,
            own_cells: details
                .and_then(|details| details.private.as_ref())
                .map_or(0, |book| book.size().0 * book.size().1 / texfold_progressive::CELL_SIDE.pow(2)),
            blocks: blocks(&texture),
        });
        Ok(())
    }
}

impl Grown {
    /// Takes over the codebook that a texture uses; rows that it grew by. A grown one is written as a new file.
    fn grow(&mut self, dir: &Path, texture: &TexelTexture, next: &mut u32) -> Result<u32, CliError> {
        self.tiles += 1;
        let Some(public) = texture.details().and_then(|details| details.public.clone()) else { return Ok(0) };
        let rows = public.size().1;
        let grown = rows.saturating_sub(self.book.as_ref().map_or(0, |book| book.size().1));
        if grown > 0 {
            let file = format!("category-{:03}-{next:06}.txf", self.number);
            *next += 1;
            let mut writer = SectionWriter::new(Progressive::ID);
            Progressive::store_codebook(&public, &mut writer);
            write_whole(&dir.join(&file), &writer.finish().bytes)?;
            self.file = Some((file, rows));
            self.book = Some(public);
        }
        Ok(grown)
    }
}

impl BankTask {
    /// Hash of all that the stored form depends on, but the bank's codebooks.
    fn key(&self) -> Result<String, CliError> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(format!("{:?}", self.settings).as_bytes());
        add_file(&mut hasher, &self.path)
            .map_err(|source| CliError::Read { path: self.path.clone(), source })?;
        Ok(hasher.finalize().to_hex().to_string())
    }

    fn row(&self, dir: &Path, sums: &Sums, (width, height): (u32, u32), seconds: f64) -> Row {
        let texels = sums.texels as f64;
        let (memory, disk) = sums
            .parts
            .iter()
            .fold((0, 0), |(memory, disk), part| (memory + part.bits_memory, disk + part.bits_disk));
        let count = |index: usize| sums.tiles.iter().map(|tile| tile.blocks[index]).sum::<u64>();
        let all = count(2).max(1) as f64;
        let rows: u32 = sums.tiles.iter().map(|tile| tile.grown_rows).sum();
        Row {
            input: self.path.display().to_string(),
            output: dir.display().to_string(),
            codec: Progressive::ID.name.to_owned(),
            settings: format!("{:?}", self.settings.encode.goal),
            width,
            height,
            images: 1,
            source_texels: sums.texels,
            bits_memory: memory,
            bits_disk: disk,
            bpp_memory: memory as f64 / texels,
            bpp_disk: disk as f64 / texels,
            psnr: sums.color.psnr(),
            psnr_alpha: sums.alpha.map(|error| error.psnr()),
            rms: sums.color.rms(),
            worst_block_rms: sums.worst_block_rms,
            ssim: sums.ssim / texels,
            ssimulacra2: mean(sums.ssimulacra2.iter().copied()),
            access: Access::Texel.name().to_owned(),
            // Tiles are coded for the goal one by one.
            goal_met: None,
            encode_seconds: seconds,
            encode_texels_per_second: texels / seconds.max(1e-9),
            peak_bytes: peak_bytes(),
            parts: sums.parts.clone(),
            verdict: format!(
                "{} tiles; {:.0}% of the blocks use public content and {:.0}% the tiles' own; the public codebooks grew by {rows} rows.",
                sums.tiles.len(),
                100.0 * count(0) as f64 / all,
                100.0 * count(1) as f64 / all
            ),
            warnings: Vec::new(),
        }
    }
}

/// Where a tile lies and what it is like.
#[derive(Debug, Clone, Copy)]
struct At {
    x: u32,
    y: u32,
    category: usize,
}

/// The tile without alpha where all of it is opaque: the base would have to hold it.
fn without_plain_alpha(tile: Raster) -> Raster {
    let opaque = tile.info().has_alpha() && tile.texels().all(|texel| texel.w >= 1.0);
    if opaque { tile.with_channels(tile.info().channels - 1) } else { tile }
}

/// Blocks that use public content, the texture's own, and all.
fn blocks(texture: &TexelTexture) -> [u64; 3] {
    let Some(details) = texture.details() else { return [0; 3] };
    let public_rows = details.public.as_ref().map_or(0, |book| book.size().1);
    let mut counts = [0; 3];
    for entry in details.maps.iter().flat_map(|map| map.entries(details.form)) {
        counts[2] += 1;
        if entry.gain % 16 > 0 {
            counts[usize::from(entry.row >= public_rows)] += 1;
        }
    }
    counts
}

impl Sums {
    /// Takes a tile in. Of the public codebook it counts what the tile added.
    fn add(&mut self, source: &ImageSet, texture: &TexelTexture, grown_rows: u32) {
        let found = quality(source, texture);
        let texels = source.texel_count();
        self.color = self.color + found.color;
        if let Some(alpha) = found.alpha {
            self.alpha = Some(self.alpha.unwrap_or_default() + alpha);
        }
        self.worst_block_rms = self.worst_block_rms.max(found.worst_block_rms);
        let (decoded, image) = (decode_surface(texture, 0, 0), &source.images()[0]);
        let similar = decoded.as_ref().map_or(0.0, |decoded| ssim(image, decoded));
        self.ssim += similar * texels as f64;
        self.ssimulacra2.push((decoded.and_then(|decoded| ssimulacra2(image, &decoded)), texels as f64));
        self.texels += texels;
        self.channels = self.channels.max(texture.layout().pixel.channels);
        self.levels = self.levels.max(texture.layout().levels);
        let public = texture.details().and_then(|details| details.public.as_ref());
        let share = public.map_or(0.0, |book| f64::from(grown_rows) / f64::from(book.size().1));
        let grown = (texture.shared_bits() as f64 * share).round() as u64;
        for part in texture.footprint().parts {
            let shared = part.name == "public codebook";
            let (memory, disk) = if shared { (grown, grown) } else { (part.bits_memory, part.bits_disk) };
            match self.parts.iter_mut().find(|known| known.name == part.name) {
                Some(known) => {
                    known.bits_memory += memory;
                    known.bits_disk += disk;
                    known.psnr_without = None;
                }
                None => self.parts.push(PartRow {
                    name: part.name.to_owned(),
                    bits_memory: memory,
                    bits_disk: disk,
                    psnr_without: part.psnr_without,
                }),
            }
        }
    }
}
