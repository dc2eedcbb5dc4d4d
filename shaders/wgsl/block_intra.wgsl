// Intra prediction of the blocks of an image: what is added to their samples.

// The intra mode of the block that the one of that number of those that are held belongs to.
fn texfold_block_mode(slot: u32) -> u32 {
    let held = texfold_block_pass.held;
    return u32(texfold_block_scratch[texfold_block_pass.notes + slot % (held.x * held.y) * TEXFOLD_BLOCK_NOTES]) >> 8u;
}

// A sample next to a block whose samples begin at `own`: of the column to its left or the row above, from 1 on; the corner is 0. `has` says
// whether the blocks to its left, above and to the right of that are there; those that are missing are as the nearest sample.
fn texfold_block_beside(own: u32, has: vec3<bool>, is_left: bool, place: u32) -> i32 {
    let line = texfold_block_pass.held.x * TEXFOLD_BLOCK_WORDS;
    let from_left = has.x && (is_left || !has.y);
    let index = select(max(place, 1u), 1u, is_left != from_left) - 1u;
    let left = own - TEXFOLD_BLOCK_WORDS + 8u * min(index, 7u) + 7u;
    let above = own - line + 56u + select(min(index, 7u), TEXFOLD_BLOCK_WORDS + max(index, 8u) - 8u, index > 7u && has.z);
    let is_corner = place == 0u && has.x && has.y;
    return texfold_block_scratch[select(select(above, left, from_left), own - line - 1u, is_corner)];
}

// Shift of a direction, 0 to 6, along the side that it comes from, in 1/32 of a sample for each sample away from it.
fn texfold_block_angle(direction: u32) -> i32 {
    let angle = i32((TEXFOLD_BLOCK_ANGLES >> (8u * min(direction, 6u - direction))) & 255u);
    return select(angle, -angle, direction > 3u);
}

// A sample of the side that a direction comes from; before its corner those of the other side.
fn texfold_block_known(own: u32, has: vec3<bool>, is_left: bool, angle: i32, place: i32) -> i32 {
    let before = (-32 * place - angle / 2) / max(-angle, 1);
    return texfold_block_beside(own, has, is_left != (place < 0), u32(select(place, before, place < 0)));
}

// A block's sample by an intra mode.
fn texfold_block_predicted(own: u32, has: vec3<bool>, mode: u32, at: vec2<u32>) -> i32 {
    if mode == 1u {
        let place = vec2<i32>(at);
        let across = texfold_block_beside(own, has, true, at.y + 1u) * (7 - place.x)
            + texfold_block_beside(own, has, false, 9u) * (place.x + 1);
        let down = texfold_block_beside(own, has, false, at.x + 1u) * (7 - place.y)
            + texfold_block_beside(own, has, true, 9u) * (place.y + 1);
        return (across + down + 8) >> 4u;
    }
    let is_left = mode < 9u;
    let angle = texfold_block_angle(select(mode - 9u, mode - 2u, is_left));
    let along = i32(select(at.x, at.y, is_left));
    let away = i32(select(at.y, at.x, is_left)) + 1;
    let moved = away * angle;
    let first = along + 1 + (moved >> 5u);
    let part = moved & 31;
    let one = texfold_block_known(own, has, is_left, angle, first);
    let next = texfold_block_known(own, has, is_left, angle, first + 1);
    return (one * (32 - part) + next * part + 16) >> 5u;
}

// A row of the intra prediction of a block of a superblock: what an invocation adds to its samples.
struct TexfoldBlockRow {
    // Place of its samples in scratch memory.
    place: u32,
    // Whether the block is predicted.
    is_predicted: bool,
    left: vec4<i32>,
    right: vec4<i32>,
}

// A row of the block of that number, row by row of as many as a whole superblock has, of the superblock in that column and row of those
// to decode.
fn texfold_block_row(place: vec2<u32>, axis: u32, block: u32, row: u32) -> TexfoldBlockRow {
    let side = texfold_block_pass.side;
    let held = texfold_block_pass.held;
    let superblock = texfold_block_wrapped(texfold_block_pass.first + place, texfold_block_pass.wrap / side);
    let blocks = texfold_block_blocks(superblock);
    let at = vec2<u32>(block % side, block / side);
    let corner = place * side + at;
    let slot = (axis * held.y + corner.y) * held.x + corner.x;
    let own = texfold_block_pass.samples + slot * TEXFOLD_BLOCK_WORDS;
    var out = TexfoldBlockRow(own + 8u * row, false, vec4<i32>(0), vec4<i32>(0));
    if any(at >= blocks) {
        return out;
    }
    let mode = texfold_block_mode(slot);
    if mode == 0u {
        return out;
    }
    let has = vec3<bool>(at.x > 0u, at.y > 0u, at.x + 1u < blocks.x);
    out.is_predicted = true;
    out.left = vec4<i32>(
        texfold_block_predicted(own, has, mode, vec2<u32>(0u, row)),
        texfold_block_predicted(own, has, mode, vec2<u32>(1u, row)),
        texfold_block_predicted(own, has, mode, vec2<u32>(2u, row)),
        texfold_block_predicted(own, has, mode, vec2<u32>(3u, row)),
    );
    out.right = vec4<i32>(
        texfold_block_predicted(own, has, mode, vec2<u32>(4u, row)),
        texfold_block_predicted(own, has, mode, vec2<u32>(5u, row)),
        texfold_block_predicted(own, has, mode, vec2<u32>(6u, row)),
        texfold_block_predicted(own, has, mode, vec2<u32>(7u, row)),
    );
    return out;
}

// Sum of a row's samples.
fn texfold_block_sum(row: TexfoldBlockRow) -> i32 {
    let both = row.left + row.right;
    return both.x + both.y + both.z + both.w;
}

// Adds a row of a prediction, less the mean of the whole one, whose sum is `sum`.
fn texfold_block_add(row: TexfoldBlockRow, sum: i32) {
    if !row.is_predicted {
        return;
    }
    let mean = vec4<i32>((sum + 32) >> 6u);
    let left = vec4<i32>(
        texfold_block_scratch[row.place],
        texfold_block_scratch[row.place + 1u],
        texfold_block_scratch[row.place + 2u],
        texfold_block_scratch[row.place + 3u],
    );
    let right = vec4<i32>(
        texfold_block_scratch[row.place + 4u],
        texfold_block_scratch[row.place + 5u],
        texfold_block_scratch[row.place + 6u],
        texfold_block_scratch[row.place + 7u],
    );
    texfold_block_put(row.place, left + row.left - mean, right + row.right - mean);
}
