// Residual content with detail from codebooks: what a codebook adds to the blocks of a base, before the residual is added.
// CPU twins: crates/progressive/src/decode.rs. The functions and bindings of residual.wgsl stand behind these.
//
// Colours are as stored: no gamma conversion (see texfold_linear). Every function works in any control flow but
// texfold_progressive_sample, which takes derivatives.

// Most levels of a texture.
const TEXFOLD_PROGRESSIVE_LEVELS: u32 = 16u;
// Cosine and sine of a quarter of a quarter turn.
const TEXFOLD_PROGRESSIVE_COS: f32 = 0.9238795;
const TEXFOLD_PROGRESSIVE_SIN: f32 = 0.38268343;
// Cosine and sine of half a quarter turn.
const TEXFOLD_PROGRESSIVE_DIAGONAL: f32 = 0.70710677;

// Whether the finest levels may not be stored, codebooks be drawn, or a base be padded. Pipelines that draw images without
// need not do what it takes: software renderers run all branches.
override TEXFOLD_PROGRESSIVE_SHRUNK: bool = true;
override TEXFOLD_PROGRESSIVE_DETAIL: bool = true;
override TEXFOLD_PROGRESSIVE_PADDED: bool = true;

// The parameters of one image, before those of its residual content.
struct TexfoldProgressiveParams {
    // Columns and rows of level 0 in texels.
    size: vec2<u32>,
    // Mip levels, those among them that are not stored; at least 1.
    levels: u32,
    // TEXFOLD_REPEAT or TEXFOLD_CLAMP.
    address_mode: u32,
    // Number of finest mip levels not stored; they are upsampled from the finest stored one.
    shrink_log2: u32,
    // How entries of the map are laid out, 4 bits each: binary logarithm of a block's side, bits of a column, of a row and
    // of a rotation; 0 where there is no map.
    map_form: u32,
    // The least gain above none.
    gain_unit: f32,
    // Binary logarithm of the words in a row of the map.
    entry_row_log2: u32,
    // Columns and rows of the public and the private codebook; 0 where there is none.
    codebooks: vec4<u32>,
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
// The map: words, row by row. Where there is none, any texture.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_1) var texfold_progressive_entries: texture_2d<u32>;
// The codebooks. Where there is none, any texture.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_2) var texfold_progressive_public: texture_2d<f32>;
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_3) var texfold_progressive_private: texture_2d<f32>;

// Word `index` of the map; out-of-range reads return a value that is never used.
fn texfold_progressive_entry_word(index: u32) -> u32 {
    let row = index >> texfold_progressive_params.entry_row_log2;
    let column = index - (row << texfold_progressive_params.entry_row_log2);
    return textureLoad(texfold_progressive_entries, vec2<u32>(column, row), 0u).x;
}

// What carries places of a block to places of the codebook: the rows of a matrix, for rotation `number` of `bits` bits.
fn texfold_progressive_rotation(number: u32, bits: u32) -> vec4<f32> {
    let part = (number >> 3u) << (5u - bits);
    var rotation = vec2<f32>(1.0, 0.0);
    if part == 1u {
        rotation = vec2<f32>(TEXFOLD_PROGRESSIVE_COS, TEXFOLD_PROGRESSIVE_SIN);
    } else if part == 2u {
        rotation = vec2<f32>(TEXFOLD_PROGRESSIVE_DIAGONAL, TEXFOLD_PROGRESSIVE_DIAGONAL);
    } else if part == 3u {
        rotation = vec2<f32>(TEXFOLD_PROGRESSIVE_SIN, TEXFOLD_PROGRESSIVE_COS);
    }
    if (number & 2u) != 0u {
        rotation = vec2<f32>(-rotation.y, rotation.x);
    }
    if (number & 4u) != 0u {
        rotation = -rotation;
    }
    let flip = select(1.0, -1.0, (number & 1u) != 0u);
    return vec4<f32>(rotation.x, -rotation.y * flip, rotation.y, rotation.x * flip);
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
    let rotation_bits = (form >> 12u) & 15u;
    let side = 1u << side_log2;
    let columns = (texfold_level_size(texfold_residual_params.size, level).x + side - 1u) >> side_log2;
    var index = (at.y >> side_log2) * columns + (at.x >> side_log2);
    for (var above = 0u; above < min(level, TEXFOLD_PROGRESSIVE_LEVELS); above++) {
        let size_above = texfold_level_size(texfold_residual_params.size, above);
        let blocks = (size_above + vec2<u32>(side - 1u)) >> vec2<u32>(side_log2);
        index += blocks.x * blocks.y;
    }
    let bit = index * (column_bits + row_bits + rotation_bits + 5u);
    let low = texfold_progressive_entry_word(bit / 32u);
    let high = texfold_progressive_entry_word(bit / 32u + 1u);
    let entry = (low >> (bit % 32u)) | ((high << 1u) << (31u - bit % 32u));
    let gain = (entry >> (column_bits + row_bits + rotation_bits)) & 31u;
    if (gain & 15u) == 0u {
        return 0.0;
    }
    let column = entry & ((1u << column_bits) - 1u);
    let row = (entry >> column_bits) & ((1u << row_bits) - 1u);
    let number = (entry >> (column_bits + row_bits)) & ((1u << rotation_bits) - 1u);
    let rotation = texfold_progressive_rotation(number, rotation_bits);
    let away = vec2<f32>(vec2<i32>(at & vec2<u32>(side - 1u))) + vec2<f32>(0.5 - 0.5 * f32(i32(side)));
    let private_one = row >= texfold_progressive_params.codebooks.y;
    let first = select(0u, texfold_progressive_params.codebooks.y, private_one);
    let centre = vec2<f32>(vec2<i32>(vec2<u32>(column, row - first)));
    let moved = vec2<f32>(rotation.x * away.x + rotation.y * away.y, rotation.z * away.x + rotation.w * away.y);
    let value = texfold_progressive_content(centre + moved, private_one);
    let step = (gain & 15u) - 1u;
    let odd = select(1.0, 1.4142135, (step & 1u) == 1u);
    let size = texfold_progressive_params.gain_unit * f32(i32(1u << (step >> 1u))) * odd;
    return select(size * value, -size * value, (gain & 16u) != 0u);
}

// The texel at `at` of level `level`, which lies inside, or up to a texel beyond a border: there the base alone.
fn texfold_progressive_load(at: vec2<i32>, level: u32) -> vec4<f32> {
    let inside = texfold_inside(at, texfold_level_size(texfold_residual_params.size, level));
    let beyond = any(at != vec2<i32>(inside));
    var texel = texfold_residual_base(at, level);
    if TEXFOLD_PROGRESSIVE_DETAIL {
        if texfold_progressive_params.map_form != 0u && !beyond {
            let detail = texfold_progressive_detail(inside, level);
            texel = clamp(texel + vec4<f32>(detail, detail, detail, 0.0), vec4<f32>(0.0), vec4<f32>(1.0));
        }
    }
    if texfold_residual_params.class_bits == 0u || beyond {
        return texel;
    }
    return clamp(texel + texfold_residual_error(inside, level), vec4<f32>(0.0), vec4<f32>(1.0));
}

// The four texels around `uv` in a stored level of `size` texels, by address mode, and how far the place lies from the first. Those beyond a
// border are the outermost, but where addresses are clamped and the base goes on.
fn texfold_progressive_taps(uv: vec2<f32>, size: vec2<u32>, address_mode: u32) -> TexfoldProgressiveTap {
    if TEXFOLD_PROGRESSIVE_PADDED {
        if texfold_residual_params.base_padding > 0u && address_mode == TEXFOLD_CLAMP {
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
    let size = texfold_level_size(texfold_residual_params.size, stored);
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
fn texfold_progressive_texel(at: vec2<u32>, level: u32) -> vec4<f32> {
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
    return texfold_progressive_texel(texfold_inside(at, size), level);
}

// The texel of level `level` that `uv` lies in, without filtering; uv is 0 to 1 from the top left, and beyond by the address
// mode.
fn texfold_progressive_nearest(uv: vec2<f32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_progressive_params.size, level);
    return texfold_progressive_texel(texfold_nearest(uv, size, texfold_progressive_params.address_mode), level);
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
