//! What a texture's header says: sizes, axes, quantiser.

use texfold_core::{ImageSize, dct_planes};

use crate::context::State;
use crate::scan::COEFFICIENTS;
use crate::tables::count;

/// Binary logarithm of the side of superblocks of the planes behind the image. Blocks of means have many coefficients, and a decoder
/// that reads all streams at once waits for the longest.
pub(super) const BASE_LOG2: u8 = 4;
/// Most channels of a texture.
pub const MAX_CHANNELS: usize = 16;
/// Most channels that share axes.
pub const MAX_GROUP: usize = 4;
/// Fractional bits of axes.
pub(super) const AXIS_BITS: u32 = 10;
/// Fractional bits of a quantiser's step beyond those of samples.
const STEP_BITS: u32 = 4;
/// Fractional bits of magnitudes before they are multiplied by a step: what reconstruction offsets are given in.
const OFFSET_BITS: u32 = 5;
/// Largest reconstruction offset: half a step.
pub(super) const MAX_OFFSET: u8 = 1 << (OFFSET_BITS - 1);
/// Steps in an octave, evenly spaced.
pub(crate) const OCTAVE_STEPS: u16 = 256;
/// Fractional bits of a step's size.
const SIZE_BITS: u32 = 10;
/// The same as a factor.
const STEP_UNITS: f64 = (1u32 << SIZE_BITS) as f64;
/// Number of the largest step: 2^18 units of the samples.
pub const MAX_STEP: u16 = 20 * OCTAVE_STEPS - 1;

/// Scale of each frequency in the transform, with 12 fractional bits: 1, then cos(k pi / 16) times the root of 2.
pub(super) const SCALES: [u32; 8] = [4096, 5681, 5352, 4816, 4096, 3218, 2217, 1130];
/// Fractional bits of [`SCALES`].
const SCALE_BITS: u32 = 12;
/// Distance of each coefficient from the mean, in 1/64 of a frequency.
pub(super) const RADII: [u32; COEFFICIENTS] = [
    0, 64, 128, 192, 256, 320, 384, 448, 64, 91, 143, 202, 264, 326, 389, 453, 128, 143, 181, 231, 286, 345,
    405, 466, 192, 202, 231, 272, 320, 373, 429, 487, 256, 264, 286, 320, 362, 410, 462, 516, 320, 326, 345,
    373, 410, 453, 500, 551, 384, 389, 405, 429, 462, 500, 543, 590, 448, 453, 466, 487, 516, 551, 590, 634,
];

/// Channels that share axes: colours, or any one to four.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Group {
    /// Number of channels, 1 to [`MAX_GROUP`].
    pub channels: u8,
    /// What is added to each channel, in units of the samples.
    pub means: [u16; MAX_GROUP],
    /// For each channel, what a unit of each axis adds to it, in 1/1024.
    pub axes: [[i16; MAX_GROUP]; MAX_GROUP],
}

impl Group {
    /// That many channels, each of them an axis, around zero.
    #[must_use]
    pub fn plain(channels: u8) -> Group {
        let mut axes = [[0; MAX_GROUP]; MAX_GROUP];
        (0..MAX_GROUP.min(channels.into())).for_each(|axis| axes[axis][axis] = 1 << AXIS_BITS);
        Group { channels, means: [0; MAX_GROUP], axes }
    }
}

/// How coefficients become numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Quantiser {
    /// Number of the step, at most [`MAX_STEP`]: (256 + `step` mod 256) times 2 to the power of `step` / 256, in 1/1024 of a
    /// unit of the samples, for orthonormal coefficients.
    pub step: u16,
    /// How much a detail coefficient's step grows by for each unit of its frequency, in 1/64.
    pub slope: u8,
    /// How far magnitudes of 1 and of more are rebuilt below them, in 1/32 of a step.
    pub offsets: [u8; 2],
    /// Whether a coefficient has one of two quantisers by the parities of the magnitudes read before it.
    pub is_dependent: bool,
}

impl Quantiser {
    /// The quantiser of that step for all frequencies, without offsets.
    #[cfg(feature = "encode")]
    pub(super) fn of_step(step: u16) -> Quantiser {
        Quantiser { step, slope: 0, offsets: [0; 2], is_dependent: false }
    }

    /// The step in 1/1024 of a unit of the samples.
    fn step_units(&self) -> u64 {
        u64::from(OCTAVE_STEPS + self.step % OCTAVE_STEPS) << (self.step / OCTAVE_STEPS)
    }

    /// The step in units of the samples.
    #[must_use]
    pub fn step_size(&self) -> f64 {
        self.step_units() as f64 / STEP_UNITS
    }

    /// Number of the step nearest to that size.
    #[must_use]
    pub fn nearest_step(size: f64) -> u16 {
        let units = (size * STEP_UNITS).max(f64::from(OCTAVE_STEPS));
        let octave = (units / f64::from(OCTAVE_STEPS)).log2().floor();
        let within = (units / octave.exp2()).round() - f64::from(OCTAVE_STEPS);
        ((octave * f64::from(OCTAVE_STEPS) + within) as u16).min(MAX_STEP)
    }
}

/// The steps of a plane's coefficients.
#[derive(Debug, Clone)]
pub(super) struct Steps {
    /// Step of each coefficient, row by row, with the samples' fractional bits and [`STEP_BITS`] more.
    steps: [u32; COEFFICIENTS],
    /// Reconstruction offsets of magnitudes of 0, 1 and more.
    offsets: [u32; 3],
    /// 1 where quantisers are dependent, else 0.
    dependent: u32,
}

impl Steps {
    /// Steps of the plane of that number, where samples have so many fractional bits.
    pub(super) fn new(quantiser: &Quantiser, plane: usize, fraction: u32) -> Steps {
        let slope = if plane == 0 { u64::from(quantiser.slope) } else { 0 };
        let size = quantiser.step_units();
        let steps = std::array::from_fn(|at| {
            // 10 fractional bits of the size, 12 of slope and radius, twice 12 of the scales, 3 for the transform's scale of 8.
            let weight = (1u64 << 12) + slope * u64::from(RADII[at]);
            let scales = (u64::from(SCALES[at % 8]) * u64::from(SCALES[at / 8])) >> SCALE_BITS;
            let scaled = ((size * weight) >> 12) * scales;
            let shift = SCALE_BITS + SIZE_BITS + 3 - (fraction + STEP_BITS) + 3 * plane as u32;
            ((scaled + (1 << (shift - 1))) >> shift).clamp(1, u64::from(u32::MAX >> 8)) as u32
        });
        let [one, more] = quantiser.offsets.map(u32::from);
        Steps { steps, offsets: [0, one, more], dependent: quantiser.is_dependent.into() }
    }

    /// The steps, as numbers.
    pub(super) fn words(&self) -> [u32; COEFFICIENTS] {
        self.steps
    }

    /// The state behind a coefficient of that magnitude.
    #[inline(always)]
    pub(super) fn after(&self, state: State, magnitude: u32) -> State {
        state.after(magnitude & self.dependent)
    }

    /// The absolute value that halves of steps stand for: twice a magnitude, or one less.
    #[inline(always)]
    pub(super) fn rebuilt(&self, at: usize, halves: u32) -> i32 {
        let magnitude = (halves + 1) >> 1;
        let finer = (halves << (OFFSET_BITS - 1)).wrapping_sub(self.offsets[magnitude.min(2) as usize]);
        (finer.wrapping_mul(self.steps[at & (COEFFICIENTS - 1)]) >> (OFFSET_BITS + STEP_BITS)) as i32
    }

    /// The step of a coefficient, in samples' units with their fractional bits.
    #[cfg(feature = "encode")]
    pub(super) fn size(&self, at: usize) -> f32 {
        self.steps[at] as f32 / (1u32 << STEP_BITS) as f32
    }
}

/// A texture's header.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DctForm {
    /// Size of the image.
    pub size: ImageSize,
    /// Bits of a sample, 8 or 16.
    pub depth: u8,
    /// Binary logarithm of a superblock's side, 4 to 6.
    pub superblock_log2: u8,
    /// The same of the planes behind the image: 4, or as the image's own in files written before.
    pub base_log2: u8,
    /// How coefficients became numbers.
    pub quantiser: Quantiser,
    /// Intra modes of the image's blocks: for 0, 1 and 2 predicted neighbours, the stopping probability of no prediction, below 64.
    /// `None` where no block has one.
    pub intra: Option<[u8; 3]>,
    /// Strength of deblocking, 0 (none) to [`crate::MAX_DEBLOCKING`].
    pub deblocking: u8,
    /// Groups of channels, in their order; at most [`MAX_CHANNELS`] channels together.
    pub groups: Vec<Group>,
}

impl DctForm {
    /// Number of channels.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.groups.iter().map(|group| usize::from(group.channels)).sum()
    }

    /// Tables of its symbols.
    pub(super) fn tables(&self) -> usize {
        count(self.quantiser.is_dependent) + self.intra.map_or(0, |none| none.len())
    }

    /// Fractional bits of samples inside the decoder.
    pub(super) fn fraction(&self) -> u32 {
        if self.depth > 8 { 2 } else { 6 }
    }

    /// Largest jump across a border of blocks that deblocking of that strength takes away from first axes: a sixteenth of the
    /// step for each unit of it, in samples' units with their fractional bits.
    pub(super) fn deblocking_limit(&self, strength: u8) -> i32 {
        // Less than 2^22.
        ((u64::from(strength) * (self.quantiser.step_units() << self.fraction())) >> (SIZE_BITS + 4)) as i32
    }

    /// For each axis, its place in its group.
    pub(super) fn ranks(&self) -> Vec<u8> {
        self.groups.iter().flat_map(|group| 0..group.channels).collect()
    }

    /// The planes, from the image itself to the coarsest base.
    pub(super) fn planes(&self) -> Vec<PlaneShape> {
        let log2 = |plane| if plane > 0 { self.base_log2 } else { self.superblock_log2 };
        let sizes = dct_planes(self.size).into_iter().enumerate();
        sizes.map(|(plane, size)| PlaneShape::new(size, log2(plane))).collect()
    }
}

/// Sizes of a plane: the image, or means of the blocks of a finer plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PlaneShape {
    /// Columns and rows of samples.
    pub size: ImageSize,
    /// Columns and rows of blocks.
    pub blocks: (usize, usize),
    /// Columns and rows of superblocks.
    pub superblocks: (usize, usize),
    /// Blocks along a superblock's side.
    pub side: usize,
}

impl PlaneShape {
    pub(super) fn new(size: ImageSize, superblock_log2: u8) -> PlaneShape {
        let side = 1usize << (superblock_log2 - 3);
        let blocks = ((size.width as usize).div_ceil(8), (size.height as usize).div_ceil(8));
        let superblocks = (blocks.0.div_ceil(side), blocks.1.div_ceil(side));
        PlaneShape { size, blocks, superblocks, side }
    }

    /// Superblocks of the plane.
    pub(super) fn count(&self) -> usize {
        self.superblocks.0 * self.superblocks.1
    }

    /// Columns and rows of blocks of a superblock.
    pub(super) fn blocks_in(&self, column: usize, row: usize) -> (usize, usize) {
        let within = |all: usize, at: usize| (all - at * self.side).min(self.side);
        (within(self.blocks.0, column), within(self.blocks.1, row))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_numbered_by_their_size() {
        for step in [0, 1, 63, 64, 200, 777, MAX_STEP] {
            let quantiser = Quantiser::of_step(step);
            assert_eq!(Quantiser::nearest_step(quantiser.step_size()), step);
        }
    }

    #[test]
    fn planes_end_with_a_single_block() {
        let form = |width, height| DctForm {
            size: ImageSize { width, height },
            depth: 8,
            superblock_log2: 5,
            base_log2: BASE_LOG2,
            quantiser: Quantiser::of_step(0),
            intra: None,
            deblocking: 0,
            groups: vec![Group::plain(3)],
        };
        let sizes = |width, height| -> Vec<(u32, u32)> {
            form(width, height).planes().iter().map(|plane| (plane.size.width, plane.size.height)).collect()
        };
        assert_eq!(sizes(1, 1), [(1, 1)]);
        assert_eq!(sizes(768, 512), [(768, 512), (96, 64), (12, 8), (2, 1)]);
        assert_eq!(sizes(9, 1), [(9, 1), (2, 1)]);
    }
}
