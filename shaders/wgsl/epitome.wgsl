// Epitome factoring: images as a map of leaves that point into a small epitome. CPU twins:
// crates/epitome/src/decode.rs.
//
// An image is covered by blocks, each split into at most 2 x 2 and again 2 x 2 quadtree leaves. A leaf has one map entry: where in an
// epitome its centre lies, the 2x2 matrix that maps its texels to places around that one, and the gain and offset of
// its content. Colours are as stored: no gamma conversion (see texfold_linear). Every
// function works in any control flow but texfold_epitome_sample, which takes derivatives.

// Number of a matrix's coefficient that stands for 1.
const TEXFOLD_EPITOME_LINEAR_ONE: f32 = 8192.0;
// Number of a gain that stands for 1.
const TEXFOLD_EPITOME_GAIN_ONE: f32 = 128.0;
// Mip levels of the image that are read from the epitome; further ones come from the coarse chain.
const TEXFOLD_EPITOME_FINE_LEVELS: u32 = 3u;

// The parameters of one image.
struct TexfoldEpitomeParams {
    // Columns and rows of level 0 in texels.
    size: vec2<u32>,
    // Stored mip levels, at least 1.
    levels: u32,
    // TEXFOLD_REPEAT or TEXFOLD_CLAMP.
    address_mode: u32,
    // How texels are read from the content planes.
    swizzle: u32,
    // 1: the second plane is a second epitome, and map entries say which; 0: it holds further channels or is the first.
    mixed: u32,
    // Texels a side of a block.
    block: u32,
    // 1: blocks are split as their words say; 0: each block is one leaf.
    split: u32,
    // Blocks in a row of the image.
    columns: u32,
    // First word of the image's blocks, or its first entry where blocks are not split.
    tree_start: u32,
    // First word of the entries.
    entry_start: u32,
    // Bytes of a map entry, 2 to 6.
    entry_bytes: u32,
    // Bits of the position's column and of its row in a map entry.
    x_bits: u32,
    y_bits: u32,
    // How many of them are a fraction of a texel.
    fraction_bits: u32,
    // Bits of the number of the gain and offset, and of the matrix, in a map entry.
    gain_offset_bits: u32,
    matrix_bits: u32,
    // First word of the 2x2 matrices, two words each.
    matrix_start: u32,
    // First word of the gains and offsets, two words each.
    gain_offset_start: u32,
    // Binary logarithm of the words in a row of the map.
    row_log2: u32,
    // Columns and rows of the first epitome in texels.
    plane_a: vec2<u32>,
    // Columns and rows of the second, or of the first again.
    plane_b: vec2<u32>,
    // Mip levels of the epitome.
    plane_levels: u32,
    // How texels are read from the coarse chain.
    coarse_swizzle: u32,
    // Texels a side of the smallest leaf.
    cell: u32,
    // Half the width of the seams along borders of leaves where both are blended at level 0, in eighths of a texel.
    seam_width: u32,
}

// A leaf of the image.
struct TexfoldEpitomeLeaf {
    // Its upper left texel.
    corner: vec2<u32>,
    // Texels a side.
    side: u32,
    // Number of its entry: no other leaf has it.
    entry: u32,
}

// Factor on each channel, and what is added then.
struct TexfoldEpitomeGainOffset {
    gain: vec4<f32>,
    offset: vec4<f32>,
}

// Where a leaf's content comes from.
struct TexfoldEpitomeSource {
    // Place of the leaf's centre in the epitome, in texels.
    position: vec2<f32>,
    // Rows of the 2x2 matrix: (xx, xy) and (yx, yy).
    matrix: vec4<f32>,
    gain_offset: TexfoldEpitomeGainOffset,
    // 1 for the second epitome.
    plane: u32,
}

@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_0) var<uniform> texfold_epitome_params: TexfoldEpitomeParams;
// The blocks of all images, the matrices, the gains and offsets, and the map entries, as 32-bit words.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_1) var texfold_epitome_map: texture_2d<u32>;
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_2) var texfold_epitome_plane_a: texture_2d<f32>;
// The second epitome or further channels; the same texture as plane a where there is neither.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_3) var texfold_epitome_plane_b: texture_2d<f32>;
// Levels of the image from TEXFOLD_EPITOME_FINE_LEVELS on; any texture where there are none.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_4) var texfold_epitome_coarse_plane: texture_2d<f32>;

// Word `index` of the map.
fn texfold_epitome_word(index: u32) -> u32 {
    let row = index >> texfold_epitome_params.row_log2;
    let column = index - (row << texfold_epitome_params.row_log2);
    return textureLoad(texfold_epitome_map, vec2<u32>(column, row), 0u).x;
}

// The leaf that holds the texel at `at` of level 0, which lies inside.
fn texfold_epitome_leaf(at: vec2<u32>) -> TexfoldEpitomeLeaf {
    let side = texfold_epitome_params.block;
    let across = texfold_divide(at.x, side);
    let down = texfold_divide(at.y, side);
    let inner = vec2<u32>(across.x, down.x);
    let corner = at - inner;
    let block = texfold_epitome_params.tree_start + down.y * texfold_epitome_params.columns + across.y;
    if texfold_epitome_params.split == 0u {
        return TexfoldEpitomeLeaf(corner, side, block);
    }
    let word = texfold_epitome_word(block);
    let first = word >> 5u;
    if (word & 1u) == 0u {
        return TexfoldEpitomeLeaf(corner, side, first);
    }
    // Entries of a block stand quarter by quarter; a quarter that is split has four.
    let half = side >> 1u;
    let quarter = select(vec2<u32>(0u), vec2<u32>(1u), inner >= vec2<u32>(half));
    let number = quarter.y * 2u + quarter.x;
    let splits = (word >> 1u) & 15u;
    let entry = first + number + 3u * countOneBits(splits & ((1u << number) - 1u));
    let quarter_corner = corner + quarter * half;
    if ((splits >> number) & 1u) == 0u {
        return TexfoldEpitomeLeaf(quarter_corner, half, entry);
    }
    let least = half >> 1u;
    let sixteenth = select(vec2<u32>(0u), vec2<u32>(1u), inner - quarter * half >= vec2<u32>(least));
    return TexfoldEpitomeLeaf(quarter_corner + sixteenth * least, least, entry + sixteenth.y * 2u + sixteenth.x);
}

// Bits `start` to `start + count - 1` of the 64 bits `low`, `high`; `count` is below 32.
fn texfold_epitome_bits(low: u32, high: u32, start: u32, count: u32) -> u32 {
    // Shifts count modulo 32. That by `start` bits to the left is made in two steps, as a shift by 32 is none.
    let across = (low >> start) | ((high << 1u) << (31u - start));
    return select(across, high >> (start - 32u), start >= 32u) & ((1u << count) - 1u);
}

// Entry `entry` of the map.
fn texfold_epitome_source(entry: u32) -> TexfoldEpitomeSource {
    let byte = entry * texfold_epitome_params.entry_bytes;
    let word = texfold_epitome_params.entry_start + (byte >> 2u);
    let low = texfold_epitome_word(word);
    let high = texfold_epitome_word(word + 1u);
    let x_start = (byte & 3u) * 8u;
    let y_start = x_start + texfold_epitome_params.x_bits;
    let gain_offset_start = y_start + texfold_epitome_params.y_bits;
    let matrix_start = gain_offset_start + texfold_epitome_params.gain_offset_bits;
    let plane_start = matrix_start + texfold_epitome_params.matrix_bits;
    let x = texfold_epitome_bits(low, high, x_start, texfold_epitome_params.x_bits);
    let y = texfold_epitome_bits(low, high, y_start, texfold_epitome_params.y_bits);
    let gain_offset_number = texfold_epitome_bits(low, high, gain_offset_start, texfold_epitome_params.gain_offset_bits);
    let matrix_number = texfold_epitome_bits(low, high, matrix_start, texfold_epitome_params.matrix_bits);
    let plane = texfold_epitome_bits(low, high, plane_start, texfold_epitome_params.mixed);
    let scale = 1.0 / f32(i32(1u << texfold_epitome_params.fraction_bits));
    let gain_offset = texfold_epitome_params.gain_offset_start + 2u * gain_offset_number;
    let matrix = texfold_epitome_params.matrix_start + 2u * matrix_number;
    return TexfoldEpitomeSource(
        vec2<f32>(vec2<i32>(vec2<u32>(x, y))) * scale,
        texfold_epitome_matrix(texfold_epitome_word(matrix), texfold_epitome_word(matrix + 1u)),
        texfold_epitome_gain_offset(texfold_epitome_word(gain_offset), texfold_epitome_word(gain_offset + 1u)),
        plane,
    );
}

// The two signed 16-bit halves of a word, low half first.
fn texfold_epitome_halves(word: u32) -> vec2<f32> {
    return vec2<f32>(bitcast<vec2<i32>>(vec2<u32>(word << 16u, word)) >> vec2<u32>(16u));
}

// The 2x2 matrix that two words hold: its rows, one a word.
fn texfold_epitome_matrix(first: u32, second: u32) -> vec4<f32> {
    let rows = vec4<f32>(texfold_epitome_halves(first), texfold_epitome_halves(second));
    return rows * (1.0 / TEXFOLD_EPITOME_LINEAR_ONE);
}

// Gain and offset that two words hold: bytes for red, green and blue each. Alpha is left as it is.
fn texfold_epitome_gain_offset(first: u32, second: u32) -> TexfoldEpitomeGainOffset {
    let shifts = vec3<u32>(0u, 8u, 16u);
    let gain = vec3<f32>(vec3<i32>((vec3<u32>(first) >> shifts) & vec3<u32>(255u)));
    let offset = vec3<f32>(vec3<i32>((vec3<u32>(second) >> shifts) & vec3<u32>(255u))) - vec3<f32>(128.0);
    return TexfoldEpitomeGainOffset(
        vec4<f32>(gain, TEXFOLD_EPITOME_GAIN_ONE) * (1.0 / TEXFOLD_EPITOME_GAIN_ONE),
        vec4<f32>(offset, 0.0) * (1.0 / 255.0),
    );
}

// Level of the epitome to read for level `level` of the image: one finer, as blending four texels halves once more,
// and finer still by what the content is stored smaller.
fn texfold_epitome_plane_level(matrix: vec4<f32>, level: u32) -> u32 {
    let across = matrix.x * matrix.x + matrix.z * matrix.z;
    let down = matrix.y * matrix.y + matrix.w * matrix.w;
    let squared = max(across, down);
    let octave = i32(squared >= 0.125) + i32(squared >= 0.5) + i32(squared >= 2.0) - 3;
    return u32(clamp(i32(level) + octave, 0, i32(texfold_epitome_params.plane_levels) - 1));
}

// The place in the epitome, in texels of level 0, for the place `at` of the image; kept within the leaf's own content.
fn texfold_epitome_place(
    source: TexfoldEpitomeSource,
    leaf: TexfoldEpitomeLeaf,
    at: vec2<f32>,
    plane_level: u32,
) -> vec2<f32> {
    let half = f32(i32(leaf.side)) * 0.5;
    let away = at - (vec2<f32>(vec2<i32>(leaf.corner)) + vec2<f32>(half));
    let moved = source.matrix.xz * away.x + source.matrix.yw * away.y;
    let margin = 0.5 * f32(i32(1u << plane_level));
    let rows = abs(source.matrix.xz) + abs(source.matrix.yw);
    let reach = max(rows * half - vec2<f32>(margin), vec2<f32>(0.0));
    return source.position + clamp(moved, -reach, reach);
}

// The leaf's colour at the place `at` of the image, in texels of level 0, for level `level` of the image.
fn texfold_epitome_content(leaf: TexfoldEpitomeLeaf, at: vec2<f32>, level: u32) -> vec4<f32> {
    let source = texfold_epitome_source(leaf.entry);
    let plane_level = texfold_epitome_plane_level(source.matrix, level);
    let place = texfold_epitome_place(source, leaf, at, plane_level);
    let texel = texfold_epitome_read(source.plane, place, plane_level);
    return clamp(texel * source.gain_offset.gain + source.gain_offset.offset, vec4<f32>(0.0), vec4<f32>(1.0));
}

// The leaf of the texel at `at` of level `level`, one of the levels that are read from the epitome.
fn texfold_epitome_leaf_at(at: vec2<u32>, level: u32) -> TexfoldEpitomeLeaf {
    // The texel's centre in texels of level 0, rounded down.
    let centre = ((at * 2u + vec2<u32>(1u)) << vec2<u32>(level)) >> vec2<u32>(1u);
    return texfold_epitome_leaf(min(centre, texfold_epitome_params.size - vec2<u32>(1u)));
}

// The texel at `at` of level `level`, which lies inside.
fn texfold_epitome_load(at: vec2<u32>, level: u32) -> vec4<f32> {
    if level >= TEXFOLD_EPITOME_FINE_LEVELS {
        return texfold_epitome_coarse(at, level);
    }
    let leaf = texfold_epitome_leaf_at(at, level);
    let place = (vec2<f32>(vec2<i32>(at)) + vec2<f32>(0.5)) * f32(i32(1u << level));
    return texfold_epitome_content(leaf, place, level);
}

// The texel at `at` of level `level`, one of the coarse chain. An image whose mip chain ends before that of others in
// its set repeats its last level, which the texture holds once.
fn texfold_epitome_coarse(at: vec2<u32>, level: u32) -> vec4<f32> {
    let last = textureNumLevels(texfold_epitome_coarse_plane) - 1u;
    let stored = min(level - TEXFOLD_EPITOME_FINE_LEVELS, last);
    let texel = textureLoad(texfold_epitome_coarse_plane, at, stored);
    return texfold_swizzle(texel, texel, texfold_epitome_params.coarse_swizzle);
}

// The colour that `leaf`, that of texel `at` of level `level`, has at `away` (texels of that level) from that
// texel's centre; the leaf's nearest texel centre where that is outside of the leaf. The level is one of those that
// are read from the epitome.
fn texfold_epitome_near(leaf: TexfoldEpitomeLeaf, at: vec2<u32>, away: vec2<f32>, level: u32) -> vec4<f32> {
    let scale = f32(i32(1u << level));
    let place = (vec2<f32>(vec2<i32>(at)) + vec2<f32>(0.5) + away) * scale;
    let corner = vec2<f32>(vec2<i32>(leaf.corner));
    let margin = vec2<f32>(0.5 * scale);
    // A leaf at the image's edge ends with the image.
    let image = vec2<f32>(vec2<i32>(texfold_epitome_params.size));
    let end = min(corner + vec2<f32>(f32(i32(leaf.side))), image);
    return texfold_epitome_content(leaf, max(min(place, end - margin), corner + margin), level);
}

// The texel at column `at.x` and row `at.y` of level `level`, clamped to it. `level` is below the number of levels.
fn texfold_epitome_fetch(at: vec2<i32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_epitome_params.size, level);
    return texfold_epitome_load(texfold_inside(at, size), level);
}

// The texel of level `level` that `uv` lies in, without filtering; uv is 0 to 1 from the top left, and beyond by
// the address mode.
fn texfold_epitome_nearest(uv: vec2<f32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_epitome_params.size, level);
    return texfold_epitome_load(texfold_nearest(uv, size, texfold_epitome_params.address_mode), level);
}

// Two texels along each axis whose leaves are blended at a place.
struct TexfoldEpitomeSeam {
    // The nearer ones to the image's upper left corner, and the others.
    low: vec2<u32>,
    high: vec2<u32>,
    // How far the place lies from the centre of `low`, in texels.
    away: vec2<f32>,
    // Weights of `high`.
    weight: vec2<f32>,
}

// The texels around a place; within a seam along a border of leaves those on both sides of it, at level 0, of `size` texels.
fn texfold_epitome_seam(tap: TexfoldTap, size: vec2<u32>, level: u32) -> TexfoldEpitomeSeam {
    let half = f32(texfold_epitome_params.seam_width) * 0.125;
    let cell = f32(texfold_epitome_params.cell);
    let at = vec2<f32>(vec2<i32>(tap.low)) + tap.weight + vec2<f32>(0.5);
    let border = floor(at * (1.0 / cell) + vec2<f32>(0.5)) * cell;
    let beyond = at - border;
    let is_inside = (tap.high == tap.low + vec2<u32>(1u))
        & (border > vec2<f32>(0.0))
        & (border < vec2<f32>(vec2<i32>(size)))
        & (abs(beyond) < vec2<f32>(half))
        & vec2<bool>((level == 0u) & (half > 0.5));
    // No border inside of the image is 0.
    let behind = max(vec2<u32>(vec2<i32>(border)), vec2<u32>(1u));
    return TexfoldEpitomeSeam(
        select(tap.low, behind - vec2<u32>(1u), is_inside),
        select(tap.high, behind, is_inside),
        select(tap.weight, beyond + vec2<f32>(0.5), is_inside),
        select(tap.weight, vec2<f32>(0.5) + beyond * (0.5 / half), is_inside),
    );
}

// Continuous reconstruction within one level: the leaves of the four nearest texels, or those around a border of leaves, each
// read at the place itself, blended. Inside a leaf all four are the same, and one of them is read.
fn texfold_epitome_bilinear(uv: vec2<f32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_epitome_params.size, level);
    let tap = texfold_tap(uv, size, texfold_epitome_params.address_mode);
    if level >= TEXFOLD_EPITOME_FINE_LEVELS {
        return texfold_bilinear(
            array<vec4<f32>, 4>(
                texfold_epitome_coarse(tap.low, level),
                texfold_epitome_coarse(vec2<u32>(tap.high.x, tap.low.y), level),
                texfold_epitome_coarse(vec2<u32>(tap.low.x, tap.high.y), level),
                texfold_epitome_coarse(tap.high, level),
            ),
            tap.weight,
        );
    }
    let seam = texfold_epitome_seam(tap, size, level);
    let upper_right = vec2<u32>(seam.high.x, seam.low.y);
    let lower_left = vec2<u32>(seam.low.x, seam.high.y);
    // At a clamped edge both texels of an axis are the same one, and its centre is read.
    let edge = seam.high == seam.low;
    let ahead = select(seam.away, vec2<f32>(0.0), edge);
    let back = select(seam.away - vec2<f32>(1.0), vec2<f32>(0.0), edge);
    let first = texfold_epitome_leaf_at(seam.low, level);
    let last = texfold_epitome_leaf_at(seam.high, level);
    // Read ahead of the branch, as both sides need it: software renderers run both.
    let nearest = texfold_epitome_near(first, seam.low, ahead, level);
    if all(seam.high == seam.low + vec2<u32>(1u)) & (first.entry == last.entry) {
        return nearest;
    }
    let right = texfold_epitome_leaf_at(upper_right, level);
    let left = texfold_epitome_leaf_at(lower_left, level);
    return texfold_bilinear(
        array<vec4<f32>, 4>(
            nearest,
            texfold_epitome_near(right, upper_right, vec2<f32>(back.x, ahead.y), level),
            texfold_epitome_near(left, lower_left, vec2<f32>(ahead.x, back.y), level),
            texfold_epitome_near(last, seam.high, back, level),
        ),
        seam.weight,
    );
}

// Trilinear filtering at `uv`; `lod` is the level, fractions blend two levels, values outside are clamped.
fn texfold_epitome_sample_level(uv: vec2<f32>, lod: f32) -> vec4<f32> {
    let clamped = texfold_lod(lod, texfold_epitome_params.levels);
    let low = floor(clamped);
    let fine = texfold_epitome_bilinear(uv, u32(low));
    if clamped == low {
        return fine;
    }
    let coarse = texfold_epitome_bilinear(uv, u32(low) + 1u);
    return texfold_mix(fine, coarse, clamped - low);
}

// Trilinear filtering at `uv`, which moves by `dx` and `dy` to the pixels right and below.
fn texfold_epitome_sample_grad(uv: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>) -> vec4<f32> {
    return texfold_epitome_sample_level(uv, texfold_level(dx, dy, texfold_epitome_params.size));
}

// The colour at `uv`, trilinear; for fragment shaders in uniform control flow.
fn texfold_epitome_sample(uv: vec2<f32>) -> vec4<f32> {
    return texfold_epitome_sample_grad(uv, dpdx(uv), dpdy(uv));
}
