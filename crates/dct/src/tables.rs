//! Probability tables that cost a few bits each: a distribution of 16 symbols follows from some stopping probabilities.
//!
//! Symbol s is taken with probability h(s) if none before it was. A table of magnitudes has five stopping probabilities (of 0,
//! 1, 2, of 3 to 7 and of the classes from 8 on), one of numbers of coefficients has fifteen. Each is one of 64 on a logistic
//! scale, 0.22 apart, which costs less than 0.001 bits a symbol. All arithmetic is in 32-bit integers, so that a shader can
//! make the same tables from the same few bytes.

use std::ops::Range;

use crate::bits::BitReader;
use crate::context::{FIRST_END, FIRST_MODE, FIRST_ODD, LEVELS, ODD_ROWS, SET_TABLES, SETS, TABLES};
use crate::scan::ZONES;

/// Symbols of a table.
pub(super) const SYMBOLS: usize = 16;
/// Binary logarithm of the sum of a table's frequencies.
pub(super) const PROBABILITY_BITS: u32 = 13;
/// Binary logarithm of the slots that share a first guess of their symbol: a table has 128 bytes, two lines of a cache.
const GUESS_SHIFT: u32 = 7;
/// Stopping probabilities of a table of magnitudes.
pub(super) const MAGNITUDE_STOPS: usize = 5;
/// Stopping probabilities of a table of numbers of coefficients.
pub(super) const END_STOPS: usize = SYMBOLS - 1;
/// Values of a stopping probability.
pub(super) const STOP_VALUES: usize = 64;
/// How far the odd quantiser's stopping probabilities are expected above those of the even one.
const ODD_SHIFT: [i32; MAGNITUDE_STOPS] = [-6, 0, 1, 0, 0];
/// What stopping probabilities are predicted by where nothing is known: 0.49.
pub(super) const USUAL_STOP: u8 = 31;

/// Stopping probabilities in 1/65536: 1 / (1 + exp(-0.22 (n - 31.5))).
pub(super) const STOP: [u16; STOP_VALUES] = [
    64, 80, 99, 124, 154, 192, 239, 298, 370, 461, 573, 713, 886, 1100, 1366, 1693, 2096, 2592, 3198, 3938,
    4835, 5918, 7214, 8752, 10558, 12655, 15054, 17754, 20741, 23977, 27410, 30968, 34568, 38126, 41559,
    44795, 47782, 50482, 52881, 54978, 56784, 58322, 59618, 60701, 61598, 62338, 62944, 63440, 63843, 64170,
    64436, 64650, 64823, 64963, 65075, 65166, 65238, 65297, 65344, 65382, 65412, 65437, 65456, 65472,
];

/// Stopping probabilities of a set.
const SET_STOPS: usize = FIRST_END * MAGNITUDE_STOPS + (SET_TABLES - FIRST_END) * END_STOPS;
/// The letter of 0 in [`PRESET`]; the others follow it in ASCII.
pub(crate) const PRESET_ZERO: u8 = b'0';
/// A letter for each stopping probability of all tables, in their order: of quantisers that do not depend on one another, and of
/// dependent ones.
pub(crate) const PRESETS: [&str; 2] = [include_str!("preset.txt"), include_str!("preset_dependent.txt")];

/// Stopping probabilities of one table, as numbers below [`STOP_VALUES`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stops {
    values: [u8; END_STOPS],
    /// How many of them are in use.
    count: u8,
}

impl Stops {
    /// The usual ones of the table of that number.
    pub(super) fn usual(table: usize) -> Stops {
        let count = if is_end(table) { END_STOPS } else { MAGNITUDE_STOPS };
        Stops { values: [USUAL_STOP; END_STOPS], count: count as u8 }
    }

    /// Those of the table of that number in a preset.
    fn preset(table: usize, preset: &str) -> Stops {
        let mut stops = Stops::usual(table);
        let (set, within) =
            if table < FIRST_ODD { (table / SET_TABLES, table % SET_TABLES) } else { (SETS, 0) };
        let ends = within.saturating_sub(FIRST_END);
        let odd = table.saturating_sub(FIRST_ODD);
        let start = set * SET_STOPS + (within - ends + odd) * MAGNITUDE_STOPS + ends * END_STOPS;
        let letters = preset.as_bytes().get(start..).unwrap_or_default();
        for (value, &letter) in stops.values_mut().iter_mut().zip(letters) {
            *value = letter.saturating_sub(PRESET_ZERO).min(STOP_VALUES as u8 - 1);
        }
        stops
    }

    /// The values in use.
    pub(super) fn values(&self) -> &[u8] {
        &self.values[..usize::from(self.count)]
    }

    /// The values in use.
    pub(super) fn values_mut(&mut self) -> &mut [u8] {
        &mut self.values[..usize::from(self.count)]
    }

    /// How far its values lie above those of another one.
    fn beyond(&self, other: &Stops) -> [i32; END_STOPS] {
        std::array::from_fn(|stop| i32::from(self.values[stop]) - i32::from(other.values[stop]))
    }

    /// Its values moved so far, but not out of range.
    fn moved(mut self, by: &[i32]) -> Stops {
        for (value, by) in self.values_mut().iter_mut().zip(by) {
            *value = (i32::from(*value) + by).clamp(0, STOP_VALUES as i32 - 1) as u8;
        }
        self
    }

    /// Which stopping probability decides at `symbol`.
    pub(super) fn stop_of(&self, symbol: usize) -> usize {
        if usize::from(self.count) == END_STOPS {
            return symbol;
        }
        match symbol {
            0..=2 => symbol,
            3..=7 => 3,
            _ => 4,
        }
    }

    /// Frequencies that sum to 2 to the power of [`PROBABILITY_BITS`], none of them 0.
    pub(super) fn frequencies(&self) -> [u16; SYMBOLS] {
        let spread = (1u32 << PROBABILITY_BITS) - SYMBOLS as u32;
        let values = self.values();
        let mut rest = 1u32 << 16;
        let mut frequencies = [0u16; SYMBOLS];
        for (symbol, frequency) in frequencies.iter_mut().enumerate() {
            let taken = if symbol == SYMBOLS - 1 {
                rest
            } else {
                let stop = STOP[usize::from(values[self.stop_of(symbol)]) & (STOP_VALUES - 1)];
                (rest * u32::from(stop)) >> 16
            };
            rest -= taken;
            *frequency = (1 + ((taken * spread) >> 16)) as u16;
        }
        let sum: u32 = frequencies.iter().map(|&frequency| u32::from(frequency)).sum();
        let mut largest = 0;
        for symbol in 1..SYMBOLS {
            if frequencies[symbol] > frequencies[largest] {
                largest = symbol;
            }
        }
        frequencies[largest] += ((1 << PROBABILITY_BITS) - sum) as u16;
        frequencies
    }
}

/// Whether the table of that number codes numbers of coefficients, or intra modes.
pub(super) fn is_end(table: usize) -> bool {
    table >= FIRST_MODE || table < FIRST_ODD && table % SET_TABLES >= FIRST_END
}

/// First tables of the rows of a set: magnitudes by subband, last magnitudes, numbers of coefficients. The end of the
/// last one follows.
const ROWS: [usize; ZONES + 3] = set_rows();

/// The rows of all tables in their order: those of each set, and where quantisers are dependent those of the odd one behind them.
pub(super) fn rows(is_dependent: bool) -> impl Iterator<Item = Range<usize>> {
    let of_set =
        |set: usize| ROWS.windows(2).map(move |row| set * SET_TABLES + row[0]..set * SET_TABLES + row[1]);
    let odd = (0..if is_dependent { SETS * ODD_ROWS } else { 0 }).map(|row| FIRST_ODD + row * LEVELS);
    (0..SETS).flat_map(of_set).chain(odd.map(|first| first..first + LEVELS))
}

/// Tables of a texture.
pub(super) fn count(is_dependent: bool) -> usize {
    if is_dependent { TABLES } else { FIRST_ODD }
}

/// The table of the even quantiser for the same class as an odd one: that of the higher one of both subbands.
fn even_of(odd: usize) -> usize {
    let (row, class) = ((odd - FIRST_ODD) / LEVELS, (odd - FIRST_ODD) % LEVELS);
    row / ODD_ROWS * SET_TABLES + (2 * (row % ODD_ROWS) + 1) * LEVELS + class
}

const fn set_rows() -> [usize; ZONES + 3] {
    let mut starts = [0; ZONES + 3];
    let mut zone = 0;
    while zone <= ZONES {
        starts[zone] = zone * LEVELS;
        zone += 1;
    }
    starts[ZONES + 1] = FIRST_END;
    starts[ZONES + 2] = SET_TABLES;
    starts
}

/// A table as the decoder uses it. *Not taken*: all starts compared at once, without guesses: 64 bytes instead of 128, but
/// half as slow again.
#[derive(Debug, Clone)]
pub(super) struct Table {
    /// Frequency and behind it, in the upper half, the sum of those before, for each symbol.
    pub ranges: [u32; SYMBOLS],
    /// First symbol of each group of slots.
    guesses: [u8; 1 << (PROBABILITY_BITS - GUESS_SHIFT)],
}

impl Table {
    /// The table of such frequencies.
    pub(super) fn new(frequencies: &[u16; SYMBOLS]) -> Table {
        let mut ranges = [0; SYMBOLS];
        let mut guesses = [0; 1 << (PROBABILITY_BITS - GUESS_SHIFT)];
        let mut start = 0u32;
        for (symbol, &frequency) in frequencies.iter().enumerate() {
            ranges[symbol] = u32::from(frequency) | start << 16;
            // Groups that begin with a slot of this symbol.
            let first = start.div_ceil(1 << GUESS_SHIFT) as usize;
            start += u32::from(frequency);
            let end = start.div_ceil(1 << GUESS_SHIFT) as usize;
            guesses[first..end].fill(symbol as u8);
        }
        Table { ranges, guesses }
    }

    /// The first slots of all symbols, two a word, the first in the lower half: what a shader reads.
    pub(super) fn starts(&self) -> [u32; SYMBOLS / 2] {
        std::array::from_fn(|pair| self.ranges[2 * pair] >> 16 | self.ranges[2 * pair + 1] & 0xffff_0000)
    }

    /// Symbol, its frequency and the place of `slot` in it.
    #[inline(always)]
    pub(super) fn find(&self, slot: u32) -> (usize, u32, u32) {
        let group = (slot >> GUESS_SHIFT) as usize & (self.guesses.len() - 1);
        let mut symbol = usize::from(self.guesses[group]);
        loop {
            let range = self.ranges[symbol & (SYMBOLS - 1)];
            let (frequency, within) = (range & 0xffff, slot.wrapping_sub(range >> 16));
            if within < frequency || symbol == SYMBOLS - 1 {
                return (symbol & (SYMBOLS - 1), frequency, within);
            }
            symbol += 1;
        }
    }
}

/// The stopping probabilities of all tables.
pub(super) type AllStops = Vec<Stops>;

/// Start of the prediction of a texture's tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Begin {
    /// All stopping probabilities alike.
    #[default]
    Alike,
    /// Those of photographs and maps: one of [`PRESETS`].
    Preset,
}

/// Prediction of a table's stopping probabilities. From all alike: those of the table before in its row, of the same row of the set
/// before for the first. From the preset: its own there, moved as far as the table before in its row lies off.
/// Where no preset is taken, the odd quantiser's tables are predicted by the even one's, likewise moved.
pub(super) fn predicted(stops: &AllStops, table: usize, begin: Begin) -> Stops {
    let is_odd = table >= FIRST_ODD;
    let is_first = if is_odd {
        (table - FIRST_ODD).is_multiple_of(LEVELS)
    } else {
        ROWS.contains(&(table % SET_TABLES))
    };
    let preset = |table: usize| Stops::preset(table, PRESETS[usize::from(stops.len() > FIRST_ODD)]);
    match begin {
        Begin::Alike if is_odd && is_first => stops[even_of(table)].moved(&ODD_SHIFT),
        Begin::Alike if is_odd => {
            stops[even_of(table)].moved(&stops[table - 1].beyond(&stops[even_of(table - 1)]))
        }
        Begin::Alike if is_first && table < SET_TABLES => Stops::usual(table),
        Begin::Alike if is_first => stops[table - SET_TABLES],
        Begin::Alike => stops[table - 1],
        Begin::Preset if is_first => preset(table),
        Begin::Preset => preset(table).moved(&stops[table - 1].beyond(&preset(table - 1))),
    }
}

/// Usual stopping probabilities for all tables.
pub(super) fn usual(is_dependent: bool) -> AllStops {
    (0..count(is_dependent)).map(Stops::usual).collect()
}

/// Tables, row by row: a flag, set where the row is as predicted; else a flag for each table and the differences.
fn read_stops(bytes: &[u8], begin: Begin, is_dependent: bool) -> Option<AllStops> {
    let mut reader = BitReader::new(bytes);
    let mut all = usual(is_dependent);
    for row in rows(is_dependent) {
        let as_predicted = reader.flag();
        for table in row {
            let mut stops = predicted(&all, table, begin);
            if !as_predicted && !reader.flag() {
                for value in stops.values_mut() {
                    let read = i32::from(*value) + reader.signed()?;
                    *value = u8::try_from(read).ok().filter(|&read| usize::from(read) < STOP_VALUES)?;
                }
            }
            all[table] = stops;
        }
    }
    Some(all)
}

/// The stopping probabilities of a texture as they are stored.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct StoredStops {
    pub(super) begin: Begin,
    pub(super) is_dependent: bool,
    pub(super) bytes: Vec<u8>,
}

impl StoredStops {
    /// Those of the preset, for dependent quantisers.
    #[cfg(feature = "encode")]
    pub(super) fn preset() -> StoredStops {
        // A flag for each row, set.
        let bytes = vec![u8::MAX; rows(true).count().div_ceil(8)];
        StoredStops { begin: Begin::Preset, is_dependent: true, bytes }
    }

    /// All of them; `None` where no writer writes such bytes.
    pub(super) fn read(&self) -> Option<AllStops> {
        read_stops(&self.bytes, self.begin, self.is_dependent)
    }

    /// Their tables, likewise.
    pub(super) fn tables(&self) -> Option<Vec<Table>> {
        let all = self.read()?;
        Some(all.iter().map(|stops| Table::new(&stops.frequencies())).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_slot_is_found_in_its_symbol() {
        for table in [0, FIRST_END] {
            for value in [0, 7, 31, 63] {
                let mut stops = Stops::usual(table);
                stops.values_mut().fill(value);
                let frequencies = stops.frequencies();
                assert_eq!(frequencies.iter().map(|&f| u32::from(f)).sum::<u32>(), 1 << PROBABILITY_BITS);
                assert!(frequencies.iter().all(|&frequency| frequency > 0));
                let built = Table::new(&frequencies);
                let naive = frequencies.iter().enumerate().flat_map(|(symbol, &frequency)| {
                    (0..u32::from(frequency)).map(move |within| (symbol, u32::from(frequency), within))
                });
                for (slot, expected) in naive.enumerate() {
                    assert_eq!(built.find(slot as u32), expected);
                }
            }
        }
    }
}
