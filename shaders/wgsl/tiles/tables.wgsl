// Tables of a cache of tiles, as the passes that fill it and the shaders that draw from it read them.

// Texels along a tile's side, border included.
const TEXFOLD_TILE_SIDE: u32 = 128u;
// Texels of the border, which repeat those of the tiles around.
const TEXFOLD_TILE_BORDER: u32 = 4u;
// Texels along a tile's side without its border.
const TEXFOLD_TILE_INNER: u32 = 120u;
// Most mip levels in tiles of their own.
const TEXFOLD_TILE_LEVELS: u32 = 12u;
// Most tiles that wait for a place.
const TEXFOLD_TILE_MOST_WANTED: u32 = 4096u;
// The bit of a page whose tile is there, beside its column, its row behind 8 bits and its layer behind 16, in tiles.
const TEXFOLD_TILE_THERE: u32 = 0x80000000u;
// Flags of a texture.
const TEXFOLD_TILE_SRGB: u32 = 1u;
const TEXFOLD_TILE_CLAMP: u32 = 2u;
// Of one whose tail alone is held: tiles are marked and not decoded.
const TEXFOLD_TILE_COARSE: u32 = 4u;

// The layers of a material's tile, from that of its place on: base colour with opacity; normals with height; occlusion, roughness and
// metalness, with height where there are no normals; emitted light.
const TEXFOLD_TILE_COLOUR: u32 = 0u;
const TEXFOLD_TILE_NORMAL: u32 = 1u;
const TEXFOLD_TILE_PACKED: u32 = 2u;
const TEXFOLD_TILE_EMISSIVE: u32 = 3u;

// The images that a texture's tiles are decoded from, at most eight.
struct TexfoldTileParts {
    // Of each in 4 bits, from the lowest on: 4 times its layer, and its first channel.
    channels: u32,
    // How many, 0 standing for one; behind 4 bits one for each layer that any of them fills, behind 8 bits one for each that has a single
    // channel; behind 16 bits two for each: how often its sides are halves of the texture's.
    shape: u32,
}

// A texture: texfold_gpu::tiles::TextureRow.
struct TexfoldTileTexture {
    // Columns and rows of level 0.
    size: vec2<u32>,
    // Mip levels, 0 where there is no texture; behind 8 bits the first level whose texels lie in the tail, a quarter of a tile that is
    // always there; behind 16 bits flags.
    shape: u32,
    // Place of the tail in the pool, in quarters of tiles: column, row behind 8 bits, layer behind 16.
    tail: u32,
    // Number of the first of its decoded stages, each of three levels.
    stages: u32,
    // 0 for superblocks; from 1 on the number of the pass that draws its tiles.
    source: u32,
    // Images that its tiles are decoded from: of a material its maps, each into channels of a layer, else one.
    parts: TexfoldTileParts,
    // For each level the number of the page of its first tile, and columns of tiles; pages are row by row.
    levels: array<vec2<u32>, 12>,
}

// Feedback of a frame: written by shaders that draw and by the passes that fill the cache.
struct TexfoldTileFeedback {
    // Number of the frame.
    frame: u32,
    // Mip levels that are added, so that all tiles find a place.
    bias: f32,
    // Tiles that the last update decoded.
    decoded: u32,
    // Tiles that it left for later.
    missing: u32,
    // Entries of `tiles`; larger where there was no place for more.
    wanted: atomic<u32>,
    reserved: array<u32, 3>,
    // Tiles that are to be decoded: texture and level behind 24 bits, column and row behind 16.
    tiles: array<vec2<u32>, 4096>,
    // For each page the frame in which it was last looked at.
    marks: array<atomic<u32>>,
}

// Mip levels of a texture.
fn texfold_tile_levels(shape: u32) -> u32 {
    return shape & 255u;
}

// The first level of its tail.
fn texfold_tile_tail(shape: u32) -> u32 {
    return (shape >> 8u) & 255u;
}

// Images that its tiles are decoded from.
fn texfold_tile_parts(parts: TexfoldTileParts) -> u32 {
    return max(parts.shape & 15u, 1u);
}

// The layer of an image's texels, and their first channel.
fn texfold_tile_part(parts: TexfoldTileParts, part: u32) -> vec2<u32> {
    let place = (parts.channels >> (4u * part)) & 15u;
    return vec2<u32>(place >> 2u, place & 3u);
}

// The level that an image has at a level of the texture, 0 where that is finer than the image; and how often the image is then to be doubled.
fn texfold_tile_part_level(parts: TexfoldTileParts, part: u32, level: u32) -> vec2<u32> {
    let halvings = (parts.shape >> (16u + 2u * part)) & 3u;
    return max(vec2<u32>(level, halvings), vec2<u32>(halvings, level)) - vec2<u32>(halvings, level);
}

// Whether an image fills a layer.
fn texfold_tile_has(parts: TexfoldTileParts, layer: u32) -> bool {
    return ((parts.shape >> (4u + layer)) & 1u) == 1u;
}

// Its flags.
fn texfold_tile_flags(shape: u32) -> u32 {
    return shape >> 16u;
}

// Columns and rows of a level.
fn texfold_tile_level_size(size: vec2<u32>, level: u32) -> vec2<u32> {
    return max(size >> vec2<u32>(level), vec2<u32>(1u));
}

// Place of a level of the tail in its quarter, with its border; level 0 is the largest, of 32 texels a side at most.
fn texfold_tile_tail_place(number: u32) -> vec2<u32> {
    switch number {
        case 0u: { return vec2<u32>(0u, 0u); }
        case 1u: { return vec2<u32>(40u, 0u); }
        case 2u: { return vec2<u32>(40u, 24u); }
        case 3u: { return vec2<u32>(40u, 40u); }
        case 4u: { return vec2<u32>(40u, 52u); }
        default: { return vec2<u32>(0u, 40u); }
    }
}
