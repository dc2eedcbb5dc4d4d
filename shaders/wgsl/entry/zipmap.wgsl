// What the entry points call, for module zipmap. It has one image a binding: `surface` is not used.

fn entry_fetch(surface: u32, at: vec2<i32>, level: u32) -> vec4<f32> {
    return texfold_zipmap_fetch(at, level);
}

fn entry_nearest(surface: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_zipmap_nearest(uv, level);
}

fn entry_bilinear(surface: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_zipmap_bilinear(uv, level);
}

fn entry_sample_level(surface: u32, uv: vec2<f32>, lod: f32) -> vec4<f32> {
    return texfold_zipmap_sample_level(uv, lod);
}

fn entry_sample(surface: u32, uv: vec2<f32>) -> vec4<f32> {
    return texfold_zipmap_sample(uv);
}

fn entry_size() -> vec2<f32> {
    return vec2<f32>(texfold_zipmap_params.size);
}

// What a renderer would do with six patches in one plane whose places it knew: four loads and a blend each, over four of the root.
fn entry_bare(at: vec2<u32>) -> vec4<f32> {
    let root = at * texfold_zipmap_params.root_size / texfold_zipmap_params.size;
    let next = min(root + vec2<u32>(1u), texfold_zipmap_params.root_size - vec2<u32>(1u));
    var colour = textureLoad(texfold_zipmap_root_a, root, 0u)
        + textureLoad(texfold_zipmap_root_a, vec2<u32>(next.x, root.y), 0u)
        + textureLoad(texfold_zipmap_root_a, vec2<u32>(root.x, next.y), 0u)
        + textureLoad(texfold_zipmap_root_a, next, 0u);
    let last = textureDimensions(texfold_zipmap_atlas) - vec2<u32>(1u);
    for (var k = 0u; k < min(6u, TEXFOLD_ZIPMAP_MOST); k += 1u) {
        let low = min((at + vec2<u32>(k)) & vec2<u32>(511u), last);
        let high = min(low + vec2<u32>(1u), last);
        let texel = textureLoad(texfold_zipmap_atlas, low, 0u)
            + textureLoad(texfold_zipmap_atlas, vec2<u32>(high.x, low.y), 0u)
            + textureLoad(texfold_zipmap_atlas, vec2<u32>(low.x, high.y), 0u)
            + textureLoad(texfold_zipmap_atlas, high, 0u);
        colour = texfold_mix(colour, texel, texel.w * 0.25);
    }
    return colour;
}

// The same within a level.
fn entry_bare_four(at: vec2<u32>) -> vec4<f32> {
    return entry_bare(at);
}
