//! Stopping probabilities from counts, where a difference costs bits of the header.

use super::symbols::Counts;
use crate::bits::{BitWriter, signed_bits};
use crate::tables::{AllStops, Begin, STOP, STOP_VALUES, SYMBOLS, Stops, predicted, rows, usual};

/// Stopping probabilities as they are written.
#[derive(Debug, Clone)]
pub(super) struct Fitted {
    pub(super) all: AllStops,
    pub(super) begin: Begin,
    pub(super) bytes: Vec<u8>,
}

/// The stopping probabilities that code such counts in the fewest bits, those of their own bytes included.
pub(super) fn fit(counts: &Counts) -> Fitted {
    let bits = StopBits::new();
    let [alike, preset] = [Begin::Alike, Begin::Preset].map(|begin| fit_from(counts, begin, &bits));
    if preset.bits(counts, &bits) <= alike.bits(counts, &bits) { preset } else { alike }
}

impl Fitted {
    /// Bits of such symbols and of the bytes; plain bits are left out.
    pub(super) fn bits(&self, counts: &Counts, bits: &StopBits) -> f64 {
        let symbols = self.all.iter().zip(counts).map(|(stops, counts)| bits.of(stops, counts));
        symbols.sum::<f64>() + 8.0 * self.bytes.len() as f64
    }
}

/// As [`fit`], from one beginning.
pub(super) fn fit_from(counts: &Counts, begin: Begin, bits: &StopBits) -> Fitted {
    let mut all = usual(true);
    let mut writer = BitWriter::default();
    for row in rows(true) {
        fit_row(counts, row, bits, begin, &mut all, &mut writer);
    }
    Fitted { all, begin, bytes: writer.finish() }
}

/// Fits the tables of a row, as predicted where that costs no more.
fn fit_row(
    counts: &Counts,
    tables: std::ops::Range<usize>,
    bits: &StopBits,
    begin: Begin,
    all: &mut AllStops,
    writer: &mut BitWriter,
) {
    let (mut fitted, mut plain) = (0.0, 0.0);
    for table in tables.clone() {
        all[table] = predicted(all, table, begin);
        plain += bits.of(&all[table], &counts[table]);
    }
    let unfitted = all[tables.clone()].to_vec();
    for table in tables.clone() {
        let (stops, cost) = bits.best(predicted(all, table, begin), &counts[table]);
        all[table] = stops;
        fitted += cost;
    }
    writer.flag(plain <= fitted);
    if plain <= fitted {
        all[tables].copy_from_slice(&unfitted);
        return;
    }
    for table in tables {
        let from = predicted(all, table, begin);
        let same = from == all[table];
        writer.flag(same);
        if !same {
            let pairs = all[table].values().iter().zip(from.values());
            pairs.for_each(|(&value, &from)| writer.signed(i32::from(value) - i32::from(from)));
        }
    }
}

/// Bits of stopping and of going on, for each stopping probability.
pub(super) struct StopBits([[f64; 2]; STOP_VALUES]);

impl StopBits {
    pub(super) fn new() -> Self {
        let bits = |share: f64| -share.log2();
        StopBits(STOP.map(|stop| {
            let share = f64::from(stop) / 65536.0;
            [bits(share), bits(1.0 - share)]
        }))
    }

    fn of_value(&self, value: u8, stopped: u32, passed: u32) -> f64 {
        let [stop, pass] = self.0[usize::from(value) % STOP_VALUES];
        f64::from(stopped) * stop + f64::from(passed) * pass
    }

    /// Bits of such symbols.
    pub(super) fn of(&self, stops: &Stops, counts: &[u32; SYMBOLS]) -> f64 {
        let tallies = tallies(stops, counts);
        stops
            .values()
            .iter()
            .zip(tallies)
            .map(|(&value, [stop, pass])| self.of_value(value, stop, pass))
            .sum()
    }

    /// The best stopping probabilities and the bits of such symbols with those of the differences.
    fn best(&self, from: Stops, counts: &[u32; SYMBOLS]) -> (Stops, f64) {
        let tallies = tallies(&from, counts);
        let mut best = from;
        let mut total = 1.0;
        for ((value, &before), [stop, pass]) in best.values_mut().iter_mut().zip(from.values()).zip(tallies) {
            let cost = |to: u8| {
                f64::from(signed_bits(i32::from(to) - i32::from(before))) + self.of_value(to, stop, pass)
            };
            let best = (0..STOP_VALUES as u8).map(|to| (cost(to), to)).min_by(|a, b| a.0.total_cmp(&b.0));
            let (bits, to) = best.unwrap_or((0.0, before));
            *value = to;
            total += bits;
        }
        let plain = 1.0 + self.of(&from, counts);
        if plain <= total { (from, plain) } else { (best, total) }
    }
}

/// How often each stopping probability stopped, and how often not.
fn tallies(stops: &Stops, counts: &[u32; SYMBOLS]) -> Vec<[u32; 2]> {
    let mut tallies = vec![[0; 2]; stops.values().len()];
    let mut beyond: u32 = counts.iter().sum();
    for (symbol, &count) in counts.iter().enumerate().take(SYMBOLS - 1) {
        beyond -= count;
        let tally = &mut tallies[stops.stop_of(symbol)];
        tally[0] += count;
        tally[1] += beyond;
    }
    tallies
}

#[cfg(test)]
mod tests {
    use texfold_core::rng::Rng;

    use super::*;
    use crate::context::TABLES;
    use crate::tables::StoredStops;

    #[test]
    fn written_tables_are_read_as_fitted() {
        let mut rng = Rng::new(8);
        for most in [0, 3, 5000] {
            let mut counts = vec![[0u32; SYMBOLS]; TABLES];
            counts.iter_mut().flatten().for_each(|count| *count = rng.below(most + 1) * rng.below(2));
            let bits = StopBits::new();
            for begin in [Begin::Alike, Begin::Preset] {
                let Fitted { all, bytes, .. } = fit_from(&counts, begin, &bits);
                assert!(most > 0 || bytes.len() <= 6, "{} bytes for nothing", bytes.len());
                assert_eq!(StoredStops { begin, is_dependent: true, bytes }.read(), Some(all));
            }
        }
    }

    #[test]
    fn fitted_tables_come_near_the_entropy() {
        let mut counts = vec![[0u32; SYMBOLS]; TABLES];
        // 3/4, 1/8 and so on, a thousand times.
        counts[5] = std::array::from_fn(|symbol| if symbol == 0 { 75_000 } else { 25_000 >> symbol });
        let stops = fit(&counts).all;
        let frequencies = stops[5].frequencies();
        let total: f64 = counts[5].iter().map(|&count| f64::from(count)).sum();
        let (mut ideal, mut coded) = (0.0, 0.0);
        for (&count, frequency) in counts[5].iter().zip(frequencies) {
            let count = f64::from(count);
            ideal -= if count > 0.0 { count * (count / total).log2() } else { 0.0 };
            coded -= count * (f64::from(frequency) / 8192.0).log2();
        }
        assert!(coded < 1.01 * ideal, "{coded} bits of {ideal}");
    }
}
