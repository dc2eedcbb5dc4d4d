//! The Gray Split Rotate descriptor and a search by it: the gray values of a grid that is aligned with a patch's main
//! direction ("Progressive compression of large-scale remote sensing images with GSR descriptors", 2012, section 4.1).
//!
//! The plane is blurred, the gradients of a patch's texels vote for its direction, and N x N values are read between texels of
//! the rotated grid. A patch without a direction keeps an upright grid. Beside the paper's plain values there are values
//! without mean and contrast, for content that is drawn with a gain. Cost: a k-d tree of the patches; a query takes
//! `2 x count` or `4 x count` neighbours, as a patch may also be found reflected and negated.

use glam::{Mat2, Vec2};
use rayon::prelude::*;
use texfold_core::CancelCheck;

use crate::groups::Groups;
use crate::index::Tree;
use crate::oriented::{BINS, OrientedPatch, bin_of, peak};

/// Fewest and most values a side of the grid.
pub const GSR_SIDES: std::ops::RangeInclusive<usize> = 4..=8;
/// Length of mean-free values a grid value, in 8-bit steps, that counts as noise: contrast below it is not blown up.
const NOISE: f32 = 1.0;

/// What is kept of the gray values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GsrInput {
    /// The values themselves, as in the paper; squared distances are mean squared differences in units of the range.
    Gray,
    /// Values less their mean, over their length: for content that is drawn with a gain of either sign.
    Shape,
}

/// A gray plane, blurred, with the direction of its gradients.
#[derive(Debug, Clone)]
pub struct GrayPlane {
    width: usize,
    height: usize,
    values: Vec<f32>,
    /// For each texel the bin of its gradient's direction, how far it lies towards the next, and the gradient's length.
    gradients: Vec<(u8, f32, f32)>,
}

impl GrayPlane {
    /// Blurs `values`, `width` a row in 8-bit units, by a Gaussian of `sigma` texels. Of no use once the job is cancelled.
    #[must_use]
    pub fn new(width: usize, values: &[f32], sigma: f32, cancel: CancelCheck<'_>) -> Self {
        let height = values.len() / width.max(1);
        let values = blur(width, height, values, sigma, cancel);
        let at = |x: usize, y: usize| values[y * width + x];
        let gradients = (0..width * height)
            .into_par_iter()
            .map(|index| {
                if cancel.is_cancelled() {
                    return (0, 0.0, 0.0);
                }
                let (x, y) = (index % width, index / width);
                let across = at((x + 1).min(width - 1), y) - at(x.saturating_sub(1), y);
                let down = at(x, (y + 1).min(height - 1)) - at(x, y.saturating_sub(1));
                let gradient = Vec2::new(across, down);
                let (bin, part) = bin_of(gradient);
                (bin as u8, part, gradient.length())
            })
            .collect();
        GrayPlane { width, height, values, gradients }
    }

    /// Columns and rows.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Value at a place between texels, clamped to the plane.
    fn at(&self, place: Vec2) -> f32 {
        let most = Vec2::new(self.width as f32 - 1.0, self.height as f32 - 1.0);
        let at = (place - 0.5).clamp(Vec2::ZERO, most);
        let (x, y) = (at.x as usize, at.y as usize);
        let (u, v) = (at.x - x as f32, at.y - y as f32);
        let (right, below) = ((x + 1).min(self.width - 1), (y + 1).min(self.height - 1));
        let row = |y: usize| {
            let (a, b) = (self.values[y * self.width + x], self.values[y * self.width + right]);
            a + (b - a) * u
        };
        let (upper, lower) = (row(y), row(below));
        upper + (lower - upper) * v
    }

    /// The main direction of the gradients in the disc of the patch of `side` texels; 0 where none stands out.
    #[must_use]
    pub fn direction(&self, centre: Vec2, side: f32) -> f32 {
        let radius = side * 0.5;
        let span = |at: f32, count: usize| {
            let low = (at - radius).ceil().max(0.0) as usize;
            low..((at + radius).floor().max(0.0) as usize).min(count)
        };
        let mut bins = [0.0f32; BINS];
        for y in span(centre.y, self.height) {
            for x in span(centre.x, self.width) {
                let away = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - centre;
                if away.length_squared() <= radius * radius {
                    let (bin, part, length) = self.gradients[y * self.width + x];
                    bins[usize::from(bin)] += length * (1.0 - part);
                    bins[(usize::from(bin) + 1) % BINS] += length * part;
                }
            }
        }
        peak(&bins).unwrap_or(0.0)
    }

    /// The values of the rotated grid row by row, and its contrast: their RMS without mean.
    fn grid<const K: usize>(&self, patch: &OrientedPatch, input: GsrInput) -> ([f32; K], f32) {
        let side = side_of(K);
        let spacing = patch.side / side as f32;
        let rotation = Mat2::from_angle(patch.angle);
        let mut values = [0.0f32; K];
        for (index, value) in values.iter_mut().enumerate() {
            let cell = Vec2::new((index % side) as f32, (index / side) as f32);
            *value = self.at(patch.centre + rotation * ((cell - (side as f32 - 1.0) * 0.5) * spacing));
        }
        let mean = values.iter().sum::<f32>() / K as f32;
        let squared: f32 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
        let length = squared.sqrt();
        let values = match input {
            GsrInput::Gray => values.map(|value| value / (255.0 * side as f32)),
            GsrInput::Shape => values.map(|value| (value - mean) / (length + NOISE * side as f32)),
        };
        (values, length / side as f32)
    }
}

/// Values a side of a grid of `count`.
const fn side_of(count: usize) -> usize {
    let mut side = 1;
    while side * side < count {
        side += 1;
    }
    side
}

fn blur(width: usize, height: usize, values: &[f32], sigma: f32, cancel: CancelCheck<'_>) -> Vec<f32> {
    let radius = (3.0 * sigma).ceil() as usize;
    let weight = |away: usize| (-(away as f32).powi(2) / (2.0 * sigma * sigma).max(1e-6)).exp();
    let kernel: Vec<f32> = (0..=radius).map(weight).collect();
    let sum = kernel[0] + 2.0 * kernel[1..].iter().sum::<f32>();
    let pass = |values: &[f32], step: usize, count: usize, place: &(dyn Fn(usize) -> usize + Sync)| {
        let texel = |index: usize| {
            if cancel.is_cancelled() {
                return 0.0;
            }
            let at = place(index);
            let start = index - at * step;
            let read = |at: usize| values[start + at * step];
            let sides = (1..=radius).map(|away| {
                kernel[away] * (read(at.saturating_sub(away)) + read((at + away).min(count - 1)))
            });
            (kernel[0] * read(at) + sides.sum::<f32>()) / sum
        };
        (0..values.len()).into_par_iter().map(texel).collect::<Vec<f32>>()
    };
    let across = pass(values, 1, width, &|index| index % width);
    pass(&across, width, height, &|index| index / width)
}

/// Patches of which the nearest are found by descriptors of any length.
trait Search: Send + Sync {
    fn near(
        &self,
        plane: &GrayPlane,
        query: &OrientedPatch,
        input: GsrInput,
        within: f32,
        count: usize,
    ) -> Vec<GsrMatch>;
    fn len(&self) -> usize;
}

/// A patch that looks like the query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GsrMatch {
    /// Squared distance of the descriptors.
    pub distance: f32,
    /// The patch.
    pub patch: OrientedPatch,
    /// What carries places of the query, from its centre, to places of this one.
    pub matrix: Mat2,
    /// Whether it looks alike with its sign changed: only with [`GsrInput::Shape`].
    pub negated: bool,
}

/// Patches whose descriptors have `K` values.
struct OfGrid<N, const K: usize>(N);

/// What finds the patches near to a descriptor.
trait Near<const K: usize>: Send + Sync {
    fn nearest(&self, query: &[f32; K], within: f32, count: usize) -> Vec<(&OrientedPatch, f32)>;
    fn len(&self) -> usize;
}

impl<const K: usize> Near<K> for Tree<OrientedPatch, K> {
    fn nearest(&self, query: &[f32; K], within: f32, count: usize) -> Vec<(&OrientedPatch, f32)> {
        Tree::nearest(self, query, within, count)
    }

    fn len(&self) -> usize {
        Tree::len(self)
    }
}

impl<const K: usize> Near<K> for Groups<OrientedPatch, K> {
    fn nearest(&self, query: &[f32; K], within: f32, count: usize) -> Vec<(&OrientedPatch, f32)> {
        Groups::nearest(self, query, within, count)
    }

    fn len(&self) -> usize {
        Groups::len(self)
    }
}

impl<N: Near<K>, const K: usize> Search for OfGrid<N, K> {
    fn near(
        &self,
        plane: &GrayPlane,
        query: &OrientedPatch,
        input: GsrInput,
        within: f32,
        count: usize,
    ) -> Vec<GsrMatch> {
        let (plain, _) = plane.grid::<K>(query, input);
        let side = side_of(K);
        let mut found = Vec::new();
        for negated in [false, true] {
            if negated && input == GsrInput::Gray {
                break;
            }
            // A negated patch has the opposite direction: its grid is read from the other end.
            let (signed, angle) = if negated {
                let rotated: [f32; K] = std::array::from_fn(|index| -plain[K - 1 - index]);
                (rotated, query.angle + std::f32::consts::PI)
            } else {
                (plain, query.angle)
            };
            // Reflection along the main direction keeps it.
            let reflected: [f32; K] =
                std::array::from_fn(|index| signed[(side - 1 - index / side) * side + index % side]);
            for (descriptor, sign) in [(&signed, 1.0), (&reflected, -1.0)] {
                let upright = Mat2::from_diagonal(Vec2::new(1.0, sign)) * Mat2::from_angle(-angle);
                for (&patch, distance) in self.0.nearest(descriptor, within, count) {
                    let matrix = Mat2::from_angle(patch.angle) * upright * (patch.side / query.side);
                    found.push(GsrMatch { distance, patch, matrix, negated });
                }
            }
        }
        found.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        found
    }

    fn len(&self) -> usize {
        self.0.len()
    }
}

/// Patches of one or several planes, found however they are rotated.
pub struct GsrIndex {
    search: Box<dyn Search>,
    input: GsrInput,
}

impl std::fmt::Debug for GsrIndex {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GsrIndex").field("patches", &self.len()).field("input", &self.input).finish()
    }
}

impl GsrIndex {
    /// Indexes patches (number of the plane, centre, side) by grids of `side` x `side` values, [`GSR_SIDES`], whose contrast
    /// is at least `contrast` 8-bit steps. Of patches that look the same a few are kept. Of no use once the job is
    /// cancelled.
    #[must_use]
    pub fn new(
        planes: &[&GrayPlane],
        patches: &[(u32, Vec2, f32)],
        side: usize,
        input: GsrInput,
        contrast: f32,
        cancel: CancelCheck<'_>,
    ) -> Self {
        GsrIndex { search: search_of(planes, patches, side, (input, contrast), Kind::Tree, cancel), input }
    }

    /// The same, which finds near patches quicker, but not always the nearest.
    #[must_use]
    pub fn grouped(
        planes: &[&GrayPlane],
        patches: &[(u32, Vec2, f32)],
        side: usize,
        input: GsrInput,
        contrast: f32,
        cancel: CancelCheck<'_>,
    ) -> Self {
        GsrIndex { search: search_of(planes, patches, side, (input, contrast), Kind::Groups, cancel), input }
    }

    /// Number of patches.
    #[must_use]
    pub fn len(&self) -> usize {
        self.search.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// For the patch of `side` texels around `centre` at most `count` patches like it, as many like its reflection and, where
    /// only shapes count, as many like the negatives of both, within the squared distance `within`; nearest first.
    #[must_use]
    pub fn nearest(
        &self,
        plane: &GrayPlane,
        (centre, side): (Vec2, f32),
        within: f32,
        count: usize,
    ) -> Vec<GsrMatch> {
        let query = OrientedPatch { field: 0, centre, side, angle: plane.direction(centre, side) };
        self.search.near(plane, &query, self.input, within, count)
    }
}

/// How near patches are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Tree,
    Groups,
}

fn search_of(
    planes: &[&GrayPlane],
    patches: &[(u32, Vec2, f32)],
    side: usize,
    kept: (GsrInput, f32),
    kind: Kind,
    cancel: CancelCheck<'_>,
) -> Box<dyn Search> {
    match side {
        ..=4 => described::<16>(planes, patches, kept, kind, cancel),
        5 => described::<25>(planes, patches, kept, kind, cancel),
        6 => described::<36>(planes, patches, kept, kind, cancel),
        7 => described::<49>(planes, patches, kept, kind, cancel),
        _ => described::<64>(planes, patches, kept, kind, cancel),
    }
}

fn described<const K: usize>(
    planes: &[&GrayPlane],
    patches: &[(u32, Vec2, f32)],
    (input, contrast): (GsrInput, f32),
    kind: Kind,
    cancel: CancelCheck<'_>,
) -> Box<dyn Search> {
    let described = patches
        .par_iter()
        .filter(|_| !cancel.is_cancelled())
        .filter_map(|&(field, centre, side)| {
            let plane = planes[field as usize];
            let patch = OrientedPatch { field, centre, side, angle: plane.direction(centre, side) };
            let (descriptor, found) = plane.grid::<K>(&patch, input);
            let usable = found >= contrast && descriptor.iter().all(|value| value.is_finite());
            usable.then_some((patch, descriptor))
        })
        .collect();
    match kind {
        Kind::Tree => Box::new(OfGrid::<Tree<OrientedPatch, K>, K>(Tree::new(described, cancel))),
        Kind::Groups => Box::new(OfGrid::<Groups<OrientedPatch, K>, K>(Groups::new(described))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth image around (60, 60), laid by `matrix`.
    fn image(matrix: Mat2) -> Vec<f32> {
        let inverse = matrix.inverse();
        let value = |x: usize, y: usize| {
            let at = inverse * (Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - 60.0);
            let wave = (at.x * 0.31).sin() * 40.0 + (at.y * 0.17 + at.x * 0.05).cos() * 30.0;
            120.0 + wave + 6.0 * at.x.clamp(-9.0, 9.0)
        };
        (0..120 * 120).map(|i| value(i % 120, i / 120)).collect()
    }

    fn everywhere(step: usize, side: f32) -> Vec<(u32, Vec2, f32)> {
        let count = 96 / step;
        let at = |i: usize| Vec2::new((i % count * step) as f32, (i / count * step) as f32) + 12.0;
        (0..count * count).map(|i| (0, at(i), side)).collect()
    }

    #[test]
    fn a_patch_is_found_however_it_is_rotated_reflected_and_negated() {
        let plain = GrayPlane::new(120, &image(Mat2::IDENTITY), 1.0, CancelCheck::default());
        for side in GSR_SIDES {
            for (angle, flip, negative) in [(0.0, 1.0, false), (0.7, 1.0, false), (-1.3, -1.0, true)] {
                let matrix = Mat2::from_angle(angle) * Mat2::from_diagonal(Vec2::new(1.0, flip));
                let mut other = image(matrix);
                if negative {
                    other.iter_mut().for_each(|value| *value = 255.0 - *value);
                }
                let other = GrayPlane::new(120, &other, 1.0, CancelCheck::default());
                let index = GsrIndex::new(
                    &[&other],
                    &everywhere(4, 32.0),
                    side,
                    GsrInput::Shape,
                    1.0,
                    CancelCheck::default(),
                );
                let found = index.nearest(&plain, (Vec2::splat(60.0), 32.0), 1.0, 4);
                let best = found[0];
                assert!(best.patch.centre.distance(Vec2::splat(60.0)) < 3.0, "{side} {angle}: {best:?}");
                assert_eq!(best.negated, negative);
                let off = best.matrix - matrix;
                assert!(off.x_axis.length().max(off.y_axis.length()) < 0.2, "{side} {angle}: {best:?}");
            }
        }
    }

    #[test]
    fn gray_values_tell_brightness_apart_and_shapes_do_not() {
        let values = image(Mat2::IDENTITY);
        let plain = GrayPlane::new(120, &values, 1.0, CancelCheck::default());
        let darker: Vec<f32> = values.iter().map(|value| value * 0.5).collect();
        let darker = GrayPlane::new(120, &darker, 1.0, CancelCheck::default());
        let patches = [(0, Vec2::splat(60.0), 16.0)];
        let distance = |input: GsrInput| {
            let index = GsrIndex::new(&[&darker], &patches, 4, input, 0.0, CancelCheck::default());
            index.nearest(&plain, (Vec2::splat(60.0), 16.0), 4.0, 1)[0].distance
        };
        assert!(distance(GsrInput::Gray) > 0.02, "{}", distance(GsrInput::Gray));
        assert!(distance(GsrInput::Shape) < 0.01, "{}", distance(GsrInput::Shape));
    }

    #[test]
    fn identical_patches_by_the_thousand_and_flat_ones_are_no_burden() {
        // Tiles of 8 x 8, repeated: every 8th patch is the same. A flat plane has no contrast at all.
        let tile = |x: usize, y: usize| ((x % 8) * 13 + (y % 8) * 29) as f32;
        let tiled: Vec<f32> = (0..120 * 120).map(|i| tile(i % 120, i / 120)).collect();
        let tiled = GrayPlane::new(120, &tiled, 0.7, CancelCheck::default());
        let index =
            GsrIndex::new(&[&tiled], &everywhere(1, 16.0), 4, GsrInput::Shape, 1.0, CancelCheck::default());
        assert!(!index.is_empty() && index.len() < 96 * 96 / 16, "{}", index.len());
        let found = index.nearest(&tiled, (Vec2::splat(60.0), 16.0), 4.0, 250);
        assert!(found.len() > 10 && found[0].distance < 1e-6);
        let flat = GrayPlane::new(120, &vec![77.0; 120 * 120], 1.0, CancelCheck::default());
        let none =
            GsrIndex::new(&[&flat], &everywhere(4, 16.0), 4, GsrInput::Gray, 1.0, CancelCheck::default());
        assert!(none.is_empty() && none.nearest(&flat, (Vec2::splat(60.0), 16.0), 4.0, 9).is_empty());
        // A flat patch of a query finds what there is, upright.
        assert!(
            index.nearest(&flat, (Vec2::splat(60.0), 16.0), 4.0, 3).iter().all(|m| m.distance.is_finite())
        );
    }

    #[test]
    fn the_tree_finds_what_a_scan_finds() {
        let plane = GrayPlane::new(120, &image(Mat2::from_angle(0.3)), 1.0, CancelCheck::default());
        let patches = everywhere(3, 16.0);
        let index = GsrIndex::new(&[&plane], &patches, 4, GsrInput::Gray, 0.0, CancelCheck::default());
        let query = OrientedPatch {
            field: 0,
            centre: Vec2::new(51.0, 70.0),
            side: 16.0,
            angle: plane.direction(Vec2::new(51.0, 70.0), 16.0),
        };
        let wanted = plane.grid::<16>(&query, GsrInput::Gray).0;
        let mut scanned: Vec<f32> = patches
            .iter()
            .map(|&(field, centre, side)| {
                let patch = OrientedPatch { field, centre, side, angle: plane.direction(centre, side) };
                let other = plane.grid::<16>(&patch, GsrInput::Gray).0;
                wanted.iter().zip(other).map(|(a, b)| (a - b) * (a - b)).sum()
            })
            .collect();
        scanned.sort_by(f32::total_cmp);
        let found = index.nearest(&plane, (query.centre, 16.0), 4.0, 1);
        assert!((found[0].distance - scanned[0]).abs() < 1e-6, "{} {}", found[0].distance, scanned[0]);
    }
}
