// Base, codebooks and error map: a small picture, enlarged, what codebooks add to its blocks, and what both lack in blocks of
// 8x8 texels. CPU twins:
// crates/progressive/src/decode.rs.
//
// A block's errors are coefficients of a two-level Haar transform in cells of 4x4 texels, of luma and two axes of chroma. The last TEXFOLD_PROGRESSIVE_STATE_BITS bits up to a coefficient's own bits, around the block, name
// its value. Colours are as stored: no gamma conversion (see texfold_linear). Every function works in any control flow but
// texfold_progressive_sample, which takes derivatives.

// Bits that a coefficient's value follows from, its own among them.
const TEXFOLD_PROGRESSIVE_STATE_BITS: u32 = 10u;
// What a value of the table is worth at scale 1 and weight 1.
const TEXFOLD_PROGRESSIVE_UNIT: f32 = 0.00003177627;
// Words of a group of blocks: where its bits begin, classes, scales.
const TEXFOLD_PROGRESSIVE_GROUP_WORDS: u32 = 5u;
// Most levels of a texture.
const TEXFOLD_PROGRESSIVE_LEVELS: u32 = 16u;
// Cosine and sine of a quarter of a quarter turn.
const TEXFOLD_PROGRESSIVE_COS: f32 = 0.9238795;
const TEXFOLD_PROGRESSIVE_SIN: f32 = 0.38268343;
// Cosine and sine of half a quarter turn.
const TEXFOLD_PROGRESSIVE_DIAGONAL: f32 = 0.70710677;

// Whether an image may be stored smaller than it is, show codebooks, or have a base of two planes, one that is not blended across blocks,
// or one that goes on beyond the borders. Pipelines that draw images without need not do what it takes: software renderers run all branches.
override TEXFOLD_PROGRESSIVE_SHRUNK: bool = true;
override TEXFOLD_PROGRESSIVE_DETAIL: bool = true;
override TEXFOLD_PROGRESSIVE_SPLIT: bool = true;
override TEXFOLD_PROGRESSIVE_APART: bool = true;
override TEXFOLD_PROGRESSIVE_BEYOND: bool = true;

// The parameters of one image.
struct TexfoldProgressiveParams {
    // Columns and rows of level 0 in texels.
    size: vec2<u32>,
    // Mip levels, those among them that are not stored; at least 1.
    levels: u32,
    // TEXFOLD_REPEAT or TEXFOLD_CLAMP.
    address_mode: u32,
    // Columns and rows of level 0 of the base.
    base_size: vec2<u32>,
    // How texels are read from the base's planes.
    swizzle: u32,
    // Bits of a block of class 1; 0 where there is no error map.
    class_bits: u32,
    // Binary logarithm of the words in a row of the map.
    row_log2: u32,
    // First bit of the blocks' bits.
    first_bit: u32,
    // Mip levels of the base.
    base_levels: u32,
    // How entries of the map are laid out, 4 bits each: binary logarithm of a block's side, bits of a column, of a row and of a
    // turn; 0 where there is no map.
    map_form: u32,
    // For each level the number of blocks of the levels above it, four levels a vector.
    level_start: array<vec4<u32>, 4>,
    // For each class the bits of a coefficient of each kind, 4 bits each, four classes a vector. Kinds: mean of luma, coarse
    // luma, edges, diagonals, mean of chroma, coarse chroma, edges and diagonals of chroma.
    classes: array<vec4<u32>, 4>,
    // Weights of the first four kinds.
    luma_weights: vec4<f32>,
    // Weights of the last three kinds.
    chroma_weights: vec4<f32>,
    // Columns and rows of the public and the private codebook; 0 where there is none.
    codebooks: vec4<u32>,
    // The least gain above none.
    gain_unit: f32,
    // Binary logarithm of the words in a row of the map.
    entry_row_log2: u32,
    // Texels of the base a side of a block, where it is not blended across blocks; else 0.
    base_cell: u32,
    // Levels that are not stored: the largest one that is is enlarged for them.
    shrink_log2: u32,
    // Columns and rows of the largest level that is stored.
    stored_size: vec2<u32>,
    // Texels of level 0 of the base beyond each border of the image.
    base_margin: u32,
    // Always 0.
    reserved: u32,
}

// A block of the error map.
struct TexfoldProgressiveBlock {
    // Its first bit in the map.
    start: u32,
    // Its bits; 0 where there is no error.
    bits: u32,
    // Bits of a coefficient of each kind, 4 bits each.
    rates: u32,
    // What its coefficients are multiplied by.
    scale: f32,
    // Its last TEXFOLD_PROGRESSIVE_STATE_BITS bits, which stand before its first.
    tail: u32,
}

// Four texels around a place, up to a texel beyond a border, and how far the place lies from the first.
struct TexfoldProgressiveTap {
    // Left column and upper row.
    low: vec2<i32>,
    // Right column and lower row.
    high: vec2<i32>,
    // Weight of the right column and of the lower row, 0 to 1.
    weight: vec2<f32>,
}

@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_0) var<uniform> texfold_progressive_params: TexfoldProgressiveParams;
// The error map: words, row by row.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_1) var texfold_progressive_map: texture_2d<u32>;
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_2) var texfold_progressive_base_a: texture_2d<f32>;
// The same texture as base a where there is one plane only.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_3) var texfold_progressive_base_b: texture_2d<f32>;
// The map: words, row by row. Where there is none, any texture.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_4) var texfold_progressive_entries: texture_2d<u32>;
// The codebooks. Where there is none, any texture.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_5) var texfold_progressive_public: texture_2d<f32>;
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_6) var texfold_progressive_private: texture_2d<f32>;

// Word `index` of the map; beyond its end nothing that counts.
fn texfold_progressive_word(index: u32) -> u32 {
    let row = index >> texfold_progressive_params.row_log2;
    let column = index - (row << texfold_progressive_params.row_log2);
    return textureLoad(texfold_progressive_map, vec2<u32>(column, row), 0u).x;
}

// The sum of a word's eight numbers of 4 bits.
fn texfold_progressive_sum(nibbles: u32) -> u32 {
    let pairs = (nibbles & 0x0f0f0f0fu) + ((nibbles >> 4u) & 0x0f0f0f0fu);
    return (pairs * 0x01010101u) >> 24u;
}

// The block that holds the texel at `at` of level `level`, which lies inside.
fn texfold_progressive_block(at: vec2<u32>, level: u32) -> TexfoldProgressiveBlock {
    let columns = (texfold_level_size(texfold_progressive_params.stored_size, level).x + 7u) / 8u;
    let start = texfold_progressive_params.level_start[level / 4u][level % 4u];
    let index = start + at.y / 8u * columns + at.x / 8u;
    let group = index / 16u * TEXFOLD_PROGRESSIVE_GROUP_WORDS;
    let member = index % 16u;
    let shift = 4u * (member % 8u);
    let before = (1u << shift) - 1u;
    let low = texfold_progressive_word(group + 1u);
    let high = texfold_progressive_word(group + 2u);
    let second = member >= 8u;
    let own = select(low, high, second);
    let first = select(0u, texfold_progressive_sum(low), second);
    let kind = (own >> shift) & 15u;
    let sum = first + texfold_progressive_sum(own & before);
    let scales = texfold_progressive_word(group + 3u + member / 8u);
    let scale = (scales >> shift) & 15u;
    let odd = select(1.0, 1.4142135, (scale & 1u) == 1u);
    let class_bits = texfold_progressive_params.class_bits;
    let first_bit = texfold_progressive_params.first_bit + texfold_progressive_word(group) * 16u + sum * class_bits;
    let bits = kind * class_bits;
    let tail = texfold_progressive_read(first_bit + bits - TEXFOLD_PROGRESSIVE_STATE_BITS).x;
    return TexfoldProgressiveBlock(
        first_bit,
        bits,
        texfold_progressive_params.classes[kind / 4u][kind % 4u],
        f32(i32(1u << (scale >> 1u))) * odd * TEXFOLD_PROGRESSIVE_UNIT,
        tail & ((1u << TEXFOLD_PROGRESSIVE_STATE_BITS) - 1u),
    );
}

// 64 bits of the map from bit `start` on, the first of them lowest in x.
fn texfold_progressive_read(start: u32) -> vec2<u32> {
    let index = start / 32u;
    let middle = texfold_progressive_word(index + 1u);
    let low = vec2<u32>(texfold_progressive_word(index), middle);
    let high = vec2<u32>(middle, texfold_progressive_word(index + 2u));
    return (low >> vec2<u32>(start % 32u)) | ((high << vec2<u32>(1u)) << vec2<u32>(31u - start % 32u));
}

// Bits of a block up to 44 behind its bit `position`, from TEXFOLD_PROGRESSIVE_STATE_BITS before it on. Without branches:
// software renderers make the loads of all of them.
fn texfold_progressive_chunk(block: TexfoldProgressiveBlock, position: u32) -> vec2<u32> {
    // Bits of the tail.
    let missing = TEXFOLD_PROGRESSIVE_STATE_BITS - min(position, TEXFOLD_PROGRESSIVE_STATE_BITS);
    let bits = texfold_progressive_read(block.start + position + missing - TEXFOLD_PROGRESSIVE_STATE_BITS);
    let low = (bits.x << missing) | (block.tail >> (TEXFOLD_PROGRESSIVE_STATE_BITS - missing));
    return vec2<u32>(low, (bits.y << missing) | ((bits.x >> 1u) >> (31u - missing)));
}

// 32 bits of a chunk from bit `start`, 0 to 31, on.
fn texfold_progressive_behind(chunk: vec2<u32>, start: u32) -> u32 {
    return (chunk.x >> start) | ((chunk.y << 1u) << (31u - start));
}

// What the state that ends `end` bits behind the chunk's position is hashed to; its four bytes are added to be its value, which is nearly
// normal, and far apart for states that differ by a bit. Where `flip` is all ones, its negative: here the complement.
fn texfold_progressive_hash(chunk: u32, end: u32, flip: u32) -> u32 {
    let state = (chunk >> end) & ((1u << TEXFOLD_PROGRESSIVE_STATE_BITS) - 1u);
    return (state * 3365104771u + 460760113u) ^ flip;
}

// A hash's bytes, added in two pairs, one in each half.
fn texfold_progressive_pairs(hash: u32) -> u32 {
    return (hash & 0x00ff00ffu) + ((hash >> 8u) & 0x00ff00ffu);
}

// The sum of the values of `count` states from the sum of their pairs.
fn texfold_progressive_value(pairs: u32, count: i32) -> f32 {
    return f32(i32((pairs & 0xffffu) + (pairs >> 16u)) - 510 * count);
}

// The coefficient whose bits end `end` bits behind the chunk's position.
fn texfold_progressive_coefficient(chunk: u32, end: u32) -> f32 {
    return texfold_progressive_value(texfold_progressive_pairs(texfold_progressive_hash(chunk, end, 0u)), 1);
}

// The sum of three coefficients whose bits end `ends` bits behind the chunk's position, those negated whose flip is all ones.
fn texfold_progressive_three(chunk: u32, ends: vec3<u32>, flips: vec3<u32>) -> f32 {
    let pairs = texfold_progressive_pairs(texfold_progressive_hash(chunk, ends.x, flips.x))
        + texfold_progressive_pairs(texfold_progressive_hash(chunk, ends.y, flips.y))
        + texfold_progressive_pairs(texfold_progressive_hash(chunk, ends.z, flips.z));
    return texfold_progressive_value(pairs, 3);
}

// The error of the texel at `at` of level `level`, which lies inside: red, green, blue and 0.
fn texfold_progressive_error(at: vec2<u32>, level: u32) -> vec4<f32> {
    let block = texfold_progressive_block(at, level);
    if block.bits == 0u {
        return vec4<f32>(0.0);
    }
    let luma_rates = (vec4<u32>(block.rates) >> vec4<u32>(0u, 4u, 8u, 12u)) & vec4<u32>(15u);
    let chroma_rates = (vec3<u32>(block.rates) >> vec3<u32>(16u, 20u, 24u)) & vec3<u32>(15u);
    // A coefficient without bits is 0.
    let luma_weights = texfold_progressive_params.luma_weights * block.scale;
    let luma_scale = select(vec4<f32>(0.0), luma_weights, luma_rates > vec4<u32>(0u));
    let chroma_weights = texfold_progressive_params.chroma_weights.xyz * block.scale;
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
    let coarse_chunk = texfold_progressive_chunk(block, cell_at);
    let mean = texfold_progressive_coefficient(coarse_chunk.x, luma_rates.x);
    let coarse_ends = luma_rates.x + luma_rates.y * vec3<u32>(1u, 2u, 3u);
    let coarse = texfold_progressive_three(coarse_chunk.x, coarse_ends, flips);
    let luma = (mean * luma_scale.x + coarse * luma_scale.y) * 0.25;

    let chroma_chunk = texfold_progressive_behind(coarse_chunk, luma_bits);
    let means = vec2<f32>(
        texfold_progressive_coefficient(chroma_chunk, chroma_rates.x),
        texfold_progressive_coefficient(chroma_chunk, 2u * chroma_rates.x),
    );
    let chroma_ends = 2u * chroma_rates.x + chroma_rates.y * vec3<u32>(1u, 3u, 5u);
    let both_coarse = vec2<f32>(
        texfold_progressive_three(chroma_chunk, chroma_ends, flips),
        texfold_progressive_three(chroma_chunk, chroma_ends + vec3<u32>(chroma_rates.y), flips),
    );
    let chroma = (means * chroma_scale.x + both_coarse * chroma_scale.y) * 0.25;

    let fine_bits = 2u * luma_rates.z + luma_rates.w;
    let fine_at = cell_at + luma_bits + 2u * chroma_rates.x + 6u * chroma_rates.y;
    let fine_chunk = texfold_progressive_chunk(block, fine_at + quad * (fine_bits + 6u * chroma_rates.z));
    let across = texfold_progressive_pairs(texfold_progressive_hash(fine_chunk.x, luma_rates.z, fine_flips.x));
    let down = texfold_progressive_pairs(texfold_progressive_hash(fine_chunk.x, 2u * luma_rates.z, fine_flips.y));
    let diagonal = texfold_progressive_pairs(texfold_progressive_hash(fine_chunk.x, fine_bits, fine_flips.z));
    let detail = (texfold_progressive_value(across + down, 2) * luma_scale.z
        + texfold_progressive_value(diagonal, 1) * luma_scale.w) * 0.5;

    let fine_chroma_chunk = texfold_progressive_behind(fine_chunk, fine_bits);
    let fine_ends = chroma_rates.z * vec3<u32>(1u, 3u, 5u);
    let both_fine = vec2<f32>(
        texfold_progressive_three(fine_chroma_chunk, fine_ends, fine_flips),
        texfold_progressive_three(fine_chroma_chunk, fine_ends + vec3<u32>(chroma_rates.z), fine_flips),
    );
    let gray = (luma + detail) * 0.57735026;
    let colour = chroma + both_fine * (chroma_scale.z * 0.5);
    let shift = colour * vec2<f32>(0.70710677, 0.40824828);
    return vec4<f32>(gray + shift.x + shift.y, gray - 2.0 * shift.y, gray - shift.x + shift.y, 0.0);
}

// Four texels of the base, of `size` texels, around the texel at `at`, inside or beyond a border, of an image of `full`, beyond whose borders
// `margin` texels of the base lie; of those of its block alone, which has `cell` texels of the base a side, where that is not 0.
fn texfold_progressive_tap(
    at: vec2<i32>,
    full: vec2<u32>,
    size: vec2<u32>,
    cell: u32,
    margin: f32,
) -> TexfoldTap {
    let last = size - vec2<u32>(1u);
    var low_end = vec2<u32>(0u);
    var high_end = last;
    if TEXFOLD_PROGRESSIVE_APART {
        if cell > 0u {
            low_end = min(vec2<u32>(max(at, vec2<i32>(0))) / 8u * cell, last);
            high_end = min(low_end + vec2<u32>(cell - 1u), last);
        }
    }
    let inner = vec2<f32>(vec2<i32>(size)) - vec2<f32>(2.0 * margin);
    let step = inner / vec2<f32>(vec2<i32>(full));
    let wanted = (vec2<f32>(at) + vec2<f32>(0.5)) * step + vec2<f32>(margin - 0.5);
    let place = clamp(wanted, vec2<f32>(vec2<i32>(low_end)), vec2<f32>(vec2<i32>(high_end)));
    let low = vec2<u32>(vec2<i32>(place));
    return TexfoldTap(low, min(low + vec2<u32>(1u), high_end), place - vec2<f32>(vec2<i32>(low)));
}

// Four texels of the base around the texel at `at` of level `level` of the image, or beyond a border, blended.
fn texfold_progressive_base(at: vec2<i32>, level: u32) -> vec4<f32> {
    let stored = min(level, texfold_progressive_params.base_levels - 1u);
    let size = texfold_level_size(texfold_progressive_params.base_size, stored);
    let full = texfold_level_size(texfold_progressive_params.stored_size, level);
    let margin = f32(i32(texfold_progressive_params.base_margin)) / f32(i32(1u << stored));
    let tap = texfold_progressive_tap(at, full, size, texfold_progressive_params.base_cell, margin);
    let a = texfold_blend(texfold_progressive_base_a, tap, stored);
    var b = a;
    if TEXFOLD_PROGRESSIVE_SPLIT {
        if texfold_progressive_params.swizzle == TEXFOLD_SPLIT {
            b = texfold_blend(texfold_progressive_base_b, tap, stored);
        }
    }
    // No base holds normals.
    return texfold_swizzle_colour(a, b, texfold_progressive_params.swizzle);
}

// Word `index` of the map; beyond its end nothing that counts.
fn texfold_progressive_entry_word(index: u32) -> u32 {
    let row = index >> texfold_progressive_params.entry_row_log2;
    let column = index - (row << texfold_progressive_params.entry_row_log2);
    return textureLoad(texfold_progressive_entries, vec2<u32>(column, row), 0u).x;
}

// What carries places of a block to places of the codebook: the rows of a matrix, for turn `number` of `bits` bits.
fn texfold_progressive_turn(number: u32, bits: u32) -> vec4<f32> {
    let part = (number >> 3u) << (5u - bits);
    var turn = vec2<f32>(1.0, 0.0);
    if part == 1u {
        turn = vec2<f32>(TEXFOLD_PROGRESSIVE_COS, TEXFOLD_PROGRESSIVE_SIN);
    } else if part == 2u {
        turn = vec2<f32>(TEXFOLD_PROGRESSIVE_DIAGONAL, TEXFOLD_PROGRESSIVE_DIAGONAL);
    } else if part == 3u {
        turn = vec2<f32>(TEXFOLD_PROGRESSIVE_SIN, TEXFOLD_PROGRESSIVE_COS);
    }
    if (number & 2u) != 0u {
        turn = vec2<f32>(-turn.y, turn.x);
    }
    if (number & 4u) != 0u {
        turn = -turn;
    }
    let flip = select(1.0, -1.0, (number & 1u) != 0u);
    return vec4<f32>(turn.x, -turn.y * flip, turn.y, turn.x * flip);
}

// The codebook at `place` in texels, blended from four.
fn texfold_progressive_content(place: vec2<f32>, private_one: bool) -> f32 {
    let sizes = texfold_progressive_params.codebooks;
    let size = select(sizes.xy, sizes.zw, private_one);
    let last = vec2<f32>(vec2<i32>(size)) - vec2<f32>(1.0);
    let at = clamp(place - vec2<f32>(0.5), vec2<f32>(0.0), last);
    let low = vec2<u32>(vec2<i32>(at));
    let high = min(low + vec2<u32>(1u), size - vec2<u32>(1u));
    let weight = at - vec2<f32>(vec2<i32>(low));
    var four: vec4<f32>;
    if private_one {
        four = vec4<f32>(
            textureLoad(texfold_progressive_private, low, 0u).x,
            textureLoad(texfold_progressive_private, vec2<u32>(high.x, low.y), 0u).x,
            textureLoad(texfold_progressive_private, vec2<u32>(low.x, high.y), 0u).x,
            textureLoad(texfold_progressive_private, high, 0u).x,
        );
    } else {
        four = vec4<f32>(
            textureLoad(texfold_progressive_public, low, 0u).x,
            textureLoad(texfold_progressive_public, vec2<u32>(high.x, low.y), 0u).x,
            textureLoad(texfold_progressive_public, vec2<u32>(low.x, high.y), 0u).x,
            textureLoad(texfold_progressive_public, high, 0u).x,
        );
    }
    four = (four * 255.0 - vec4<f32>(128.0)) / 127.0;
    let upper = four.x + (four.y - four.x) * weight.x;
    let lower = four.z + (four.w - four.z) * weight.x;
    return upper + (lower - upper) * weight.y;
}

// What the codebook adds to the texel at `at` of level `level`, which lies inside. Rows behind those of the public codebook are
// the private one's.
fn texfold_progressive_detail(at: vec2<u32>, level: u32) -> f32 {
    let form = texfold_progressive_params.map_form;
    let side_log2 = form & 15u;
    let column_bits = (form >> 4u) & 15u;
    let row_bits = (form >> 8u) & 15u;
    let turn_bits = (form >> 12u) & 15u;
    let side = 1u << side_log2;
    let columns = (texfold_level_size(texfold_progressive_params.stored_size, level).x + side - 1u) >> side_log2;
    var index = (at.y >> side_log2) * columns + (at.x >> side_log2);
    for (var above = 0u; above < min(level, TEXFOLD_PROGRESSIVE_LEVELS); above++) {
        let size_above = texfold_level_size(texfold_progressive_params.stored_size, above);
        let blocks = (size_above + vec2<u32>(side - 1u)) >> vec2<u32>(side_log2);
        index += blocks.x * blocks.y;
    }
    let bit = index * (column_bits + row_bits + turn_bits + 5u);
    let low = texfold_progressive_entry_word(bit / 32u);
    let high = texfold_progressive_entry_word(bit / 32u + 1u);
    let entry = (low >> (bit % 32u)) | ((high << 1u) << (31u - bit % 32u));
    let gain = (entry >> (column_bits + row_bits + turn_bits)) & 31u;
    if (gain & 15u) == 0u {
        return 0.0;
    }
    let column = entry & ((1u << column_bits) - 1u);
    let row = (entry >> column_bits) & ((1u << row_bits) - 1u);
    let number = (entry >> (column_bits + row_bits)) & ((1u << turn_bits) - 1u);
    let turn = texfold_progressive_turn(number, turn_bits);
    let away = vec2<f32>(vec2<i32>(at & vec2<u32>(side - 1u))) + vec2<f32>(0.5 - 0.5 * f32(i32(side)));
    let private_one = row >= texfold_progressive_params.codebooks.y;
    let first = select(0u, texfold_progressive_params.codebooks.y, private_one);
    let centre = vec2<f32>(vec2<i32>(vec2<u32>(column, row - first)));
    let moved = vec2<f32>(turn.x * away.x + turn.y * away.y, turn.z * away.x + turn.w * away.y);
    let value = texfold_progressive_content(centre + moved, private_one);
    let step = (gain & 15u) - 1u;
    let odd = select(1.0, 1.4142135, (step & 1u) == 1u);
    let size = texfold_progressive_params.gain_unit * f32(i32(1u << (step >> 1u))) * odd;
    return select(size * value, -size * value, (gain & 16u) != 0u);
}

// The texel at `at` of level `level`, which lies inside, or up to a texel beyond a border: there the base alone.
fn texfold_progressive_load(at: vec2<i32>, level: u32) -> vec4<f32> {
    let inside = texfold_inside(at, texfold_level_size(texfold_progressive_params.stored_size, level));
    let beyond = any(at != vec2<i32>(inside));
    var shown = texfold_progressive_base(at, level);
    if TEXFOLD_PROGRESSIVE_DETAIL {
        if texfold_progressive_params.map_form != 0u && !beyond {
            let detail = texfold_progressive_detail(inside, level);
            shown = clamp(shown + vec4<f32>(detail, detail, detail, 0.0), vec4<f32>(0.0), vec4<f32>(1.0));
        }
    }
    if texfold_progressive_params.class_bits == 0u || beyond {
        return shown;
    }
    return clamp(shown + texfold_progressive_error(inside, level), vec4<f32>(0.0), vec4<f32>(1.0));
}

// The four texels around `uv` in a stored level of `size` texels, by address mode, and how far the place lies from the first. Those beyond a
// border are the outermost, but where addresses are clamped and the base goes on.
fn texfold_progressive_taps(uv: vec2<f32>, size: vec2<u32>, address_mode: u32) -> TexfoldProgressiveTap {
    if TEXFOLD_PROGRESSIVE_BEYOND {
        if texfold_progressive_params.base_margin > 0u && address_mode == TEXFOLD_CLAMP {
            let at = clamp(uv, vec2<f32>(0.0), vec2<f32>(1.0)) * vec2<f32>(vec2<i32>(size)) - vec2<f32>(0.5);
            let low = floor(at);
            let corner = vec2<i32>(low);
            return TexfoldProgressiveTap(corner, corner + vec2<i32>(1), max(at - low, vec2<f32>(0.0)));
        }
    }
    let tap = texfold_tap(uv, size, address_mode);
    return TexfoldProgressiveTap(vec2<i32>(tap.low), vec2<i32>(tap.high), tap.weight);
}

// Bilinear filtering of stored level `stored` at `uv`.
fn texfold_progressive_filtered(uv: vec2<f32>, stored: u32, address_mode: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_progressive_params.stored_size, stored);
    let tap = texfold_progressive_taps(uv, size, address_mode);
    let texels = array<vec4<f32>, 4>(
        texfold_progressive_load(tap.low, stored),
        texfold_progressive_load(vec2<i32>(tap.high.x, tap.low.y), stored),
        texfold_progressive_load(vec2<i32>(tap.low.x, tap.high.y), stored),
        texfold_progressive_load(tap.high, stored),
    );
    return texfold_bilinear(texels, tap.weight);
}

// The texel at `at` of level `level`, which lies inside: as it is stored, or between four of those.
fn texfold_progressive_shown(at: vec2<u32>, level: u32) -> vec4<f32> {
    let shrink = texfold_progressive_params.shrink_log2;
    if TEXFOLD_PROGRESSIVE_SHRUNK {
        if level < shrink {
            let size = texfold_level_size(texfold_progressive_params.size, level);
            let uv = (vec2<f32>(vec2<i32>(at)) + vec2<f32>(0.5)) / vec2<f32>(vec2<i32>(size));
            return texfold_progressive_filtered(uv, 0u, TEXFOLD_CLAMP);
        }
    }
    return texfold_progressive_load(vec2<i32>(at), max(level, shrink) - shrink);
}

// The texel at column `at.x` and row `at.y` of level `level`, clamped to it.
fn texfold_progressive_fetch(at: vec2<i32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_progressive_params.size, level);
    return texfold_progressive_shown(texfold_inside(at, size), level);
}

// The texel of level `level` that `uv` lies in, without filtering; uv is 0 to 1 from the top left, and beyond by the address
// mode.
fn texfold_progressive_nearest(uv: vec2<f32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_progressive_params.size, level);
    return texfold_progressive_shown(texfold_nearest(uv, size, texfold_progressive_params.address_mode), level);
}

// Bilinear filtering at `uv` within level `level`; where that is not stored, of the largest that is.
fn texfold_progressive_bilinear(uv: vec2<f32>, level: u32) -> vec4<f32> {
    let shrink = texfold_progressive_params.shrink_log2;
    return texfold_progressive_filtered(uv, max(level, shrink) - shrink, texfold_progressive_params.address_mode);
}

// Trilinear filtering at `uv`; `lod` is the level, fractions blend two levels, values outside are clamped.
fn texfold_progressive_sample_level(uv: vec2<f32>, lod: f32) -> vec4<f32> {
    let clamped = texfold_lod(lod, texfold_progressive_params.levels);
    let low = floor(clamped);
    let fine = texfold_progressive_bilinear(uv, u32(low));
    if clamped == low {
        return fine;
    }
    let coarse = texfold_progressive_bilinear(uv, u32(low) + 1u);
    return texfold_mix(fine, coarse, clamped - low);
}

// Trilinear filtering at `uv`, which moves by `dx` and `dy` to the pixels right and below.
fn texfold_progressive_sample_grad(uv: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>) -> vec4<f32> {
    return texfold_progressive_sample_level(uv, texfold_level(dx, dy, texfold_progressive_params.size));
}

// The colour at `uv`, trilinear; for fragment shaders in uniform control flow.
fn texfold_progressive_sample(uv: vec2<f32>) -> vec4<f32> {
    return texfold_progressive_sample_grad(uv, dpdx(uv), dpdy(uv));
}
