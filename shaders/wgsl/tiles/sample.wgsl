// Drawing from a cache of tiles: any number of textures of any size in one bind group, filtered by the hardware.
//
// Lookups mark tiles, and the update after the frame decodes those that are missing; until then the nearest coarser level shows. Functions without `level` or `grad` take derivatives: they are called from uniform control flow.

@group(TEXFOLD_GROUP) @binding(0) var<storage, read> texfold_tile_textures: array<TexfoldTileTexture>;
// For each tile its place in the pool, or 0.
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

// A lookup of one texture or material.
struct TexfoldTileLookup {
    texture: u32,
    // Columns and rows of level 0.
    size: vec2<u32>,
    // The first level of the tail, and the levels that have tiles of their own.
    tail: u32,
    own: u32,
    flags: u32,
    // Texture coordinates, in [0, 1].
    at: vec2<f32>,
    // Their changes across a pixel.
    across: vec2<f32>,
    down: vec2<f32>,
    // Whether they are not 0: the sampler may filter along them.
    is_stretched: bool,
    // Whether this lookup marks the tiles that it reads.
    is_marked: bool,
    // The level, and the share of the next coarser one.
    level: u32,
    share: f32,
}

// Where a level's texels lie in the pool, or those of the finest coarser level that is there.
struct TexfoldTileFound {
    at: vec2<f32>,
    // The first of its layers.
    layer: u32,
    // Changes across a pixel.
    across: vec2<f32>,
    down: vec2<f32>,
}

// All maps of a material. Those that it lacks are 1, so that a renderer's own factors apply, and (0, 0, 1) for normals.
struct TexfoldTileMaterial {
    // Base colour, in linear light where the cache has it so, and opacity.
    color: vec4<f32>,
    // In tangent space, from -1 to 1; shorter than 1 between normals that differ.
    normal: vec3<f32>,
    height: f32,
    // As the base colour.
    emissive: vec3<f32>,
    occlusion: f32,
    roughness: f32,
    metalness: f32,
}

// Marks a tile as looked at, and asks for it where it is missing and can be decoded.
fn texfold_tile_mark(lookup: TexfoldTileLookup, level: u32, tile: vec2<u32>, page: u32, place: u32) {
    let frame = texfold_tile_feedback.frame;
    let is_asked = place == 0u && (lookup.flags & TEXFOLD_TILE_COARSE) == 0u;
    if atomicExchange(&texfold_tile_feedback.marks[page], frame) == frame || !is_asked {
        return;
    }
    let number = atomicAdd(&texfold_tile_feedback.wanted, 1u);
    if number < TEXFOLD_TILE_MOST_WANTED {
        texfold_tile_feedback.tiles[number] = vec2<u32>(lookup.texture | (level << 24u), tile.x | (tile.y << 16u));
    }
}

// Finds a level, or the finest coarser one that is there.
fn texfold_tile_find(lookup: TexfoldTileLookup, level: u32) -> TexfoldTileFound {
    // The loop looks for a place alone: software renderers run what stands in a loop once more than it takes. Integers are not divided, which
    // these do lane by lane.
    var place = 0u;
    var inner = vec2<f32>(0.0);
    var size = vec2<f32>(0.0);
    var found = level;
    for (var step = 0u; step < TEXFOLD_TILE_LEVELS; step += 1u) {
        let is_own = found < lookup.own;
        size = vec2<f32>(texfold_tile_level_size(lookup.size, found));
        let at = lookup.at * size;
        // A tile's border serves where rounding takes the one before or behind.
        let tile = vec2<u32>(min(at, size - vec2<f32>(0.01)) / f32(TEXFOLD_TILE_INNER));
        let pages = texfold_tile_textures[lookup.texture].levels[found];
        let page = pages.x + tile.y * pages.y + tile.x;
        place = select(0u, texfold_tile_pages[page], is_own);
        inner = at - vec2<f32>(tile * TEXFOLD_TILE_INNER) + f32(TEXFOLD_TILE_BORDER);
        if lookup.is_marked && is_own && (found == level || place != 0u) {
            texfold_tile_mark(lookup, found, tile, page, place);
        }
        if place != 0u || !is_own {
            break;
        }
        found += 1u;
    }
    var corner = vec2<u32>(place & 255u, (place >> 8u) & 255u) * TEXFOLD_TILE_SIDE;
    if place == 0u {
        place = texfold_tile_textures[lookup.texture].tail;
        found = max(found, lookup.tail);
        size = vec2<f32>(texfold_tile_level_size(lookup.size, found));
        inner = lookup.at * size + f32(TEXFOLD_TILE_BORDER);
        corner = vec2<u32>(place & 255u, (place >> 8u) & 255u) * (TEXFOLD_TILE_SIDE / 2u)
            + texfold_tile_tail_place(found - lookup.tail);
    }
    let scale = 1.0 / f32(textureDimensions(texfold_tile_pool).x);
    return TexfoldTileFound(
        (vec2<f32>(corner) + inner) * scale,
        (place >> 16u) & 0x7fffu,
        lookup.across * size * scale,
        lookup.down * size * scale,
    );
}

// Values of a layer of what was found.
fn texfold_tile_values(found: TexfoldTileFound, layer: u32, is_stretched: bool) -> vec4<f32> {
    let slice = found.layer + layer;
    if TEXFOLD_TILE_ANISOTROPY > 1.0 && is_stretched {
        return textureSampleGrad(texfold_tile_pool, texfold_tile_sampler, found.at, slice, found.across, found.down);
    }
    return textureSampleLevel(texfold_tile_pool, texfold_tile_sampler, found.at, slice, 0.0);
}

// Colours of a layer of what was found: values, or those of sRGB in linear light.
fn texfold_tile_colours(lookup: TexfoldTileLookup, found: TexfoldTileFound, layer: u32) -> vec4<f32> {
    let is_srgb = TEXFOLD_TILE_COLOURS == 1u
        || (TEXFOLD_TILE_COLOURS == 2u && (lookup.flags & TEXFOLD_TILE_SRGB) != 0u);
    if !is_srgb {
        return texfold_tile_values(found, layer, lookup.is_stretched);
    }
    let slice = found.layer + layer;
    if TEXFOLD_TILE_ANISOTROPY > 1.0 && lookup.is_stretched {
        return textureSampleGrad(texfold_tile_pool_srgb, texfold_tile_sampler, found.at, slice, found.across, found.down);
    }
    return textureSampleLevel(texfold_tile_pool_srgb, texfold_tile_sampler, found.at, slice, 0.0);
}

// Whether a pixel marks what it reads: about one of each square does, another one in each frame. Pixels are told apart by the texels
// under them, of the level that has about one a pixel.
fn texfold_tile_marks(size: vec2<f32>, at: vec2<f32>, lod: f32) -> bool {
    let pixel = vec2<u32>(at * size * exp2(-floor(max(lod, -8.0)))) % TEXFOLD_TILE_STRIDE;
    // An odd multiple of the frame's number reaches all places in turn, far ones after one another.
    let turn = texfold_tile_feedback.frame * 27u % (TEXFOLD_TILE_STRIDE * TEXFOLD_TILE_STRIDE);
    return pixel.x == turn % TEXFOLD_TILE_STRIDE && pixel.y == turn / TEXFOLD_TILE_STRIDE;
}

// A lookup at texture coordinates on a level with a fraction, of a footprint with these changes across a pixel, of a texture of `levels`.
fn texfold_tile_lookup(
    texture: u32,
    uv: vec2<f32>,
    lod: f32,
    across: vec2<f32>,
    down: vec2<f32>,
    levels: u32,
) -> TexfoldTileLookup {
    let shape = texfold_tile_textures[texture].shape;
    var lookup: TexfoldTileLookup;
    lookup.texture = texture;
    lookup.size = texfold_tile_textures[texture].size;
    lookup.tail = texfold_tile_tail(shape);
    lookup.own = min(levels, lookup.tail);
    lookup.flags = texfold_tile_flags(shape);
    let is_clamped = (lookup.flags & TEXFOLD_TILE_CLAMP) != 0u;
    lookup.at = select(fract(uv), clamp(uv, vec2<f32>(0.0), vec2<f32>(1.0)), is_clamped);
    lookup.across = across;
    lookup.down = down;
    lookup.is_stretched = any(across != vec2<f32>(0.0)) || any(down != vec2<f32>(0.0));
    lookup.is_marked = texfold_tile_marks(vec2<f32>(lookup.size), lookup.at, lod);
    let fine = clamp(lod + texfold_tile_feedback.bias, 0.0, f32(levels - 1u));
    lookup.level = u32(fine);
    lookup.share = fract(fine);
    return lookup;
}

// The level, with a fraction, of texture coordinates that change by so much across a pixel.
fn texfold_tile_lod(texture: u32, across: vec2<f32>, down: vec2<f32>) -> f32 {
    let size = vec2<f32>(texfold_tile_textures[texture].size);
    let one = length(across * size);
    let other = length(down * size);
    let extent = max(min(one, other), max(one, other) / TEXFOLD_TILE_ANISOTROPY);
    return log2(max(extent, 1e-6));
}

// The colour of a lookup.
fn texfold_tile_filtered(texture: u32, uv: vec2<f32>, lod: f32, across: vec2<f32>, down: vec2<f32>) -> vec4<f32> {
    let levels = texfold_tile_levels(texfold_tile_textures[texture].shape);
    if levels == 0u {
        return vec4<f32>(0.0);
    }
    let lookup = texfold_tile_lookup(texture, uv, lod, across, down, levels);
    let colour = texfold_tile_colours(lookup, texfold_tile_find(lookup, lookup.level), TEXFOLD_TILE_COLOUR);
    if lookup.share == 0.0 {
        return colour;
    }
    let coarse = texfold_tile_find(lookup, lookup.level + 1u);
    return mix(colour, texfold_tile_colours(lookup, coarse, TEXFOLD_TILE_COLOUR), lookup.share);
}

// The maps of a lookup of a material: one search for the tiles of all.
fn texfold_tile_maps(texture: u32, uv: vec2<f32>, lod: f32, across: vec2<f32>, down: vec2<f32>) -> TexfoldTileMaterial {
    var colour = vec4<f32>(1.0);
    var normal = vec4<f32>(0.5, 0.5, 1.0, 1.0);
    var packed = vec4<f32>(1.0);
    var emissive = vec4<f32>(1.0);
    let levels = texfold_tile_levels(texfold_tile_textures[texture].shape);
    if levels > 0u {
        let lookup = texfold_tile_lookup(texture, uv, lod, across, down, levels);
        let parts = texfold_tile_textures[texture].parts;
        let fine = texfold_tile_find(lookup, lookup.level);
        var coarse = fine;
        if lookup.share > 0.0 {
            coarse = texfold_tile_find(lookup, lookup.level + 1u);
        }
        if texfold_tile_has(parts, TEXFOLD_TILE_COLOUR) {
            let other = texfold_tile_colours(lookup, coarse, TEXFOLD_TILE_COLOUR);
            colour = mix(texfold_tile_colours(lookup, fine, TEXFOLD_TILE_COLOUR), other, lookup.share);
        }
        if texfold_tile_has(parts, TEXFOLD_TILE_NORMAL) {
            let other = texfold_tile_values(coarse, TEXFOLD_TILE_NORMAL, lookup.is_stretched);
            normal = mix(texfold_tile_values(fine, TEXFOLD_TILE_NORMAL, lookup.is_stretched), other, lookup.share);
        }
        if texfold_tile_has(parts, TEXFOLD_TILE_PACKED) {
            let other = texfold_tile_values(coarse, TEXFOLD_TILE_PACKED, lookup.is_stretched);
            packed = mix(texfold_tile_values(fine, TEXFOLD_TILE_PACKED, lookup.is_stretched), other, lookup.share);
        }
        if texfold_tile_has(parts, TEXFOLD_TILE_EMISSIVE) {
            let other = texfold_tile_colours(lookup, coarse, TEXFOLD_TILE_EMISSIVE);
            emissive = mix(texfold_tile_colours(lookup, fine, TEXFOLD_TILE_EMISSIVE), other, lookup.share);
        }
    }
    return TexfoldTileMaterial(
        colour,
        normal.xyz * 2.0 - 1.0,
        min(normal.w, packed.w),
        emissive.xyz,
        packed.x,
        packed.y,
        packed.z,
    );
}

// The colour at texture coordinates on a level with a fraction, without anisotropy.
fn texfold_tile_sample_level(texture: u32, uv: vec2<f32>, lod: f32) -> vec4<f32> {
    return texfold_tile_filtered(texture, uv, lod, vec2<f32>(0.0), vec2<f32>(0.0));
}

// The colour at texture coordinates that change by so much across a pixel.
fn texfold_tile_sample_grad(texture: u32, uv: vec2<f32>, across: vec2<f32>, down: vec2<f32>) -> vec4<f32> {
    return texfold_tile_filtered(texture, uv, texfold_tile_lod(texture, across, down), across, down);
}

// The colour at texture coordinates.
fn texfold_tile_sample(texture: u32, uv: vec2<f32>) -> vec4<f32> {
    return texfold_tile_sample_grad(texture, uv, dpdx(uv), dpdy(uv));
}

// All maps of a material at texture coordinates on a level with a fraction, without anisotropy.
fn texfold_tile_sample_material_level(material: u32, uv: vec2<f32>, lod: f32) -> TexfoldTileMaterial {
    return texfold_tile_maps(material, uv, lod, vec2<f32>(0.0), vec2<f32>(0.0));
}

// All maps of a material at texture coordinates that change by so much across a pixel.
fn texfold_tile_sample_material_grad(
    material: u32,
    uv: vec2<f32>,
    across: vec2<f32>,
    down: vec2<f32>,
) -> TexfoldTileMaterial {
    return texfold_tile_maps(material, uv, texfold_tile_lod(material, across, down), across, down);
}

// All maps of a material at texture coordinates.
fn texfold_tile_sample_material(material: u32, uv: vec2<f32>) -> TexfoldTileMaterial {
    return texfold_tile_sample_material_grad(material, uv, dpdx(uv), dpdy(uv));
}
