//! Tiles of an image encoded and written: by block with one step, or by texel with public codebooks.

use std::cell::Cell;
use std::path::Path;

use texfold::bank::{
    Codebooks, Grown, Seen, SourceTile, TexelTiles, TileSource, WriteError, block_tile_entry, encode_blocks,
    search_blocks, write_tile,
};
use texfold_core::image::Depth;
use texfold_core::{Access, Goal, ImageSize, Job, Limits, Stage};
use texfold_dct::Dct;

use super::fault;
use super::sums::{Making, Sums};
use super::task::BankTask;
use super::tiles;
use crate::error::CliError;
use crate::input::Remarks;
use crate::progress::Share;
use crate::report::missed;

/// Passes after which progress is at a half.
const USUAL_PASSES: f32 = 4.0;

/// An image that is being encoded.
pub(super) struct Encode<'e> {
    pub(super) task: &'e BankTask,
    /// The bank's folder.
    pub(super) dir: &'e Path,
    /// Number of its first file.
    pub(super) first: u32,
    /// Categories of its tiles, row by row.
    pub(super) categories: &'e [usize],
    pub(super) depth: Depth,
    /// Reference value of errors: [`texfold_core::image::Raster::peak`].
    pub(super) peak: f32,
    pub(super) limit_bytes: u64,
    pub(super) share: &'e Share<'e>,
}

/// Figures of an image's tiles, its size, the verdict, and its categories with their codebooks as they have grown.
pub(super) struct Encoded {
    pub(super) sums: Sums,
    pub(super) size: ImageSize,
    pub(super) making: Making,
    pub(super) grown: Vec<Grown>,
}

impl Encode<'_> {
    /// All tiles with one step, with which the image as a whole meets the goal.
    pub(super) fn blocks(&self) -> Result<Encoded, CliError> {
        let params = self.task.settings.encode.params::<Dct>();
        let failed = |error| fault(&self.task.path, error);
        let source = Source { encode: self, passes: Some(Cell::new(0)) };
        let mut seen = Seen { depth: self.depth, peak: self.peak, ..Seen::default() };
        if !matches!(params.goal, Goal::Tolerance(_)) {
            let look = source.each_tile(0, &mut |tile| {
                seen.add(&tile.texels);
                Ok(())
            });
            look.map_err(failed)?;
        }
        let (mut sums, mut next, mut of_tile) = (Sums::default(), self.first, self.categories.iter());
        let found = search_blocks(&source, &params, &seen).and_then(|found| {
            encode_blocks(&source, &params, found, &seen, |place, set, images| {
                let category = *of_tile.next().ok_or(WriteError::Changed)?;
                let size = set.images()[0].size();
                let tile = block_tile_entry(write_tile(&images, self.dir, &mut next)?, place, size, category);
                sums.add(tile, &set, &images, 0);
                Ok(())
            })
        });
        let size = found.map_err(failed)?;
        let measured = sums.measured();
        let verdict =
            format!("{} tiles by block with one step; {:.3} bits a texel.", sums.tiles.len(), measured.bpp);
        let warning = missed(params.goal, &measured);
        let making = Making { access: Access::Block, goal_met: Some(warning.is_none()), verdict, warning };
        Ok(Encoded { sums, size, making, grown: Grown::of_tiles(self.categories) })
    }

    /// Each tile for itself meets the goal, with public codebooks that it uses and adds to.
    pub(super) fn texels(&self, codebooks: &Codebooks) -> Result<Encoded, CliError> {
        let Encode { dir, first, categories, peak, .. } = *self;
        let params = &self.task.params();
        let tiles = TexelTiles { params, dir, first, peak, categories, codebooks };
        let mut progress = |stage| self.share.report(stage);
        let mut job = Job::new(Limits::default()).with_progress(&mut progress);
        let mut sums = Sums::default();
        let encoded = tiles.encode(&Source { encode: self, passes: None }, &mut job, |tile| {
            sums.add(tile.entry, &tile.source, &tile.texture, tile.grown_bits);
            Ok(())
        });
        let (size, grown) = encoded.map_err(|error| fault(&self.task.path, error))?;
        // Tiles are coded for the goal one by one.
        let making = Making { access: Access::Texel, goal_met: None, verdict: sums.shares(), warning: None };
        Ok(Encoded { sums, size, making, grown })
    }
}

/// The tiles of an image, read from its file.
struct Source<'e> {
    encode: &'e Encode<'e>,
    /// Times that the image was read, where progress counts them.
    passes: Option<Cell<u32>>,
}

impl TileSource for Source<'_> {
    type Error = WriteError;

    fn each_tile(
        &self,
        apron: u32,
        take: &mut dyn FnMut(SourceTile) -> Result<(), WriteError>,
    ) -> Result<ImageSize, WriteError> {
        let Encode { task: BankTask { path, settings, .. }, share, categories, limit_bytes, .. } =
            self.encode;
        let passes = self.passes.as_ref().map(|passes| passes.replace(passes.get() + 1));
        let mut taken = 0;
        let read = tiles::each(path, settings, *limit_bytes, &mut Remarks::default(), |cut| {
            if let Some(passes) = passes {
                let done = done(passes, taken as f32 / categories.len().max(1) as f32);
                share.report(Stage { name: "coding blocks", done });
            }
            taken += 1;
            let around = if apron > 0 { cut.around(apron)? } else { None };
            take(SourceTile { place: cut.place, texels: cut.tile, around })
                .map_err(|error| fault(path, error))
        });
        read.map_err(|error| WriteError::Source(Box::new(error)))
    }
}

/// Progress after so many passes over the image and a part of the next; the number of passes of a search is not known before.
fn done(passes: u32, part: f32) -> f32 {
    let passes = passes as f32 + part;
    passes / (passes + USUAL_PASSES)
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
