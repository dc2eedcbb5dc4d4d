// Output of a rectangle's texels.
struct EntryOutput {
    // Columns and rows of the rectangle.
    size: vec2<u32>,
    // Its first column and row in the image's level.
    origin: vec2<u32>,
    // Its first column and row in the target.
    place: vec2<u32>,
    // Fractional bits of channels' sums.
    shift: u32,
    // Largest sample.
    largest: i32,
    // For each of the target's channels: mean, first axis, weights.
    means: vec4<i32>,
    first_axes: vec4<u32>,
    weights: array<vec4<i32>, 4>,
    // Last column and row of samples of the image.
    last: vec2<u32>,
    // Binary logarithm of the samples along a texel's side, 0 to 2.
    reduce_log2: u32,
    // Bit 0: colours are averaged as light, by their squares; bit 1: weighted by the target's last channel.
    average: u32,
}

// The target's channels of the sample in that column and row of the image.
fn entry_sample(place: vec2<u32>) -> vec4<i32> {
    let first = texfold_block_pass.first * texfold_block_pass.side * 8u;
    let all = texfold_block_pass.wrap * 8u;
    let at = texfold_block_wrapped(place + all - first, all);
    let shift = entry_output.shift;
    let largest = entry_output.largest;
    let means = entry_output.means;
    let axes = entry_output.first_axes;
    return vec4<i32>(
        texfold_block_channel(at, means.x, axes.x, entry_output.weights[0], shift, largest),
        texfold_block_channel(at, means.y, axes.y, entry_output.weights[1], shift, largest),
        texfold_block_channel(at, means.z, axes.z, entry_output.weights[2], shift, largest),
        texfold_block_channel(at, means.w, axes.w, entry_output.weights[3], shift, largest),
    );
}

// The target's channels of the texel in that column and row of the image's level: a sample, or the mean of a square of samples.
fn entry_texel(at: vec2<u32>) -> vec4<i32> {
    let reduce = min(entry_output.reduce_log2, 2u);
    let first = at << vec2<u32>(reduce);
    if reduce == 0u {
        return entry_sample(first);
    }
    let is_light = (entry_output.average & 1u) == 1u;
    let is_weighted = (entry_output.average & 2u) == 2u;
    let is_deep = entry_output.largest > 255;
    let side = 1u << reduce;
    var sums = vec4<u32>(0u);
    var weights = 0u;
    for (var place = 0u; place < min(side * side, TEXFOLD_BLOCK_WORDS); place += 1u) {
        let offset = vec2<u32>(place % side, place / side);
        let sample = vec4<u32>(entry_sample(min(first + offset, entry_output.last)));
        let squares = (sample.xyz * sample.xyz) >> vec3<u32>(select(0u, 12u, is_deep));
        let weight = select(1u, (sample.w >> select(0u, 8u, is_deep)) + 1u, is_weighted);
        sums += vec4<u32>(select(sample.xyz, squares, is_light) * weight, sample.w);
        weights += weight;
    }
    var means = (sums.xyz + vec3<u32>(weights / 2u)) / vec3<u32>(weights);
    if is_light {
        means = means << vec3<u32>(select(0u, 12u, is_deep));
        means = vec3<u32>(texfold_block_root(means.x), texfold_block_root(means.y), texfold_block_root(means.z));
    }
    let last = (sums.w + ((side * side) >> 1u)) >> (2u * reduce);
    return vec4<i32>(vec4<u32>(means, last));
}
