// Blending of fetched texels. CPU twins: crates/core/src/sample.rs.

// `a` at weight 0, `b` at weight 1.
fn texfold_mix(a: vec4<f32>, b: vec4<f32>, weight: f32) -> vec4<f32> {
    return a + (b - a) * weight;
}

// Blends the four texels around a place: upper left, upper right, lower left, lower right. `weight` (0 to 1) is
// that of the right column and of the lower row.
fn texfold_bilinear(texels: array<vec4<f32>, 4>, weight: vec2<f32>) -> vec4<f32> {
    let upper = texfold_mix(texels[0], texels[1], weight.x);
    let lower = texfold_mix(texels[2], texels[3], weight.x);
    return texfold_mix(upper, lower, weight.y);
}

// The four texels of `tap` in level `level` of a plane, blended.
fn texfold_blend(plane: texture_2d<f32>, tap: TexfoldTap, level: u32) -> vec4<f32> {
    let texels = array<vec4<f32>, 4>(
        textureLoad(plane, tap.low, level),
        textureLoad(plane, vec2<u32>(tap.high.x, tap.low.y), level),
        textureLoad(plane, vec2<u32>(tap.low.x, tap.high.y), level),
        textureLoad(plane, tap.high, level),
    );
    return texfold_bilinear(texels, tap.weight);
}

// Rebuilds the third component of a unit normal from the first two, all stored as v * 0.5 + 0.5.
fn texfold_normal_z(x: f32, y: f32) -> vec3<f32> {
    let nx = x * 2.0 - 1.0;
    let ny = y * 2.0 - 1.0;
    let z = sqrt(max(1.0 - nx * nx - ny * ny, 0.0));
    return vec3<f32>(x, y, z * 0.5 + 0.5);
}

// Swizzle: plane a holds red, green, blue and alpha.
const TEXFOLD_RGBA: u32 = 0u;
// Swizzle: plane a holds red, green and blue; alpha is 1.
const TEXFOLD_RGB: u32 = 1u;
// Swizzle: plane a holds gray; alpha is 1.
const TEXFOLD_GRAY: u32 = 2u;
// Swizzle: plane a holds gray and alpha.
const TEXFOLD_GRAY_ALPHA: u32 = 3u;
// Swizzle: plane a holds red and green, plane b blue; alpha is 1.
const TEXFOLD_SPLIT: u32 = 4u;
// Swizzle: plane a holds x and y of a unit normal; alpha is 1.
const TEXFOLD_NORMAL: u32 = 5u;

// One texel from the values `a` and `b` that its planes hold; `kind` is one of the swizzles above but that of normals.
fn texfold_swizzle_colour(a: vec4<f32>, b: vec4<f32>, kind: u32) -> vec4<f32> {
    // Without branches: software renderers run all of them.
    let gray = (kind == TEXFOLD_GRAY) | (kind == TEXFOLD_GRAY_ALPHA);
    let blue = select(a.z, b.x, kind == TEXFOLD_SPLIT);
    let alpha = select(1.0, a.w, kind == TEXFOLD_RGBA);
    return vec4<f32>(
        a.x,
        select(a.y, a.x, gray),
        select(blue, a.x, gray),
        select(alpha, a.y, kind == TEXFOLD_GRAY_ALPHA),
    );
}

// One texel from the values `a` and `b` that its planes hold; `kind` is one of the swizzles above. Blended values
// give a blended texel; a normal gets back its length of 1.
fn texfold_swizzle(a: vec4<f32>, b: vec4<f32>, kind: u32) -> vec4<f32> {
    let colour = texfold_swizzle_colour(a, b, kind);
    let normal = vec4<f32>(texfold_normal_z(a.x, a.y), 1.0);
    return select(colour, normal, kind == TEXFOLD_NORMAL);
}

// Decodes one sRGB value in [0, 1] to linear light (IEC 61966-2-1). CPU twin: image::srgb_to_linear.
fn texfold_srgb_to_linear(value: f32) -> f32 {
    let curve = pow((max(value, 0.04045) + 0.055) / 1.055, 2.4);
    return select(curve, value / 12.92, value <= 0.04045);
}

// Decodes the colour of an sRGB texel to linear light; alpha stays.
fn texfold_linear(texel: vec4<f32>) -> vec4<f32> {
    return vec4<f32>(
        texfold_srgb_to_linear(texel.x),
        texfold_srgb_to_linear(texel.y),
        texfold_srgb_to_linear(texel.z),
        texel.w,
    );
}
