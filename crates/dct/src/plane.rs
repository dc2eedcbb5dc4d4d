//! Superblocks of a plane: their symbols, coefficients and samples.

use crate::context::{
    Around, END_BITS, END_START, ESCAPE, ESCAPE_BITS, FIRST_END, FIRST_LAST, MAGNITUDE_BITS, MAGNITUDE_START,
    Magnitudes, Neighbours, SET_TABLES, SIGNS, State, first_table, held, set_of,
};
use crate::form::{PlaneShape, Steps};
use crate::rans::Rans;
use crate::scan::{COEFFICIENTS, PADDED, SCAN};
use crate::tables::Table;
use crate::transform::inverse;
use crate::vectors::vectorised;

/// Weights of the means around a block in its lowest coefficients, in 1/256: those of JPEG (T.81, K.8) in the transform's scales.
const FIRST_WEIGHT: i32 = 50;
/// Weight of the second differences.
const SECOND_WEIGHT: i32 = 12;
/// Weight of the differences along both sides.
const MIXED_WEIGHT: i32 = 10;
/// Bits of a coefficient's place.
const PLACE_BITS: u32 = COEFFICIENTS.ilog2();
/// Places of the predicted coefficients: the mean first.
pub(super) const PREDICTED: [usize; 6] = [0, 8, 16, 1, 9, 2];

/// Number of [`PREDICTED`] that follow from the means around a block: with an intra mode the mean alone.
#[inline(always)]
pub(super) fn predicted_of(mode: u8) -> usize {
    if mode > 0 { 1 } else { PREDICTED.len() }
}

/// Samples of a part of a plane, all axes, in samples' units with their fractional bits.
#[derive(Debug, Clone)]
pub(super) struct Patch {
    /// Columns and rows of the whole plane.
    pub plane: (usize, usize),
    /// First column and row that it holds.
    pub origin: (usize, usize),
    /// Columns and rows that it holds.
    pub size: (usize, usize),
    /// Samples, axis by axis, row by row.
    pub samples: Vec<i32>,
}

impl Patch {
    /// A patch of zeros.
    pub(super) fn new(
        plane: (usize, usize),
        origin: (usize, usize),
        size: (usize, usize),
        axes: usize,
    ) -> Patch {
        Patch { plane, origin, size, samples: vec![0; size.0 * size.1 * axes] }
    }

    /// The sample nearest to a place, which may lie a sample outside of the plane.
    #[inline(always)]
    fn at(&self, axis: usize, column: usize, row: usize) -> i32 {
        let (column, row) = (column - self.origin.0, row - self.origin.1);
        self.samples[(axis * self.size.1 + row) * self.size.0 + column]
    }

    /// What the means around a block say of its coefficients at [`PREDICTED`].
    #[inline(always)]
    pub(super) fn predict(&self, axis: usize, column: usize, row: usize) -> [i32; 6] {
        let (left, right) = (column.saturating_sub(1), (column + 1).min(self.plane.0 - 1));
        let (above, below) = (row.saturating_sub(1), (row + 1).min(self.plane.1 - 1));
        let at = |column, row| self.at(axis, column, row);
        let (middle, west, east) = (at(column, row), at(left, row), at(right, row));
        let (north, south) = (at(column, above), at(column, below));
        let corners = at(left, above)
            .wrapping_sub(at(right, above))
            .wrapping_sub(at(left, below))
            .wrapping_add(at(right, below));
        let weighted = |weight: i32, value: i32| weight.wrapping_mul(value).wrapping_add(128) >> 8;
        let second = |one: i32, other: i32| one.wrapping_add(other).wrapping_sub(middle.wrapping_mul(2));
        [
            middle,
            weighted(FIRST_WEIGHT, west.wrapping_sub(east)),
            weighted(SECOND_WEIGHT, second(west, east)),
            weighted(FIRST_WEIGHT, north.wrapping_sub(south)),
            weighted(MIXED_WEIGHT, corners),
            weighted(SECOND_WEIGHT, second(north, south)),
        ]
    }

    /// Takes a block's samples, as far as they lie in the patch.
    #[inline(always)]
    pub(super) fn put(&mut self, axis: usize, column: usize, row: usize, block: &[i32; COEFFICIENTS]) {
        let (left, top) = (8 * column - self.origin.0, 8 * row - self.origin.1);
        let (columns, rows) =
            (self.size.0.saturating_sub(left).min(8), self.size.1.saturating_sub(top).min(8));
        for (line, samples) in block.chunks_exact(8).take(rows).enumerate() {
            let start = (axis * self.size.1 + top + line) * self.size.0 + left;
            self.samples[start..start + columns].copy_from_slice(&samples[..columns]);
        }
    }
}

/// What the decoder of a plane needs of the texture.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlaneDecoder<'a> {
    /// Sizes.
    pub shape: PlaneShape,
    /// Whether finer planes build on it.
    pub is_base: bool,
    /// Tables of all sets.
    pub tables: &'a [Table],
    /// Steps of its coefficients.
    pub steps: &'a Steps,
    /// Place of each axis in its group.
    pub ranks: &'a [u8],
    /// Whether its blocks have intra modes.
    pub has_modes: bool,
    /// Means of its blocks; none where it is a single block.
    pub base: Option<&'a Patch>,
}

/// A block that was read: its coefficients and what contexts need of it.
struct Read {
    magnitudes: Magnitudes,
    end_symbol: usize,
}

impl PlaneDecoder<'_> {
    /// Reads a superblock and gives each block's samples, without intra predictions: axis, column and row of the block in the plane,
    /// samples. `around` has their modes afterwards.
    #[inline(never)]
    pub(super) fn superblock(
        &self,
        place: (usize, usize),
        bytes: &[u8],
        around: &mut Around,
        mut put: impl FnMut(usize, (usize, usize), &[i32; COEFFICIENTS]),
    ) {
        vectorised(
            #[inline(always)]
            || self.read_superblock(place, bytes, around, &mut put),
        );
    }

    #[inline(always)]
    fn read_superblock(
        &self,
        (column, row): (usize, usize),
        bytes: &[u8],
        around: &mut Around,
        mut put: impl FnMut(usize, (usize, usize), &[i32; COEFFICIENTS]),
    ) {
        let (columns, rows) = self.shape.blocks_in(column, row);
        around.reset(columns, rows, self.ranks.len());
        let mut stream = Rans::new(bytes);
        for block in 0..columns * rows {
            let place = (column * self.shape.side + block % columns, row * self.shape.side + block / columns);
            let mode = match around.modes.table().filter(|_| self.has_modes) {
                Some(table) => stream.symbol(&self.tables[table]) as u8,
                None => 0,
            };
            around.modes.push(mode);
            for (axis, &rank) in self.ranks.iter().enumerate() {
                let mut coefficients = [0i32; COEFFICIENTS];
                if let Some(base) = self.base {
                    let predicted = base.predict(axis, place.0, place.1);
                    let count = predicted_of(mode);
                    PREDICTED
                        .iter()
                        .zip(predicted)
                        .take(count)
                        .for_each(|(&at, value)| coefficients[at] = value);
                }
                let set = set_of(self.is_base, rank == 0);
                let neighbours = around.of(block, axis, rank > 1);
                let read = self.block(&mut stream, set, &neighbours, &mut coefficients);
                around.keep(block, axis, &read.magnitudes, read.end_symbol);
                put(axis, place, &inverse(coefficients));
            }
        }
    }

    /// Reads a block's axis and adds what it says to `coefficients`.
    #[inline(never)]
    fn block(
        &self,
        shared: &mut Rans<'_>,
        set: usize,
        neighbours: &Neighbours<'_>,
        coefficients: &mut [i32; COEFFICIENTS],
    ) -> Read {
        vectorised(
            #[inline(always)]
            move || self.read_block(shared, set, neighbours, coefficients),
        )
    }

    #[inline(always)]
    fn read_block(
        &self,
        shared: &mut Rans<'_>,
        set: usize,
        neighbours: &Neighbours<'_>,
        coefficients: &mut [i32; COEFFICIENTS],
    ) -> Read {
        // A copy stays in registers.
        let mut stream = *shared;
        let tables = self.tables;
        let mut magnitudes = [0; PADDED];
        let end_symbol = stream.symbol(&tables[set * SET_TABLES + FIRST_END + neighbours.end]);
        let more = stream.bits(u32::from(END_BITS[end_symbol]));
        // Means come from the base, where there is one.
        let first = usize::from(self.base.is_some());
        let count = (usize::from(END_START[end_symbol]) + more as usize).min(COEFFICIENTS - first);
        if count == 0 {
            *shared = stream;
            return Read { magnitudes, end_symbol };
        }
        // Magnitudes that are not zero, in halves of steps, above the 6 bits of their place.
        let mut found = [0u32; COEFFICIENTS];
        let mut nonzero = 0;
        let mut state = State::default();
        for number in (first..first + count).rev() {
            let place = SCAN[number];
            let at = usize::from(place.padded);
            let zone = usize::from(place.zone);
            let last = number == first + count - 1;
            let table = if last {
                set * SET_TABLES + FIRST_LAST + zone
            } else {
                first_table(set, zone, state) + neighbours.level(&magnitudes, at)
            };
            let symbol = stream.symbol(&tables[table]);
            let mut magnitude = symbol as u32;
            if symbol > 7 {
                magnitude = large_magnitude(&mut stream, symbol);
            }
            magnitude += u32::from(last);
            // Without a branch: whether a coefficient is zero cannot be foretold.
            let halves = (2 * magnitude).wrapping_sub(state.odd());
            found[nonzero % COEFFICIENTS] = halves << PLACE_BITS | u32::from(place.raster);
            nonzero += usize::from(magnitude > 0);
            magnitudes[at] = held(magnitude);
            state = self.steps.after(state, magnitude);
        }
        // Signs come after all magnitudes, as the stream's state is what decoding waits for.
        for found in found[..nonzero.min(COEFFICIENTS)].chunks(SIGNS) {
            let signs = stream.bits(found.len() as u32);
            for (number, &packed) in found.iter().enumerate() {
                let raster = packed as usize % COEFFICIENTS;
                let sign = (signs >> number & 1) as i32;
                let value = self.steps.rebuilt(raster, packed >> PLACE_BITS);
                let value = (value ^ sign.wrapping_neg()).wrapping_add(sign);
                coefficients[raster] = coefficients[raster].wrapping_add(value);
            }
        }
        *shared = stream;
        Read { magnitudes, end_symbol }
    }
}

/// A magnitude from 8 on.
#[cold]
fn large_magnitude(stream: &mut Rans<'_>, symbol: usize) -> u32 {
    if symbol < ESCAPE {
        return MAGNITUDE_START[symbol] + stream.bits(u32::from(MAGNITUDE_BITS[symbol]));
    }
    let length = stream.bits(5).min(ESCAPE_BITS);
    let low = stream.bits(length.min(12));
    MAGNITUDE_START[ESCAPE] + (low | stream.bits(length.saturating_sub(12)) << 12)
}
