//! Writing of the streams that `rans` reads.

use crate::tables::{PROBABILITY_BITS, Table};

/// Most bytes of a stream: what the index can say.
pub(super) const MAX_STREAM: usize = (1 << 24) - 1;

/// A symbol or plain bits.
#[derive(Debug, Clone, Copy)]
pub(super) struct Op {
    /// Frequency and sum of those before, or the value.
    value: u32,
    /// Number of plain bits; 0 for a symbol.
    count: u32,
}

impl Op {
    /// A symbol of a table.
    pub(super) fn symbol(table: &Table, symbol: usize) -> Op {
        Op { value: table.ranges[symbol], count: 0 }
    }

    /// Plain bits, 1 to 16.
    pub(super) fn bits(value: u32, count: u32) -> Op {
        Op { value, count }
    }
}

/// The stream of such operations, read in their order.
pub(super) fn stream(ops: &[Op]) -> Vec<u8> {
    let mut state = 0u32;
    let mut words = Vec::new();
    for op in ops.iter().rev() {
        if op.count > 0 {
            if state >> (32 - op.count) != 0 {
                words.push(state as u16);
                state >>= 16;
            }
            state = state << op.count | op.value;
        } else {
            let (frequency, start) = (op.value & 0xffff, op.value >> 16);
            if u64::from(state) >= u64::from(frequency) << (32 - PROBABILITY_BITS) {
                words.push(state as u16);
                state >>= 16;
            }
            state = ((state / frequency) << PROBABILITY_BITS) + state % frequency + start;
        }
    }
    let used = 4 - state.leading_zeros() as usize / 8;
    let mut bytes = state.to_le_bytes()[..used].to_vec();
    bytes.extend(words.iter().rev().flat_map(|word| word.to_le_bytes()));
    bytes
}

#[cfg(test)]
mod tests {
    use texfold_core::rng::Rng;

    use super::*;
    use crate::rans::Rans;
    use crate::tables::Stops;

    #[test]
    fn streams_of_any_length_come_back() {
        let mut rng = Rng::new(3);
        let tables: Vec<Table> = [2u8, 20, 40, 61]
            .iter()
            .map(|&value| {
                let mut stops = Stops::usual(0);
                stops.values_mut().fill(value);
                Table::new(&stops.frequencies())
            })
            .collect();
        for length in 0..400 {
            let plan: Vec<(usize, u32, u32)> = (0..length)
                .map(|_| {
                    let count = 1 + rng.below(16);
                    match rng.below(3) {
                        0 => (4, rng.below(1 << count), count),
                        _ => (rng.index(4), if rng.below(5) == 0 { rng.below(16) } else { 0 }, 0),
                    }
                })
                .collect();
            let op = |&(table, value, count): &(usize, u32, u32)| match count {
                0 => Op::symbol(&tables[table], value as usize),
                _ => Op::bits(value, count),
            };
            let bytes = stream(&plan.iter().map(op).collect::<Vec<_>>());
            let mut reader = Rans::new(&bytes);
            for &(table, value, count) in &plan {
                let read = match count {
                    0 => reader.symbol(&tables[table]) as u32,
                    _ => reader.bits(count),
                };
                assert_eq!(read, value);
            }
        }
    }

    #[test]
    fn likely_symbols_alone_cost_nothing() {
        let mut stops = Stops::usual(0);
        stops.values_mut().fill(63);
        let table = Table::new(&stops.frequencies());
        assert!(stream(&[Op::symbol(&table, 0); 40]).is_empty());
    }
}
