// A plane of a texture in blocks of variable length, as its decoder takes it.

// Words of a block.
const TEXFOLD_BLOCK_WORDS: u32 = 64u;
// Words that are noted of a block's axis.
const TEXFOLD_BLOCK_NOTES: u32 = 5u;

// Decoding of one plane: texfold_shaders::DctPass.
struct TexfoldBlockPass {
    plane_blocks: vec2<u32>,
    first: vec2<u32>,
    count: vec2<u32>,
    held: vec2<u32>,
    base_first: vec2<u32>,
    base_held: vec2<u32>,
    // Columns and rows of blocks of all superblocks: those behind the last are the first ones again.
    wrap: vec2<u32>,
    // Columns and rows of samples of all superblocks of the base, likewise.
    base_wrap: vec2<u32>,
    superblock_columns: u32,
    superblock_start: u32,
    side: u32,
    axes: u32,
    ranks: u32,
    is_base: u32,
    has_base: u32,
    samples: u32,
    notes: u32,
    base_samples: u32,
    steps: u32,
    // Both reconstruction offsets, 8 bits each; bit 16 where quantisers are dependent, bit 17 where blocks of the image have intra modes.
    offsets: u32,
    index: u32,
    index_bits: u32,
    stream_bytes: u32,
    // Largest jump across a border of blocks that is taken away from first axes; 0 where nothing is filtered.
    deblocking: i32,
    // First word of the tables of probabilities: for each of 16 symbols its frequency, and the sum of those before it behind 16 bits.
    tables: u32,
    // First byte of the streams.
    streams: u32,
}
