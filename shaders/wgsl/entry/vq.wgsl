// What the entry points call, for module vq.

fn entry_fetch(surface: u32, at: vec2<i32>, level: u32) -> vec4<f32> {
    return texfold_vq_fetch(surface, at, level);
}

fn entry_nearest(surface: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_vq_nearest(surface, uv, level);
}

fn entry_bilinear(surface: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_vq_bilinear(surface, uv, level);
}

fn entry_sample_level(surface: u32, uv: vec2<f32>, lod: f32) -> vec4<f32> {
    return texfold_vq_sample_level(surface, uv, lod);
}

fn entry_sample(surface: u32, uv: vec2<f32>) -> vec4<f32> {
    return texfold_vq_sample_surface(surface, uv);
}

fn entry_size() -> vec2<f32> {
    return vec2<f32>(texfold_vq_params.size);
}

// One texel with the loads of texfold_vq_load and nothing else: right for the first image only.
fn entry_bare(surface: u32, at: vec2<u32>) -> vec4<f32> {
    let corner = textureLoad(texfold_vq_index, at >> vec2<u32>(2u), 0u).xy + (at & vec2<u32>(3u));
    let a = textureLoad(texfold_vq_codebook_a, corner, 0u);
    if texfold_vq_params.swizzle == TEXFOLD_SPLIT {
        return vec4<f32>(a.xy, textureLoad(texfold_vq_codebook_b, corner, 0u).x, 1.0);
    }
    return a;
}
