//! Where the surface is sampled: lattices on triangles whose places on edges and at vertices are shared.
//!
//! A patch has a power of two of steps along a side (paper section 5.2: predefined sizes), chosen by the largest view
//! of its triangle. Samples belong to *elements*: vertices, edges and faces. Triangles that meet at an edge read the same
//! samples there; where their sides differ the edge has the coarser one's, and the finer triangle interpolates, so
//! the maps agree along the whole edge.

use std::collections::BTreeMap;

use glam::Vec3;
use rayon::prelude::*;
use texfold_core::CancelCheck;

use crate::bvh::Bvh;
use crate::layout::MAX_SIDE_LOG2;
use crate::{Mesh, Photograph};

/// A vertex, an edge or the inside of a triangle.
#[derive(Debug, Clone)]
pub(crate) struct Element {
    /// Its vertices: one, two or three.
    pub(crate) vertices: Vec<u32>,
    /// Triangles that it belongs to.
    pub(crate) triangles: Vec<u32>,
    /// Number of its first sample.
    pub(crate) first: u32,
    /// Weights of its vertices, one entry a sample.
    pub(crate) weights: Vec<Vec3>,
}

/// Texels of a patch among the samples of its triangle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lattice {
    /// Steps from sample to sample for one from texel to texel.
    pub(crate) stride: u32,
    /// Steps from texel to texel along the patch's side.
    pub(crate) steps: u32,
}

/// What a texel is blended from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Blend {
    pub(crate) samples: [u32; 2],
    /// Weight of the second, 0 to 1.
    pub(crate) part: f32,
}

impl Blend {
    fn of(sample: u32) -> Blend {
        Blend { samples: [sample; 2], part: 0.0 }
    }
}

/// All samples of a mesh.
#[derive(Debug, Clone)]
pub(crate) struct Surface {
    /// Vertices first, then edges, then faces.
    pub(crate) elements: Vec<Element>,
    /// For each vertex the elements that its hat function covers, in order.
    pub(crate) around: Vec<Vec<u32>>,
    /// For each triangle its edges' elements: from corner 0 to 1, 1 to 2, 2 to 0.
    edges: Vec<[u32; 3]>,
    /// Element of the first triangle.
    first_face: u32,
    /// Samples of all elements.
    pub(crate) samples: u32,
}

/// As many steps along the sides of each triangle as its largest view resolves; of no use once the job is cancelled.
pub(crate) fn resolved(mesh: &Mesh, views: &[Photograph], bvh: &Bvh, cancel: CancelCheck<'_>) -> Vec<f32> {
    let cameras: Vec<_> = views.iter().map(|view| (view.camera, view.camera.to_camera())).collect();
    let largest = |(index, &triangle): (usize, &[u32; 3])| {
        let corners = mesh.corners(triangle);
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        let mut area = 0f32;
        for (camera, to_camera) in cameras.iter().filter(|_| !cancel.is_cancelled()) {
            let places = corners.map(|corner| camera.project(to_camera.transform_point3(corner)));
            let [Some(a), Some(b), Some(c)] = places else { continue };
            // Counter-clockwise from the front is clockwise with rows that run down.
            let doubled = -(b - a).perp_dot(c - a);
            let to_eye = camera.eye() - middle;
            if doubled > area && !bvh.blocks(middle, to_eye, 0.0..1.0, |other| other as usize != index) {
                area = doubled;
            }
        }
        // n steps along the sides cut a triangle into n * n parts of two a pixel's area.
        area.sqrt()
    };
    mesh.triangles.par_iter().enumerate().map(largest).collect()
}

/// The steps along the sides of each triangle's patch: a power of two, at most `sampling` times those that are resolved.
pub(crate) fn sides_log2(resolved: &[f32], sampling: f32) -> Vec<u8> {
    let log2 = |&steps: &f32| (steps * sampling).max(1.0).log2().floor().min(f32::from(MAX_SIDE_LOG2)) as u8;
    resolved.iter().map(log2).collect()
}

impl Surface {
    /// The samples of `mesh` with patches of the given sides.
    pub(crate) fn new(mesh: &Mesh, sides_log2: &[u8]) -> Surface {
        let vertices = mesh.positions.len() as u32;
        let alone = |vertex| Element {
            vertices: vec![vertex],
            triangles: Vec::new(),
            first: 0,
            weights: vec![Vec3::X],
        };
        let mut surface = Surface {
            elements: (0..vertices).map(alone).collect(),
            around: vec![Vec::new(); vertices as usize],
            edges: Vec::new(),
            first_face: 0,
            samples: 0,
        };
        surface.add_edges(mesh, sides_log2);
        surface.first_face = surface.elements.len() as u32;
        for (triangle, (&corners, &log2)) in (0..).zip(mesh.triangles.iter().zip(sides_log2)) {
            let n = 1u32 << log2;
            let inside = (1..n).flat_map(|j| (1..n.saturating_sub(j)).map(move |i| (i, j)));
            let weights = inside.map(|(i, j)| Vec3::new((n - i - j) as f32, i as f32, j as f32) / n as f32);
            surface.elements.push(Element {
                vertices: corners.to_vec(),
                triangles: vec![triangle],
                first: 0,
                weights: weights.collect(),
            });
            corners.iter().for_each(|&v| surface.elements[v as usize].triangles.push(triangle));
        }
        for (index, element) in (0..).zip(&mut surface.elements) {
            element.first = surface.samples;
            surface.samples += element.weights.len() as u32;
            if !element.weights.is_empty() {
                element.vertices.iter().for_each(|&v| surface.around[v as usize].push(index));
            }
        }
        surface
    }

    /// How many samples the hat function of a vertex covers.
    pub(crate) fn rows(&self, vertex: u32) -> usize {
        let elements = self.around[vertex as usize].iter();
        elements.map(|&element| self.elements[element as usize].weights.len()).sum()
    }

    fn add_edges(&mut self, mesh: &Mesh, sides_log2: &[u8]) {
        let mut known: BTreeMap<(u32, u32), (u8, Vec<u32>)> = BTreeMap::new();
        for (triangle, (&corners, &log2)) in (0..).zip(mesh.triangles.iter().zip(sides_log2)) {
            for key in edges_of(corners) {
                let (least, triangles) = known.entry(key).or_insert((log2, Vec::new()));
                *least = log2.min(*least);
                triangles.push(triangle);
            }
        }
        let mut numbers = BTreeMap::new();
        for (key, (log2, triangles)) in known {
            numbers.insert(key, self.elements.len() as u32);
            let n = 1u32 << log2;
            let weights = (1..n).map(|i| Vec3::new((n - i) as f32, i as f32, 0.0) / n as f32).collect();
            self.elements.push(Element { vertices: vec![key.0, key.1], triangles, first: 0, weights });
        }
        let number = |key| numbers.get(&key).copied().unwrap_or(0);
        self.edges = mesh.triangles.iter().map(|&corners| edges_of(corners).map(number)).collect();
    }

    /// What texel (i, j) of a triangle's patch is blended from.
    pub(crate) fn texel(&self, mesh: &Mesh, triangle: u32, lattice: Lattice, (i, j): (u32, u32)) -> Blend {
        let Lattice { stride, steps } = lattice;
        let corners = mesh.triangles[triangle as usize];
        let k = steps - i - j;
        let vertex = |corner: usize| self.elements[corners[corner] as usize].first;
        let edge = |number: usize, at| {
            let reversed = corners[number] > corners[(number + 1) % 3];
            let at = if reversed { steps - at } else { at };
            self.on_edge(self.edges[triangle as usize][number], lattice, at)
        };
        match (k, i, j) {
            (k, ..) if k == steps => Blend::of(vertex(0)),
            (_, i, _) if i == steps => Blend::of(vertex(1)),
            (_, _, j) if j == steps => Blend::of(vertex(2)),
            (_, i, 0) => edge(0, i),
            (0, _, j) => edge(1, j),
            (k, 0, _) => edge(2, k),
            (_, i, j) => {
                let (i, j, n) = (i * stride, j * stride, steps * stride);
                // Rows before this one have n - 2, n - 3, ... samples.
                let before = (1..j).map(|row| n - row - 1).sum::<u32>();
                Blend::of(self.elements[(self.first_face + triangle) as usize].first + before + i - 1)
            }
        }
    }

    /// The samples around step `at` of the element of an edge, counted from its first vertex. Patches at both sides read the same samples:
    /// those in strides of the lattice, or the ends alone.
    fn on_edge(&self, element: u32, lattice: Lattice, at: u32) -> Blend {
        let element = &self.elements[element as usize];
        let fine = element.weights.len() as u32 + 1;
        let stride = lattice.stride.min(fine);
        let steps = fine / stride;
        let (low, part) = (at * steps / lattice.steps, at * steps % lattice.steps);
        let sample = |step: u32| match step * stride {
            0 => self.elements[element.vertices[0] as usize].first,
            at if at == fine => self.elements[element.vertices[1] as usize].first,
            at => element.first + at - 1,
        };
        Blend {
            samples: [sample(low), sample((low + 1).min(steps))],
            part: part as f32 / lattice.steps as f32,
        }
    }
}

/// The edges of a triangle as pairs of vertices, the lower first.
fn edges_of([a, b, c]: [u32; 3]) -> [(u32, u32); 3] {
    [(a, b), (b, c), (c, a)].map(|(a, b)| (a.min(b), a.max(b)))
}

impl Element {
    /// The place of a sample.
    pub(crate) fn position(&self, mesh: &Mesh, sample: usize) -> Vec3 {
        self.blend(&mesh.positions, sample)
    }

    /// The smooth unit normal at a sample; as the shader has it, short where normals cancel out.
    pub(crate) fn normal(&self, normals: &[Vec3], sample: usize) -> Vec3 {
        let normal = self.blend(normals, sample);
        normal / normal.length().max(1e-6)
    }

    /// The value of a vertex's hat function at a sample; 0 where the vertex is none of the element's.
    pub(crate) fn hat(&self, vertex: u32, sample: usize) -> f32 {
        let corner = self.vertices.iter().position(|&own| own == vertex);
        corner.map_or(0.0, |corner| self.weights[sample][corner])
    }

    fn blend(&self, values: &[Vec3], sample: usize) -> Vec3 {
        let weights = self.weights[sample];
        let corners = self.vertices.iter().enumerate();
        corners.map(|(corner, &vertex)| values[vertex as usize] * weights[corner]).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip of triangles over the unit square, with one of them turned over its first edge.
    fn mesh() -> Mesh {
        let p = |x, y| Vec3::new(x, y, 0.3 * x * y);
        Mesh {
            positions: vec![p(0.0, 0.0), p(1.0, 0.0), p(1.0, 1.0), p(0.0, 1.0), p(0.5, -1.0)],
            triangles: vec![[0, 1, 2], [2, 3, 0], [1, 0, 4]],
        }
    }

    #[test]
    fn every_texel_lies_where_its_samples_do() {
        let mesh = mesh();
        for sides in [[3, 3, 3], [0, 2, 4], [5, 1, 0], [1, 1, 2]] {
            let surface = Surface::new(&mesh, &sides);
            let mut places = vec![Vec3::NAN; surface.samples as usize];
            for element in &surface.elements {
                for sample in 0..element.weights.len() {
                    places[element.first as usize + sample] = element.position(&mesh, sample);
                    let hats: f32 = (0..5).map(|vertex| element.hat(vertex, sample)).sum();
                    assert!((hats - 1.0).abs() < 1e-6);
                }
            }
            for (triangle, &log2) in sides.iter().enumerate() {
                let n = 1u32 << log2;
                let [a, b, c] = mesh.corners(mesh.triangles[triangle]);
                for (i, j) in (0..=n).flat_map(|i| (0..=n - i).map(move |j| (i, j))) {
                    let lattice = Lattice { stride: 1, steps: n };
                    let Blend { samples: [low, high], part } =
                        surface.texel(&mesh, triangle as u32, lattice, (i, j));
                    let place = places[low as usize].lerp(places[high as usize], part);
                    let wanted = a + (b - a) * (i as f32 / n as f32) + (c - a) * (j as f32 / n as f32);
                    assert!(
                        place.distance(wanted) < 1e-5,
                        "{sides:?} {triangle} ({i}, {j}): {place} {wanted}"
                    );
                }
            }
        }
    }

    #[test]
    fn coarse_patches_agree_along_shared_edges() {
        let mesh = mesh();
        for (sides, halvings) in [([3, 3, 3], 1), ([0, 2, 4], 1), ([5, 1, 0], 2), ([3, 4, 2], 3)] {
            let surface = Surface::new(&mesh, &sides);
            // A value for each sample that no line runs through.
            let value = |sample: u32| ((sample * sample) % 97) as f32;
            let on_edge = |triangle: u32, ends: [u32; 2], part: f32| {
                let log2: u8 = sides[triangle as usize];
                let steps = 1u32 << log2.saturating_sub(halvings);
                let corners = mesh.triangles[triangle as usize];
                let at = |node: u32| {
                    let mut weights = [0; 3];
                    for (end, weight) in ends.into_iter().zip([steps - node, node]) {
                        weights[corners.iter().position(|&corner| corner == end).unwrap()] = weight;
                    }
                    let lattice = Lattice { stride: (1 << log2) / steps, steps };
                    let Blend { samples: [low, high], part } =
                        surface.texel(&mesh, triangle, lattice, (weights[1], weights[2]));
                    value(low) * (1.0 - part) + value(high) * part
                };
                let place = part * steps as f32;
                let low = (place as u32).min(steps - 1);
                at(low) * (1.0 - place + low as f32) + at(low + 1) * (place - low as f32)
            };
            for (first, second, ends) in [(0, 1, [2, 0]), (0, 2, [0, 1])] {
                for step in 0..=64 {
                    let part = step as f32 / 64.0;
                    let (a, b) = (on_edge(first, ends, part), on_edge(second, ends, part));
                    assert!((a - b).abs() < 1e-3, "{sides:?} {ends:?} at {part}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn rings_hold_all_samples_with_a_hat() {
        let mesh = mesh();
        let surface = Surface::new(&mesh, &[2, 2, 2]);
        for vertex in 0..5u32 {
            let naive: Vec<u32> = (0..surface.elements.len() as u32)
                .filter(|&e| {
                    surface.elements[e as usize]
                        .weights
                        .iter()
                        .enumerate()
                        .any(|(s, _)| surface.elements[e as usize].hat(vertex, s) > 0.0)
                })
                .collect();
            assert_eq!(surface.around[vertex as usize], naive);
        }
    }
}
