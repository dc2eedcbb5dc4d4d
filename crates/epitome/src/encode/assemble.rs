//! From chosen leaves to the shipped form.

use rayon::prelude::*;
use texfold_bc::{Content, ContentPlanes};
use texfold_core::image::{ImageSet, MipFilter, Raster, mip_chain};
use texfold_core::{CancelCheck, Effort, EncodeError, Notes, SourceError};
use texfold_residual::ResidualContent;

use super::candidate::{Candidate, FRACTION_BITS};
use super::choose::{Choice, Options};
use super::leaf::Grid;
use super::options::Palettes;
use super::pack::{Packing, pack};
use super::pyramid::{Space, Stored};
use super::refit::{self, CellCache, refit};
use crate::encoded::{
    Entry, EpitomeTexture, LEAST_STRIP, Linear, MapFormat, PLANE_MIPS, Parts, coarse_content, coarse_levels,
};
use crate::layers::{LayerMap, Layering};

/// Linear parts that a map can name.
const MOST_LINEARS: usize = 256;

/// What a texture is made of.
#[derive(Clone, Copy)]
pub(crate) struct Plan<'a> {
    pub(crate) images: &'a ImageSet,
    pub(crate) space: &'a Space,
    pub(crate) grid: &'a Grid,
    pub(crate) options: &'a Options,
    pub(crate) palettes: &'a Palettes,
    /// Bits of an entry that the choice reckons with.
    pub(crate) entry_bits: f32,
    pub(crate) mips: bool,
    pub(crate) effort: Effort,
    /// Whether charts of content may be turned to fit, which raw content alone can be.
    pub(crate) turns: bool,
    /// Where content is to be fitted to its readers: what was encoded so before.
    pub(crate) refit: Option<&'a CellCache>,
}

/// The shipped form of choices, one a layer, coarse to fine.
/// Where content has an error map it is coded as finely as bits are worth `lambda`.
pub(crate) fn assemble(
    plan: &Plan<'_>,
    choices: &[Choice],
    lambda: f32,
) -> Result<EpitomeTexture, EncodeError> {
    let step = if plan.mips { 1 << PLANE_MIPS } else { 1 };
    let packing = pack(plan.space, plan.options, choices, (step, plan.turns));
    let too_large = |(side, stored): (&(u32, u32), &Stored)| {
        side.0.max(side.1) * stored.cell > texfold_core::MAX_PLANE_SIDE
    };
    if packing.sizes.iter().zip(&plan.space.stored).any(too_large) {
        return Err(SourceError::Full { what: "an epitome of 8192x8192 texels" }.into());
    }
    let used: Vec<usize> =
        (0..plan.space.stored.len()).filter(|&f| packing.charts.iter().any(|c| c.format == f)).collect();
    let used = if used.is_empty() { vec![0] } else { used };
    let mut palettes = Used::default();
    let mut maps: Vec<LayerMap> = Vec::new();
    for choice in choices {
        let (trees, leaves) = leaves(plan.grid, choice);
        let entry = |&node: &usize| entry(plan, &packing, choice, node, &used, &mut palettes);
        maps.push(LayerMap { trees, entries: leaves.iter().map(entry).collect() });
    }
    if plan.turns && palettes.linears.len() > MOST_LINEARS {
        return assemble(&Plan { turns: false, ..*plan }, choices, lambda);
    }
    let fraction_bits = whole_texels(&mut maps);
    let levels = if plan.mips { plan.images.full_levels() } else { 1 };
    let format = map_format(plan.grid, &maps, &palettes, (fraction_bits, used.len() > 1));
    let full = || EncodeError::Source(SourceError::Full { what: "an epitome" });
    let mut errors = None;
    let is_plain = |format: &&usize| plan.space.stored[**format].form.is_none();
    let plain: Vec<usize> = used.iter().filter(is_plain).copied().collect();
    let made = plain.par_iter().map(|&format| epitome(plan, &packing, choices, (format, levels > 1)));
    let epitomes = made.collect::<Option<Vec<_>>>().ok_or_else(full)?;
    if let Some(&format) = used.iter().find(|format| !is_plain(format)) {
        let coded = with_errors(plan, &packing, choices, (format, levels > 1, lambda));
        errors = Some(Box::new(coded.ok_or_else(full)?));
    }
    let finest = maps.pop().unwrap_or_default();
    let parts = Parts {
        layout: plan.images.layout(levels),
        format,
        trees: finest.trees,
        entries: finest.entries,
        linears: palettes.linears,
        tones: palettes.tones.iter().map(|&number| plan.palettes.tone(number)).collect(),
        epitomes,
        errors,
        coarse: coarse(plan, levels, plan.space.stored[used[0]].content, choices),
        layering: (!maps.is_empty()).then(|| {
            Box::new(Layering {
                total: choices.len() as u32,
                rows: used
                    .iter()
                    .map(|&format| packing.finest_rows[format] * plan.space.stored[format].cell)
                    .collect(),
                coarser: maps,
                cells: used
                    .iter()
                    .map(|&format| cell_layers(plan.space, &packing, format, choices))
                    .collect(),
            })
        }),
    };
    Ok(EpitomeTexture::new(parts, Notes::default()))
}

/// Fields as wide as the entries of all layers need.
fn map_format(
    grid: &Grid,
    maps: &[LayerMap],
    palettes: &Used,
    (fraction_bits, mixed): (u32, bool),
) -> MapFormat {
    let bits = |most: u32| 32 - most.leading_zeros();
    let most = |of: fn(&Entry) -> u32| maps.iter().flat_map(|map| &map.entries).map(of).max().unwrap_or(0);
    MapFormat {
        block: grid.block,
        split: grid.split,
        x_bits: bits(most(|entry| entry.x)),
        y_bits: bits(most(|entry| entry.y)),
        fraction_bits,
        tone_bits: bits(palettes.tones.len().saturating_sub(1) as u32),
        linear_bits: bits(palettes.linears.len().saturating_sub(1) as u32),
        mixed,
        strip: LEAST_STRIP,
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
    linears: Vec<Linear>,
    tones: Vec<u16>,
}

/// The place of `number` in `list`, added at the end where it is new.
fn number_of<T: Copy + PartialEq>(list: &mut Vec<T>, number: T) -> u32 {
    let at = list.iter().position(|&known| known == number).unwrap_or_else(|| {
        list.push(number);
        list.len() - 1
    });
    at as u32
}

fn entry(
    plan: &Plan<'_>,
    packing: &Packing,
    choice: &Choice,
    node: usize,
    used: &[usize],
    palettes: &mut Used,
) -> Entry {
    let candidate: Option<&Candidate> =
        choice.leaves[node].and_then(|leaf| plan.options.candidates[node].get(leaf as usize));
    let moved = candidate.and_then(|candidate| packing.moved(plan.space, plan.options, candidate));
    // Leaves outside of the image show nothing; their entry is never read.
    let (Some(candidate), Some(((x, y), turn))) = (candidate, moved) else {
        return Entry {
            linear: number_of(&mut palettes.linears, plan.palettes.linear(0)),
            tone: number_of(&mut palettes.tones, 0),
            ..Entry::default()
        };
    };
    Entry {
        x,
        y,
        tone: number_of(&mut palettes.tones, candidate.tone),
        linear: number_of(&mut palettes.linears, turn.linear(plan.palettes.linear(candidate.linear))),
        plane: used.iter().position(|&format| format == usize::from(candidate.format)).unwrap_or(0) as u32,
    }
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

/// An epitome and its mip levels.
fn epitome(
    plan: &Plan<'_>,
    packing: &Packing,
    choices: &[Choice],
    (format, mips): (usize, bool),
) -> Option<Vec<ContentPlanes>> {
    let stored = &plan.space.stored[format];
    let (columns, rows) = packing.sizes[format];
    let (width, height) = (columns * stored.cell, rows * stored.cell);
    let formats = stored.content.formats(plan.space.pixel).0;
    let planes: Vec<Vec<u8>> = formats.iter().map(|f| vec![0; f.bytes(width, height) as usize]).collect();
    let mut base = ContentPlanes::from_planes(stored.content, plan.space.pixel, (width, height), planes)?;
    for chart in packing.charts.iter().filter(|chart| chart.format == format) {
        let from = &stored.planes[chart.image][chart.scale];
        if plan.turns {
            base.copy_texels(from, chart.texels(stored.cell));
        } else {
            base.copy_cells(from, chart.cells.iter().map(|&at| (at, chart.place_of(at))));
        }
    }
    if let Some(cache) = plan.refit {
        base = refit(plan, cache, packing, choices, (format, base));
    }
    if !mips {
        return Some(vec![base]);
    }
    let image = Raster::from_texels(width, height, plan.space.pixel, &base.decode()).ok()?;
    let mut levels = vec![base];
    for level in mip_chain(&image, 1 + PLANE_MIPS, MipFilter::Box).iter().skip(1) {
        levels.push(encode_level(plan, stored.content, level));
    }
    Some(levels)
}

/// The epitome with an error map, and its mip levels.
fn with_errors(
    plan: &Plan<'_>,
    packing: &Packing,
    choices: &[Choice],
    (format, mips, lambda): (usize, bool, f32),
) -> Option<ResidualContent> {
    let stored = &plan.space.stored[format];
    let (columns, rows) = packing.sizes[format];
    let (width, height) = (columns * stored.cell, rows * stored.cell);
    let (mut texels, weights) = refit::fitted(plan, packing, choices, (format, width, height));
    texels.iter_mut().for_each(|texel| *texel /= 255.0);
    let image = Raster::from_texels(width, height, plan.space.pixel, &texels).ok()?;
    let levels = if mips { 1 + PLANE_MIPS } else { 1 };
    let chain = if mips { mip_chain(&image, levels, MipFilter::Box) } else { vec![image] };
    stored.form.as_ref()?.encode(&chain, lambda, &weights, plan.effort, CancelCheck::default()).ok()
}

fn encode_level(plan: &Plan<'_>, content: Content, level: &Raster) -> ContentPlanes {
    let texels: Vec<_> = level.texels().collect();
    ContentPlanes::encode(
        content,
        plan.space.pixel,
        (level.size().width, level.size().height),
        &texels,
        plan.effort,
    )
}

/// For each image the levels that are not read from the epitome, finer than it where they would show the images worse
/// than it does.
fn coarse(plan: &Plan<'_>, levels: u32, content: Content, choices: &[Choice]) -> Vec<Vec<ContentPlanes>> {
    let range = coarse_levels(levels);
    if range.is_empty() {
        return Vec::new();
    }
    let below = |image: &Raster| mip_chain(image, levels, MipFilter::Box).split_off(range.start as usize);
    let chains: Vec<Vec<Raster>> = plan.images.images().iter().map(below).collect();
    let encode = |finer: bool| -> Vec<Vec<ContentPlanes>> {
        let content = coarse_content(content, plan.space.pixel, finer);
        let encode = |levels: &Vec<Raster>| levels.iter().map(|l| encode_level(plan, content, l)).collect();
        chains.iter().map(encode).collect()
    };
    let coarse = encode(false);
    let texels: u64 = plan.images.images().iter().map(|image| image.size().texels()).sum();
    let asked = choices.last().map_or(0.0, |choice| choice.psnr(texels as f64));
    let shown = chain_psnr(chains.iter().flatten().zip(coarse.iter().flatten()));
    if content == Content::Bc1 && shown < asked { encode(true) } else { coarse }
}

/// PSNR in dB of red, green and blue of all those levels.
fn chain_psnr<'a>(levels: impl Iterator<Item = (&'a Raster, &'a ContentPlanes)>) -> f64 {
    let (mut error, mut count) = (0.0, 0);
    for (level, coded) in levels {
        for (texel, shown) in level.texels().zip(coded.decode()) {
            error += f64::from((texel - shown).truncate().length_squared());
            count += 3;
        }
    }
    10.0 * (f64::from(count.max(1)) / error.max(1e-9)).log10()
}
