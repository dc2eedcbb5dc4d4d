// A surface light field on its own mesh: three corners a triangle, without vertex buffers.

struct Scene {
    // From the mesh's space to clip space.
    view_projection: mat4x4<f32>,
    // Where the camera is, in the mesh's space.
    eye: vec3<f32>,
    reserved: u32,
}

@group(1) @binding(0) var<uniform> scene: Scene;

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) place: vec3<f32>,
    @location(1) barycentric: vec3<f32>,
    @location(2) @interpolate(flat) triangle: u32,
}

@vertex
fn vertex_main(@builtin(vertex_index) index: u32) -> Corner {
    let triangle = index / 3u;
    let corner = index % 3u;
    let vertex = texfold_lightfield_word(texfold_lightfield_triangle(triangle) + corner);
    let place = texfold_lightfield_position(vertex);
    let barycentric = vec3<f32>(vec3<u32>(corner) == vec3<u32>(0u, 1u, 2u));
    return Corner(scene.view_projection * vec4<f32>(place, 1.0), place, barycentric, triangle);
}

@fragment
fn fragment_main(corner: Corner) -> @location(0) vec4<f32> {
    let direction = normalize(scene.eye - corner.place);
    return texfold_lightfield_sample(corner.triangle, corner.barycentric, direction);
}
