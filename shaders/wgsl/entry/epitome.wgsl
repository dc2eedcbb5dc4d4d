// What the entry points call, for module epitome. It has one image a binding: `image` is not used.

fn entry_fetch(image: u32, at: vec2<i32>, level: u32) -> vec4<f32> {
    return texfold_epitome_fetch(at, level);
}

fn entry_nearest(image: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_epitome_nearest(uv, level);
}

fn entry_bilinear(image: u32, uv: vec2<f32>, level: u32) -> vec4<f32> {
    return texfold_epitome_bilinear(uv, level);
}

fn entry_sample_level(image: u32, uv: vec2<f32>, lod: f32) -> vec4<f32> {
    return texfold_epitome_sample_level(uv, lod);
}

fn entry_sample(image: u32, uv: vec2<f32>) -> vec4<f32> {
    return texfold_epitome_sample(uv);
}

fn entry_size() -> vec2<f32> {
    return vec2<f32>(texfold_epitome_params.size);
}

// Four texels with the loads of texfold_epitome_content for the texel at `at`: two words of the entry, two of the
// matrix and two of gain and offset, then four texels of one of two epitomes, or of both planes of one. Fields are taken
// as if each entry began with a word, and nothing is rotated: texels lie near to each other as in a lookup.
fn entry_loads_content(entry: u32, at: vec2<u32>) -> vec4<f32> {
    let byte = entry * texfold_epitome_params.entry_bytes;
    let word = texfold_epitome_params.entry_start + (byte >> 2u);
    let low = texfold_epitome_word(word);
    let high = texfold_epitome_word(word + 1u);
    let bits = vec4<u32>(
        texfold_epitome_params.x_bits,
        texfold_epitome_params.y_bits,
        texfold_epitome_params.matrix_bits,
        texfold_epitome_params.gain_offset_bits,
    );
    let fields = vec4<u32>(low, low >> bits.x, high, low) & ((vec4<u32>(1u) << bits) - vec4<u32>(1u));
    let matrix = texfold_epitome_params.matrix_start + 2u * fields.z;
    let gain_offset = texfold_epitome_params.gain_offset_start + 2u * fields.w;
    let moved = texfold_epitome_word(matrix) & texfold_epitome_word(matrix + 1u) & 1u;
    let summed = texfold_epitome_word(gain_offset) + texfold_epitome_word(gain_offset + 1u);
    let second = (high & texfold_epitome_params.mixed) != 0u;
    let corner = (fields.xy >> vec2<u32>(texfold_epitome_params.fraction_bits)) + vec2<u32>(moved);
    let size = select(texfold_epitome_params.plane_a, texfold_epitome_params.plane_b, second);
    // Always 0, but a number that depends on the matrix, as in a lookup.
    let level = moved & (texfold_epitome_params.plane_levels >> 2u);
    let place = min(corner + (at & vec2<u32>(15u)), size - vec2<u32>(2u));
    let next = place + vec2<u32>(1u);
    var a = vec4<f32>(0.0);
    if !second {
        a = textureLoad(texfold_epitome_plane_a, place, level)
            + textureLoad(texfold_epitome_plane_a, vec2<u32>(next.x, place.y), level)
            + textureLoad(texfold_epitome_plane_a, vec2<u32>(place.x, next.y), level)
            + textureLoad(texfold_epitome_plane_a, next, level);
    }
    var b = a;
    if second | (texfold_epitome_params.swizzle == TEXFOLD_SPLIT) {
        b = textureLoad(texfold_epitome_plane_b, place, level)
            + textureLoad(texfold_epitome_plane_b, vec2<u32>(next.x, place.y), level)
            + textureLoad(texfold_epitome_plane_b, vec2<u32>(place.x, next.y), level)
            + textureLoad(texfold_epitome_plane_b, next, level);
    }
    return a + b + vec4<f32>(f32(i32(summed)));
}

// One texel with the loads of texfold_epitome_load. The leaf is found as there: what is loaded next hangs on it.
fn entry_loads(at: vec2<u32>) -> vec4<f32> {
    return entry_loads_content(texfold_epitome_leaf(at).entry, at);
}

// Four texels with the loads of texfold_epitome_bilinear: inside a leaf as many as for one, and a second leaf.
fn entry_loads_four(at: vec2<u32>) -> vec4<f32> {
    let next = min(at + vec2<u32>(1u), texfold_epitome_params.size - vec2<u32>(1u));
    let upper_right = vec2<u32>(next.x, at.y);
    let lower_left = vec2<u32>(at.x, next.y);
    let first = texfold_epitome_leaf(at).entry;
    let last = texfold_epitome_leaf(next).entry;
    let nearest = entry_loads_content(first, at);
    if first == last {
        return nearest;
    }
    return nearest
        + entry_loads_content(texfold_epitome_leaf(upper_right).entry, upper_right)
        + entry_loads_content(texfold_epitome_leaf(lower_left).entry, lower_left)
        + entry_loads_content(last, next);
}
