//! Images by texel: each tile for itself answers the goal, with public codebooks that it uses and adds to.

use std::path::Path;

use texfold_core::container::SectionWriter;
use texfold_core::image::ImageSet;
use texfold_core::{Access, ImageSize, Job, Limits, TextureCodec};
use texfold_progressive::{Progressive, ProgressiveTexture, Shared};

use super::fault;
use super::sums::{Making, Sums};
use super::task::{BankTask, Books, Grown, Place};
use super::tiles::{self, Cut};
use crate::error::CliError;
use crate::input::Remarks;
use crate::output::write_whole;
use crate::progress::Share;
use texfold::bank::{Tile, without_plain_alpha, write_tile};

/// Rows of texels that a public codebook may have: 512 of 256 texels are 64 kB in BC4.
const MOST_ROWS: u32 = 512;

/// Encodes an image and writes its files: what its tiles come to, its size, and the codebooks as it leaves them.
pub(super) fn encode(
    task: &BankTask,
    books: &Books,
    place: Place<'_>,
    share: &Share<'_>,
) -> Result<(Sums, ImageSize, Vec<Grown>), CliError> {
    let Place { dir, first, categories, limit_bytes, peak } = place;
    let mut encoding = Encoding { task, dir, peak, next: first, grown: Vec::new(), sums: Sums::default() };
    let mut of_tile = categories.iter();
    let size = tiles::each(&task.path, &task.settings, limit_bytes, &mut Remarks::default(), |cut| {
        let category = *of_tile.next().ok_or_else(|| task.has_changed())?;
        encoding.enter(category, books);
        encoding.add_tile(category, cut, share)
    })?;
    Ok((encoding.sums, size, encoding.grown))
}

/// How such an image was made.
pub(super) fn making(sums: &Sums) -> Making {
    let count = |index: usize| sums.tiles.iter().map(|tile| tile.blocks[index]).sum::<u64>();
    let all = count(2).max(1) as f64;
    let rows: u32 = sums.tiles.iter().map(|tile| tile.grown_rows).sum();
    let verdict = format!(
        "{} tiles; {:.0}% of the blocks use public content and {:.0}% the tiles' own; the public codebooks grew by {rows} rows.",
        sums.tiles.len(),
        100.0 * count(0) as f64 / all,
        100.0 * count(1) as f64 / all
    );
    // Tiles are coded for the goal one by one.
    Making { access: Access::Texel, goal_met: None, verdict, warning: None }
}

/// An image that is being encoded.
struct Encoding<'m> {
    task: &'m BankTask,
    dir: &'m Path,
    peak: f32,
    /// Number of its next file.
    next: u32,
    grown: Vec<Grown>,
    sums: Sums,
}

impl Encoding<'_> {
    /// Makes sure that a category is among those of the image.
    fn enter(&mut self, number: usize, books: &Books) {
        if self.grown.iter().all(|grown| grown.number != number) {
            let book = books.get(&number).cloned().flatten();
            self.grown.push(Grown { number, tiles: 0, book, file: None });
        }
    }

    fn add_tile(&mut self, category: usize, cut: Cut<'_>, share: &Share<'_>) -> Result<(), CliError> {
        let Encoding { task, dir, peak, next, grown, sums } = self;
        let Some(grown) = grown.iter_mut().find(|grown| grown.number == category) else { return Ok(()) };
        let (size, (x, y)) = (cut.tile.size(), cut.place);
        let around = cut.around()?;
        let set = ImageSet::single(without_plain_alpha(cut.tile.with_peak(*peak)));
        let around = around.map(|around| around.with_channels(set.info().channels));
        let shared = Shared { public: grown.book.clone(), most_rows: MOST_ROWS, apron: around };
        let mut progress = |stage| share.report(stage);
        let mut job = Job::new(Limits::default()).with_progress(&mut progress);
        let texture = Progressive::encode_shared(&set, &task.params(), &shared, &mut job)
            .map_err(|source| CliError::Encode { path: task.path.clone(), source })?;
        let grown_rows = grown.grow(dir, &texture, next)?;
        let file = write_tile(&texture, dir, next).map_err(|error| fault(&task.path, error))?;
        let details = texture.details();
        let tile = Tile {
            file,
            x,
            y,
            width: size.width,
            height: size.height,
            category: category as u32,
            grown_rows,
            own_cells: details
                .and_then(|details| details.private.as_ref())
                .map_or(0, |book| book.size().0 * book.size().1 / texfold_progressive::CELL_SIDE.pow(2)),
            blocks: blocks(&texture),
        };
        sums.add(tile, &set, &texture, grown_bits(&texture, grown_rows));
        Ok(())
    }
}

impl Grown {
    /// Takes over the codebook that a texture uses; rows that it grew by. A grown one is written as a new file.
    fn grow(&mut self, dir: &Path, texture: &ProgressiveTexture, next: &mut u32) -> Result<u32, CliError> {
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

/// Bits of the rows that a public codebook grew by.
fn grown_bits(texture: &ProgressiveTexture, grown_rows: u32) -> u64 {
    let public = texture.details().and_then(|details| details.public.as_ref());
    let share = public.map_or(0.0, |book| f64::from(grown_rows) / f64::from(book.size().1));
    (texture.shared_bits() as f64 * share).round() as u64
}

/// Blocks that use public content, the texture's own, and all.
fn blocks(texture: &ProgressiveTexture) -> [u64; 3] {
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
