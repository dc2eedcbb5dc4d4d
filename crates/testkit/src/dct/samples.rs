//! From coefficients to samples and channels: the second half of `shaders/wgsl/block.wgsl`, function for function.

use glam::{IVec2, IVec4, UVec2};

use super::*;

/// Places behind the last column or row are those of the first ones; `at` is less than twice `all`.
pub fn texfold_block_wrapped(at: UVec2, all: UVec2) -> UVec2 {
    at - UVec2::select(at.cmpge(all), all, UVec2::ZERO)
}

/// The base's sample for a block of an axis; beyond a border the nearest one.
pub fn texfold_block_mean(view: &DctView<'_>, axis: u32, at: IVec2) -> i32 {
    let last = UVec2::from(view.pass.plane_blocks).as_ivec2() - 1;
    let (first, all) = (UVec2::from(view.pass.base_first), UVec2::from(view.pass.base_wrap));
    let inside = texfold_block_wrapped(at.clamp(IVec2::ZERO, last).as_uvec2() + all - first, all);
    let [columns, rows] = view.pass.base_held;
    let slot = (axis * rows + inside.y / 8) * columns + inside.x / 8;
    let place = inside.y % 8 * 8 + inside.x % 8;
    view.scratch(view.pass.base_samples + slot * TEXFOLD_BLOCK_WORDS + place)
}

/// A value times a weight in 1/256, rounded.
pub fn texfold_block_weighted(value: i32, weight: i32) -> i32 {
    value.wrapping_mul(weight).wrapping_add(128) >> 8
}

/// What the means around a block say of its coefficients: the columns 0, 1 and 2, three rows each.
pub fn texfold_block_predict(view: &DctView<'_>, axis: u32, at: IVec2) -> [IVec4; 3] {
    let mean = |column, row| texfold_block_mean(view, axis, at + IVec2::new(column, row));
    let middle = mean(0, 0);
    let (west, east, north, south) = (mean(-1, 0), mean(1, 0), mean(0, -1), mean(0, 1));
    let corners = mean(-1, -1).wrapping_sub(mean(1, -1)).wrapping_sub(mean(-1, 1)).wrapping_add(mean(1, 1));
    let second = |one: i32, other: i32| one.wrapping_add(other).wrapping_sub(middle.wrapping_mul(2));
    let across = texfold_block_weighted(west.wrapping_sub(east), TEXFOLD_BLOCK_FIRST);
    let across_second = texfold_block_weighted(second(west, east), TEXFOLD_BLOCK_SECOND);
    let down = texfold_block_weighted(north.wrapping_sub(south), TEXFOLD_BLOCK_FIRST);
    let down_second = texfold_block_weighted(second(north, south), TEXFOLD_BLOCK_SECOND);
    let mixed = texfold_block_weighted(corners, TEXFOLD_BLOCK_MIXED);
    [
        IVec4::new(middle, down, down_second, 0),
        IVec4::new(across, mixed, 0, 0),
        IVec4::new(across_second, 0, 0, 0),
    ]
}

/// What is noted of the signs of the block's axis of that number.
pub fn texfold_block_signs(view: &DctView<'_>, slot: u32) -> TexfoldBlockSigns {
    let notes = view.pass.notes + slot * TEXFOLD_BLOCK_NOTES;
    let word = |at: u32| view.scratch(notes + at) as u32;
    TexfoldBlockSigns { nonzero: UVec2::new(word(1), word(2)), signs: UVec2::new(word(3), word(4)) }
}

/// Whether the coefficient at place `at` is negative.
pub fn texfold_block_negative(view: &DctView<'_>, signs: &TexfoldBlockSigns, at: u32) -> bool {
    let number = view.word(TEXFOLD_BLOCK_SCAN + at) >> 16;
    let is_high = number >= 32;
    // Those that were read before it.
    let before = (select(signs.nonzero.x, signs.nonzero.y, is_high) >> (number % 32)) >> 1;
    let place = before.count_ones() + select(signs.nonzero.y.count_ones(), 0, is_high);
    select(signs.signs.x, signs.signs.y, place >= 32) >> (place % 32) & 1 == 1
}

/// What the halves of steps in scratch memory at `own` + `at` stands for, `at` its place in the block.
pub fn texfold_block_rebuilt(view: &DctView<'_>, signs: &TexfoldBlockSigns, own: u32, at: u32) -> i32 {
    let halves = view.scratch(own + at) as u32;
    let offset = view.pass.offsets >> (8 * u32::from(halves > 2)) & 255;
    let finer = (halves << 4).wrapping_sub(offset * u32::from(halves > 0));
    let value = (finer.wrapping_mul(view.word(view.pass.steps + at)) >> 9) as i32;
    select(value, value.wrapping_neg(), texfold_block_negative(view, signs, at))
}

/// Four of them.
pub fn texfold_block_four(view: &DctView<'_>, signs: &TexfoldBlockSigns, own: u32, at: u32) -> IVec4 {
    IVec4::new(
        texfold_block_rebuilt(view, signs, own, at),
        texfold_block_rebuilt(view, signs, own, at + 1),
        texfold_block_rebuilt(view, signs, own, at + 2),
        texfold_block_rebuilt(view, signs, own, at + 3),
    )
}

/// Times a constant in 1/256, rounded.
pub fn texfold_block_times(value: IVec4, constant: i32) -> IVec4 {
    value.wrapping_mul(IVec4::splat(constant)).wrapping_add(IVec4::splat(128)) >> 8
}

/// Four transforms side by side: the eight values of which `input` has the frequencies.
pub fn texfold_block_transform(input: [IVec4; 8]) -> [IVec4; 8] {
    let add = IVec4::wrapping_add;
    let sub = IVec4::wrapping_sub;
    let (sum, difference) = (add(input[0], input[4]), sub(input[0], input[4]));
    let both = add(input[2], input[6]);
    let rotated = sub(texfold_block_times(sub(input[2], input[6]), TEXFOLD_BLOCK_ROOT), both);
    let (even0, even1) = (add(sum, both), add(difference, rotated));
    let (even2, even3) = (sub(difference, rotated), sub(sum, both));
    let (z13, z10) = (add(input[5], input[3]), sub(input[5], input[3]));
    let (z11, z12) = (add(input[1], input[7]), sub(input[1], input[7]));
    let odd0 = add(z11, z13);
    let z5 = texfold_block_times(add(z10, z12), TEXFOLD_BLOCK_ROTATE_BOTH);
    let odd1 = sub(sub(z5, texfold_block_times(z10, TEXFOLD_BLOCK_ROTATE_SECOND)), odd0);
    let odd2 = sub(texfold_block_times(sub(z11, z13), TEXFOLD_BLOCK_ROOT), odd1);
    let odd3 = add(sub(texfold_block_times(z12, TEXFOLD_BLOCK_ROTATE_FIRST), z5), odd2);
    [
        add(even0, odd0),
        add(even1, odd1),
        add(even2, odd2),
        sub(even3, odd3),
        add(even3, odd3),
        sub(even2, odd2),
        sub(even1, odd1),
        sub(even0, odd0),
    ]
}

/// Four columns of four values as rows.
pub fn texfold_block_square(a: IVec4, b: IVec4, c: IVec4, d: IVec4) -> [IVec4; 4] {
    [
        IVec4::new(a.x, b.x, c.x, d.x),
        IVec4::new(a.y, b.y, c.y, d.y),
        IVec4::new(a.z, b.z, c.z, d.z),
        IVec4::new(a.w, b.w, c.w, d.w),
    ]
}

/// Four columns of a block's samples from the rows 0 to 3 and 4 to 7 of its coefficients' transform, four columns of them.
pub fn texfold_block_rows(upper: [IVec4; 4], lower: [IVec4; 4]) -> [IVec4; 8] {
    let a = texfold_block_square(upper[0], upper[1], upper[2], upper[3]);
    let b = texfold_block_square(lower[0], lower[1], lower[2], lower[3]);
    [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]
}

/// Holds a row of a block's samples.
pub fn texfold_block_put(view: &mut DctView<'_>, at: u32, left: IVec4, right: IVec4) {
    let at = at as usize;
    view.scratch[at..at + 4].copy_from_slice(&left.to_array());
    view.scratch[at + 4..at + 8].copy_from_slice(&right.to_array());
}

/// Half of a block's columns, transformed along its rows: the upper half where `at` is 0, the lower one where it is 4.
pub fn texfold_block_half(
    view: &DctView<'_>,
    signs: &TexfoldBlockSigns,
    own: u32,
    at: u32,
    predicted: [IVec4; 3],
) -> [IVec4; 8] {
    let four = |column: u32| texfold_block_four(view, signs, own, at + 8 * column);
    texfold_block_transform([
        four(0).wrapping_add(predicted[0]),
        four(1).wrapping_add(predicted[1]),
        four(2).wrapping_add(predicted[2]),
        four(3),
        four(4),
        four(5),
        four(6),
        four(7),
    ])
}

/// Column and row in the plane of the block of that number of those that are held.
pub fn texfold_block_place(view: &DctView<'_>, slot: u32) -> UVec2 {
    let [columns, rows] = view.pass.held;
    let place = UVec2::new(slot % columns, slot / columns % rows);
    texfold_block_wrapped(UVec2::from(view.pass.first) * view.pass.side + place, UVec2::from(view.pass.wrap))
}

/// Turns the coefficients of a block's axis, the one of that number of those that are held, into its samples, in their place.
pub fn texfold_block_samples(view: &mut DctView<'_>, slot: u32) {
    let [columns, rows] = view.pass.held;
    let axis = slot / (columns * rows);
    let at = texfold_block_place(view, slot).as_ivec2();
    let own = view.pass.samples + slot * TEXFOLD_BLOCK_WORDS;
    let none = [IVec4::ZERO; 3];
    let mut predicted = if view.pass.has_base == 1 { texfold_block_predict(view, axis, at) } else { none };
    if texfold_block_has_modes(view) && texfold_block_mode(view, slot) > 0 {
        predicted = [IVec4::new(predicted[0].x, 0, 0, 0), none[1], none[2]];
    }
    let signs = texfold_block_signs(view, slot);
    let [upper0, upper1, upper2, upper3, upper4, upper5, upper6, upper7] =
        texfold_block_half(view, &signs, own, 0, predicted);
    let [lower0, lower1, lower2, lower3, lower4, lower5, lower6, lower7] =
        texfold_block_half(view, &signs, own, 4, none);
    let left = texfold_block_transform(texfold_block_rows(
        [upper0, upper1, upper2, upper3],
        [lower0, lower1, lower2, lower3],
    ));
    let right = texfold_block_transform(texfold_block_rows(
        [upper4, upper5, upper6, upper7],
        [lower4, lower5, lower6, lower7],
    ));
    for (row, (left, right)) in (0..).zip(left.into_iter().zip(right)) {
        texfold_block_put(view, own + 8 * row, left, right);
    }
}

/// Filters a line across a border: the samples of both blocks next to it lie at `before` and `own`, those behind them `across`
/// words before and after.
pub fn texfold_block_smooth(
    view: &mut DctView<'_>,
    before: u32,
    own: u32,
    across: u32,
    limit: i32,
    near: i32,
    far: i32,
) {
    let p1 = view.scratch(before - across);
    let p0 = view.scratch(before);
    let q0 = view.scratch(own);
    let q1 = view.scratch(own + across);
    let step = q0.wrapping_sub(p0).wrapping_mul(9);
    let slopes = q1.wrapping_sub(p1).wrapping_mul(3);
    let jump = (step.wrapping_sub(slopes).wrapping_add(8) >> 4).clamp(-limit, limit);
    let by_near = jump.wrapping_mul(near).wrapping_add(4) >> 3;
    let by_far = jump.wrapping_mul(far).wrapping_add(4) >> 3;
    view.scratch[(before - across) as usize] = p1.wrapping_add(by_far);
    view.scratch[before as usize] = p0.wrapping_add(by_near);
    view.scratch[own as usize] = q0.wrapping_sub(by_near);
    view.scratch[(own + across) as usize] = q1.wrapping_sub(by_far);
}

/// Filters the border between a block's axis, the one of that number of those that are held, and the block to its left, or the
/// one above where `is_above` is 1; not where a superblock ends.
pub fn texfold_block_deblock(view: &mut DctView<'_>, slot: u32, is_above: u32) {
    let [columns, rows] = view.pass.held;
    let axis = slot / (columns * rows);
    let place = select(slot % columns, slot / columns % rows, is_above == 1);
    let is_beyond = texfold_block_place(view, slot).cmpge(UVec2::from(view.pass.plane_blocks)).any();
    if place.is_multiple_of(view.pass.side) || is_beyond {
        return;
    }
    let across = select(1, 8, is_above == 1);
    let along = select(8, 1, is_above == 1);
    let own = view.pass.samples + slot * TEXFOLD_BLOCK_WORDS;
    let before = own - select(1, columns, is_above == 1) * TEXFOLD_BLOCK_WORDS + 7 * across;
    let is_first = view.pass.ranks >> (2 * axis) & 3 == 0;
    let limit = view.pass.deblocking.wrapping_mul(select(2, 1, is_first));
    let near = select(TEXFOLD_BLOCK_OTHER_NEAR, TEXFOLD_BLOCK_FIRST_NEAR, is_first);
    let far = select(TEXFOLD_BLOCK_OTHER_FAR, TEXFOLD_BLOCK_FIRST_FAR, is_first);
    for line in 0..8.min(TEXFOLD_BLOCK_LINES) {
        texfold_block_smooth(view, before + line * along, own + line * along, across, limit, near, far);
    }
}

/// A sample of an axis, of those that are held.
pub fn texfold_block_sample(view: &DctView<'_>, axis: u32, at: UVec2) -> i32 {
    let [columns, rows] = view.pass.held;
    let slot = (axis.min(view.pass.axes - 1) * rows + at.y / 8) * columns + at.x / 8;
    let place = at.y % 8 * 8 + at.x % 8;
    view.scratch(view.pass.samples + slot * TEXFOLD_BLOCK_WORDS + place)
}

/// A channel of the texel at `at` of those that are held: `mean` and the weighted axes from `first` on, of which `shift` bits
/// are fractional, between 0 and `largest`.
pub fn texfold_block_channel(
    view: &DctView<'_>,
    at: UVec2,
    mean: i32,
    first: u32,
    weights: IVec4,
    shift: u32,
    largest: i32,
) -> i32 {
    let part = |rank: u32, weight: i32| texfold_block_sample(view, first + rank, at).wrapping_mul(weight);
    let sum = mean
        .wrapping_add(part(0, weights.x))
        .wrapping_add(part(1, weights.y))
        .wrapping_add(part(2, weights.z))
        .wrapping_add(part(3, weights.w));
    (sum >> shift).clamp(0, largest)
}

/// The square root of a number, rounded.
pub fn texfold_block_root(value: u32) -> u32 {
    let mut root = ((value as f32).sqrt() as u32).min(65535);
    if root * root > value {
        root -= 1;
    } else if root < 65535 && (root + 1) * (root + 1) <= value {
        root += 1;
    }
    root + u32::from(value - root * root > root)
}
