//! Choice of the image samples: the windows with the most guidance (paper sections 3.1 and 3.4).
//!
//! Guidance = normalised usability + normalised importance, by their weights. After each choice the blocks that it
//! shows within tolerance no longer count for usability, nor its texels for importance.

use rayon::prelude::*;
use texfold_codebook::Search;
use texfold_core::image::Raster;
use texfold_core::{CancelCheck, EncodeError};

use super::blocks::Blocks;
use super::importance::Integral;
use super::usability::Words;
use crate::GuidanceWeights;
use crate::grid::{CodebookPart, Grid};
use crate::guidance::Map;

/// Step of sample positions in texels: that of the image's own blocks, so that a sample's cells are blocks
/// of the image.
const POSITION_STEP: u32 = 4;

/// How many image samples, and how many texels a side each has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct SampleSpec {
    pub(crate) count: u32,
    pub(crate) side: u32,
}

impl SampleSpec {
    /// No sample.
    pub(crate) const NONE: SampleSpec = SampleSpec { count: 0, side: 0 };
}

/// What samples are chosen by.
pub(crate) struct Choice<'a> {
    pub(crate) images: &'a [Raster],
    pub(crate) blocks: &'a Blocks,
    pub(crate) words: &'a Words,
    pub(crate) importance: &'a [Map],
    pub(crate) weights: GuidanceWeights,
    pub(crate) cancel: CancelCheck<'a>,
}

#[derive(Debug, Clone, Copy)]
struct Position {
    image: usize,
    x: u32,
    y: u32,
    usability: f32,
    importance: f32,
}

impl Choice<'_> {
    /// At most as many samples as `spec` says for a codebook of `grid`.
    pub(crate) fn choose(&self, grid: Grid, spec: SampleSpec) -> Result<Vec<CodebookPart>, EncodeError> {
        let SampleSpec { count, side } = spec;
        let mut importance: Vec<Map> = self.importance.to_vec();
        let mut left: Vec<f32> = (0..self.images.len())
            .flat_map(|image| self.blocks.of_level0(image))
            .map(|row| self.blocks.inside[row])
            .collect();
        let mut samples: Vec<CodebookPart> = Vec::new();
        for (x, y) in grid.sample_places(count, side) {
            let best = self.best(&importance, &left, side);
            self.cancel.checkpoint()?;
            let Some(best) = best else { break };
            let (image, source_x, source_y) = (best.image as u32, best.x, best.y);
            samples.push(CodebookPart { x, y, side, image, source_x, source_y });
            for row in source_y..source_y + side {
                let mut line = importance[best.image].row_mut(row as usize);
                (source_x..source_x + side).for_each(|column| line[column as usize] = 0.0);
            }
            self.strike_out(&samples[samples.len() - 1..], &mut left);
        }
        self.cancel.checkpoint().map(|()| samples)
    }

    fn best(&self, importance: &[Map], left: &[f32], side: u32) -> Option<Position> {
        let positions: Vec<Position> =
            (0..self.images.len()).flat_map(|image| self.positions(image, importance, left, side)).collect();
        let most =
            |value: fn(&Position) -> f32| positions.iter().map(value).fold(f32::MIN_POSITIVE, f32::max);
        let (most_usable, most_important) = (most(|p| p.usability), most(|p| p.importance));
        let others = self.weights.saliency.max(self.weights.painted).max(self.weights.distortion);
        let guidance = |p: &Position| {
            self.weights.usability * p.usability / most_usable + others * p.importance / most_important
        };
        // The first of equals, so that the choice does not depend on anything but the image.
        positions.into_iter().reduce(|best, p| if guidance(&p) > guidance(&best) { p } else { best })
    }

    fn positions(&self, image: usize, importance: &[Map], left: &[f32], side: u32) -> Vec<Position> {
        let size = self.images[image].size();
        if size.width < side || size.height < side || self.cancel.is_cancelled() {
            return Vec::new();
        }
        let usability = self.words.usability(image, side, left);
        let integral = Integral::new(&importance[image], self.cancel);
        let step = usability.step.max(POSITION_STEP);
        let stride = (step / usability.step) as usize;
        let (rows, columns) = usability.values.dim();
        (0..rows)
            .step_by(stride)
            .flat_map(|row| (0..columns).step_by(stride).map(move |column| (row, column)))
            .filter_map(|(row, column)| {
                let (x, y) = (column as u32 * usability.step, row as u32 * usability.step);
                // Windows that are further apart than a square's last ones leave room for squares that hang over.
                let is_inside = x + side <= size.width && y + side <= size.height;
                let importance = is_inside.then(|| integral.mean(x, y, side))?;
                Some(Position { image, x, y, usability: usability.values[[row, column]], importance })
            })
            .collect()
    }

    /// Sets the weight of blocks that the samples match within tolerance to 0.
    fn strike_out(&self, samples: &[CodebookPart], left: &mut [f32]) {
        let windows = sample_windows(self.images, samples);
        let search = Search::new(windows.view());
        let rows: Vec<usize> =
            (0..self.images.len()).flat_map(|image| self.blocks.of_level0(image)).collect();
        let reach = self.words.distortion;
        left.par_iter_mut().zip(rows).for_each(|(weight, row)| {
            if *weight > 0.0
                && !self.cancel.is_cancelled()
                && search.nearest(self.blocks.vector(row), reach).is_some()
            {
                *weight = 0.0;
            }
        });
    }
}

/// All windows of the samples, cut from the images.
pub(crate) fn sample_windows(images: &[Raster], samples: &[CodebookPart]) -> ndarray::Array2<f32> {
    let dims = 16 * usize::from(images[0].info().channels);
    let mut values = Vec::new();
    for part in samples {
        for (y, x) in (0..part.side - 3).flat_map(|y| (0..part.side - 3).map(move |x| (y, x))) {
            let start = values.len();
            values.resize(start + dims, 0.0);
            let image = &images[part.image as usize];
            super::blocks::window(image, part.source_x + x, part.source_y + y, &mut values[start..]);
        }
    }
    let rows = values.len() / dims;
    ndarray::Array2::from_shape_vec((rows, dims), values)
        .unwrap_or_else(|_| ndarray::Array2::zeros((0, dims)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::image::{ColorSpace, ImageSet};

    #[test]
    fn samples_of_large_images_lie_inside() {
        // Windows are 8 texels apart here, and 24 - 4 is no multiple of that.
        let (width, height) = (1204, 1004);
        let bytes: Vec<u8> = (0..width * height).map(|i| (i % width / 5 + i / width / 4) as u8).collect();
        let image = Raster::from_u8(width, height, 1, ColorSpace::Srgb, &bytes).unwrap();
        let cancel = CancelCheck::default();
        let blocks = Blocks::cut(&ImageSet::single(image.clone()), 1, cancel).unwrap();
        let images = [image];
        let words = Words::new(&images, &blocks, 16, cancel).unwrap();
        let importance = [Map::zeros((height as usize, width as usize))];
        let choice = Choice {
            images: &images,
            blocks: &blocks,
            words: &words,
            importance: &importance,
            weights: GuidanceWeights::default(),
            cancel,
        };
        let left = vec![1.0; blocks.inside.len()];
        let positions = choice.positions(0, &importance, &left, 24);
        assert!(!positions.is_empty());
        assert!(positions.iter().all(|at| at.x + 24 <= width && at.y + 24 <= height));
    }
}
