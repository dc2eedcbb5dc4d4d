//! CPU reference of `shaders/wgsl/block.wgsl`, function for function.
//!
//! [`decode`] runs it on what [`texfold_core::GpuDct`] hands to a GPU, in the order of the compute passes: all
//! streams of a plane, then the inverse transforms of its blocks, then channels. `decode.rs` gives the same texels, faster: one superblock at a time, 8-bit
//! magnitudes, loops over lanes.

mod intra;
mod passes;
mod samples;

pub use intra::*;
pub use passes::decode;
pub use samples::*;

use glam::UVec2;
use texfold_shaders::DctPass;

/// Words of a block.
pub const TEXFOLD_BLOCK_WORDS: u32 = 64;
/// First word of the coefficients in coding order: place, column by column, subband behind 8 bits; and behind 16 bits the
/// number in coding order of the coefficient at the place of that number.
pub const TEXFOLD_BLOCK_SCAN: u32 = 0;
/// First word of the classes of expected magnitudes, four a word.
pub const TEXFOLD_BLOCK_LEVELS: u32 = 64;
/// First word of the symbols: first number of coefficients, its plain bits behind 8 bits, first magnitude behind 16 bits, its
/// plain bits behind 28.
pub const TEXFOLD_BLOCK_SYMBOLS: u32 = 128;
/// Words that are noted of a block's axis.
pub const TEXFOLD_BLOCK_NOTES: u32 = 5;
/// Words of a table.
pub const TEXFOLD_BLOCK_TABLE_WORDS: u32 = 8;
/// Tables of one kind of plane and axis.
pub const TEXFOLD_BLOCK_SET_TABLES: u32 = 111;
/// Tables of a subband.
pub const TEXFOLD_BLOCK_ZONE_TABLES: u32 = 16;
/// Tables of the odd quantiser in a set, those of two subbands each.
pub const TEXFOLD_BLOCK_ODD_TABLES: u32 = 48;
/// The state of dependent quantisation behind each one, behind an even magnitude; four bits a state.
pub const TEXFOLD_BLOCK_NEXT_EVEN: u32 = 1933730128;
/// The same behind an odd magnitude.
pub const TEXFOLD_BLOCK_NEXT_ODD: u32 = 1365263218;
/// Absolute angles of the directions 0 to 3, 8 bits each; those of 4 to 6 are the same backwards.
pub const TEXFOLD_BLOCK_ANGLES: u32 = 331034;
/// First table of the last coefficient's magnitude in a set.
pub const TEXFOLD_BLOCK_FIRST_LAST: u32 = 96;
/// First table of numbers of coefficients in a set.
pub const TEXFOLD_BLOCK_FIRST_END: u32 = 102;
/// The symbol that an escaped magnitude follows.
pub const TEXFOLD_BLOCK_ESCAPE: u32 = 15;
/// Most bits of an escaped magnitude.
pub const TEXFOLD_BLOCK_ESCAPE_BITS: u32 = 24;
/// Largest magnitude that contexts tell apart.
pub const TEXFOLD_BLOCK_LARGEST: u32 = 127;
/// Superblocks of a group of the index.
pub const TEXFOLD_BLOCK_GROUP: u32 = 32;
/// Most pairs of symbols of a superblock: 64 blocks of 16 axes, a number of coefficients and 64 magnitudes each.
pub const TEXFOLD_BLOCK_MAX_ROUNDS: u32 = 33792;
/// A stream's state below is refilled.
pub const TEXFOLD_BLOCK_LOW: u32 = 65536;
/// Binary logarithm of the sum of a table's frequencies.
pub const TEXFOLD_BLOCK_PROBABILITY_BITS: u32 = 13;
/// Weight of the first differences of means around a block in its lowest coefficients, in 1/256.
pub const TEXFOLD_BLOCK_FIRST: i32 = 50;
/// Weight of the second differences.
pub const TEXFOLD_BLOCK_SECOND: i32 = 12;
/// Weight of the differences along both sides.
pub const TEXFOLD_BLOCK_MIXED: i32 = 10;
/// The root of 2 in 1/256.
pub const TEXFOLD_BLOCK_ROOT: i32 = 362;
/// 2 cos(pi / 8) in 1/256.
pub const TEXFOLD_BLOCK_ROTATE_BOTH: i32 = 473;
/// 2 (cos(pi / 8) - cos(3 pi / 8)) in 1/256.
pub const TEXFOLD_BLOCK_ROTATE_FIRST: i32 = 277;
/// 2 (cos(pi / 8) + cos(3 pi / 8)) in 1/256.
pub const TEXFOLD_BLOCK_ROTATE_SECOND: i32 = 669;
/// Lines across a border of a block.
pub const TEXFOLD_BLOCK_LINES: u32 = 8;
/// Eighths of a jump that are added to the samples next to a border, of first axes.
pub const TEXFOLD_BLOCK_FIRST_NEAR: i32 = 6;
/// Eighths of a jump that are added to those behind them, of first axes.
pub const TEXFOLD_BLOCK_FIRST_FAR: i32 = -2;
/// As [`TEXFOLD_BLOCK_FIRST_NEAR`], of other axes.
pub const TEXFOLD_BLOCK_OTHER_NEAR: i32 = 8;
/// As [`TEXFOLD_BLOCK_FIRST_FAR`], of other axes.
pub const TEXFOLD_BLOCK_OTHER_FAR: i32 = 3;

/// What a pass of the shader has bound.
#[derive(Debug)]
pub struct DctView<'a> {
    /// The uniform block.
    pub pass: &'a DctPass,
    /// Constants, tables, steps, index.
    pub words: &'a [u32],
    /// The streams' bytes, the lowest of a word first, and a word behind them.
    pub streams: &'a [u32],
    /// Coefficients and samples.
    pub scratch: &'a mut [i32],
}

/// A stream that is being read.
#[derive(Debug, Clone, Copy, Default)]
pub struct TexfoldBlockStream {
    state: u32,
    /// First byte that is not read.
    next: u32,
    /// First byte behind it.
    end: u32,
}

/// What the contexts of a block's axis look at, as places in scratch memory; 0 for what is not there.
#[derive(Debug, Clone, Copy, Default)]
pub struct TexfoldBlockAround {
    /// Its own coefficients.
    own: u32,
    left: u32,
    above: u32,
    /// The axis before of the same block.
    cross: u32,
    /// What is noted of it.
    notes: u32,
    /// Weight of its own template in halves.
    gain: u32,
    /// First table of its set.
    tables: u32,
    odd_tables: u32,
    /// Table of its number of coefficients.
    end_table: u32,
    /// Table of the block's intra mode; 0 where it has none.
    mode_table: u32,
}

/// How far a superblock is read.
#[derive(Debug, Clone, Copy, Default)]
pub struct TexfoldBlockProgress {
    /// What the contexts of the item look at.
    around: TexfoldBlockAround,
    /// The block's axis that is read: blocks row by row, all axes of each.
    item: u32,
    /// Coefficients of the item that are still to be read; 0 where their number is.
    left: u32,
    /// 1 where the next one is the first to be read, which is not 0.
    is_last: u32,
    /// State of dependent quantisation.
    state: u32,
    /// The coefficients of the item that are not zero, by their numbers in coding order.
    nonzero: UVec2,
}

/// The signs of a block's axis.
#[derive(Debug, Clone, Copy)]
pub struct TexfoldBlockSigns {
    /// The coefficients that are not zero, by their numbers in coding order.
    nonzero: UVec2,
    /// Their signs, that of the last one first.
    signs: UVec2,
}

impl DctView<'_> {
    fn word(&self, at: u32) -> u32 {
        self.words[at as usize]
    }

    fn scratch(&self, at: u32) -> i32 {
        self.scratch[at as usize]
    }
}

/// `otherwise` or `value`, as WGSL has it.
fn select<T>(otherwise: T, value: T, condition: bool) -> T {
    if condition { value } else { otherwise }
}

/// Two bytes of the streams from byte `at` on.
pub fn texfold_block_pair(view: &DctView<'_>, at: u32) -> u32 {
    let low = view.streams[at as usize / 4] >> (8 * (at % 4));
    let high = (view.streams[at as usize / 4 + 1] << 1) << (31 - 8 * (at % 4));
    (low | high) & 0xffff
}

/// Length of a superblock's stream, of that place in the group of the index whose words begin at `group`.
pub fn texfold_block_length(view: &DctView<'_>, group: u32, place: u32) -> u32 {
    let bit = place * view.pass.index_bits;
    let at = group + 1 + bit / 32;
    let low = view.word(at) >> (bit % 32);
    let high = (view.word(at + 1) << 1) << (31 - bit % 32);
    (low | high) & ((1 << view.pass.index_bits) - 1)
}

/// The stream of the superblock of that number; empty where it does not lie among the streams' bytes.
pub fn texfold_block_stream(view: &DctView<'_>, number: u32) -> TexfoldBlockStream {
    let group = view.pass.index + number / TEXFOLD_BLOCK_GROUP * (view.pass.index_bits + 1);
    let place = number % TEXFOLD_BLOCK_GROUP;
    let first = view.word(group);
    let mut start = first;
    for before in 0..place.min(TEXFOLD_BLOCK_GROUP) {
        start = start.wrapping_add(texfold_block_length(view, group, before));
    }
    let mut end = start.wrapping_add(texfold_block_length(view, group, place));
    if end < first || end > view.pass.stream_bytes {
        (start, end) = (0, 0);
    }
    start += view.pass.streams;
    end += view.pass.streams;
    // The parity of the length says whether the state has 3 or 4 bytes.
    let length = end - start;
    let head = select(4 - length % 2, length, length < 4);
    let bytes = texfold_block_pair(view, start) | texfold_block_pair(view, start + 2) << 16;
    let mask = (u32::MAX >> (8 * (4 - head.max(1)))) * u32::from(head > 0);
    TexfoldBlockStream { state: bytes & mask, next: start + head, end }
}

/// Takes two bytes where the state is low and there are any.
pub fn texfold_block_refill(view: &DctView<'_>, stream: &mut TexfoldBlockStream) {
    if stream.state < TEXFOLD_BLOCK_LOW && stream.next + 2 <= stream.end {
        stream.state = stream.state << 16 | texfold_block_pair(view, stream.next);
        stream.next += 2;
    }
}

/// The next symbol, by the table of that number.
pub fn texfold_block_symbol(view: &DctView<'_>, stream: &mut TexfoldBlockStream, table: u32) -> u32 {
    let words = view.pass.tables + table * TEXFOLD_BLOCK_TABLE_WORDS;
    let slots = 1 << TEXFOLD_BLOCK_PROBABILITY_BITS;
    let slot = stream.state & (slots - 1);
    let mut pair = select(0, 4, view.word(words + 4) & 0xffff <= slot);
    pair += select(0, 2, view.word(words + pair + 2) & 0xffff <= slot);
    pair += select(0, 1, view.word(words + pair + 1) & 0xffff <= slot);
    let both = view.word(words + pair);
    let split = both >> 16;
    let after = select(view.word(words + pair + 1) & 0xffff, slots, pair == 7);
    let is_second = split <= slot;
    let first = select(both & 0xffff, split, is_second);
    let end = select(split, after, is_second);
    let above = stream.state >> TEXFOLD_BLOCK_PROBABILITY_BITS;
    stream.state = end.wrapping_sub(first).wrapping_mul(above).wrapping_add(slot).wrapping_sub(first);
    texfold_block_refill(view, stream);
    2 * pair + u32::from(is_second)
}

/// The next number of at most 16 bits.
pub fn texfold_block_bits(view: &DctView<'_>, stream: &mut TexfoldBlockStream, count: u32) -> u32 {
    let value = stream.state & ((1 << count) - 1);
    stream.state >>= count;
    texfold_block_refill(view, stream);
    value
}

/// A magnitude from 8 on.
pub fn texfold_block_large(view: &DctView<'_>, stream: &mut TexfoldBlockStream, symbol: u32) -> u32 {
    let word = view.word(TEXFOLD_BLOCK_SYMBOLS + symbol);
    let first = word >> 16 & 0xfff;
    if symbol < TEXFOLD_BLOCK_ESCAPE {
        return first + texfold_block_bits(view, stream, word >> 28);
    }
    let length = texfold_block_bits(view, stream, 5).min(TEXFOLD_BLOCK_ESCAPE_BITS);
    let low = texfold_block_bits(view, stream, length.min(12));
    let high = texfold_block_bits(view, stream, length.max(12) - 12);
    first + (low | high << 12)
}

/// Whether the plane's blocks have intra modes.
pub fn texfold_block_has_modes(view: &DctView<'_>) -> bool {
    view.pass.offsets >> 17 & 1 == 1 && view.pass.is_base == 0
}

/// Where the contexts of a block's axis look: of the block of that number in its superblock, which has `blocks` columns and
/// rows and begins at `corner` of the blocks that are held.
pub fn texfold_block_around(
    view: &DctView<'_>,
    corner: UVec2,
    blocks: UVec2,
    block: u32,
    axis: u32,
) -> TexfoldBlockAround {
    let at = UVec2::new(block % blocks.x, block / blocks.x);
    let [columns, rows] = view.pass.held;
    let slot = (axis * rows + corner.y + at.y) * columns + corner.x + at.x;
    let own = view.pass.samples + slot * TEXFOLD_BLOCK_WORDS;
    let notes = view.pass.notes + slot * TEXFOLD_BLOCK_NOTES;
    let rank = view.pass.ranks >> (2 * axis) & 3;
    let (has_left, has_above) = (at.x > 0, at.y > 0);
    let one = select(0, own.wrapping_sub(TEXFOLD_BLOCK_WORDS), has_left);
    let other = select(0, own.wrapping_sub(columns * TEXFOLD_BLOCK_WORDS), has_above);
    let left_end = select(0, notes.wrapping_sub(TEXFOLD_BLOCK_NOTES), has_left);
    let above_end = select(0, notes.wrapping_sub(columns * TEXFOLD_BLOCK_NOTES), has_above);
    // Where there is only one neighbour, it counts twice.
    let left = select(other, one, has_left);
    let above = select(one, other, has_above);
    let before = view.scratch(select(above_end, left_end, has_left)) as u32;
    let over = view.scratch(select(left_end, above_end, has_above)) as u32;
    let ends = (before & 255) + (over & 255);
    let apart = !has_left && !has_above;
    // Those of modes stand behind all others.
    let modes = 4 * (TEXFOLD_BLOCK_SET_TABLES + TEXFOLD_BLOCK_ODD_TABLES);
    let has_mode = texfold_block_has_modes(view) && axis == 0 && !apart;
    let predicted = u32::from(has_left && before > 255) + u32::from(has_above && over > 255);
    let set = 2 * view.pass.is_base + u32::from(rank > 0);
    let tables = set * TEXFOLD_BLOCK_SET_TABLES;
    let cross = select(0, own.wrapping_sub(columns * rows * TEXFOLD_BLOCK_WORDS), rank > 1);
    TexfoldBlockAround {
        own,
        left,
        above,
        cross,
        notes,
        gain: select(4, 5, apart),
        tables,
        odd_tables: 4 * TEXFOLD_BLOCK_SET_TABLES + set * TEXFOLD_BLOCK_ODD_TABLES,
        end_table: tables + TEXFOLD_BLOCK_FIRST_END + select(texfold_block_end_class(ends), 8, apart),
        mode_table: select(0, modes + predicted, has_mode),
    }
}

/// Context by the sum of both neighbours' symbols of the number of coefficients.
pub fn texfold_block_end_class(sum: u32) -> u32 {
    select(((sum + 5) / 4).min(7), 0, sum == 0)
}

/// A coefficient's magnitude as far as contexts tell it apart; halves of steps are held, twice the magnitude or one less.
pub fn texfold_block_magnitude(view: &DctView<'_>, at: u32) -> u32 {
    ((view.scratch(at) as u32 + 1) >> 1).min(TEXFOLD_BLOCK_LARGEST)
}

/// The state of dependent quantisation behind a magnitude.
pub fn texfold_block_next(view: &DctView<'_>, state: u32, magnitude: u32) -> u32 {
    let is_dependent = view.pass.offsets >> 16 & 1;
    let states = select(TEXFOLD_BLOCK_NEXT_EVEN, TEXFOLD_BLOCK_NEXT_ODD, magnitude & is_dependent == 1);
    states >> (4 * state) & 7
}

/// Class of the expected magnitude at place `at` of a block, whose coefficients later in the scan are all known.
pub fn texfold_block_level(view: &DctView<'_>, around: &TexfoldBlockAround, at: u32) -> u32 {
    let own = around.own + at;
    let (right, below) = (at < 56, at % 8 < 7);
    let magnitude = |at| texfold_block_magnitude(view, at);
    let later = magnitude(select(0, own + 8, right))
        + magnitude(select(0, own + 16, at < 48))
        + magnitude(select(0, own + 1, below))
        + magnitude(select(0, own + 2, at % 8 < 6))
        + magnitude(select(0, own + 9, right && below));
    let expected = ((later * around.gain) >> 1)
        + magnitude(around.left + at)
        + magnitude(around.above + at)
        + magnitude(around.cross + at);
    let last = expected.min(255);
    view.word(TEXFOLD_BLOCK_LEVELS + last / 4) >> (8 * (last % 4)) & 255
}

/// Reads the signs of a block's axis and notes them: up to 16 at once, after all magnitudes.
pub fn texfold_block_note(
    view: &mut DctView<'_>,
    stream: &mut TexfoldBlockStream,
    notes: u32,
    nonzero: UVec2,
) {
    let count = nonzero.x.count_ones() + nonzero.y.count_ones();
    let mut signs = UVec2::new(texfold_block_bits(view, stream, count.min(16)), 0);
    if count > 16 {
        signs.x |= texfold_block_bits(view, stream, (count - 16).min(16)) << 16;
    }
    if count > 32 {
        signs.y = texfold_block_bits(view, stream, (count - 32).min(16));
    }
    if count > 48 {
        signs.y |= texfold_block_bits(view, stream, count - 48) << 16;
    }
    let words = [nonzero.x, nonzero.y, signs.x, signs.y].map(|word| word as i32);
    view.scratch[notes as usize + 1..notes as usize + 5].copy_from_slice(&words);
}

/// Reads a symbol of a superblock of `blocks` columns and rows of blocks, the first of them at `corner` of those that are
/// held: the number of coefficients of a block's axis or a coefficient's magnitude, which goes to scratch memory.
pub fn texfold_block_round(
    view: &mut DctView<'_>,
    corner: UVec2,
    blocks: UVec2,
    stream: &mut TexfoldBlockStream,
    progress: &mut TexfoldBlockProgress,
) {
    let first = view.pass.has_base;
    let begins = progress.left == 0;
    let number = first + progress.left.max(1) - 1;
    let scan = view.word(TEXFOLD_BLOCK_SCAN + number);
    let at = scan & 255;
    let zone = scan >> 8 & 255;
    let mut table = progress.around.tables + TEXFOLD_BLOCK_FIRST_LAST + zone;
    let mut mode = 0;
    if begins {
        let axes = view.pass.axes;
        progress.around =
            texfold_block_around(view, corner, blocks, progress.item / axes, progress.item % axes);
        table = progress.around.end_table;
        if progress.around.mode_table > 0 {
            mode = texfold_block_symbol(view, stream, progress.around.mode_table);
        }
    } else if progress.is_last == 0 {
        let level = texfold_block_level(view, &progress.around, at);
        let even = progress.around.tables + zone * TEXFOLD_BLOCK_ZONE_TABLES;
        let odd = progress.around.odd_tables + zone / 2 * TEXFOLD_BLOCK_ZONE_TABLES;
        table = select(even, odd, progress.state & 1 == 1) + level;
    }
    let symbol = texfold_block_symbol(view, stream, table);
    if begins {
        let word = view.word(TEXFOLD_BLOCK_SYMBOLS + symbol);
        let more = texfold_block_bits(view, stream, word >> 8 & 255);
        progress.left = ((word & 255) + more).min(TEXFOLD_BLOCK_WORDS - first);
        progress.is_last = 1;
        progress.state = 0;
        progress.nonzero = UVec2::ZERO;
        view.scratch[progress.around.notes as usize] = (symbol | mode << 8) as i32;
    } else {
        let mut magnitude = symbol;
        if symbol > 7 {
            magnitude = texfold_block_large(view, stream, symbol);
        }
        magnitude += progress.is_last;
        if magnitude > 0 {
            let halves = 2 * magnitude - (progress.state & 1);
            view.scratch[(progress.around.own + at) as usize] = halves as i32;
            let bit = 1 << (number % 32);
            progress.nonzero |= select(UVec2::new(bit, 0), UVec2::new(0, bit), number >= 32);
        }
        progress.state = texfold_block_next(view, progress.state, magnitude);
        progress.left -= 1;
        progress.is_last = 0;
        if progress.left == 0 {
            texfold_block_note(view, stream, progress.around.notes, progress.nonzero);
        }
    }
    progress.item += u32::from(progress.left == 0);
}

/// Columns and rows of blocks of the superblock in that column and row of the plane.
pub fn texfold_block_blocks(view: &DctView<'_>, superblock: UVec2) -> UVec2 {
    (UVec2::from(view.pass.plane_blocks) - superblock * view.pass.side).min(UVec2::splat(view.pass.side))
}

/// Reads the superblock in that column and row of those to decode.
pub fn texfold_block_superblock(view: &mut DctView<'_>, place: UVec2) {
    let side = view.pass.side;
    let superblock =
        texfold_block_wrapped(UVec2::from(view.pass.first) + place, UVec2::from(view.pass.wrap) / side);
    let blocks = texfold_block_blocks(view, superblock);
    let items = blocks.x * blocks.y * view.pass.axes;
    let row = view.pass.superblock_start + superblock.y * view.pass.superblock_columns;
    let mut stream = texfold_block_stream(view, row + superblock.x);
    let mut progress = TexfoldBlockProgress::default();
    for _ in 0..(items * 33).min(TEXFOLD_BLOCK_MAX_ROUNDS) {
        if progress.item >= items {
            break;
        }
        texfold_block_round(view, place * side, blocks, &mut stream, &mut progress);
        if progress.item < items {
            texfold_block_round(view, place * side, blocks, &mut stream, &mut progress);
        }
    }
}
