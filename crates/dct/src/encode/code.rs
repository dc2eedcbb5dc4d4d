//! A texture at a step: planes from the coarsest on, each against the decoded one above it.

use texfold_core::{CancelCheck, EncodeError, Metric, SourceError, parallel};

use super::fit::{Fitted, fit};
use super::forward::Coefficients;
use super::masking::masking;
use super::quantise::{Quantising, residuals_of};
use super::symbols::{
    BlockBits, Collector, Counter, Counts, Sink, Superblock, SymbolBits, coded, end_symbol, magnitudes_of,
};
use crate::context::{Around, set_of};
use crate::decode::DctTexture;
use crate::form::{DctForm, PlaneShape, Steps};
use crate::index::Index;
use crate::plane::{PREDICTED, Patch};
use crate::rans_encode::{MAX_STREAM, stream};
use crate::scan::COEFFICIENTS;
use crate::tables::{StoredStops, Table};
use crate::transform::inverse;

/// Squared steps that a bit is worth. At high rates an optimal quantiser has 0.1155 (6.02 dB a bit); of 0.08 to 0.2, this
/// is the best at 0.9 to 2 bits a texel on seven photographs.
pub(super) const LAMBDA: f32 = 0.12;
/// Magnitudes whose reconstruction is measured: of 1, and of more.
const OFFSETS: usize = 2;

/// How long the encoder looks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Looks {
    /// Times that all planes are quantised, each time with the bits of symbols that the time before gave.
    pub passes: usize,
    /// Times that a block's coefficients are lowered.
    pub rounds: usize,
    /// What errors count.
    pub metric: Metric,
}

/// Quantised planes, and what they say of tables and offsets.
struct Quantised {
    /// Superblocks, plane by plane.
    planes: Vec<Vec<Superblock>>,
    counts: Counts,
    offsets: [u8; OFFSETS],
}

/// The texture of that header's step; its reconstruction offsets are chosen here.
pub(super) fn code(
    planes: &[Coefficients],
    form: &DctForm,
    looks: Looks,
    check: CancelCheck<'_>,
) -> Result<DctTexture, EncodeError> {
    settled(planes, form, looks, check)?.written()
}

/// As [`code`], with the bits of each 8x8 block, row by row: those of its own symbols, and an equal share of the bits of all means.
pub(super) fn code_with_bits(
    planes: &[Coefficients],
    form: &DctForm,
    looks: Looks,
    check: CancelCheck<'_>,
) -> Result<(DctTexture, Vec<f32>), EncodeError> {
    let settled = settled(planes, form, looks, check)?;
    let finest = planes.first().map(|plane| plane.shape);
    let bits = finest.map(|shape| settled.block_bits(shape)).unwrap_or_default();
    Ok((settled.written()?, bits))
}

/// All that a texture is written of.
struct Settled {
    form: DctForm,
    /// Superblocks, plane by plane.
    planes: Vec<Vec<Superblock>>,
    /// Bytes of the tables, and the tables.
    stops: StoredStops,
    tables: Vec<Table>,
}

/// Occurrences of symbols at that header's step.
#[cfg(test)]
pub(super) fn counts(planes: &[Coefficients], form: &DctForm, looks: Looks) -> Counts {
    let settled = settled(planes, form, looks, CancelCheck::default()).unwrap();
    let mut counter = Counter::default();
    for (plane, superblocks) in settled.planes.iter().enumerate() {
        superblocks.iter().for_each(|superblock| settled.walk(plane, superblock, &mut counter));
    }
    counter.0
}

/// Numbers and tables at that header's step.
fn settled(
    planes: &[Coefficients],
    form: &DctForm,
    looks: Looks,
    check: CancelCheck<'_>,
) -> Result<Settled, EncodeError> {
    let mut form = form.clone();
    let mut symbol_bits = None;
    for _ in 1..looks.passes {
        let quantised = quantise(planes, &form, symbol_bits.as_ref(), looks, check)?;
        let stops = fit(&quantised.counts).all;
        let tables: Vec<Table> = stops.iter().map(|stops| Table::new(&stops.frequencies())).collect();
        symbol_bits = Some(SymbolBits::new(&tables));
        form.quantiser.offsets = quantised.offsets;
    }
    let quantised = quantise(planes, &form, symbol_bits.as_ref(), looks, check)?;
    let Fitted { all, begin, bytes } = fit(&quantised.counts);
    let tables = all.iter().map(|stops| Table::new(&stops.frequencies())).collect();
    Ok(Settled { form, planes: quantised.planes, stops: StoredStops { begin, bytes }, tables })
}

impl Settled {
    /// Gives the symbols of a plane's superblock to `sink`.
    fn walk(&self, plane: usize, superblock: &Superblock, sink: &mut impl Sink) {
        let first = usize::from(plane + 1 < self.planes.len());
        superblock.walk(plane > 0, first, &self.form.ranks(), sink);
    }

    /// Bits of each block of the image, row by row, with their share of those of all means.
    fn block_bits(&self, shape: PlaneShape) -> Vec<f32> {
        let of = |plane: usize, superblock: &Superblock| {
            let mut sink = BlockBits { tables: &self.tables, blocks: Vec::new() };
            self.walk(plane, superblock, &mut sink);
            sink.blocks
        };
        let means: f32 = (1..self.planes.len())
            .flat_map(|plane| self.planes[plane].iter().flat_map(move |s| of(plane, s)))
            .sum();
        let mut bits =
            vec![means / (shape.blocks.0 * shape.blocks.1) as f32; shape.blocks.0 * shape.blocks.1];
        for (number, superblock) in self.planes.first().into_iter().flatten().enumerate() {
            let place = (number % shape.superblocks.0, number / shape.superblocks.0);
            for ((column, row), own) in places(shape, place).zip(of(0, superblock)) {
                bits[row * shape.blocks.0 + column] += own;
            }
        }
        bits
    }

    /// Streams and index.
    fn written(self) -> Result<DctTexture, EncodeError> {
        let streams = self.planes.iter().enumerate().rev().flat_map(|(plane, superblocks)| {
            parallel::map(superblocks.len(), |number| {
                let mut collector = Collector { tables: &self.tables, ops: Vec::new() };
                self.walk(plane, &superblocks[number], &mut collector);
                stream(&collector.ops)
            })
        });
        let streams: Vec<Vec<u8>> = streams.collect();
        let lengths: Vec<usize> = streams.iter().map(Vec::len).collect();
        let index =
            Index::of_lengths(&lengths).filter(|_| lengths.iter().all(|&length| length <= MAX_STREAM));
        let index =
            index.ok_or(SourceError::Full { what: "the index of superblocks is full; split the images" })?;
        let bytes = streams.concat();
        let length = bytes.len() as u32;
        Ok(DctTexture::new(self.form, self.stops, index, bytes, length))
    }
}

/// Columns and rows of a superblock's blocks in a plane, in the order of coding.
fn places(shape: PlaneShape, (column, row): (usize, usize)) -> impl Iterator<Item = (usize, usize)> {
    let (columns, rows) = shape.blocks_in(column, row);
    (0..columns * rows)
        .map(move |block| (column * shape.side + block % columns, row * shape.side + block / columns))
}

/// Quantises all planes.
fn quantise(
    planes: &[Coefficients],
    form: &DctForm,
    symbol_bits: Option<&SymbolBits>,
    looks: Looks,
    check: CancelCheck<'_>,
) -> Result<Quantised, EncodeError> {
    let ranks = form.ranks();
    let mut base: Option<Patch> = None;
    let mut sums = [Moment::default(); OFFSETS];
    let mut counts = Counter::default();
    let mut all = Vec::new();
    for (plane, coefficients) in planes.iter().enumerate().rev() {
        let steps = Steps::new(&form.quantiser, plane, form.fraction());
        let is_masked = plane == 0 && looks.metric == Metric::Perceptual;
        let quantiser = PlaneQuantiser {
            form,
            plane,
            coefficients,
            masking: is_masked.then(|| masking(coefficients, ranks.len(), steps.size(0))),
            steps,
            ranks: &ranks,
            base: base.as_ref(),
            symbol_bits,
            rounds: looks.rounds,
        };
        let coded = quantiser.superblocks(check)?;
        for superblock in &coded {
            superblock.superblock.walk(plane > 0, quantiser.first(), &ranks, &mut counts);
            sums.iter_mut().zip(superblock.moments).for_each(|(sum, moment)| sum.add(moment));
        }
        let superblocks: Vec<Superblock> = coded.into_iter().map(|coded| coded.superblock).collect();
        base = (plane > 0).then(|| quantiser.decoded(&superblocks));
        all.push(superblocks);
    }
    all.reverse();
    Ok(Quantised { planes: all, counts: counts.0, offsets: sums.map(Moment::offset) })
}

/// How far values lie below the magnitudes that stand for them.
#[derive(Debug, Clone, Copy, Default)]
struct Moment {
    /// Sum in 1/1024 of a step: whole, so that the order of additions does not matter.
    sum: i64,
    count: i64,
}

impl Moment {
    fn add(&mut self, other: Moment) {
        self.sum += other.sum;
        self.count += other.count;
    }

    /// The mean as a reconstruction offset.
    fn offset(self) -> u8 {
        let mean = self.sum as f64 / self.count.max(1) as f64 / 1024.0;
        (32.0 * mean).round().clamp(0.0, f64::from(crate::form::MAX_OFFSET)) as u8
    }
}

/// A superblock and the moments of its magnitudes.
struct Coded {
    superblock: Superblock,
    moments: [Moment; OFFSETS],
}

/// What quantises a plane.
struct PlaneQuantiser<'a> {
    form: &'a DctForm,
    plane: usize,
    coefficients: &'a Coefficients,
    /// For each block, how much more squared error a bit is worth; alike where there are none.
    masking: Option<Vec<f32>>,
    steps: Steps,
    ranks: &'a [u8],
    base: Option<&'a Patch>,
    symbol_bits: Option<&'a SymbolBits>,
    rounds: usize,
}

impl PlaneQuantiser<'_> {
    /// First coefficient that is coded.
    fn first(&self) -> usize {
        usize::from(self.base.is_some())
    }

    fn shape(&self) -> PlaneShape {
        self.coefficients.shape
    }

    fn superblocks(&self, check: CancelCheck<'_>) -> Result<Vec<Coded>, EncodeError> {
        let shape = self.shape();
        let coded = parallel::map(shape.count(), |number| {
            let place = (number % shape.superblocks.0, number / shape.superblocks.0);
            (!check.is_cancelled()).then(|| self.superblock(place))
        });
        coded.into_iter().collect::<Option<Vec<Coded>>>().ok_or(EncodeError::Cancelled)
    }

    fn superblock(&self, place: (usize, usize)) -> Coded {
        let shape = self.shape();
        let blocks = shape.blocks_in(place.0, place.1);
        let mut around = Around::default();
        around.reset(blocks.0, blocks.1, self.ranks.len());
        let mut moments = [Moment::default(); OFFSETS];
        let mut superblock = Superblock::new(blocks);
        for (block, (column, row)) in places(shape, place).enumerate() {
            let at = row * shape.blocks.0 + column;
            let masking = self.masking.as_ref().map_or(1.0, |masking| masking[at]);
            for (axis, &rank) in self.ranks.iter().enumerate() {
                let set = set_of(self.plane > 0, rank == 0);
                let quantising = Quantising {
                    steps: &self.steps,
                    offsets: self.form.quantiser.offsets.map(|offset| f32::from(offset) / 32.0),
                    first: self.first(),
                    lambda: LAMBDA * masking,
                    rounds: self.rounds,
                    symbol_bits: self.symbol_bits.map(|symbol_bits| symbol_bits.of_set(set)),
                };
                let coefficients = &self.coefficients.blocks[at * self.ranks.len() + axis];
                let predicted = self.base.map(|base| base.predict(axis, column, row));
                let neighbours = around.of(block, axis, rank > 1);
                let levels = quantising.block(coefficients, predicted, &neighbours);
                quantising.measure(coefficients, predicted, &levels, &mut moments);
                let end = end_symbol(coded(&levels, self.first()));
                around.keep(block, axis, &magnitudes_of(&levels), end);
                superblock.push(&levels);
            }
        }
        superblock.shrink();
        Coded { superblock, moments }
    }

    /// The plane as the decoder sees it.
    fn decoded(&self, superblocks: &[Superblock]) -> Patch {
        let shape = self.shape();
        let size = (shape.size.width as usize, shape.size.height as usize);
        let mut patch = Patch::new(size, (0, 0), size, self.ranks.len());
        for (number, superblock) in superblocks.iter().enumerate() {
            let place = (number % shape.superblocks.0, number / shape.superblocks.0);
            let mut levels = superblock.levels();
            for (column, row) in places(shape, place) {
                for (axis, levels) in levels.by_ref().take(self.ranks.len()).enumerate() {
                    let mut coefficients = [0; COEFFICIENTS];
                    if let Some(base) = self.base {
                        let predicted = base.predict(axis, column, row);
                        PREDICTED.iter().zip(predicted).for_each(|(&at, value)| coefficients[at] = value);
                    }
                    for (at, &level) in levels.iter().enumerate().filter(|(_, level)| **level != 0) {
                        let value = self.steps.rebuilt(at, level.unsigned_abs());
                        let signed = if level < 0 { value.wrapping_neg() } else { value };
                        coefficients[at] = coefficients[at].wrapping_add(signed);
                    }
                    patch.put(axis, column, row, &inverse(coefficients));
                }
            }
        }
        patch
    }
}

impl Quantising<'_> {
    /// Adds how far a block's values lie below their magnitudes.
    fn measure(
        &self,
        block: &super::forward::Block,
        predicted: Option<[i32; 6]>,
        levels: &[i32; COEFFICIENTS],
        moments: &mut [Moment; OFFSETS],
    ) {
        let residuals = residuals_of(block, predicted);
        for (at, &level) in levels.iter().enumerate().filter(|(_, level)| **level != 0) {
            let below = level.unsigned_abs() as f32 - residuals[at].abs() / self.steps.size(at);
            let moment = &mut moments[usize::from(level.unsigned_abs() > 1)];
            moment.sum += (1024.0 * below.clamp(-8.0, 8.0)).round() as i64;
            moment.count += 1;
        }
    }
}
