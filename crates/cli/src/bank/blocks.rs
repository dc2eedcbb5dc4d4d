//! Images by block: all tiles with one step, with which the image as a whole answers the goal.
//!
//! A step a tile would give each the same PSNR, smooth ones finer steps than they need beside rough ones: more bits for the
//! same errors of the image, and noise that changes where tiles meet. The image is read once for each step that is tried,
//! so that no more than a tile of it is held.

use std::cell::Cell;

use texfold_core::image::{Depth, ImageSet};
use texfold_core::metric::{SquaredError, quality};
use texfold_core::target::Measured;
use texfold_core::{Access, EncodeError, Encoded, Goal, ImageSize, Job, Limits, Stage};
use texfold_dct::{Dct, DctImages, DctParams};

use super::sums::{Making, Sums};
use super::task::{BankTask, Grown, Place, write_tile};
use super::tiles::{self, Cut, without_plain_alpha};
use crate::error::CliError;
use crate::input::Remarks;
use crate::progress::Share;
use crate::report::missed;
use texfold::bank::Tile;

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
    let encoding = Encoding { task, params: &params, place, share, passes: Cell::new(0) };
    let found = Dct::search_step(params.goal, depth, |step| {
        encoding.measured(step).map(|measured| (step, measured))
    })?;
    let found = found.ok_or_else(|| task.has_changed())?;
    encoding.write(found.value, found.met)
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
struct Encoding<'e> {
    task: &'e BankTask,
    params: &'e DctParams,
    place: Place<'e>,
    share: &'e Share<'e>,
    /// Times that the image was read.
    passes: Cell<u32>,
}

impl Encoding<'_> {
    /// Hands all tiles to `take`, as they are coded.
    fn each(
        &self,
        mut take: impl FnMut(ImageSet, Cut<'_>) -> Result<(), CliError>,
    ) -> Result<ImageSize, CliError> {
        let BankTask { path, settings, .. } = self.task;
        let (passes, tiles) = (self.passes.replace(self.passes.get() + 1), self.place.categories.len());
        let mut taken = 0;
        tiles::each(path, settings, self.place.limit_bytes, &mut Remarks::default(), |cut| {
            let done = done(passes, taken as f32 / tiles.max(1) as f32);
            self.share.report(Stage { name: "coding blocks", done });
            taken += 1;
            let tile = cut.tile.clone().with_peak(self.place.peak);
            take(ImageSet::single(without_plain_alpha(tile)), cut)
        })
    }

    /// A tile with that step.
    fn tile(&self, set: &ImageSet, step: u16) -> Result<DctImages, CliError> {
        let mut job = Job::new(Limits::default());
        Dct::encode_at_step(set, self.params, step, &mut job).map_err(|source| self.fault(source))
    }

    fn fault(&self, source: EncodeError) -> CliError {
        CliError::Encode { path: self.task.path.clone(), source }
    }

    /// What all tiles with that step come to.
    fn measured(&self, step: u16) -> Result<Measured, CliError> {
        let (mut color, mut worst_block_rms) = (SquaredError::default(), 0.0f64);
        let (mut bits, mut texels) = (0, 0);
        self.each(|set, _| {
            let images = self.tile(&set, step)?;
            bits += images.memory().goal;
            texels += set.texel_count();
            // Bits need no decoding.
            if !matches!(self.params.goal, Goal::Bpp(_)) {
                let found = quality(&set, &images);
                color = color + found.color;
                worst_block_rms = worst_block_rms.max(found.worst_block_rms);
            }
            Ok(())
        })?;
        Ok(Measured { psnr: color.psnr(), bpp: bits as f64 / texels.max(1) as f64, worst_block_rms })
    }

    /// Writes all tiles with that step.
    fn write(&self, step: u16, met: bool) -> Result<(Sums, ImageSize, Vec<Grown>), CliError> {
        let Place { dir, first, categories, .. } = self.place;
        let (mut sums, mut next) = (Sums::default(), first);
        let mut of_tile = categories.iter();
        let size = self.each(|set, cut| {
            let category = *of_tile.next().ok_or_else(|| self.task.has_changed())?;
            let images = self.tile(&set, step)?;
            let described = images.described(&set, self.params, met, &Job::default());
            let images = described.map_err(|source| self.fault(source))?;
            let (size, (x, y)) = (cut.tile.size(), cut.place);
            let tile = Tile {
                file: write_tile(&images, dir, &mut next)?,
                x,
                y,
                width: size.width,
                height: size.height,
                category: category as u32,
                grown_rows: 0,
                own_cells: 0,
                blocks: [0; 3],
            };
            sums.add(tile, &set, &images, 0);
            Ok(())
        })?;
        Ok((sums, size, joined(categories)))
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
