// What the entry points call, for module bc. It has one image a binding: `surface` is not used.

fn entry_fetch(surface: u32, at: vec2<i32>, level: u32) -> vec4<f32> {
    return texfold_bc_fetch(at, level);
}

fn entry_nearest(surface: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_bc_nearest(uv, level);
}

fn entry_bilinear(surface: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_bc_bilinear(uv, level);
}

fn entry_sample_level(surface: u32, uv: vec2<f32>, lod: f32) -> vec4<f32> {
    return texfold_bc_sample_level(uv, lod);
}

fn entry_sample(surface: u32, uv: vec2<f32>) -> vec4<f32> {
    return texfold_bc_sample(uv);
}

fn entry_size() -> vec2<f32> {
    return vec2<f32>(texfold_bc_params.plane_size);
}

// One texel with the loads of texfold_bc_load and nothing else.
fn entry_bare(surface: u32, at: vec2<u32>) -> vec4<f32> {
    let a = textureLoad(texfold_bc_plane_a, at, 0u);
    if texfold_bc_params.swizzle == TEXFOLD_SPLIT {
        return vec4<f32>(a.xy, textureLoad(texfold_bc_plane_b, at, 0u).x, 1.0);
    }
    return a;
}
