// What the entry points call, for module bc. It has one image a binding: `image` is not used.

fn entry_fetch(image: u32, at: vec2<i32>, level: u32) -> vec4<f32> {
    return texfold_bc_fetch(at, level);
}

fn entry_nearest(image: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_bc_nearest(uv, level);
}

fn entry_bilinear(image: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_bc_bilinear(uv, level);
}

fn entry_sample_level(image: u32, uv: vec2<f32>, lod: f32) -> vec4<f32> {
    return texfold_bc_sample_level(uv, lod);
}

fn entry_sample(image: u32, uv: vec2<f32>) -> vec4<f32> {
    return texfold_bc_sample(uv);
}

fn entry_size() -> vec2<f32> {
    return vec2<f32>(texfold_bc_params.plane_size);
}

// One texel with the loads of texfold_bc_load and nothing else.
fn entry_loads(at: vec2<u32>) -> vec4<f32> {
    let a = textureLoad(texfold_bc_plane_a, at, 0u);
    var b = a;
    if texfold_bc_params.swizzle == TEXFOLD_SPLIT {
        b = textureLoad(texfold_bc_plane_b, at, 0u);
    }
    return a + b;
}

// Four texels with the loads of texfold_bc_blend.
fn entry_loads_four(at: vec2<u32>) -> vec4<f32> {
    let next = at + vec2<u32>(1u);
    let a = textureLoad(texfold_bc_plane_a, at, 0u)
        + textureLoad(texfold_bc_plane_a, vec2<u32>(next.x, at.y), 0u)
        + textureLoad(texfold_bc_plane_a, vec2<u32>(at.x, next.y), 0u)
        + textureLoad(texfold_bc_plane_a, next, 0u);
    var b = a;
    if texfold_bc_params.swizzle == TEXFOLD_SPLIT {
        b = textureLoad(texfold_bc_plane_b, at, 0u)
            + textureLoad(texfold_bc_plane_b, vec2<u32>(next.x, at.y), 0u)
            + textureLoad(texfold_bc_plane_b, vec2<u32>(at.x, next.y), 0u)
            + textureLoad(texfold_bc_plane_b, next, 0u);
    }
    return a + b;
}
