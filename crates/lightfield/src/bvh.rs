//! Rays against triangles, through a hierarchy of boxes split at the median: O(log n) a ray.

use std::ops::Range;

use glam::Vec3;

/// Triangles of a leaf: fewer cost more boxes, more cost more triangles.
const LEAF: usize = 4;
/// Open boxes of a traversal: the tree is balanced, so 2^26 triangles are no deeper than half of that.
const STACK: usize = 64;

/// Where a ray meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Hit {
    /// Distance along the ray in lengths of its direction.
    pub(crate) distance: f32,
    /// Index of the triangle.
    pub(crate) triangle: u32,
    /// Weights of the triangle's corners.
    pub(crate) barycentric: Vec3,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    low: Vec3,
    high: Vec3,
    /// Of a leaf the first triangle, else the left child; the right child follows its whole subtree.
    first: u32,
    /// Triangles of a leaf, 0 for a branch.
    count: u32,
    right: u32,
}

/// The hierarchy over a mesh.
#[derive(Debug, Clone)]
pub(crate) struct Bvh {
    nodes: Vec<Node>,
    /// Corners, in the order of the leaves.
    corners: Vec<[Vec3; 3]>,
    /// Their numbers in the mesh.
    order: Vec<u32>,
}

impl Bvh {
    /// Over triangles given by their corners, which are finite.
    pub(crate) fn new(triangles: &[[Vec3; 3]]) -> Bvh {
        let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
        let centres: Vec<Vec3> = triangles.iter().map(|[a, b, c]| *a + *b + *c).collect();
        let mut bvh = Bvh { nodes: Vec::new(), corners: Vec::new(), order: Vec::new() };
        if !order.is_empty() {
            bvh.build(triangles, &centres, &mut order, 0);
        }
        bvh.corners = order.iter().map(|&triangle| triangles[triangle as usize]).collect();
        bvh.order = order;
        bvh
    }

    fn build(&mut self, triangles: &[[Vec3; 3]], centres: &[Vec3], order: &mut [u32], first: usize) -> u32 {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for &triangle in order.iter() {
            for corner in triangles[triangle as usize] {
                (low, high) = (low.min(corner), high.max(corner));
            }
        }
        let index = self.nodes.len();
        self.nodes.push(Node { low, high, first: first as u32, count: order.len() as u32, right: 0 });
        if order.len() <= LEAF {
            return index as u32;
        }
        let size = high - low;
        let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).unwrap_or(0);
        let middle = order.len() / 2;
        // The number breaks ties, so that the tree is the same on every machine.
        order.select_nth_unstable_by(middle, |&a, &b| {
            centres[a as usize][axis].total_cmp(&centres[b as usize][axis]).then(a.cmp(&b))
        });
        let (left, right) = order.split_at_mut(middle);
        self.build(triangles, centres, left, first);
        let right = self.build(triangles, centres, right, first + middle);
        self.nodes[index].count = 0;
        self.nodes[index].right = right;
        index as u32
    }

    /// The nearest triangle beyond distance `from`.
    pub(crate) fn nearest(&self, origin: Vec3, direction: Vec3, from: f32) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        self.visit(origin, direction, from..f32::INFINITY, |hit| {
            if best.is_none_or(|best| hit.distance < best.distance) {
                best = Some(hit);
            }
            best.map_or(f32::INFINITY, |best| best.distance)
        });
        best
    }

    /// Whether a triangle that `counts` admits lies within `distances`, without their ends.
    #[cfg(feature = "encode")]
    pub(crate) fn blocks(
        &self,
        origin: Vec3,
        direction: Vec3,
        distances: Range<f32>,
        counts: impl Fn(u32) -> bool,
    ) -> bool {
        let mut found = false;
        self.visit(origin, direction, distances.clone(), |hit| {
            found |= counts(hit.triangle);
            if found { f32::NEG_INFINITY } else { distances.end }
        });
        found
    }

    /// Gives every triangle within `distances` to `see`, which answers with a new end.
    fn visit(&self, origin: Vec3, direction: Vec3, distances: Range<f32>, mut see: impl FnMut(Hit) -> f32) {
        let Range { start: from, end: mut to } = distances;
        let inverse = direction.recip();
        let mut stack = [0u32; STACK];
        let mut open = usize::from(!self.nodes.is_empty());
        while open > 0 {
            open -= 1;
            let index = stack[open];
            let node = &self.nodes[index as usize];
            if !node.meets(origin, inverse, from, to) {
                continue;
            }
            if node.count == 0 {
                stack[open] = node.right;
                stack[open + 1] = index + 1;
                open += 2;
                continue;
            }
            for at in node.first as usize..(node.first + node.count) as usize {
                if let Some((distance, barycentric)) = intersect(&self.corners[at], origin, direction)
                    && distance > from
                    && distance < to
                {
                    to = see(Hit { distance, triangle: self.order[at], barycentric });
                }
            }
        }
    }
}

impl Node {
    fn meets(&self, origin: Vec3, inverse: Vec3, from: f32, to: f32) -> bool {
        let (a, b) = ((self.low - origin) * inverse, (self.high - origin) * inverse);
        // A ray within a face of the box gives NaN there, which min and max of IEEE 754 leave out.
        let near = a.min(b).max_element().max(from);
        let far = a.max(b).min_element().min(to);
        near <= far || near.is_nan() || far.is_nan()
    }
}

/// Distance and weights of the corners where a ray meets a triangle from either side (Möller and Trumbore 1997).
fn intersect(&[a, b, c]: &[Vec3; 3], origin: Vec3, direction: Vec3) -> Option<(f32, Vec3)> {
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(ac);
    let scale = ab.dot(across);
    if scale == 0.0 {
        return None;
    }
    let to_origin = origin - a;
    let u = to_origin.dot(across) / scale;
    let other = to_origin.cross(ab);
    let v = direction.dot(other) / scale;
    let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
    inside.then(|| (ac.dot(other) / scale, Vec3::new(1.0 - u - v, u, v)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::rng::Rng;

    fn vector(rng: &mut Rng) -> Vec3 {
        Vec3::new(rng.between(-1.0, 1.0) as f32, rng.between(-1.0, 1.0) as f32, rng.between(-1.0, 1.0) as f32)
    }

    #[test]
    fn rays_find_what_trying_every_triangle_finds() {
        let mut rng = Rng::new(3);
        for count in [0, 1, 2, 5, 64, 300] {
            let triangles: Vec<[Vec3; 3]> = (0..count)
                .map(|_| {
                    let at = vector(&mut rng);
                    [at, at + 0.3 * vector(&mut rng), at + 0.3 * vector(&mut rng)]
                })
                .collect();
            let bvh = Bvh::new(&triangles);
            let mut met = 0;
            for round in 0..300 {
                let origin = 1.5 * vector(&mut rng);
                let direction = if round % 7 == 0 { Vec3::X } else { vector(&mut rng) };
                let naive = triangles
                    .iter()
                    .enumerate()
                    .filter_map(|(index, corners)| Some((index, intersect(corners, origin, direction)?.0)))
                    .filter(|&(_, distance)| distance > 0.0)
                    .min_by(|a, b| a.1.total_cmp(&b.1));
                let found = bvh.nearest(origin, direction, 0.0);
                met += usize::from(found.is_some());
                assert_eq!(found.map(|hit| (hit.triangle as usize, hit.distance)), naive);
                let limit = naive.map_or(9.0, |(_, distance)| distance);
                assert!(!bvh.blocks(origin, direction, 0.0..limit, |_| true));
                assert_eq!(bvh.blocks(origin, direction, 0.0..f32::INFINITY, |_| true), naive.is_some());
                assert!(!bvh.blocks(origin, direction, 0.0..f32::INFINITY, |_| false));
            }
            assert!(count < 64 || met > 15, "{count} triangles, {met} hits");
        }
    }
}
