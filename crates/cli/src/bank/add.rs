//! Images are added one after another: each tile by tile, against the public codebook of its category, then all at once.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use texfold_core::container::SectionWriter;
use texfold_core::image::{ImageSet, Raster};
use texfold_core::metric::{SquaredError, decode_surface, quality, ssim};
use texfold_core::{Encoded, Job, Limits, TextureCodec};
use texfold_progressive::{Codebook, Progressive, ProgressiveParams, ProgressiveTexture, Shared};

use super::manifest::{Category, Image, Manifest, Tile};
use super::{Open, category, tiles};
use crate::compress::add_file;
use crate::config::Settings;
use crate::error::CliError;
use crate::output::write_whole;
use crate::progress::Share;
use crate::report::{PartRow, Row, peak_bytes};

/// Rows of texels that a public codebook may have: 512 of 256 texels are 64 kB in BC4.
const MOST_ROWS: u32 = 512;
/// Where k-means starts from.
const SEED: u64 = 0x7e8f_01d5;

/// An image that is to be in a bank.
#[derive(Debug)]
pub(crate) struct BankTask {
    pub(crate) path: PathBuf,
    pub(crate) name: String,
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
    texels: u64,
    parts: Vec<PartRow>,
    channels: u8,
    levels: u32,
}

/// Divides the first images of a bank into categories.
pub(crate) fn categorise(open: &mut Open, tasks: &[&BankTask], limit_bytes: u64) {
    if !open.bank.manifest.categories.is_empty() {
        return;
    }
    let mut colours = Vec::new();
    for task in tasks {
        // What cannot be read is said when the image is added.
        let _ = tiles::each(&task.path, &task.settings, limit_bytes, |_, _, tile| {
            colours.push(category::colours(&tile));
            Ok(())
        });
    }
    open.bank.manifest.categories = category::divide(&colours, SEED);
}

impl BankTask {
    /// Adds the image; whether it was there already, and its row.
    pub(crate) fn add(
        &self,
        open: &mut Open,
        limit_bytes: u64,
        share: &Share<'_>,
    ) -> Result<(Row, bool), CliError> {
        let key = self.key()?;
        if let Some(known) = open.bank.manifest.images.iter().find(|image| image.name == self.name) {
            if known.key == key && known.tiles.iter().all(|tile| open.bank.dir.join(&tile.file).exists()) {
                return Ok((known.row.clone(), true));
            }
            return Err(CliError::BankName { path: self.path.clone() });
        }
        let start = Instant::now();
        let mut manifest = open.bank.manifest.clone();
        let mut books = open.books.clone();
        let mut sums = Sums::default();
        let size = tiles::each(&self.path, &self.settings, limit_bytes, |x, y, tile| {
            let number = category::join(&mut manifest.categories, category::colours(&tile));
            books.resize(manifest.categories.len(), None);
            if books[number].is_none() && number < open.bank.manifest.categories.len() {
                books[number] = open.book(number)?;
            }
            let at = At { x, y, category: number };
            self.add_tile(&open.bank.dir, (at, tile), &mut manifest, &mut books[number], &mut sums, share)
        })?;
        let seconds = start.elapsed().as_secs_f64();
        let row = self.row(&open.bank.dir, &sums, (size.width, size.height), seconds);
        manifest.images.push(Image {
            name: self.name.clone(),
            key,
            width: size.width,
            height: size.height,
            channels: sums.channels,
            levels: sums.levels,
            tiles: sums.tiles,
            row: row.clone(),
        });
        manifest.commit(&open.bank.dir)?;
        open.bank.manifest = manifest;
        open.books = books;
        Ok((row, false))
    }

    fn add_tile(
        &self,
        dir: &Path,
        (at, tile): (At, Raster),
        manifest: &mut Manifest,
        book: &mut Option<Arc<Codebook>>,
        sums: &mut Sums,
        share: &Share<'_>,
    ) -> Result<(), CliError> {
        let size = tile.size();
        let set = ImageSet::single(without_plain_alpha(tile));
        let shared = Shared { public: book.clone(), most_rows: MOST_ROWS };
        let settings = &self.settings.encode;
        let params = ProgressiveParams {
            goal: settings.goal,
            content: settings.content,
            reduce_log2: None,
            mips: settings.mips,
            effort: settings.effort,
        };
        let mut progress = |stage| share.report(stage);
        let mut job = Job::new(Limits::default()).with_progress(&mut progress);
        let texture = Progressive::encode_shared(&set, &params, &shared, &mut job)
            .map_err(|source| CliError::Encode { path: self.path.clone(), source })?;
        let category = &mut manifest.categories[at.category];
        let grown_rows = grow(dir, &texture, book, (at.category, &mut manifest.next), category)?;
        let file = format!("image-{:06}.txf", manifest.next);
        manifest.next += 1;
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
            encode_seconds: seconds,
            encode_texels_per_second: texels / seconds.max(1e-9),
            peak_bytes: peak_bytes(),
            parts: sums.parts.clone(),
            verdict: format!(
                "{} tiles; {:.0}% of the blocks show public content and {:.0}% the tiles' own; the public codebooks grew by {rows} rows.",
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

/// Takes over the codebook that a texture shows; rows that it grew by. A grown one is written as a new file.
fn grow(
    dir: &Path,
    texture: &ProgressiveTexture,
    book: &mut Option<Arc<Codebook>>,
    (number, next): (usize, &mut u32),
    category: &mut Category,
) -> Result<u32, CliError> {
    category.tiles += 1;
    let Some(shown) = texture.details().and_then(|details| details.public.clone()) else { return Ok(0) };
    let rows = shown.size().1;
    let grown = rows.saturating_sub(book.as_ref().map_or(0, |book| book.size().1));
    if grown > 0 {
        let file = format!("category-{number:03}-{next:06}.txf");
        *next += 1;
        let mut writer = SectionWriter::new(Progressive::ID);
        Progressive::store_codebook(&shown, &mut writer);
        write_whole(&dir.join(&file), &writer.finish().bytes)?;
        (category.file, category.rows) = (Some(file), rows);
        *book = Some(shown);
    }
    Ok(grown)
}

/// The tile without alpha where all of it is opaque: the base would have to hold it.
fn without_plain_alpha(tile: Raster) -> Raster {
    let opaque = tile.info().has_alpha() && tile.texels().all(|texel| texel.w >= 1.0);
    if opaque { tile.with_channels(tile.info().channels - 1) } else { tile }
}

/// Blocks that show public content, the texture's own, and all.
fn blocks(texture: &ProgressiveTexture) -> [u64; 3] {
    let Some(details) = texture.details() else { return [0; 3] };
    let public_rows = details.public.as_ref().map_or(0, |book| book.size().1);
    let mut counts = [0; 3];
    for entry in details.entries.iter().flatten() {
        counts[2] += 1;
        if entry.gain % 16 > 0 {
            counts[usize::from(entry.row >= public_rows)] += 1;
        }
    }
    counts
}

impl Sums {
    /// Takes a tile in. Of the public codebook it counts what the tile added.
    fn add(&mut self, source: &ImageSet, texture: &ProgressiveTexture, grown_rows: u32) {
        let found = quality(source, texture);
        let texels = source.texel_count();
        self.color = self.color + found.color;
        if let Some(alpha) = found.alpha {
            self.alpha = Some(self.alpha.unwrap_or_default() + alpha);
        }
        self.worst_block_rms = self.worst_block_rms.max(found.worst_block_rms);
        let similar = decode_surface(texture, 0, 0).map_or(0.0, |shown| ssim(&source.images()[0], &shown));
        self.ssim += similar * texels as f64;
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
