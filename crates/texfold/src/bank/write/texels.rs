//! Images by texel: each tile meets the goal by itself, with the public codebook of its category, which grows by what is new in
//! the tile (progressive paper, sections 4 and 5).
//!
//! Rows are added behind those that are there: a grown codebook is a new file whose first rows are the bytes of the old one, so that
//! tiles of before are read with either. Tiles are encoded one after another, as each may use what those before it added.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use texfold_core::container::SectionWriter;
use texfold_core::image::ImageSet;
use texfold_core::{ImageSize, Job, TextureCodec};
use texfold_progressive::{
    APRON, CELL_SIDE, Codebook, Progressive, ProgressiveParams, ProgressiveTexture, Shared,
};

use super::{SourceTile, TileSource, WriteError, whole, without_plain_alpha, write_tile};
use crate::bank::{Category, Tile};

/// Most rows of texels of a public codebook: 512 of 256 texels are 64 kB in BC4.
const MOST_ROWS: u32 = 512;

/// Public codebooks by category; `None` where a category has none yet.
pub type Codebooks = HashMap<usize, Option<Arc<Codebook>>>;

/// A category that tiles of an image join, and its public codebook as the image leaves it.
#[derive(Debug, Clone)]
pub struct Grown {
    /// Number of the category.
    pub category: usize,
    /// Tiles that join it.
    pub tiles: u32,
    /// Its codebook.
    book: Option<Arc<Codebook>>,
    /// File and rows of a codebook that has grown.
    file: Option<(String, u32)>,
}

impl Grown {
    /// Categories that tiles join ([`Categories::join`](super::Categories::join)), without growth.
    #[must_use]
    pub fn of_tiles(categories: &[usize]) -> Vec<Grown> {
        let mut all: Vec<Grown> = Vec::new();
        for &category in categories {
            match all.iter_mut().find(|known| known.category == category) {
                Some(known) => known.tiles += 1,
                None => all.push(Grown { category, tiles: 1, book: None, file: None }),
            }
        }
        all
    }

    /// Enters tiles and codebook into the list of a bank.
    pub(super) fn enter(&self, categories: &mut [Category]) {
        let category = &mut categories[self.category];
        category.tiles += self.tiles;
        if let Some((file, rows)) = &self.file {
            (category.file, category.rows) = (Some(file.clone()), *rows);
        }
    }

    /// Replaces the codebook by that of a texture, and writes it where it has grown; the rows that it grew by.
    fn take(&mut self, texture: &ProgressiveTexture, dir: &Path, next: &mut u32) -> Result<u32, WriteError> {
        let Some(public) = texture.details().and_then(|details| details.public.clone()) else { return Ok(0) };
        let rows = public.size().1;
        let added = rows.saturating_sub(self.book.as_ref().map_or(0, |book| book.size().1));
        if added > 0 {
            let file = format!("category-{:03}-{next:06}.txf", self.category);
            *next += 1;
            let mut writer = SectionWriter::new(Progressive::ID);
            Progressive::store_codebook(&public, &mut writer);
            let path = dir.join(&file);
            whole::write_whole(&path, &writer.finish().bytes)
                .map_err(|source| WriteError::Write { path, source })?;
            self.file = Some((file, rows));
            self.book = Some(public);
        }
        Ok(added)
    }
}

/// A tile that is encoded and written.
#[derive(Debug)]
pub struct TexelTile {
    /// Its entry in the list of the bank.
    pub entry: Tile,
    /// The tile as it was encoded.
    pub source: ImageSet,
    /// The tile encoded.
    pub texture: ProgressiveTexture,
    /// Bits of the rows that it added to the public codebook.
    pub grown_bits: u64,
}

/// Parameters and place of an image that is encoded by texel.
#[derive(Debug, Clone, Copy)]
pub struct TexelTiles<'t> {
    /// Goal and effort.
    pub params: &'t ProgressiveParams,
    /// The bank's folder.
    pub dir: &'t Path,
    /// Number of the first file: there are at most two for each tile.
    pub first: u32,
    /// Reference value of errors ([`texfold_core::image::Raster::peak`]): the largest of the image.
    pub peak: f32,
    /// Categories of the tiles, row by row.
    pub categories: &'t [usize],
    /// Codebooks of these categories.
    pub codebooks: &'t Codebooks,
}

impl TexelTiles<'_> {
    /// Encodes the tiles of a source and writes their files and the codebooks that grow; each tile is handed to `take`. The size of the image,
    /// and its categories.
    ///
    /// # Errors
    /// [`WriteError::Encode`], [`WriteError::Write`], [`WriteError::Changed`], and those of the source and of `take`.
    pub fn encode<S: TileSource>(
        &self,
        source: &S,
        job: &mut Job<'_>,
        mut take: impl FnMut(TexelTile) -> Result<(), S::Error>,
    ) -> Result<(ImageSize, Vec<Grown>), S::Error> {
        let mut grown = Grown::of_tiles(self.categories);
        for grown in &mut grown {
            grown.book = self.codebooks.get(&grown.category).cloned().flatten();
        }
        let (mut next, mut number) = (self.first, 0);
        let budget = job.budget.clone();
        let size = source.each_tile(APRON, &mut |tile| {
            let &category = self.categories.get(number).ok_or(WriteError::Changed)?;
            let at = |number: usize| number as f32 / self.categories.len() as f32;
            let grown =
                grown.iter_mut().find(|grown| grown.category == category).ok_or(WriteError::Changed)?;
            job.budget = budget.clone();
            let done =
                job.within(at(number), at(number + 1), |job| self.encode_tile(tile, grown, &mut next, job))?;
            number += 1;
            take(done)
        })?;
        Ok((size, grown))
    }

    fn encode_tile(
        &self,
        tile: SourceTile,
        grown: &mut Grown,
        next: &mut u32,
        job: &mut Job<'_>,
    ) -> Result<TexelTile, WriteError> {
        let SourceTile { place: (x, y), texels, around } = tile;
        let ImageSize { width, height } = texels.size();
        let source = ImageSet::single(without_plain_alpha(texels.with_peak(self.peak)));
        let apron = around.map(|around| around.with_channels(source.info().channels));
        let shared = Shared { public: grown.book.clone(), most_rows: MOST_ROWS, apron };
        let texture = Progressive::encode_shared(&source, self.params, &shared, job)?;
        let grown_rows = grown.take(&texture, self.dir, next)?;
        let (own_cells, blocks) = counts(&texture);
        let (category, file) = (grown.category as u32, write_tile(&texture, self.dir, next)?);
        let entry = Tile { file, x, y, width, height, category, grown_rows, own_cells, blocks };
        let grown_bits = grown_bits(&texture, grown_rows);
        Ok(TexelTile { entry, source, texture, grown_bits })
    }
}

/// Bits of the rows that a public codebook grew by.
fn grown_bits(texture: &ProgressiveTexture, grown_rows: u32) -> u64 {
    let public = texture.details().and_then(|details| details.public.as_ref());
    let share = public.map_or(0.0, |book| f64::from(grown_rows) / f64::from(book.size().1));
    (texture.shared_bits() as f64 * share).round() as u64
}

/// Cells of a texture's own codebook; its blocks that use the public one, its own, and all.
fn counts(texture: &ProgressiveTexture) -> (u32, [u64; 3]) {
    let Some(details) = texture.details() else { return (0, [0; 3]) };
    let area = |(width, height): (u32, u32)| width * height;
    let cells = details.private.as_ref().map_or(0, |book| area(book.size()) / CELL_SIDE.pow(2));
    let public_rows = details.public.as_ref().map_or(0, |book| book.size().1);
    let mut counts = [0; 3];
    for entry in details.maps.iter().flat_map(|map| map.entries(details.form)) {
        counts[2] += 1;
        if entry.gain % 16 > 0 {
            counts[usize::from(entry.row >= public_rows)] += 1;
        }
    }
    (cells, counts)
}
