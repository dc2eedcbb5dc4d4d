// A rectangle of texture coordinates drawn over the whole target.

struct View {
    // Texture coordinates at the image's top left corner, and their change over its width and its height.
    uv_origin: vec2<f32>,
    uv_across: vec2<f32>,
    uv_down: vec2<f32>,
    // Columns and rows of the whole image.
    size: vec2<f32>,
    // Column and row of the image at the target's upper left pixel.
    offset: vec2<f32>,
    // Mip level for lookups with fractional levels.
    lod: f32,
    // Mip level for lookups within one level.
    level: u32,
    // Place of the image in its binding.
    image: u32,
    reserved: u32,
}

@group(1) @binding(0) var<uniform> view: View;

// One triangle that covers the target.
@vertex
fn vertex_main(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(f32(index & 1u), f32(index >> 1u)) * 4.0 - vec2<f32>(1.0);
    return vec4<f32>(corner, 0.0, 1.0);
}

// Texture coordinates at the centre of the pixel at `position`, in pixels of the target.
fn view_uv(position: vec2<f32>) -> vec2<f32> {
    let at = (position + view.offset) / view.size;
    return view.uv_origin + view.uv_across * at.x + view.uv_down * at.y;
}
