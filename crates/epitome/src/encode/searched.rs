//! What was searched: content at all scales, and for every square that may become a leaf the places that look like
//! it.

use texfold_bc::Bc1Blocks;
use texfold_core::image::{ImageSet, Raster};
use texfold_core::{CancelCheck, EncodeError, Goal, ImageSize, Job, ParamError, PlaneFormat, SourceError};

use super::candidate::{Match, Rules};
use super::cell_cache::CellCache;
use super::choose::choose;
use super::formats::{block_of, storages};
use super::lambda_index::lambda;
use super::leaf::Grid;
use super::mask;
use super::plan::Plan;
use super::pyramid::{LEAST_SIDE, SCALES, SCALES_ALONE, ScaleChoice, Space, Storage};
use super::state::{Choice, Costs, Options, Problem};
use crate::format::Palettes;
use crate::{EpitomeParams, EpitomeSource};

/// Bits of an entry as estimated in the rate-distortion cost.
pub(super) const ENTRY_BITS: f32 = 40.0;
/// Side of all leaves where there is no quadtree and none is given.
const FIXED_BLOCK: u32 = 16;

/// What was searched, for encoding with several goals.
#[derive(Debug)]
pub struct EpitomeSearch {
    pub(super) images: ImageSet,
    pub(super) params: EpitomeParams,
    pub(super) space: Space,
    pub(super) grid: Grid,
    /// Cells that content may come from.
    pub(super) allowed: Option<Vec<bool>>,
    pub(super) matches: Vec<Vec<Match>>,
    /// Where content is fitted to its readers. Not within tolerances, which hold for content as it is; nor content
    /// that must come from a part of the images or from their own blocks.
    pub(super) refit: Option<CellCache>,
    /// Bits of a cell and number of cells, by format.
    pub(super) cell_bits: Vec<f32>,
    cells: Vec<u32>,
    /// Where cells differ in bits: those of each, in bits of a cell of its format.
    pub(super) shares: Vec<f32>,
    /// Where cells of content differ in bits: the lambda that it was coded at.
    pub(super) coded_lambda: Option<f32>,
    /// Whether a search ends with an error where hardly any content is shared.
    pub(super) needs_shared: bool,
    /// As [`Shape::bytes`].
    pub(super) bytes: u64,
    /// The same images with other content, of which the goal will choose.
    pub(super) other: Option<Box<EpitomeSearch>>,
}

/// Whether blocks that are to be taken over are those of the images.
fn check_blocks(source: EpitomeSource<'_>) -> Result<(), SourceError> {
    let Some(blocks) = source.blocks else { return Ok(()) };
    let images = source.images.images();
    let needed = |size: ImageSize| PlaneFormat::Bc1.bytes(size.width, size.height) as usize;
    let sum = |sizes: &mut dyn Iterator<Item = ImageSize>| sizes.map(needed).sum::<usize>();
    let needed_of = |(blocks, image): (&Bc1Blocks, &Raster)| {
        blocks.size == image.size() && blocks.blocks.len() == needed(blocks.size)
    };
    if blocks.len() == images.len() && blocks.iter().zip(images).all(needed_of) {
        return Ok(());
    }
    let found = blocks.iter().map(|blocks| blocks.blocks.len()).sum();
    Err(SourceError::Length { found, needed: sum(&mut images.iter().map(Raster::size)) })
}

/// In which formats, blocks and scales images are searched.
pub(super) struct Shape {
    storages: Vec<Storage>,
    grid: Grid,
    scales: ScaleChoice,
    /// Bytes that the images take at all scales, as they are and decoded from each format: most of what an encode
    /// holds.
    pub(super) bytes: u64,
}

impl Shape {
    pub(super) fn of(images: &ImageSet, params: &EpitomeParams) -> Result<Self, ParamError> {
        let storages = storages(images.info(), params)?;
        let sizes: Vec<ImageSize> = images.images().iter().map(|image| image.size()).collect();
        let scales = match params.transforms.scales {
            false => 1,
            true if params.layers > 1 => SCALES.len(),
            true => SCALES_ALONE,
        };
        let (grid, scales) = match params.goal {
            Goal::Tolerance(_) => (Grid::new(&sizes, params.tolerance_block(), false), 1),
            _ if params.transforms.quadtree => (Grid::new(&sizes, block_of(&storages), true), scales),
            _ => (Grid::new(&sizes, params.block.unwrap_or(FIXED_BLOCK), false), scales),
        };
        // Content at a quarter of its size has whole cells too.
        let whole = scales == 1 || grid.block.is_multiple_of(4 * LEAST_SIDE);
        let scales = ScaleChoice { padding: if whole { grid.block } else { 4 * grid.block }, scales };
        let bytes =
            sizes.iter().map(|&size| scales.field_bytes(size)).sum::<u64>() * (1 + storages.len() as u64);
        Ok(Shape { storages, grid, scales, bytes })
    }
}

impl EpitomeSearch {
    /// Content at all scales, without matches.
    pub(super) fn new(
        source: EpitomeSource<'_>,
        params: &EpitomeParams,
        Shape { storages, grid, scales, bytes }: Shape,
        job: &mut Job<'_>,
    ) -> Result<EpitomeSearch, EncodeError> {
        check_blocks(source)?;
        job.stage("storing content", 0.0)?;
        let images = source.images.clone();
        let cancel = job.cancel_check();
        let space =
            job.install(|| Space::new(&images, source.blocks, &storages, scales, params.effort, cancel))?;
        let allowed = source.content_from.map(|mask| mask::allowed_cells(&space, mask)).transpose()?;
        let matches = vec![Vec::new(); grid.nodes()];
        let coded_lambda = storages.iter().find_map(|storage| storage.lambda());
        let cells = space.stored.iter().map(|stored| stored.cells).collect();
        let is_free = source.content_from.is_none() && source.blocks.is_none();
        let refit = (is_free && !matches!(params.goal, Goal::Tolerance(_))).then(CellCache::default);
        Ok(EpitomeSearch {
            images,
            cell_bits: space.cell_bits(),
            shares: space.shares(),
            refit,
            params: params.clone(),
            space,
            grid,
            allowed,
            matches,
            cells,
            bytes,
            coded_lambda,
            needs_shared: false,
            other: None,
        })
    }

    /// What bits cost at a lambda index.
    pub(super) fn costs(&self, entry_bits: f32, lambda_index: u32) -> Costs<'_> {
        Costs {
            lambda: lambda(lambda_index),
            entry_bits,
            cell_bits: &self.cell_bits,
            shares: &self.shares,
            cells: &self.cells,
            others: None,
        }
    }

    /// What is to be chosen at such costs.
    pub(super) fn problem<'a>(
        &'a self,
        options: &'a Options,
        costs: Costs<'a>,
        cancel: CancelCheck<'a>,
    ) -> Problem<'a> {
        Problem { grid: &self.grid, options, costs, cancel }
    }

    pub(super) fn choose(&self, options: &Options, lambda_index: u32, cancel: CancelCheck<'_>) -> Choice {
        choose(self.problem(options, self.costs(ENTRY_BITS, lambda_index), cancel))
    }

    /// Whether every block is to be covered within a tolerance.
    pub(super) fn covers_blocks(&self) -> bool {
        matches!(self.params.goal, Goal::Tolerance(_))
    }

    pub(super) fn rules(&self, tolerance: Option<f32>) -> Rules<'_> {
        Rules {
            cells: self.allowed.as_deref(),
            tolerance,
            kind: self.params.tolerance_kind,
            refits: self.refit.is_some() && self.params.layers <= 1,
            full_size: false,
        }
    }

    pub(super) fn plan<'a>(
        &'a self,
        options: &'a Options,
        palettes: &'a Palettes,
        entry_bits: f32,
        cancel: CancelCheck<'a>,
    ) -> Plan<'a> {
        Plan {
            images: &self.images,
            space: &self.space,
            grid: &self.grid,
            options,
            palettes,
            entry_bits,
            mips: self.params.mips,
            effort: self.params.effort,
            orientations: false,
            refit: self.refit.as_ref(),
            cancel,
        }
    }
}
