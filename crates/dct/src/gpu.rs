//! A texture as the compute shader reads it.

use texfold_core::{BASE_PART, DctLayout, GpuChannel, GpuDct, MipAverage, RESIDUAL_PART};

use crate::context::{END_BITS, END_START, LEVEL, MAGNITUDE_BITS, MAGNITUDE_START};
use crate::decode::DctTexture;
use crate::form::{AXIS_BITS, DctForm, Group, MAX_GROUP, RADII, SCALES};
use crate::intra::{MODE_STOPS, MODES};
use crate::scan::{COEFFICIENTS, SCAN};
use crate::tables::{PRESETS, STOP, STOP_VALUES, SYMBOLS, Table};

/// First words of what `block.wgsl` reads: the scan, classes of expected magnitudes, symbols, tables of probabilities.
pub(super) const SCAN_WORDS: usize = 0;
pub(super) const LEVEL_WORDS: usize = 64;
pub(super) const SYMBOL_WORDS: usize = 128;
pub(super) const TABLE_WORDS: usize = 144;

/// Which part of an image a texture is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stage {
    /// Number of the image.
    pub image: usize,
    /// Mip level.
    pub level: u32,
    /// Levels that are made of it, 1 to 3.
    pub levels: u32,
    /// How.
    pub average: MipAverage,
}

impl Default for Stage {
    /// An image without further levels.
    fn default() -> Self {
        Stage { image: 0, level: 0, levels: 1, average: MipAverage::default() }
    }
}

impl DctTexture {
    /// What a GPU needs to decode the texture, which is that part of an image. The streams are borrowed; tables, steps and index are copied as words, 22 kB (16 kB of independent quantisers)
    /// and 4 bytes each word of the index.
    #[must_use]
    pub fn gpu(&self, stage: Stage) -> GpuDct<'_> {
        let form = self.form();
        let shift = form.fraction() + AXIS_BITS;
        // A texture that is only uploaded keeps no tables.
        let tools = self.make_tools();
        let mut words = constants();
        // All at once: a vector that grows holds up to three times as much.
        words.reserve_exact(
            words_before_index(tools.steps.len(), form) + self.index.words().len() + 2 - words.len(),
        );
        words.extend(tools.tables.iter().flat_map(Table::starts));
        let steps = words.len() as u32;
        words.extend(tools.steps.iter().flat_map(|steps| steps.words()));
        let index = words.len() as u32;
        words.extend(self.index.words());
        // A length is read as part of two words.
        words.extend([0, 0]);
        let mut first_axis = 0;
        let channels = form.groups.iter().flat_map(|group| {
            let first = first_axis;
            first_axis += u32::from(group.channels);
            (0..usize::from(group.channels)).map(move |channel| gpu_channel(group, channel, first, shift))
        });
        let layout = DctLayout {
            size: form.size,
            depth: form.depth,
            superblock_log2: form.superblock_log2,
            base_log2: form.base_log2,
            ranks: form.ranks(),
            channels: channels.collect(),
            shift,
            offsets: form.quantiser.offsets,
            is_dependent: form.quantiser.is_dependent,
            has_modes: form.intra.is_some(),
            steps,
            index,
            index_bits: self.index.width(),
            stream_bytes: self.bytes.len() as u32,
            average: stage.average,
            deblocking: form.deblocking_limit(form.deblocking),
        };
        let held = self.bytes_before_streams();
        let base = self.base_length().min(self.bytes.len());
        let mut held_bytes = vec![(BASE_PART, (held + base) as u64)];
        if self.bytes.len() > base {
            held_bytes.push((RESIDUAL_PART, (self.bytes.len() - base) as u64));
        }
        let Stage { image, level, levels, .. } = stage;
        GpuDct { layout, words, streams: &self.bytes, image, level, levels, row: 0, held_bytes }
    }
}

/// Words of a texture of so many planes that stand before its index.
pub(super) fn words_before_index(planes: usize, form: &DctForm) -> usize {
    TABLE_WORDS + form.tables() * SYMBOLS / 2 + planes * COEFFICIENTS
}

/// Numbers that the format fixes (FORMAT.md, "Images in blocks of variable length"), for decoders in other languages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FormatConstants {
    /// Stopping probabilities in 1/65536.
    pub stops: [u16; STOP_VALUES],
    /// The presets of stopping probabilities, a letter each: '0' for 0, and those that follow it in ASCII. The second one is of
    /// dependent quantisers.
    pub presets: [&'static str; 2],
    /// Stopping probabilities of intra modes other than none, for [`FormatConstants::stops`].
    pub mode_stops: [u8; MODES - 2],
    /// Scale of each frequency in 1/4096.
    pub scales: [u32; 8],
    /// Distance of each coefficient from the mean, in 1/64 of a frequency, row by row.
    pub radii: [u32; COEFFICIENTS],
    /// The first words of [`GpuDct::words`]: scan, classes and symbols, the same for all textures.
    pub words: Vec<u32>,
}

impl FormatConstants {
    /// The numbers.
    #[must_use]
    pub fn new() -> Self {
        FormatConstants {
            stops: STOP,
            presets: PRESETS,
            mode_stops: MODE_STOPS,
            scales: SCALES,
            radii: RADII,
            words: constants(),
        }
    }
}

impl Default for FormatConstants {
    fn default() -> Self {
        FormatConstants::new()
    }
}

/// Scan, classes and symbols: what stands before the tables.
fn constants() -> Vec<u32> {
    let mut words = vec![0; TABLE_WORDS];
    let scan = &mut words[SCAN_WORDS..];
    for (number, place) in SCAN.iter().enumerate() {
        scan[number] |= u32::from(place.raster) | u32::from(place.zone) << 8;
        scan[usize::from(place.raster)] |= (number as u32) << 16;
    }
    let levels = words[LEVEL_WORDS..].iter_mut().zip(LEVEL.chunks_exact(4));
    levels.for_each(|(word, levels)| *word = packed(levels));
    let symbols = &mut words[SYMBOL_WORDS..][..SYMBOLS];
    for (symbol, word) in symbols.iter_mut().enumerate() {
        let ends = u32::from(END_START[symbol]) | u32::from(END_BITS[symbol]) << 8;
        *word = ends | MAGNITUDE_START[symbol] << 16 | u32::from(MAGNITUDE_BITS[symbol]) << 28;
    }
    words
}

/// Bytes as a word, the lowest first.
fn packed(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |word, &byte| word << 8 | u32::from(byte))
}

fn gpu_channel(group: &Group, channel: usize, first_axis: u32, shift: u32) -> GpuChannel {
    let mean = i32::from(group.means[channel]).wrapping_shl(shift).wrapping_add(1 << (shift - 1));
    let weight = |axis: usize| {
        if axis < usize::from(group.channels) { i32::from(group.axes[channel][axis]) } else { 0 }
    };
    GpuChannel { mean, first_axis, weights: std::array::from_fn::<i32, MAX_GROUP, _>(weight) }
}
