//! Images by block: all tiles with one step, with which the image as a whole answers the goal.

use std::cell::Cell;

use texfold::bank::{
    Seen, SourceTile, TileSource, WriteError, block_tile_entry, encode_blocks, search_blocks, write_tile,
};
use texfold_core::image::Depth;
use texfold_core::{Access, Goal, ImageSize, Stage};
use texfold_dct::Dct;

use super::fault;
use super::sums::{Making, Sums};
use super::task::{BankTask, Grown, Place};
use super::tiles;
use crate::error::CliError;
use crate::input::Remarks;
use crate::progress::Share;
use crate::report::missed;

/// Passes after which progress is at a half.
const USUAL_PASSES: f32 = 4.0;

/// Encodes an image and writes its files: what its tiles come to, its size, and the categories that they join.
pub(super) fn encode(
    task: &BankTask,
    depth: Depth,
    place: Place<'_>,
    share: &Share<'_>,
) -> Result<(Sums, ImageSize, Vec<Grown>), CliError> {
    let params = task.settings.encode.params::<Dct>();
    let Place { dir, first, categories, peak, .. } = place;
    let source = Source { task, place, share, passes: Cell::new(0) };
    let mut seen = Seen { depth, peak, ..Seen::default() };
    if !matches!(params.goal, Goal::Tolerance(_)) {
        let look = source.each_tile(&mut |tile| {
            seen.add(&tile.texels);
            Ok(())
        });
        look.map_err(|error| fault(&task.path, error))?;
    }
    let (mut sums, mut next, mut of_tile) = (Sums::default(), first, categories.iter());
    let found = search_blocks(&source, &params, &seen).and_then(|found| {
        encode_blocks(&source, &params, found, &seen, |place, set, images| {
            let category = *of_tile.next().ok_or(WriteError::Changed)?;
            let size = set.images()[0].size();
            let tile = block_tile_entry(write_tile(&images, dir, &mut next)?, place, size, category);
            sums.add(tile, &set, &images, 0);
            Ok(())
        })
    });
    let size = found.map_err(|error| fault(&task.path, error))?;
    Ok((sums, size, joined(categories)))
}

/// How such an image was made.
pub(super) fn making(sums: &Sums, goal: Goal) -> Making {
    let measured = sums.measured();
    let verdict =
        format!("{} tiles by block with one step; {:.3} bits a texel.", sums.tiles.len(), measured.bpp);
    let warning = missed(goal, &measured);
    Making { access: Access::Block, goal_met: Some(warning.is_none()), verdict, warning }
}

/// An image that is being encoded.
struct Source<'e> {
    task: &'e BankTask,
    place: Place<'e>,
    share: &'e Share<'e>,
    /// Times that the image was read.
    passes: Cell<u32>,
}

impl TileSource for Source<'_> {
    type Error = WriteError;

    fn each_tile(
        &self,
        take: &mut dyn FnMut(SourceTile) -> Result<(), WriteError>,
    ) -> Result<ImageSize, WriteError> {
        let BankTask { path, settings, .. } = self.task;
        let (passes, tiles) = (self.passes.replace(self.passes.get() + 1), self.place.categories.len());
        let mut taken = 0;
        let read = tiles::each(path, settings, self.place.limit_bytes, &mut Remarks::default(), |cut| {
            let done = done(passes, taken as f32 / tiles.max(1) as f32);
            self.share.report(Stage { name: "coding blocks", done });
            taken += 1;
            take(SourceTile { place: cut.place, texels: cut.tile }).map_err(|error| fault(path, error))
        });
        read.map_err(|error| WriteError::Source(Box::new(error)))
    }
}

/// Progress after so many passes over the image and a part of the next; the number of passes of a search is not known before.
fn done(passes: u32, part: f32) -> f32 {
    let passes = passes as f32 + part;
    passes / (passes + USUAL_PASSES)
}

/// The categories with their tiles; none has grown.
fn joined(categories: &[usize]) -> Vec<Grown> {
    let mut joined: Vec<Grown> = Vec::new();
    for &number in categories {
        match joined.iter_mut().find(|known| known.number == number) {
            Some(known) => known.tiles += 1,
            None => joined.push(Grown { number, tiles: 1, book: None, file: None }),
        }
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_grows_and_does_not_end_before_the_work() {
        let all: Vec<f32> = (0..20).flat_map(|pass| [done(pass, 0.0), done(pass, 0.9)]).collect();
        assert!(all.is_sorted() && all[0] == 0.0 && all[39] < 1.0);
    }
}
