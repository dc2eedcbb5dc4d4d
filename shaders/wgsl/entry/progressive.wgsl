// What the entry points call, for module progressive. It has one image a binding: `image` is not used.

fn entry_fetch(image: u32, at: vec2<i32>, level: u32) -> vec4<f32> {
    return texfold_progressive_fetch(at, level);
}

fn entry_nearest(image: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_progressive_nearest(uv, level);
}

fn entry_bilinear(image: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_progressive_bilinear(uv, level);
}

fn entry_sample_level(image: u32, uv: vec2<f32>, lod: f32) -> vec4<f32> {
    return texfold_progressive_sample_level(uv, lod);
}

fn entry_sample(image: u32, uv: vec2<f32>) -> vec4<f32> {
    return texfold_progressive_sample(uv);
}

fn entry_size() -> vec2<f32> {
    return vec2<f32>(texfold_progressive_params.size);
}

// One texel with the loads of texfold_progressive_load: four of the base, four of the block's header, two of the
// block's last bits, and twice three of its bits. Where the bits lie is found as there: what is loaded next hangs on it.
fn entry_loads(at: vec2<u32>) -> vec4<f32> {
    let place = at * texfold_residual_params.base_size / texfold_residual_params.size;
    let next = min(place + vec2<u32>(1u), texfold_residual_params.base_size - vec2<u32>(1u));
    let texel = textureLoad(texfold_residual_base_a, place, 0u)
        + textureLoad(texfold_residual_base_a, vec2<u32>(next.x, place.y), 0u)
        + textureLoad(texfold_residual_base_a, vec2<u32>(place.x, next.y), 0u)
        + textureLoad(texfold_residual_base_a, next, 0u);
    let block = texfold_residual_block(at, 0u);
    let cell = block.start + (block.bits / 4u) * (((at.x >> 2u) & 1u) + ((at.y >> 2u) & 1u) * 2u);
    let bits = texfold_residual_read(cell) ^ texfold_residual_read(cell + 32u + 8u * (at.x & 2u));
    return texel + vec4<f32>(block.scale * f32(i32((bits.x ^ bits.y ^ block.tail) & 1u)));
}

// Four texels with the loads of texfold_progressive_bilinear.
fn entry_loads_four(at: vec2<u32>) -> vec4<f32> {
    let next = min(at + vec2<u32>(1u), texfold_residual_params.size - vec2<u32>(1u));
    return entry_loads(at)
        + entry_loads(vec2<u32>(next.x, at.y))
        + entry_loads(vec2<u32>(at.x, next.y))
        + entry_loads(next);
}
