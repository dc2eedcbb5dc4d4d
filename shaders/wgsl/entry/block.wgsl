// Bindings of the passes.

@group(0) @binding(0) var<uniform> texfold_block_pass: TexfoldBlockPass;
// Constants, tables of probabilities, steps, index.
@group(0) @binding(1) var<storage, read> texfold_block_words: array<u32>;
// The streams' bytes, and a word behind them.
@group(0) @binding(2) var<storage, read> texfold_block_streams: array<u32>;
@group(0) @binding(3) var<storage, read_write> texfold_block_scratch: array<i32>;

@group(1) @binding(0) var<uniform> entry_output: EntryOutput;

// The passes that decode a plane in blocks of variable length: first all its superblocks' streams, then all its blocks; then,
// where the image is deblocked, the borders between columns of blocks and those between rows.

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

@compute @workgroup_size(64)
fn deblock_columns(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < texfold_block_pass.held.x * texfold_block_pass.held.y * texfold_block_pass.axes {
        texfold_block_deblock(id.x, 0u);
    }
}

@compute @workgroup_size(64)
fn deblock_rows(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < texfold_block_pass.held.x * texfold_block_pass.held.y * texfold_block_pass.axes {
        texfold_block_deblock(id.x, 1u);
    }
}
