//! Triangles and vertices in an order that takes few bytes: each triangle beside the one before where there is such a one, vertices
//! as they come, so that most differences of indices are small and places of neighbours stand together. O(triangles log triangles).
//!
//! *Not done*: codes for the shape of the walk itself (Touma and Gotsman 1998), which take fewer bytes
//! but are no plain list of indices.

use std::collections::BTreeMap;

use glam::Vec3;

use crate::Mesh;

/// Steps of the lattice of places across a mesh: a twentieth of a pixel of photographs of 400.
const LATTICE: f64 = 8192.0;
/// And along an edge of mean length, so that triangles of fine meshes keep their shape.
const EDGE_STEPS: f64 = 64.0;

/// Meshes are often scaled to a size of 1 or 2: the step is to be the same where rounding leaves such a size a little short.
const ROUNDED_SIZE: f64 = 1.0 + 1.0 / 1024.0;

/// Stands for a vertex without a number.
const NONE: u32 = u32::MAX;

/// With places on a lattice, so that they take half of the bytes: a power of two of at most [`LATTICE`] parts of its size
/// and [`EDGE_STEPS`] of its edges' mean length.
pub(crate) fn snapped(mesh: &Mesh) -> Mesh {
    let low = mesh.positions.iter().fold(Vec3::INFINITY, |low, &place| low.min(place));
    let high = mesh.positions.iter().fold(Vec3::NEG_INFINITY, |high, &place| high.max(place));
    let edges = mesh.triangles.iter().map(|&triangle| {
        let [a, b, c] = mesh.corners(triangle);
        f64::from(a.distance(b) + b.distance(c) + c.distance(a))
    });
    let edge = edges.sum::<f64>() / (3 * mesh.triangles.len()).max(1) as f64;
    let step = f64::min(f64::from((high - low).max_element()) / LATTICE, edge / EDGE_STEPS);
    let step = (step * ROUNDED_SIZE).log2().floor().exp2() as f32;
    if !step.is_normal() {
        return mesh.clone();
    }
    let snap = |place: &Vec3| (*place / step).round() * step;
    let is_exact = |place: &Vec3| (*place / step).is_finite();
    if !mesh.positions.iter().all(is_exact) {
        return mesh.clone();
    }
    Mesh { positions: mesh.positions.iter().map(snap).collect(), triangles: mesh.triangles.clone() }
}

/// The same triangles in such an order; vertices of none go.
pub(crate) fn walked(mesh: &Mesh) -> Mesh {
    let mut beside: BTreeMap<(u32, u32), Vec<u32>> = BTreeMap::new();
    for (number, &triangle) in (0..).zip(&mesh.triangles) {
        edges(triangle).into_iter().for_each(|edge| beside.entry(key(edge)).or_default().push(number));
    }
    let mut is_done = vec![false; mesh.triangles.len()];
    let mut walked = Mesh::default();
    let mut numbers = vec![NONE; mesh.positions.len()];
    let mut next_seed = 0;
    // Edges that were passed by, the last on top.
    let mut open: Vec<(u32, u32)> = Vec::new();
    loop {
        let across = open.pop().map(|edge| (edge, beside.get(&key(edge))));
        let found = across.and_then(|(edge, sides)| {
            let side = sides?.iter().copied().find(|&side| !is_done[side as usize])?;
            Some((side, edge))
        });
        if found.is_none() && !open.is_empty() {
            continue;
        }
        let (number, triangle) = match found {
            Some((number, edge)) => (number, turned(mesh.triangles[number as usize], edge)),
            None => match (next_seed..mesh.triangles.len()).find(|&seed| !is_done[seed]) {
                Some(seed) => (seed as u32, mesh.triangles[seed]),
                None => return walked,
            },
        };
        next_seed += usize::from(found.is_none());
        is_done[number as usize] = true;
        walked.triangles.push(triangle.map(|vertex| {
            let number = &mut numbers[vertex as usize];
            if *number == NONE {
                *number = walked.positions.len() as u32;
                walked.positions.push(mesh.positions[vertex as usize]);
            }
            *number
        }));
        let [a, b, c] = triangle;
        open.extend([(a, b), (c, a), (b, c)]);
    }
}

fn edges([a, b, c]: [u32; 3]) -> [(u32, u32); 3] {
    [(a, b), (b, c), (c, a)]
}

fn key((a, b): (u32, u32)) -> (u32, u32) {
    (a.min(b), a.max(b))
}

/// A triangle with the corners of `edge` first.
fn turned([a, b, c]: [u32; 3], edge: (u32, u32)) -> [u32; 3] {
    let turns = [[a, b, c], [b, c, a], [c, a, b]];
    turns.into_iter().find(|&[first, second, _]| key((first, second)) == key(edge)).unwrap_or([a, b, c])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_size_that_rounding_leaves_a_little_short_has_the_same_lattice() {
        let mesh = |size: f32| Mesh {
            positions: vec![Vec3::ZERO, Vec3::new(size, 0.0, 0.0), Vec3::new(0.0, 0.333, 0.0)],
            triangles: vec![[0, 1, 2]],
        };
        for size in [1.0f32, 2.0, 64.0] {
            let short = size * (1.0 - 1e-7);
            assert!(short < size);
            assert_eq!(snapped(&mesh(short)), snapped(&mesh(size)), "{size}");
        }
    }

    #[test]
    fn a_walk_keeps_triangles_and_their_sides_and_goes_to_neighbours() {
        let side = 9;
        let place = |at: u32| Vec3::new((at % side) as f32, (at / side) as f32, 0.5);
        let mut mesh = Mesh { positions: (0..side * side + 3).map(place).collect(), triangles: Vec::new() };
        for at in (0..side * (side - 1)).filter(|at| at % side + 1 < side) {
            // In an order that jumps about.
            let at = at * 5 % (side * (side - 1));
            if at % side + 1 < side {
                mesh.triangles.extend([[at, at + 1, at + side], [at + 1, at + side + 1, at + side]]);
            }
        }
        let walked = walked(&mesh);
        let sorted = |mesh: &Mesh| {
            let least_first = |&triangle: &[u32; 3]| {
                let corners = mesh.corners(triangle).map(|place| place.to_array().map(f32::to_bits));
                let [a, b, c] = corners;
                [[a, b, c], [b, c, a], [c, a, b]].into_iter().min()
            };
            let mut all: Vec<_> = mesh.triangles.iter().map(least_first).collect();
            all.sort();
            all
        };
        assert_eq!(sorted(&walked), sorted(&mesh));
        let mut used = mesh.triangles.as_flattened().to_vec();
        used.sort_unstable();
        used.dedup();
        assert_eq!(walked.positions.len(), used.len());
        let meets = |pair: &&[[u32; 3]]| pair[0].iter().any(|vertex| pair[1].contains(vertex));
        let neighbours = walked.triangles.windows(2).filter(meets).count();
        assert!(neighbours * 10 > walked.triangles.len() * 8, "{neighbours} of {}", walked.triangles.len());
    }
}
