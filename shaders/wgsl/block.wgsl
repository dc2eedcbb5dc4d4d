// Textures in blocks of variable length, decoded by compute passes: a superblock's stream an invocation, then a block's
// inverse transform an invocation. CPU twins: crates/testkit/src/dct.
//
// All arithmetic is in 32-bit integers and wraps, so every device gives the texels of the CPU. Any bytes decode: streams end
// where the index and the length of all streams say, loops are bounded, and whatever a stream holds leads to places inside
// of the buffers. Coefficients, and later the samples in their place, lie in scratch memory, which is also what contexts
// look at; its first block stays 0 and stands for what lies beyond a border. What each symbol of a stream waits for lies in
// workgroup memory: constants, the plane's tables, and the magnitudes of the block that is read.

// First word of the coefficients in coding order: place, column by column, subband behind 8 bits; and behind 16 bits the
// number in coding order of the coefficient at the place of that number.
const TEXFOLD_BLOCK_SCAN: u32 = 0u;
// First word of the symbols: first number of coefficients, its plain bits behind 8 bits, first magnitude behind 16 bits, its
// plain bits behind 28.
const TEXFOLD_BLOCK_SYMBOLS: u32 = 128u;
// Tables of one kind of plane and axis.
const TEXFOLD_BLOCK_SET_TABLES: u32 = 111u;
// Tables of a subband.
const TEXFOLD_BLOCK_ZONE_TABLES: u32 = 16u;
// Tables of the odd quantiser in a set, those of two subbands each.
const TEXFOLD_BLOCK_ODD_TABLES: u32 = 48u;
// The state of dependent quantisation behind each one, behind an even magnitude and behind an odd one; four bits a state.
const TEXFOLD_BLOCK_NEXT_EVEN: u32 = 1933730128u;
const TEXFOLD_BLOCK_NEXT_ODD: u32 = 1365263218u;
// Absolute angles of the directions 0 to 3, 8 bits each; those of 4 to 6 are the same backwards.
const TEXFOLD_BLOCK_ANGLES: u32 = 331034u;
// First table of the last coefficient's magnitude in a set.
const TEXFOLD_BLOCK_FIRST_LAST: u32 = 96u;
// First table of numbers of coefficients in a set.
const TEXFOLD_BLOCK_FIRST_END: u32 = 102u;
// The symbol that an escaped magnitude follows.
const TEXFOLD_BLOCK_ESCAPE: u32 = 15u;
// Most bits of an escaped magnitude.
const TEXFOLD_BLOCK_ESCAPE_BITS: u32 = 24u;
// Largest magnitude that contexts tell apart.
const TEXFOLD_BLOCK_LARGEST: u32 = 127u;
// Superblocks of a group of the index.
const TEXFOLD_BLOCK_GROUP: u32 = 32u;
// Most pairs of symbols of a superblock: 64 blocks of 16 axes, a number of coefficients and 64 magnitudes each.
const TEXFOLD_BLOCK_MAX_ROUNDS: u32 = 33792u;
// A stream's state below is refilled.
const TEXFOLD_BLOCK_LOW: u32 = 65536u;
// Binary logarithm of the sum of a table's frequencies.
const TEXFOLD_BLOCK_PROBABILITY_BITS: u32 = 13u;
// Weights of the means around a block in its lowest coefficients, in 1/256: first, second and mixed differences.
const TEXFOLD_BLOCK_FIRST: i32 = 50;
const TEXFOLD_BLOCK_SECOND: i32 = 12;
const TEXFOLD_BLOCK_MIXED: i32 = 10;
// Constants of the transform in 1/256: the root of 2, 2 cos(pi / 8), 2 (cos(pi / 8) - cos(3 pi / 8)), their sum times 2.
const TEXFOLD_BLOCK_ROOT: i32 = 362;
const TEXFOLD_BLOCK_ROTATE_BOTH: i32 = 473;
const TEXFOLD_BLOCK_ROTATE_FIRST: i32 = 277;
const TEXFOLD_BLOCK_ROTATE_SECOND: i32 = 669;
// Lines across a border of a block.
const TEXFOLD_BLOCK_LINES: u32 = 8u;
// Eighths of a jump that are added to the samples next to a border, and to those behind them: of first axes and of others.
const TEXFOLD_BLOCK_FIRST_NEAR: i32 = 6;
const TEXFOLD_BLOCK_FIRST_FAR: i32 = -2;
const TEXFOLD_BLOCK_OTHER_NEAR: i32 = 8;
const TEXFOLD_BLOCK_OTHER_FAR: i32 = 3;

// A stream that is being read.
struct TexfoldBlockStream {
    state: u32,
    // First byte that is not read.
    next: u32,
    // First byte behind it.
    end: u32,
    // The two bytes from `next` on, loaded before they are needed.
    ahead: u32,
}

// What the contexts of a block's axis look at, as places in scratch memory; 0 for what is not there.
struct TexfoldBlockAround {
    // Its own coefficients.
    own: u32,
    left: u32,
    above: u32,
    // The axis before of the same block.
    cross: u32,
    // What is noted of it.
    notes: u32,
    // Weight of its own template in halves.
    gain: u32,
    // First table of its set, of those in workgroup memory, and first one of the odd quantiser.
    tables: u32,
    odd_tables: u32,
    // Table of its number of coefficients.
    end_table: u32,
    // Table of the block's intra mode; 0 where it has none.
    mode_table: u32,
}

// How far a superblock is read.
struct TexfoldBlockProgress {
    // What the contexts of the item look at.
    around: TexfoldBlockAround,
    // The block's axis that is read: blocks row by row, all axes of each.
    item: u32,
    // Coefficients of the item that are still to be read; 0 where their number is.
    left: u32,
    // 1 where the next one is the first to be read, which is not 0.
    is_last: u32,
    // The coefficients of the item that are not zero, by their numbers in coding order.
    nonzero: vec2<u32>,
    // Place and subband of the coefficient that is read next, as in coding order.
    scan: u32,
    // State of dependent quantisation; always 0 where quantisers are not dependent.
    state: u32,
    // Magnitudes at its place in the block to the left, the one above and the axis before.
    beside: vec3<u32>,
}

// The signs of a block's axis.
struct TexfoldBlockSigns {
    // The coefficients that are not zero, by their numbers in coding order.
    nonzero: vec2<u32>,
    // Their signs, that of the last one first.
    signs: vec2<u32>,
}

// Two bytes of the streams from byte `at` on.
fn texfold_block_pair(at: u32) -> u32 {
    let low = texfold_block_streams[at / 4u] >> (8u * (at % 4u));
    let high = (texfold_block_streams[at / 4u + 1u] << 1u) << (31u - 8u * (at % 4u));
    return (low | high) & 0xffffu;
}

// Length of a superblock's stream, of that place in the group of the index whose words begin at `group`.
fn texfold_block_length(group: u32, place: u32) -> u32 {
    let bit = place * texfold_block_pass.index_bits;
    let at = group + 1u + bit / 32u;
    let low = texfold_block_words[at] >> (bit % 32u);
    let high = (texfold_block_words[at + 1u] << 1u) << (31u - bit % 32u);
    return (low | high) & ((1u << texfold_block_pass.index_bits) - 1u);
}

// The stream of the superblock of that number; empty where it does not lie among the streams' bytes.
fn texfold_block_stream(number: u32) -> TexfoldBlockStream {
    let group = texfold_block_pass.index
        + number / TEXFOLD_BLOCK_GROUP * (texfold_block_pass.index_bits + 1u);
    let place = number % TEXFOLD_BLOCK_GROUP;
    let first = texfold_block_words[group];
    var start = first;
    for (var before = 0u; before < min(place, TEXFOLD_BLOCK_GROUP); before += 1u) {
        start += texfold_block_length(group, before);
    }
    var end = start + texfold_block_length(group, place);
    if end < first || end > texfold_block_pass.stream_bytes {
        start = 0u;
        end = 0u;
    }
    start += texfold_block_pass.streams;
    end += texfold_block_pass.streams;
    // The parity of the length says whether the state has 3 or 4 bytes.
    let length = end - start;
    let head = select(4u - length % 2u, length, length < 4u);
    let bytes = texfold_block_pair(start) | (texfold_block_pair(start + 2u) << 16u);
    let mask = (0xffffffffu >> (8u * (4u - max(head, 1u)))) * u32(head > 0u);
    return TexfoldBlockStream(bytes & mask, start + head, end, texfold_block_pair(start + head));
}

// Takes two bytes where the state is low and there are any.
fn texfold_block_refill(stream: ptr<function, TexfoldBlockStream>) {
    if (*stream).state < TEXFOLD_BLOCK_LOW && (*stream).next + 2u <= (*stream).end {
        (*stream).state = ((*stream).state << 16u) | (*stream).ahead;
        (*stream).next += 2u;
        (*stream).ahead = texfold_block_pair((*stream).next);
    }
}

// The next symbol, by the table of that number, which has for each pair of symbols the first slots of both, the first in the lower
// half: halving, without loads that wait for one another.
fn texfold_block_symbol(stream: ptr<function, TexfoldBlockStream>, table: u32) -> u32 {
    let slots = 1u << TEXFOLD_BLOCK_PROBABILITY_BITS;
    let slot = (*stream).state & (slots - 1u);
    let lower = texfold_block_tables[2u * table];
    let upper = texfold_block_tables[2u * table + 1u];
    let is_upper = (upper.x & 0xffffu) <= slot;
    let four = select(lower, upper, is_upper);
    let is_later = (four.z & 0xffffu) <= slot;
    let two = select(four.xy, four.zw, is_later);
    let is_last = (two.y & 0xffffu) <= slot;
    let both = select(two.x, two.y, is_last);
    let is_second = (both >> 16u) <= slot;
    // The first slot of the next pair.
    var after = select(upper.x & 0xffffu, slots, is_upper);
    after = select(four.z & 0xffffu, after, is_later);
    after = select(two.y & 0xffffu, after, is_last);
    let first = select(both & 0xffffu, both >> 16u, is_second);
    let end = select(both >> 16u, after, is_second);
    (*stream).state = (end - first) * ((*stream).state >> TEXFOLD_BLOCK_PROBABILITY_BITS) + slot - first;
    texfold_block_refill(stream);
    return 8u * u32(is_upper) + 4u * u32(is_later) + 2u * u32(is_last) + u32(is_second);
}

// The next number of at most 16 bits.
fn texfold_block_bits(stream: ptr<function, TexfoldBlockStream>, count: u32) -> u32 {
    let value = (*stream).state & ((1u << count) - 1u);
    (*stream).state >>= count;
    texfold_block_refill(stream);
    return value;
}

// A magnitude from 8 on.
fn texfold_block_large(stream: ptr<function, TexfoldBlockStream>, symbol: u32) -> u32 {
    let word = texfold_block_constants[TEXFOLD_BLOCK_SYMBOLS + symbol];
    let first = (word >> 16u) & 0xfffu;
    if symbol < TEXFOLD_BLOCK_ESCAPE {
        return first + texfold_block_bits(stream, word >> 28u);
    }
    let length = min(texfold_block_bits(stream, 5u), TEXFOLD_BLOCK_ESCAPE_BITS);
    let low = texfold_block_bits(stream, min(length, 12u));
    let high = texfold_block_bits(stream, max(length, 12u) - 12u);
    return first + (low | (high << 12u));
}

// Whether the plane's blocks have intra modes.
fn texfold_block_has_modes() -> bool {
    return ((texfold_block_pass.offsets >> 17u) & 1u) == 1u && texfold_block_pass.is_base == 0u;
}

// Where the contexts of a block's axis look: of the block of that number in its superblock, which has `blocks` columns and rows
// and begins at `corner` of the blocks that are held.
fn texfold_block_around(corner: vec2<u32>, blocks: vec2<u32>, block: u32, axis: u32) -> TexfoldBlockAround {
    let at = vec2<u32>(block % blocks.x, block / blocks.x);
    let held = texfold_block_pass.held;
    let slot = (axis * held.y + corner.y + at.y) * held.x + corner.x + at.x;
    let own = texfold_block_pass.samples + slot * TEXFOLD_BLOCK_WORDS;
    let notes = texfold_block_pass.notes + slot * TEXFOLD_BLOCK_NOTES;
    let rank = (texfold_block_pass.ranks >> (2u * axis)) & 3u;
    let has_left = at.x > 0u;
    let has_above = at.y > 0u;
    let one = select(0u, own - TEXFOLD_BLOCK_WORDS, has_left);
    let other = select(0u, own - held.x * TEXFOLD_BLOCK_WORDS, has_above);
    let left_end = select(0u, notes - TEXFOLD_BLOCK_NOTES, has_left);
    let above_end = select(0u, notes - held.x * TEXFOLD_BLOCK_NOTES, has_above);
    // Where there is only one neighbour, it counts twice.
    let left = select(other, one, has_left);
    let above = select(one, other, has_above);
    let before = u32(texfold_block_scratch[select(above_end, left_end, has_left)]);
    let over = u32(texfold_block_scratch[select(left_end, above_end, has_above)]);
    let ends = (before & 255u) + (over & 255u);
    let apart = !has_left && !has_above;
    // Those of modes stand behind all others.
    let modes = 2u * (TEXFOLD_BLOCK_SET_TABLES + TEXFOLD_BLOCK_ODD_TABLES);
    let has_mode = texfold_block_has_modes() && axis == 0u && !apart;
    let predicted = u32(has_left && before > 255u) + u32(has_above && over > 255u);
    let tables = u32(rank > 0u) * TEXFOLD_BLOCK_SET_TABLES;
    let cross = select(0u, own - held.x * held.y * TEXFOLD_BLOCK_WORDS, rank > 1u);
    return TexfoldBlockAround(
        own,
        left,
        above,
        cross,
        notes,
        select(4u, 5u, apart),
        tables,
        2u * TEXFOLD_BLOCK_SET_TABLES + u32(rank > 0u) * TEXFOLD_BLOCK_ODD_TABLES,
        tables + TEXFOLD_BLOCK_FIRST_END + select(texfold_block_end_class(ends), 8u, apart),
        select(0u, modes + predicted, has_mode),
    );
}

// Context by the sum of both neighbours' symbols of the number of coefficients.
fn texfold_block_end_class(sum: u32) -> u32 {
    return select(min((sum + 5u) / 4u, 7u), 0u, sum == 0u);
}

// A coefficient's magnitude as far as contexts tell it apart; halves of steps are held, twice the magnitude or one less.
fn texfold_block_magnitude(at: u32) -> u32 {
    return min((u32(texfold_block_scratch[at]) + 1u) >> 1u, TEXFOLD_BLOCK_LARGEST);
}

// The state of dependent quantisation behind a magnitude.
fn texfold_block_next(state: u32, magnitude: u32) -> u32 {
    let is_dependent = (texfold_block_pass.offsets >> 16u) & 1u;
    let states = select(TEXFOLD_BLOCK_NEXT_EVEN, TEXFOLD_BLOCK_NEXT_ODD, (magnitude & is_dependent) == 1u);
    return (states >> (4u * state)) & 7u;
}

// Class of the expected magnitude of a coefficient of a block, whose coefficients later in the scan are all known: of the one that
// is held at `own`, between `beside` of the blocks around. What is held is `zero` more than its magnitude; less is of an item before, or
// lies behind an edge.
fn texfold_block_level(gain: u32, own: u32, zero: u32, beside: vec3<u32>) -> u32 {
    let later = max(texfold_block_held[own + 10u], zero)
        + max(texfold_block_held[own + 20u], zero)
        + max(texfold_block_held[own + 1u], zero)
        + max(texfold_block_held[own + 2u], zero)
        + max(texfold_block_held[own + 11u], zero);
    let expected = (((later - 5u * zero) * gain) >> 1u) + beside.x + beside.y + beside.z;
    return texfold_block_levels[min(expected, 255u)];
}

// Reads the signs of a block's axis and notes them: up to 16 at once, after all magnitudes.
fn texfold_block_note(stream: ptr<function, TexfoldBlockStream>, notes: u32, nonzero: vec2<u32>) {
    let count = countOneBits(nonzero.x) + countOneBits(nonzero.y);
    var signs = vec2<u32>(texfold_block_bits(stream, min(count, 16u)), 0u);
    if count > 16u {
        signs.x |= texfold_block_bits(stream, min(count - 16u, 16u)) << 16u;
    }
    if count > 32u {
        signs.y = texfold_block_bits(stream, min(count - 32u, 16u));
    }
    if count > 48u {
        signs.y |= texfold_block_bits(stream, count - 48u) << 16u;
    }
    texfold_block_scratch[notes + 1u] = i32(nonzero.x);
    texfold_block_scratch[notes + 2u] = i32(nonzero.y);
    texfold_block_scratch[notes + 3u] = i32(signs.x);
    texfold_block_scratch[notes + 4u] = i32(signs.y);
}

// Reads a symbol of a superblock of `blocks` columns and rows of blocks, the first of them at `corner` of those that are held:
// the number of coefficients of a block's axis or a coefficient's magnitude, which goes to scratch memory.
fn texfold_block_round(
    corner: vec2<u32>,
    blocks: vec2<u32>,
    stream: ptr<function, TexfoldBlockStream>,
    progress: ptr<function, TexfoldBlockProgress>,
) {
    let first = texfold_block_pass.has_base;
    let begins = (*progress).left == 0u;
    let number = first + max((*progress).left, 1u) - 1u;
    let at = (*progress).scan & 255u;
    let zone = ((*progress).scan >> 8u) & 255u;
    let own = texfold_block_lane + at + at / 8u * 2u;
    // No clearing between items: each holds larger numbers than the one before.
    let zero = ((*progress).item + 1u) * (TEXFOLD_BLOCK_LARGEST + 1u);
    var table = (*progress).around.tables + TEXFOLD_BLOCK_FIRST_LAST + zone;
    var mode = 0u;
    if begins {
        let axes = texfold_block_pass.axes;
        (*progress).around =
            texfold_block_around(corner, blocks, (*progress).item / axes, (*progress).item % axes);
        table = (*progress).around.end_table;
        if (*progress).around.mode_table > 0u {
            mode = texfold_block_symbol(stream, (*progress).around.mode_table);
        }
    } else if (*progress).is_last == 0u {
        let even = (*progress).around.tables + zone * TEXFOLD_BLOCK_ZONE_TABLES;
        let odd = (*progress).around.odd_tables + zone / 2u * TEXFOLD_BLOCK_ZONE_TABLES;
        table = select(even, odd, ((*progress).state & 1u) == 1u)
            + texfold_block_level((*progress).around.gain, own, zero, (*progress).beside);
    }
    // What the coefficient behind it needs, loaded while the symbol is read.
    let scan = texfold_block_constants[TEXFOLD_BLOCK_SCAN + max(number, 1u) - 1u];
    let beside = vec3<u32>(
        texfold_block_magnitude((*progress).around.left + (scan & 255u)),
        texfold_block_magnitude((*progress).around.above + (scan & 255u)),
        texfold_block_magnitude((*progress).around.cross + (scan & 255u)),
    );
    let symbol = texfold_block_symbol(stream, table);
    if begins {
        let word = texfold_block_constants[TEXFOLD_BLOCK_SYMBOLS + symbol];
        let more = texfold_block_bits(stream, (word >> 8u) & 255u);
        (*progress).left = min((word & 255u) + more, TEXFOLD_BLOCK_WORDS - first);
        (*progress).is_last = 1u;
        (*progress).state = 0u;
        (*progress).nonzero = vec2<u32>(0u);
        (*progress).scan = texfold_block_constants[TEXFOLD_BLOCK_SCAN + first + max((*progress).left, 1u) - 1u];
        texfold_block_scratch[(*progress).around.notes] = i32(symbol | (mode << 8u));
    } else {
        var magnitude = symbol;
        if symbol > 7u {
            magnitude = texfold_block_large(stream, symbol);
        }
        magnitude += (*progress).is_last;
        texfold_block_held[own] = zero + min(magnitude, TEXFOLD_BLOCK_LARGEST);
        if magnitude > 0u {
            texfold_block_scratch[(*progress).around.own + at] = i32(2u * magnitude - ((*progress).state & 1u));
            let bit = 1u << (number % 32u);
            (*progress).nonzero |= select(vec2<u32>(bit, 0u), vec2<u32>(0u, bit), number >= 32u);
        }
        (*progress).state = texfold_block_next((*progress).state, magnitude);
        (*progress).left -= 1u;
        (*progress).is_last = 0u;
        (*progress).scan = scan;
        (*progress).beside = beside;
        if (*progress).left == 0u {
            texfold_block_note(stream, (*progress).around.notes, (*progress).nonzero);
        }
    }
    (*progress).item += u32((*progress).left == 0u);
}

// Columns and rows of blocks of the superblock in that column and row of the plane.
fn texfold_block_blocks(superblock: vec2<u32>) -> vec2<u32> {
    let side = texfold_block_pass.side;
    return min(texfold_block_pass.plane_blocks - superblock * side, vec2<u32>(side));
}

// Reads the superblock in that column and row of those to decode. Invocations side by side stay together although their
// blocks are of different lengths, as each round reads a symbol whatever it is. Two rounds a time: Mesa's software renderer
// ends all loops of an invocation after 65535 rounds.
fn texfold_block_superblock(place: vec2<u32>) {
    let side = texfold_block_pass.side;
    let superblock = texfold_block_wrapped(texfold_block_pass.first + place, texfold_block_pass.wrap / side);
    let blocks = texfold_block_blocks(superblock);
    let items = blocks.x * blocks.y * texfold_block_pass.axes;
    let row = texfold_block_pass.superblock_start + superblock.y * texfold_block_pass.superblock_columns;
    var stream = texfold_block_stream(row + superblock.x);
    var progress: TexfoldBlockProgress;
    for (var round = 0u; round < min(items * 33u, TEXFOLD_BLOCK_MAX_ROUNDS); round += 1u) {
        if progress.item >= items {
            break;
        }
        texfold_block_round(place * side, blocks, &stream, &progress);
        if progress.item < items {
            texfold_block_round(place * side, blocks, &stream, &progress);
        }
    }
}

// Places behind the last column or row are those of the first ones; `at` is less than twice `all`.
fn texfold_block_wrapped(at: vec2<u32>, all: vec2<u32>) -> vec2<u32> {
    return at - select(vec2<u32>(0u), all, at >= all);
}

// The base's sample for a block of an axis; beyond a border the nearest one.
fn texfold_block_mean(axis: u32, at: vec2<i32>) -> i32 {
    let last = vec2<i32>(texfold_block_pass.plane_blocks) - vec2<i32>(1);
    let first = texfold_block_pass.base_first;
    let all = texfold_block_pass.base_wrap;
    let inside = texfold_block_wrapped(vec2<u32>(clamp(at, vec2<i32>(0), last)) + all - first, all);
    let held = texfold_block_pass.base_held;
    let slot = (axis * held.y + inside.y / 8u) * held.x + inside.x / 8u;
    let place = inside.y % 8u * 8u + inside.x % 8u;
    return texfold_block_scratch[texfold_block_pass.base_samples + slot * TEXFOLD_BLOCK_WORDS + place];
}

// A value times a weight in 1/256, rounded.
fn texfold_block_weighted(value: i32, weight: i32) -> i32 {
    return (value * weight + 128) >> 8u;
}

// What the means around a block say of its coefficients: the columns 0, 1 and 2, three rows each.
fn texfold_block_predict(axis: u32, at: vec2<i32>) -> array<vec4<i32>, 3> {
    let middle = texfold_block_mean(axis, at);
    let west = texfold_block_mean(axis, at + vec2<i32>(-1, 0));
    let east = texfold_block_mean(axis, at + vec2<i32>(1, 0));
    let north = texfold_block_mean(axis, at + vec2<i32>(0, -1));
    let south = texfold_block_mean(axis, at + vec2<i32>(0, 1));
    let corners = texfold_block_mean(axis, at + vec2<i32>(-1, -1))
        - texfold_block_mean(axis, at + vec2<i32>(1, -1))
        - texfold_block_mean(axis, at + vec2<i32>(-1, 1))
        + texfold_block_mean(axis, at + vec2<i32>(1, 1));
    let across = texfold_block_weighted(west - east, TEXFOLD_BLOCK_FIRST);
    let across_second = texfold_block_weighted(west + east - middle * 2, TEXFOLD_BLOCK_SECOND);
    let down = texfold_block_weighted(north - south, TEXFOLD_BLOCK_FIRST);
    let down_second = texfold_block_weighted(north + south - middle * 2, TEXFOLD_BLOCK_SECOND);
    let mixed = texfold_block_weighted(corners, TEXFOLD_BLOCK_MIXED);
    return array<vec4<i32>, 3>(
        vec4<i32>(middle, down, down_second, 0),
        vec4<i32>(across, mixed, 0, 0),
        vec4<i32>(across_second, 0, 0, 0),
    );
}

// What is noted of the signs of the block's axis of that number.
fn texfold_block_signs(slot: u32) -> TexfoldBlockSigns {
    let notes = texfold_block_pass.notes + slot * TEXFOLD_BLOCK_NOTES;
    let nonzero = vec2<i32>(texfold_block_scratch[notes + 1u], texfold_block_scratch[notes + 2u]);
    let signs = vec2<i32>(texfold_block_scratch[notes + 3u], texfold_block_scratch[notes + 4u]);
    return TexfoldBlockSigns(vec2<u32>(nonzero), vec2<u32>(signs));
}

// Whether the coefficient at place `at` is negative.
fn texfold_block_negative(signs: TexfoldBlockSigns, at: u32) -> bool {
    let number = texfold_block_words[TEXFOLD_BLOCK_SCAN + at] >> 16u;
    let is_high = number >= 32u;
    // Those that were read before it.
    let before = (select(signs.nonzero.x, signs.nonzero.y, is_high) >> (number % 32u)) >> 1u;
    let place = countOneBits(before) + select(countOneBits(signs.nonzero.y), 0u, is_high);
    return ((select(signs.signs.x, signs.signs.y, place >= 32u) >> (place % 32u)) & 1u) == 1u;
}

// What the halves of steps in scratch memory at `own` + `at` stand for, `at` its place in the block.
fn texfold_block_rebuilt(signs: TexfoldBlockSigns, own: u32, at: u32) -> i32 {
    let halves = u32(texfold_block_scratch[own + at]);
    let offset = (texfold_block_pass.offsets >> (8u * u32(halves > 2u))) & 255u;
    let finer = (halves << 4u) - offset * u32(halves > 0u);
    let value = i32((finer * texfold_block_words[texfold_block_pass.steps + at]) >> 9u);
    return select(value, -value, texfold_block_negative(signs, at));
}

// Four of them.
fn texfold_block_four(signs: TexfoldBlockSigns, own: u32, at: u32) -> vec4<i32> {
    return vec4<i32>(
        texfold_block_rebuilt(signs, own, at),
        texfold_block_rebuilt(signs, own, at + 1u),
        texfold_block_rebuilt(signs, own, at + 2u),
        texfold_block_rebuilt(signs, own, at + 3u),
    );
}

// Times a constant in 1/256, rounded.
fn texfold_block_times(value: vec4<i32>, constant: i32) -> vec4<i32> {
    return (value * constant + vec4<i32>(128)) >> vec4<u32>(8u);
}

// Four transforms side by side: the eight values of which `input` has the frequencies.
fn texfold_block_transform(input: array<vec4<i32>, 8>) -> array<vec4<i32>, 8> {
    let sum = input[0] + input[4];
    let difference = input[0] - input[4];
    let both = input[2] + input[6];
    let rotated = texfold_block_times(input[2] - input[6], TEXFOLD_BLOCK_ROOT) - both;
    let even0 = sum + both;
    let even1 = difference + rotated;
    let even2 = difference - rotated;
    let even3 = sum - both;
    let z13 = input[5] + input[3];
    let z10 = input[5] - input[3];
    let z11 = input[1] + input[7];
    let z12 = input[1] - input[7];
    let odd0 = z11 + z13;
    let z5 = texfold_block_times(z10 + z12, TEXFOLD_BLOCK_ROTATE_BOTH);
    let odd1 = z5 - texfold_block_times(z10, TEXFOLD_BLOCK_ROTATE_SECOND) - odd0;
    let odd2 = texfold_block_times(z11 - z13, TEXFOLD_BLOCK_ROOT) - odd1;
    let odd3 = texfold_block_times(z12, TEXFOLD_BLOCK_ROTATE_FIRST) - z5 + odd2;
    return array<vec4<i32>, 8>(
        even0 + odd0,
        even1 + odd1,
        even2 + odd2,
        even3 - odd3,
        even3 + odd3,
        even2 - odd2,
        even1 - odd1,
        even0 - odd0,
    );
}

// Four columns of four values as rows.
fn texfold_block_square(a: vec4<i32>, b: vec4<i32>, c: vec4<i32>, d: vec4<i32>) -> array<vec4<i32>, 4> {
    return array<vec4<i32>, 4>(
        vec4<i32>(a.x, b.x, c.x, d.x),
        vec4<i32>(a.y, b.y, c.y, d.y),
        vec4<i32>(a.z, b.z, c.z, d.z),
        vec4<i32>(a.w, b.w, c.w, d.w),
    );
}

// Four columns of a block's samples from the rows 0 to 3 and 4 to 7 of its coefficients' transform, four columns of them.
fn texfold_block_rows(upper: array<vec4<i32>, 4>, lower: array<vec4<i32>, 4>) -> array<vec4<i32>, 8> {
    let a = texfold_block_square(upper[0], upper[1], upper[2], upper[3]);
    let b = texfold_block_square(lower[0], lower[1], lower[2], lower[3]);
    return array<vec4<i32>, 8>(a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]);
}

// Holds a row of a block's samples.
fn texfold_block_put(at: u32, left: vec4<i32>, right: vec4<i32>) {
    texfold_block_scratch[at] = left.x;
    texfold_block_scratch[at + 1u] = left.y;
    texfold_block_scratch[at + 2u] = left.z;
    texfold_block_scratch[at + 3u] = left.w;
    texfold_block_scratch[at + 4u] = right.x;
    texfold_block_scratch[at + 5u] = right.y;
    texfold_block_scratch[at + 6u] = right.z;
    texfold_block_scratch[at + 7u] = right.w;
}

// Half of a block's columns, transformed along its rows: the upper half where `at` is 0, the lower one where it is 4.
fn texfold_block_half(
    signs: TexfoldBlockSigns,
    own: u32,
    at: u32,
    predicted: array<vec4<i32>, 3>,
) -> array<vec4<i32>, 8> {
    return texfold_block_transform(array<vec4<i32>, 8>(
        texfold_block_four(signs, own, at) + predicted[0],
        texfold_block_four(signs, own, at + 8u) + predicted[1],
        texfold_block_four(signs, own, at + 16u) + predicted[2],
        texfold_block_four(signs, own, at + 24u),
        texfold_block_four(signs, own, at + 32u),
        texfold_block_four(signs, own, at + 40u),
        texfold_block_four(signs, own, at + 48u),
        texfold_block_four(signs, own, at + 56u),
    ));
}

// Column and row in the plane of the block of that number of those that are held.
fn texfold_block_place(slot: u32) -> vec2<u32> {
    let held = texfold_block_pass.held;
    let place = vec2<u32>(slot % held.x, slot / held.x % held.y);
    return texfold_block_wrapped(texfold_block_pass.first * texfold_block_pass.side + place, texfold_block_pass.wrap);
}

// Turns the coefficients of a block's axis, the one of that number of those that are held, into its samples, in their place.
fn texfold_block_samples(slot: u32) {
    let held = texfold_block_pass.held;
    let axis = slot / (held.x * held.y);
    let at = vec2<i32>(texfold_block_place(slot));
    let own = texfold_block_pass.samples + slot * TEXFOLD_BLOCK_WORDS;
    let nothing = vec4<i32>(0);
    var predicted = array<vec4<i32>, 3>(nothing, nothing, nothing);
    let none = predicted;
    if texfold_block_pass.has_base == 1u {
        predicted = texfold_block_predict(axis, at);
    }
    if texfold_block_has_modes() && texfold_block_mode(slot) > 0u {
        predicted = array<vec4<i32>, 3>(vec4<i32>(predicted[0].x, 0, 0, 0), nothing, nothing);
    }
    let signs = texfold_block_signs(slot);
    let upper = texfold_block_half(signs, own, 0u, predicted);
    let lower = texfold_block_half(signs, own, 4u, none);
    let left = texfold_block_transform(texfold_block_rows(
        array<vec4<i32>, 4>(upper[0], upper[1], upper[2], upper[3]),
        array<vec4<i32>, 4>(lower[0], lower[1], lower[2], lower[3]),
    ));
    let right = texfold_block_transform(texfold_block_rows(
        array<vec4<i32>, 4>(upper[4], upper[5], upper[6], upper[7]),
        array<vec4<i32>, 4>(lower[4], lower[5], lower[6], lower[7]),
    ));
    texfold_block_put(own, left[0], right[0]);
    texfold_block_put(own + 8u, left[1], right[1]);
    texfold_block_put(own + 16u, left[2], right[2]);
    texfold_block_put(own + 24u, left[3], right[3]);
    texfold_block_put(own + 32u, left[4], right[4]);
    texfold_block_put(own + 40u, left[5], right[5]);
    texfold_block_put(own + 48u, left[6], right[6]);
    texfold_block_put(own + 56u, left[7], right[7]);
}

// Filters a line across a border: the samples of both blocks next to it lie at `before` and `own`, those behind them `across`
// words before and after.
fn texfold_block_smooth(before: u32, own: u32, across: u32, limit: i32, near: i32, far: i32) {
    let p1 = texfold_block_scratch[before - across];
    let p0 = texfold_block_scratch[before];
    let q0 = texfold_block_scratch[own];
    let q1 = texfold_block_scratch[own + across];
    let jump = clamp(((q0 - p0) * 9 - (q1 - p1) * 3 + 8) >> 4u, -limit, limit);
    let by_near = (jump * near + 4) >> 3u;
    let by_far = (jump * far + 4) >> 3u;
    texfold_block_scratch[before - across] = p1 + by_far;
    texfold_block_scratch[before] = p0 + by_near;
    texfold_block_scratch[own] = q0 - by_near;
    texfold_block_scratch[own + across] = q1 - by_far;
}

// Filters the border between a block's axis, the one of that number of those that are held, and the block to its left, or the
// one above where `is_above` is 1; not where a superblock ends.
fn texfold_block_deblock(slot: u32, is_above: u32) {
    let held = texfold_block_pass.held;
    let axis = slot / (held.x * held.y);
    let place = select(slot % held.x, slot / held.x % held.y, is_above == 1u);
    if place % texfold_block_pass.side == 0u || any(texfold_block_place(slot) >= texfold_block_pass.plane_blocks) {
        return;
    }
    let across = select(1u, 8u, is_above == 1u);
    let along = select(8u, 1u, is_above == 1u);
    let own = texfold_block_pass.samples + slot * TEXFOLD_BLOCK_WORDS;
    let before = own - select(1u, held.x, is_above == 1u) * TEXFOLD_BLOCK_WORDS + 7u * across;
    let is_first = ((texfold_block_pass.ranks >> (2u * axis)) & 3u) == 0u;
    let limit = texfold_block_pass.deblocking * select(2, 1, is_first);
    let near = select(TEXFOLD_BLOCK_OTHER_NEAR, TEXFOLD_BLOCK_FIRST_NEAR, is_first);
    let far = select(TEXFOLD_BLOCK_OTHER_FAR, TEXFOLD_BLOCK_FIRST_FAR, is_first);
    for (var line = 0u; line < min(8u, TEXFOLD_BLOCK_LINES); line += 1u) {
        texfold_block_smooth(before + line * along, own + line * along, across, limit, near, far);
    }
}

// A sample of an axis, of those that are held.
fn texfold_block_sample(axis: u32, at: vec2<u32>) -> i32 {
    let held = texfold_block_pass.held;
    let slot = (min(axis, texfold_block_pass.axes - 1u) * held.y + at.y / 8u) * held.x + at.x / 8u;
    let place = at.y % 8u * 8u + at.x % 8u;
    return texfold_block_scratch[texfold_block_pass.samples + slot * TEXFOLD_BLOCK_WORDS + place];
}

// A channel of the texel at `at` of those that are held: `mean` and the weighted axes from `first` on, of which `shift` bits
// are fractional, between 0 and `largest`.
fn texfold_block_channel(at: vec2<u32>, mean: i32, first: u32, weights: vec4<i32>, shift: u32, largest: i32) -> i32 {
    let sum = mean
        + texfold_block_sample(first, at) * weights.x
        + texfold_block_sample(first + 1u, at) * weights.y
        + texfold_block_sample(first + 2u, at) * weights.z
        + texfold_block_sample(first + 3u, at) * weights.w;
    return clamp(sum >> shift, 0, largest);
}

// The square root of a number, rounded.
fn texfold_block_root(value: u32) -> u32 {
    var root = min(u32(sqrt(f32(value))), 65535u);
    if root * root > value {
        root -= 1u;
    } else if root < 65535u && (root + 1u) * (root + 1u) <= value {
        root += 1u;
    }
    return root + u32(value - root * root > root);
}
