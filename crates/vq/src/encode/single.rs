//! One encode for one size of codebook; what does not depend on that size is prepared once.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use ndarray::Array2;
use rayon::prelude::*;
use texfold_bc::Content;
use texfold_codebook::{Match, Search, Settings, build};
use texfold_core::image::{ImageSet, Raster};
use texfold_core::{Effort, EncodeError, ImageLayout, Notes};

use super::assemble::{Draft, Stored, assign};
use super::blocks::Blocks;
use super::importance::{block_weights, importance_maps};
use super::plan::Grid;
use super::samples::{Choice, sample_windows};
use super::usability::Words;
use crate::encoded::{CodebookPart, VqTexture, size_classes};
use crate::guidance::Map;
use crate::{VqParams, VqSource};

/// Blocks that codewords are learnt from: 32 for each of the most codewords there can be.
const TRAINING_BLOCKS: usize = 1 << 17;
/// Images of at most so many blocks may also point at windows that lie across codewords: 0.2 to 0.3 dB at no bits, for
/// twice the time of the search.
const STRADDLING_BLOCKS: usize = 1 << 16;
/// Up to so many blocks further rounds cost next to nothing.
const FEW_BLOCKS: usize = 1 << 14;
/// Share of blocks that further blocks should fit as well as: the join threshold of later frames.
const JOIN_QUANTILE: f64 = 0.9;
/// Smallest join threshold, 8-bit RMS: below it rounding alone would make new codewords.
const LEAST_JOIN_RMS: f32 = 2.0;

/// What every size of codebook shares.
pub(crate) struct Prepared<'s> {
    pub(crate) source: VqSource<'s>,
    /// What quality is held against: the source as it was given.
    pub(crate) reference: &'s ImageSet,
    pub(crate) params: VqParams,
    pub(crate) layout: ImageLayout,
    pub(crate) blocks: Blocks,
    pub(crate) maps: Vec<Map>,
    pub(crate) weights: Vec<f32>,
    pub(crate) words: Words,
    /// Blocks that codewords are learnt from.
    training: Vec<usize>,
    /// Number and side of samples that pay, by the logarithm of the number of cells.
    samples: Mutex<BTreeMap<u32, (u32, u32)>>,
}

/// One size and kind of codebook.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Request {
    pub(crate) grid: Grid,
    pub(crate) content: Content,
    pub(crate) effort: Effort,
    pub(crate) seed: u64,
}

impl<'s> Prepared<'s> {
    pub(crate) fn new(
        source: VqSource<'s>,
        reference: &'s ImageSet,
        params: &VqParams,
    ) -> Result<Self, EncodeError> {
        let levels = if params.mips { source.images.full_levels().min(16) } else { 1 };
        let blocks = Blocks::cut(source.images, levels);
        let maps = importance_maps(&source)?;
        let weights = block_weights(&blocks, &maps, strength(&source, params));
        let words = Words::new(source.images.images(), &blocks, blocks.len() / 8, 1);
        let stride = blocks.len().div_ceil(TRAINING_BLOCKS).max(1);
        let training = (0..blocks.len()).step_by(stride).collect();
        let layout = source.images.layout(levels);
        Ok(Prepared {
            source,
            reference,
            params: params.clone(),
            layout,
            blocks,
            maps,
            weights,
            words,
            training,
            samples: Mutex::default(),
        })
    }

    pub(crate) fn images(&self) -> &[Raster] {
        self.source.images.images()
    }

    /// `count` samples of `side` texels for a codebook of `grid`.
    pub(crate) fn choose_samples(&self, grid: Grid, (count, side): (u32, u32)) -> Vec<CodebookPart> {
        let choice = Choice {
            images: self.images(),
            blocks: &self.blocks,
            words: &self.words,
            importance: &self.maps,
            weights: self.source.weights,
        };
        choice.choose(grid, count, side)
    }

    /// Number and side of samples: the caller's, or those with the least weighted error among a few, settled once
    /// for each doubling of the codebook.
    pub(crate) fn sample_spec(&self, request: &Request) -> (u32, u32) {
        if let Some(spec) = self.params.samples {
            return spec;
        }
        let side = usual_side(request.grid);
        if side == 0 {
            return (0, 0);
        }
        let key = request.grid.cells().ilog2();
        let known = self.samples.lock().unwrap_or_else(PoisonError::into_inner).get(&key).copied();
        let settled = known.unwrap_or_else(|| {
            let settled = self.best_spec(request, side);
            self.samples.lock().unwrap_or_else(PoisonError::into_inner).insert(key, settled);
            settled
        });
        (settled.0, settled.1.min(side))
    }

    fn best_spec(&self, request: &Request, side: u32) -> (u32, u32) {
        let error = |&count: &u32| {
            let samples = self.choose_samples(request.grid, (count, side));
            let draft = self.learn(request, samples);
            ((count, side), self.weighted_error(request, &draft))
        };
        let errors = usual_counts(self.images().len()).iter().map(error);
        errors.reduce(|best, trial| if trial.1 < best.1 { trial } else { best }).map_or((0, 0), |best| best.0)
    }

    fn weighted_error(&self, request: &Request, draft: &Draft) -> f64 {
        let stored = draft.store(self.images(), (self.layout.pixel, request.content), Effort::Fast, false);
        let matches = assign(&self.blocks, &self.training, stored.windows.view());
        let weights: Vec<f32> = self.training.iter().map(|&row| self.weights[row]).collect();
        weighted_sum(&matches, &weights)
    }

    /// The texture for one size and kind of codebook. Where there are few blocks every number of samples is tried to the
    /// end; else a trial without the last steps decides.
    pub(crate) fn encode(&self, request: &Request) -> VqTexture {
        let side = usual_side(request.grid);
        let settled = self.params.samples.is_some() || side == 0;
        if settled || request.effort == Effort::Fast || self.blocks.len() > FEW_BLOCKS {
            return self.encode_with(request, self.sample_spec(request)).0;
        }
        let trials =
            usual_counts(self.images().len()).iter().map(|&count| self.encode_with(request, (count, side)));
        let best = trials.reduce(|best, trial| if trial.1 < best.1 { trial } else { best });
        best.map_or_else(|| self.encode_with(request, (0, 0)).0, |best| best.0)
    }

    /// The texture with such samples, and its weighted error.
    fn encode_with(&self, request: &Request, spec: (u32, u32)) -> (VqTexture, f64) {
        let samples = self.choose_samples(request.grid, spec);
        let mut draft = self.learn(request, samples);
        let straddling = self.params.effort != Effort::Fast && self.blocks.len() <= STRADDLING_BLOCKS;
        let store = |draft: &Draft, effort: Effort| {
            draft.store(self.images(), (self.layout.pixel, request.content), effort, straddling)
        };
        let weights: Vec<f32> = self.training.iter().map(|&row| self.weights[row]).collect();
        for _ in 0..polish_rounds(request.effort, self.blocks.len()) {
            // Rounds need only know about where the stored form will be.
            let stored = store(&draft, Effort::Fast);
            let matches = assign(&self.blocks, &self.training, stored.windows.view());
            draft.average(&self.blocks, &self.training, &weights, &stored, &matches);
        }
        let stored = store(&draft, request.effort);
        let all: Vec<usize> = (0..self.blocks.len()).collect();
        let matches = assign(&self.blocks, &all, stored.windows.view());
        let error = weighted_sum(&matches, &self.weights);
        (self.texture(&draft, stored, &matches), error)
    }

    /// Codewords for the blocks that the samples do not show as well as a codeword would.
    fn learn(&self, request: &Request, samples: Vec<CodebookPart>) -> Draft {
        let cells = request.grid.free_cells(&samples).len();
        let left: Vec<usize> = if samples.is_empty() {
            self.training.clone()
        } else {
            let search = Search::new(sample_windows(self.images(), &samples).view());
            let reach = self.words.distortion;
            let unseen = |&row: &usize| search.nearest(self.blocks.vector(row), reach).is_none();
            self.training.par_iter().copied().filter(unseen).collect()
        };
        let weights: Vec<f32> = left.iter().map(|&row| self.weights[row]).collect();
        let settings = lloyd_settings(request.effort, left.len(), request.seed);
        let built = build(self.blocks.subset(&left).view(), &weights, cells, settings);
        Draft { grid: request.grid, samples, codewords: by_brightness(built.codewords) }
    }

    /// The shipped form of a draft whose every block is matched.
    pub(crate) fn texture(&self, draft: &Draft, stored: Stored, matches: &[Match]) -> VqTexture {
        let (mut classes, places) = size_classes(&self.layout, stored.planes.swizzle().0);
        for (surface, &(class, place)) in places.iter().enumerate() {
            let class = &mut classes[class];
            let start = self.blocks.starts[surface];
            for block in 0..class.blocks() {
                let position = class.position(place, block);
                class.index[position] = stored.corners[matches[start + block as usize].index as usize];
            }
        }
        let cells = draft.grid.free_cells(&draft.samples).len();
        VqTexture {
            layout: self.layout.clone(),
            codebook: stored.planes,
            texels: stored.texels,
            classes,
            places,
            samples: draft.samples.clone(),
            free_cells: (cells - draft.codewords.nrows()) as u32,
            join_rms: join_rms(matches, self.blocks.vectors.ncols()),
            notes: Notes::default(),
        }
    }
}

fn weighted_sum(matches: &[Match], weights: &[f32]) -> f64 {
    matches.iter().zip(weights).map(|(found, &weight)| f64::from(found.distance) * f64::from(weight)).sum()
}

/// RMS error, in 8-bit units, that all but the worst blocks keep.
fn join_rms(matches: &[Match], dims: usize) -> f32 {
    let mut distances: Vec<f32> = matches.iter().map(|found| found.distance).collect();
    distances.sort_by(f32::total_cmp);
    let at = ((distances.len().max(1) - 1) as f64 * JOIN_QUANTILE) as usize;
    let distance = distances.get(at).copied().unwrap_or(0.0);
    (255.0 * (distance / dims.max(1) as f32).sqrt()).max(LEAST_JOIN_RMS)
}

/// Side of samples that suits a codebook: a quarter to an eighth of its area; 0 where that would be a handful of blocks.
pub(crate) fn usual_side(grid: Grid) -> u32 {
    match grid.cells() {
        0..=127 => 0,
        128..=511 => 16,
        512..=1023 => 32,
        _ => 64,
    }
}

/// Numbers of samples that are worth a trial: frames of a sequence repeat more than parts of one image do.
fn usual_counts(images: usize) -> &'static [u32] {
    if images > 1 { &[0, 1, 2, 3, 4] } else { &[0, 1] }
}

/// How strongly importance weighs: frames of a sequence count alike, as in the paper, unless something was painted.
fn strength(source: &VqSource<'_>, params: &VqParams) -> f32 {
    let single = source.images.images().len() == 1 || source.painted.is_some() || source.mesh.is_some();
    if single { params.importance } else { 0.0 }
}

/// Rounds that move the codewords to what uses them in the stored form.
fn polish_rounds(effort: Effort, blocks: usize) -> u32 {
    match effort {
        Effort::Fast => 0,
        Effort::Normal if blocks <= FEW_BLOCKS => 3,
        Effort::Normal => 1,
        Effort::High => 4,
    }
}

fn lloyd_settings(effort: Effort, blocks: usize, seed: u64) -> Settings {
    let (rounds, least_gain) = match effort {
        Effort::Fast => (4, 0.02),
        Effort::Normal if blocks <= FEW_BLOCKS => (20, 2e-3),
        Effort::Normal => (12, 4e-3),
        Effort::High => (60, 2e-4),
    };
    Settings { rounds, least_gain, seed }
}

/// Orders codewords by their mean, so that neighbouring blocks have similar indices, which compress better.
pub(crate) fn by_brightness(codewords: Array2<f32>) -> Array2<f32> {
    let mean: Vec<f32> = codewords.rows().into_iter().map(|row| row.sum()).collect();
    let mut order: Vec<usize> = (0..mean.len()).collect();
    order.sort_by(|&a, &b| mean[a].total_cmp(&mean[b]).then(a.cmp(&b)));
    codewords.select(ndarray::Axis(0), &order)
}
