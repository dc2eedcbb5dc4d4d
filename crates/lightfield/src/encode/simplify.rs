//! Meshes of fewer triangles: edges are collapsed in the order of the quadric error (Garland and Heckbert 1997), then vertices are
//! moved along their normals until the mesh lies as often outside of the first one as inside.
//!
//! The second step is for views: what a mesh does not cover is lost, and a mesh whose vertices lie on the surface is too small
//! wherever that is convex. Quadrics are weighted by area; open boundaries have planes of their own. A collapse is made only where it
//! joins no sheets (link condition) and turns no triangle over. O(triangles log triangles), and a ray for each of a few places on each
//! triangle.
//!
//! *Not done*: texture seams (there are none), a bound of the distance.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

use glam::{DMat3, DVec3, Vec3};
use texfold_core::CancelCheck;

use crate::Mesh;
use crate::bvh::Bvh;

/// Weight of planes along open boundaries, in weights of the surface's: less lets holes grow.
const BOUNDARY_WEIGHT: f64 = 10.0;
/// Pull of the edge's middle in shares of the quadric's trace: flat places have no best point.
const PULL: f64 = 1e-3;
/// Least cosine between the normals of a triangle before and after a collapse.
const LEAST_TURN: f64 = 0.2;
/// Rounds of moving vertices out and in: with fewer, spheres of 60 triangles lose 4 % of their volume.
const ROUNDS: usize = 12;
/// Parts of a triangle's side: in the middle of each part of it the distance from the first mesh is looked for.
const STEPS: u32 = 3;
/// How far they are looked for, in lengths of a triangle's longest side.
const REACH: f32 = 0.5;

/// Sum of squared distances from planes: x' a x + 2 b x + c.
#[derive(Debug, Clone, Copy)]
struct Quadric {
    a: DMat3,
    b: DVec3,
    c: f64,
}

impl Quadric {
    const NOTHING: Quadric = Quadric { a: DMat3::ZERO, b: DVec3::ZERO, c: 0.0 };

    fn plane(normal: DVec3, point: DVec3, weight: f64) -> Quadric {
        let offset = -normal.dot(point);
        let a = DMat3::from_cols(normal * normal.x, normal * normal.y, normal * normal.z);
        Quadric { a: a * weight, b: normal * (offset * weight), c: offset * offset * weight }
    }

    fn plus(self, other: Quadric) -> Quadric {
        Quadric { a: self.a + other.a, b: self.b + other.b, c: self.c + other.c }
    }

    fn error(&self, point: DVec3) -> f64 {
        (point.dot(self.a * point) + 2.0 * self.b.dot(point) + self.c).max(0.0)
    }

    /// The point of least error near `middle`.
    fn best(&self, middle: DVec3) -> DVec3 {
        let trace = self.a.x_axis.x + self.a.y_axis.y + self.a.z_axis.z;
        let pull = trace * PULL + f64::MIN_POSITIVE;
        let a = self.a + DMat3::from_diagonal(DVec3::splat(pull));
        let best = a.inverse() * (middle * pull - self.b);
        if best.is_finite() { best } else { middle }
    }
}

struct Collapser {
    positions: Vec<DVec3>,
    triangles: Vec<Option<[u32; 3]>>,
    around: Vec<BTreeSet<u32>>,
    quadrics: Vec<Quadric>,
    /// How often a vertex has changed: entries of the queue with older numbers are out of date.
    changes: Vec<u32>,
    queue: BinaryHeap<Reverse<Candidate>>,
    alive: usize,
}

/// An edge and what its collapse costs; ordered by cost, then by its vertices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Candidate {
    /// Bits of a number that is not negative: these are ordered as the numbers are.
    cost: u64,
    edge: (u32, u32),
    changes: (u32, u32),
}

/// The mesh with at most `triangles` triangles, or as few as can be reached; itself where it has no more.
#[must_use]
pub fn simplify_mesh(mesh: &Mesh, triangles: usize) -> Mesh {
    simplified_unless(mesh, triangles, CancelCheck::default())
}

/// As [`simplify_mesh`]; any mesh once the job is cancelled.
pub(super) fn simplified_unless(mesh: &Mesh, triangles: usize, cancel: CancelCheck<'_>) -> Mesh {
    let whole = mesh.welded();
    if whole.triangles.len() <= triangles || !whole.is_valid() {
        return whole;
    }
    let mut collapser = Collapser::new(&whole);
    collapser.run(triangles, cancel);
    let mut mesh = collapser.mesh();
    let bvh = Bvh::new(&whole.triangles.iter().map(|&triangle| whole.corners(triangle)).collect::<Vec<_>>());
    (0..ROUNDS).for_each(|_| centre(&mut mesh, &bvh, cancel));
    mesh
}

/// Moves every vertex along its normal by the mean distance of the places around it from the surface.
fn centre(mesh: &mut Mesh, surface: &Bvh, cancel: CancelCheck<'_>) {
    let normals = mesh.normals();
    let mut sums = vec![(0.0, 0.0); mesh.positions.len()];
    for &corners in mesh.triangles.iter().take_while(|_| !cancel.is_cancelled()) {
        let [a, b, c] = mesh.corners(corners);
        let weighted = (b - a).cross(c - a);
        let (area, normal) = (weighted.length(), weighted.normalize_or_zero());
        let reach = REACH * (b - a).length().max((c - b).length()).max((a - c).length());
        for hats in places() {
            let place = a * hats.x + b * hats.y + c * hats.z;
            let Some(distance) = surface.along(place, normal, reach) else { continue };
            for (corner, hat) in corners.into_iter().zip(hats.to_array()) {
                let sum = &mut sums[corner as usize];
                *sum = (sum.0 + distance * hat * area, sum.1 + hat * area);
            }
        }
    }
    for ((place, normal), (sum, weight)) in mesh.positions.iter_mut().zip(normals).zip(sums) {
        *place += normal * (sum / f32::max(weight, f32::MIN_POSITIVE));
    }
}

/// The middles of the parts that a triangle is cut into, as weights of its corners.
fn places() -> impl Iterator<Item = Vec3> {
    let cells = |shift: u32, end: u32| {
        (0..end).flat_map(move |i| (0..end - i).map(move |j| (3 * i + shift, 3 * j + shift)))
    };
    let weights = |(i, j): (u32, u32)| Vec3::new((3 * STEPS - i - j) as f32, i as f32, j as f32);
    cells(1, STEPS).chain(cells(2, STEPS - 1)).map(move |at| weights(at) / (3 * STEPS) as f32)
}

impl Bvh {
    /// How far along `direction`, a unit vector, the nearest surface is, within `reach` to both sides; negative behind.
    fn along(&self, place: Vec3, direction: Vec3, reach: f32) -> Option<f32> {
        let ahead = self.nearest(place, direction, 0.0).map(|hit| hit.distance);
        let behind = self.nearest(place, -direction, 0.0).map(|hit| -hit.distance);
        let within = [ahead, behind].into_iter().flatten().filter(|distance| distance.abs() <= reach);
        within.min_by(|a, b| a.abs().total_cmp(&b.abs()))
    }
}

impl Collapser {
    fn new(mesh: &Mesh) -> Collapser {
        let positions: Vec<DVec3> = mesh.positions.iter().map(|place| place.as_dvec3()).collect();
        let mut collapser = Collapser {
            around: vec![BTreeSet::new(); positions.len()],
            quadrics: vec![Quadric::NOTHING; positions.len()],
            changes: vec![0; positions.len()],
            triangles: mesh.triangles.iter().copied().map(Some).collect(),
            queue: BinaryHeap::new(),
            alive: mesh.triangles.len(),
            positions,
        };
        let mut edges: BTreeMap<(u32, u32), (u32, DVec3)> = BTreeMap::new();
        for (index, &corners) in (0..).zip(&mesh.triangles) {
            let normal = collapser.normal(corners);
            let area = normal.length();
            let plane =
                Quadric::plane(normal / area.max(f64::MIN_POSITIVE), collapser.place(corners[0]), area);
            for corner in 0..3 {
                let (v, next) = (corners[corner], corners[(corner + 1) % 3]);
                collapser.around[v as usize].insert(index);
                collapser.quadrics[v as usize] = collapser.quadrics[v as usize].plus(plane);
                edges.entry((v.min(next), v.max(next))).or_insert((0, normal)).0 += 1;
            }
        }
        for (&(a, b), &(_, normal)) in edges.iter().filter(|(_, found)| found.0 == 1) {
            let along = collapser.place(b) - collapser.place(a);
            let across = along.cross(normal).normalize_or_zero();
            let plane = Quadric::plane(across, collapser.place(a), along.length_squared() * BOUNDARY_WEIGHT);
            for v in [a, b] {
                collapser.quadrics[v as usize] = collapser.quadrics[v as usize].plus(plane);
            }
        }
        edges.keys().for_each(|&edge| collapser.push(edge));
        collapser
    }

    fn place(&self, vertex: u32) -> DVec3 {
        self.positions[vertex as usize]
    }

    fn normal(&self, corners: [u32; 3]) -> DVec3 {
        let [a, b, c] = corners.map(|vertex| self.place(vertex));
        (b - a).cross(c - a)
    }

    /// Where an edge collapses to, and at what cost.
    fn target(&self, (a, b): (u32, u32)) -> (DVec3, f64) {
        let quadric = self.quadrics[a as usize].plus(self.quadrics[b as usize]);
        let best = quadric.best((self.place(a) + self.place(b)) * 0.5);
        (best, quadric.error(best))
    }

    fn push(&mut self, (a, b): (u32, u32)) {
        let edge = (a.min(b), a.max(b));
        let (_, cost) = self.target(edge);
        if cost.is_finite() {
            let changes = (self.changes[edge.0 as usize], self.changes[edge.1 as usize]);
            self.queue.push(Reverse(Candidate { cost: cost.to_bits(), edge, changes }));
        }
    }

    fn run(&mut self, triangles: usize, cancel: CancelCheck<'_>) {
        while self.alive > triangles && !cancel.is_cancelled() {
            let Some(Reverse(candidate)) = self.queue.pop() else { return };
            let (a, b) = candidate.edge;
            if candidate.changes == (self.changes[a as usize], self.changes[b as usize]) {
                self.collapse(a, b);
            }
        }
    }

    fn neighbours(&self, vertex: u32) -> BTreeSet<u32> {
        let corners = self.around[vertex as usize].iter().filter_map(|&t| self.triangles[t as usize]);
        corners.flatten().filter(|&other| other != vertex).collect()
    }

    /// Whether an open boundary runs through a vertex.
    fn is_open(&self, vertex: u32) -> bool {
        self.neighbours(vertex).iter().any(|&other| self.shared(vertex, other).count() == 1)
    }

    fn shared(&self, a: u32, b: u32) -> impl Iterator<Item = u32> {
        self.around[a as usize].intersection(&self.around[b as usize]).copied()
    }

    /// Collapses an edge where that joins no sheets and turns no triangle over.
    fn collapse(&mut self, a: u32, b: u32) {
        let gone: Vec<u32> = self.shared(a, b).collect();
        let common = self.neighbours(a).intersection(&self.neighbours(b)).count();
        let inner = gone.len() == 2;
        if gone.is_empty()
            || gone.len() > 2
            || common != gone.len()
            || inner && self.is_open(a) && self.is_open(b)
        {
            return;
        }
        let (place, _) = self.target((a, b));
        let stays =
            |v: u32| self.around[v as usize].iter().filter(|t| !gone.contains(t)).map(move |&t| (v, t));
        for (vertex, triangle) in stays(a).chain(stays(b)) {
            let Some(corners) = self.triangles[triangle as usize] else { continue };
            let [p, q, r] = corners.map(|v| if v == vertex { place } else { self.place(v) });
            let (before, after) = (self.normal(corners), (q - p).cross(r - p));
            if before.dot(after) <= LEAST_TURN * before.length() * after.length() {
                return;
            }
        }
        self.positions[a as usize] = place;
        self.quadrics[a as usize] = self.quadrics[a as usize].plus(self.quadrics[b as usize]);
        for &triangle in &gone {
            for vertex in self.triangles[triangle as usize].take().into_iter().flatten() {
                self.around[vertex as usize].remove(&triangle);
            }
        }
        self.alive -= gone.len();
        for triangle in std::mem::take(&mut self.around[b as usize]) {
            if let Some(corners) = &mut self.triangles[triangle as usize] {
                corners.iter_mut().filter(|corner| **corner == b).for_each(|corner| *corner = a);
                self.around[a as usize].insert(triangle);
            }
        }
        self.changes[a as usize] += 1;
        self.changes[b as usize] += 1;
        for other in self.neighbours(a) {
            self.push((a, other));
        }
    }

    /// What is left, vertices without triangles left out.
    fn mesh(&self) -> Mesh {
        let mut numbers = BTreeMap::new();
        let mut mesh = Mesh::default();
        for corners in self.triangles.iter().flatten() {
            let triangle = corners.map(|vertex| {
                *numbers.entry(vertex).or_insert_with(|| {
                    mesh.positions.push(self.place(vertex).as_vec3());
                    mesh.positions.len() as u32 - 1
                })
            });
            mesh.triangles.push(triangle);
        }
        mesh
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A closed sphere of `rings` x `2 rings` quadrangles.
    fn sphere(rings: u32) -> Mesh {
        let mut mesh = Mesh::default();
        let columns = 2 * rings;
        for (i, j) in (0..=rings).flat_map(|i| (0..columns).map(move |j| (i, j))) {
            let (polar, around) = (
                std::f32::consts::PI * i as f32 / rings as f32,
                std::f32::consts::TAU * j as f32 / columns as f32,
            );
            let radius = if i % rings == 0 { 0.0 } else { polar.sin() };
            let (x, y) =
                if radius == 0.0 { (0.0, 0.0) } else { (radius * around.cos(), radius * around.sin()) };
            mesh.positions.push(Vec3::new(
                x,
                y,
                if radius == 0.0 { 1.0 - 2.0 * (i / rings) as f32 } else { polar.cos() },
            ));
        }
        for (i, j) in (0..rings).flat_map(|i| (0..columns).map(move |j| (i, j))) {
            let at = |i: u32, j: u32| i * columns + j % columns;
            mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
        mesh.welded()
    }

    fn volume(mesh: &Mesh) -> f32 {
        let of = |&triangle: &[u32; 3]| {
            let [a, b, c] = mesh.corners(triangle);
            a.dot(b.cross(c)) / 6.0
        };
        mesh.triangles.iter().map(of).sum()
    }

    fn edges(mesh: &Mesh) -> BTreeMap<(u32, u32), u32> {
        let mut edges = BTreeMap::new();
        for [a, b, c] in &mesh.triangles {
            for (p, q) in [(a, b), (b, c), (c, a)] {
                *edges.entry((*p.min(q), *p.max(q))).or_insert(0) += 1;
            }
        }
        edges
    }

    #[test]
    fn a_simplified_sphere_is_closed_and_as_large_as_before() {
        let whole = sphere(24);
        for count in [600, 200, 60] {
            let mesh = simplify_mesh(&whole, count);
            assert!(
                mesh.triangles.len() <= count && mesh.triangles.len() + 2 > count,
                "{}",
                mesh.triangles.len()
            );
            assert!(edges(&mesh).values().all(|&triangles| triangles == 2));
            let (found, wanted) = (volume(&mesh), volume(&whole));
            assert!((found / wanted - 1.0).abs() < 0.03, "{count}: {found} of {wanted}");
        }
        assert_eq!(simplify_mesh(&whole, 100_000), whole);
    }

    #[test]
    fn open_boundaries_and_odd_edges_stay() {
        let mut open = sphere(16);
        open.triangles.retain(|&corners| open.positions[corners[0] as usize].z > 0.0);
        let mesh = simplify_mesh(&open, 100);
        assert!(mesh.triangles.len() <= 100);
        let rim = |mesh: &Mesh| {
            let lowest = mesh.positions.iter().map(|place| place.z).fold(f32::INFINITY, f32::min);
            let count = edges(mesh).values().filter(|&&triangles| triangles == 1).count();
            (lowest, count)
        };
        assert!(rim(&mesh).0.abs() < 0.02 && rim(&mesh).1 > 5, "{:?}", rim(&mesh));
        // An edge of three triangles is no reason to fail.
        let mut odd = sphere(8);
        let [a, b, _] = odd.triangles[9];
        odd.positions.push(Vec3::splat(2.0));
        odd.triangles.push([a, b, odd.positions.len() as u32 - 1]);
        assert!(simplify_mesh(&odd, 60).triangles.len() <= 60);
        assert!(simplify_mesh(&odd, 0).is_valid());
    }
}
