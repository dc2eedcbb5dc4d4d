//! A texture at a step: planes from the coarsest on, each against the decoded one above it.

use texfold_core::metric::SquaredError;
use texfold_core::target::Measured;
use texfold_core::{CancelCheck, EncodeError, Metric, SourceError, parallel};

use super::activity::Activity;
use super::cutout;
use super::fit::{Fitted, StopBits, fit};
use super::forward::{Block, Coefficients};
use super::goal::unit_of;
use super::intra::{BlockAxis, Choice, Chooser, fit_modes};
use super::masking::masking;
use super::quantise::{Quantising, Trellis, residuals_of};
use super::symbols::{
    BlockBits, Collector, Counter, Levels, Sink, Superblock, SymbolBits, coded, end_symbol, magnitudes_of,
    states_of,
};
use crate::context::{Around, MODE_TABLES, set_of};
use crate::decode::DctTexture;
use crate::form::{DctForm, PlaneShape, Quantiser, Steps};
use crate::index::Index;
use crate::intra::{References, USUAL_NONE, add, put, tables as intra_tables};
use crate::plane::{PREDICTED, Patch};
use crate::rans_encode::{MAX_STREAM, stream};
use crate::scan::COEFFICIENTS;
use crate::tables::{AllStops, StoredStops, Table};
use crate::transform::inverse;

/// Squared steps that a bit is worth: of 0.05, 0.06, 0.075, 0.1, 0.13 and 0.16, the best for PSNR at 1, 2 and 3.56 bits a texel on eight images.
pub(super) const LAMBDA: f32 = 0.075;
/// Reconstruction offsets before any are measured.
const USUAL_OFFSETS: [u8; OFFSETS] = [2, 1];
/// Of so many superblocks one is quantised where only the symbols' bits are looked for.
const STRIDE: usize = 4;
/// Least superblocks of a plane that every [`STRIDE`]th of stands for.
const LEAST_SUPERBLOCKS: usize = 64;
/// Superblocks that bits and errors are estimated from where there are more than [`STRIDE`] times as many.
const ESTIMATED: usize = 256;
/// Bits of a superblock beside those of its symbols: some 11 of its length in the index, 6.5 of whole words in its stream.
const SUPERBLOCK_BITS: f64 = 17.5;
/// Share of squared errors that deblocking and the clamping of samples leave: 0.2 dB is the median of 11 images at 32 and at 40 dB.
const DEBLOCKED: f64 = 0.955;
/// Most superblocks of an image that is quantised without intra modes, too, as these may take more than they save.
const SMALL: usize = 16;
/// Superblocks that a thread quantises one after the other.
const PART: usize = 16;
/// Magnitudes whose reconstruction is measured: of 1, and of more.
const OFFSETS: usize = 2;

/// How long the encoder looks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Looks {
    /// Times that planes are quantised, each time with the bits of symbols that the time before gave; at first with those of the
    /// preset. All but the last time it is a part of the image's superblocks.
    pub passes: usize,
    /// What errors count.
    pub metric: Metric,
}

/// Quantised planes, and what they say of tables and offsets.
struct Quantised {
    /// Superblocks, plane by plane.
    planes: Vec<Vec<Superblock>>,
    counter: Counter,
    /// Measured, else 0.
    offsets: [u8; OFFSETS],
    /// Sum of squared errors, in squared steps of coefficients that all count alike; 0 where they are not measured.
    squared_error: f64,
}

impl Quantised {
    /// Bits of all symbols and of their tables.
    fn bits(&self) -> f64 {
        let Counter { counts, plain_bits } = &self.counter;
        let bits = StopBits::new();
        let modes = fit_modes(counts, &bits).map_or(0.0, |(_, bits)| bits);
        fit(counts).bits(counts, &bits) + modes + *plain_bits as f64
    }

    /// Bits, and errors in bits at [`LAMBDA`].
    fn cost(&self) -> f64 {
        self.bits() + self.squared_error / f64::from(LAMBDA)
    }
}

/// Bits and errors of textures at a step, estimated.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimate {
    /// Bits of the bytes that are held.
    pub bits: f64,
    /// Error of all samples, in 8-bit units.
    pub squared_error: SquaredError,
}

/// Sum over several textures.
impl std::iter::Sum for Estimate {
    fn sum<I: Iterator<Item = Estimate>>(all: I) -> Estimate {
        all.fold(Estimate::default(), |sum, one| Estimate {
            bits: sum.bits + one.bits,
            squared_error: sum.squared_error + one.squared_error,
        })
    }
}

impl Estimate {
    /// The estimate in the units of goals, for images of so many texels.
    #[must_use]
    pub fn measured(&self, texels: u64) -> Measured {
        Measured { bpp: self.bits / texels as f64, psnr: self.squared_error.psnr(), ..Measured::default() }
    }
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
pub(super) fn counts(planes: &[Coefficients], form: &DctForm, looks: Looks) -> super::symbols::Counts {
    let settled = settled(planes, form, looks, CancelCheck::default()).unwrap();
    let mut counter = Counter::default();
    for (plane, superblocks) in settled.planes.iter().enumerate() {
        superblocks.iter().for_each(|superblock| settled.walk(plane, superblock, &mut counter));
    }
    counter.counts
}

/// The header and the tables that quantising begins with: dependent quantisers and the preset.
fn begun(form: &DctForm) -> (DctForm, Vec<Table>) {
    let mut form = form.clone();
    form.quantiser.is_dependent = true;
    form.quantiser.offsets = USUAL_OFFSETS;
    form.intra = Some(USUAL_NONE);
    let tables = tables_of(&StoredStops::preset().read().unwrap_or_default(), form.intra);
    (form, tables)
}

/// The tables of all symbols.
fn tables_of(stops: &AllStops, intra: Option<[u8; MODE_TABLES]>) -> Vec<Table> {
    let tables = stops.iter().map(|stops| Table::new(&stops.frequencies()));
    tables.chain(intra.into_iter().flat_map(intra_tables)).collect()
}

/// Bits and errors of the texture of that header's step: those of a part of the superblocks, coded with the preset.
pub(super) fn estimate(
    planes: &[Coefficients],
    form: &DctForm,
    metric: Metric,
    check: CancelCheck<'_>,
) -> Result<Estimate, EncodeError> {
    let (form, tables) = begun(form);
    let superblocks = planes.first().map_or(0, |plane| plane.shape.count());
    let stride = (superblocks / ESTIMATED).max(STRIDE);
    let pass = Pass { stride, metric, tried: 0, is_measured: true };
    let quantised = quantise(planes, &form, &SymbolBits::new(&tables), pass, check)?;
    let all: usize = planes.iter().map(|plane| plane.shape.count()).sum();
    let beside = SUPERBLOCK_BITS * all as f64;
    let (unit, count) = (unit_of(form.depth), form.size.texels() * form.channels() as u64);
    let is_cutout = planes.first().is_some_and(|plane| plane.cutout.is_some());
    let scale = if is_cutout { f64::from(1u32 << cutout::SCALE_LOG2) } else { 1.0 };
    let size = form.quantiser.step_size() / scale;
    // Rounding to samples adds a twelfth each.
    let sum = (DEBLOCKED * quantised.squared_error * size * size + count as f64 / 12.0) / (unit * unit);
    Ok(Estimate { bits: quantised.bits() + beside, squared_error: SquaredError { sum, count } })
}

/// Numbers and tables at that header's step.
fn settled(
    planes: &[Coefficients],
    form: &DctForm,
    looks: Looks,
    check: CancelCheck<'_>,
) -> Result<Settled, EncodeError> {
    let (mut form, mut tables) = begun(form);
    let tried = looks.passes - 1;
    for _ in 1..looks.passes {
        let pass = Pass { stride: STRIDE, metric: looks.metric, tried: 0, is_measured: true };
        let quantised = quantise(planes, &form, &SymbolBits::new(&tables), pass, check)?;
        let counts = &quantised.counter.counts;
        form.intra = fit_modes(counts, &StopBits::new()).map(|(none, _)| none).or(form.intra);
        tables = tables_of(&fit(counts).all, form.intra);
        form.quantiser.offsets = quantised.offsets;
    }
    let is_small = planes.first().is_some_and(|plane| plane.shape.count() <= SMALL);
    let pass = Pass { stride: 1, metric: looks.metric, tried, is_measured: is_small };
    let symbol_bits = SymbolBits::new(&tables);
    let mut quantised = quantise(planes, &form, &symbol_bits, pass, check)?;
    if is_small {
        let without = DctForm { intra: None, ..form.clone() };
        let other = quantise(planes, &without, &symbol_bits, pass, check)?;
        if other.cost() < quantised.cost() {
            quantised = other;
        }
    }
    let counts = &quantised.counter.counts;
    form.intra = fit_modes(counts, &StopBits::new()).map(|(none, _)| none);
    let Fitted { all, begin, bytes } = fit(counts);
    let stops = StoredStops { begin, is_dependent: true, bytes };
    if form.intra.is_none() {
        quantised.planes.iter_mut().flatten().for_each(|superblock| superblock.modes = Vec::new());
    }
    let tables = tables_of(&all, form.intra);
    Ok(Settled { form, planes: quantised.planes, stops, tables })
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

/// How planes are quantised.
#[derive(Debug, Clone, Copy)]
struct Pass {
    /// Of a large image's superblocks one in so many is quantised, and counts as all.
    stride: usize,
    /// What errors count.
    metric: Metric,
    /// Intra modes that are quantised for each block beside none.
    tried: usize,
    /// Whether reconstruction offsets and errors are measured.
    is_measured: bool,
}

/// Quantises all planes.
fn quantise(
    planes: &[Coefficients],
    form: &DctForm,
    symbol_bits: &SymbolBits,
    Pass { stride, metric, tried, is_measured }: Pass,
    check: CancelCheck<'_>,
) -> Result<Quantised, EncodeError> {
    let ranks = form.ranks();
    let mut base: Option<Patch> = None;
    let mut sums = [Moment::default(); OFFSETS];
    let mut counter = Counter::default();
    let mut squared_error = 0.0;
    let mut all = Vec::new();
    for (plane, coefficients) in planes.iter().enumerate().rev() {
        let steps = Steps::new(&form.quantiser, plane, form.fraction());
        let alike = Steps::new(&Quantiser::of_step(form.quantiser.step), plane, form.fraction());
        let is_masked = plane == 0 && metric == Metric::Perceptual;
        let is_large = plane == 0 && coefficients.shape.count() >= LEAST_SUPERBLOCKS;
        let stride = if is_large { stride } else { 1 };
        let quantiser = PlaneQuantiser {
            form,
            plane,
            coefficients,
            masking: is_masked.then(|| masking(&coefficients.energies, steps.size(0))),
            weights: std::array::from_fn(|at| (steps.size(at) / alike.size(at)).powi(2)),
            steps,
            ranks: &ranks,
            base: base.as_ref(),
            symbol_bits,
            chooser: form.intra.filter(|_| plane == 0 && base.is_some()).map(|_| Chooser::new(tried)),
            is_measured,
        };
        let mut superblocks = Vec::new();
        let mut own = Counter::default();
        let (of_bits, of_errors) = if stride > 1 { quantiser.factors(stride) } else { (1.0, 1.0) };
        for part in quantiser.parts(stride, check)? {
            own.add(&part.counter, 1.0);
            sums.iter_mut().zip(part.moments).for_each(|(sum, moment)| sum.add(moment));
            squared_error += part.squared_error * of_errors;
            superblocks.extend(part.superblocks);
        }
        counter.add(&own, of_bits);
        base = (plane > 0).then(|| quantiser.decoded(&superblocks));
        all.push(superblocks);
    }
    all.reverse();
    Ok(Quantised { planes: all, counter, offsets: sums.map(Moment::offset), squared_error })
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

/// Quantised superblocks that follow each other, their symbols, and the moments of their magnitudes.
#[derive(Debug, Default)]
struct Part {
    superblocks: Vec<Superblock>,
    counter: Counter,
    moments: [Moment; OFFSETS],
    squared_error: f64,
}

/// What quantises a plane.
struct PlaneQuantiser<'a> {
    form: &'a DctForm,
    plane: usize,
    coefficients: &'a Coefficients,
    /// For each block, how much more squared error a bit is worth; alike where there are none.
    masking: Option<Vec<f32>>,
    steps: Steps,
    /// Squared steps that all count alike in a squared step of each coefficient.
    weights: [f32; COEFFICIENTS],
    ranks: &'a [u8],
    base: Option<&'a Patch>,
    symbol_bits: &'a SymbolBits,
    /// Choice among intra modes, where blocks may have such.
    chooser: Option<Chooser>,
    is_measured: bool,
}

impl PlaneQuantiser<'_> {
    /// First coefficient that is coded.
    fn first(&self) -> usize {
        usize::from(self.base.is_some())
    }

    fn shape(&self) -> PlaneShape {
        self.coefficients.shape
    }

    /// Every `stride`th superblock.
    fn parts(&self, stride: usize, check: CancelCheck<'_>) -> Result<Vec<Part>, EncodeError> {
        let count = self.shape().count().div_ceil(stride);
        let parts = parallel::map(count.div_ceil(PART), |part| {
            let numbers = part * PART..((part + 1) * PART).min(count);
            let mut part = Part::default();
            for number in numbers {
                if check.is_cancelled() {
                    return None;
                }
                self.superblock(self.place(number, stride), &mut part);
            }
            Some(part)
        });
        parts.into_iter().collect::<Option<Vec<Part>>>().ok_or(EncodeError::Cancelled)
    }

    /// Factors of bits and errors of every `stride`th superblock, for estimates of those of all.
    fn factors(&self, stride: usize) -> (f64, f64) {
        let shape = self.shape();
        let all = parallel::map(shape.blocks.1, |row| self.activity((0..shape.blocks.0).map(|at| (at, row))));
        let count = shape.count().div_ceil(stride);
        let part = parallel::map(count, |number| self.activity(places(shape, self.place(number, stride))));
        part.into_iter().sum::<Activity>().factors(&all.into_iter().sum(), stride as f64)
    }

    fn activity(&self, places: impl Iterator<Item = (usize, usize)>) -> Activity {
        let inverse = |axis| {
            let scale =
                if self.coefficients.cutout == Some(axis) { cutout::scale_of(self.form) } else { 1.0 };
            std::array::from_fn(|at| if at < self.first() { 0.0 } else { scale / self.steps.size(at) })
        };
        let inverses: Vec<[f32; COEFFICIENTS]> = (0..self.ranks.len()).map(inverse).collect();
        let mut activity = Activity::default();
        for (column, row) in places {
            let first = (row * self.shape().blocks.0 + column) * inverses.len();
            for (axis, inverse) in inverses.iter().enumerate() {
                activity.add(&self.coefficients.blocks[first + axis], inverse, self.weights_of(axis));
            }
        }
        activity
    }

    /// Weight of a squared step of each coefficient of an axis.
    fn weights_of(&self, axis: usize) -> &[f32; COEFFICIENTS] {
        // The errors of a cut-out are clamped away, mostly.
        if self.coefficients.cutout == Some(axis) { &[0.0; COEFFICIENTS] } else { &self.weights }
    }

    /// Column and row of the superblock that stands for the `stride` of that number: one of them by chance, so that no pattern of
    /// the image has more of them than it should.
    fn place(&self, number: usize, stride: usize) -> (usize, usize) {
        let shape = self.shape();
        let chance = (number as u32).wrapping_mul(0x9e37_79b1) >> 8;
        let number = (number * stride + chance as usize % stride).min(shape.count() - 1);
        (number % shape.superblocks.0, number / shape.superblocks.0)
    }

    /// Quantises a superblock.
    fn superblock(&self, place: (usize, usize), part: &mut Part) {
        let shape = self.shape();
        let blocks = shape.blocks_in(place.0, place.1);
        let mut superblock = Superblock::new(blocks);
        let samples = if self.chooser.is_some() { COEFFICIENTS * shape.side * shape.side } else { 0 };
        let mut held = Held {
            around: Around::default(),
            samples: vec![0; samples * self.ranks.len()],
            trellis: Trellis::default(),
        };
        held.around.reset(blocks.0, blocks.1, self.ranks.len());
        for (block, place) in places(shape, place).enumerate() {
            let at = At { block, inside: (block % blocks.0, block / blocks.0), place, columns: blocks.0 };
            let choice = self.choice(at, &mut held);
            for axis in 0..self.ranks.len() {
                let levels = self.axis(at, axis, &choice, &mut held, part);
                let end = end_symbol(coded(&levels, self.first()));
                held.around.keep(block, axis, &magnitudes_of(&levels), end);
                superblock.push(&levels);
            }
            if self.chooser.is_some() {
                held.around.modes.push(choice.mode);
                superblock.modes.push(choice.mode);
            }
        }
        superblock.shrink();
        superblock.walk(self.plane > 0, self.first(), self.ranks, &mut part.counter);
        part.superblocks.push(superblock);
    }

    /// A block's axis.
    fn block_axis<'b>(&'b self, at: At, axis: usize, around: &'b Around, samples: &[i32]) -> BlockAxis<'b> {
        let At { block, inside, place: (column, row), columns } = at;
        let shape = self.shape();
        let number = row * shape.blocks.0 + column;
        let rank = self.ranks[axis];
        let masking = self.masking.as_ref().map_or(1.0, |masking| masking[number]);
        let quantising = Quantising {
            steps: &self.steps,
            offsets: self.form.quantiser.offsets.map(|offset| f32::from(offset) / 32.0),
            first: self.first(),
            lambda: LAMBDA * masking,
            symbol_bits: self.symbol_bits,
            set: set_of(self.plane > 0, rank == 0),
        };
        let mut coefficients = self.coefficients.blocks[number * self.ranks.len() + axis];
        if self.coefficients.cutout == Some(axis) {
            coefficients = coefficients.map(|value| value * cutout::scale_of(self.form));
        }
        let side = 8 * shape.side;
        BlockAxis {
            quantising,
            coefficients,
            predicted: self.base.map(|base| base.predict(axis, column, row)),
            neighbours: around.of(block, axis, rank > 1),
            references: self
                .chooser
                .as_ref()
                .and_then(|_| References::new(&samples[axis * side * side..], side, columns, inside)),
        }
    }

    /// The mode of a block.
    fn choice(&self, at: At, Held { around, samples, trellis }: &mut Held) -> Choice {
        let (Some(chooser), Some(table)) = (&self.chooser, around.modes.table()) else {
            return Choice::default();
        };
        let firsts = (0..self.ranks.len()).filter(|&axis| self.ranks[axis] == 0);
        let axes: Vec<BlockAxis<'_>> =
            firsts.map(|axis| self.block_axis(at, axis, around, samples)).collect();
        chooser.choose(&axes, table, trellis)
    }

    /// Quantises a block's axis.
    fn axis(
        &self,
        at: At,
        axis: usize,
        choice: &Choice,
        Held { around, samples, trellis }: &mut Held,
        part: &mut Part,
    ) -> Levels {
        let own = self.block_axis(at, axis, around, samples);
        let prediction = own.prediction(choice.mode);
        let (coefficients, predicted) = match &self.chooser {
            Some(chooser) => chooser.against(&own, prediction.as_ref()),
            None => (own.coefficients, own.predicted),
        };
        let group = self.ranks[..axis].iter().filter(|&&rank| rank == 0).count();
        let known = choice.levels.get(group).filter(|_| self.ranks[axis] == 0);
        let levels = match known {
            Some(levels) => *levels,
            None => own.quantising.block(&coefficients, predicted, &own.neighbours, trellis),
        };
        if self.is_measured {
            own.quantising.measure(&coefficients, predicted, &levels, self.weights_of(axis), part);
        }
        if self.chooser.is_some() {
            let side = 8 * self.shape().side;
            let samples = &mut samples[axis * side * side..][..side * side];
            put(samples, side, at.inside, &self.rebuilt(&levels, predicted));
            prediction.iter().for_each(|prediction| add(samples, side, at.inside, prediction));
        }
        levels
    }

    /// The samples of a block's axis as the decoder sees them, without an intra prediction.
    fn rebuilt(&self, levels: &Levels, predicted: Option<[i32; 6]>) -> [i32; COEFFICIENTS] {
        let mut coefficients = [0; COEFFICIENTS];
        PREDICTED
            .iter()
            .zip(predicted.into_iter().flatten())
            .for_each(|(&at, value)| coefficients[at] = value);
        let states = states_of(levels);
        for (at, &level) in levels.iter().enumerate().filter(|(_, level)| **level != 0) {
            let value = self.steps.rebuilt(at, 2 * level.unsigned_abs() - states[at].odd());
            let signed = if level < 0 { value.wrapping_neg() } else { value };
            coefficients[at] = coefficients[at].wrapping_add(signed);
        }
        inverse(coefficients)
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
                    let predicted = self.base.map(|base| base.predict(axis, column, row));
                    patch.put(axis, column, row, &self.rebuilt(&levels, predicted));
                }
            }
        }
        patch
    }
}

impl Quantising<'_> {
    /// Adds how far a block's values lie below their magnitudes, and its squared error.
    fn measure(
        &self,
        block: &Block,
        predicted: Option<[i32; 6]>,
        levels: &Levels,
        weights: &[f32; COEFFICIENTS],
        part: &mut Part,
    ) {
        let moments = &mut part.moments;
        let error = self.squared_error(&residuals_of(block, predicted), levels, weights, |beyond, below| {
            moments[beyond].sum += (1024.0 * below.clamp(-8.0, 8.0)).round() as i64;
            moments[beyond].count += 1;
        });
        part.squared_error += f64::from(error);
    }

    /// Squared error of a block's residuals in squared steps. `each` takes how far a value lies below its magnitude, which is more than 1 where
    /// the number is 1.
    pub(super) fn squared_error(
        &self,
        residuals: &Block,
        levels: &Levels,
        weights: &[f32; COEFFICIENTS],
        mut each: impl FnMut(usize, f32),
    ) -> f32 {
        let states = states_of(levels);
        let mut squared_error = 0.0;
        for at in (0..COEFFICIENTS).filter(|&at| at > 0 || self.first == 0) {
            let value = residuals[at].abs() / self.steps.size(at);
            let magnitude = levels[at].unsigned_abs();
            let mut below = -value;
            if magnitude > 0 {
                let beyond = usize::from(magnitude > 1);
                below += magnitude as f32 - 0.5 * states[at].odd() as f32;
                each(beyond, below);
                below -= self.offsets[beyond];
            }
            squared_error += weights[at] * below * below;
        }
        squared_error
    }
}

/// A superblock as far as it is quantised.
struct Held {
    around: Around,
    /// Samples of each axis as the decoder sees them, where blocks may have modes.
    samples: Vec<i32>,
    trellis: Trellis,
}

/// A block in its superblock.
#[derive(Debug, Clone, Copy)]
struct At {
    /// Number in the superblock.
    block: usize,
    /// Column and row in the superblock.
    inside: (usize, usize),
    /// Column and row in the plane.
    place: (usize, usize),
    /// Columns of blocks of the superblock.
    columns: usize,
}
