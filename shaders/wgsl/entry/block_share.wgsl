// Workgroup memory of the pass that reads streams: what they share, and what each has.

// Streams of a workgroup, one an invocation: texfold_shaders::BLOCK_STREAMS.
const ENTRY_STREAMS: u32 = 8u;
// Words before the tables: coefficients in coding order, classes of expected magnitudes, symbols.
const ENTRY_CONSTANTS: u32 = 144u;
// First word of the classes, four a word.
const ENTRY_LEVELS: u32 = 64u;
// Tables of one kind of plane: a set of the first axis, and one of the others; and those of the odd quantiser.
const ENTRY_TABLES: u32 = 222u;
const ENTRY_ODD_TABLES: u32 = 96u;
// Tables of intra modes.
const ENTRY_MODE_TABLES: u32 = 3u;
// Magnitudes of a stream: ten columns of ten, of which the last two stay zero.
const ENTRY_HELD: u32 = 100u;

// Copies of what streams are read by. Tables have two quarters each.
var<workgroup> texfold_block_constants: array<u32, ENTRY_CONSTANTS>;
var<workgroup> texfold_block_levels: array<u32, 256>;
var<workgroup> texfold_block_tables: array<vec4<u32>, 2u * (ENTRY_TABLES + ENTRY_ODD_TABLES + ENTRY_MODE_TABLES)>;
// Magnitudes of the block's axis that is read, as far as contexts tell them apart; those of an invocation begin at texfold_block_lane.
var<workgroup> texfold_block_held: array<u32, ENTRY_HELD * ENTRY_STREAMS>;
var<private> texfold_block_lane: u32;
// Sums of the rows that a workgroup predicts.
var<workgroup> entry_sums: array<i32, 64>;

// Prepares the memory for the streams of texfold_block_pass; a barrier must follow.
fn entry_share(lane: u32) {
    texfold_block_lane = ENTRY_HELD * lane;
    for (var word = 0u; word < min(ENTRY_HELD, TEXFOLD_BLOCK_MAX_ROUNDS); word += 1u) {
        texfold_block_held[texfold_block_lane + word] = 0u;
    }
    for (var word = lane; word < min(ENTRY_CONSTANTS, TEXFOLD_BLOCK_MAX_ROUNDS); word += ENTRY_STREAMS) {
        texfold_block_constants[word] = texfold_block_words[word];
    }
    for (var sum = lane; sum < min(256u, TEXFOLD_BLOCK_MAX_ROUNDS); sum += ENTRY_STREAMS) {
        texfold_block_levels[sum] = (texfold_block_words[ENTRY_LEVELS + sum / 4u] >> (8u * (sum % 4u))) & 255u;
    }
    let first = texfold_block_pass.tables + 8u * ENTRY_TABLES * texfold_block_pass.is_base;
    // Those of the odd quantiser stand behind all others.
    let odd = texfold_block_pass.tables + 8u * (2u * ENTRY_TABLES + ENTRY_ODD_TABLES * texfold_block_pass.is_base);
    // Those of modes stand behind these; they are of dependent quantisers.
    let modes = texfold_block_pass.tables + 8u * (ENTRY_TABLES + ENTRY_ODD_TABLES);
    let flags = texfold_block_pass.offsets >> 16u;
    let tables = ENTRY_TABLES + ENTRY_ODD_TABLES * (flags & 1u) + ENTRY_MODE_TABLES * (flags >> 1u);
    for (var quarter = lane; quarter < min(2u * tables, TEXFOLD_BLOCK_MAX_ROUNDS); quarter += ENTRY_STREAMS) {
        let sets = select(odd - 8u * ENTRY_TABLES, first, quarter < 2u * ENTRY_TABLES);
        let at = select(modes, sets, quarter < 2u * (ENTRY_TABLES + ENTRY_ODD_TABLES)) + 4u * quarter;
        texfold_block_tables[quarter] = vec4<u32>(
            texfold_block_words[at],
            texfold_block_words[at + 1u],
            texfold_block_words[at + 2u],
            texfold_block_words[at + 3u],
        );
    }
}

// Adds the predictions of an axis of the superblock in that column and row of those to decode, of `side` blocks a side. Eight invocations
// have a superblock, one row of a block each, block by block: those that follow are predicted from it. All 64 of a workgroup call it.
fn entry_predict(place: vec2<u32>, is_there: bool, axis: u32, side: u32, lane: u32) {
    for (var block = 0u; block < min(side * side, TEXFOLD_BLOCK_WORDS); block += 1u) {
        var row = TexfoldBlockRow(0u, false, vec4<i32>(0), vec4<i32>(0));
        if is_there {
            row = texfold_block_row(place, axis, block, lane % 8u);
        }
        entry_sums[lane] = texfold_block_sum(row);
        workgroupBarrier();
        var sum = 0;
        for (var other = 0u; other < min(8u, TEXFOLD_BLOCK_WORDS); other += 1u) {
            sum += entry_sums[lane / 8u * 8u + other];
        }
        texfold_block_add(row, sum);
        workgroupBarrier();
        storageBarrier();
    }
}
