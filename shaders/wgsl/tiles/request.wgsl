// Tiles that an update of a cache decodes.

// Most tiles of an update.
const TEXFOLD_TILE_MOST: u32 = 64u;
// Most planes of a stage: those of 262144 texels a side.
const TEXFOLD_TILE_PLANES: u32 = 6u;
// Sums of a plane: one for each tile, and that of all.
const TEXFOLD_TILE_SUMS: u32 = 65u;
// First sum of blocks.
const TEXFOLD_TILE_BLOCKS: u32 = 390u;

// A stage of a texture in superblocks: texfold_gpu::tiles::StageRow.
struct TexfoldTileStage {
    means: vec4<i32>,
    first_axes: vec4<u32>,
    weights: array<vec4<i32>, 4>,
    size: vec2<u32>,
    tables: u32,
    steps: u32,
    index: u32,
    index_bits: u32,
    streams: u32,
    stream_bytes: u32,
    // Of the image; of the planes behind it behind 8 bits.
    superblock_log2: u32,
    axes: u32,
    ranks: u32,
    offsets: u32,
    deblocking: i32,
    shift: u32,
    largest: i32,
    average: u32,
}

// A tile to decode: one of the images that it is decoded from, which follow one another.
struct TexfoldTileRequest {
    texture: u32,
    // The level; behind 8 bits the number of the image.
    level: u32,
    tile: vec2<u32>,
    // Its place in the pool, as pages hold it.
    place: u32,
    // Number of its stage; with the highest bit, of the pass that draws it.
    stage: u32,
}

// All tiles of an update, each as many times as it has images.
struct TexfoldTilePlan {
    count: u32,
    // Words of scratch memory that they take.
    words: u32,
    // For each plane, the coarsest first, and each tile: superblocks of the tiles before it, of each rounded up to whole workgroups.
    // Behind these: blocks and axes of the tiles before it.
    sums: array<u32, 780>,
    requests: array<TexfoldTileRequest, 64>,
    // For each tile its planes, the finest last.
    passes: array<TexfoldBlockPass, 384>,
}

// Columns and rows of tiles of a level of that size.
fn texfold_tile_count(size: vec2<u32>) -> vec2<u32> {
    return (size + vec2<u32>(TEXFOLD_TILE_INNER - 1u)) / TEXFOLD_TILE_INNER;
}
