// Zoom-into-parts texture maps: a root and patches of higher resolution, in one pass. CPU twins: crates/zipmap/src/decode.rs.
//
// Tiles of the root name the patches that touch them, in the order in which they lie over each other. Colours are as stored: no gamma
// conversion (see texfold_linear). Every function works in any control flow but texfold_zipmap_sample, which takes
// derivatives.

// Most patches that a tile names.
const TEXFOLD_ZIPMAP_MOST: u32 = 2048u;
// Texels of the table that describe a patch.
const TEXFOLD_ZIPMAP_RECORD: u32 = 6u;
// Least third coordinate of a place that a patch shows: nearer to its horizon, or behind it, it shows nothing.
const TEXFOLD_ZIPMAP_HORIZON: f32 = 0.0001;

// The parameters of a texture.
struct TexfoldZipmapParams {
    // Columns and rows of level 0, as fine as the finest patch.
    size: vec2<u32>,
    // Mip levels, at least 1.
    levels: u32,
    // TEXFOLD_REPEAT or TEXFOLD_CLAMP.
    address_mode: u32,
    // Columns and rows of level 0 of the root.
    root_size: vec2<u32>,
    // Mip levels of the root.
    root_levels: u32,
    // How texels are read from the root's planes.
    root_swizzle: u32,
    // Columns and rows of tiles.
    tiles: vec2<u32>,
    // First texel of the table that describes patches.
    record_start: u32,
    // How texels are read from the patches' plane.
    patch_swizzle: u32,
    // Binary logarithm of the texels in a row of the table.
    row_log2: u32,
    reserved_a: u32,
    reserved_b: u32,
    reserved_c: u32,
}

// A patch as the table describes it.
struct TexfoldZipmapPatch {
    // From the root's texture coordinates to the patch's.
    matrix: mat3x3<f32>,
    // Columns and rows of level 0.
    size: vec2<u32>,
    // Mip levels.
    levels: u32,
    // Its first texel of the table.
    start: u32,
}

@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_0) var<uniform> texfold_zipmap_params: TexfoldZipmapParams;
// Tiles, their lists of patches, and the patches, row by row.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_1) var texfold_zipmap_table: texture_2d<u32>;
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_2) var texfold_zipmap_root_a: texture_2d<f32>;
// The same texture as root a where there is one plane only.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_3) var texfold_zipmap_root_b: texture_2d<f32>;
// All mip levels of all patches.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_4) var texfold_zipmap_atlas: texture_2d<f32>;

// Texel `index` of the table; beyond its end nothing that counts.
fn texfold_zipmap_entry(index: u32) -> vec4<u32> {
    let row = index >> texfold_zipmap_params.row_log2;
    let column = index - (row << texfold_zipmap_params.row_log2);
    let last = textureDimensions(texfold_zipmap_table) - vec2<u32>(1u);
    return textureLoad(texfold_zipmap_table, min(vec2<u32>(column, row), last), 0u);
}

// The patch of that number.
fn texfold_zipmap_patch(index: u32) -> TexfoldZipmapPatch {
    let start = texfold_zipmap_params.record_start + index * TEXFOLD_ZIPMAP_RECORD;
    let x = texfold_zipmap_entry(start);
    let y = texfold_zipmap_entry(start + 1u);
    let z = texfold_zipmap_entry(start + 2u);
    let rows = mat3x3<f32>(bitcast<vec3<f32>>(x.xyz), bitcast<vec3<f32>>(y.xyz), bitcast<vec3<f32>>(z.xyz));
    return TexfoldZipmapPatch(transpose(rows), vec2<u32>(x.w & 0xffffu, x.w >> 16u), y.w, start);
}

// Four texels of level `level` of a patch around `uv`, blended.
fn texfold_zipmap_blend(layer: TexfoldZipmapPatch, uv: vec2<f32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(layer.size, level);
    let origin = texfold_zipmap_entry(layer.start + 3u + level / 4u)[level % 4u];
    let corner = vec2<u32>(origin & 0xffffu, origin >> 16u);
    let tap = texfold_tap(uv, size, TEXFOLD_CLAMP);
    let last = textureDimensions(texfold_zipmap_atlas) - vec2<u32>(1u);
    let low = min(corner + tap.low, last);
    let high = min(corner + tap.high, last);
    let a = texfold_bilinear(
        array<vec4<f32>, 4>(
            textureLoad(texfold_zipmap_atlas, low, 0u),
            textureLoad(texfold_zipmap_atlas, vec2<u32>(high.x, low.y), 0u),
            textureLoad(texfold_zipmap_atlas, vec2<u32>(low.x, high.y), 0u),
            textureLoad(texfold_zipmap_atlas, high, 0u),
        ),
        tap.weight,
    );
    return texfold_swizzle(a, a, texfold_zipmap_params.patch_swizzle);
}

// What a patch shows at `uv` of the root, which moves by `dx` and `dy` to the pixels right and below: its colour and how much of it.
fn texfold_zipmap_layer(index: u32, uv: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>) -> vec4<f32> {
    let layer = texfold_zipmap_patch(index);
    let place = layer.matrix * vec3<f32>(uv, 1.0);
    let at = place.xy / place.z;
    let inside = all(at >= vec2<f32>(0.0)) & all(at <= vec2<f32>(1.0));
    if !(inside & (place.z >= TEXFOLD_ZIPMAP_HORIZON)) {
        return vec4<f32>(0.0);
    }
    let to_right = layer.matrix * vec3<f32>(dx, 0.0);
    let to_below = layer.matrix * vec3<f32>(dy, 0.0);
    let across = (to_right.xy - at * to_right.z) / place.z;
    let down = (to_below.xy - at * to_below.z) / place.z;
    let wanted = texfold_level(across, down, layer.size);
    let lod = select(0.0, wanted, wanted > 0.0);
    if lod >= f32(layer.levels) {
        return vec4<f32>(0.0);
    }
    let low = floor(lod);
    let fine = texfold_zipmap_blend(layer, at, u32(low));
    if lod == low {
        return fine;
    }
    var coarse = vec4<f32>(fine.xyz, 0.0);
    if u32(low) + 1u < layer.levels {
        coarse = texfold_zipmap_blend(layer, at, u32(low) + 1u);
    }
    return texfold_mix(fine, coarse, lod - low);
}

// Four texels of level `level` of the root around `uv`, blended.
fn texfold_zipmap_root_blend(uv: vec2<f32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_zipmap_params.root_size, level);
    let tap = texfold_tap(uv, size, texfold_zipmap_params.address_mode);
    let upper_right = vec2<u32>(tap.high.x, tap.low.y);
    let lower_left = vec2<u32>(tap.low.x, tap.high.y);
    let a = texfold_bilinear(
        array<vec4<f32>, 4>(
            textureLoad(texfold_zipmap_root_a, tap.low, level),
            textureLoad(texfold_zipmap_root_a, upper_right, level),
            textureLoad(texfold_zipmap_root_a, lower_left, level),
            textureLoad(texfold_zipmap_root_a, tap.high, level),
        ),
        tap.weight,
    );
    var b = a;
    if texfold_zipmap_params.root_swizzle == TEXFOLD_SPLIT {
        b = texfold_bilinear(
            array<vec4<f32>, 4>(
                textureLoad(texfold_zipmap_root_b, tap.low, level),
                textureLoad(texfold_zipmap_root_b, upper_right, level),
                textureLoad(texfold_zipmap_root_b, lower_left, level),
                textureLoad(texfold_zipmap_root_b, tap.high, level),
            ),
            tap.weight,
        );
    }
    return texfold_swizzle(a, b, texfold_zipmap_params.root_swizzle);
}

// The root's colour at `uv`, which moves by `dx` and `dy` to the pixels right and below.
fn texfold_zipmap_root(uv: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>) -> vec4<f32> {
    let wanted = texfold_level(dx, dy, texfold_zipmap_params.root_size);
    let lod = texfold_lod(wanted, texfold_zipmap_params.root_levels);
    let low = floor(lod);
    let fine = texfold_zipmap_root_blend(uv, u32(low));
    if lod == low {
        return fine;
    }
    return texfold_mix(fine, texfold_zipmap_root_blend(uv, u32(low) + 1u), lod - low);
}

// The colour at `uv`, which moves by `dx` and `dy` to the pixels right and below: 0 to 1 from the top left of the root, and beyond by
// the address mode.
fn texfold_zipmap_sample_grad(uv: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>) -> vec4<f32> {
    var colour = texfold_zipmap_root(uv, dx, dy);
    let at = texfold_fold(uv, texfold_zipmap_params.address_mode);
    let tiles = texfold_zipmap_params.tiles;
    let tile = texfold_inside(vec2<i32>(floor(at * vec2<f32>(tiles))), tiles);
    let number = tile.y * tiles.x + tile.x;
    let found = texfold_zipmap_entry(number / 4u)[number % 4u];
    let count = found >> 20u;
    var names = vec4<u32>(0u);
    for (var k = 0u; k < min(count, TEXFOLD_ZIPMAP_MOST); k += 1u) {
        if k % 8u == 0u {
            names = texfold_zipmap_entry((found & 0xfffffu) + k / 8u);
        }
        let index = (names[k / 2u % 4u] >> (16u * (k % 2u))) & 0xffffu;
        let layer = texfold_zipmap_layer(index, at, dx, dy);
        colour = texfold_mix(colour, vec4<f32>(layer.xyz, 1.0), layer.w);
    }
    return colour;
}

// The colour at `uv` where pixels are as large as the texels of level `lod`, clamped to those that there are.
fn texfold_zipmap_sample_level(uv: vec2<f32>, lod: f32) -> vec4<f32> {
    let size = vec2<f32>(texfold_zipmap_params.size);
    let step = exp2(texfold_lod(lod, texfold_zipmap_params.levels)) / size;
    return texfold_zipmap_sample_grad(uv, vec2<f32>(step.x, 0.0), vec2<f32>(0.0, step.y));
}

// The colour at `uv` where pixels are the texels of level `level`.
fn texfold_zipmap_bilinear(uv: vec2<f32>, level: u32) -> vec4<f32> {
    let size = vec2<f32>(texfold_level_size(texfold_zipmap_params.size, level));
    return texfold_zipmap_sample_grad(uv, vec2<f32>(1.0 / size.x, 0.0), vec2<f32>(0.0, 1.0 / size.y));
}

// The texel at column `at.x` and row `at.y` of level `level`, clamped to it.
fn texfold_zipmap_fetch(at: vec2<i32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_zipmap_params.size, level);
    let place = vec2<f32>(texfold_inside(at, size)) + vec2<f32>(0.5);
    return texfold_zipmap_bilinear(place / vec2<f32>(size), level);
}

// The texel of level `level` that `uv` lies in.
fn texfold_zipmap_nearest(uv: vec2<f32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_zipmap_params.size, level);
    let at = texfold_nearest(uv, size, texfold_zipmap_params.address_mode);
    return texfold_zipmap_fetch(vec2<i32>(at), level);
}

// The colour at `uv`, by derivatives; for fragment shaders in uniform control flow.
fn texfold_zipmap_sample(uv: vec2<f32>) -> vec4<f32> {
    return texfold_zipmap_sample_grad(uv, dpdx(uv), dpdy(uv));
}
