//! Importance of texels, and the weight that it gives to blocks (paper section 3.4).

use ndarray::Array2;
use rayon::prelude::*;
use texfold_core::image::Raster;
use texfold_core::{CancelCheck, EncodeError};

use super::blocks::Blocks;
use crate::classes::blocks_of;
use crate::guidance::{Map, distortion, painted, saliency};
use crate::{GuidanceWeights, VqSource};

/// Weight of the most important block over that of the least important one, less 1, at importance 1. The
/// importance bench charts the trade: larger values take from the whole image what they give to its salient part.
const WEIGHT_GAIN: f32 = 4.0;
/// Exponent on the rank of a block's importance: what is of middling importance weighs little more than the rest.
const WEIGHT_POWER: i32 = 3;

/// Importance of the texels of every image, 0 to 1, without usability.
pub(crate) fn importance_maps(
    source: &VqSource<'_>,
    weights: GuidanceWeights,
    cancel: CancelCheck<'_>,
) -> Result<Vec<Map>, EncodeError> {
    let first = source.images.images()[0].size();
    let painted = source.painted.map(|raster| painted(raster, first, cancel)).transpose()?;
    cancel.checkpoint()?;
    let distortion = source.mesh.map(|mesh| distortion(mesh, first, cancel)).transpose()?;
    cancel.checkpoint()?;
    let map = |(index, image): (usize, &Raster)| {
        let own = if index == 0 { (painted.as_ref(), distortion.as_ref()) } else { (None, None) };
        combine(saliency(image, cancel), own.0, own.1, weights)
    };
    let maps = source.images.images().par_iter().enumerate().map(map).collect();
    cancel.checkpoint().map(|()| maps)
}

/// Weighted mean of the maps that are there; each has its maximum at 1.
fn combine(saliency: Map, painted: Option<&Map>, distortion: Option<&Map>, weights: GuidanceWeights) -> Map {
    let mut total = weights.saliency;
    let mut sum = saliency * weights.saliency;
    for (map, weight) in [(painted, weights.painted), (distortion, weights.distortion)] {
        if let Some(map) = map.filter(|map| map.dim() == sum.dim()) {
            sum.scaled_add(weight, map);
            total += weight;
        }
    }
    if total > 0.0 { sum / total } else { sum }
}

/// Weight of every block: its share inside the image times 1 to `1 + WEIGHT_GAIN x strength` by the rank of its
/// importance, all scaled to a mean of 1 over level 0.
pub(crate) fn block_weights(blocks: &Blocks, maps: &[Map], strength: f32) -> Vec<f32> {
    let ranks = importance_ranks(blocks, maps);
    let gain = |rank: f32| 1.0 + WEIGHT_GAIN * strength * rank.powi(WEIGHT_POWER);
    let mut weights: Vec<f32> =
        blocks.inside.iter().zip(&ranks).map(|(&inside, &rank)| inside * gain(rank)).collect();
    let mean = weights.iter().map(|&weight| f64::from(weight)).sum::<f64>() / weights.len().max(1) as f64;
    weights.iter_mut().for_each(|weight| *weight /= mean as f32);
    weights
}

/// Rank of every block's importance among all, 0 to 1; equal importance has the highest rank of its group, all equal
/// have 0.
pub(crate) fn importance_ranks(blocks: &Blocks, maps: &[Map]) -> Vec<f32> {
    let values = block_importance(blocks, maps);
    let mut sorted = values.clone();
    sorted.par_sort_unstable_by(f32::total_cmp);
    let total = sorted.len().max(2) as f32 - 1.0;
    if sorted.first() == sorted.last() {
        return vec![0.0; values.len()];
    }
    values
        .par_iter()
        .map(|value| (sorted.partition_point(|other| other <= value) - 1) as f32 / total)
        .collect()
}

/// Mean importance of the texels of level 0 that each block of any level shows.
fn block_importance(blocks: &Blocks, maps: &[Map]) -> Vec<f32> {
    let mut values = Vec::new();
    for (image, map) in maps.iter().enumerate() {
        let end = blocks.starts.get(image + 1).copied().unwrap_or(blocks.len());
        let size = blocks.sizes[image];
        let mut level = 0;
        while blocks.starts[image] + level_blocks(size, level + 1) <= end && values.len() < end {
            let (columns, rows) = size.at_level(level).blocks();
            let side = 4u32 << level;
            for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
                values.push(mean_of(map, column * side, row * side, side));
            }
            level += 1;
        }
    }
    values
}

/// Blocks of the first `levels` levels.
fn level_blocks(size: texfold_core::ImageSize, levels: u32) -> usize {
    blocks_of(size, levels) as usize
}

/// Mean of at most 16 values spread over a square.
fn mean_of(map: &Map, x: u32, y: u32, side: u32) -> f32 {
    let (height, width) = map.dim();
    let step = (side / 4).max(1);
    let mut sum = 0.0;
    for (dy, dx) in (0..4).flat_map(|dy| (0..4).map(move |dx| (dy, dx))) {
        let row = ((y + dy * step) as usize).min(height.saturating_sub(1));
        let column = ((x + dx * step) as usize).min(width.saturating_sub(1));
        sum += map[[row, column]];
    }
    sum / 16.0
}

/// Sums over rectangles in constant time.
#[derive(Debug, Clone)]
pub(crate) struct Integral {
    sums: Array2<f64>,
}

impl Integral {
    pub(crate) fn new(map: &Map, cancel: CancelCheck<'_>) -> Self {
        let (rows, columns) = map.dim();
        let mut sums = Array2::zeros((rows + 1, columns + 1));
        for row in (0..rows).take_while(|_| !cancel.is_cancelled()) {
            let mut line = 0.0;
            for column in 0..columns {
                line += f64::from(map[[row, column]]);
                sums[[row + 1, column + 1]] = sums[[row, column + 1]] + line;
            }
        }
        Integral { sums }
    }

    /// Mean over a square that lies inside.
    pub(crate) fn mean(&self, x: u32, y: u32, side: u32) -> f32 {
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = (left + side as usize, top + side as usize);
        let sum = self.sums[[bottom, right]] - self.sums[[top, right]] - self.sums[[bottom, left]]
            + self.sums[[top, left]];
        (sum / (f64::from(side) * f64::from(side))) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::image::{ColorSpace, ImageSet};

    fn flat(width: u32, height: u32) -> Blocks {
        let bytes = vec![100; (width * height) as usize];
        let image = Raster::from_u8(width, height, 1, ColorSpace::Srgb, &bytes).unwrap();
        Blocks::cut(&ImageSet::single(image), 2, CancelCheck::default()).unwrap()
    }

    #[test]
    fn important_blocks_weigh_more_on_every_level() {
        let blocks = flat(32, 16);
        let map = Array2::from_shape_fn((16, 32), |(_, column)| if column >= 16 { 1.0 } else { 0.0 });
        let weights = block_weights(&blocks, &[map], 1.0);
        assert_eq!(weights.len(), blocks.len());
        assert!(weights[7] > 2.0 * weights[0], "level 0: {weights:?}");
        assert!(weights[32 + 3] > 2.0 * weights[32], "level 1: {weights:?}");
        let even = block_weights(&blocks, &[Array2::zeros((16, 32))], 1.0);
        assert!(even.iter().all(|&weight| (weight - 1.0).abs() < 1e-6));
    }

    #[test]
    fn integral_means() {
        let map = Array2::from_shape_fn((6, 5), |(row, column)| (row * 10 + column) as f32);
        let mean = Integral::new(&map, CancelCheck::default()).mean(1, 2, 3);
        assert!((mean - 32.0).abs() < 1e-5, "{mean}");
    }
}
