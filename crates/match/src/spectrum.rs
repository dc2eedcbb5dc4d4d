//! Patches found by the low frequencies of their shape, under the eight orientations that map a square's texels to its texels.
//!
//! A main direction, as GSR descriptors have it, is unsteady where content looks like noise, and patches that would serve are
//! missed. Here patches are described by the cosine transform of their values over their length and looked up in all eight
//! orientations, which swap frequencies and change their signs. Of the frequencies those are kept that hold most of the patches'
//! energy, so that the product of two descriptors foretells how far one patch, with a gain, explains the other. Cost: side^2 x 8
//! for each patch, and 16 queries of bounded effort in a tree.

use glam::{Mat2, Vec2};
use rayon::prelude::*;
use texfold_core::CancelCheck;

use crate::bounded::BoundedTree;

/// Frequencies along a side that are looked at.
const LOW: usize = 8;
/// Frequencies of a descriptor, and one number more that makes all of one length.
const KEPT: usize = 23;
const LENGTH: usize = KEPT + 1;
/// Patches that frequencies are chosen by.
const SAMPLE: usize = 4096;

/// Coefficients of frequencies below [`LOW`], row by row.
type Low = [f32; LOW * LOW];

/// Square patches of one size.
pub struct SpectrumIndex {
    cosines: Cosines,
    /// Places in [`Low`] of the frequencies that count.
    kept: [usize; KEPT],
    tree: BoundedTree<LENGTH>,
    count: usize,
}

impl std::fmt::Debug for SpectrumIndex {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SpectrumIndex").field("patches", &self.count).field("kept", &self.kept).finish()
    }
}

/// A patch that looks like the query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpectrumMatch {
    /// Its number.
    pub number: usize,
    /// What carries places of the query, from its centre, to places of this one: quarter turns,
    /// reflected or not.
    pub matrix: Mat2,
    /// Squared distance of the descriptors, of length 1, of the patches or of one and the other's negative, 0 to 2.
    pub distance: f32,
}

impl SpectrumIndex {
    /// Indexes `count` patches of `side` x `side` values, which `patch` writes by number, row by row. Those whose RMS is not well
    /// above `noise` are described as if they were so much fainter in shape.
    /// Of no use once the job is cancelled.
    #[must_use]
    pub fn new(
        side: usize,
        noise: f32,
        count: usize,
        patch: impl Fn(usize, &mut Vec<f32>) + Sync,
        cancel: CancelCheck<'_>,
    ) -> Self {
        let cosines = Cosines::new(side, noise);
        let describe = |room: &mut Vec<f32>, number: usize| {
            room.clear();
            patch(number, room);
            cosines.low(room)
        };
        let step = count.div_ceil(SAMPLE).max(1);
        let sample: Vec<Low> = (0..count.div_ceil(step))
            .into_par_iter()
            .map_init(Vec::new, |room, index| describe(room, index * step))
            .collect();
        let kept = strongest(&sample);
        let points: Vec<[f32; LENGTH]> = (0..count)
            .into_par_iter()
            .filter(|_| !cancel.is_cancelled())
            .map_init(Vec::new, |room, number| {
                let mut point = pick(&describe(room, number), &kept);
                let squares: f32 = point.iter().map(|value| value * value).sum();
                point[KEPT] = (1.0 - squares).max(0.0).sqrt();
                point
            })
            .collect();
        let points = if cancel.is_cancelled() { Vec::new() } else { points };
        SpectrumIndex { tree: BoundedTree::new(&points, cancel), cosines, kept, count: points.len() }
    }

    /// Number of patches.
    #[must_use]
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// At most `count` patches, rotated and of either sign, that are most like `patch`, the likest first; a look at 32 x
    /// `leaves` patches for each orientation and sign.
    #[must_use]
    pub fn nearest(&self, patch: &[f32], count: usize, leaves: usize) -> Vec<SpectrumMatch> {
        let low = self.cosines.low(patch);
        let mut found: Vec<SpectrumMatch> = Vec::new();
        let mut most = f32::INFINITY;
        for orientation in 0..8 {
            let plain = pick(&rotated(&low, orientation), &self.kept);
            for query in [plain, plain.map(|value| -value)] {
                let near = self.tree.nearest(&query, most, count, leaves);
                let matched = |(number, distance): (u32, f32)| SpectrumMatch {
                    number: number as usize,
                    matrix: matrix(orientation),
                    distance,
                };
                found.extend(near.into_iter().map(matched));
                found.sort_by(|a, b| a.distance.total_cmp(&b.distance));
                found.truncate(count);
                if found.len() == count {
                    // What is farther than these is not looked for.
                    most = found.last().map_or(most, |last| last.distance);
                }
            }
        }
        found
    }
}

/// The frequencies that hold the most energy.
fn strongest(sample: &[Low]) -> [usize; KEPT] {
    let mut energy = [0.0f64; LOW * LOW];
    for low in sample {
        energy.iter_mut().zip(low).for_each(|(energy, value)| *energy += f64::from(value * value));
    }
    let mut places: [usize; LOW * LOW] = std::array::from_fn(|place| place);
    places.sort_by(|&a, &b| energy[b].total_cmp(&energy[a]).then(a.cmp(&b)));
    std::array::from_fn(|index| places[index])
}

/// The kept frequencies, and 0.
fn pick(low: &Low, kept: &[usize; KEPT]) -> [f32; LENGTH] {
    std::array::from_fn(|index| kept.get(index).map_or(0.0, |&place| low[place]))
}

/// Whether orientation number `orientation` exchanges columns and rows, and then reflects columns, and rows.
fn steps(orientation: u32) -> (bool, bool, bool) {
    (orientation & 4 != 0, orientation & 1 != 0, orientation & 2 != 0)
}

/// What carries places of a patch to those of the rotated one.
fn matrix(orientation: u32) -> Mat2 {
    let (exchanged, across, down) = steps(orientation);
    let sign = |reflected: bool| if reflected { -1.0 } else { 1.0 };
    let signs = Mat2::from_diagonal(Vec2::new(sign(across), sign(down)));
    if exchanged { signs * Mat2::from_cols(Vec2::Y, Vec2::X) } else { signs }
}

/// The coefficients of the rotated patch.
fn rotated(low: &Low, orientation: u32) -> Low {
    let (exchanged, across, down) = steps(orientation);
    std::array::from_fn(|place| {
        let (u, v) = (place % LOW, place / LOW);
        let value = if exchanged { low[u * LOW + v] } else { low[place] };
        let odd = (across && u % 2 == 1) != (down && v % 2 == 1);
        if odd { -value } else { value }
    })
}

/// The cosine transform of patches of one size, without their higher frequencies.
struct Cosines {
    side: usize,
    noise: f32,
    /// By frequency and place; all 0 for frequencies that patches of this side do not have.
    table: Vec<f32>,
}

impl Cosines {
    fn new(side: usize, noise: f32) -> Self {
        let value = |index: usize| {
            let (u, x) = (index / side, index % side);
            let scale = if u == 0 { 1.0 } else { 2.0 } / side as f64;
            let angle = std::f64::consts::PI * (2 * x + 1) as f64 * u as f64 / (2 * side) as f64;
            if u < side { (scale.sqrt() * angle.cos()) as f32 } else { 0.0 }
        };
        Cosines { side, noise, table: (0..LOW * side).map(value).collect() }
    }

    /// Coefficients of a patch over its length.
    fn low(&self, patch: &[f32]) -> Low {
        let side = self.side;
        let squares: f32 = patch.iter().map(|value| value * value).sum();
        let scale = 1.0 / (squares.sqrt() + self.noise * side as f32).max(f32::MIN_POSITIVE);
        let mut low = [0.0; LOW * LOW];
        let mut across = [0.0f32; LOW];
        for (y, row) in patch.chunks_exact(side).enumerate() {
            for (sum, cosines) in across.iter_mut().zip(self.table.chunks_exact(side)) {
                *sum = row.iter().zip(cosines).map(|(a, b)| a * b).sum::<f32>() * scale;
            }
            for (v, row) in low.chunks_exact_mut(LOW).enumerate() {
                let cosine = self.table[v * side + y];
                row.iter_mut().zip(&across).for_each(|(sum, value)| *sum += cosine * value);
            }
        }
        low
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 16;

    /// A patch of soft noise.
    fn noise(number: usize) -> Vec<f32> {
        let value = |x: usize, y: usize| {
            let seed = (number * 4096 + y / 4 * 64 + x / 4) as u32;
            let mixed = (seed ^ seed >> 16).wrapping_mul(0x7feb_352d);
            let hash = (mixed ^ mixed >> 15).wrapping_mul(0x846c_a68b);
            (hash >> 8) as f32 / (1 << 24) as f32 - 0.5
        };
        (0..SIDE * SIDE).map(|i| value(i % SIDE, i / SIDE)).collect()
    }

    fn index() -> SpectrumIndex {
        SpectrumIndex::new(SIDE, 0.0, 2000, |number, out| out.extend(noise(number)), CancelCheck::default())
    }

    #[test]
    fn a_patch_is_found_however_it_is_rotated_and_negated() {
        let index = index();
        for orientation in 0..8 {
            let (carried, number) = (matrix(orientation), 37 + 211 * orientation as usize);
            // The query has at each place what the other has where the place is carried to.
            let other = noise(number);
            let half = Vec2::splat(SIDE as f32 * 0.5 - 0.5);
            let value = |i: usize| {
                let place = Vec2::new((i % SIDE) as f32, (i / SIDE) as f32) - half;
                let at = (carried * place + half).round().as_uvec2();
                -3.0 * other[at.y as usize * SIDE + at.x as usize]
            };
            let patch: Vec<f32> = (0..SIDE * SIDE).map(value).collect();
            let found = index.nearest(&patch, 4, 64);
            assert_eq!((found[0].number, found[0].matrix), (number, carried), "orientation {orientation}");
            assert!(found.len() == 4 && found.is_sorted_by(|a, b| a.distance <= b.distance));
        }
    }

    #[test]
    fn nearer_patches_correlate_more() {
        let index = index();
        let query = noise(5000);
        let correlation = |found: &SpectrumMatch| {
            let other = noise(found.number);
            let half = Vec2::splat(SIDE as f32 * 0.5 - 0.5);
            let carried = |i: usize| {
                let place = Vec2::new((i % SIDE) as f32, (i / SIDE) as f32) - half;
                let at = (found.matrix * place + half).round().as_uvec2();
                other[at.y as usize * SIDE + at.x as usize]
            };
            let dot = |f: &dyn Fn(usize) -> f32| (0..SIDE * SIDE).map(f).sum::<f32>();
            let both = dot(&|i| query[i] * carried(i));
            both * both / (dot(&|i| query[i] * query[i]) * dot(&|i| other[i] * other[i]))
        };
        let found = index.nearest(&query, 400, 2000);
        let mean = |found: &[SpectrumMatch]| found.iter().map(correlation).sum::<f32>() / found.len() as f32;
        let (near, far) = (mean(&found[..20]), mean(&found[380..]));
        assert!(near > 1.5 * far, "{near} and {far}");
    }

    #[test]
    fn what_is_flat_or_not_a_number_does_no_harm() {
        let index = SpectrumIndex::new(
            4,
            0.1,
            3,
            |number, out| out.extend([number as f32; 16]),
            CancelCheck::default(),
        );
        assert!(index.nearest(&[0.0; 16], 2, 4).len() == 2 && index.len() == 3);
        assert!(index.nearest(&[f32::NAN; 16], 2, 4).is_empty());
        assert!(
            SpectrumIndex::new(8, 0.1, 0, |_, _| (), CancelCheck::default())
                .nearest(&[1.0; 64], 2, 4)
                .is_empty()
        );
    }
}
