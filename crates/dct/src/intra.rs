//! Intra prediction: a block from the decoded samples next to it in its superblock, in integers.
//!
//! Source: Lainema and others, "Intra coding of the HEVC standard", 2012: directions in 1/32 of a sample and the planar mode; of 33
//! directions there are 14. A prediction's mean is taken away, as the means of blocks come from the base. Where a block is
//! predicted so, its lowest coefficients are not predicted from the means around it. All axes of a block have one mode, and a superblock
//! needs no other one. Bits saved at equal steps on four photographs, modes counted: 4.9 % at steps of 50 (0.3 to 1.1 bits a texel), 3.6 % at
//! steps of 20 (0.6 to 2.3 bits). *Not taken*: half of each prediction as a further choice (-0.1 and 0.2 %); directions of what the means leave
//! of the samples (-0.1 %).

use crate::context::{FIRST_MODE, MODE_TABLES};
use crate::scan::COEFFICIENTS;
use crate::tables::{SYMBOLS, Stops, Table};
use crate::vectors::vectorised;

/// Modes: none, planar, directions from the left, directions from above.
pub(super) const MODES: usize = SYMBOLS;
/// Directions from one side.
const DIRECTIONS: usize = 7;
/// Shift of each direction along the side that it comes from, in 1/32 of a sample for each sample away from it.
const ANGLES: [i32; DIRECTIONS] = [26, 13, 5, 0, -5, -13, -26];
/// Samples along a block's side.
const SIDE: usize = 8;
/// Samples of a side that blocks are predicted from, the corner first.
const REFERENCES: usize = 17;

/// Stopping probabilities of no prediction before any are measured, by the number of neighbours that are predicted.
#[cfg(feature = "encode")]
pub(super) const USUAL_NONE: [u8; MODE_TABLES] = [39, 32, 27];
/// Stopping probabilities of the other modes, of seven photographs at four steps.
pub(super) const MODE_STOPS: [u8; MODES - 2] = [24, 18, 18, 21, 25, 23, 23, 22, 21, 22, 24, 30, 28, 32];

/// The tables of modes, whose stopping probabilities of no prediction are `none`.
pub(super) fn tables(none: [u8; MODE_TABLES]) -> [Table; MODE_TABLES] {
    none.map(|none| Table::new(&stops(none).frequencies()))
}

/// The stopping probabilities of a table of modes.
pub(super) fn stops(none: u8) -> Stops {
    let mut stops = Stops::usual(FIRST_MODE);
    if let [first, others @ ..] = stops.values_mut() {
        *first = none;
        others.copy_from_slice(&MODE_STOPS);
    }
    stops
}

/// The modes of a superblock's blocks, as far as they are decoded.
#[derive(Debug, Default)]
pub(super) struct Modes {
    columns: usize,
    modes: Vec<u8>,
}

impl Modes {
    /// Forgets all, for a superblock of so many columns of blocks.
    pub(super) fn reset(&mut self, columns: usize) {
        self.columns = columns;
        self.modes.clear();
    }

    /// The table that codes the next block's mode; `None` for the first block, which has none.
    #[inline(always)]
    pub(super) fn table(&self) -> Option<usize> {
        let block = self.modes.len();
        let is_predicted = |at: usize| usize::from(self.modes[at] > 0);
        let left = if block.is_multiple_of(self.columns) { 0 } else { is_predicted(block - 1) };
        let above = if block < self.columns { 0 } else { is_predicted(block - self.columns) };
        (block > 0).then_some(FIRST_MODE + left + above)
    }

    /// Adds the next block's mode.
    #[inline(always)]
    pub(super) fn push(&mut self, mode: u8) {
        self.modes.push(mode);
    }

    /// The modes of all blocks, row by row.
    pub(super) fn all(&self) -> &[u8] {
        &self.modes
    }
}

/// The samples next to a block: those above it and those to its left, from the corner on.
#[derive(Debug)]
pub(super) struct References {
    above: [i32; REFERENCES],
    left: [i32; REFERENCES],
}

impl References {
    /// Of the block in that column and row of a superblock of so many columns of blocks. `samples` are an axis' samples, `side` in a
    /// row; those of the blocks before it are decoded. `None` for the first block.
    pub(super) fn new(
        samples: &[i32],
        side: usize,
        columns: usize,
        (column, row): (usize, usize),
    ) -> Option<References> {
        let own = SIDE * (row * side + column);
        let (has_left, has_above) = (column > 0, row > 0);
        let mut references = References { above: [0; REFERENCES], left: [0; REFERENCES] };
        let References { above, left } = &mut references;
        if has_above {
            let first = own - side;
            let count = if column + 1 < columns { 2 * SIDE } else { SIDE };
            above[1..=count].copy_from_slice(&samples[first..first + count]);
            let last = above[count];
            above[count + 1..].fill(last);
        }
        if has_left {
            for (line, sample) in left[1..].iter_mut().enumerate() {
                *sample = samples[own - 1 + line.min(SIDE - 1) * side];
            }
        }
        match (has_left, has_above) {
            (false, false) => return None,
            (true, true) => (above[0], left[0]) = (samples[own - side - 1], samples[own - side - 1]),
            // What is missing is as the nearest sample that is there.
            (true, false) => {
                above.fill(left[1]);
                left[0] = left[1];
            }
            (false, true) => {
                left.fill(above[1]);
                above[0] = above[1];
            }
        }
        Some(references)
    }

    /// The block's samples by a mode other than none, less their mean.
    pub(super) fn predict(&self, mode: u8) -> [i32; COEFFICIENTS] {
        vectorised(
            #[inline(always)]
            || {
                let mut samples = self.lines(mode);
                let sum = samples.iter().fold(0i32, |sum, &sample| sum.wrapping_add(sample));
                let mean = sum.wrapping_add(32) >> 6;
                samples.iter_mut().for_each(|sample| *sample = sample.wrapping_sub(mean));
                if is_from_left(mode) { turned(&samples) } else { samples }
            },
        )
    }

    /// The block's samples by a mode other than none: column by column where it is [`is_from_left`], else row by row.
    #[inline(always)]
    pub(super) fn lines(&self, mode: u8) -> [i32; COEFFICIENTS] {
        let direction = usize::from(mode).saturating_sub(2);
        let angle = ANGLES[direction % DIRECTIONS];
        match mode {
            0 | 1 => self.planar(),
            _ if is_from_left(mode) => directed(&self.left, &self.above, angle),
            _ => directed(&self.above, &self.left, angle),
        }
    }

    /// The mean of what lies between both sides, with their last samples opposite.
    #[inline(always)]
    fn planar(&self) -> [i32; COEFFICIENTS] {
        let (right, below) = (self.above[1 + SIDE], self.left[1 + SIDE]);
        let mut samples = [0; COEFFICIENTS];
        for (y, line) in samples.chunks_exact_mut(SIDE).enumerate() {
            for (x, sample) in line.iter_mut().enumerate() {
                let between = |one: i32, other: i32, place: usize| {
                    one.wrapping_mul((SIDE - 1 - place) as i32)
                        .wrapping_add(other.wrapping_mul(place as i32 + 1))
                };
                let across = between(self.left[1 + y], right, x);
                let down = between(self.above[1 + x], below, y);
                *sample = across.wrapping_add(down).wrapping_add(8) >> 4;
            }
        }
        samples
    }
}

/// Whether a mode is a direction from the left.
#[inline(always)]
pub(super) fn is_from_left(mode: u8) -> bool {
    (2..2 + DIRECTIONS).contains(&usize::from(mode))
}

/// Columns as rows.
#[inline(always)]
pub(super) fn turned(samples: &[i32; COEFFICIENTS]) -> [i32; COEFFICIENTS] {
    let mut out = [0; COEFFICIENTS];
    for at in 0..COEFFICIENTS {
        out[at] = samples[at % SIDE * SIDE + at / SIDE];
    }
    out
}

/// A block's samples line by line away from `main`; behind its corner come those of `other`.
#[inline(always)]
fn directed(main: &[i32; REFERENCES], other: &[i32; REFERENCES], angle: i32) -> [i32; COEFFICIENTS] {
    // Places from -7 on.
    let mut known = [0; REFERENCES + SIDE];
    known[SIDE..].copy_from_slice(main);
    if angle < 0 {
        for before in 1..SIDE as i32 {
            let place = (32 * before - angle / 2) / -angle;
            known[SIDE - before as usize] = other[(place as usize).min(REFERENCES - 1)];
        }
    }
    let mut samples = [0; COEFFICIENTS];
    for (away, line) in (1..).zip(samples.chunks_exact_mut(SIDE)) {
        let part = (away * angle) & 31;
        let first = (SIDE as i32 + 1 + ((away * angle) >> 5)) as usize;
        let known = &known[first.min(REFERENCES - 1)..][..SIDE + 1];
        for (sample, pair) in line.iter_mut().zip(known.windows(2)) {
            let (one, next) = (pair[0].wrapping_mul(32 - part), pair[1].wrapping_mul(part));
            *sample = one.wrapping_add(next).wrapping_add(16) >> 5;
        }
    }
    samples
}

/// Adds the predictions of a superblock's blocks to their samples: for each axis `side` rows of `side`.
pub(super) fn add_predictions(samples: &mut [i32], side: usize, columns: usize, modes: &[u8]) {
    for samples in samples.chunks_exact_mut(side * side) {
        for (block, &mode) in modes.iter().enumerate().filter(|(_, mode)| **mode > 0) {
            let place = (block % columns, block / columns);
            let Some(references) = References::new(samples, side, columns, place) else { continue };
            add(samples, side, place, &references.predict(mode));
        }
    }
}

/// Sets the samples of the block in that column and row of a superblock, of `side` samples a row.
#[inline(always)]
pub(super) fn put(
    samples: &mut [i32],
    side: usize,
    (column, row): (usize, usize),
    block: &[i32; COEFFICIENTS],
) {
    let first = SIDE * (row * side + column);
    for (line, block) in block.chunks_exact(SIDE).enumerate() {
        samples[first + line * side..][..SIDE].copy_from_slice(block);
    }
}

/// Adds a prediction to them.
pub(super) fn add(
    samples: &mut [i32],
    side: usize,
    (column, row): (usize, usize),
    predicted: &[i32; COEFFICIENTS],
) {
    let first = SIDE * (row * side + column);
    for (line, predicted) in predicted.chunks_exact(SIDE).enumerate() {
        let own = samples[first + line * side..][..SIDE].iter_mut().zip(predicted);
        own.for_each(|(sample, &predicted)| *sample = sample.wrapping_add(predicted));
    }
}
