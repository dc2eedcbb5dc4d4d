// The passes that decode a plane in blocks of variable length: first all its superblocks' streams, then all its blocks.

@compute @workgroup_size(32)
fn read_superblocks(@builtin(global_invocation_id) id: vec3<u32>) {
    let count = texfold_block_pass.count;
    if id.x < count.x * count.y {
        texfold_block_superblock(vec2<u32>(id.x % count.x, id.x / count.x));
    }
}

@compute @workgroup_size(64)
fn transform_blocks(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < texfold_block_pass.held.x * texfold_block_pass.held.y * texfold_block_pass.axes {
        texfold_block_samples(id.x);
    }
}

// Where a rectangle's texels go.
struct EntryOutput {
    // Columns and rows of the rectangle.
    size: vec2<u32>,
    // Its first column and row in the samples that are held.
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
}

@group(1) @binding(0) var<uniform> entry_output: EntryOutput;

// The target's channels of the rectangle's texel at `at`.
fn entry_texel(at: vec2<u32>) -> vec4<i32> {
    let held = entry_output.origin + at;
    let shift = entry_output.shift;
    let largest = entry_output.largest;
    let means = entry_output.means;
    let first = entry_output.first_axes;
    return vec4<i32>(
        texfold_block_channel(held, means.x, first.x, entry_output.weights[0], shift, largest),
        texfold_block_channel(held, means.y, first.y, entry_output.weights[1], shift, largest),
        texfold_block_channel(held, means.z, first.z, entry_output.weights[2], shift, largest),
        texfold_block_channel(held, means.w, first.w, entry_output.weights[3], shift, largest),
    );
}
