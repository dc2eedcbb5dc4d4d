//! Coding of a block's coefficients by a trellis: the bit string of given length whose values come nearest to them.
//!
//! Each coefficient's value follows from the last ten bits up to its own (the state), so that a step of k bits leads from each
//! state to 2^k others. The Viterbi algorithm finds the best path; the first state must be what the last leaves behind, as
//! decoders read the string around its end. The best path without that rule gives the state that both shall be, and a second
//! run the best path through it: not always the best of all such rings, as "QTIP" (Tseng et al. 2024) does.
//! Cost: O(states) a coefficient and run.

use crate::decode::TEXFOLD_RESIDUAL_STATE_BITS;
use crate::decode::fast::{STATES, VALUES};

/// [`VALUES`] by the states' bits in reverse. States are held so in here: those that a state may follow, and those that may
/// follow it, then stand as vector units want them.
static REVERSED: [f32; STATES] = {
    let mut values = [0.0; STATES];
    let mut state = 0;
    while state < STATES {
        values[reverse(state)] = VALUES[state];
        state += 1;
    }
    values
};

/// A state with its bits in reverse.
const fn reverse(state: usize) -> usize {
    state.reverse_bits() >> (usize::BITS - TEXFOLD_RESIDUAL_STATE_BITS)
}

/// A coefficient to code.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Step {
    /// What its value should be.
    pub(crate) target: f32,
    /// What values of the table are multiplied by.
    pub(crate) weight: f32,
    /// Its bits, at least 1.
    pub(crate) rate: u32,
}

/// Cost of a state that no path may begin with.
const FORBIDDEN: f32 = 1e30;
/// Cost of all others: not 0, as the lowest bits of costs name the states before.
const START: f32 = 1.0;
/// Those bits, as many as the most that a coefficient may have.
const TAG: u32 = 31;

/// Room for one search after another.
#[derive(Debug)]
pub(crate) struct Trellis {
    cost: Vec<f32>,
    next: Vec<f32>,
    /// For each step the least cost of the states that agree in all but their oldest bits, and which of them has it.
    best: Vec<f32>,
    /// States along the path.
    path: Vec<u16>,
}

impl Default for Trellis {
    fn default() -> Self {
        Trellis { cost: vec![0.0; STATES], next: vec![0.0; STATES], best: Vec::new(), path: Vec::new() }
    }
}

impl Trellis {
    /// The last state of the best path from any state to any state, and that path's squared error.
    pub(crate) fn open(&mut self, steps: &[Step]) -> (u16, f32) {
        self.cost.fill(START);
        self.forward(steps);
        let end = (0..STATES).min_by(|&a, &b| self.cost[a].total_cmp(&self.cost[b])).unwrap_or(0);
        (reverse(end) as u16, self.cost[end] - START)
    }

    /// The states along the best path from state `end` back to it.
    pub(crate) fn ring(&mut self, steps: &[Step], end: u16) -> &[u16] {
        self.cost.fill(FORBIDDEN);
        let end = reverse(usize::from(end));
        self.cost[end] = START;
        self.forward(steps);
        self.trace(steps, end);
        &self.path
    }

    fn forward(&mut self, steps: &[Step]) {
        self.best.resize(steps.iter().map(|step| STATES >> step.rate).sum(), 0.0);
        let mut rest = self.best.as_mut_slice();
        for step in steps {
            let (best, further) = rest.split_at_mut(STATES >> step.rate);
            match step.rate {
                1 => advance::<2>(step, &self.cost, best, &mut self.next),
                2 => advance::<4>(step, &self.cost, best, &mut self.next),
                3 => advance::<8>(step, &self.cost, best, &mut self.next),
                4 => advance::<16>(step, &self.cost, best, &mut self.next),
                _ => advance::<32>(step, &self.cost, best, &mut self.next),
            }
            std::mem::swap(&mut self.cost, &mut self.next);
            rest = further;
        }
    }

    fn trace(&mut self, steps: &[Step], end: usize) {
        self.path.clear();
        self.path.resize(steps.len(), 0);
        let (mut state, mut start) = (end, self.best.len());
        for (step, place) in steps.iter().zip(&mut self.path).rev() {
            *place = reverse(state) as u16;
            let count = STATES >> step.rate;
            start -= count;
            let kept = state >> step.rate;
            state = kept + count * (self.best[start + kept].to_bits() & TAG) as usize;
        }
    }
}

/// One step: the least of the `WAYS` states that lead to the same ones, and the cost of going on from it.
fn advance<const WAYS: usize>(step: &Step, cost: &[f32], best: &mut [f32], next: &mut [f32]) {
    let count = best.len();
    let mut ways = cost.chunks_exact(count);
    for (least, &cost) in best.iter_mut().zip(ways.next().unwrap_or_default()) {
        *least = f32::from_bits(cost.to_bits() & !TAG);
    }
    for (way, costs) in (1..).zip(ways) {
        for (least, &cost) in best.iter_mut().zip(costs) {
            let cost = f32::from_bits(cost.to_bits() & !TAG | way);
            *least = if cost < *least { cost } else { *least };
        }
    }
    let (next, _) = next.as_chunks_mut::<WAYS>();
    let (values, _) = REVERSED.as_chunks::<WAYS>();
    for ((next, values), &least) in next.iter_mut().zip(values).zip(&*best) {
        for (next, value) in next.iter_mut().zip(values) {
            let miss = step.target - step.weight * value;
            *next = least + miss * miss;
        }
    }
}

/// Puts the own bits of each state behind one another, 16 at a time, the first lowest.
pub(crate) fn pack(steps: &[Step], path: &[u16]) -> Vec<u16> {
    let mut halves = Vec::new();
    let (mut word, mut filled) = (0u32, 0);
    for (step, &state) in steps.iter().zip(path) {
        word |= (u32::from(state) >> (TEXFOLD_RESIDUAL_STATE_BITS - step.rate)) << filled;
        filled += step.rate;
        if filled >= 16 {
            halves.push(word as u16);
            word >>= 16;
            filled -= 16;
        }
    }
    if filled > 0 {
        halves.push(word as u16);
    }
    halves
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(seed: u64, count: usize, rates: &[u32]) -> Vec<Step> {
        let mut rng = texfold_core::rng::Rng::new(seed);
        let mut next = || rng.between(-0.5, 0.5) as f32;
        // The sum of twelve evenly spread numbers is nearly normal, of variance 1.
        let step = |n: usize| Step {
            target: 123.4 * (0..12).map(|_| next()).sum::<f32>(),
            weight: 1.0,
            rate: rates[n % rates.len()],
        };
        (0..count).map(step).collect()
    }

    fn error(steps: &[Step], path: &[u16]) -> f32 {
        let miss = |(step, &state): (&Step, &u16)| step.target - step.weight * VALUES[usize::from(state)];
        steps.iter().zip(path).map(|pair| miss(pair).powi(2)).sum()
    }

    #[test]
    fn states_follow_one_another_around_the_ring() {
        let steps = random(3, 72, &[3, 2, 2, 1, 1]);
        let mut trellis = Trellis::default();
        let (end, _) = trellis.open(&steps);
        let path = trellis.ring(&steps, end).to_vec();
        let mut before = *path.last().unwrap();
        assert_eq!(before, end);
        for (step, &state) in steps.iter().zip(&path) {
            assert_eq!(state & ((1 << (10 - step.rate)) - 1), before >> step.rate);
            before = state;
        }
    }

    #[test]
    fn the_open_path_is_the_best_of_all() {
        // Five steps of two bits: every string of ten bits that can precede them and every one of theirs.
        let steps = random(9, 5, &[2]);
        let (end, found) = Trellis::default().open(&steps);
        let mut least = f32::MAX;
        for start in 0..1u32 << 10 {
            for bits in 0..1u32 << 10 {
                let string = start | bits << 10;
                let path: Vec<u16> = (1..=5).map(|n| (string >> (2 * n) & 1023) as u16).collect();
                least = least.min(error(&steps, &path));
            }
        }
        assert!((found / least - 1.0).abs() < 1e-3 && end < STATES as u16, "{found} {least}");
    }

    #[test]
    fn normal_numbers_come_near_the_bound_of_their_bits() {
        // Four levels of the best quantiser leave 0.1175 of the variance, the bound is 0.0625; two levels 0.363 and 0.25.
        for (rate, levels) in [(1, 0.363), (2, 0.1175)] {
            let steps = random(5, 4096, &[rate]);
            let mut trellis = Trellis::default();
            let (end, _) = trellis.open(&steps);
            let share = error(&steps, trellis.ring(&steps, end))
                / steps.iter().map(|s| s.target.powi(2)).sum::<f32>();
            assert!(share < 0.82 * levels, "{rate} bits leave {share}");
        }
    }

    #[test]
    fn own_bits_are_packed_in_order() {
        let steps = [1, 2, 5, 5, 5].map(|rate| Step { target: 0.0, weight: 1.0, rate });
        let path = [0x200, 0x300, 0x020, 0x3e0, 0x2a0];
        // 1, 11, 00001, 11111, 10101 from the lowest bit on: 18 bits.
        let bits: u32 = 1 | 3 << 1 | 1 << 3 | 31 << 8 | 21 << 13;
        assert_eq!(pack(&steps, &path), [bits as u16, (bits >> 16) as u16]);
    }
}
