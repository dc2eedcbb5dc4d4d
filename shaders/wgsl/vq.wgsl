// Vector quantisation: each 4x4 block is a pair of bytes that point into a codebook. CPU twins:
// crates/vq/src/decode.rs.
//
// `image` tells an image from the others of its size: what ImageBinding::image holds, 0 for the first. It is
// the row and 8192 times the column where the image begins in the index plane. Images that fit into one column, one
// below the other, begin at multiples of texfold_vq_params.rows. Colours are as stored: no gamma conversion (see texfold_linear). Every function works in any control flow
// but texfold_vq_sample and texfold_vq_sample_image, which take derivatives.

// The parameters of all images of one size.
struct TexfoldVqParams {
    // Columns and rows of level 0 in texels.
    size: vec2<u32>,
    // Stored mip levels, at least 1.
    levels: u32,
    // TEXFOLD_REPEAT or TEXFOLD_CLAMP.
    address_mode: u32,
    // How texels are read from the codebook's planes.
    swizzle: u32,
    // Rows of the index plane that one image fills.
    rows: u32,
    // Always 0.
    reserved: vec2<u32>,
    // For each level the number of blocks of the levels above it, four levels a vector.
    level_start: array<vec4<u32>, 4>,
}

@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_0) var<uniform> texfold_vq_params: TexfoldVqParams;
// Column and row in the codebook, in texels, for each block.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_1) var texfold_vq_index: texture_2d<u32>;
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_2) var texfold_vq_codebook_a: texture_2d<f32>;
// The same texture as codebook a where there is one plane only.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_3) var texfold_vq_codebook_b: texture_2d<f32>;

// Where the texel at `at` of level `level`, which lies inside, is in the codebook.
fn texfold_vq_place(image: u32, at: vec2<u32>, level: u32) -> vec2<u32> {
    // Without a branch for level 0: software renderers run both sides. Computed from the size, as each further
    // parameter costs them more.
    let width = (texfold_vq_params.size.x + 3u) / 4u;
    let level_width = (texfold_level_size(texfold_vq_params.size, level).x + 3u) / 4u;
    let start = texfold_vq_params.level_start[level / 4u][level % 4u];
    let block = texfold_divide(start + at.y / 4u * level_width + at.x / 4u, width);
    let origin = vec2<u32>(image / 8192u, image % 8192u);
    return textureLoad(texfold_vq_index, origin + block, 0u).xy + at % 4u;
}

// The texel at `at` of level `level`, which lies inside.
fn texfold_vq_load(image: u32, at: vec2<u32>, level: u32) -> vec4<f32> {
    let place = texfold_vq_place(image, at, level);
    let a = textureLoad(texfold_vq_codebook_a, place, 0u);
    var b = a;
    if texfold_vq_params.swizzle == TEXFOLD_SPLIT {
        b = textureLoad(texfold_vq_codebook_b, place, 0u);
    }
    return texfold_swizzle(a, b, texfold_vq_params.swizzle);
}

// The four texels of `tap` in level `level`, blended.
fn texfold_vq_blend(image: u32, tap: TexfoldTap, level: u32) -> vec4<f32> {
    let places = array<vec2<u32>, 4>(
        texfold_vq_place(image, tap.low, level),
        texfold_vq_place(image, vec2<u32>(tap.high.x, tap.low.y), level),
        texfold_vq_place(image, vec2<u32>(tap.low.x, tap.high.y), level),
        texfold_vq_place(image, tap.high, level),
    );
    let a = texfold_bilinear(
        array<vec4<f32>, 4>(
            textureLoad(texfold_vq_codebook_a, places[0], 0u),
            textureLoad(texfold_vq_codebook_a, places[1], 0u),
            textureLoad(texfold_vq_codebook_a, places[2], 0u),
            textureLoad(texfold_vq_codebook_a, places[3], 0u),
        ),
        tap.weight,
    );
    var b = a;
    if texfold_vq_params.swizzle == TEXFOLD_SPLIT {
        b = texfold_bilinear(
            array<vec4<f32>, 4>(
                textureLoad(texfold_vq_codebook_b, places[0], 0u),
                textureLoad(texfold_vq_codebook_b, places[1], 0u),
                textureLoad(texfold_vq_codebook_b, places[2], 0u),
                textureLoad(texfold_vq_codebook_b, places[3], 0u),
            ),
            tap.weight,
        );
    }
    return texfold_swizzle(a, b, texfold_vq_params.swizzle);
}

// The texel at column `at.x` and row `at.y` of level `level`, clamped to it. `level` is below the number of levels.
fn texfold_vq_fetch(image: u32, at: vec2<i32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_vq_params.size, level);
    return texfold_vq_load(image, texfold_inside(at, size), level);
}

// The texel of level `level` that `uv` lies in, without filtering; uv is 0 to 1 from the top left, and beyond by
// the address mode.
fn texfold_vq_nearest(image: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_vq_params.size, level);
    return texfold_vq_load(image, texfold_nearest(uv, size, texfold_vq_params.address_mode), level);
}

// Bilinear filtering at `uv` within one level, across blocks.
fn texfold_vq_bilinear(image: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_vq_params.size, level);
    return texfold_vq_blend(image, texfold_tap(uv, size, texfold_vq_params.address_mode), level);
}

// Trilinear filtering at `uv`; `lod` is the level, fractions blend two levels, values outside are clamped.
fn texfold_vq_sample_level(image: u32, uv: vec2<f32>, lod: f32) -> vec4<f32> {
    let clamped = texfold_lod(lod, texfold_vq_params.levels);
    let low = floor(clamped);
    let fine = texfold_vq_bilinear(image, uv, u32(low));
    if clamped == low {
        return fine;
    }
    let coarse = texfold_vq_bilinear(image, uv, u32(low) + 1u);
    return texfold_mix(fine, coarse, clamped - low);
}

// Trilinear filtering at `uv`, which moves by `dx` and `dy` to the pixels right and below.
fn texfold_vq_sample_grad(image: u32, uv: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>) -> vec4<f32> {
    return texfold_vq_sample_level(image, uv, texfold_level(dx, dy, texfold_vq_params.size));
}

// The colour of image `image` at `uv`, trilinear; for fragment shaders in uniform control flow.
fn texfold_vq_sample_image(image: u32, uv: vec2<f32>) -> vec4<f32> {
    return texfold_vq_sample_grad(image, uv, dpdx(uv), dpdy(uv));
}

// The colour of image 0 at `uv`, trilinear; for fragment shaders in uniform control flow.
fn texfold_vq_sample(uv: vec2<f32>) -> vec4<f32> {
    return texfold_vq_sample_image(0u, uv);
}
