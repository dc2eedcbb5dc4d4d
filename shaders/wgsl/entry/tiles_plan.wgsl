// The update of a cache of tiles, first pass: chooses tiles among those that are wanted and places of the pool for them, and plans their
// decoding.
// One workgroup.

struct EntryOptions {
    // Places in the pool.
    slots: u32,
    // Most tiles to decode.
    tiles: u32,
    // Words of scratch memory.
    words: u32,
    // Passes that draw tiles.
    sources: u32,
    // Tiles along a side of a layer of the pool.
    columns: u32,
    // Layers of a place, 0 standing for one.
    layers: u32,
}

@group(0) @binding(0) var<storage, read> texfold_tile_textures: array<TexfoldTileTexture>;
@group(0) @binding(1) var<storage, read_write> texfold_tile_pages: array<u32>;
@group(0) @binding(2) var<storage, read_write> texfold_tile_feedback: TexfoldTileFeedback;
// For each place in the pool the number of its page, counted from 1; 0 where it is free.
@group(0) @binding(3) var<storage, read_write> entry_slots: array<u32>;
@group(0) @binding(4) var<storage, read> entry_stages: array<TexfoldTileStage>;
@group(0) @binding(5) var<storage, read_write> entry_plan: TexfoldTilePlan;
// Numbers of workgroups: of the clearing pass, of reading all planes, of transforming each, of writing, then of each pass that draws.
@group(0) @binding(6) var<storage, read_write> entry_workgroups: array<u32>;
@group(0) @binding(7) var<uniform> entry_options: EntryOptions;

// A place that is never given away.
const ENTRY_KEPT: u32 = 0xffffffffu;
const ENTRY_THREADS: u32 = 256u;
// Ages of places in frames: the last one is that of free ones, the one before stands for all that are older.
const ENTRY_AGES: u32 = 256u;
// From this age on a place may be given away.
const ENTRY_LEAST_AGE: u32 = 2u;
// In so many frames every pixel has marked what it reads.
const ENTRY_CYCLE: u32 = 64u;
const ENTRY_WORKGROUP: u32 = 64u;
// Streams of a workgroup: texfold_shaders::BLOCK_STREAMS.
const ENTRY_STREAMS: u32 = 8u;
const ENTRY_CLEARED: u32 = 64u;
// The bit of requests that another pass draws.
const ENTRY_DRAWN: u32 = 0x80000000u;

var<workgroup> entry_ages: array<atomic<u32>, ENTRY_AGES>;
// Wanted tiles of each level, then the next rank of each.
var<workgroup> entry_levels: array<atomic<u32>, TEXFOLD_TILE_LEVELS>;
var<workgroup> entry_chosen: array<u32, TEXFOLD_TILE_MOST>;
// The first request of each tile, and the tile of each request.
var<workgroup> entry_first: array<u32, TEXFOLD_TILE_MOST>;
var<workgroup> entry_owner: array<u32, TEXFOLD_TILE_MOST>;
var<workgroup> entry_words: array<u32, TEXFOLD_TILE_MOST>;
var<workgroup> entry_places: array<u32, TEXFOLD_TILE_MOST>;
var<workgroup> entry_count: u32;
var<workgroup> entry_oldest: u32;
var<workgroup> entry_rest: atomic<u32>;
var<workgroup> entry_next: atomic<u32>;
// Workgroups that read the streams of a plane, the most of any.
var<workgroup> entry_streams: atomic<u32>;

// A wanted tile.
struct EntryTile {
    texture: u32,
    level: u32,
    tile: vec2<u32>,
    page: u32,
    // Whether there is such a tile and it is still missing.
    is_wanted: bool,
}

fn entry_wanted(number: u32) -> EntryTile {
    let words = texfold_tile_feedback.tiles[number];
    var tile: EntryTile;
    tile.texture = words.x & 0xffffffu;
    tile.level = words.x >> 24u;
    tile.tile = vec2<u32>(words.y & 0xffffu, words.y >> 16u);
    if tile.texture >= arrayLength(&texfold_tile_textures) {
        return tile;
    }
    let shape = texfold_tile_textures[tile.texture].shape;
    if tile.level >= min(min(texfold_tile_levels(shape), texfold_tile_tail(shape)), TEXFOLD_TILE_LEVELS) {
        return tile;
    }
    let size = texfold_tile_level_size(texfold_tile_textures[tile.texture].size, tile.level);
    let count = texfold_tile_count(size);
    if any(tile.tile >= count) {
        return tile;
    }
    tile.page = texfold_tile_textures[tile.texture].levels[tile.level].x + tile.tile.y * count.x + tile.tile.x;
    // It may have become coarse since it was asked for.
    let is_coarse = (texfold_tile_flags(shape) & TEXFOLD_TILE_COARSE) != 0u;
    tile.is_wanted = texfold_tile_pages[tile.page] == 0u && !is_coarse;
    return tile;
}

// The page of a place.
fn entry_there(slot: u32) -> u32 {
    let columns = entry_options.columns;
    let layer = slot / (columns * columns) * max(entry_options.layers, 1u);
    return TEXFOLD_TILE_THERE | (layer << 16u) | ((slot / columns % columns) << 8u) | (slot % columns);
}

// Frames since a place was last looked at.
fn entry_age(slot: u32) -> u32 {
    let entry = entry_slots[slot];
    if entry == ENTRY_KEPT {
        return 0u;
    }
    if entry == 0u || texfold_tile_pages[entry - 1u] != entry_there(slot) {
        return ENTRY_AGES - 1u;
    }
    let seen = atomicLoad(&texfold_tile_feedback.marks[entry - 1u]);
    return min(texfold_tile_feedback.frame - seen, ENTRY_AGES - 2u);
}

// Columns or rows of superblocks that a tile needs, the first and how many: of a level of `level` texels, each 2^`reduce` samples of
// `size`, of `range`, its first texel and the one behind its last. Behind the last one the first ones follow.
fn entry_superblocks(range: vec2<i32>, level: i32, size: u32, reduce: u32, log2: u32, is_clamped: bool) -> vec2<u32> {
    let all = (size + (1u << log2) - 1u) >> log2;
    var start = range.x;
    var end = min(range.y, level + i32(TEXFOLD_TILE_BORDER));
    if is_clamped {
        start = max(start, 0);
        end = min(end, level);
    }
    if end - start >= level {
        return vec2<u32>(0u, all);
    }
    let first = u32((start + level) % level);
    let last = u32((end - 1) % level);
    let one = (first << reduce) >> log2;
    let other = min(((last + 1u) << reduce) - 1u, size - 1u) >> log2;
    return vec2<u32>(one, select(min(all - one + other + 1u, all), other - one + 1u, last >= first));
}

// The same of the base, whose samples are the means of `blocks` blocks: those of the superblocks in `range`, which have `side` blocks a
// side, and one around them.
fn entry_base(range: vec2<u32>, side: u32, blocks: u32, log2: u32) -> vec2<u32> {
    let all = (blocks + side - 1u) / side;
    let base = (blocks + (1u << log2) - 1u) >> log2;
    if range.y >= all {
        return vec2<u32>(0u, base);
    }
    let first = (max(range.x * side, 1u) - 1u) >> log2;
    let end = range.x + range.y;
    if end <= all {
        return vec2<u32>(first, (min(end * side, blocks - 1u) >> log2) - first + 1u);
    }
    let last = min((end - all) * side, blocks - 1u) >> log2;
    return vec2<u32>(first, min(base - first + last + 1u, base));
}

// Columns or rows of an image's level that a tile shows from its column or row `begin` on, the first and the one behind the last; of an image
// that is to be doubled so often those beside them, too.
fn entry_range(begin: i32, doublings: u32) -> vec2<i32> {
    let side = i32(TEXFOLD_TILE_SIDE >> doublings);
    if doublings == 0u {
        return vec2<i32>(begin, begin + side);
    }
    return vec2<i32>((begin >> doublings) - 1, (begin >> doublings) + side + 2);
}

// The stage that an image of a tile is decoded from: those of one image follow those of another.
fn entry_stage(tile: EntryTile, part: u32) -> u32 {
    let shape = texfold_tile_textures[tile.texture].shape;
    let last = min(texfold_tile_levels(shape), texfold_tile_tail(shape)) - 1u;
    let parts = texfold_tile_textures[tile.texture].parts;
    var stage = texfold_tile_textures[tile.texture].stages;
    for (var before = 0u; before < part; before += 1u) {
        stage += texfold_tile_part_level(parts, before, last).x / 3u + 1u;
    }
    return stage + texfold_tile_part_level(parts, part, tile.level).x / 3u;
}

// Plans the planes of an image of a tile, as request `number` of the update; returns the words that they take.
fn entry_planes(number: u32, tile: EntryTile, part: u32) -> u32 {
    let texture = tile.texture;
    let flags = texfold_tile_flags(texfold_tile_textures[texture].shape);
    let is_clamped = (flags & TEXFOLD_TILE_CLAMP) != 0u;
    let stage = entry_stage(tile, part);
    let own = texfold_tile_part_level(texfold_tile_textures[texture].parts, part, tile.level);
    let reduce = own.x % 3u;
    let base_log2 = entry_stages[stage].superblock_log2 >> 8u;
    var log2 = entry_stages[stage].superblock_log2 & 255u;
    let level = vec2<i32>(texfold_tile_level_size(entry_stages[stage].size, reduce));
    let begin = vec2<i32>(tile.tile * TEXFOLD_TILE_INNER) - vec2<i32>(i32(TEXFOLD_TILE_BORDER));
    var size = entry_stages[stage].size;
    var columns = entry_superblocks(entry_range(begin.x, own.y), level.x, size.x, reduce, log2, is_clamped);
    var rows = entry_superblocks(entry_range(begin.y, own.y), level.y, size.y, reduce, log2, is_clamped);
    var words = 0u;
    var plane = 0u;
    for (; plane < TEXFOLD_TILE_PLANES; plane += 1u) {
        let place = number * TEXFOLD_TILE_PLANES + TEXFOLD_TILE_PLANES - 1u - plane;
        let all = (size + vec2<u32>((1u << log2) - 1u)) >> vec2<u32>(log2);
        let side = (1u << log2) / 8u;
        let is_last = size.x <= 8u && size.y <= 8u;
        var planned: TexfoldBlockPass;
        planned.plane_blocks = (size + vec2<u32>(7u)) / 8u;
        planned.first = vec2<u32>(columns.x, rows.x);
        planned.count = vec2<u32>(columns.y, rows.y);
        planned.held = planned.count * side;
        planned.wrap = all * side;
        planned.superblock_columns = all.x;
        planned.side = side;
        planned.axes = entry_stages[stage].axes;
        planned.ranks = entry_stages[stage].ranks;
        planned.is_base = u32(plane > 0u);
        planned.has_base = u32(!is_last);
        planned.steps = entry_stages[stage].steps + TEXFOLD_BLOCK_WORDS * plane;
        planned.offsets = entry_stages[stage].offsets;
        planned.index = entry_stages[stage].index;
        planned.index_bits = entry_stages[stage].index_bits;
        planned.stream_bytes = entry_stages[stage].stream_bytes;
        planned.deblocking = select(0, entry_stages[stage].deblocking, plane == 0u);
        planned.tables = entry_stages[stage].tables;
        planned.streams = entry_stages[stage].streams;
        let blocks = planned.held.x * planned.held.y * planned.axes;
        planned.samples = words;
        planned.notes = words + blocks * TEXFOLD_BLOCK_WORDS;
        words += blocks * (TEXFOLD_BLOCK_WORDS + TEXFOLD_BLOCK_NOTES);
        if plane > 0u {
            // The finer plane's means.
            entry_plan.passes[place + 1u].base_first = planned.first * side * 8u;
            entry_plan.passes[place + 1u].base_held = planned.held;
            entry_plan.passes[place + 1u].base_wrap = planned.wrap * 8u;
            entry_plan.passes[place + 1u].base_samples = planned.samples;
        }
        entry_plan.passes[place] = planned;
        if is_last {
            break;
        }
        log2 = base_log2;
        columns = entry_base(columns, side, planned.plane_blocks.x, log2);
        rows = entry_base(rows, side, planned.plane_blocks.y, log2);
        size = planned.plane_blocks;
    }
    // The coarsest plane's superblocks come first in the index; there are none of planes that the stage does not have.
    var before = 0u;
    for (var place = number * TEXFOLD_TILE_PLANES; place < (number + 1u) * TEXFOLD_TILE_PLANES; place += 1u) {
        if place + min(plane, TEXFOLD_TILE_PLANES - 1u) + 1u < (number + 1u) * TEXFOLD_TILE_PLANES {
            entry_plan.passes[place].count = vec2<u32>(0u);
            entry_plan.passes[place].held = vec2<u32>(0u);
            continue;
        }
        entry_plan.passes[place].superblock_start = before;
        let all = entry_plan.passes[place].wrap / entry_plan.passes[place].side;
        before += all.x * all.y;
    }
    return words;
}

// Raises the bias where there is no room for what is wanted, and lowers it where much is not looked at.
fn entry_adjust_bias(wanted: u32, unused: u32) {
    let bias = texfold_tile_feedback.bias;
    if wanted > unused {
        texfold_tile_feedback.bias = min(bias + 0.0625, 8.0);
    } else if unused - wanted > entry_options.slots / 4u {
        texfold_tile_feedback.bias = max(bias - 0.015625, 0.0);
    }
}

// Ages of all places, and levels of all tiles that are wanted.
fn entry_survey(thread: u32, entries: u32) {
    for (var slot = thread; slot < entry_options.slots; slot += ENTRY_THREADS) {
        atomicAdd(&entry_ages[entry_age(slot)], 1u);
    }
    for (var number = thread; number < entries; number += ENTRY_THREADS) {
        let tile = entry_wanted(number);
        if tile.is_wanted {
            atomicAdd(&entry_levels[tile.level], 1u);
        }
    }
}

// The number of tiles to decode, the first rank of each level, and the least age of places that are given away.
fn entry_decide() {
    var wanted = 0u;
    for (var level = 0u; level < TEXFOLD_TILE_LEVELS; level += 1u) {
        // The coarsest first.
        let coarse = TEXFOLD_TILE_LEVELS - 1u - level;
        wanted += atomicExchange(&entry_levels[coarse], wanted);
    }
    var unused = 0u;
    for (var age = ENTRY_CYCLE; age < ENTRY_AGES; age += 1u) {
        unused += atomicLoad(&entry_ages[age]);
    }
    entry_adjust_bias(wanted, unused);
    // The oldest places, and of the youngest age among them as many as are needed.
    let most = min(min(wanted, entry_options.tiles), TEXFOLD_TILE_MOST);
    var oldest = ENTRY_AGES - 1u;
    var found = atomicLoad(&entry_ages[oldest]);
    while found < most && oldest > ENTRY_LEAST_AGE {
        oldest -= 1u;
        found += atomicLoad(&entry_ages[oldest]);
    }
    let count = min(most, found);
    entry_count = count;
    entry_oldest = oldest;
    atomicStore(&entry_rest, count - min(count, found - atomicLoad(&entry_ages[oldest])));
    texfold_tile_feedback.missing = wanted;
}

// The tiles of the first `most` ranks, and as many places for them.
fn entry_choose(thread: u32, entries: u32, most: u32) {
    for (var number = thread; number < entries; number += ENTRY_THREADS) {
        let tile = entry_wanted(number);
        if tile.is_wanted {
            let rank = atomicAdd(&entry_levels[tile.level], 1u);
            if rank < most {
                entry_chosen[rank] = number;
            }
        }
    }
    for (var slot = thread; slot < entry_options.slots; slot += ENTRY_THREADS) {
        let age = entry_age(slot);
        var is_given = age > entry_oldest;
        if age == entry_oldest && most > 0u {
            // The rest of those that are needed.
            is_given = atomicSub(&entry_rest, 1u) - 1u < most;
        }
        if is_given && age >= ENTRY_LEAST_AGE {
            let place = atomicAdd(&entry_next, 1u);
            if place < most {
                entry_places[place] = slot;
            }
        }
    }
}

// Requests of the chosen tiles, one for each of their images, of as many tiles as there is room for; returns how many.
fn entry_share_requests(most: u32) -> u32 {
    var requests = 0u;
    for (var rank = 0u; rank < most; rank += 1u) {
        let texture = texfold_tile_feedback.tiles[entry_chosen[rank]].x & 0xffffffu;
        let next = requests + texfold_tile_parts(texfold_tile_textures[texture].parts);
        if next > TEXFOLD_TILE_MOST {
            break;
        }
        entry_first[rank] = requests;
        for (; requests < next; requests += 1u) {
            entry_owner[requests] = rank;
        }
    }
    return requests;
}

// Plans a request; returns the words of scratch memory that it takes.
fn entry_planned(number: u32, tile: EntryTile, part: u32) -> u32 {
    if texfold_tile_textures[tile.texture].source == 0u {
        return entry_planes(number, tile, part);
    }
    for (var plane = 0u; plane < TEXFOLD_TILE_PLANES; plane += 1u) {
        entry_plan.passes[number * TEXFOLD_TILE_PLANES + plane].count = vec2<u32>(0u);
        entry_plan.passes[number * TEXFOLD_TILE_PLANES + plane].held = vec2<u32>(0u);
    }
    return 0u;
}

// First word of each request, for as many tiles as there are words.
fn entry_share_words(requests: u32) {
    // The first block of scratch memory stays 0.
    var words = TEXFOLD_BLOCK_WORDS;
    var count = 0u;
    var decoded = 0u;
    for (; count < requests; count += 1u) {
        let next = words + entry_words[count];
        if next > entry_options.words {
            // Nor the requests of the same tile before it.
            count = entry_first[entry_owner[count]];
            break;
        }
        entry_words[count] = words;
        words = next;
    }
    if count > 0u {
        decoded = entry_owner[count - 1u] + 1u;
    }
    entry_count = count;
    entry_plan.count = count;
    entry_plan.words = words;
    let cleared = ENTRY_WORKGROUP * ENTRY_CLEARED;
    entry_dispatch(0u, select(0u, (words + cleared - 1u) / cleared, count > 0u));
    texfold_tile_feedback.decoded = decoded;
    texfold_tile_feedback.missing -= decoded;
    texfold_tile_feedback.frame += 1u;
    atomicStore(&texfold_tile_feedback.wanted, 0u);
}

// Workgroups of the dispatch of that number.
fn entry_dispatch(number: u32, groups: u32) {
    entry_workgroups[3u * number] = groups;
    entry_workgroups[3u * number + 1u] = 1u;
    entry_workgroups[3u * number + 2u] = 1u;
}

// Gives a tile its place, and takes that from the one that had it; writes its request.
fn entry_place(number: u32, tile: EntryTile, part: u32) {
    let slot = entry_places[entry_owner[number]];
    let before = entry_slots[slot];
    if part == 0u {
        if before != 0u && texfold_tile_pages[before - 1u] == entry_there(slot) {
            texfold_tile_pages[before - 1u] = 0u;
        }
        entry_slots[slot] = tile.page + 1u;
        texfold_tile_pages[tile.page] = entry_there(slot);
    }
    let source = texfold_tile_textures[tile.texture].source;
    entry_plan.requests[number] = TexfoldTileRequest(
        tile.texture,
        tile.level | (part << 8u),
        tile.tile,
        entry_there(slot),
        select(ENTRY_DRAWN | source, entry_stage(tile, part), source == 0u),
    );
    for (var plane = 0u; plane < TEXFOLD_TILE_PLANES; plane += 1u) {
        let place = number * TEXFOLD_TILE_PLANES + plane;
        entry_plan.passes[place].samples += entry_words[number];
        entry_plan.passes[place].notes += entry_words[number];
        entry_plan.passes[place].base_samples += entry_words[number];
    }
}

// Sums of a plane over all tiles.
fn entry_sum(plane: u32, count: u32) {
    let first = plane * TEXFOLD_TILE_SUMS;
    var superblocks = 0u;
    var blocks = 0u;
    for (var number = 0u; number < count; number += 1u) {
        let planned = entry_plan.passes[number * TEXFOLD_TILE_PLANES + plane];
        entry_plan.sums[first + number] = superblocks;
        entry_plan.sums[TEXFOLD_TILE_BLOCKS + first + number] = blocks;
        // The streams of a workgroup are of one tile.
        let streams = planned.count.x * planned.count.y + ENTRY_STREAMS - 1u;
        superblocks += streams - streams % ENTRY_STREAMS;
        blocks += planned.held.x * planned.held.y * planned.axes;
    }
    entry_plan.sums[first + count] = superblocks;
    entry_plan.sums[TEXFOLD_TILE_BLOCKS + first + count] = blocks;
    atomicMax(&entry_streams, superblocks / ENTRY_STREAMS);
    entry_dispatch(2u + plane, (blocks + ENTRY_WORKGROUP - 1u) / ENTRY_WORKGROUP);
}

// Workgroups that write tiles of superblocks, where `source` is 0, or those of a pass that draws.
fn entry_write(source: u32, count: u32) {
    var tiles = 0u;
    for (var number = 0u; number < count; number += 1u) {
        let stage = entry_plan.requests[number].stage;
        tiles += u32(stage == (ENTRY_DRAWN | source) || (source == 0u && stage < ENTRY_DRAWN));
    }
    let write = 3u * (2u + TEXFOLD_TILE_PLANES + source);
    entry_workgroups[write] = TEXFOLD_TILE_SIDE / 8u;
    entry_workgroups[write + 1u] = TEXFOLD_TILE_SIDE / 8u;
    // A pass looks for its tiles among all of them.
    entry_workgroups[write + 2u] = select(0u, count, tiles > 0u);
}

@compute @workgroup_size(ENTRY_THREADS)
fn plan_tiles(@builtin(local_invocation_index) thread: u32) {
    let entries = min(atomicLoad(&texfold_tile_feedback.wanted), TEXFOLD_TILE_MOST_WANTED);
    entry_survey(thread, entries);
    workgroupBarrier();
    if thread == 0u {
        entry_decide();
    }
    let most = workgroupUniformLoad(&entry_count);
    entry_choose(thread, entries, most);
    workgroupBarrier();
    if thread == 0u {
        entry_count = entry_share_requests(most);
    }
    let requests = workgroupUniformLoad(&entry_count);
    var mine: EntryTile;
    var part = 0u;
    if thread < requests {
        let rank = entry_owner[thread];
        part = thread - entry_first[rank];
        mine = entry_wanted(entry_chosen[rank]);
        entry_words[thread] = entry_planned(thread, mine, part);
    }
    storageBarrier();
    workgroupBarrier();
    if thread == 0u {
        entry_share_words(requests);
    }
    let count = workgroupUniformLoad(&entry_count);
    if thread < count {
        entry_place(thread, mine, part);
    }
    storageBarrier();
    workgroupBarrier();
    if thread < TEXFOLD_TILE_PLANES {
        entry_sum(thread, count);
    }
    workgroupBarrier();
    if thread == 0u {
        entry_dispatch(1u, atomicLoad(&entry_streams));
        entry_workgroups[4] = TEXFOLD_TILE_PLANES;
    }
    for (var source = thread; source <= entry_options.sources; source += ENTRY_THREADS) {
        entry_write(source, count);
    }
}
