//! Nearest points within a bounded effort.
//!
//! In fourteen dimensions an exact k-d tree looks at thousands of points for every query, more the more points there are.
//! Here leaves are looked at in the order of their distance (best bin first, Beis and Lowe 1997), and after a number of them
//! the search ends with what it has: its time grows with the logarithm of the number of points. What is found so may miss a
//! neighbour; matches are refined and handed on to neighbours afterwards, which makes up for it.
//!
//! Searches without such a bound are those of the crate kiddo ([`crate::index`]), with which encodes of epitomes take as many CPU
//! seconds: 26.4 after 26.9 for a facade of 1024x1024 texels at 32 dB, 8.6 after 9.3 for brick of 512x512, 1.33 after 1.25 and 1.02 after
//! 1.00 for two fixtures of 256x256 (`texfold compress IMAGE --codec epitome --psnr 32`, development build, two cores).

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use rayon::prelude::*;
use texfold_core::CancelCheck;

/// Points of a leaf.
const LEAF: usize = 32;
/// Points above which halves are built side by side.
const SIDE_BY_SIDE: usize = 1 << 13;

/// Points of a leaf, by axis: distances of all of them are found at once.
type Leaf<const K: usize> = [[f32; LEAF]; K];

/// The smallest box around the points of a node.
#[derive(Debug, Clone, Copy)]
struct Bounds<const K: usize> {
    low: [f32; K],
    high: [f32; K],
}

/// Points in a balanced k-d tree of tight boxes. Node `i` has the halves `2 i` and `2 i + 1`; the root is 1.
pub(crate) struct BoundedTree<const K: usize> {
    bounds: Vec<Bounds<K>>,
    leaves: Vec<Leaf<K>>,
    /// Numbers of the points of the leaves.
    numbers: Vec<[u32; LEAF]>,
}

/// A node that is still to be looked at. The nearest is the greatest, and of equal ones that of the lowest number.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Open {
    distance: f32,
    node: usize,
}

impl Eq for Open {}

impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        other.distance.total_cmp(&self.distance).then(other.node.cmp(&self.node))
    }
}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<const K: usize> Bounds<K> {
    fn around(points: &[[f32; K]], numbers: &[u32]) -> Self {
        let mut bounds = Bounds { low: [f32::INFINITY; K], high: [f32::NEG_INFINITY; K] };
        for &number in numbers {
            for (axis, &value) in points[number as usize].iter().enumerate() {
                bounds.low[axis] = bounds.low[axis].min(value);
                bounds.high[axis] = bounds.high[axis].max(value);
            }
        }
        bounds
    }

    /// Squared distance of a place from the box; 0 inside of it.
    #[inline]
    fn distance(&self, place: &[f32; K]) -> f32 {
        let mut sum = 0.0;
        for axis in 0..K {
            let beyond = (self.low[axis] - place[axis]).max(place[axis] - self.high[axis]).max(0.0);
            sum += beyond * beyond;
        }
        sum
    }

    /// The axis along which it is longest.
    fn longest(&self) -> usize {
        let length = |axis: &usize| self.high[*axis] - self.low[*axis];
        (0..K).rev().max_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or(0)
    }
}

impl<const K: usize> BoundedTree<K> {
    /// The tree of all points, which are named by their places in the list; all of their numbers are finite. Of no use once the
    /// job is cancelled.
    pub(crate) fn new(points: &[[f32; K]], cancel: CancelCheck<'_>) -> Self {
        let leaves = points.len().div_ceil(LEAF).next_power_of_two();
        let mut numbers: Vec<u32> = (0..points.len() as u32).collect();
        let mut made: Vec<(usize, Bounds<K>, &mut [u32])> = Vec::new();
        split(points, Node { number: 1, leaves }, &mut numbers, &mut made, cancel);
        let none = Bounds { low: [f32::INFINITY; K], high: [f32::INFINITY; K] };
        let mut tree = BoundedTree {
            bounds: vec![none; 2 * leaves],
            leaves: vec![[[f32::INFINITY; LEAF]; K]; leaves],
            numbers: vec![[u32::MAX; LEAF]; leaves],
        };
        for (node, bounds, of_node) in made {
            if cancel.is_cancelled() {
                break;
            }
            tree.bounds[node] = bounds;
            let Some(leaf) = node.checked_sub(leaves) else { continue };
            for (lane, &number) in of_node.iter().enumerate() {
                tree.numbers[leaf][lane] = number;
                for (axis, lanes) in tree.leaves[leaf].iter_mut().enumerate() {
                    lanes[lane] = points[number as usize][axis];
                }
            }
        }
        tree
    }

    /// At most `count` points near `query` and nearer than the squared distance `within`, with their distances, nearest first
    /// and those of equal distance by their numbers. At most `leaves` leaves are looked at; the nearest points of all are
    /// found where that is enough for all leaves that could hold some.
    pub(crate) fn nearest(
        &self,
        query: &[f32; K],
        within: f32,
        count: usize,
        leaves: usize,
    ) -> Vec<(u32, f32)> {
        let mut found: Vec<(u32, f32)> = Vec::new();
        let (mut most, mut looked) = (within, 0);
        let mut open = BinaryHeap::from([Open { distance: self.bounds[1].distance(query), node: 1 }]);
        while let Some(Open { distance, mut node }) = open.pop() {
            if distance.is_nan() || distance >= most || looked == leaves || count == 0 {
                break;
            }
            while let Some((near, far)) = self.halves(node, query) {
                if far.distance < most {
                    open.push(far);
                }
                node = near.node;
            }
            looked += 1;
            self.look(node, query, &mut most, count, &mut found);
        }
        found
    }

    /// The halves of a node, the nearer one first; `None` of a leaf.
    #[inline]
    fn halves(&self, node: usize, query: &[f32; K]) -> Option<(Open, Open)> {
        let half = |node: usize| Open { distance: self.bounds[node].distance(query), node };
        if node >= self.leaves.len() {
            return None;
        }
        let (first, second) = (half(2 * node), half(2 * node + 1));
        Some(if first >= second { (first, second) } else { (second, first) })
    }

    /// Adds the points of a leaf that are nearer than `most`, and keeps the nearest `count`.
    fn look(&self, node: usize, query: &[f32; K], most: &mut f32, count: usize, found: &mut Vec<(u32, f32)>) {
        let leaf = node - self.leaves.len();
        let mut distances = [0.0f32; LEAF];
        for (lanes, value) in self.leaves[leaf].iter().zip(query) {
            for (distance, lane) in distances.iter_mut().zip(lanes) {
                *distance += (lane - value) * (lane - value);
            }
        }
        for (&distance, &number) in distances.iter().zip(&self.numbers[leaf]) {
            if distance < *most {
                let place = found.partition_point(|&(other, near)| (near, other) < (distance, number));
                found.insert(place, (number, distance));
                if found.len() > count {
                    found.pop();
                }
                if found.len() == count {
                    *most = most.min(found[count - 1].1);
                }
            }
        }
    }
}

/// A node of a tree that is being built, and how many leaves it has room for.
#[derive(Debug, Clone, Copy)]
struct Node {
    number: usize,
    leaves: usize,
}

impl Node {
    fn halves(self) -> [Node; 2] {
        [0, 1].map(|half| Node { number: 2 * self.number + half, leaves: self.leaves / 2 })
    }
}

/// Sorts the points of a node into its halves, and those into theirs, until the job is cancelled.
fn split<'a, const K: usize>(
    points: &[[f32; K]],
    node: Node,
    numbers: &'a mut [u32],
    made: &mut Vec<(usize, Bounds<K>, &'a mut [u32])>,
    cancel: CancelCheck<'_>,
) {
    if cancel.is_cancelled() {
        return;
    }
    let bounds = Bounds::around(points, numbers);
    if node.leaves == 1 {
        made.push((node.number, bounds, numbers));
        return;
    }
    made.push((node.number, bounds, &mut []));
    let (axis, middle) = (bounds.longest(), numbers.len() / 2);
    let value = |number: u32| points[number as usize][axis];
    if middle > 0 {
        numbers.select_nth_unstable_by(middle, |&a, &b| value(a).total_cmp(&value(b)).then(a.cmp(&b)));
    }
    let is_large = numbers.len() > SIDE_BY_SIDE;
    let (low, high) = numbers.split_at_mut(middle);
    let [first, second] = node.halves();
    if !is_large {
        split(points, first, low, made, cancel);
        split(points, second, high, made, cancel);
        return;
    }
    let halves: Vec<Vec<_>> = [(first, low), (second, high)]
        .into_par_iter()
        .map(|(node, numbers)| {
            let mut made = Vec::new();
            split(points, node, numbers, &mut made, cancel);
            made
        })
        .collect();
    made.extend(halves.into_iter().flatten());
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The nearest points by looking at all of them.
    fn scan<const K: usize>(
        points: &[[f32; K]],
        query: &[f32; K],
        within: f32,
        count: usize,
    ) -> Vec<(u32, f32)> {
        let distance = |point: &[f32; K]| point.iter().zip(query).map(|(a, b)| (a - b) * (a - b)).sum();
        let mut all: Vec<(u32, f32)> = (0..).zip(points.iter().map(distance)).collect();
        all.retain(|&(_, distance)| distance < within);
        all.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        all.truncate(count);
        all
    }

    proptest! {
        #[test]
        fn with_enough_leaves_it_finds_what_a_full_scan_finds(
            points in proptest::collection::vec(proptest::array::uniform5(-8i8..8), 0..300),
            query in proptest::array::uniform5(-9i8..9),
            within in 0u8..200,
            count in 0usize..20,
        ) {
            // Whole numbers: distances are exact, and many are equal.
            let points: Vec<[f32; 5]> = points.iter().map(|point| point.map(f32::from)).collect();
            let (query, within) = (query.map(f32::from), f32::from(within));
            let tree = BoundedTree::new(&points, CancelCheck::default());
            let found = tree.nearest(&query, within, count, usize::MAX);
            let scanned = scan(&points, &query, within, count);
            let distances = |found: &[(u32, f32)]| found.iter().map(|near| near.1).collect::<Vec<_>>();
            prop_assert_eq!(distances(&found), distances(&scanned));
            for (number, distance) in found {
                prop_assert_eq!(scan(&points[number as usize..=number as usize], &query, within, 1), [(0, distance)]);
            }
        }
    }

    #[test]
    fn few_leaves_find_most() {
        // Fourteen numbers that fall off as the frequencies of images do.
        let value = |i: u32, axis: u32| {
            let hash = (i * 14 + axis).wrapping_mul(2_654_435_761).rotate_left(13).wrapping_mul(0x9e37_79b1);
            ((hash >> 8) as f32 / (1 << 24) as f32 - 0.5) / (1 + axis) as f32
        };
        let point = |i: u32| std::array::from_fn::<f32, 14, _>(|axis| value(i, axis as u32));
        let points: Vec<[f32; 14]> = (0..20_000).map(point).collect();
        let tree = BoundedTree::new(&points, CancelCheck::default());
        let queries = 20_000..20_200;
        let found: usize = queries
            .clone()
            .map(|i| {
                let scanned = scan(&points, &point(i), f32::INFINITY, 6);
                let found = tree.nearest(&point(i), f32::INFINITY, 6, 32);
                found.iter().filter(|near| scanned.contains(near)).count()
            })
            .sum();
        let share = found as f64 / (6 * queries.len()) as f64;
        assert!(share > 0.8, "{share}");
    }

    #[test]
    fn what_is_not_a_number_finds_nothing() {
        let tree = BoundedTree::new(&[[1.0f32, 2.0], [3.0, 4.0]], CancelCheck::default());
        assert!(tree.nearest(&[f32::NAN, 0.0], 9.0, 2, 9).is_empty());
        assert!(
            BoundedTree::<2>::new(&[], CancelCheck::default())
                .nearest(&[0.0, 0.0], f32::INFINITY, 2, 9)
                .is_empty()
        );
    }

    #[test]
    fn a_tree_of_a_cancelled_job_is_not_built() {
        let points: Vec<[f32; 14]> =
            (0..600_000u32).map(|i| [(i.wrapping_mul(2_654_435_761) >> 8) as f32; 14]).collect();
        let cancel = texfold_core::Cancel::default();
        let job = texfold_core::Job::default().with_cancel(&cancel);
        let tree = |near: [f32; 14]| {
            BoundedTree::new(&points, job.cancel_check()).nearest(&near, 1.0, 1, usize::MAX)
        };
        assert_eq!(tree(points[9]), [(9, 0.0)]);
        cancel.cancel();
        assert!(tree(points[9]).is_empty());
    }
}
