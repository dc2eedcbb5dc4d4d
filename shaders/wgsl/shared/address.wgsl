// From texture coordinates to texels. CPU twins: crates/core/src/address.rs.

// Address mode: coordinates outside [0, 1) start again at the other side.
const TEXFOLD_REPEAT: u32 = 0u;
// Address mode: coordinates outside are moved to the edge.
const TEXFOLD_CLAMP: u32 = 1u;

// The upper left of the four texels around a place, and how far the place lies from it.
struct TexfoldTap {
    // Column and row; may lie outside the texture by one.
    low: vec2<i32>,
    // Weight of the right column and of the lower row, 0 to 1.
    weight: vec2<f32>,
}

// Brings the texel coordinate `coord` into 0..size by address mode. `size` is at least 1.
fn texfold_wrap(coord: i32, size: u32, mode: u32) -> u32 {
    let count = i32(size);
    if mode == TEXFOLD_REPEAT {
        let rest = coord % count;
        return u32(select(rest, rest + count, rest < 0));
    }
    return u32(clamp(coord, 0, count - 1));
}

// The four texels around `uv` in a level of `size` texels; (0, 0) is the top left of the image, (1, 1) its
// bottom right.
fn texfold_tap(uv: vec2<f32>, size: vec2<u32>) -> TexfoldTap {
    let at = uv * vec2<f32>(size) - vec2<f32>(0.5);
    let low = floor(at);
    return TexfoldTap(vec2<i32>(low), at - low);
}

// The texel of a level of `size` texels that `uv` lies in, before wrapping.
fn texfold_nearest(uv: vec2<f32>, size: vec2<u32>) -> vec2<i32> {
    return vec2<i32>(floor(uv * vec2<f32>(size)));
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
