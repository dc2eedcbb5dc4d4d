//! Which pieces of images become atoms: those that many blocks would use, one after another, the best first.

use std::collections::HashMap;

use glam::Vec2;
use rayon::prelude::*;
use texfold_core::{CancelCheck, EncodeError};
use texfold_match::{GrayPlane, GsrIndex, GsrInput};

use super::search::{Library, rotation_of};
use super::{LumaResidual, ROTATION_BITS, gain_unit};
use crate::codebook::CELL_SIDE;
use crate::decode::texfold_progressive_rotation;

/// Blocks that pieces are judged by.
const SAMPLE: usize = 1024;
/// Patches that these are compared with, at most.
const PATCHES: usize = 1 << 14;
/// Squared distance of shapes up to which they are compared: beyond it less than a quarter of a block can be explained.
const WITHIN: f32 = 1.0;
/// Values a side of a descriptor's grid.
const GRID: usize = 4;
/// Blur before patches are described, in spacings of the grid.
const BLUR: f32 = 0.25;
/// Factor from 8-bit steps to values of descriptors' planes.
const GRAY_STEPS: f32 = 127.0;
/// Neighbours of each kind of a block.
const NEIGHBOURS: usize = 24;
/// Share of what a patch explains that is left in blocks, with a gain of few bits, and found again.
const SHIPPED: f32 = 0.8;
/// Squared error that a bit is worth, in that of a texel: a bit halves a coefficient's root.
const BIT_WORTH: f32 = 1.386;

/// A piece that is worth its bits.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Choice {
    /// Its content.
    pub(crate) cell: Vec<f32>,
    /// Blocks that would use it, of all.
    pub(crate) reuse: u32,
    /// Bits that it saves, about.
    pub(crate) bits: f32,
}

/// What pieces must do to become content.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Price {
    /// Most pieces.
    pub(crate) most: usize,
    /// Bits that a piece must save.
    pub(crate) cell_bits: f32,
}

/// Pieces of level 0 of the images, each worth its price on top of those before it and of what `library` holds, for blocks
/// of `side` texels.
///
/// # Errors
/// [`EncodeError::Cancelled`] within 0.2 s of the caller's wish.
pub(crate) fn choose(
    residuals: &[Vec<LumaResidual>],
    side: usize,
    library: Option<&Library>,
    price: Price,
    check: CancelCheck<'_>,
) -> Result<Vec<Choice>, EncodeError> {
    let Price { most, cell_bits } = price;
    let tops: Vec<&LumaResidual> = residuals.iter().filter_map(|levels| levels.first()).collect();
    let sample = Sample::new(&tops, side);
    if sample.blocks.is_empty() || most == 0 {
        return Ok(Vec::new());
    }
    let flat: Vec<LumaResidual> = tops.par_iter().map(|residual| residual.flattened()).collect();
    check.checkpoint()?;
    let mut best = match library {
        Some(library) => {
            sample.explained(&tops, library, gain_unit(residuals, side.trailing_zeros()), check)?
        }
        None => vec![0.0; sample.blocks.len()],
    };
    let mut offers = sample.offers(&tops, &flat, side, check)?;
    let bit = (BIT_WORTH * sample.squared_error / sample.stands_for).max(f32::MIN_POSITIVE);
    let mut choices = Vec::new();
    while choices.len() < most {
        check.checkpoint()?;
        let worth = |offers: &Explained| -> f32 {
            offers.iter().map(|&(block, explained)| (explained - best[block as usize]).max(0.0)).sum()
        };
        let worths: Vec<f32> = offers.par_iter().map(|(_, offers)| worth(offers)).collect();
        let first = (0..offers.len()).min_by(|&a, &b| worths[b].total_cmp(&worths[a]).then(a.cmp(&b)));
        let Some(first) = first.filter(|&first| worths[first] > cell_bits * bit) else { break };
        let bits = worths[first] / bit;
        let (piece, users) = offers.swap_remove(first);
        let mut reuse = 0;
        for (block, explained) in users {
            if explained > best[block as usize] {
                best[block as usize] = explained;
                reuse += 1;
            }
        }
        let reuse = (reuse as f32 * sample.stands_for) as u32;
        let cell = flat[piece.image as usize].cell(piece.left as usize, piece.top as usize);
        choices.push(Choice { cell, reuse, bits });
    }
    Ok(choices)
}

/// A square of [`CELL_SIDE`] texels of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
struct Piece {
    image: u32,
    left: u32,
    top: u32,
}

/// Blocks by number, and the squared error that a piece would take away from each.
type Explained = Vec<(u32, f32)>;

/// A block of an image.
#[derive(Debug, Clone, Copy)]
struct Place {
    image: u32,
    column: usize,
    row: usize,
}

/// Blocks spread over all images.
struct Sample {
    blocks: Vec<Place>,
    /// How many blocks each stands for.
    stands_for: f32,
    /// Mean squared error of a texel.
    squared_error: f32,
}

impl Sample {
    fn new(tops: &[&LumaResidual], side: usize) -> Self {
        let mut blocks = Vec::new();
        for (image, residual) in (0..).zip(tops) {
            let (columns, rows) = (residual.width / side, residual.height / side);
            let place = |index: usize| Place { image, column: index % columns, row: index / columns };
            blocks.extend((0..columns * rows).map(place));
        }
        let all = blocks.len();
        // An odd step visits all columns.
        let step = all.div_ceil(SAMPLE).max(1) | 1;
        let blocks: Vec<_> = blocks.into_iter().step_by(step).collect();
        let texels: usize = tops.iter().map(|residual| residual.values.len()).sum();
        let squared: f64 =
            tops.iter().flat_map(|residual| &residual.values).map(|value| f64::from(value * value)).sum();
        Sample {
            stands_for: all as f32 / blocks.len().max(1) as f32,
            squared_error: (squared / texels.max(1) as f64) as f32,
            blocks,
        }
    }

    /// Squared error that the library takes away from each block.
    fn explained(
        &self,
        tops: &[&LumaResidual],
        library: &Library,
        unit: u16,
        check: CancelCheck<'_>,
    ) -> Result<Vec<f32>, EncodeError> {
        let of_block = |block: &Place| {
            if check.is_cancelled() {
                return 0.0;
            }
            library.explained(tops[block.image as usize], (block.column, block.row), unit)
        };
        let explained = self.blocks.par_iter().map(of_block).collect();
        check.checkpoint().map(|()| explained)
    }

    /// For each piece the blocks that it could serve, and the squared error that it would take away.
    fn offers(
        &self,
        tops: &[&LumaResidual],
        flat: &[LumaResidual],
        side: usize,
        check: CancelCheck<'_>,
    ) -> Result<Vec<(Piece, Explained)>, EncodeError> {
        let planes: Vec<GrayPlane> = flat
            .par_iter()
            .map(|residual| {
                let values: Vec<f32> = residual.values.iter().map(|value| value * GRAY_STEPS).collect();
                GrayPlane::new(residual.width, &values, blur_of(side), check)
            })
            .collect();
        let texels: usize = flat.iter().map(|residual| residual.values.len()).sum();
        let stride = ((texels as f32 / PATCHES as f32).sqrt().ceil() as usize).max(2);
        let list: Vec<_> = (0..)
            .zip(flat)
            .flat_map(|(image, residual)| patches(residual.width, residual.height, side, stride, image))
            .collect();
        check.checkpoint()?;
        let views: Vec<&GrayPlane> = planes.iter().collect();
        let index = GsrIndex::grouped(&views, &list, GRID, GsrInput::Shape, 1.0, check);
        let matcher = Matcher { tops, flat, planes: &planes, index: &index, side };
        let of_block =
            |&block: &Place| if check.is_cancelled() { Vec::new() } else { matcher.pieces_for(block) };
        let found: Vec<Vec<(Piece, f32)>> = self.blocks.par_iter().map(of_block).collect();
        check.checkpoint()?;
        let mut pieces: HashMap<Piece, Explained> = HashMap::new();
        for (block, found) in (0..).zip(found) {
            for (piece, explained) in found {
                pieces.entry(piece).or_default().push((block, explained));
            }
        }
        let mut pieces: Vec<_> = pieces.into_iter().collect();
        pieces.sort_by_key(|(piece, _)| *piece);
        Ok(pieces)
    }
}

/// What finds patches like a block.
struct Matcher<'a> {
    /// Residuals of level 0 of each image.
    tops: &'a [&'a LumaResidual],
    /// The same at one contrast.
    flat: &'a [LumaResidual],
    planes: &'a [GrayPlane],
    index: &'a GsrIndex,
    /// Texels a side of a block.
    side: usize,
}

impl Matcher<'_> {
    /// The pieces that hold patches like a block, and what the best patch of each takes away.
    fn pieces_for(&self, block: Place) -> Vec<(Piece, f32)> {
        let (image, side) = (block.image as usize, self.side);
        let mut target = Vec::new();
        self.tops[image].block(side, block.column, block.row, &mut target);
        let centre = Vec2::new(block.column as f32 + 0.5, block.row as f32 + 0.5) * side as f32;
        let mut best: HashMap<Piece, f32> = HashMap::new();
        for found in self.index.nearest(&self.planes[image], (centre, side as f32), WITHIN, NEIGHBOURS) {
            let at = found.patch.centre;
            let own = found.patch.field == block.image && (at - centre).abs().max_element() < side as f32;
            if own {
                continue;
            }
            let rotation = texfold_progressive_rotation(rotation_of(found.matrix), ROTATION_BITS);
            let explained = explain(&target, &self.flat[found.patch.field as usize], at, rotation, side);
            let corner = |at: f32| (at as u32) / CELL_SIDE * CELL_SIDE;
            let piece = Piece { image: found.patch.field, left: corner(at.x), top: corner(at.y) };
            let best = best.entry(piece).or_default();
            *best = best.max(explained);
        }
        let mut list: Vec<_> = best.into_iter().collect();
        list.sort_by_key(|(piece, _)| *piece);
        list
    }
}

/// Squared error that a patch takes away with the best of gains.
fn explain(target: &[f32], residual: &LumaResidual, at: Vec2, rotation: glam::Vec4, side: usize) -> f32 {
    let start = 0.5 - 0.5 * side as f32;
    let (mut both, mut own) = (0.0, 1e-6);
    let last = (residual.width as i32 - 1, residual.height as i32 - 1);
    for (index, &target) in target.iter().enumerate() {
        let (x, y) = (start + (index % side) as f32, start + (index / side) as f32);
        let place = (at.x + rotation.x * x + rotation.y * y, at.y + rotation.z * x + rotation.w * y);
        let (x, y) = ((place.0.floor() as i32).clamp(0, last.0), (place.1.floor() as i32).clamp(0, last.1));
        let value = residual.values[y as usize * residual.width + x as usize];
        both += value * target;
        own += value * value;
    }
    SHIPPED * both * both / own
}

/// Blur in texels of planes whose patches of `side` texels are described.
fn blur_of(side: usize) -> f32 {
    BLUR * side as f32 / GRID as f32
}

/// Patches that lie inside, `stride` texels apart.
fn patches(width: usize, height: usize, side: usize, stride: usize, field: u32) -> Vec<(u32, Vec2, f32)> {
    let half = side / 2;
    let mut list = Vec::new();
    for y in (half..(height + 1).saturating_sub(half)).step_by(stride) {
        for x in (half..(width + 1).saturating_sub(half)).step_by(stride) {
            list.push((field, Vec2::new(x as f32, y as f32), side as f32));
        }
    }
    list
}
