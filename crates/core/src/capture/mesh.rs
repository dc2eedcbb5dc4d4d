//! Triangle meshes without texture coordinates.

use glam::Vec3;

use super::Camera;

/// A triangle mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Places of the vertices.
    pub positions: Vec<Vec3>,
    /// Three vertices each, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Whether every index names a vertex and all numbers are finite.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let vertices = self.positions.len();
        self.positions.iter().all(|position| position.is_finite())
            && self.triangles.iter().flatten().all(|&index| (index as usize) < vertices)
    }

    /// The mesh with vertices at one place joined, in the order of their first, and without triangles of no area.
    #[must_use]
    pub fn welded(&self) -> Mesh {
        let mut known = std::collections::HashMap::new();
        let mut welded = Mesh::default();
        let mut joined = Vec::new();
        for &position in &self.positions {
            // -0 and 0 are one place.
            let key = (position + Vec3::ZERO).to_array().map(f32::to_bits);
            joined.push(*known.entry(key).or_insert_with(|| {
                welded.positions.push(position);
                welded.positions.len() as u32 - 1
            }));
        }
        let triangles = self.triangles.iter().map(|triangle| triangle.map(|index| joined[index as usize]));
        welded.triangles = triangles.filter(|&triangle| welded.doubled_area(triangle) > 0.0).collect();
        welded
    }

    /// The corners of a triangle.
    #[must_use]
    pub fn corners(&self, triangle: [u32; 3]) -> [Vec3; 3] {
        triangle.map(|index| self.positions[index as usize])
    }

    /// Twice the area of a triangle; 0 where it has none or the number is not finite.
    fn doubled_area(&self, triangle: [u32; 3]) -> f32 {
        let [a, b, c] = self.corners(triangle);
        let area = (b - a).cross(c - a).length();
        if area.is_finite() { area } else { 0.0 }
    }

    /// Distances along a camera's axis between which all of the mesh in front of it lies, for a depth buffer.
    #[must_use]
    pub fn depths(&self, camera: &Camera) -> (f32, f32) {
        // Nearer than this share of the farthest, depths of 32-bit floats would run together.
        const LEAST_SHARE: f32 = 1e-4;
        let to_camera = camera.to_camera();
        let depths = self.positions.iter().map(|&position| -to_camera.transform_point3(position).z);
        let (low, high) =
            depths.fold((f32::INFINITY, 0f32), |(low, high), depth| (low.min(depth), high.max(depth)));
        let far = if high > 0.0 && high.is_finite() { high * 1.01 } else { 1.0 };
        ((0.99 * low).clamp(far * LEAST_SHARE, 0.99 * far), far)
    }

    /// Unit normals of the vertices: those of the triangles around, weighted by area; +z where there are none.
    #[must_use]
    pub fn normals(&self) -> Vec<Vec3> {
        let mut normals = vec![Vec3::ZERO; self.positions.len()];
        for &triangle in &self.triangles {
            let [a, b, c] = self.corners(triangle);
            let normal = (b - a).cross(c - a);
            if normal.is_finite() {
                triangle.iter().for_each(|&index| normals[index as usize] += normal);
            }
        }
        normals.into_iter().map(|normal| normal.try_normalize().unwrap_or(Vec3::Z)).collect()
    }
}
