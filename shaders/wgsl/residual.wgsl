// Residual content: a reduced base and a residual plane, for the modules of codecs that embed it. CPU twins:
// crates/residual/src/decode/mod.rs.
//
// A texel is a place of the base, blended from four base texels, plus a residual. A block's residuals are coefficients of
// a two-level Haar transform in cells of 4x4 texels, of luma and two axes of chroma, or of these turned. The last TEXFOLD_RESIDUAL_STATE_BITS
// bits up to a coefficient's own last bit, around the block, name its value. Colours are as stored: no gamma conversion
// (see texfold_linear). Every function works in any control flow.

// Bits that a coefficient's value follows from, its own among them.
const TEXFOLD_RESIDUAL_STATE_BITS: u32 = 10u;
// What a value of the table is worth at scale 1 and weight 1.
const TEXFOLD_RESIDUAL_UNIT: f32 = 0.00003177627;
// Words of a group of blocks: where its bits begin, classes, scales.
const TEXFOLD_RESIDUAL_GROUP_WORDS: u32 = 5u;
// Bits of each of the three numbers that say how luma and chroma are turned, and the number of 1 there.
const TEXFOLD_RESIDUAL_AXES_BITS: u32 = 10u;
const TEXFOLD_RESIDUAL_AXES_ONE: f32 = 511.0;

// Whether the base may have two planes, or be block-isolated. Pipelines that draw images without need not do what it
// takes: software renderers run all branches.
override TEXFOLD_RESIDUAL_SPLIT: bool = true;
override TEXFOLD_RESIDUAL_ISOLATED: bool = true;

// The parameters of one image.
struct TexfoldResidualParams {
    // Columns and rows of level 0 in texels.
    size: vec2<u32>,
    // Columns and rows of level 0 of the base.
    base_size: vec2<u32>,
    // How texels are read from the base's planes.
    swizzle: u32,
    // Bits of a block of class 1; 0 where there is no residual plane.
    class_bits: u32,
    // Binary logarithm of the words in a row of the residual plane.
    row_log2: u32,
    // First bit of the blocks' bits.
    first_bit: u32,
    // Mip levels of the base.
    base_levels: u32,
    // Base texels a side of a block, where the base is block-isolated (no filtering across blocks); else 0.
    base_block: u32,
    // Texels of level 0 of the base beyond each border of the image.
    base_padding: u32,
    // How luma and chroma are turned: see texfold_residual_axes. 0: not at all.
    axes: u32,
    // For each level the number of blocks of the finer levels, four levels a vector.
    level_start: array<vec4<u32>, 4>,
    // For each rate class the bits of a coefficient of each subband, 4 bits each, four classes a vector. Subbands: mean of
    // luma, coarse luma, edges, diagonals, mean of chroma, coarse chroma, edges and diagonals of chroma.
    classes: array<vec4<u32>, 4>,
    // Weights of the first four subbands.
    luma_weights: vec4<f32>,
    // Weights of the last three subbands.
    chroma_weights: vec3<f32>,
    // Factor of alpha's contrast around one half: see texfold_residual_contrast.
    alpha_gain: f32,
}

// A block of the residual plane.
struct TexfoldResidualBlock {
    // Its first bit in the residual plane.
    start: u32,
    // Its bits; 0 where there is no residual.
    bits: u32,
    // Bits of a coefficient of each subband, 4 bits each.
    rates: u32,
    // What its coefficients are multiplied by.
    scale: f32,
    // Its last TEXFOLD_RESIDUAL_STATE_BITS bits, which stand before its first.
    tail: u32,
}

@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_0) var<uniform> texfold_residual_params: TexfoldResidualParams;
// The residual plane: words, row by row.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_1) var texfold_residual_plane: texture_2d<u32>;
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_2) var texfold_residual_base_a: texture_2d<f32>;
// The same texture as base a where there is one plane only.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_3) var texfold_residual_base_b: texture_2d<f32>;

// Word `index` of the residual plane; out-of-range reads return a value that is never used.
fn texfold_residual_word(index: u32) -> u32 {
    let row = index >> texfold_residual_params.row_log2;
    let column = index - (row << texfold_residual_params.row_log2);
    return textureLoad(texfold_residual_plane, vec2<u32>(column, row), 0u).x;
}

// The sum of a word's eight numbers of 4 bits.
fn texfold_residual_sum(nibbles: u32) -> u32 {
    let pairs = (nibbles & 0x0f0f0f0fu) + ((nibbles >> 4u) & 0x0f0f0f0fu);
    return (pairs * 0x01010101u) >> 24u;
}

// The block that holds the texel at `at` of level `level`, which lies inside.
fn texfold_residual_block(at: vec2<u32>, level: u32) -> TexfoldResidualBlock {
    let columns = (texfold_level_size(texfold_residual_params.size, level).x + 7u) / 8u;
    let start = texfold_residual_params.level_start[level / 4u][level % 4u];
    let index = start + at.y / 8u * columns + at.x / 8u;
    let group = index / 16u * TEXFOLD_RESIDUAL_GROUP_WORDS;
    let member = index % 16u;
    let shift = 4u * (member % 8u);
    let before = (1u << shift) - 1u;
    let low = texfold_residual_word(group + 1u);
    let high = texfold_residual_word(group + 2u);
    let second = member >= 8u;
    let own = select(low, high, second);
    let first = select(0u, texfold_residual_sum(low), second);
    let rate_class = (own >> shift) & 15u;
    let sum = first + texfold_residual_sum(own & before);
    let scales = texfold_residual_word(group + 3u + member / 8u);
    let scale = (scales >> shift) & 15u;
    let odd = select(1.0, 1.4142135, (scale & 1u) == 1u);
    let class_bits = texfold_residual_params.class_bits;
    let first_bit = texfold_residual_params.first_bit + texfold_residual_word(group) * 16u + sum * class_bits;
    let bits = rate_class * class_bits;
    let tail = texfold_residual_read(first_bit + bits - TEXFOLD_RESIDUAL_STATE_BITS).x;
    return TexfoldResidualBlock(
        first_bit,
        bits,
        texfold_residual_params.classes[rate_class / 4u][rate_class % 4u],
        f32(i32(1u << (scale >> 1u))) * odd * TEXFOLD_RESIDUAL_UNIT,
        tail & ((1u << TEXFOLD_RESIDUAL_STATE_BITS) - 1u),
    );
}

// 64 bits of the residual plane from bit `start` on, the first of them lowest in x.
fn texfold_residual_read(start: u32) -> vec2<u32> {
    let index = start / 32u;
    let middle = texfold_residual_word(index + 1u);
    let low = vec2<u32>(texfold_residual_word(index), middle);
    let high = vec2<u32>(middle, texfold_residual_word(index + 2u));
    return (low >> vec2<u32>(start % 32u)) | ((high << vec2<u32>(1u)) << vec2<u32>(31u - start % 32u));
}

// Bits of a block up to 44 behind its bit `position`, from TEXFOLD_RESIDUAL_STATE_BITS before it on. Without branches:
// software renderers make the loads of all of them.
fn texfold_residual_chunk(block: TexfoldResidualBlock, position: u32) -> vec2<u32> {
    // Bits of the tail.
    let missing = TEXFOLD_RESIDUAL_STATE_BITS - min(position, TEXFOLD_RESIDUAL_STATE_BITS);
    let bits = texfold_residual_read(block.start + position + missing - TEXFOLD_RESIDUAL_STATE_BITS);
    let low = (bits.x << missing) | (block.tail >> (TEXFOLD_RESIDUAL_STATE_BITS - missing));
    return vec2<u32>(low, (bits.y << missing) | ((bits.x >> 1u) >> (31u - missing)));
}

// 32 bits of a chunk from bit `start`, 0 to 31, on.
fn texfold_residual_behind(chunk: vec2<u32>, start: u32) -> u32 {
    return (chunk.x >> start) | ((chunk.y << 1u) << (31u - start));
}

// What the state that ends `end` bits behind the chunk's position is hashed to. Its four bytes are added to be its value,
// which is nearly normal, and far apart for states that differ by a bit. Where `flip` is all ones, the value's negative:
// here the complement.
fn texfold_residual_hash(chunk: u32, end: u32, flip: u32) -> u32 {
    let state = (chunk >> end) & ((1u << TEXFOLD_RESIDUAL_STATE_BITS) - 1u);
    return (state * 3365104771u + 460760113u) ^ flip;
}

// A hash's bytes, added in two pairs, one in each half.
fn texfold_residual_pairs(hash: u32) -> u32 {
    return (hash & 0x00ff00ffu) + ((hash >> 8u) & 0x00ff00ffu);
}

// The sum of the values of `count` states from the sum of their pairs.
fn texfold_residual_value(pairs: u32, count: i32) -> f32 {
    return f32(i32((pairs & 0xffffu) + (pairs >> 16u)) - 510 * count);
}

// The coefficient whose bits end `end` bits behind the chunk's position.
fn texfold_residual_coefficient(chunk: u32, end: u32) -> f32 {
    return texfold_residual_value(texfold_residual_pairs(texfold_residual_hash(chunk, end, 0u)), 1);
}

// The sum of three coefficients whose bits end `ends` bits behind the chunk's position, those negated whose flip is all
// ones.
fn texfold_residual_three(chunk: u32, ends: vec3<u32>, flips: vec3<u32>) -> f32 {
    let pairs = texfold_residual_pairs(texfold_residual_hash(chunk, ends.x, flips.x))
        + texfold_residual_pairs(texfold_residual_hash(chunk, ends.y, flips.y))
        + texfold_residual_pairs(texfold_residual_hash(chunk, ends.z, flips.z));
    return texfold_residual_value(pairs, 3);
}

// The rotation of luma and both axes of chroma that the parameters say: axis times the tangent of half the angle.
fn texfold_residual_axes(word: u32) -> vec3<f32> {
    let top = vec3<u32>(word) << vec3<u32>(22u, 12u, 2u);
    let parts = bitcast<vec3<i32>>(top) >> vec3<u32>(32u - TEXFOLD_RESIDUAL_AXES_BITS);
    return vec3<f32>(parts) * (1.0 / TEXFOLD_RESIDUAL_AXES_ONE);
}

// Luma and both axes of chroma, turned by `axes`.
fn texfold_residual_turned(parts: vec3<f32>, axes: vec3<f32>) -> vec3<f32> {
    let once = cross(axes, parts);
    return parts + (once + cross(axes, once)) * (2.0 / (1.0 + dot(axes, axes)));
}

// The residual of the texel at `at` of level `level`, which lies inside: red, green, blue and 0.
fn texfold_residual_error(at: vec2<u32>, level: u32) -> vec4<f32> {
    let block = texfold_residual_block(at, level);
    if block.bits == 0u {
        return vec4<f32>(0.0);
    }
    let luma_rates = (vec4<u32>(block.rates) >> vec4<u32>(0u, 4u, 8u, 12u)) & vec4<u32>(15u);
    let chroma_rates = (vec3<u32>(block.rates) >> vec3<u32>(16u, 20u, 24u)) & vec3<u32>(15u);
    // A coefficient without bits is 0.
    let luma_weights = texfold_residual_params.luma_weights * block.scale;
    let luma_scale = select(vec4<f32>(0.0), luma_weights, luma_rates > vec4<u32>(0u));
    let chroma_weights = texfold_residual_params.chroma_weights * block.scale;
    let chroma_scale = select(vec3<f32>(0.0), chroma_weights, chroma_rates > vec3<u32>(0u));
    // All ones on the right and lower side of a cell, and of a quarter of it: there coefficients count negatively.
    let sides = vec2<u32>(0u) - ((at >> vec2<u32>(1u)) & vec2<u32>(1u));
    let fine_sides = vec2<u32>(0u) - (at & vec2<u32>(1u));
    let flips = vec3<u32>(sides, sides.x ^ sides.y);
    let fine_flips = vec3<u32>(fine_sides, fine_sides.x ^ fine_sides.y);
    let cell = ((at.x >> 2u) & 1u) + ((at.y >> 2u) & 1u) * 2u;
    let quad = ((at.x >> 1u) & 1u) + ((at.y >> 1u) & 1u) * 2u;

    let cell_at = cell * (block.bits / 4u);
    let luma_bits = luma_rates.x + 3u * luma_rates.y;
    let coarse_chunk = texfold_residual_chunk(block, cell_at);
    let mean = texfold_residual_coefficient(coarse_chunk.x, luma_rates.x);
    let coarse_ends = luma_rates.x + luma_rates.y * vec3<u32>(1u, 2u, 3u);
    let coarse = texfold_residual_three(coarse_chunk.x, coarse_ends, flips);
    let luma = (mean * luma_scale.x + coarse * luma_scale.y) * 0.25;

    let chroma_chunk = texfold_residual_behind(coarse_chunk, luma_bits);
    let means = vec2<f32>(
        texfold_residual_coefficient(chroma_chunk, chroma_rates.x),
        texfold_residual_coefficient(chroma_chunk, 2u * chroma_rates.x),
    );
    let chroma_ends = 2u * chroma_rates.x + chroma_rates.y * vec3<u32>(1u, 3u, 5u);
    let both_coarse = vec2<f32>(
        texfold_residual_three(chroma_chunk, chroma_ends, flips),
        texfold_residual_three(chroma_chunk, chroma_ends + vec3<u32>(chroma_rates.y), flips),
    );
    let chroma = (means * chroma_scale.x + both_coarse * chroma_scale.y) * 0.25;

    let fine_bits = 2u * luma_rates.z + luma_rates.w;
    let fine_at = cell_at + luma_bits + 2u * chroma_rates.x + 6u * chroma_rates.y;
    let fine_chunk = texfold_residual_chunk(block, fine_at + quad * (fine_bits + 6u * chroma_rates.z));
    let across = texfold_residual_pairs(texfold_residual_hash(fine_chunk.x, luma_rates.z, fine_flips.x));
    let down = texfold_residual_pairs(texfold_residual_hash(fine_chunk.x, 2u * luma_rates.z, fine_flips.y));
    let diagonal = texfold_residual_pairs(texfold_residual_hash(fine_chunk.x, fine_bits, fine_flips.z));
    let detail = (texfold_residual_value(across + down, 2) * luma_scale.z
        + texfold_residual_value(diagonal, 1) * luma_scale.w) * 0.5;

    let fine_chroma_chunk = texfold_residual_behind(fine_chunk, fine_bits);
    let fine_ends = chroma_rates.z * vec3<u32>(1u, 3u, 5u);
    let both_fine = vec2<f32>(
        texfold_residual_three(fine_chroma_chunk, fine_ends, fine_flips),
        texfold_residual_three(fine_chroma_chunk, fine_ends + vec3<u32>(chroma_rates.z), fine_flips),
    );
    var parts = vec3<f32>(luma + detail, chroma + both_fine * (chroma_scale.z * 0.5));
    if texfold_residual_params.axes != 0u {
        parts = texfold_residual_turned(parts, texfold_residual_axes(texfold_residual_params.axes));
    }
    let gray = parts.x * 0.57735026;
    let shift = parts.yz * vec2<f32>(0.70710677, 0.40824828);
    return vec4<f32>(gray + shift.x + shift.y, gray - 2.0 * shift.y, gray - shift.x + shift.y, 0.0);
}

// Four base texels around the texel at `at`, inside or beyond a border, of an image of `full` texels. The base has `size`
// texels, of which `padding` lie beyond each border. Where `block` is not 0, only those of the texel's own block are read,
// which has `block` base texels a side.
fn texfold_residual_tap(
    at: vec2<i32>,
    full: vec2<u32>,
    size: vec2<u32>,
    block: u32,
    padding: f32,
) -> TexfoldTap {
    let last = size - vec2<u32>(1u);
    var low_end = vec2<u32>(0u);
    var high_end = last;
    if TEXFOLD_RESIDUAL_ISOLATED {
        if block > 0u {
            low_end = min(vec2<u32>(max(at, vec2<i32>(0))) / 8u * block, last);
            high_end = min(low_end + vec2<u32>(block - 1u), last);
        }
    }
    let inner = vec2<f32>(vec2<i32>(size)) - vec2<f32>(2.0 * padding);
    let step = inner / vec2<f32>(vec2<i32>(full));
    let wanted = (vec2<f32>(at) + vec2<f32>(0.5)) * step + vec2<f32>(padding - 0.5);
    let place = clamp(wanted, vec2<f32>(vec2<i32>(low_end)), vec2<f32>(vec2<i32>(high_end)));
    let low = vec2<u32>(vec2<i32>(place));
    return TexfoldTap(low, min(low + vec2<u32>(1u), high_end), place - vec2<f32>(vec2<i32>(low)));
}

// A texel with the contrast of its alpha raised `gain` times around one half.
fn texfold_residual_contrast(texel: vec4<f32>, gain: f32) -> vec4<f32> {
    let alpha = clamp(texel.w * gain - 0.5 * (gain - 1.0), 0.0, 1.0);
    return select(texel, vec4<f32>(texel.xyz, alpha), gain > 1.0);
}

// Four texels of the base around the texel at `at` of level `level` of the image, or beyond a border, blended.
fn texfold_residual_base(at: vec2<i32>, level: u32) -> vec4<f32> {
    let stored = min(level, texfold_residual_params.base_levels - 1u);
    let size = texfold_level_size(texfold_residual_params.base_size, stored);
    let full = texfold_level_size(texfold_residual_params.size, level);
    let padding = f32(i32(texfold_residual_params.base_padding)) / f32(i32(1u << stored));
    let tap = texfold_residual_tap(at, full, size, texfold_residual_params.base_block, padding);
    let a = texfold_blend(texfold_residual_base_a, tap, stored);
    var b = a;
    if TEXFOLD_RESIDUAL_SPLIT {
        if texfold_residual_params.swizzle == TEXFOLD_SPLIT {
            b = texfold_blend(texfold_residual_base_b, tap, stored);
        }
    }
    // No base holds normals.
    let texel = texfold_swizzle_colour(a, b, texfold_residual_params.swizzle);
    return texfold_residual_contrast(texel, texfold_residual_params.alpha_gain);
}

// The texel at `at` of level `level`, which lies inside, or up to a texel beyond a border: there the base alone.
fn texfold_residual_load(at: vec2<i32>, level: u32) -> vec4<f32> {
    let inside = texfold_inside(at, texfold_level_size(texfold_residual_params.size, level));
    let base = texfold_residual_base(at, level);
    if texfold_residual_params.class_bits == 0u || any(at != vec2<i32>(inside)) {
        return base;
    }
    return clamp(base + texfold_residual_error(inside, level), vec4<f32>(0.0), vec4<f32>(1.0));
}
