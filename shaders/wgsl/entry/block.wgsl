// Bindings of the passes.

// A plane's pass, at the distance that all devices allow for offsets.
struct EntryPass {
    @size(256) plane: TexfoldBlockPass,
}

// Passes from that of the offset on, of which there may be fewer.
@group(0) @binding(0) var<uniform> entry_passes: array<EntryPass, 6>;
// Constants, tables of probabilities, steps, index.
@group(0) @binding(1) var<storage, read> texfold_block_words: array<u32>;
// The streams' bytes, and a word behind them.
@group(0) @binding(2) var<storage, read> texfold_block_streams: array<u32>;
@group(0) @binding(3) var<storage, read_write> texfold_block_scratch: array<i32>;

@group(1) @binding(0) var<uniform> entry_output: EntryOutput;

var<private> texfold_block_pass: TexfoldBlockPass;

// The passes that decode a texture in blocks of variable length: first the streams of all planes, as streams need no samples. Then
// the blocks of each plane, the coarsest first; where blocks of the image have intra modes, their predictions; last, where it is deblocked,
// the borders between columns of blocks and those between rows.

@compute @workgroup_size(ENTRY_STREAMS)
fn read_superblocks(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    texfold_block_pass = entry_passes[id.y].plane;
    entry_share(lane);
    workgroupBarrier();
    let count = texfold_block_pass.count;
    if id.x < count.x * count.y {
        texfold_block_superblock(vec2<u32>(id.x % count.x, id.x / count.x));
    }
}

// Prepares the pass of the offset; true where it has a block of that number.
fn entry_has(block: u32) -> bool {
    texfold_block_pass = entry_passes[0].plane;
    return block < texfold_block_pass.held.x * texfold_block_pass.held.y * texfold_block_pass.axes;
}

@compute @workgroup_size(64)
fn transform_blocks(@builtin(global_invocation_id) id: vec3<u32>) {
    if entry_has(id.x) {
        texfold_block_samples(id.x);
    }
}

// An axis of eight superblocks a workgroup.
@compute @workgroup_size(64)
fn predict_blocks(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    texfold_block_pass = entry_passes[0].plane;
    let count = texfold_block_pass.count;
    let number = 8u * group.x + lane / 8u;
    let is_there = number < count.x * count.y && texfold_block_has_modes();
    let place = vec2<u32>(number % count.x, number / count.x);
    entry_predict(place, is_there, group.y, entry_passes[0].plane.side, lane);
}

@compute @workgroup_size(64)
fn deblock_columns(@builtin(global_invocation_id) id: vec3<u32>) {
    if entry_has(id.x) {
        texfold_block_deblock(id.x, 0u);
    }
}

@compute @workgroup_size(64)
fn deblock_rows(@builtin(global_invocation_id) id: vec3<u32>) {
    if entry_has(id.x) {
        texfold_block_deblock(id.x, 1u);
    }
}
