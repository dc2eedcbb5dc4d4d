//! One encode for one size of codebook; what does not depend on that size is prepared once.

use std::collections::{BTreeMap, HashSet};
use std::sync::{Mutex, PoisonError};

use ndarray::Array2;
use rayon::prelude::*;
use texfold_bc::Content;
use texfold_codebook::{Match, Search, Settings, build_unless};
use texfold_core::image::{ImageSet, Raster};
use texfold_core::{Cached, CancelCheck, Effort, EncodeError, ImageLayout, Notes};

use super::assemble::{Draft, Storage, Stored, assign};
use super::blocks::Blocks;
use super::importance::{block_weights, importance_maps};
use super::plan::MAX_CELLS;
use super::samples::{Choice, SampleSpec, sample_windows};
use super::usability::Words;
use crate::classes::Groups;
use crate::decode::TEXFOLD_VQ_LEVELS;
use crate::encoded::VqTexture;
use crate::grid::CodebookPart;
use crate::grid::Grid;
use crate::guidance::Map;
use crate::parts::Parts;
use crate::{VqParams, VqSource};

/// Blocks that codewords are learnt from: 32 for each of the most codewords there can be.
const TRAINING_BLOCKS: usize = 1 << 17;
/// Blocks for each word of the choice of samples: an eighth of the blocks is about as fine as a codebook gets.
const BLOCKS_A_WORD: usize = 8;
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
    /// Codewords beyond which more bring nothing: twice the blocks that differ, as learning may find some of these twice.
    pub(crate) most_words: u32,
    /// Number and side of samples that pay, by the logarithm of the number of cells.
    samples: Mutex<BTreeMap<u32, SampleSpec>>,
    pub(crate) cancel: CancelCheck<'s>,
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
        cancel: CancelCheck<'s>,
    ) -> Result<Self, EncodeError> {
        let levels = levels(source.images, params);
        let blocks = Blocks::cut(source.images, levels, cancel)?;
        let maps = importance_maps(&source, params.weights, cancel)?;
        let weights = block_weights(&blocks, &maps, strength(&source, params));
        cancel.checkpoint()?;
        let words = Words::new(source.images.images(), &blocks, blocks.len() / BLOCKS_A_WORD, cancel)?;
        let stride = blocks.len().div_ceil(TRAINING_BLOCKS).max(1);
        let training = (0..blocks.len()).step_by(stride).collect();
        let layout = source.images.layout(levels);
        let most_words = (2 * distinct(&blocks)).min(blocks.len()).max(1) as u32;
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
            most_words,
            samples: Mutex::default(),
            cancel,
        })
    }

    pub(crate) fn images(&self) -> &[Raster] {
        self.source.images.images()
    }

    /// The samples for a codebook of `grid`.
    pub(crate) fn choose_samples(
        &self,
        grid: Grid,
        spec: SampleSpec,
    ) -> Result<Vec<CodebookPart>, EncodeError> {
        let choice = Choice {
            images: self.images(),
            blocks: &self.blocks,
            words: &self.words,
            importance: &self.maps,
            weights: self.params.weights,
            cancel: self.cancel,
        };
        choice.choose(grid, spec)
    }

    /// Number and side of samples: the caller's, or those with the least weighted error among a few, settled once
    /// for each doubling of the codebook; with what was learned for them, where it was settled now.
    fn sample_spec(&self, request: &Request) -> Result<(SampleSpec, Option<Draft>), EncodeError> {
        if let Some(spec) = self.chosen_samples() {
            return Ok((spec, None));
        }
        let side = usual_side(request.grid);
        // Samples of a single image of many blocks seldom pay, and their trial takes half of the time.
        let is_single = self.images().len() == 1 && self.blocks.len() > FEW_BLOCKS;
        if side == 0 || is_single && request.effort == Effort::Fast {
            return Ok((SampleSpec::NONE, None));
        }
        let key = request.grid.cells().ilog2();
        let known = self.samples.lock().unwrap_or_else(PoisonError::into_inner).get(&key).copied();
        if let Some(known) = known {
            return Ok((SampleSpec { side: known.side.min(side), ..known }, None));
        }
        let (settled, draft) = self.best_spec(request, side)?;
        self.samples.lock().unwrap_or_else(PoisonError::into_inner).insert(key, settled);
        Ok((settled, draft))
    }

    /// What the caller requested.
    pub(crate) fn chosen_samples(&self) -> Option<SampleSpec> {
        self.params.samples.map(|(count, side)| SampleSpec { count, side })
    }

    fn best_spec(&self, request: &Request, side: u32) -> Result<(SampleSpec, Option<Draft>), EncodeError> {
        let mut drafts = Vec::new();
        for &count in usual_counts(self.images().len()) {
            let spec = SampleSpec { count, side };
            let samples = self.choose_samples(request.grid, spec)?;
            let left = self.unmatched(&samples)?;
            // Samples that match fewer blocks than codewords in their place would hardly win.
            let cells = u64::from(request.grid.cells());
            let taken = cells - request.grid.free_cells(&samples).len() as u64;
            let matched = (self.training.len() - left.len()) as u64;
            if matched * cells >= self.training.len() as u64 * taken {
                drafts.push((spec, self.learn(request, samples, &left)?));
            }
        }
        let mut best = (f64::INFINITY, 0);
        for (number, (_, draft)) in drafts.iter().enumerate().filter(|_| drafts.len() > 1) {
            let error = self.weighted_error(request, draft)?;
            if error < best.0 {
                best = (error, number);
            }
        }
        let chosen = drafts.into_iter().nth(best.1);
        Ok(chosen.map_or((SampleSpec::NONE, None), |(spec, draft)| (spec, Some(draft))))
    }

    fn weighted_error(&self, request: &Request, draft: &Draft) -> Result<f64, EncodeError> {
        let quick = self.storage(request.content, Effort::Fast, false);
        let stored = draft.store(self.images(), quick, self.cancel)?;
        let matches = assign(&self.blocks, &self.training, stored.windows.view(), self.cancel)?;
        let weights: Vec<f32> = self.training.iter().map(|&row| self.weights[row]).collect();
        Ok(weighted_sum(&matches, &weights))
    }

    /// How a codebook is stored.
    pub(crate) fn storage(&self, content: Content, effort: Effort, straddling: bool) -> Storage {
        Storage { pixel: self.layout.pixel, content, effort, straddling }
    }

    /// The texture for one size and kind of codebook. Where there are few blocks every number of samples is tried to
    /// the end; else a trial without the last steps decides.
    pub(crate) fn encode(&self, request: &Request) -> Result<VqTexture, EncodeError> {
        let side = usual_side(request.grid);
        let settled = self.params.samples.is_some() || side == 0;
        if settled || request.effort == Effort::Fast || self.blocks.len() > FEW_BLOCKS {
            let (spec, draft) = self.sample_spec(request)?;
            return Ok(self.encode_with(request, spec, draft)?.0);
        }
        let counts = usual_counts(self.images().len());
        let mut best = self.encode_with(request, SampleSpec { count: counts[0], side }, None)?;
        for &count in &counts[1..] {
            let trial = self.encode_with(request, SampleSpec { count, side }, None)?;
            if trial.1 < best.1 {
                best = trial;
            }
        }
        Ok(best.0)
    }

    /// The texture with such samples, and its weighted error; `learned` is what was learned for them before.
    fn encode_with(
        &self,
        request: &Request,
        spec: SampleSpec,
        learned: Option<Draft>,
    ) -> Result<(VqTexture, f64), EncodeError> {
        let mut draft = match learned {
            Some(draft) => draft,
            None => {
                let samples = self.choose_samples(request.grid, spec)?;
                let left = self.unmatched(&samples)?;
                self.learn(request, samples, &left)?
            }
        };
        let straddling = self.params.effort != Effort::Fast && self.blocks.len() <= STRADDLING_BLOCKS;
        let store = |draft: &Draft, effort: Effort| {
            draft.store(self.images(), self.storage(request.content, effort, straddling), self.cancel)
        };
        let weights: Vec<f32> = self.training.iter().map(|&row| self.weights[row]).collect();
        for _ in 0..polish_rounds(request.effort, self.blocks.len()) {
            // Rounds need only know about where the stored form will be.
            let stored = store(&draft, Effort::Fast)?;
            let matches = assign(&self.blocks, &self.training, stored.windows.view(), self.cancel)?;
            draft.average(&self.blocks, &self.training, &weights, &stored, &matches);
        }
        let stored = store(&draft, request.effort)?;
        let all: Vec<usize> = (0..self.blocks.len()).collect();
        let matches = assign(&self.blocks, &all, stored.windows.view(), self.cancel)?;
        let error = weighted_sum(&matches, &self.weights);
        Ok((self.texture(&draft, stored, &matches), error))
    }

    /// The blocks that the samples do not match as well as a codeword would.
    fn unmatched(&self, samples: &[CodebookPart]) -> Result<Vec<usize>, EncodeError> {
        if samples.is_empty() {
            return Ok(self.training.clone());
        }
        let search = Search::new(sample_windows(self.images(), samples).view());
        let reach = self.words.distortion;
        let unseen = |&row: &usize| {
            !self.cancel.is_cancelled() && search.nearest(self.blocks.vector(row), reach).is_none()
        };
        let left = self.training.par_iter().copied().filter(unseen).collect();
        self.cancel.checkpoint()?;
        Ok(left)
    }

    /// Codewords for those blocks, beside the samples.
    fn learn(
        &self,
        request: &Request,
        samples: Vec<CodebookPart>,
        left: &[usize],
    ) -> Result<Draft, EncodeError> {
        let cells = request.grid.free_cells(&samples).len();
        let weights: Vec<f32> = left.iter().map(|&row| self.weights[row]).collect();
        let settings = lloyd_settings(request.effort, left.len(), request.seed);
        let (vectors, cancel) = (self.blocks.subset(left), self.cancel);
        let built = build_unless(vectors.view(), &weights, cells, settings, &|| cancel.is_cancelled());
        let codewords = by_brightness(built.ok_or(EncodeError::Cancelled)?.codewords);
        Ok(Draft { grid: request.grid, samples, codewords })
    }

    /// The shipped form of a draft whose every block is matched.
    pub(crate) fn texture(&self, draft: &Draft, stored: Stored, matches: &[Match]) -> VqTexture {
        let groups = Groups::of(&self.layout);
        let mut classes = groups.classes(stored.planes.swizzle().0);
        for (image, place) in groups.places.iter().enumerate() {
            let class = &mut classes[place.class];
            let start = self.blocks.starts[image];
            for block in 0..class.blocks() {
                let position = class.position(place.number, block);
                class.index[position] = stored.corners[matches[start + block as usize].index as usize];
            }
        }
        let cells = draft.grid.free_cells(&draft.samples).len();
        let parts = Parts {
            layout: self.layout.clone(),
            codebook: stored.planes,
            classes,
            places: groups.places,
            samples: draft.samples.clone(),
            free_cells: (cells - draft.codewords.nrows()) as u32,
            join_rms: join_rms(matches, self.blocks.vectors.ncols()),
        };
        VqTexture { parts, texels: Cached::from(stored.texels), notes: Notes::default() }
    }
}

/// Number of blocks without their copies, counted up to the most codewords there can be.
fn distinct(blocks: &Blocks) -> usize {
    let mut seen: HashSet<Vec<u32>> = HashSet::new();
    for row in 0..blocks.len() {
        seen.insert(blocks.vector(row).iter().map(|value| value.to_bits()).collect());
        if seen.len() >= MAX_CELLS as usize {
            break;
        }
    }
    seen.len()
}

fn weighted_sum(matches: &[Match], weights: &[f32]) -> f64 {
    matches.iter().zip(weights).map(|(found, &weight)| f64::from(found.distance) * f64::from(weight)).sum()
}

/// RMS error, in 8-bit units, that all but the worst blocks keep.
fn join_rms(matches: &[Match], dims: usize) -> f32 {
    let mut distances: Vec<f32> = matches.iter().map(|found| found.distance).collect();
    distances.par_sort_unstable_by(f32::total_cmp);
    let at = ((distances.len().max(1) - 1) as f64 * JOIN_QUANTILE) as usize;
    let distance = distances.get(at).copied().unwrap_or(0.0);
    (255.0 * (distance / dims.max(1) as f32).sqrt()).max(LEAST_JOIN_RMS)
}

/// Mip levels that are stored.
pub(crate) fn levels(images: &ImageSet, params: &VqParams) -> u32 {
    if params.mips { images.full_levels().min(TEXFOLD_VQ_LEVELS as u32) } else { 1 }
}

/// Side of samples that suits a codebook: a quarter to an eighth of its area; 0 where that would be a handful of
/// blocks.
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

#[cfg(test)]
mod tests {
    use texfold_core::image::ColorSpace;

    use super::*;

    #[test]
    fn copies_of_blocks_are_counted_once() {
        let of = |value: fn(u32, u32) -> u8| {
            let bytes: Vec<u8> = (0..64 * 64).map(|at| value(at % 64, at / 64)).collect();
            let raster = Raster::from_u8(64, 64, 1, ColorSpace::Linear, &bytes).unwrap();
            let images = ImageSet::single(raster);
            distinct(&Blocks::cut(&images, 1, CancelCheck::default()).unwrap())
        };
        assert_eq!(of(|_, _| 7), 1);
        // Columns of blocks by turns, and as many blocks as there are.
        assert_eq!(of(|x, _| (x / 4 % 3) as u8), 3);
        assert_eq!(of(|x, y| (x / 4 + y / 4 * 16) as u8), 256);
    }
}
