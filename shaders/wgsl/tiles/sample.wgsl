// Drawing from a cache of tiles: any number of textures of any size in one bind group, filtered by the hardware.
//
// What is looked at is marked, and what is missing is decoded by the update after the frame; until then the nearest coarser
// level shows. Functions without `level` or `grad` take derivatives: they are called from uniform control flow.

@group(TEXFOLD_GROUP) @binding(0) var<storage, read> texfold_tile_textures: array<TexfoldTileTexture>;
// For each tile its place in the pool, counted from 1; 0 where it is not there.
@group(TEXFOLD_GROUP) @binding(1) var<storage, read> texfold_tile_pages: array<u32>;
@group(TEXFOLD_GROUP) @binding(2) var<storage, read_write> texfold_tile_feedback: TexfoldTileFeedback;
@group(TEXFOLD_GROUP) @binding(3) var texfold_tile_pool: texture_2d_array<f32>;
// The same texels, from sRGB to linear light.
@group(TEXFOLD_GROUP) @binding(4) var texfold_tile_pool_srgb: texture_2d_array<f32>;
@group(TEXFOLD_GROUP) @binding(5) var texfold_tile_sampler: sampler;

// Most texels across a pixel's footprint along its longer axis, for one across the shorter axis: that of the sampler.
const TEXFOLD_TILE_ANISOTROPY: f32 = TEXFOLD_ANISOTROPY;
// Of so many pixels along each side of a square one marks the tiles that it reads.
const TEXFOLD_TILE_STRIDE: u32 = TEXFOLD_STRIDE;
// Colours of the textures that a pipeline draws: 0 for values, 1 for sRGB, 2 for both.
override TEXFOLD_TILE_COLOURS: u32 = 2u;

// A lookup of one texture.
struct TexfoldTileLookup {
    texture: u32,
    // Texture coordinates, in [0, 1].
    at: vec2<f32>,
    // Their changes across a pixel.
    across: vec2<f32>,
    down: vec2<f32>,
    // Whether this lookup marks the tiles that it reads.
    is_marked: bool,
}

// Marks a tile as looked at, and asks for it where it is missing.
fn texfold_tile_mark(texture: u32, level: u32, tile: vec2<u32>, page: u32, slot: u32) {
    let frame = texfold_tile_feedback.frame;
    if atomicExchange(&texfold_tile_feedback.marks[page], frame) == frame || slot != 0u {
        return;
    }
    let number = atomicAdd(&texfold_tile_feedback.wanted, 1u);
    if number < TEXFOLD_TILE_MOST_WANTED {
        texfold_tile_feedback.tiles[number] = vec2<u32>(texture | (level << 24u), tile.x | (tile.y << 16u));
    }
}

// The pool's texel at `at` of the tile in place `slot`, filtered by the sampler.
fn texfold_tile_pooled(lookup: TexfoldTileLookup, size: vec2<f32>, slot: u32, at: vec2<f32>) -> vec4<f32> {
    let side = textureDimensions(texfold_tile_pool).x;
    let row = side / TEXFOLD_TILE_SIDE;
    let place = vec2<u32>(slot % row, slot / row % row) * TEXFOLD_TILE_SIDE;
    let uv = (vec2<f32>(place) + at) / f32(side);
    let layer = slot / (row * row);
    let across = lookup.across * size / f32(side);
    let down = lookup.down * size / f32(side);
    let is_srgb = (texfold_tile_textures[lookup.texture].flags & TEXFOLD_TILE_SRGB) != 0u;
    if TEXFOLD_TILE_ANISOTROPY > 1.0 {
        if TEXFOLD_TILE_COLOURS == 1u || TEXFOLD_TILE_COLOURS == 2u && is_srgb {
            return textureSampleGrad(texfold_tile_pool_srgb, texfold_tile_sampler, uv, layer, across, down);
        }
        return textureSampleGrad(texfold_tile_pool, texfold_tile_sampler, uv, layer, across, down);
    }
    if TEXFOLD_TILE_COLOURS == 1u || TEXFOLD_TILE_COLOURS == 2u && is_srgb {
        return textureSampleLevel(texfold_tile_pool_srgb, texfold_tile_sampler, uv, layer, 0.0);
    }
    return textureSampleLevel(texfold_tile_pool, texfold_tile_sampler, uv, layer, 0.0);
}

// A level's colour, or that of the finest coarser one that is there.
fn texfold_tile_filtered(lookup: TexfoldTileLookup, level: u32) -> vec4<f32> {
    let tail = texfold_tile_textures[lookup.texture].tail;
    let own = min(texfold_tile_textures[lookup.texture].levels, tail);
    let whole = texfold_tile_textures[lookup.texture].size;
    var found = level;
    for (var step = 0u; step < TEXFOLD_TILE_LEVELS; step += 1u) {
        if found >= own {
            found = max(found, tail);
            break;
        }
        let size = texfold_tile_level_size(whole, found);
        let count = texfold_tile_count(size);
        let at = lookup.at * vec2<f32>(size);
        let tile = min(vec2<u32>(at) / TEXFOLD_TILE_INNER, count - vec2<u32>(1u));
        let page = texfold_tile_textures[lookup.texture].pages[found] + tile.y * count.x + tile.x;
        let slot = texfold_tile_pages[page];
        if lookup.is_marked && (found == level || slot != 0u) {
            texfold_tile_mark(lookup.texture, found, tile, page, slot);
        }
        if slot != 0u {
            let inner = at - vec2<f32>(tile * TEXFOLD_TILE_INNER) + f32(TEXFOLD_TILE_BORDER);
            return texfold_tile_pooled(lookup, vec2<f32>(size), slot - 1u, inner);
        }
        found += 1u;
    }
    let quarter = texfold_tile_textures[lookup.texture].quarter;
    let size = texfold_tile_level_size(whole, found);
    let place = texfold_tile_tail_place(found - tail)
        + vec2<u32>(quarter % 2u, quarter / 2u % 2u) * (TEXFOLD_TILE_SIDE / 2u)
        + vec2<u32>(TEXFOLD_TILE_BORDER);
    return texfold_tile_pooled(lookup, vec2<f32>(size), quarter / 4u, vec2<f32>(place) + lookup.at * vec2<f32>(size));
}

// Whether a pixel marks what it reads: about one of each square does, another one in each frame. Pixels are told apart by the texels
// under them, of the level that has about one a pixel.
fn texfold_tile_marks(size: vec2<f32>, at: vec2<f32>, lod: f32) -> bool {
    let pixel = vec2<u32>(at * size * exp2(-floor(max(lod, -8.0)))) % TEXFOLD_TILE_STRIDE;
    // An odd multiple of the frame's number reaches all places in turn, far ones after one another.
    let turn = texfold_tile_feedback.frame * 27u % (TEXFOLD_TILE_STRIDE * TEXFOLD_TILE_STRIDE);
    return pixel.x == turn % TEXFOLD_TILE_STRIDE && pixel.y == turn / TEXFOLD_TILE_STRIDE;
}

// The colour at texture coordinates on a level with a fraction, of a footprint with these changes across a pixel.
fn texfold_tile_lookup(texture: u32, uv: vec2<f32>, lod: f32, across: vec2<f32>, down: vec2<f32>) -> vec4<f32> {
    let levels = texfold_tile_textures[texture].levels;
    if levels == 0u {
        return vec4<f32>(0.0);
    }
    let is_clamped = (texfold_tile_textures[texture].flags & TEXFOLD_TILE_CLAMP) != 0u;
    let at = select(fract(uv), clamp(uv, vec2<f32>(0.0), vec2<f32>(1.0)), is_clamped);
    let last = f32(levels - 1u);
    let biased = clamp(lod + texfold_tile_feedback.bias, 0.0, last);
    let is_marked = texfold_tile_marks(vec2<f32>(texfold_tile_textures[texture].size), at, lod);
    let lookup = TexfoldTileLookup(texture, at, across, down, is_marked);
    let level = u32(biased);
    let share = fract(biased);
    let fine = texfold_tile_filtered(lookup, level);
    if share == 0.0 {
        return fine;
    }
    return mix(fine, texfold_tile_filtered(lookup, level + 1u), share);
}

// The colour at texture coordinates on a level with a fraction, without anisotropy.
fn texfold_tile_sample_level(texture: u32, uv: vec2<f32>, lod: f32) -> vec4<f32> {
    return texfold_tile_lookup(texture, uv, lod, vec2<f32>(0.0), vec2<f32>(0.0));
}

// The colour at texture coordinates that change by so much across a pixel.
fn texfold_tile_sample_grad(texture: u32, uv: vec2<f32>, across: vec2<f32>, down: vec2<f32>) -> vec4<f32> {
    let size = vec2<f32>(texfold_tile_textures[texture].size);
    let one = length(across * size);
    let other = length(down * size);
    let extent = max(min(one, other), max(one, other) / TEXFOLD_TILE_ANISOTROPY);
    return texfold_tile_lookup(texture, uv, log2(max(extent, 1e-6)), across, down);
}

// The colour at texture coordinates.
fn texfold_tile_sample(texture: u32, uv: vec2<f32>) -> vec4<f32> {
    return texfold_tile_sample_grad(texture, uv, dpdx(uv), dpdy(uv));
}
