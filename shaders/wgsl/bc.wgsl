// Plain block compression: texels of planes that the GPU decodes. CPU twins: crates/bc/src/decode.rs.
//
// Colours are as stored: no gamma conversion (see texfold_linear). Every function works in any control flow but
// texfold_bc_sample, which takes derivatives.

// Whether a plane may be smaller than its source. Right for every image; a pipeline that draws none of these may set
// it to false. That spares software renderers, which run the loads of every branch, four loads in each of
// texfold_bc_fetch and texfold_bc_nearest.
override TEXFOLD_BC_REDUCED: bool = true;

// The parameters of one image.
struct TexfoldBcParams {
    // Columns and rows of the source.
    size: vec2<u32>,
    // Columns and rows of the stored plane.
    plane_size: vec2<u32>,
    // Stored mip levels, at least 1.
    levels: u32,
    // TEXFOLD_REPEAT or TEXFOLD_CLAMP.
    address_mode: u32,
    // How texels are read from the planes.
    swizzle: u32,
    // 1 where the plane is smaller than the source.
    reduced: u32,
}

@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_0) var<uniform> texfold_bc_params: TexfoldBcParams;
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_1) var texfold_bc_plane_a: texture_2d<f32>;
// The same texture as plane a where there is one plane only.
@group(TEXFOLD_GROUP) @binding(TEXFOLD_BINDING_2) var texfold_bc_plane_b: texture_2d<f32>;

// The stored texel at `at` of plane level `level`; `at` lies inside. An image whose mip chain ends before that of
// others in its set repeats its last level, which the texture holds once.
fn texfold_bc_load(at: vec2<u32>, level: u32) -> vec4<f32> {
    let stored = min(level, textureNumLevels(texfold_bc_plane_a) - 1u);
    let a = textureLoad(texfold_bc_plane_a, at, stored);
    var b = a;
    if texfold_bc_params.swizzle == TEXFOLD_SPLIT {
        b = textureLoad(texfold_bc_plane_b, at, stored);
    }
    return texfold_swizzle(a, b, texfold_bc_params.swizzle);
}

// The four stored texels of `tap` in plane level `level`, blended.
fn texfold_bc_blend(tap: TexfoldTap, level: u32) -> vec4<f32> {
    let stored = min(level, textureNumLevels(texfold_bc_plane_a) - 1u);
    let a = texfold_blend(texfold_bc_plane_a, tap, stored);
    var b = a;
    if texfold_bc_params.swizzle == TEXFOLD_SPLIT {
        b = texfold_blend(texfold_bc_plane_b, tap, stored);
    }
    return texfold_swizzle(a, b, texfold_bc_params.swizzle);
}

// The texel at `at` of level `level` of the source's size, which lies inside.
fn texfold_bc_texel(at: vec2<u32>, level: u32) -> vec4<f32> {
    if TEXFOLD_BC_REDUCED {
        if texfold_bc_params.reduced != 0u {
            let size = texfold_level_size(texfold_bc_params.size, level);
            let uv = (vec2<f32>(at) + vec2<f32>(0.5)) / vec2<f32>(size);
            let plane_size = texfold_level_size(texfold_bc_params.plane_size, level);
            return texfold_bc_blend(texfold_tap(uv, plane_size, TEXFOLD_CLAMP), level);
        }
    }
    return texfold_bc_load(at, level);
}

// The texel at column `at.x` and row `at.y` of level `level` of the source's size, clamped to it. `level` is below
// the number of levels.
fn texfold_bc_fetch(at: vec2<i32>, level: u32) -> vec4<f32> {
    return texfold_bc_texel(texfold_inside(at, texfold_level_size(texfold_bc_params.size, level)), level);
}

// The texel of level `level` that `uv` lies in, without filtering; uv is 0 to 1 from the top left, and beyond by
// the address mode.
fn texfold_bc_nearest(uv: vec2<f32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_bc_params.size, level);
    return texfold_bc_texel(texfold_nearest(uv, size, texfold_bc_params.address_mode), level);
}

// Bilinear filtering at `uv` within stored level `level`.
fn texfold_bc_bilinear(uv: vec2<f32>, level: u32) -> vec4<f32> {
    let size = texfold_level_size(texfold_bc_params.plane_size, level);
    return texfold_bc_blend(texfold_tap(uv, size, texfold_bc_params.address_mode), level);
}

// Trilinear filtering at `uv`; `lod` is the stored level, fractions blend two levels, values outside are clamped.
fn texfold_bc_sample_level(uv: vec2<f32>, lod: f32) -> vec4<f32> {
    let clamped = texfold_lod(lod, texfold_bc_params.levels);
    let low = floor(clamped);
    let fine = texfold_bc_bilinear(uv, u32(low));
    if clamped == low {
        return fine;
    }
    let coarse = texfold_bc_bilinear(uv, u32(low) + 1u);
    return texfold_mix(fine, coarse, clamped - low);
}

// Trilinear filtering at `uv`, which moves by `dx` and `dy` to the pixels right and below.
fn texfold_bc_sample_grad(uv: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>) -> vec4<f32> {
    return texfold_bc_sample_level(uv, texfold_level(dx, dy, texfold_bc_params.plane_size));
}

// The colour at `uv`, trilinear; for fragment shaders in uniform control flow.
fn texfold_bc_sample(uv: vec2<f32>) -> vec4<f32> {
    return texfold_bc_sample_grad(uv, dpdx(uv), dpdy(uv));
}
