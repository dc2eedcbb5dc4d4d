//! What codebooks can reproduce of the residuals of bases: the choice of their content, and an entry for each block.
//!
//! Source: "Progressive compression of large-scale remote sensing images with GSR descriptors", 2012, section 4. Pieces
//! of the image whose patches are like many blocks by GSR descriptors become content, those that the most blocks would use
//! public; blocks are matched against the public codebook and what the image brings of its own, there in all orientations by
//! low frequencies, as main directions of noise are unsteady. Other than there, content is detail without colour, brightness
//! and contrast (see [`crate::codebook`]), and a block that finds nothing pays for its entry all the same: entries are of one
//! length. Cost: a k-d tree query and some hundred patches a block.

mod cells;
mod choose;
mod search;

use rayon::prelude::*;
use texfold_core::image::Raster;
use texfold_core::{CancelCheck, EncodeError, Texel};

use std::sync::Arc;

use choose::{Choice, Price, choose};
use search::{Library, gain_unit};
use texfold_bc::Content;

use crate::Shared;
use crate::codebook::{CELL_SIDE, Codebook, Details, Entry, EntryMap, MapForm};

/// Bits of rotations: reflection, quarters, and a quarter in four.
pub(crate) const ROTATION_BITS: u32 = 5;

/// Residuals of one level of an image beside its base, in luma and 8-bit units.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LumaResidual {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) values: Vec<f32>,
}

impl LumaResidual {
    pub(crate) fn new(source: &Raster, base: &[Texel]) -> LumaResidual {
        let size = source.size();
        let texel = |(index, base): (usize, &Texel)| {
            let (x, y) = (index as u32 % size.width, index as u32 / size.width);
            let away = source.texel(x, y) - *base;
            (away.x + away.y + away.z) * (255.0 / 3.0)
        };
        let values = base.par_iter().enumerate().map(texel).collect();
        LumaResidual { width: size.width as usize, height: size.height as usize, values }
    }

    /// The block of `side` texels at a column and row of blocks; what lies beyond the edge is 0, as it is never seen.
    pub(crate) fn block(&self, side: usize, column: usize, row: usize, out: &mut Vec<f32>) {
        out.clear();
        for y in row * side..(row + 1) * side {
            for x in column * side..(column + 1) * side {
                let inside = x < self.width && y < self.height;
                out.push(if inside { self.values[y * self.width + x] } else { 0.0 });
            }
        }
    }

    /// The values over their RMS nearby, of one contrast throughout: -1 to 1.
    pub(crate) fn flattened(&self) -> LumaResidual {
        let squares: Vec<f32> = self.values.iter().map(|value| value * value).collect();
        let near = box_means(&squares, self.width, self.height, NEARBY);
        let level = |(value, near): (&f32, &f32)| {
            (value / (CREST * (near + LEAST_RMS * LEAST_RMS).sqrt())).clamp(-1.0, 1.0)
        };
        LumaResidual { values: self.values.iter().zip(&near).map(level).collect(), ..*self }
    }

    /// A cell of codebook content.
    pub(crate) fn cell(&self, left: usize, top: usize) -> Vec<f32> {
        let side = CELL_SIDE as usize;
        let value = |i: usize| {
            let (x, y) = ((left + i % side).min(self.width - 1), (top + i / side).min(self.height - 1));
            self.values[y * self.width + x]
        };
        (0..side * side).map(value).collect()
    }
}

/// Texels to each side over which contrast is taken.
const NEARBY: usize = 8;
/// Contrast in 8-bit units that is not blown up any more.
const LEAST_RMS: f32 = 0.5;
/// Largest value over RMS that content holds: larger ones are cut.
const CREST: f32 = 3.0;

/// Means over squares of `2 radius + 1` texels, cut at the edges.
fn box_means(values: &[f32], width: usize, height: usize, radius: usize) -> Vec<f32> {
    let run = |values: &[f32], step: usize, count: usize, start: usize, out: &mut [f32]| {
        let mut sums = vec![0.0f64; count + 1];
        for i in 0..count {
            sums[i + 1] = sums[i] + f64::from(values[start + i * step]);
        }
        for i in 0..count {
            let (low, high) = (i.saturating_sub(radius), (i + radius + 1).min(count));
            out[start + i * step] = ((sums[high] - sums[low]) / (high - low) as f64) as f32;
        }
    };
    let mut across = vec![0.0; values.len()];
    (0..height).for_each(|y| run(values, 1, width, y * width, &mut across));
    let mut down = vec![0.0; values.len()];
    (0..width).for_each(|x| run(&across, width, height, x, &mut down));
    down
}

/// Codebooks and the entries of all blocks: `residuals` are those of each image, level by level.
///
/// # Errors
/// [`EncodeError::Cancelled`] within a few blocks of the caller's wish.
pub(crate) fn find(
    residuals: &[Vec<LumaResidual>],
    side_log2: u32,
    library: &Library,
    check: CancelCheck<'_>,
) -> Result<Option<Details>, EncodeError> {
    let form = map_form(side_log2, library.size());
    if form.entry_bits() > 32 {
        return Ok(None);
    }
    let unit = gain_unit(residuals, side_log2);
    let map = |levels: &Vec<LumaResidual>| {
        let entries = levels.iter().map(|residual| library.entries(residual, form, unit, check));
        let entries: Vec<Vec<Entry>> = entries.collect::<Result<_, _>>()?;
        Ok(EntryMap::new(&entries.concat(), form))
    };
    let maps = residuals.iter().map(map).collect::<Result<_, EncodeError>>()?;
    let (public, private) = library.books();
    Ok(Some(Details { public, private, form, gain_unit: unit, maps }))
}

/// Content for the residuals of images: the public codebook with what many blocks would use, and pieces that are worth their
/// bits in these images alone, the best first.
#[derive(Debug)]
pub(crate) struct Candidates {
    public: Option<Arc<Codebook>>,
    own: Vec<Choice>,
}

impl Candidates {
    /// The public codebook grows where it has room.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] within 0.2 s of the caller's wish.
    pub(crate) fn new(
        residuals: &[Vec<LumaResidual>],
        side: usize,
        shared: &Shared,
        check: CancelCheck<'_>,
    ) -> Result<Candidates, EncodeError> {
        let known = shared.public.clone();
        let rows = known.as_ref().map_or(0, |book| book.size().1);
        let room = shared.most_rows.saturating_sub(rows) / CELL_SIDE * PUBLIC_CELLS;
        let cell_bits = if room > 0 { CELL_BITS / SHARING } else { CELL_BITS };
        let library = known.clone().map(|book| Library::new(Some(book), None, side, check));
        check.checkpoint()?;
        let price = Price { most: MOST_CELLS, cell_bits };
        let choices = choose(residuals, side, library.as_ref(), price, check)?;
        let (mut reused, own): (Vec<Choice>, Vec<Choice>) =
            choices.into_iter().partition(|choice| room > 0 && choice.reuse >= LEAST_REUSE);
        // Whole rows of cells are added: what an image reads never changes.
        let whole = reused.len().min(room as usize) / PUBLIC_CELLS as usize * PUBLIC_CELLS as usize;
        let rest = reused.split_off(whole);
        let public = match (known, of_cells(&reused, PUBLIC_CELLS * CELL_SIDE)) {
            (Some(book), Some(further)) => book.grown(&further).map(Arc::new).or(Some(book)),
            (known, further) => known.or(further.map(Arc::new)),
        };
        let mut own: Vec<Choice> =
            rest.into_iter().chain(own).filter(|choice| choice.bits >= CELL_BITS).collect();
        own.sort_by(|a, b| b.bits.total_cmp(&a.bits));
        Ok(Candidates { public, own })
    }

    /// Cells of a private codebook that with the map takes at most `most_bits`.
    pub(crate) fn own_cells(
        &self,
        residuals: &[Vec<LumaResidual>],
        side: usize,
        most_bits: Option<f64>,
    ) -> usize {
        // Of cells beyond a power of two the bits of places would be lost.
        let mut cells = self.own.len().checked_ilog2().map_or(0, |log2| 1 << log2);
        let public_rows = self.public.as_ref().map_or(0, |book| book.size().1);
        while cells > 0 && most_bits.is_some_and(|most| bits(residuals, side, cells, public_rows) > most) {
            cells /= 2;
        }
        cells
    }

    /// The codebooks with so many cells of the images' own; `None` where there is nothing to read.
    pub(crate) fn library(&self, side: usize, own_cells: usize, check: CancelCheck<'_>) -> Option<Library> {
        let log2 = own_cells.max(1).ilog2();
        let private = of_cells(&self.own[..own_cells], CELL_SIDE << log2.div_ceil(2)).map(Arc::new);
        let public = self.public.clone();
        (public.is_some() || private.is_some()).then(|| Library::new(public, private, side, check))
    }
}

/// The form of entries for codebooks of such width and height in all.
fn map_form(side_log2: u32, (width, height): (u32, u32)) -> MapForm {
    let bits = |side: u32| side.max(2).next_power_of_two().trailing_zeros();
    let (column_bits, row_bits) = (bits(width), bits(height));
    MapForm { side_log2, column_bits, row_bits, rotation_bits: ROTATION_BITS }
}

/// Bits of a map, and of a private codebook of so many cells.
fn bits(residuals: &[Vec<LumaResidual>], side: usize, cells: usize, public_rows: u32) -> f64 {
    let blocks: usize = residuals
        .iter()
        .flatten()
        .map(|residual| residual.width.div_ceil(side) * residual.height.div_ceil(side))
        .sum();
    let log2 = cells.max(1).ilog2();
    let (width, rows) = (CELL_SIDE << log2.div_ceil(2), CELL_SIDE << (log2 / 2));
    let width = if public_rows > 0 { width.max(PUBLIC_CELLS * CELL_SIDE) } else { width };
    let form = map_form(side.trailing_zeros(), (width, rows + public_rows));
    blocks as f64 * f64::from(form.entry_bits()) + cells as f64 * f64::from(CELL_BITS)
}

fn of_cells(choices: &[Choice], width: u32) -> Option<Codebook> {
    let cells: Vec<Vec<f32>> = choices.iter().map(|choice| choice.cell.clone()).collect();
    if cells.is_empty() { None } else { Codebook::of_cells(Content::Bc4, width, &cells) }
}

/// Most cells that an image brings.
const MOST_CELLS: usize = 256;
/// Bits of a cell in BC4.
const CELL_BITS: f32 = 4096.0;
/// Images that are taken to share the bits of public content.
const SHARING: f32 = 4.0;
/// Blocks of an image that use a piece of public content at least.
const LEAST_REUSE: u32 = 64;
/// Cells in a row of a public codebook.
const PUBLIC_CELLS: u32 = 8;
