//! The symbols of quantised blocks: one walk for counting, for bits and for the stream.

use crate::context::{
    Around, END_BITS, END_START, ESCAPE, FIRST_END, FIRST_LAST, FIRST_MODE, FIRST_ODD, LEVELS,
    MAGNITUDE_BITS, MAGNITUDE_START, MODE_TABLES, Magnitudes, Neighbours, SET_TABLES, SIGNS, State,
    first_table, held, set_of,
};
use crate::rans_encode::Op;
use crate::scan::{COEFFICIENTS, PADDED, SCAN};
use crate::tables::{PROBABILITY_BITS, SYMBOLS, Table};

/// Numbers of a block's coefficients, row by row.
pub(super) type Levels = [i32; COEFFICIENTS];

/// Occurrences of each symbol in each table.
pub(super) type Counts = Vec<[u32; SYMBOLS]>;

/// Bits of each symbol in each table, in bits, with those of the plain bits behind it and of the sign.
#[derive(Debug, Clone)]
pub(super) struct SymbolBits(Vec<[f32; SYMBOLS]>);

impl SymbolBits {
    /// Bits under such tables.
    pub(super) fn new(tables: &[Table]) -> SymbolBits {
        let bits = |table: &Table, number: usize| {
            let within = if number < FIRST_ODD { number % SET_TABLES } else { 0 };
            std::array::from_fn(|symbol| {
                let frequency = (table.ranges[symbol] & 0xffff) as f32;
                let plain = if number >= FIRST_MODE {
                    0.0
                } else if within >= FIRST_END {
                    f32::from(END_BITS[symbol])
                } else {
                    // The last magnitude is coded less one and always has a sign.
                    let signed = symbol > 0 || within >= FIRST_LAST;
                    f32::from(MAGNITUDE_BITS[symbol]) + f32::from(u8::from(signed))
                };
                PROBABILITY_BITS as f32 - frequency.log2() + plain
            })
        };
        SymbolBits(tables.iter().enumerate().map(|(number, table)| bits(table, number)).collect())
    }

    /// Those of the table of that number.
    #[inline(always)]
    pub(super) fn of(&self, table: usize) -> &[f32; SYMBOLS] {
        &self.0[table]
    }

    /// Those of the tables of all classes of expected magnitudes, from the table of that number on.
    #[inline(always)]
    pub(super) fn levels(&self, first: usize) -> &[[f32; SYMBOLS]; LEVELS] {
        self.0[first..].first_chunk().unwrap_or(&[[0.0; SYMBOLS]; LEVELS])
    }
}

/// Bits of a magnitude in a table.
#[inline(always)]
pub(super) fn magnitude_bits(symbol_bits: &[f32; SYMBOLS], magnitude: u32) -> f32 {
    symbol_bits[magnitude_symbol(magnitude)] + escaped_bits(magnitude)
}

/// Bits of a magnitude beside those of its symbol.
#[inline(always)]
pub(super) fn escaped_bits(magnitude: u32) -> f32 {
    if magnitude < MAGNITUDE_START[ESCAPE] { 0.0 } else { 5.0 + escape_length(magnitude) as f32 }
}

/// Symbol of a magnitude.
#[inline(always)]
pub(super) fn magnitude_symbol(magnitude: u32) -> usize {
    match magnitude {
        0..=7 => magnitude as usize,
        _ => (7 + (magnitude - 6).ilog2() as usize).min(ESCAPE),
    }
}

/// Symbol of a number of coefficients.
#[inline]
pub(super) fn end_symbol(count: usize) -> usize {
    END_START.iter().rposition(|&start| usize::from(start) <= count).unwrap_or(0)
}

fn escape_length(magnitude: u32) -> u32 {
    32 - (magnitude - MAGNITUDE_START[ESCAPE]).leading_zeros()
}

/// Takes the symbols of a stream in their order.
pub(super) trait Sink {
    /// A symbol of the table of that number.
    fn symbol(&mut self, table: usize, symbol: usize);
    /// Plain bits.
    fn bits(&mut self, value: u32, count: u32);
    /// What follows belongs to the next block.
    fn next_block(&mut self) {}
}

/// Counts symbols and plain bits.
#[derive(Debug)]
pub(super) struct Counter {
    pub counts: Counts,
    pub plain_bits: u64,
}

impl Default for Counter {
    fn default() -> Self {
        Counter { counts: vec![[0; SYMBOLS]; FIRST_MODE + MODE_TABLES], plain_bits: 0 }
    }
}

impl Counter {
    /// Adds the counts of another one, `times` over.
    pub(super) fn add(&mut self, other: &Counter, times: f64) {
        let all = self.counts.iter_mut().flatten().zip(other.counts.iter().flatten());
        all.for_each(|(sum, &count)| *sum += (f64::from(count) * times).round() as u32);
        self.plain_bits += (other.plain_bits as f64 * times).round() as u64;
    }
}

impl Sink for Counter {
    fn symbol(&mut self, table: usize, symbol: usize) {
        self.counts[table][symbol] += 1;
    }

    fn bits(&mut self, _value: u32, count: u32) {
        self.plain_bits += u64::from(count);
    }
}

/// Collects what the stream is made of.
#[derive(Debug)]
pub(super) struct Collector<'a> {
    pub tables: &'a [Table],
    pub ops: Vec<Op>,
}

impl Sink for Collector<'_> {
    fn symbol(&mut self, table: usize, symbol: usize) {
        self.ops.push(Op::symbol(&self.tables[table], symbol));
    }

    fn bits(&mut self, value: u32, count: u32) {
        if count > 0 {
            self.ops.push(Op::bits(value, count));
        }
    }
}

/// Sums up the bits of each block.
#[derive(Debug)]
pub(super) struct BlockBits<'a> {
    pub tables: &'a [Table],
    pub blocks: Vec<f32>,
}

impl BlockBits<'_> {
    fn add(&mut self, bits: f32) {
        self.blocks.last_mut().into_iter().for_each(|sum| *sum += bits);
    }
}

impl Sink for BlockBits<'_> {
    fn symbol(&mut self, table: usize, symbol: usize) {
        let frequency = self.tables[table].ranges[symbol] & 0xffff;
        self.add(PROBABILITY_BITS as f32 - (frequency as f32).log2());
    }

    fn bits(&mut self, _value: u32, count: u32) {
        self.add(count as f32);
    }

    fn next_block(&mut self) {
        self.blocks.push(0.0);
    }
}

/// A superblock's quantised blocks, block by block, axis by axis: of each the levels up to the last that is not 0.
#[derive(Debug, Clone)]
pub(super) struct Superblock {
    /// Columns and rows of blocks.
    pub blocks: (usize, usize),
    /// Intra modes of its blocks, where they have such.
    pub modes: Vec<u8>,
    /// Number of levels of each block.
    counts: Vec<u8>,
    /// Levels in the order of coding.
    levels: Vec<i32>,
}

impl Superblock {
    /// Without levels yet.
    pub(super) fn new(blocks: (usize, usize)) -> Superblock {
        Superblock { blocks, modes: Vec::new(), counts: Vec::new(), levels: Vec::new() }
    }

    pub(super) fn push(&mut self, levels: &Levels) {
        let count = coded(levels, 0);
        self.counts.push(count as u8);
        self.levels.extend(SCAN[..count].iter().map(|place| levels[usize::from(place.raster)]));
    }

    /// Gives back the memory that no block needs.
    pub(super) fn shrink(&mut self) {
        self.modes.shrink_to_fit();
        self.counts.shrink_to_fit();
        self.levels.shrink_to_fit();
    }

    /// The levels of all blocks.
    pub(super) fn levels(&self) -> impl Iterator<Item = Levels> + '_ {
        let mut rest = self.levels.as_slice();
        self.counts.iter().map(move |&count| {
            let (own, further) = rest.split_at(count.into());
            rest = further;
            let mut levels = [0; COEFFICIENTS];
            SCAN.iter().zip(own).for_each(|(place, &level)| levels[usize::from(place.raster)] = level);
            levels
        })
    }

    /// Gives all symbols of the superblock to `sink`.
    pub(super) fn walk(&self, is_base: bool, first: usize, ranks: &[u8], sink: &mut impl Sink) {
        let mut around = Around::default();
        around.reset(self.blocks.0, self.blocks.1, ranks.len());
        for (number, levels) in self.levels().enumerate() {
            let (block, axis) = (number / ranks.len(), number % ranks.len());
            if axis == 0 {
                sink.next_block();
                let mode = self.modes.get(block).copied().unwrap_or_default();
                if let Some(table) = around.modes.table().filter(|_| !self.modes.is_empty()) {
                    sink.symbol(table, mode.into());
                }
                around.modes.push(mode);
            }
            let set = set_of(is_base, ranks[axis] == 0);
            let neighbours = around.of(block, axis, ranks[axis] > 1);
            let (magnitudes, end) = walk_block(&levels, first, set, &neighbours, sink);
            around.keep(block, axis, &magnitudes, end);
        }
    }
}

/// Number of coded coefficients: those from `first` to the last that is not 0.
pub(super) fn coded(levels: &Levels, first: usize) -> usize {
    let last = (first..COEFFICIENTS).rev().find(|&number| levels[usize::from(SCAN[number].raster)] != 0);
    last.map_or(0, |last| last + 1 - first)
}

/// The state of each coefficient, column by column.
pub(super) fn states_of(levels: &Levels) -> [State; COEFFICIENTS] {
    let mut states = [State::default(); COEFFICIENTS];
    let mut state = State::default();
    for place in SCAN.iter().rev() {
        let at = usize::from(place.raster);
        states[at] = state;
        state = state.after(levels[at].unsigned_abs());
    }
    states
}

/// Magnitudes of levels, padded.
pub(super) fn magnitudes_of(levels: &Levels) -> Magnitudes {
    let mut magnitudes = [0; PADDED];
    for place in SCAN {
        magnitudes[usize::from(place.padded)] = held(levels[usize::from(place.raster)].unsigned_abs());
    }
    magnitudes
}

/// Gives the symbols of a block's axis to `sink`.
pub(super) fn walk_block(
    levels: &Levels,
    first: usize,
    set: usize,
    neighbours: &Neighbours<'_>,
    sink: &mut impl Sink,
) -> (Magnitudes, usize) {
    let count = coded(levels, first);
    let end = end_symbol(count);
    let tables = set * SET_TABLES;
    sink.symbol(tables + FIRST_END + neighbours.end, end);
    sink.bits((count - usize::from(END_START[end])) as u32, u32::from(END_BITS[end]));
    // Contexts look only at what is decoded before, so all magnitudes may be there.
    let magnitudes = magnitudes_of(levels);
    let mut state = State::default();
    for number in (first..first + count).rev() {
        let place = SCAN[number];
        let (at, zone) = (usize::from(place.padded), usize::from(place.zone));
        let level = levels[usize::from(place.raster)];
        let last = number == first + count - 1;
        let table = if last {
            tables + FIRST_LAST + zone
        } else {
            first_table(set, zone, state) + neighbours.level(&magnitudes, at)
        };
        state = state.after(level.unsigned_abs());
        let magnitude = level.unsigned_abs() - u32::from(last);
        let symbol = magnitude_symbol(magnitude);
        sink.symbol(table, symbol);
        walk_rest(magnitude, symbol, sink);
    }
    let (mut negative, mut signs) = (0u64, 0u32);
    for number in (first..first + count).rev() {
        let level = levels[usize::from(SCAN[number].raster)];
        negative |= u64::from(level < 0) << signs;
        signs += u32::from(level != 0);
    }
    while signs > 0 {
        let read = signs.min(SIGNS as u32);
        sink.bits((negative & ((1 << read) - 1)) as u32, read);
        (negative, signs) = (negative >> read, signs - read);
    }
    (magnitudes, end)
}

/// The plain bits behind a magnitude's symbol.
fn walk_rest(magnitude: u32, symbol: usize, sink: &mut impl Sink) {
    let rest = magnitude - MAGNITUDE_START[symbol];
    if symbol < ESCAPE {
        return sink.bits(rest, u32::from(MAGNITUDE_BITS[symbol]));
    }
    let length = escape_length(magnitude);
    sink.bits(length, 5);
    sink.bits(rest & 0xfff, length.min(12));
    sink.bits(rest >> 12, length.saturating_sub(12));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn symbols_are_those_of_their_ranges() {
        for magnitude in 0..1000u32 {
            let naive = (0..SYMBOLS).rev().find(|&symbol| MAGNITUDE_START[symbol] <= magnitude).unwrap();
            assert_eq!(magnitude_symbol(magnitude), naive, "{magnitude}");
        }
        assert_eq!(end_symbol(0), 0);
        assert_eq!(end_symbol(6), 5);
        assert_eq!(end_symbol(64), 15);
    }
}
