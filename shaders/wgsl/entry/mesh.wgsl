// A textured triangle mesh.

struct Scene {
    // From the mesh's space to clip space.
    view_projection: mat4x4<f32>,
    // Place of the image in its binding.
    image: u32,
    reserved: u32,
    reserved_too: vec2<u32>,
}

@group(1) @binding(0) var<uniform> scene: Scene;

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) uv: vec2<f32>,
}

@vertex
fn vertex_main(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> Corner {
    return Corner(scene.view_projection * vec4<f32>(position, 1.0), uv);
}

@fragment
fn fragment_main(corner: Corner) -> @location(0) vec4<f32> {
    return entry_sample(scene.image, corner.uv);
}
