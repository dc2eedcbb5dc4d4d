//! Reading banks: images, single tiles and levels as images, and what a bank holds.

use std::path::{Path, PathBuf};

use serde::Serialize;
use texfold::bank::{BankError, Category, MANIFEST, Part, TILE_SIDE as TILE, Tile};
use texfold::{AnyImage, dct::DctImages, progressive::ProgressiveTexture};
use texfold_core::image::{PixelInfo, Raster};
use texfold_core::{ImageSize, Rect, RegionError};
use texfold_progressive::CELL_SIDE;

use super::manifest::{self, Bank, Image, access_of, georeference_of};
use crate::console::{answer, complain};
use crate::decompress::{Picture, Writing};
use crate::error::{CliError, explain, guarded};
use crate::input::georeference::{Georeference, Part as Extent};
use crate::report::Sizes;

/// Whether a path is the folder of a bank.
pub(crate) fn is_bank(path: &Path) -> bool {
    path.join(MANIFEST).is_file()
}

/// What of a bank is decoded.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Choice<'c> {
    /// The image of that name; all where there is none.
    pub(crate) image: Option<&'c str>,
    /// The tile of that column and row.
    pub(crate) tile: Option<(u32, u32)>,
    pub(crate) writing: &'c Writing,
}

impl Choice<'_> {
    fn output(&self, image: &Image) -> PathBuf {
        let tile = self.tile.map_or(String::new(), |(x, y)| format!("-{x}-{y}"));
        self.writing.out.join(format!("{}{tile}{}", image.name, self.writing.ending()))
    }
}

/// Draws a rectangle of a tile.
pub(crate) type Draw<'d> = dyn Fn(&Path, &AnyImage, Rect) -> Result<Raster, CliError> + 'd;

/// Writes images of a bank; the number of those that failed. Each is named with its cause, the others are written.
pub(crate) fn decompress(dir: &Path, choice: Choice<'_>, draw: &Draw<'_>) -> Result<usize, CliError> {
    let bank = manifest::open(dir)?;
    let wanted = |(_, image): &(u32, &Image)| choice.image.is_none_or(|name| *name == image.name);
    let images: Vec<(u32, &Image)> = (0..).zip(bank.images()).filter(wanted).collect();
    if let (true, Some(name)) = (images.is_empty(), choice.image) {
        return Err(CliError::NoSuchImage { path: dir.to_owned(), name: name.to_owned() });
    }
    let outputs: Vec<PathBuf> = images.iter().map(|(_, image)| choice.output(image)).collect();
    choice.writing.check(outputs.iter().map(PathBuf::as_path))?;
    let mut failed = 0;
    for ((number, image), output) in images.into_iter().zip(outputs) {
        let path = dir.join(&image.name);
        let done = guarded(&path, || drawn(&bank, (number, image), choice, draw)?.write(&output));
        if let Err(error) = done {
            complain(&format!("{}: {}", image.name, explain(&error)));
            failed += 1;
        }
    }
    Ok(failed)
}

/// The chosen part of an image of that number.
fn drawn(
    bank: &Bank,
    (number, image): (u32, &Image),
    choice: Choice<'_>,
    draw: &Draw<'_>,
) -> Result<Picture, CliError> {
    let (path, writing) = (bank.dir().join(&image.name), choice.writing);
    let level = writing.lod;
    let region = |source| CliError::Region { path: path.clone(), source };
    if level >= image.levels {
        return Err(region(RegionError::NoSuchLevel { level, levels: image.levels }));
    }
    let size = ImageSize { width: image.width, height: image.height }.at_level(level);
    let place = |tile: &Tile| (tile.x / TILE, tile.y / TILE);
    let area = match choice.tile {
        Some(chosen) => {
            let last = image.tiles.iter().map(place).max().unwrap_or_default();
            let tile = image.tiles.iter().find(|tile| place(tile) == chosen);
            let none = || CliError::NoSuchTile { path: path.clone(), tile: chosen, last };
            tile.ok_or_else(none)?.at_level(level)
        }
        None => writing.rect(0, size).map_err(region)?,
    };
    let mut picture = None;
    for Part { tile, rect, corner } in bank.parts(Rect { image: number, ..area }).map_err(region)? {
        let texture = bank.tile(tile)?;
        let pixel = texture.as_encoded().layout().pixel;
        if pixel.channels > image.channels {
            let what = format!("{} is not the tile that is listed", tile.file);
            return Err(BankError::Manifest { path: bank.dir().join(MANIFEST), what }.into());
        }
        let size = ImageSize { width: area.width, height: area.height };
        let picture = match &mut picture {
            Some(picture) => picture,
            // Tiles that are opaque are stored without alpha.
            None => {
                let info = PixelInfo { channels: image.channels, ..pixel };
                let georeference = georeference_of(image);
                let bands = georeference.as_ref().and_then(Georeference::bands);
                let bands =
                    bands.filter(|bands| writing.takes_bands() && bands.count == u16::from(image.channels));
                let whole = ImageSize { width: image.width, height: image.height };
                let georeference = georeference.map(|found| found.of_part(Extent::of(whole, area)));
                let made = writing.picture(&path, size, info, bands)?;
                picture.insert(made.with_georeference(georeference))
            }
        };
        let texture = match writing.layers {
            Some(layers) => first_layers(&texture, layers).unwrap_or(texture),
            None => texture,
        };
        picture.place(corner, &draw(&bank.path_of(tile), &texture, rect)?);
    }
    picture.ok_or_else(|| region(RegionError::Outside { width: size.width, height: size.height }))
}

/// A tile as it is with the first layers of its file.
fn first_layers(tile: &AnyImage, layers: u32) -> Option<AnyImage> {
    let by_block = tile.downcast_ref::<DctImages>().map(|tile| AnyImage::new(tile.first_layers(layers)));
    let by_texel = tile.downcast_ref::<ProgressiveTexture>();
    by_block.or_else(|| by_texel.map(|tile| AnyImage::new(tile.first_layers(layers))))
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
    /// Its place on Earth.
    #[serde(skip_serializing_if = "Option::is_none")]
    place: Option<String>,
    tiles: usize,
    categories: Vec<u32>,
    psnr: f64,
    #[serde(flatten)]
    sizes: Sizes,
    /// Cells that public codebooks grew by.
    public_cells_added: u64,
    own_cells: u64,
    /// Shares of blocks that use public content, and the image's own.
    public_share: f64,
    own_share: f64,
}

#[derive(Debug, Serialize)]
struct CategorySummary {
    /// What the user calls it.
    name: Option<String>,
    tiles: u32,
    cells: u64,
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
    cells: u64,
}

/// Cells in a row of a public codebook.
const ROW_CELLS: u64 = 256 / CELL_SIDE as u64;

/// Cells of so many rows of texels.
fn cells_of(rows: u64) -> u64 {
    rows / u64::from(CELL_SIDE) * ROW_CELLS
}

/// Says what a bank holds.
pub(crate) fn describe(dir: &Path, json: bool) -> Result<(), CliError> {
    let bank = manifest::open(dir)?;
    let images: Vec<ImageSummary> = bank.manifest().images.iter().map(summary_of).collect();
    let categories =
        (0..).zip(&bank.manifest().categories).map(|(number, category)| category_of(&bank, number, category));
    let texels =
        bank.manifest().images.iter().fold(0, |sum: u64, image| sum.saturating_add(image.row.source_texels));
    let summary = Summary {
        bank: dir.display().to_string(),
        images,
        categories: categories.collect(),
        source_texels: texels,
        sizes: Sizes::sum(bank.manifest().images.iter().map(|image| image.row.sizes), texels),
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
        cells: cells_of(category.rows.into()),
        file: category.file.clone(),
        public_share: 0.0,
        growth: Vec::new(),
    };
    let (mut rows, mut used, mut all) = (0u64, 0, 0);
    for image in &bank.manifest().images {
        let tiles = tiles(image);
        if tiles.is_empty() {
            continue;
        }
        rows += tiles.iter().map(|tile| u64::from(tile.grown_rows)).sum::<u64>();
        used += tiles.iter().map(|tile| tile.blocks[0]).sum::<u64>();
        all += tiles.iter().map(|tile| tile.blocks[2]).sum::<u64>();
        summary.growth.push(Growth { image: image.name.clone(), cells: cells_of(rows) });
    }
    summary.public_share = used as f64 / all.max(1) as f64;
    summary
}

fn summary_of(image: &Image) -> ImageSummary {
    let sum = |figure: fn(&Tile) -> u32| image.tiles.iter().map(|tile| u64::from(figure(tile))).sum::<u64>();
    let blocks = |index: usize| image.tiles.iter().map(|tile| tile.blocks[index]).sum::<u64>() as f64;
    let mut categories: Vec<u32> = image.tiles.iter().map(|tile| tile.category).collect();
    categories.sort_unstable();
    categories.dedup();
    ImageSummary {
        name: image.name.clone(),
        access: access_of(image).name(),
        width: image.width,
        height: image.height,
        place: georeference_of(image).and_then(|found| found.description()),
        tiles: image.tiles.len(),
        categories,
        psnr: image.row.psnr,
        sizes: image.row.sizes,
        public_cells_added: cells_of(sum(|tile| tile.grown_rows)),
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
        lines.extend(image.place.iter().map(|place| format!("    at {place}")));
    }
    let Sizes { bpp_memory, bpp_resident, bpp_disk, .. } = summary.sizes;
    lines.push(format!(
        "  bits a texel: {bpp_memory:.4} memory, {bpp_disk:.4} disk, {bpp_resident:.4} decoded whole"
    ));
    lines.join("\n")
}
