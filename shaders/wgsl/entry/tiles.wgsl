// The update of a cache of tiles, its further passes: streams of all tiles and planes at once, blocks of all tiles plane by plane, and
// texels into the pool.

struct EntryStep {
    // The plane that is decoded, the coarsest first.
    plane: u32,
    // Bytes of all streams before the bound ones, and bytes of these.
    first: u32,
    bytes: u32,
}

@group(0) @binding(0) var<storage, read> entry_plan: TexfoldTilePlan;
@group(0) @binding(1) var<storage, read> texfold_block_words: array<u32>;
@group(0) @binding(2) var<storage, read> texfold_block_streams: array<u32>;
@group(0) @binding(3) var<storage, read_write> texfold_block_scratch: array<i32>;
@group(0) @binding(4) var<uniform> entry_step: EntryStep;

var<private> texfold_block_pass: TexfoldBlockPass;

// Words that an invocation clears.
const ENTRY_CLEARED: u32 = 64u;

@compute @workgroup_size(64)
fn clear_scratch(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    for (var row = 0u; row < ENTRY_CLEARED; row += 1u) {
        let word = (group.x * ENTRY_CLEARED + row) * 64u + thread;
        if word < entry_plan.words {
            texfold_block_scratch[word] = 0;
        }
    }
}

// The tile that item `number` of a plane belongs to, and the item's number in it: of superblocks where `first` is 0, of blocks where it is
// TEXFOLD_TILE_BLOCKS. Where there are fewer items, the number of tiles.
fn entry_item(number: u32, plane: u32, first: u32) -> vec2<u32> {
    let sums = first + plane * TEXFOLD_TILE_SUMS;
    if number >= entry_plan.sums[sums + entry_plan.count] {
        return vec2<u32>(entry_plan.count, 0u);
    }
    var tile = 0u;
    for (var step = TEXFOLD_TILE_MOST / 2u; step > 0u; step /= 2u) {
        if tile + step < entry_plan.count && entry_plan.sums[sums + tile + step] <= number {
            tile += step;
        }
    }
    return vec2<u32>(tile, number - entry_plan.sums[sums + tile]);
}

// All planes at once: streams need no samples. A workgroup's streams are of one tile, which may lie in another buffer than the bound one.
@compute @workgroup_size(ENTRY_STREAMS)
fn read_superblocks(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let found = entry_item(group.x * ENTRY_STREAMS, group.y, 0u);
    var is_bound = false;
    if found.x < entry_plan.count {
        texfold_block_pass = entry_plan.passes[found.x * TEXFOLD_TILE_PLANES + group.y];
        // Those of an earlier buffer wrap around.
        texfold_block_pass.streams -= entry_step.first;
        is_bound = texfold_block_pass.streams < entry_step.bytes;
    }
    if is_bound {
        entry_share(lane);
    }
    workgroupBarrier();
    let number = found.y + lane;
    let count = texfold_block_pass.count;
    if is_bound && number < count.x * count.y {
        texfold_block_superblock(vec2<u32>(number % count.x, number / count.x));
    }
}

@compute @workgroup_size(64)
fn transform_blocks(@builtin(global_invocation_id) id: vec3<u32>) {
    let found = entry_item(id.x, entry_step.plane, TEXFOLD_TILE_BLOCKS);
    if found.x < entry_plan.count {
        texfold_block_pass = entry_plan.passes[found.x * TEXFOLD_TILE_PLANES + entry_step.plane];
        texfold_block_samples(found.y);
    }
}

// Eight superblocks of a tile a workgroup, as they are read. Groups that differ in y have axes in turn.
@compute @workgroup_size(64)
fn predict_blocks(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let found = entry_item(group.x * ENTRY_STREAMS, entry_step.plane, 0u);
    if found.x >= entry_plan.count {
        return;
    }
    let own = found.x * TEXFOLD_TILE_PLANES + entry_step.plane;
    texfold_block_pass = entry_plan.passes[own];
    let count = texfold_block_pass.count;
    let number = found.y + lane / 8u;
    let is_there = number < count.x * count.y && texfold_block_has_modes();
    let place = vec2<u32>(number % count.x, number / count.x);
    for (var axis = group.y; axis < entry_plan.passes[own].axes; axis += TEXFOLD_TILE_PLANES) {
        entry_predict(place, is_there, axis, entry_plan.passes[own].side, lane);
    }
}

fn entry_deblock(number: u32, is_above: u32) {
    let found = entry_item(number, entry_step.plane, TEXFOLD_TILE_BLOCKS);
    if found.x < entry_plan.count {
        texfold_block_pass = entry_plan.passes[found.x * TEXFOLD_TILE_PLANES + entry_step.plane];
        if texfold_block_pass.deblocking > 0 {
            texfold_block_deblock(found.y, is_above);
        }
    }
}

@compute @workgroup_size(64)
fn deblock_columns(@builtin(global_invocation_id) id: vec3<u32>) {
    entry_deblock(id.x, 0u);
}

@compute @workgroup_size(64)
fn deblock_rows(@builtin(global_invocation_id) id: vec3<u32>) {
    entry_deblock(id.x, 1u);
}

@group(1) @binding(0) var<storage, read> texfold_tile_textures: array<TexfoldTileTexture>;
@group(1) @binding(1) var<storage, read> entry_stages: array<TexfoldTileStage>;
@group(1) @binding(2) var entry_pool: texture_storage_2d_array<rgba8unorm, write>;

var<private> entry_output: EntryOutput;

// The texel of a request in that column and row of the texture's level; `level` is that of its image, and how often this is to be doubled.
fn entry_colour(number: u32, level: vec2<u32>, at: vec2<u32>, flags: u32) -> vec4<f32> {
    let stage = entry_plan.requests[number].stage;
    texfold_block_pass = entry_plan.passes[(number + 1u) * TEXFOLD_TILE_PLANES - 1u];
    entry_output.shift = entry_stages[stage].shift;
    entry_output.largest = entry_stages[stage].largest;
    entry_output.means = entry_stages[stage].means;
    entry_output.first_axes = entry_stages[stage].first_axes;
    entry_output.weights = entry_stages[stage].weights;
    entry_output.last = entry_stages[stage].size - vec2<u32>(1u);
    entry_output.reduce_log2 = level.x % 3u;
    entry_output.average = entry_stages[stage].average;
    // The place between four texels of the image, in parts of one.
    let part = 2i << level.y;
    let place = 2 * vec2<i32>(at) + vec2<i32>(1 - part / 2);
    let share = vec2<f32>(place & vec2<i32>(part - 1)) / f32(part);
    var colour = vec4<f32>(0.0);
    for (var tap = 0u; tap < select(4u, 1u, level.y == 0u); tap += 1u) {
        let beside = vec2<u32>(tap & 1u, tap >> 1u);
        let weight = select(vec2<f32>(1.0) - share, share, beside == vec2<u32>(1u));
        var texel = at;
        if level.y > 0u {
            texel = texfold_tile_address((place >> vec2<u32>(level.y + 1u)) + vec2<i32>(beside), entry_stages[stage].size, flags);
        }
        colour += select(weight.x * weight.y, 1.0, level.y == 0u) * vec4<f32>(entry_texel(texel));
    }
    return colour / f32(entry_output.largest);
}

// The first image of a layer writes it, with those behind it that fill further channels.
@compute @workgroup_size(8, 8)
fn write_tiles(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.z >= entry_plan.count || entry_plan.requests[id.z].stage >= 0x80000000u {
        return;
    }
    let request = entry_plan.requests[id.z];
    let level = request.level & 255u;
    let own = request.level >> 8u;
    let parts = texfold_tile_textures[request.texture].parts;
    let layer = texfold_tile_part(parts, own).x;
    for (var part = 0u; part < own; part += 1u) {
        if texfold_tile_part(parts, part).x == layer {
            return;
        }
    }
    let flags = texfold_tile_flags(texfold_tile_textures[request.texture].shape);
    let size = texfold_tile_level_size(texfold_tile_textures[request.texture].size, level);
    let at = texfold_tile_source(request.tile, size, flags, id.xy);
    // Channels that no image fills stay 1.
    var texel = vec4<f32>(1.0);
    for (var part = own; part < texfold_tile_parts(parts); part += 1u) {
        let place = texfold_tile_part(parts, part);
        if place.x != layer {
            continue;
        }
        let colour = entry_colour(id.z + part - own, texfold_tile_part_level(parts, part, level), at, flags);
        if ((parts.shape >> (8u + part)) & 1u) == 1u {
            texel = select(texel, colour.xxxx, vec4<u32>(0u, 1u, 2u, 3u) == vec4<u32>(place.y));
        } else {
            texel = colour;
        }
    }
    let target_texel = texfold_tile_place(request.place);
    textureStore(entry_pool, target_texel.xy + id.xy, target_texel.z + layer, texel);
}
