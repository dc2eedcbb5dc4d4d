//! Nearest patches by descriptor.

use std::collections::HashMap;
use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use texfold_core::CancelCheck;

use crate::bounded::BoundedTree;
use crate::{DESCRIPTOR_LENGTH, Descriptor, LumaSums, describe};

/// Steps a unit in which descriptors are told apart: patches that agree to a step are near-identical.
const STEPS: f32 = 500.0;
/// Near-identical patches that are kept.
const ALIKE: usize = 2;
/// Leaves that are looked at for a query. An epitome of a megatexel takes 51 CPU seconds with 32 of them, 59 with 128 and 85 with
/// all; in small images 128 find what all do, 32 do not.
const LEAVES: usize = 128;

/// Where a patch lies: which field, and its upper left texel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// Number of the field.
    pub field: u32,
    /// Column of its upper left texel.
    pub x: u32,
    /// Row of its upper left texel.
    pub y: u32,
}

/// A patch that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbour {
    /// Where it lies.
    pub place: Place,
    /// Squared distance of the descriptors; at most about 4.
    pub distance: f32,
}

/// Items found by their descriptors.
pub(crate) struct Tree<T, const K: usize> {
    tree: Option<ImmutableKdTree<f32, K>>,
    items: Vec<T>,
}

/// Patches of one size in one or several fields.
pub struct PatchIndex {
    tree: BoundedTree<DESCRIPTOR_LENGTH>,
    places: Vec<Place>,
    patch: (usize, usize),
}

impl std::fmt::Debug for PatchIndex {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PatchIndex").field("places", &self.len()).field("patch", &self.patch).finish()
    }
}

impl PatchIndex {
    /// Indexes the patches of `patch` texels at `places` (each inside its field, whose sums are in `fields`) whose contrast is
    /// at least `contrast` 8-bit steps. Patches without contrast look all alike: thousands of them in a tree cost time
    /// and find nothing, and any one of them serves a query as well as any other.
    ///
    /// Of no use once the job is cancelled.
    #[must_use]
    pub fn new(
        fields: &[&LumaSums],
        patch: (usize, usize),
        places: &[Place],
        contrast: f32,
        cancel: CancelCheck<'_>,
    ) -> Self {
        let describe = |place: &Place| {
            let sums = fields[place.field as usize];
            (*place, describe(sums, place.x as usize, place.y as usize, patch.0, patch.1))
        };
        let described: Vec<_> = places
            .par_iter()
            .filter(|_| !cancel.is_cancelled())
            .map(describe)
            .filter(|(_, (_, found))| *found >= contrast)
            .map(|(place, (descriptor, _))| (place, descriptor))
            .collect();
        // A tree of some is of no more use than an empty one, and takes longer.
        let described = if cancel.is_cancelled() { Vec::new() } else { first_of_each(described) };
        let described = if cancel.is_cancelled() { Vec::new() } else { described };
        let (places, points): (Vec<_>, Vec<_>) = described.into_iter().unzip();
        PatchIndex { tree: BoundedTree::new(&points, cancel), places, patch }
    }

    /// Number of patches.
    #[must_use]
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Columns and rows of a patch in texels.
    #[must_use]
    pub fn patch(&self) -> (usize, usize) {
        self.patch
    }

    /// At most `count` patches near `query` and within the squared distance `within`, nearest first; patches of equal distance
    /// in the order of their places. They are the nearest of those in a number of leaves of the tree: now and then one is
    /// missed.
    #[must_use]
    pub fn nearest(&self, query: &Descriptor, within: f32, count: usize) -> Vec<Neighbour> {
        let found = self.tree.nearest(query, within, count, LEAVES);
        let neighbour = |(number, distance)| Neighbour { place: self.places[number as usize], distance };
        found.into_iter().map(neighbour).collect()
    }
}

impl<T, const K: usize> Tree<T, K> {
    /// All items but further ones that look the same. Of no use once the job is cancelled.
    pub(crate) fn new(described: Vec<(T, [f32; K])>, cancel: CancelCheck<'_>) -> Self {
        let described = if cancel.is_cancelled() { Vec::new() } else { described };
        let (items, points): (Vec<_>, Vec<_>) = first_of_each(described).into_iter().unzip();
        // Building fails for more items than 32 bits count alone.
        Tree { tree: ImmutableKdTree::new_from_slice(&points).ok().filter(|tree| tree.size() > 0), items }
    }

    /// Number of items.
    pub(crate) fn len(&self) -> usize {
        self.items.len()
    }

    /// At most `count` items nearest to `query` within a squared distance, nearest first, with their distances.
    pub(crate) fn nearest(&self, query: &[f32; K], within: f32, count: usize) -> Vec<(&T, f32)> {
        let (Some(tree), Some(count)) = (&self.tree, NonZero::new(count)) else { return Vec::new() };
        if query.iter().any(|value| !value.is_finite()) {
            return Vec::new();
        }
        let near =
            tree.query(query).nearest_n::<SquaredEuclidean<f32>>(count).within(within).exclusive_boundaries();
        let mut found: Vec<(u32, f32)> =
            near.execute().into_iter().map(|near| (near.item, near.distance)).collect();
        // Items of equal distance in the order that they were given.
        found.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        found.into_iter().map(|(item, distance)| (&self.items[item as usize], distance)).collect()
    }
}

/// The step nearest to a value: without the C library, by which all values of all patches would be rounded.
fn step_of(value: f32) -> i16 {
    (value * STEPS + 0.5f32.copysign(value)) as i16
}

/// The first few of near-identical patches. What repeats exactly has its first copies as the source of all, so that
/// everybody finds the same ones.
pub(crate) fn first_of_each<T, const K: usize>(described: Vec<(T, [f32; K])>) -> Vec<(T, [f32; K])> {
    let mut seen: HashMap<[i16; K], usize> = HashMap::new();
    let is_new = |(_, descriptor): &(T, [f32; K])| {
        let count = seen.entry(descriptor.map(step_of)).or_default();
        *count += 1;
        *count <= ALIKE
    };
    described.into_iter().filter(is_new).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Field;
    use glam::Vec4;

    fn grid(columns: u32, rows: u32) -> Vec<Place> {
        let row = |y: u32| (0..columns).map(move |x| Place { field: 0, x, y });
        (0..rows).flat_map(row).collect()
    }

    #[test]
    fn finds_what_a_full_scan_finds() {
        let value = |x: usize, y: usize| ((x * x + 3 * y * y + x * y * 5) % 97) as f32 * 2.5;
        let texels = (0..64 * 48).map(|i| Vec4::splat(value(i % 64, i / 64))).collect();
        let field = Field { width: 64, height: 48, texels };
        let sums = LumaSums::new(&field);
        let places = grid(56, 40);
        let index = PatchIndex::new(&[&sums], (8, 8), &places, 0.0, CancelCheck::default());
        let query = describe(&sums, 13, 21, 8, 8).0;
        let found = index.nearest(&query, 4.0, 5);
        let mut scanned: Vec<f32> = places
            .iter()
            .map(|place| {
                let other = describe(&sums, place.x as usize, place.y as usize, 8, 8).0;
                other.iter().zip(&query).map(|(a, b)| (a - b) * (a - b)).sum()
            })
            .collect();
        scanned.sort_by(f32::total_cmp);
        assert_eq!(found[0].place, Place { field: 0, x: 13, y: 21 });
        for (found, scanned) in found.iter().zip(scanned) {
            assert!((found.distance - scanned).abs() < 1e-5);
        }
    }

    #[test]
    fn a_cancelled_index_is_empty() {
        let texels = (0..64 * 48).map(|i| Vec4::splat((i * i % 97) as f32)).collect();
        let sums = LumaSums::new(&Field { width: 64, height: 48, texels });
        let cancel = texfold_core::Cancel::default();
        let job = texfold_core::Job::default().with_cancel(&cancel);
        let index = || PatchIndex::new(&[&sums], (8, 8), &grid(56, 40), 0.0, job.cancel_check());
        assert!(!index().is_empty());
        cancel.cancel();
        assert!(index().is_empty());
    }

    #[test]
    fn thousands_of_equal_patches_are_no_trouble() {
        let field = Field { width: 200, height: 200, texels: vec![Vec4::splat(9.0); 40_000] };
        let sums = LumaSums::new(&field);
        let places = grid(190, 190);
        assert!(PatchIndex::new(&[&sums], (8, 8), &places, 0.5, CancelCheck::default()).is_empty());
        let all = PatchIndex::new(&[&sums], (8, 8), &places, 0.0, CancelCheck::default());
        let query = describe(&sums, 0, 0, 8, 8).0;
        let found: Vec<Place> = all.nearest(&query, 1.0, 7).iter().map(|near| near.place).collect();
        assert_eq!(found, places[..2]);
    }
}
