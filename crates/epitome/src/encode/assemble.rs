//! From chosen leaves to the shipped form.

use rayon::prelude::*;
use texfold_bc::{Content, ContentPlanes};
use texfold_core::image::{MipFilter, Raster, mip_chain_cancellable};
use texfold_core::target::Measured;
use texfold_core::{EncodeError, MAX_PLANE_SIDE, Notes, SourceError, Texel};
use texfold_dct::encode::Estimate;
use texfold_residual::ResidualContent;

use super::candidate::Candidate;
use super::in_blocks::BlockEncoders;
use super::leaf::Grid;
use super::pack::{Packing, Sides, pack};
use super::plan::Plan;
use super::pyramid::{Coder, Space, Stored};
use super::reading::FRACTION_BITS;
use super::refit::{self, refit};
use super::state::Choice;
use crate::EpitomeTexture;
use crate::format::{Entry, LEAST_SEAM_WIDTH, LayerMap, MapFormat, Matrix, Palettes};
use crate::layers::CellLayers;
use crate::layers::Layering;
use crate::map::{CoarserMap, MapPlane};
use crate::parts::{PLANE_MIPS, Parts, coarse_content, coarse_levels};

/// 2x2 matrices that a map can name.
const MOST_LINEARS: usize = 256;

/// The shipped form of choices, one a layer, coarse to fine.
/// Where content has a residual plane, or is in blocks of variable length, it is coded as finely as bits are worth `lambda`.
///
/// # Errors
/// [`SourceError::Full`] where an epitome would be larger than a GPU can sample, [`EncodeError::Cancelled`] where the
/// job was cancelled.
pub(crate) fn assemble(
    plan: &Plan<'_>,
    choices: &[Choice],
    lambda: f32,
) -> Result<EpitomeTexture, EncodeError> {
    draft(plan, choices, lambda)?.texture(lambda)
}

/// A texture whose blocks of variable length, if it has any, are still to be coded.
pub(super) struct Draft<'a> {
    parts: Parts,
    blocks: Option<BlockEncoders<'a>>,
}

impl Draft<'_> {
    /// The texture with blocks as finely coded as bits are worth `lambda`.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`] where the job was cancelled.
    pub(super) fn texture(&self, lambda: f32) -> Result<EpitomeTexture, EncodeError> {
        let blocks = self.blocks.as_ref().map(|blocks| blocks.at(lambda)).transpose()?;
        Ok(EpitomeTexture::new(
            Parts { blocks: blocks.map(Box::new), ..self.parts.clone() },
            Notes::default(),
        ))
    }

    /// Bits and PSNR of that texture, estimated from its blocks; both are off by what is beside them.
    ///
    /// # Errors
    /// As there.
    pub(super) fn estimate(&self, lambda: f32) -> Result<Measured, EncodeError> {
        let Some(blocks) = &self.blocks else { return Ok(Measured::default()) };
        let found = blocks.estimate(lambda)?;
        let beside = 32 * self.parts.map.words().len();
        let texels: u64 = self.parts.layout.images.iter().map(|size| size.texels()).sum();
        Ok(Estimate { bits: found.bits + beside as f64, ..found }.measured(texels))
    }
}

/// All of the shipped form but blocks of variable length.
///
/// # Errors
/// As [`assemble`].
pub(super) fn draft<'a>(plan: &Plan<'a>, choices: &[Choice], lambda: f32) -> Result<Draft<'a>, EncodeError> {
    // What was chosen after the job was cancelled does not cover the images.
    plan.cancel.checkpoint()?;
    let step = if plan.mips { 1 << PLANE_MIPS } else { 1 };
    let packing =
        pack(plan.space, plan.options, choices, Sides { step, orientations: plan.orientations }, plan.cancel);
    plan.cancel.checkpoint()?;
    check_sides(plan, &packing)?;
    let used: Vec<usize> =
        (0..plan.space.stored.len()).filter(|&f| packing.charts.iter().any(|c| c.format == f)).collect();
    let sheets =
        Sheets { plan, packing: &packing, choices, used: if used.is_empty() { vec![0] } else { used } };
    let mut palettes = Used::default();
    let mut maps: Vec<LayerMap> =
        choices.iter().map(|choice| sheets.layer_map(choice, &mut palettes)).collect();
    if plan.orientations && palettes.matrices.len() > MOST_LINEARS {
        return draft(&Plan { orientations: false, ..*plan }, choices, lambda);
    }
    let fraction_bits = whole_texels(&mut maps);
    let levels = if plan.mips { plan.images.full_levels() } else { 1 };
    let format =
        MapFormat { fraction_bits, mixed: sheets.used.len() > 1, ..map_format(plan.grid, &maps, &palettes) };
    let palettes = Palettes {
        matrices: palettes.matrices,
        gain_offsets: palettes.gain_offsets.iter().map(|&number| plan.palettes.gain_offset(number)).collect(),
    };
    let finest = maps.pop().unwrap_or_default();
    let parts = Parts {
        layout: plan.images.layout(levels),
        format,
        map: MapPlane::new(&format, &palettes, &finest),
        palettes,
        epitomes: sheets.epitomes(levels > 1)?,
        errors: sheets.with_errors(levels > 1, lambda)?,
        coarse: sheets.coarse(levels)?,
        blocks: None,
        layering: (!maps.is_empty()).then(|| Box::new(sheets.layering(&format, &maps, &finest))),
    };
    Ok(Draft { parts, blocks: sheets.in_blocks(levels)? })
}

/// Whether all epitomes can be sampled.
fn check_sides(plan: &Plan<'_>, packing: &Packing) -> Result<(), SourceError> {
    let too_large =
        |(side, stored): (&(u32, u32), &Stored)| side.0.max(side.1) * stored.cell > MAX_PLANE_SIDE;
    if packing.sizes.iter().zip(&plan.space.stored).any(too_large) {
        return Err(SourceError::Full { what: "an epitome of 8192x8192 texels" });
    }
    Ok(())
}

/// Epitomes in the making: one for each format that leaves read.
struct Sheets<'a, 'p> {
    plan: &'a Plan<'p>,
    packing: &'a Packing,
    choices: &'a [Choice],
    /// Formats that leaves read, ascending; at least one.
    used: Vec<usize>,
}

/// Fields as wide as the entries of all layers need.
fn map_format(grid: &Grid, maps: &[LayerMap], palettes: &Used) -> MapFormat {
    let bits = |most: u32| 32 - most.leading_zeros();
    let most = |of: fn(&Entry) -> u32| maps.iter().flat_map(|map| &map.entries).map(of).max().unwrap_or(0);
    MapFormat {
        block: grid.block,
        split: grid.split,
        x_bits: bits(most(|entry| entry.x)),
        y_bits: bits(most(|entry| entry.y)),
        fraction_bits: FRACTION_BITS,
        gain_offset_bits: bits(palettes.gain_offsets.len().saturating_sub(1) as u32),
        matrix_bits: bits(palettes.matrices.len().saturating_sub(1) as u32),
        mixed: false,
        seam_width: LEAST_SEAM_WIDTH,
    }
}

/// For each cell of an epitome, row by row, the first layer that reads it; the last one for cells that none reads.
fn cell_layers(space: &Space, packing: &Packing, format: usize, choices: &[Choice]) -> Vec<u8> {
    let (columns, rows) = packing.sizes[format];
    let mut layers = vec![choices.len().saturating_sub(1) as u8; (columns * rows) as usize];
    for chart in packing.charts.iter().filter(|chart| chart.format == format) {
        let cells = space.rows_of(format, chart.image, chart.scale);
        for &(x, y) in &chart.cells {
            let cell = cells.number(x, y) as usize;
            let first = choices.iter().position(|choice| choice.users[cell] > 0);
            let (to_x, to_y) = chart.place_of((x, y));
            if let (Some(layer), Some(first)) = (layers.get_mut((to_y * columns + to_x) as usize), first) {
                *layer = first as u8;
            }
        }
    }
    layers
}

/// Tree bytes of all blocks, and the nodes of all leaves in the order of their entries.
fn leaves(grid: &Grid, choice: &Choice) -> (Vec<u8>, Vec<usize>) {
    let (mut trees, mut leaves) = (Vec::new(), Vec::new());
    for block in 0..grid.blocks() {
        let first = block * grid.per_block();
        if !grid.split {
            leaves.push(first);
            continue;
        }
        if choice.leaves[first].is_some() {
            trees.push(0);
            leaves.push(first);
            continue;
        }
        let mut tree = 1;
        for quarter in 0..4 {
            if choice.leaves[first + 1 + quarter].is_some() {
                leaves.push(first + 1 + quarter);
            } else {
                tree |= 2 << quarter;
                leaves.extend((0..4).map(|part| first + 5 + 4 * quarter + part));
            }
        }
        trees.push(tree);
    }
    (trees, leaves)
}

/// Numbers of the palettes that entries use, in the order of their first use.
#[derive(Default)]
struct Used {
    matrices: Vec<Matrix>,
    gain_offsets: Vec<u16>,
}

/// The place of `number` in `list`, added at the end where it is new.
fn number_of<T: Copy + PartialEq>(list: &mut Vec<T>, number: T) -> u32 {
    let at = list.iter().position(|&known| known == number).unwrap_or_else(|| {
        list.push(number);
        list.len() - 1
    });
    at as u32
}

/// Takes from positions the fraction bits that are 0 in all of them; gives how many are left.
fn whole_texels(maps: &mut [LayerMap]) -> u32 {
    let all = maps.iter().flat_map(|map| &map.entries).fold(0, |all, entry| all | entry.x | entry.y);
    let spare = all.trailing_zeros().min(FRACTION_BITS);
    for entry in maps.iter_mut().flat_map(|map| &mut map.entries) {
        (entry.x, entry.y) = (entry.x >> spare, entry.y >> spare);
    }
    FRACTION_BITS - spare
}

impl<'p> Sheets<'_, 'p> {
    /// Trees and entries of a layer.
    fn layer_map(&self, choice: &Choice, palettes: &mut Used) -> LayerMap {
        let (trees, leaves) = leaves(self.plan.grid, choice);
        let entries = leaves.iter().map(|&node| self.entry(choice, node, palettes)).collect();
        LayerMap { trees, entries }
    }

    fn entry(&self, choice: &Choice, node: usize, palettes: &mut Used) -> Entry {
        let plan = self.plan;
        let candidate: Option<&Candidate> =
            choice.leaves[node].and_then(|leaf| plan.options.candidates[node].get(leaf as usize));
        let moved = candidate.and_then(|candidate| self.packing.moved(plan.space, plan.options, candidate));
        // Leaves outside of the image are not drawn; their entry is never read.
        let (Some(candidate), Some(((x, y), orientation))) = (candidate, moved) else {
            return Entry {
                matrix: number_of(&mut palettes.matrices, plan.palettes.matrix(0)),
                gain_offset: number_of(&mut palettes.gain_offsets, 0),
                ..Entry::default()
            };
        };
        let format = usize::from(candidate.format);
        Entry {
            x,
            y,
            gain_offset: number_of(&mut palettes.gain_offsets, candidate.gain_offset),
            matrix: number_of(
                &mut palettes.matrices,
                orientation.matrix(plan.palettes.matrix(candidate.matrix)),
            ),
            plane: self.used.iter().position(|&used| used == format).unwrap_or(0) as u32,
        }
    }

    /// What layers before the finest bring.
    fn layering(&self, format: &MapFormat, coarser: &[LayerMap], finest: &LayerMap) -> Layering {
        let Sheets { plan, packing, choices, used } = self;
        let rows = |&format: &usize| packing.finest_rows[format] * plan.space.stored[format].cell;
        let total = choices.len() as u32;
        let finer = coarser.iter().skip(1).chain([finest]);
        let layers = |&used: &usize| CellLayers::new(&cell_layers(plan.space, packing, used, choices), total);
        Layering {
            total,
            rows: used.iter().map(rows).collect(),
            coarser: coarser
                .iter()
                .zip(finer)
                .map(|(map, finer)| CoarserMap::new(format, map, finer))
                .collect(),
            cells: used.iter().map(layers).collect(),
        }
    }

    /// Epitomes without a residual plane.
    fn epitomes(&self, mips: bool) -> Result<Vec<Vec<ContentPlanes>>, EncodeError> {
        let is_plain = |format: &&usize| self.plan.space.stored[**format].coder.is_none();
        let plain: Vec<usize> = self.used.iter().filter(is_plain).copied().collect();
        plain.par_iter().map(|&format| self.epitome(format, mips)).collect()
    }

    /// An epitome and its mip levels.
    fn epitome(&self, format: usize, mips: bool) -> Result<Vec<ContentPlanes>, EncodeError> {
        let Sheets { plan, packing, choices, .. } = *self;
        let stored = &plan.space.stored[format];
        let (width, height) = self.size(format);
        let formats = stored.content.formats(plan.space.pixel).0;
        let planes: Vec<Vec<u8>> = formats.iter().map(|f| vec![0; f.bytes(width, height) as usize]).collect();
        let base = ContentPlanes::from_planes(stored.content, plan.space.pixel, (width, height), planes);
        let mut base = base.ok_or_else(full)?;
        for chart in packing.charts.iter().filter(|chart| chart.format == format) {
            let from = &stored.planes[chart.image][chart.scale];
            if plan.orientations {
                base.copy_texels(from, chart.texels(stored.cell));
            } else {
                base.copy_cells(from, chart.cells.iter().map(|&at| (at, chart.place_of(at))));
            }
        }
        if let Some(cache) = plan.refit {
            base = refit(plan, cache, packing, choices, format, base)?;
        }
        if !mips {
            return Ok(vec![base]);
        }
        let image = Raster::from_texels(width, height, plan.space.pixel, &base.decode())?;
        let mut levels = vec![base];
        let chain = mip_chain_cancellable(&image, 1 + PLANE_MIPS, MipFilter::Box, plan.cancel)?;
        for level in chain.iter().skip(1) {
            levels.push(encode_level(plan, stored.content, level)?);
        }
        Ok(levels)
    }

    /// The epitome with a residual plane, if any, and its mip levels.
    fn with_errors(&self, mips: bool, lambda: f32) -> Result<Option<Box<ResidualContent>>, EncodeError> {
        let Sheets { plan, packing, choices, .. } = *self;
        let coded = |format: &usize| match plan.space.stored[*format].coder.as_ref()? {
            Coder::ErrorMap(form) => Some((*format, form)),
            Coder::Blocks(_) => None,
        };
        let Some((format, form)) = self.used.iter().find_map(coded) else { return Ok(None) };
        let (width, height) = self.size(format);
        let drawn = refit::fitted(plan, packing, choices, format, (width, height));
        plan.cancel.checkpoint()?;
        let weights = drawn.block_weights(plan.space.stored[format].cell as usize);
        let texels: Vec<Texel> = drawn.texels.into_iter().map(|texel| texel / 255.0).collect();
        let image = Raster::from_texels(width, height, plan.space.pixel, &texels)?;
        let levels = if mips { 1 + PLANE_MIPS } else { 1 };
        let chain = mip_chain_cancellable(&image, levels, MipFilter::Box, plan.cancel)?;
        let coded = form.encode(&chain, lambda, &weights, plan.effort, plan.cancel)?;
        Ok(Some(Box::new(coded)))
    }

    /// The epitome in blocks of variable length, if any, and the mip levels.
    fn in_blocks(&self, levels: u32) -> Result<Option<BlockEncoders<'p>>, EncodeError> {
        let Sheets { plan, packing, choices, .. } = *self;
        let Some(Coder::Blocks(metric)) = plan.space.stored[0].coder else { return Ok(None) };
        let mut drawn = refit::fitted(plan, packing, choices, 0, self.size(0));
        plan.cancel.checkpoint()?;
        if levels > 1 {
            // Mip levels read what lies beside a leaf, too.
            drawn.count_whole_cells(plan.space.stored[0].cell as usize);
        }
        BlockEncoders::new(plan, metric, &drawn, levels).map(Some)
    }

    /// In planes, for each image the levels that are not read from the epitome.
    fn coarse(&self, levels: u32) -> Result<Vec<Vec<ContentPlanes>>, EncodeError> {
        let stored = &self.plan.space.stored[self.used[0]];
        if matches!(stored.coder, Some(Coder::Blocks(_))) {
            return Ok(Vec::new());
        }
        coarse(self.plan, levels, stored.content, self.choices)
    }

    /// Columns and rows in texels of the epitome of that format.
    fn size(&self, format: usize) -> (u32, u32) {
        let (columns, rows) = self.packing.sizes[format];
        let cell = self.plan.space.stored[format].cell;
        (columns * cell, rows * cell)
    }
}

/// An epitome that its format cannot hold.
fn full() -> EncodeError {
    SourceError::Full { what: "an epitome" }.into()
}

fn encode_level(plan: &Plan<'_>, content: Content, level: &Raster) -> Result<ContentPlanes, EncodeError> {
    let texels: Vec<_> = level.texels().collect();
    let size = (level.size().width, level.size().height);
    ContentPlanes::encode_cancellable(content, plan.space.pixel, size, &texels, plan.effort, plan.cancel)
}

/// For each image the levels that are not read from the epitome, finer than it where they would reconstruct the images worse
/// than it does.
fn coarse(
    plan: &Plan<'_>,
    levels: u32,
    content: Content,
    choices: &[Choice],
) -> Result<Vec<Vec<ContentPlanes>>, EncodeError> {
    let range = coarse_levels(levels);
    if range.is_empty() {
        return Ok(Vec::new());
    }
    let below = |image: &Raster| {
        let mut chain = mip_chain_cancellable(image, levels, MipFilter::Box, plan.cancel)?;
        Ok(chain.split_off(range.start as usize))
    };
    let chains: Vec<Vec<Raster>> =
        plan.images.images().iter().map(below).collect::<Result<_, EncodeError>>()?;
    let encode = |finer: bool| {
        let content = coarse_content(content, plan.space.pixel, finer);
        let encode = |levels: &Vec<Raster>| levels.iter().map(|l| encode_level(plan, content, l)).collect();
        chains.iter().map(encode).collect::<Result<Vec<Vec<ContentPlanes>>, EncodeError>>()
    };
    let coarse = encode(false)?;
    let texels: u64 = plan.images.images().iter().map(|image| image.size().texels()).sum();
    let target = choices.last().map_or(0.0, |choice| choice.psnr(texels as f64));
    let decoded = chain_psnr(chains.iter().flatten().zip(coarse.iter().flatten()));
    if content == Content::Bc1 && decoded < target { encode(true) } else { Ok(coarse) }
}

/// PSNR in dB of red, green and blue of all those levels.
fn chain_psnr<'a>(levels: impl Iterator<Item = (&'a Raster, &'a ContentPlanes)>) -> f64 {
    let (mut error, mut count) = (0.0, 0);
    for (level, coded) in levels {
        for (texel, decoded) in level.texels().zip(coded.decode()) {
            error += f64::from((texel - decoded).truncate().length_squared());
            count += 3;
        }
    }
    10.0 * (f64::from(count.max(1)) / error.max(1e-9)).log10()
}
