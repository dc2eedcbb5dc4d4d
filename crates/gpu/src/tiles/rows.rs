//! Rows of the tables that `shaders/wgsl/tiles` reads.

use texfold_core::{GpuChannel, GpuDct, ImageSize};

/// Texels along a tile's side, border included.
pub(super) const SIDE: u32 = 128;
/// Texels of the border.
pub(super) const BORDER: u32 = 4;
/// Texels along a tile's side without its border.
pub(super) const INNER: u32 = SIDE - 2 * BORDER;
/// Texels along a side of the largest level of a tail.
const TAIL_SIDE: u32 = 32;
/// Most mip levels in tiles of their own.
pub(super) const MOST_LEVELS: usize = 12;
/// Most tiles of an update.
pub(super) const MOST_TILES: u32 = 64;
/// Most planes of a stage.
pub(super) const PLANES: u32 = 6;
/// Bytes of the feedback before the pages' marks: eight words, and the tiles that are wanted.
pub(super) const FEEDBACK_BYTES: u64 = 32 + 8 * 4096;
/// Bytes of the plan of an update: two counts, sums, requests, passes.
pub(super) const PLAN_BYTES: u64 = 4 * (2 + 2 * 65 * PLANES as u64)
    + (24 + size_of::<texfold_shaders::DctPass>() as u64 * PLANES as u64) * MOST_TILES as u64;

/// Places of a tail's levels in its quarter of a tile.
pub(super) const TAIL_PLACES: [[u32; 2]; 6] = [[0, 0], [40, 0], [40, 24], [40, 40], [40, 52], [0, 40]];

/// Names and values of what a counterpart in another language shares with this cache.
pub(super) const NUMBERS: [(&str, u64); 12] = [
    ("SIDE", SIDE as u64),
    ("BORDER", BORDER as u64),
    ("TAIL_SIDE", TAIL_SIDE as u64),
    ("MOST_LEVELS", MOST_LEVELS as u64),
    ("MOST_TILES", MOST_TILES as u64),
    ("PLANES", PLANES as u64),
    ("FEEDBACK_BYTES", FEEDBACK_BYTES),
    ("PLAN_BYTES", PLAN_BYTES),
    ("TEXTURE_ROW_BYTES", size_of::<TextureRow>() as u64),
    ("STAGE_ROW_BYTES", size_of::<StageRow>() as u64),
    ("SRGB", SRGB as u64),
    ("CLAMP", CLAMP as u64),
];

/// Flags of a texture.
pub(super) const SRGB: u32 = 1;
pub(super) const CLAMP: u32 = 2;
pub(super) const COARSE: u32 = 4;

/// A texture; all zeros for none.
#[derive(Debug, Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct TextureRow {
    pub(super) size: [u32; 2],
    /// Mip levels, first level of the tail, flags: 8, 8 and 16 bits from the lowest on.
    pub(super) shape: u32,
    /// Place of the tail in quarters of tiles: column, row, layer, likewise.
    pub(super) tail: u32,
    pub(super) stages: u32,
    pub(super) source: u32,
    pub(super) parts: PartsRow,
    /// First page and columns of tiles of each level.
    pub(super) levels: [[u32; 2]; MOST_LEVELS],
}

/// The images that a texture's tiles are decoded from; all zeros for one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct PartsRow {
    /// Of each in 4 bits, from the lowest on: 4 times its layer, and its first channel.
    pub(super) channels: u32,
    /// How many; behind 4 bits one for each layer that any fills, behind 8 bits one for each that has a single channel.
    pub(super) shape: u32,
}

/// A stage in superblocks.
#[derive(Debug, Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct StageRow {
    means: [i32; 4],
    first_axes: [u32; 4],
    weights: [[i32; 4]; 4],
    size: [u32; 2],
    tables: u32,
    steps: u32,
    index: u32,
    index_bits: u32,
    streams: u32,
    stream_bytes: u32,
    superblock_log2: u32,
    axes: u32,
    ranks: u32,
    offsets: u32,
    deblocking: i32,
    shift: u32,
    largest: i32,
    average: u32,
}

impl StageRow {
    /// A stage whose words without those that all textures share begin at word `words` of the data, and its streams at byte `streams`.
    pub(super) fn new(
        stage: &GpuDct<'_>,
        channels: [GpuChannel; 4],
        (words, streams): (u32, u32),
    ) -> StageRow {
        let layout = &stage.layout;
        let moved = |word: u32| word - texfold_shaders::DCT_TABLES + words;
        StageRow {
            means: channels.map(|channel| channel.mean),
            first_axes: channels.map(|channel| channel.first_axis),
            weights: channels.map(|channel| channel.weights),
            size: [layout.size.width, layout.size.height],
            tables: words,
            steps: moved(layout.steps),
            index: moved(layout.index),
            index_bits: layout.index_bits,
            streams,
            stream_bytes: layout.stream_bytes,
            superblock_log2: u32::from(layout.superblock_log2) | u32::from(layout.base_log2) << 8,
            axes: layout.ranks.len().min(16) as u32,
            ranks: layout.packed_ranks(),
            offsets: layout.packed_offsets(),
            deblocking: layout.deblocking,
            shift: layout.shift,
            largest: (1 << layout.depth) - 1,
            average: layout.average.bits(),
        }
    }

    /// Most words of scratch memory that a tile of such a stage takes, of texels that are means of 2^`reduce_log2` samples a side.
    pub(super) fn most_words(stage: &GpuDct<'_>, reduce_log2: u32) -> u64 {
        let words = u64::from(texfold_shaders::BLOCK_WORDS + texfold_shaders::BLOCK_NOTES);
        let mut count = [SIDE << reduce_log2; 2];
        let mut sum = 0;
        for (number, plane) in texfold_core::dct_planes(stage.layout.size).into_iter().enumerate() {
            let log2 = u32::from(stage.layout.plane_log2(number));
            let blocks = |texels: u32, all: u32| {
                let superblocks = (texels.div_ceil(1 << log2) + 1).min(all.div_ceil(1 << log2));
                superblocks << (log2 - 3)
            };
            count = [blocks(count[0], plane.width), blocks(count[1], plane.height)];
            sum += u64::from(count[0]) * u64::from(count[1]) * stage.layout.ranks.len() as u64 * words;
            // The means of these blocks and of those around them.
            count = count.map(|blocks| blocks + 2);
        }
        sum
    }
}

/// The first level of an image of that size that lies in its tail.
pub(super) fn tail_of(size: ImageSize) -> u32 {
    let is_small = |level: &u32| {
        let ImageSize { width, height } = size.at_level(*level);
        width.max(height) <= TAIL_SIDE
    };
    (0..32).find(is_small).unwrap_or_default()
}

/// Column and row of a level of a tail in its quarter of a tile, behind its border.
pub(super) fn tail_place(number: u32) -> [u32; 2] {
    TAIL_PLACES[(number as usize).min(5)].map(|place| place + BORDER)
}
