//! Deblocking: what is left of the borders between the 8x8 blocks of a superblock of the image is filtered.
//!
//! Across a border a line has the samples p1, p0 | q0, q1. Its jump beyond what the slopes around it say is
//! (9 (q0 - p0) - 3 (q1 - p1)) / 16, as in HEVC (H.265, 8.7.2.5.7). Least squares over seven photographs at 0.5 bits say how much
//! of it is an error: three quarters of jumps up to an eighth of the quantiser's step for a group's first axis, then less and
//! less, so that it is limited to a share of the step; nearly all for the other axes, where the limit is twice that. The
//! samples behind p0 and q0 of a first axis move the other way by a quarter, as those of textures do; wider filters took 2 to 10
//! points of SSIMULACRA2.
//!
//! *Random access*: borders between superblocks stay as they are, so a superblock needs nothing of those around it.
//! Arithmetic is in 32-bit integers and wraps. *Not taken*: limits by the blocks' numbers of coefficients; after it an adaptive loop filter
//! as in VVC (7x7 diamond, 40 classes, two limits, one set of filters for all images, learned on eight): on eight others 0.22, 0.15 and
//! 0.01 dB at 0.5, 1 and 2 bits, and -0.2 to 0.4 points of SSIMULACRA2.

use crate::vectors::vectorised;

/// Largest strength.
pub const MAX_DEBLOCKING: u8 = 3;
/// Most texels along a superblock's side.
const MAX_SIDE: usize = 64;
/// Eighths of a jump that are added to p0 and to p1 of a group's first axis.
pub(super) const FIRST_TAPS: [i32; 2] = [6, -2];
/// The same of its other axes.
pub(super) const OTHER_TAPS: [i32; 2] = [8, 3];

/// What an axis is filtered with: eighths of a jump that are added to p0 and to p1. They are constants, as shifts are faster than
/// products.
#[derive(Clone, Copy)]
struct Filter<const NEAR: i32, const FAR: i32> {
    /// Largest jump, in samples' units with their fractional bits.
    limit: i32,
}

impl<const NEAR: i32, const FAR: i32> Filter<NEAR, FAR> {
    /// Filters lines across a border: as many samples p1, p0, q0 and q1.
    #[inline(always)]
    fn lines(self, [p1, p0, q0, q1]: [&mut [i32]; 4]) {
        // A loop over slices is what compilers turn into vectors.
        for (((p1, p0), q0), q1) in p1.iter_mut().zip(p0).zip(q0).zip(q1) {
            let step = q0.wrapping_sub(*p0).wrapping_mul(9);
            let slopes = q1.wrapping_sub(*p1).wrapping_mul(3);
            let jump = step.wrapping_sub(slopes).wrapping_add(8) >> 4;
            let jump = jump.max(-self.limit).min(self.limit);
            let near = jump.wrapping_mul(NEAR).wrapping_add(4) >> 3;
            let far = jump.wrapping_mul(FAR).wrapping_add(4) >> 3;
            *p1 = p1.wrapping_add(far);
            *p0 = p0.wrapping_add(near);
            *q0 = q0.wrapping_sub(near);
            *q1 = q1.wrapping_sub(far);
        }
    }

    /// Filters an axis.
    #[inline(always)]
    fn plane(self, plane: &mut [i32], side: usize, blocks: (usize, usize)) {
        self.columns(plane, side, blocks);
        self.rows(plane, side, blocks);
    }

    /// Filters the borders between the columns of blocks of an axis.
    #[inline(always)]
    fn columns(self, plane: &mut [i32], side: usize, (columns, rows): (usize, usize)) {
        let count = (8 * rows).min(MAX_SIDE);
        // Transposed, so that lines lie side by side.
        let mut taps = [[0i32; MAX_SIDE]; 4];
        for first in (1..columns).map(|column| 8 * column - 2) {
            for (at, line) in plane.chunks_exact(side).take(count).enumerate() {
                let Some(samples) = line[first..].first_chunk::<4>() else { continue };
                for tap in 0..4 {
                    taps[tap][at % MAX_SIDE] = samples[tap];
                }
            }
            let [p1, p0, q0, q1] = &mut taps;
            self.lines([&mut p1[..count], &mut p0[..count], &mut q0[..count], &mut q1[..count]]);
            for (at, line) in plane.chunks_exact_mut(side).take(count).enumerate() {
                let Some(samples) = line[first..].first_chunk_mut::<4>() else { continue };
                for tap in 0..4 {
                    samples[tap] = taps[tap][at % MAX_SIDE];
                }
            }
        }
    }

    /// Filters the borders between the rows of blocks of an axis.
    #[inline(always)]
    fn rows(self, plane: &mut [i32], side: usize, (columns, rows): (usize, usize)) {
        let count = (8 * columns).min(side);
        for row in 1..rows {
            let lines = &mut plane[(8 * row - 2) * side..(8 * row + 2) * side];
            let (above, below) = lines.split_at_mut(2 * side);
            let ((p1, p0), (q0, q1)) = (above.split_at_mut(side), below.split_at_mut(side));
            self.lines([&mut p1[..count], &mut p0[..count], &mut q0[..count], &mut q1[..count]]);
        }
    }
}

/// Filters a superblock: for each axis, of that place in its group, `side` x `side` samples, of which so many columns and rows
/// of blocks are the image's. `limit` is the largest jump of first axes; nothing changes where it is 0.
#[inline(never)]
pub(super) fn deblock(samples: &mut [i32], side: usize, blocks: (usize, usize), ranks: &[u8], limit: i32) {
    if limit == 0 {
        return;
    }
    vectorised(
        #[inline(always)]
        move || {
            for (plane, &rank) in samples.chunks_exact_mut(side * side).zip(ranks) {
                if rank == 0 {
                    Filter::<{ FIRST_TAPS[0] }, { FIRST_TAPS[1] }> { limit }.plane(plane, side, blocks);
                } else {
                    let limit = 2 * limit;
                    Filter::<{ OTHER_TAPS[0] }, { OTHER_TAPS[1] }> { limit }.plane(plane, side, blocks);
                }
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What FORMAT.md says of a line.
    fn line(samples: [i32; 4], taps: [i32; 2], limit: i32) -> [i32; 4] {
        let [p1, p0, q0, q1] = samples;
        let jump = ((9 * (q0 - p0) - 3 * (q1 - p1) + 8) >> 4).clamp(-limit, limit);
        let [near, far] = taps.map(|tap| (jump * tap + 4) >> 3);
        [p1 + far, p0 + near, q0 - near, q1 - far]
    }

    fn naive(samples: &mut [i32], side: usize, blocks: (usize, usize), ranks: &[u8], limit: i32) {
        for (axis, &rank) in ranks.iter().enumerate() {
            let (taps, limit) = if rank == 0 { (FIRST_TAPS, limit) } else { (OTHER_TAPS, 2 * limit) };
            let at = |x: usize, y: usize| (axis * side + y) * side + x;
            for (x, y) in (8..8 * blocks.0).step_by(8).flat_map(|x| (0..8 * blocks.1).map(move |y| (x, y))) {
                let places = [at(x - 2, y), at(x - 1, y), at(x, y), at(x + 1, y)];
                let found = line(places.map(|place| samples[place]), taps, limit);
                places.iter().zip(found).for_each(|(&place, value)| samples[place] = value);
            }
            for (x, y) in (0..8 * blocks.0).flat_map(|x| (8..8 * blocks.1).step_by(8).map(move |y| (x, y))) {
                let places = [at(x, y - 2), at(x, y - 1), at(x, y), at(x, y + 1)];
                let found = line(places.map(|place| samples[place]), taps, limit);
                places.iter().zip(found).for_each(|(&place, value)| samples[place] = value);
            }
        }
    }

    #[test]
    fn borders_inside_a_superblock_are_filtered_as_the_format_says() {
        let mut rng = texfold_core::rng::Rng::new(3);
        for (side, blocks) in [(16, (2, 2)), (32, (3, 4)), (64, (8, 1)), (32, (1, 1))] {
            let ranks = [0, 1, 0];
            let samples: Vec<i32> = (0..3 * side * side).map(|_| rng.below(8000) as i32 - 4000).collect();
            let (mut found, mut wanted) = (samples.clone(), samples.clone());
            deblock(&mut found, side, blocks, &ranks, 300);
            naive(&mut wanted, side, blocks, &ranks, 300);
            assert!(found == wanted, "{side} {blocks:?}");
            deblock(&mut found, side, blocks, &ranks, 0);
            assert!(found == wanted, "a limit of 0 changes nothing");
        }
    }

    #[test]
    fn small_jumps_close_and_large_ones_stay() {
        let across = |jump: i32| {
            let mut samples: Vec<i32> = (0..256).map(|at| if at % 16 < 8 { 0 } else { jump }).collect();
            deblock(&mut samples, 16, (2, 2), &[0], 100);
            samples[8] - samples[7]
        };
        assert!(across(80) < 40, "{}", across(80));
        assert_eq!(across(10_000), 10_000 - 2 * 75);
    }
}
