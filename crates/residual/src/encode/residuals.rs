//! The residuals of all images of a texture, in the order of their planes' blocks.

use std::ops::Range;

use texfold_core::ImageSize;
use texfold_core::image::Raster;
use texfold_core::{CancelCheck, Effort, EncodeError, Metric, Texel};

use super::axes::{suited, turn};
use super::coder::Coder;
use super::eye::{factors, forgive_hidden, importance, scale};
use super::transform::{ResidualBlock, blocks};
use crate::axes::Axes;
use crate::plane::{BLOCK_SIDE, ResidualPlane, plane_words};
use crate::rates::{RATE_CLASSES, RateModel};

/// Bits of the plane that stands for a residual plane where there is none.
const EMPTY_PLANE_BITS: u64 = 32;

/// Bits of a block of class 1 that are tried: 15 classes reach 3.75 bits a texel with the first, 7.5 with the second.
pub const CLASS_BITS: [u32; 2] = [16, 32];

/// Share of the blocks in the largest class from which larger classes are tried.
pub const CROWDED: f64 = 0.02;

/// The residuals of all blocks, image by image, level by level.
#[derive(Debug, Default)]
pub struct Residuals {
    /// All blocks.
    pub blocks: Vec<ResidualBlock>,
    /// Whether a block is of level 0, which goals are held against.
    pub counted: Vec<bool>,
    /// Blocks of each image.
    counts: Vec<usize>,
    /// Along which axes the blocks' coefficients are.
    pub axes: Axes,
    /// What errors count.
    metric: Metric,
    /// How errors of each block count; alike where there are none.
    importance: Vec<f32>,
}

impl Residuals {
    /// Begins the next image.
    pub fn begin_image(&mut self) {
        self.counts.push(0);
    }

    /// Adds the next level of the image that was begun last: `source` less what `decode` gives of rows of it.
    /// `counted`: whether goals are held against it. Returns the decoded texels.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] within a strip of rows of the caller's wish.
    pub fn push_level(
        &mut self,
        source: &Raster,
        decode: impl FnMut(Range<u32>, &mut [Texel]),
        counted: bool,
        check: CancelCheck<'_>,
    ) -> Result<Vec<Texel>, EncodeError> {
        let mut decoded = decode_strips(source.size(), decode, check)?;
        forgive_hidden(source, &mut decoded);
        let found = blocks(source, &decoded);
        self.counted.resize(self.counted.len() + found.len(), counted);
        if let Some(count) = self.counts.last_mut() {
            *count += found.len();
        }
        self.blocks.extend(found);
        check.checkpoint()?;
        Ok(decoded)
    }

    /// Turns luma and chroma of all blocks, which are along [`Axes::default`] so far, to such axes.
    pub fn turn(&mut self, axes: Axes) {
        turn(&mut self.blocks, axes);
        self.axes = axes;
    }

    /// The axes that suit the residuals of level 0: their principal components, or luma and chroma where these are about as good.
    #[must_use]
    pub fn suited_axes(&self) -> Axes {
        suited(&self.blocks, &self.counted)
    }

    /// Lets errors of all blocks, which count as squares so far, count by a metric. Returns what share of the squares counts.
    pub fn judge_by(&mut self, metric: Metric) -> f32 {
        self.metric = metric;
        if metric == Metric::Psnr {
            return 1.0;
        }
        let energy = |blocks: &[ResidualBlock]| {
            blocks.iter().map(|block| f64::from(block.energy.iter().sum::<f32>())).sum::<f64>()
        };
        let before = energy(&self.blocks);
        scale(&mut self.blocks, &factors(metric));
        self.importance = importance(&self.blocks);
        if before > 0.0 { (energy(&self.blocks) / before) as f32 } else { 1.0 }
    }

    /// All blocks with a model that was trained on them.
    #[must_use]
    pub fn coder(&self, model: RateModel, effort: Effort) -> Coder<'_> {
        Coder::new(&self.blocks, model, effort).with_importance(&self.importance)
    }

    /// That model as it is stored: with the axes, and weights for coefficients as they are.
    #[must_use]
    pub fn stored_model(&self, model: &RateModel) -> RateModel {
        let mut stored = model.clone().with_axes(self.axes);
        for (weight, factor) in stored.weights.iter_mut().zip(factors(self.metric)) {
            *weight = (f32::from(*weight) / factor).round().min(f32::from(u16::MAX)) as u16;
        }
        stored
    }

    /// Bits in memory of the residual planes where class 1 has `class_bits` and blocks have such classes.
    #[must_use]
    pub fn plane_bits(&self, class_bits: u32, classes: &[u8]) -> u64 {
        if classes.iter().all(|&class| class == 0) {
            return EMPTY_PLANE_BITS * self.counts.len() as u64;
        }
        let (mut first, mut words) = (0, 0);
        for &count in &self.counts {
            let sum: u64 = classes[first..first + count].iter().map(|&class| u64::from(class)).sum();
            words += plane_words(count, sum * u64::from(class_bits / 16));
            first += count;
        }
        32 * words
    }

    /// The residual planes of blocks of such classes, which `coder` has coded; `None` where all are of class 0.
    #[must_use]
    pub fn planes(&self, coder: &Coder<'_>, classes: &[u8]) -> Option<Vec<ResidualPlane>> {
        // A plane of nothing is left out.
        if classes.iter().all(|&class| class == 0) {
            return None;
        }
        let mut planes = Vec::new();
        let mut first = 0;
        for &count in &self.counts {
            let mut plane = ResidualPlane::default();
            for (index, &class) in (first..first + count).zip(&classes[first..first + count]) {
                let found = coder.found(index, class);
                plane.classes.push(class);
                plane.scales.push(found.map_or(0, |found| found.scale));
                plane.bits.extend(found.iter().flat_map(|found| &found.halves));
            }
            planes.push(plane);
            first += count;
        }
        Some(planes)
    }
}

/// Rows of blocks that are decoded between two looks at whether the job was cancelled.
const STRIP_ROWS: u32 = 8 * BLOCK_SIDE;

/// All texels of a level of that size, of which `decode` gives rows, row by row.
///
/// # Errors
/// [`EncodeError::Cancelled`] within a strip of rows of the caller's wish.
pub fn decode_strips(
    size: ImageSize,
    mut decode: impl FnMut(Range<u32>, &mut [Texel]),
    check: CancelCheck<'_>,
) -> Result<Vec<Texel>, EncodeError> {
    let mut texels = vec![Texel::ZERO; size.width as usize * size.height as usize];
    let strips = texels.chunks_mut((size.width * STRIP_ROWS) as usize);
    for (first, strip) in (0..size.height).step_by(STRIP_ROWS as usize).zip(strips) {
        check.checkpoint()?;
        decode(first..(first + STRIP_ROWS).min(size.height), strip);
    }
    Ok(texels)
}

/// Share of the blocks that are of the largest class.
#[must_use]
pub fn share_of_largest(classes: &[u8]) -> f64 {
    let largest = classes.iter().filter(|&&class| usize::from(class) + 1 == RATE_CLASSES).count();
    largest as f64 / classes.len() as f64
}
