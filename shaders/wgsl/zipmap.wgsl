// Zoom-into-parts texture maps: a root and patches of higher resolution, in one pass. CPU twins: crates/zipmap/src/decode.rs.
//
// Tiles of the root name the patches that touch them, the uppermost first: what lies under opaque texels is not looked up. Colours are
// as stored: no gamma conversion (see texfold_linear). Every function works in any control flow but texfold_zipmap_sample, which
// takes derivatives.
//
// Two paths: where pixels are no larger than the texels of the finest patch of their tile, every patch is read from its level 0, four
// texels and three of the table; elsewhere the level that fits is found for each patch. Software renderers run all code at least once,
// and leave a loop only where a round ends without pixels: so loops are left there, not only where the next round would begin.

// Most patches that a tile names.
const TEXFOLD_ZIPMAP_MOST: u32 = 2048u;
// Texels of the table that describe a patch.
const TEXFOLD_ZIPMAP_RECORD: u32 = 8u;
// Numbers of 16 bits before the names in a list: how fine its patches are.
const TEXFOLD_ZIPMAP_BEFORE: u32 = 2u;
// Transmittance below which compositing stops: a quarter of a step of 8 bits.
const TEXFOLD_ZIPMAP_LEAST: f32 = 0.0009765625;
// Levels that are blended.
const TEXFOLD_ZIPMAP_BLENDED: u32 = 2u;
// Most lookups for one pixel that is longer than wide.
const TEXFOLD_ZIPMAP_LONG: u32 = 8u;
// Least third coordinate of a place in a patch: nearer to the horizon, or behind it, the patch is transparent.
const TEXFOLD_ZIPMAP_HORIZON: f32 = 0.0001;

// Whether a root may lie in two planes: pipelines that draw none that does need not make the loads.
override TEXFOLD_ZIPMAP_SPLIT: bool = true;

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
    // What the root's texture coordinates u and v, and 1, add to the place in texels of level 0, times a third coordinate.
    by_u: vec3<f32>,
    by_v: vec3<f32>,
    by_one: vec3<f32>,
    // Columns and rows of level 0.
    size: vec2<i32>,
    // Where its upper left texel lies in the plane.
    origin: vec2<i32>,
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
// All levels of all patches. Blocks of variable length make two of three levels of means: these lie in its mip levels.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_4) var texfold_zipmap_atlas: texture_2d<f32>;

// Where texel `index` of the table lies.
fn texfold_zipmap_place(index: u32) -> vec2<u32> {
    let row = index >> texfold_zipmap_params.row_log2;
    return vec2<u32>(index - (row << texfold_zipmap_params.row_log2), row);
}

// Texel `index` of the table.
fn texfold_zipmap_entry(index: u32) -> vec4<u32> {
    return textureLoad(texfold_zipmap_table, texfold_zipmap_place(index), 0u);
}

// Two numbers of 16 bits.
fn texfold_zipmap_pair(both: u32) -> vec2<i32> {
    return vec2<i32>(i32(both & 0xffffu), i32(both >> 16u));
}

// The patch of that number.
fn texfold_zipmap_patch(index: u32) -> TexfoldZipmapPatch {
    let start = texfold_zipmap_params.record_start + index * TEXFOLD_ZIPMAP_RECORD;
    // A row of the table holds whole patches.
    let place = texfold_zipmap_place(start);
    let x = textureLoad(texfold_zipmap_table, place, 0u);
    let y = textureLoad(texfold_zipmap_table, place + vec2<u32>(1u, 0u), 0u);
    let z = textureLoad(texfold_zipmap_table, place + vec2<u32>(2u, 0u), 0u);
    return TexfoldZipmapPatch(
        bitcast<vec3<f32>>(x.xyz),
        bitcast<vec3<f32>>(y.xyz),
        bitcast<vec3<f32>>(z.xyz),
        texfold_zipmap_pair(x.w),
        texfold_zipmap_pair(y.w),
        z.w & 0xffu,
        start,
    );
}

// A texel of mip level `mip` of the plane, in a column and a row that count: the border of levels of means is transparent.
fn texfold_zipmap_tap(at: vec2<i32>, mip: u32, counts: bool) -> vec4<f32> {
    let texel = textureLoad(texfold_zipmap_atlas, at, i32(mip));
    return vec4<f32>(texel.xyz, select(0.0, texel.w, counts));
}

// Four texels of a level around `at`, in texels of it, blended: from `origin` on in mip level `mip` of the plane.
fn texfold_zipmap_blend(origin: vec2<i32>, mip: u32, size: vec2<i32>, at: vec2<f32>) -> vec4<f32> {
    let last = size - vec2<i32>(1);
    let place = clamp(at - vec2<f32>(0.5), vec2<f32>(0.0), vec2<f32>(last));
    let corner = vec2<i32>(place);
    let low = origin + corner;
    // Behind the last column or row, where the weight is 0.
    let high = low + vec2<i32>(1);
    let is_stored = vec2<bool>(mip == 0u);
    let first = is_stored | ((corner > vec2<i32>(0)) & (corner < last));
    let second = is_stored | (corner + vec2<i32>(1) < last);
    return texfold_bilinear(
        array<vec4<f32>, 4>(
            texfold_zipmap_tap(low, mip, first.x & first.y),
            texfold_zipmap_tap(vec2<i32>(high.x, low.y), mip, second.x & first.y),
            texfold_zipmap_tap(vec2<i32>(low.x, high.y), mip, first.x & second.y),
            texfold_zipmap_tap(high, mip, second.x & second.y),
        ),
        place - vec2<f32>(corner),
    );
}

// Colour and alpha of a texel of a patch; transparent where it is not `inside`.
fn texfold_zipmap_visible(texel: vec4<f32>, inside: bool) -> vec4<f32> {
    let alpha = select(texel.w, texel.y, texfold_zipmap_params.patch_swizzle == TEXFOLD_GRAY_ALPHA);
    return vec4<f32>(texel.xyz, select(0.0, alpha, inside));
}

// Colour and alpha of a patch at `uv` of the root, where no pixel is larger than its texels.
fn texfold_zipmap_near(index: u32, uv: vec2<f32>) -> vec4<f32> {
    let layer = texfold_zipmap_patch(index);
    let place = layer.by_u * uv.x + layer.by_v * uv.y + layer.by_one;
    let at = place.xy / place.z;
    let inside = all(at >= vec2<f32>(0.0)) & all(at <= vec2<f32>(layer.size));
    let texel = texfold_zipmap_blend(layer.origin, 0u, layer.size, at);
    return texfold_zipmap_visible(texel, inside & (place.z >= TEXFOLD_ZIPMAP_HORIZON));
}

// Four texels of level `level` of a patch around `share` of its sides, blended.
fn texfold_zipmap_level(layer: TexfoldZipmapPatch, share: vec2<f32>, level: u32) -> vec4<f32> {
    let size = vec2<i32>(texfold_level_size(vec2<u32>(layer.size), level));
    let origin = texfold_zipmap_entry(layer.start + 3u + level / 4u)[level % 4u];
    // Above the 13 bits of the column stands the mip level of the plane.
    let place = texfold_zipmap_pair(origin & 0xffff1fffu);
    return texfold_zipmap_blend(place, (origin >> 13u) & 7u, size, share * vec2<f32>(size));
}

// Colour and alpha of a patch at `uv` of the root, which moves by `dx` and `dy` to the pixels right and below.
fn texfold_zipmap_layer(index: u32, uv: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>) -> vec4<f32> {
    let layer = texfold_zipmap_patch(index);
    let place = layer.by_u * uv.x + layer.by_v * uv.y + layer.by_one;
    let at = place.xy / place.z;
    let size = vec2<f32>(layer.size);
    let inside = all(at >= vec2<f32>(0.0)) & all(at <= size) & (place.z >= TEXFOLD_ZIPMAP_HORIZON);
    let to_right = layer.by_u * dx.x + layer.by_v * dx.y;
    let to_below = layer.by_u * dy.x + layer.by_v * dy.y;
    let across = (to_right.xy - at * to_right.z) / place.z;
    let down = (to_below.xy - at * to_below.z) / place.z;
    let lod = 0.5 * log2(max(max(dot(across, across), dot(down, down)), 1.0));
    if !(inside & (lod < f32(layer.levels))) {
        return vec4<f32>(0.0);
    }
    let low = floor(lod);
    let share = at / size;
    // Behind its last level a patch fades out.
    let last = u32(low) + 1u >= layer.levels;
    var texel = vec4<f32>(0.0);
    for (var k = 0u; k < min(2u, TEXFOLD_ZIPMAP_BLENDED); k += 1u) {
        let level = texfold_zipmap_level(layer, share, u32(low) + k);
        texel = select(texfold_mix(texel, level, lod - low), level, k == 0u);
        if (k == 1u) | last | (lod == low) {
            break;
        }
    }
    let visible = texfold_zipmap_visible(texel, true);
    return vec4<f32>(visible.xyz, visible.w * select(1.0, 1.0 - (lod - low), last));
}

// Four texels of level `level` of the root around `uv`, blended.
fn texfold_zipmap_root_blend(uv: vec2<f32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_zipmap_params.root_size, level);
    let tap = texfold_tap(uv, size, texfold_zipmap_params.address_mode);
    let a = texfold_blend(texfold_zipmap_root_a, tap, level);
    var b = a;
    if TEXFOLD_ZIPMAP_SPLIT {
        if texfold_zipmap_params.root_swizzle == TEXFOLD_SPLIT {
            b = texfold_blend(texfold_zipmap_root_b, tap, level);
        }
    }
    return texfold_swizzle(a, b, texfold_zipmap_params.root_swizzle);
}

// The root's colour at `uv`, which moves by `dx` and `dy` to the pixels right and below.
fn texfold_zipmap_root(uv: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>) -> vec4<f32> {
    let wanted = texfold_level(dx, dy, texfold_zipmap_params.root_size);
    let lod = texfold_lod(wanted, texfold_zipmap_params.root_levels);
    let low = floor(lod);
    var colour = vec4<f32>(0.0);
    for (var k = 0u; k < min(2u, TEXFOLD_ZIPMAP_BLENDED); k += 1u) {
        let level = texfold_zipmap_root_blend(uv, u32(low) + k);
        colour = select(texfold_mix(colour, level, lod - low), level, k == 0u);
        if (k == 1u) | (lod == low) {
            break;
        }
    }
    return colour;
}

// The tile that `uv` lies in: how many patches touch it, and the first texel of their list.
fn texfold_zipmap_tile(uv: vec2<f32>) -> vec2<u32> {
    let tiles = texfold_zipmap_params.tiles;
    let tile = texfold_inside(vec2<i32>(floor(uv * vec2<f32>(tiles))), tiles);
    let number = tile.y * tiles.x + tile.x;
    let found = texfold_zipmap_entry(number / 4u)[number % 4u];
    return vec2<u32>(found >> 20u, found & 0xfffffu);
}

// The patch at place `k` of a list.
fn texfold_zipmap_name(list: u32, k: u32) -> u32 {
    let at = k + TEXFOLD_ZIPMAP_BEFORE;
    return (texfold_zipmap_entry(list + at / 8u)[at / 2u % 4u] >> (16u * (at % 2u))) & 0xffffu;
}

// Composited colour and remaining transmittance of `front`, with a further patch below.
fn texfold_zipmap_under(front: vec4<f32>, back: vec4<f32>) -> vec4<f32> {
    let share = front.w * back.w;
    return vec4<f32>(front.xyz + back.xyz * share, front.w - share);
}

// The colour at `uv`, which moves by `dx` and `dy` to the pixels right and below, of a pixel that is about as long as wide.
fn texfold_zipmap_pixel(uv: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>) -> vec4<f32> {
    let at = texfold_fold(uv, texfold_zipmap_params.address_mode);
    let found = texfold_zipmap_tile(at);
    let root = vec2<f32>(texfold_zipmap_params.root_size);
    let longest = max(dot(dx * root, dx * root), dot(dy * root, dy * root));
    let is_near = longest * bitcast<f32>(texfold_zipmap_entry(found.y).x) <= 1.0;
    // Composited colour, and the transmittance to the patches below.
    var seen = vec4<f32>(0.0, 0.0, 0.0, 1.0);
    if is_near {
        for (var k = 0u; k < min(found.x, TEXFOLD_ZIPMAP_MOST); k += 1u) {
            seen = texfold_zipmap_under(seen, texfold_zipmap_near(texfold_zipmap_name(found.y, k), at));
            if (k + 1u >= found.x) | (seen.w <= TEXFOLD_ZIPMAP_LEAST) {
                break;
            }
        }
    } else {
        for (var k = 0u; k < min(found.x, TEXFOLD_ZIPMAP_MOST); k += 1u) {
            seen = texfold_zipmap_under(seen, texfold_zipmap_layer(texfold_zipmap_name(found.y, k), at, dx, dy));
            if (k + 1u >= found.x) | (seen.w <= TEXFOLD_ZIPMAP_LEAST) {
                break;
            }
        }
    }
    let gray = texfold_zipmap_params.patch_swizzle == TEXFOLD_GRAY_ALPHA;
    let patches = vec4<f32>(select(seen.xyz, seen.xxx, gray), 1.0 - seen.w);
    if seen.w <= TEXFOLD_ZIPMAP_LEAST {
        return patches;
    }
    return patches + texfold_zipmap_root(uv, dx, dy) * seen.w;
}

// The colour at `uv`, which moves by `dx` and `dy` to the pixels right and below: 0 to 1 from the top left of the root, and beyond by
// the address mode. A pixel that is longer than wide is the mean of several, side by side.
fn texfold_zipmap_sample_grad(uv: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>) -> vec4<f32> {
    let root = vec2<f32>(texfold_zipmap_params.root_size);
    let across = dx * root;
    let down = dy * root;
    let longer = dot(across, across) >= dot(down, down);
    let along = select(down, across, longer);
    let squared = dot(along, along);
    // Its length over its width, which is its area over its length, and its length in texels of the finest patch.
    let ratio = squared / max(abs(across.x * down.y - across.y * down.x), 1e-12);
    let texels = sqrt(squared) * f32(texfold_zipmap_params.size.x) / root.x;
    let count = clamp(min(floor(ratio + 0.5), ceil(texels)), 1.0, f32(TEXFOLD_ZIPMAP_LONG));
    let step = select(dy, dx, longer) / count;
    // A part is as wide as long.
    let side = vec2<f32>(-along.y, along.x) / (root * count);
    let is_one = count == 1.0;
    var sum = vec4<f32>(0.0);
    for (var k = 0u; k < min(u32(count), TEXFOLD_ZIPMAP_LONG); k += 1u) {
        let place = uv + step * (f32(k) + 0.5 - 0.5 * count);
        sum += texfold_zipmap_pixel(place, select(step, dx, is_one), select(side, dy, is_one));
        if k + 1u >= u32(count) {
            break;
        }
    }
    return sum / count;
}

// The colour at `uv` where pixels are as large as the texels of level `lod`, clamped to those that there are.
fn texfold_zipmap_sample_level(uv: vec2<f32>, lod: f32) -> vec4<f32> {
    let size = vec2<f32>(texfold_zipmap_params.size);
    let step = exp2(texfold_lod(lod, texfold_zipmap_params.levels)) / size;
    return texfold_zipmap_pixel(uv, vec2<f32>(step.x, 0.0), vec2<f32>(0.0, step.y));
}

// The colour at `uv` where pixels are the texels of level `level`.
fn texfold_zipmap_bilinear(uv: vec2<f32>, level: u32) -> vec4<f32> {
    let size = vec2<f32>(texfold_level_size(texfold_zipmap_params.size, level));
    return texfold_zipmap_pixel(uv, vec2<f32>(1.0 / size.x, 0.0), vec2<f32>(0.0, 1.0 / size.y));
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
