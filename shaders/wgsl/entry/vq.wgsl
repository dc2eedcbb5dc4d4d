// What the entry points call, for module vq.

fn entry_fetch(image: u32, at: vec2<i32>, level: u32) -> vec4<f32> {
    return texfold_vq_fetch(image, at, level);
}

fn entry_nearest(image: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_vq_nearest(image, uv, level);
}

fn entry_bilinear(image: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_vq_bilinear(image, uv, level);
}

fn entry_sample_level(image: u32, uv: vec2<f32>, lod: f32) -> vec4<f32> {
    return texfold_vq_sample_level(image, uv, lod);
}

fn entry_sample(image: u32, uv: vec2<f32>) -> vec4<f32> {
    return texfold_vq_sample_image(image, uv);
}

fn entry_size() -> vec2<f32> {
    return vec2<f32>(texfold_vq_params.size);
}

// Where the texel at `at` is in the codebook: right for the first image only.
fn entry_loads_place(at: vec2<u32>) -> vec2<u32> {
    return textureLoad(texfold_vq_index, at >> vec2<u32>(2u), 0u).xy + (at & vec2<u32>(3u));
}

// One texel with the loads of texfold_vq_load and nothing else.
fn entry_loads(at: vec2<u32>) -> vec4<f32> {
    let place = entry_loads_place(at);
    let a = textureLoad(texfold_vq_codebook_a, place, 0u);
    var b = a;
    if texfold_vq_params.swizzle == TEXFOLD_SPLIT {
        b = textureLoad(texfold_vq_codebook_b, place, 0u);
    }
    return a + b;
}

// Four texels with the loads of texfold_vq_blend.
fn entry_loads_four(at: vec2<u32>) -> vec4<f32> {
    let upper_left = entry_loads_place(at);
    let upper_right = entry_loads_place(at + vec2<u32>(1u, 0u));
    let lower_left = entry_loads_place(at + vec2<u32>(0u, 1u));
    let lower_right = entry_loads_place(at + vec2<u32>(1u, 1u));
    let a = textureLoad(texfold_vq_codebook_a, upper_left, 0u)
        + textureLoad(texfold_vq_codebook_a, upper_right, 0u)
        + textureLoad(texfold_vq_codebook_a, lower_left, 0u)
        + textureLoad(texfold_vq_codebook_a, lower_right, 0u);
    var b = a;
    if texfold_vq_params.swizzle == TEXFOLD_SPLIT {
        b = textureLoad(texfold_vq_codebook_b, upper_left, 0u)
            + textureLoad(texfold_vq_codebook_b, upper_right, 0u)
            + textureLoad(texfold_vq_codebook_b, lower_left, 0u)
            + textureLoad(texfold_vq_codebook_b, lower_right, 0u);
    }
    return a + b;
}
