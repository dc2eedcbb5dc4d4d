// From texture coordinates to texels. CPU twins: crates/core/src/address.rs.

// Address mode: coordinates outside [0, 1) start again at the other side.
const TEXFOLD_REPEAT: u32 = 0u;
// Address mode: coordinates outside are moved to the edge.
const TEXFOLD_CLAMP: u32 = 1u;
// 1 - 2^-20: see texfold_divide.
const TEXFOLD_BELOW_ONE: f32 = 0.99999905;

// The four texels around a place, all of them inside the texture, and how far the place lies from the first.
struct TexfoldTap {
    // Left column and upper row.
    low: vec2<u32>,
    // Right column and lower row.
    high: vec2<u32>,
    // Weight of the right column and of the lower row, 0 to 1.
    weight: vec2<f32>,
}

// Moves `uv` into 0 to 1 in repeat mode. 1 itself comes from negative numbers too small to differ from 0.
fn texfold_fold(uv: vec2<f32>, mode: u32) -> vec2<f32> {
    return select(uv, uv - floor(uv), mode == TEXFOLD_REPEAT);
}

// The four texels around `uv` in a level of `size` texels; (0, 0) is the top left of the image, (1, 1) its
// bottom right, and beyond these the address mode counts.
fn texfold_tap(uv: vec2<f32>, size: vec2<u32>, mode: u32) -> TexfoldTap {
    let at = texfold_fold(uv, mode) * vec2<f32>(vec2<i32>(size)) - vec2<f32>(0.5);
    let corner = floor(at);
    let last = vec2<i32>(size) - vec2<i32>(1);
    // Folded coordinates are beyond an edge by one texel at most: no division brings them inside.
    let low = clamp(vec2<i32>(corner), vec2<i32>(-1), last);
    let around = mode == TEXFOLD_REPEAT;
    let before = select(vec2<i32>(0), last, around);
    let behind = select(last, vec2<i32>(0), around);
    let weight = at - corner;
    return TexfoldTap(
        vec2<u32>(select(low, before, low < vec2<i32>(0))),
        vec2<u32>(select(low + vec2<i32>(1), behind, low >= last)),
        // Infinity minus itself is no number, and so not above 0.
        select(vec2<f32>(0.0), weight, weight > vec2<f32>(0.0)),
    );
}

// The texel of a level of `size` texels that `uv` lies in, by address mode.
fn texfold_nearest(uv: vec2<f32>, size: vec2<u32>, mode: u32) -> vec2<u32> {
    return texfold_inside(vec2<i32>(texfold_fold(uv, mode) * vec2<f32>(vec2<i32>(size))), size);
}

// The texel at column `at.x` and row `at.y` of a level of `size` texels, clamped to it.
fn texfold_inside(at: vec2<i32>, size: vec2<u32>) -> vec2<u32> {
    return vec2<u32>(clamp(at, vec2<i32>(0), vec2<i32>(size) - vec2<i32>(1)));
}

// Size in texels of mip level `level` (0 to 31) of an image of `size` texels.
fn texfold_level_size(size: vec2<u32>, level: u32) -> vec2<u32> {
    return max(size >> vec2<u32>(level), vec2<u32>(1u));
}

// Mip level for a pixel that moves `dx` and `dy` in uv from its neighbours; below 0 the texture is magnified.
fn texfold_level(dx: vec2<f32>, dy: vec2<f32>, size: vec2<u32>) -> f32 {
    let across = dx * vec2<f32>(size);
    let down = dy * vec2<f32>(size);
    let squared = max(dot(across, across), dot(down, down));
    return 0.5 * log2(max(squared, 1e-12));
}

// The level to look up for mip level `lod` of `levels`: 0 to levels - 1. What is no number becomes 0.
fn texfold_lod(lod: f32, levels: u32) -> f32 {
    return select(0.0, min(lod, f32(levels - 1u)), lod > 0.0);
}

// `value` modulo and over `divisor`, exactly, for values below 2^31, divisors from 1 to 2^24 and quotients below
// 2^18. GPUs and software renderers divide floats much faster than integers.
fn texfold_divide(value: u32, divisor: u32) -> vec2<u32> {
    // Conversion, division (2.5 units in the last place on a GPU) and product are off by less than 2^-20 together:
    // scaled down by that much the estimate is the quotient or one less.
    let share = TEXFOLD_BELOW_ONE / f32(i32(divisor));
    let quotient = u32(i32(f32(i32(value)) * share));
    let rest = value - quotient * divisor;
    return select(vec2<u32>(rest, quotient), vec2<u32>(rest - divisor, quotient + 1u), rest >= divisor);
}
