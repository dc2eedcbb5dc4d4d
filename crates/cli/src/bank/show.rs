//! Reading banks: images, single tiles and levels as images, and what a bank holds.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use serde::Serialize;
use texfold::{AnyImage, dct::DctImages, progressive::ProgressiveTexture};
use texfold_core::RegionError;
use texfold_core::image::Raster;
use texfold_progressive::{CELL_SIDE, Codebook};

use super::Bank;
use super::category::Category;
use super::manifest::{Image, MANIFEST, Tile};
use crate::console::{answer, complain};
use crate::error::{CliError, explain, guarded};
use crate::png;
use crate::report::Sizes;

/// Whether a path is the folder of a bank.
pub(crate) fn is_bank(path: &Path) -> bool {
    path.join(MANIFEST).is_file()
}

/// What of a bank is decoded.
#[derive(Debug, Clone, Default)]
pub(crate) struct Choice {
    /// The image of that name; all where there is none.
    pub(crate) image: Option<String>,
    /// The tile of that column and row.
    pub(crate) tile: Option<(u32, u32)>,
    /// Mip level.
    pub(crate) level: u32,
    /// Only so many layers.
    pub(crate) layers: Option<u32>,
}

/// Draws one tile at a level.
pub(crate) type Draw<'d> = dyn Fn(&Path, &AnyImage, u32) -> Result<Raster, CliError> + 'd;

/// Writes images of a bank as PNG files; the number of those that failed. Each is named with its cause, the others are
/// written.
pub(crate) fn decompress(
    dir: &Path,
    out: &Path,
    choice: &Choice,
    draw: &Draw<'_>,
) -> Result<usize, CliError> {
    let bank = Bank::read(dir)?;
    let mut books = HashMap::new();
    let wanted = |image: &&Image| choice.image.as_ref().is_none_or(|name| *name == image.name);
    let images: Vec<&Image> = bank.manifest.images.iter().filter(wanted).collect();
    if let (true, Some(name)) = (images.is_empty(), &choice.image) {
        return Err(CliError::NoSuchImage { path: dir.to_owned(), name: name.clone() });
    }
    let mut failed = 0;
    for image in images {
        let path = dir.join(&image.name);
        let done = guarded(&path, || bank.draw(image, (out, choice), draw, &mut books));
        if let Err(error) = done {
            complain(&format!("{}: {}", image.name, explain(&error)));
            failed += 1;
        }
    }
    Ok(failed)
}

/// Codebooks that have been read, by category.
type Books = HashMap<u32, Option<Arc<Codebook>>>;

impl Bank {
    fn draw(
        &self,
        image: &Image,
        (out, choice): (&Path, &Choice),
        draw: &Draw<'_>,
        books: &mut Books,
    ) -> Result<(), CliError> {
        let path = self.dir.join(&image.name);
        let region = |source| CliError::Region { path: path.clone(), source };
        if choice.level >= image.levels {
            return Err(region(RegionError::NoSuchLevel { level: choice.level, levels: image.levels }));
        }
        let chosen = |tile: &&Tile| {
            choice
                .tile
                .is_none_or(|(x, y)| (tile.x / super::tiles::TILE, tile.y / super::tiles::TILE) == (x, y))
        };
        let tiles: Vec<&Tile> = image.tiles.iter().filter(chosen).collect();
        if tiles.is_empty() {
            return Err(region(RegionError::Outside { width: image.width, height: image.height }));
        }
        let area = match (choice.tile, tiles.as_slice()) {
            (Some(_), [tile, ..]) => (tile.x, tile.y, tile.width, tile.height),
            _ => (0, 0, image.width, image.height),
        };
        let mut canvas = Canvas::new(image.channels, area, choice.level);
        for tile in tiles {
            let book = match books.get(&tile.category) {
                Some(book) => book.clone(),
                None => {
                    let book = self.codebook(&self.manifest.categories[tile.category as usize])?;
                    books.entry(tile.category).or_insert(book).clone()
                }
            };
            let texture = self.tile(tile, book.as_deref())?;
            let size = texture.as_encoded().layout().images[0];
            if (size.width, size.height) != (tile.width, tile.height) {
                let what = format!("{} is not the tile that is listed", tile.file);
                return Err(CliError::BankManifest { path: self.dir.join(MANIFEST), what });
            }
            let texture = match choice.layers {
                Some(layers) => first_layers(&texture, layers).unwrap_or(texture),
                None => texture,
            };
            canvas.place(tile, &draw(&self.dir.join(&tile.file), &texture, choice.level)?);
        }
        let suffix = choice.tile.map_or(String::new(), |(x, y)| format!("-{x}-{y}"));
        canvas.write(&out.join(format!("{}{suffix}.png", image.name)))
    }
}

/// A tile as it is with the first layers of its file.
fn first_layers(tile: &AnyImage, layers: u32) -> Option<AnyImage> {
    let by_block = tile.downcast_ref::<DctImages>().map(|tile| AnyImage::new(tile.first_layers(layers)));
    let by_texel = tile.downcast_ref::<ProgressiveTexture>();
    by_block.or_else(|| by_texel.map(|tile| AnyImage::new(tile.first_layers(layers))))
}

/// An image that tiles are placed in, 8 bits a channel.
struct Canvas {
    width: usize,
    height: usize,
    channels: usize,
    level: u32,
    corner: (u32, u32),
    bytes: Vec<u8>,
}

impl Canvas {
    /// A level of that area of an image.
    fn new(channels: u8, (left, top, width, height): (u32, u32, u32, u32), level: u32) -> Canvas {
        let side = |length: u32| (length >> level).max(1) as usize;
        let (width, height, channels) = (side(width), side(height), usize::from(channels));
        let bytes = vec![0; width * height * channels];
        Canvas { width, height, channels, level, corner: (left, top), bytes }
    }

    /// Puts a tile in its place; what does not fit is cut.
    fn place(&mut self, tile: &Tile, raster: &Raster) {
        let size = raster.size();
        let left = ((tile.x - self.corner.0) >> self.level) as usize;
        let top = ((tile.y - self.corner.1) >> self.level) as usize;
        let texels = raster.to_bytes();
        let own = usize::from(raster.info().channels);
        if own > self.channels || left >= self.width {
            return;
        }
        let columns = (size.width as usize).min(self.width - left);
        for row in 0..(size.height as usize).min(self.height.saturating_sub(top)) {
            let from = row * size.width as usize * own;
            let to = ((top + row) * self.width + left) * self.channels;
            let line = self.bytes[to..to + columns * self.channels].chunks_exact_mut(self.channels);
            for (to, from) in line.zip(texels[from..].chunks_exact(own)) {
                // Tiles that are opaque are stored without alpha.
                to.fill(u8::MAX);
                to[..own].copy_from_slice(from);
            }
        }
    }

    fn write(&self, path: &Path) -> Result<(), CliError> {
        png::write_bytes(path, (self.width as u32, self.height as u32), self.channels as u8, &self.bytes)
    }
}

/// A bank in figures.
#[derive(Debug, Serialize)]
struct Summary {
    bank: String,
    images: Vec<ImageSummary>,
    categories: Vec<CategorySummary>,
    source_texels: u64,
    #[serde(flatten)]
    sizes: Sizes,
}

/// An image in figures; of public codebooks it counts what it added to them.
#[derive(Debug, Serialize)]
struct ImageSummary {
    name: String,
    /// "block" or "texel".
    access: &'static str,
    width: u32,
    height: u32,
    tiles: usize,
    categories: Vec<u32>,
    psnr: f64,
    #[serde(flatten)]
    sizes: Sizes,
    /// Cells that public codebooks grew by.
    public_cells_added: u32,
    own_cells: u32,
    /// Shares of blocks that use public content, and the image's own.
    public_share: f64,
    own_share: f64,
}

#[derive(Debug, Serialize)]
struct CategorySummary {
    /// What the user calls it.
    name: Option<String>,
    tiles: u32,
    cells: u32,
    file: Option<String>,
    /// Share of the blocks of its tiles that use the public codebook.
    public_share: f64,
    /// Cells of the codebook after each image that has tiles of the category.
    growth: Vec<Growth>,
}

/// A codebook once an image was in.
#[derive(Debug, Serialize)]
struct Growth {
    image: String,
    cells: u32,
}

/// Cells in a row of a public codebook.
const ROW_CELLS: u32 = 256 / CELL_SIDE;

/// Says what a bank holds.
pub(crate) fn describe(dir: &Path, json: bool) -> Result<(), CliError> {
    let bank = Bank::read(dir)?;
    let images: Vec<ImageSummary> = bank.manifest.images.iter().map(summary_of).collect();
    let categories =
        (0..).zip(&bank.manifest.categories).map(|(number, category)| category_of(&bank, number, category));
    let sum = |figure: fn(&Image) -> u64| bank.manifest.images.iter().map(figure).sum::<u64>();
    let texels = sum(|image| image.row.source_texels);
    let summary = Summary {
        bank: dir.display().to_string(),
        images,
        categories: categories.collect(),
        source_texels: texels,
        sizes: Sizes::sum(bank.manifest.images.iter().map(|image| image.row.sizes), texels),
    };
    if json {
        let text = serde_json::to_string_pretty(&summary);
        answer(&text.map_err(|source| CliError::Write { path: dir.to_owned(), source: source.into() })?);
        return Ok(());
    }
    answer(&lines(&summary));
    Ok(())
}

fn category_of(bank: &Bank, number: u32, category: &Category) -> CategorySummary {
    let tiles = |image: &Image| -> Vec<Tile> {
        image.tiles.iter().filter(|tile| tile.category == number).cloned().collect()
    };
    let mut summary = CategorySummary {
        name: category.name.clone(),
        tiles: category.tiles,
        cells: category.rows / CELL_SIDE * ROW_CELLS,
        file: category.file.clone(),
        public_share: 0.0,
        growth: Vec::new(),
    };
    let (mut rows, mut used, mut all) = (0, 0, 0);
    for image in &bank.manifest.images {
        let tiles = tiles(image);
        if tiles.is_empty() {
            continue;
        }
        rows += tiles.iter().map(|tile| tile.grown_rows).sum::<u32>();
        used += tiles.iter().map(|tile| tile.blocks[0]).sum::<u64>();
        all += tiles.iter().map(|tile| tile.blocks[2]).sum::<u64>();
        summary.growth.push(Growth { image: image.name.clone(), cells: rows / CELL_SIDE * ROW_CELLS });
    }
    summary.public_share = used as f64 / all.max(1) as f64;
    summary
}

fn summary_of(image: &Image) -> ImageSummary {
    let sum = |figure: fn(&Tile) -> u32| image.tiles.iter().map(figure).sum::<u32>();
    let blocks = |index: usize| image.tiles.iter().map(|tile| tile.blocks[index]).sum::<u64>() as f64;
    let mut categories: Vec<u32> = image.tiles.iter().map(|tile| tile.category).collect();
    categories.sort_unstable();
    categories.dedup();
    ImageSummary {
        name: image.name.clone(),
        access: image.access().name(),
        width: image.width,
        height: image.height,
        tiles: image.tiles.len(),
        categories,
        psnr: image.row.psnr,
        sizes: image.row.sizes,
        public_cells_added: sum(|tile| tile.grown_rows) / CELL_SIDE * ROW_CELLS,
        own_cells: sum(|tile| tile.own_cells),
        public_share: blocks(0) / blocks(2).max(1.0),
        own_share: blocks(1) / blocks(2).max(1.0),
    }
}

fn lines(summary: &Summary) -> String {
    let mut lines = vec![format!("{}: a bank of {} images", summary.bank, summary.images.len())];
    for (number, category) in summary.categories.iter().enumerate() {
        let name = category.name.as_ref().map_or(String::new(), |name| format!(" ({name})"));
        let cells = match category.cells {
            0 => String::new(),
            cells => {
                let share = 100.0 * category.public_share;
                format!(", {cells} public cells, shown by {share:.0}% of the blocks with a map")
            }
        };
        lines.push(format!("  category {number}{name}: {} tiles{cells}", category.tiles));
    }
    lines.push(format!(
        "  {:28} {:>11} {:>5} {:>6} {:>8} {:>7} {:>6} {:>6} {:>7} {:>5}",
        "image", "size", "tiles", "by", "dB", "bpp", "added", "own", "public", "own"
    ));
    for image in &summary.images {
        lines.push(format!(
            "  {:28} {:>11} {:>5} {:>6} {:>8.2} {:>7.3} {:>6} {:>6} {:>6.0}% {:>4.0}%",
            image.name,
            format!("{}x{}", image.width, image.height),
            image.tiles,
            image.access,
            image.psnr,
            image.sizes.bpp_memory,
            image.public_cells_added,
            image.own_cells,
            100.0 * image.public_share,
            100.0 * image.own_share
        ));
    }
    let Sizes { bpp_memory, bpp_resident, bpp_disk, .. } = summary.sizes;
    lines.push(format!(
        "  bits a texel: {bpp_memory:.4} memory, {bpp_disk:.4} disk, {bpp_resident:.4} decoded whole"
    ));
    lines.join("\n")
}
