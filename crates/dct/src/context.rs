//! Which probability table codes a symbol: from what is decoded already of the block, of the blocks to its left and above
//! in the superblock, and of the block's axis before.
//!
//! A magnitude is expected from the five coefficients just above it in frequency, as in AV1 and VVC, and from the same
//! coefficient of the neighbouring blocks, as in Wu, "High-order context modeling and embedded conditional entropy coding of
//! wavelet coefficients", 1997. Least squares over seven photographs give weights of 0.24, 0.18 and 0.2 for direct, diagonal
//! and next coefficients, 0.08 to 0.14 for each neighbouring block and 0.13 for the axis before where that is no luma: so
//! a quarter, an eighth and an eighth. *Not taken*: the coefficients around that of the neighbouring blocks (0.02 each),
//! luma for the first chroma axis (0.02); gradient-boosted trees over 28 features of the same surroundings, learned on eight photographs,
//! would take 1.3, 1.0 and 0.6 % of the bits of symbols and signs at 0.5, 1 and 2 bits on eight others.

use crate::intra::Modes;
use crate::scan::{PADDED, PADDED_SIDE, ZONES};

/// Classes of expected magnitude.
pub(super) const LEVELS: usize = 16;
/// Contexts of a block's number of coefficients: eight by the neighbours' numbers, one where there are none.
pub(super) const END_CONTEXTS: usize = 9;
/// Tables of one kind of plane and axis: of magnitudes, of the last coefficient's magnitude, of numbers of coefficients.
pub(super) const SET_TABLES: usize = ZONES * LEVELS + ZONES + END_CONTEXTS;
/// Kinds: detail or base, first axis of a group or another one.
pub(super) const SETS: usize = 4;
/// Rows of tables of magnitudes of the odd quantiser in a set, each of two subbands.
pub(super) const ODD_ROWS: usize = ZONES / 2;
/// First table of the odd quantiser: those of all sets stand behind all others.
pub(super) const FIRST_ODD: usize = SETS * SET_TABLES;
/// All tables of a texture with dependent quantisers; others have those before [`FIRST_ODD`].
pub(super) const TABLES: usize = FIRST_ODD + SETS * ODD_ROWS * LEVELS;
/// Tables of intra modes, by the number of neighbours that are predicted: behind all others.
pub(super) const MODE_TABLES: usize = 3;
/// The first of them.
pub(super) const FIRST_MODE: usize = TABLES;
/// First table of the last coefficient's magnitude in a set.
pub(super) const FIRST_LAST: usize = ZONES * LEVELS;
/// First table of numbers of coefficients in a set.
pub(super) const FIRST_END: usize = FIRST_LAST + ZONES;
/// Largest magnitude that contexts tell apart.
const LARGEST: u32 = 127;

/// Class by the expected magnitude in eighths.
pub(super) static LEVEL: [u8; 256] = levels();

const fn levels() -> [u8; 256] {
    // The largest expectation of each class; a class spans some 40 %.
    const LAST: [usize; LEVELS] = [0, 1, 2, 3, 4, 6, 8, 11, 15, 22, 32, 48, 80, 128, 200, 255];
    let mut table = [0; 256];
    let (mut level, mut at) = (0, 0);
    while at < 256 {
        if at > LAST[level] {
            level += 1;
        }
        table[at] = level as u8;
        at += 1;
    }
    table
}

/// Which quantiser a coefficient has: dependent quantisation as in ECM, with eight states (VVC has four; Schwarz and others,
/// "Quantization and entropy coding in the Versatile Video Coding (VVC) standard", 2021, section V).
///
/// In even states a magnitude m stands for m steps, in odd ones for m - 1/2 (0 for 0). The parity of m leads to the next state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct State(u8);

/// Number of states.
#[cfg(feature = "encode")]
pub(super) const STATES: usize = 8;
/// The state behind each one, behind an even magnitude and behind an odd one; four bits a state, the lowest first.
pub(super) const NEXT_STATES: [u32; 2] = [0x7342_6150, 0x5160_4372];

impl State {
    /// The state of that number.
    #[cfg(feature = "encode")]
    pub(super) fn new(number: usize) -> State {
        State(number as u8)
    }

    /// Its number.
    #[cfg(feature = "encode")]
    pub(super) fn number(self) -> usize {
        usize::from(self.0)
    }

    /// 1 in odd states, else 0.
    #[inline(always)]
    pub(super) fn odd(self) -> u32 {
        u32::from(self.0 & 1)
    }

    /// The state behind a coefficient of that magnitude.
    #[inline(always)]
    pub(super) fn after(self, magnitude: u32) -> State {
        State((NEXT_STATES[(magnitude & 1) as usize] >> (4 * self.0) & 7) as u8)
    }
}

/// First table of magnitudes of a subband in a set.
#[inline(always)]
pub(super) fn first_table(set: usize, zone: usize, state: State) -> usize {
    let even = set * SET_TABLES + zone * LEVELS;
    let odd = FIRST_ODD + (set * ODD_ROWS + zone / 2) * LEVELS;
    if state.odd() == 0 { even } else { odd }
}

/// A magnitude as planes of magnitudes hold it.
#[inline(always)]
pub(super) fn held(magnitude: u32) -> u8 {
    magnitude.min(LARGEST) as u8
}

/// Set of the tables of an axis.
#[inline]
pub(super) fn set_of(base: bool, first_axis: bool) -> usize {
    2 * usize::from(base) + usize::from(!first_axis)
}

/// Magnitudes of a block, padded.
pub(super) type Magnitudes = [u8; PADDED];

static NOTHING: Magnitudes = [0; PADDED];

/// A padded place of a plane of magnitudes.
#[inline(always)]
fn magnitude(plane: &Magnitudes, at: usize) -> u32 {
    // Places are below 78, so the mask changes none.
    u32::from(plane[at & (PADDED - 1)])
}

/// What the contexts of a block look at.
#[derive(Debug, Clone, Copy)]
pub(super) struct Neighbours<'a> {
    /// The block to the left, or the other one where there is only one.
    left: &'a Magnitudes,
    /// The block above, or the other one where there is only one.
    above: &'a Magnitudes,
    /// The axis before of the same block.
    cross: &'a Magnitudes,
    /// Weight of the block's own template in halves: more where there are no neighbouring blocks.
    gain: u32,
    /// Context of the block's number of coefficients.
    pub end: usize,
}

impl Neighbours<'_> {
    /// Class of the expected magnitude at that padded place, where `own` holds all coefficients that come later in the scan.
    #[inline(always)]
    pub(super) fn level(&self, own: &Magnitudes, at: usize) -> usize {
        let template = magnitude(own, at + 1)
            + magnitude(own, at + 2)
            + magnitude(own, at + PADDED_SIDE)
            + magnitude(own, at + 2 * PADDED_SIDE)
            + magnitude(own, at + PADDED_SIDE + 1);
        self.class(template, self.beside(at))
    }

    /// Sum of the magnitudes at that padded place of the blocks around and of the axis before.
    #[inline(always)]
    pub(super) fn beside(&self, at: usize) -> u32 {
        magnitude(self.left, at) + magnitude(self.above, at) + magnitude(self.cross, at)
    }

    /// Class of the expected magnitude by the sum of the block's own and of those beside.
    #[inline(always)]
    pub(super) fn class(&self, template: u32, beside: u32) -> usize {
        usize::from(LEVEL[(((template * self.gain) >> 1) + beside).min(255) as usize])
    }
}

/// Magnitudes, numbers of coefficients and intra modes of the blocks of a superblock, as far as it is decoded.
#[derive(Debug, Default)]
pub(super) struct Around {
    columns: usize,
    axes: usize,
    magnitudes: Vec<Magnitudes>,
    ends: Vec<u8>,
    /// Intra modes of its blocks.
    pub modes: Modes,
}

impl Around {
    /// Forgets all, for a superblock of so many blocks.
    pub(super) fn reset(&mut self, columns: usize, rows: usize, axes: usize) {
        (self.columns, self.axes) = (columns, axes);
        self.modes.reset(columns);
        self.magnitudes.clear();
        self.magnitudes.resize(columns * rows * axes, [0; PADDED]);
        self.ends.clear();
        self.ends.resize(columns * rows * axes, 0);
    }

    /// What stands around a block's axis; `cross` says that the axis before belongs to the same group and is not its first.
    #[inline(always)]
    pub(super) fn of(&self, block: usize, axis: usize, cross: bool) -> Neighbours<'_> {
        let at = block * self.axes + axis;
        let left = (!block.is_multiple_of(self.columns)).then(|| at - self.axes);
        let above = (block >= self.columns).then(|| at - self.columns * self.axes);
        let plane = |at: Option<usize>| at.map_or(&NOTHING, |at| &self.magnitudes[at]);
        let end = |at: usize| usize::from(self.ends[at]);
        let cross = plane(cross.then(|| at.wrapping_sub(1)));
        match (left, above) {
            (None, None) => {
                Neighbours { left: &NOTHING, above: &NOTHING, cross, gain: 5, end: END_CONTEXTS - 1 }
            }
            (Some(one), None) | (None, Some(one)) => {
                let only = plane(Some(one));
                Neighbours { left: only, above: only, cross, gain: 4, end: end_class(2 * end(one)) }
            }
            (Some(one), Some(other)) => Neighbours {
                left: plane(left),
                above: plane(above),
                cross,
                gain: 4,
                end: end_class(end(one) + end(other)),
            },
        }
    }

    /// Keeps what was decoded of a block's axis.
    #[inline(always)]
    pub(super) fn keep(&mut self, block: usize, axis: usize, magnitudes: &Magnitudes, end_symbol: usize) {
        let at = block * self.axes + axis;
        self.magnitudes[at] = *magnitudes;
        self.ends[at] = end_symbol as u8;
    }
}

/// Context by the sum of both neighbours' symbols of the number of coefficients.
fn end_class(sum: usize) -> usize {
    match sum {
        0 => 0,
        1..=2 => 1,
        3..=6 => 2,
        7..=10 => 3,
        11..=14 => 4,
        15..=18 => 5,
        19..=22 => 6,
        _ => 7,
    }
}

/// First number of coefficients of each of its 16 symbols.
pub(super) const END_START: [u8; 16] = [0, 1, 2, 3, 4, 5, 7, 9, 11, 15, 19, 23, 31, 39, 47, 55];
/// Plain bits behind each symbol.
pub(super) const END_BITS: [u8; 16] = [0, 0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 3, 4];
/// First magnitude of each symbol of magnitudes; the last one is an escape.
pub(super) const MAGNITUDE_START: [u32; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 14, 22, 38, 70, 134, 262];
/// Plain bits behind each symbol but the last.
pub(super) const MAGNITUDE_BITS: [u8; 16] = [0, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 0];
/// The symbol whose value follows as 5 bits of length and that many bits.
pub(super) const ESCAPE: usize = 15;
/// Most bits of an escaped value: what 16-bit samples need at the finest step.
pub(super) const ESCAPE_BITS: u32 = 24;
/// Most signs that are read at once.
pub(super) const SIGNS: usize = 16;
