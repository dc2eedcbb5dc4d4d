// What the entry points call, for module zipmap. It has one image a binding: `image` is not used.

fn entry_fetch(image: u32, at: vec2<i32>, level: u32) -> vec4<f32> {
    return texfold_zipmap_fetch(at, level);
}

fn entry_nearest(image: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_zipmap_nearest(uv, level);
}

fn entry_bilinear(image: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_zipmap_bilinear(uv, level);
}

fn entry_sample_level(image: u32, uv: vec2<f32>, lod: f32) -> vec4<f32> {
    return texfold_zipmap_sample_level(uv, lod);
}

fn entry_sample(image: u32, uv: vec2<f32>) -> vec4<f32> {
    return texfold_zipmap_sample(uv);
}

fn entry_size() -> vec2<f32> {
    return vec2<f32>(texfold_zipmap_params.size);
}

// Four texels with the loads of texfold_zipmap_pixel where it reads level 0: four of the root, the tile and its list, and of each patch
// that it names three of the table and four of its texels, at a place that hangs on the table. All patches are read, whatever covers them.
fn entry_loads(at: vec2<u32>) -> vec4<f32> {
    let root = at * texfold_zipmap_params.root_size / texfold_zipmap_params.size;
    let next = min(root + vec2<u32>(1u), texfold_zipmap_params.root_size - vec2<u32>(1u));
    var below = textureLoad(texfold_zipmap_root_a, root, 0u)
        + textureLoad(texfold_zipmap_root_a, vec2<u32>(next.x, root.y), 0u)
        + textureLoad(texfold_zipmap_root_a, vec2<u32>(root.x, next.y), 0u)
        + textureLoad(texfold_zipmap_root_a, next, 0u);
    if TEXFOLD_ZIPMAP_SPLIT {
        if texfold_zipmap_params.root_swizzle == TEXFOLD_SPLIT {
            below += textureLoad(texfold_zipmap_root_b, root, 0u)
                + textureLoad(texfold_zipmap_root_b, vec2<u32>(next.x, root.y), 0u)
                + textureLoad(texfold_zipmap_root_b, vec2<u32>(root.x, next.y), 0u)
                + textureLoad(texfold_zipmap_root_b, next, 0u);
        }
    }
    let found = texfold_zipmap_tile(vec2<f32>(at) / vec2<f32>(texfold_zipmap_params.size));
    let fineness = texfold_zipmap_entry(found.y).x;
    var seen = vec4<f32>(0.0, 0.0, 0.0, 1.0);
    for (var k = 0u; k < min(found.x, TEXFOLD_ZIPMAP_MOST); k += 1u) {
        let layer = texfold_zipmap_patch(texfold_zipmap_name(found.y, k));
        // Bits that are always 0, but hang on all of the patch.
        let words = bitcast<vec3<u32>>(layer.by_u) & bitcast<vec3<u32>>(layer.by_v) & bitcast<vec3<u32>>(layer.by_one);
        let none = vec2<i32>(vec2<u32>(words.x & words.y, words.z & layer.levels & fineness) & vec2<u32>(1u));
        let low = min(layer.origin + vec2<i32>(at & vec2<u32>(127u)) + none, layer.origin + layer.size);
        let high = low + vec2<i32>(1);
        let texel = textureLoad(texfold_zipmap_atlas, low, 0)
            + textureLoad(texfold_zipmap_atlas, vec2<i32>(high.x, low.y), 0)
            + textureLoad(texfold_zipmap_atlas, vec2<i32>(low.x, high.y), 0)
            + textureLoad(texfold_zipmap_atlas, high, 0);
        seen = texfold_zipmap_under(seen, texel * 0.25);
        if k + 1u >= found.x {
            break;
        }
    }
    return vec4<f32>(seen.xyz, 1.0 - seen.w) + below * seen.w;
}

// The same within a level.
fn entry_loads_four(at: vec2<u32>) -> vec4<f32> {
    return entry_loads(at);
}
