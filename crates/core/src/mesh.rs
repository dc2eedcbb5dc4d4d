//! Triangle meshes with texture coordinates, as far as codecs need them.

use glam::{Vec2, Vec3};

/// A triangle mesh whose every corner has a texture coordinate.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct UvMesh {
    /// Positions of the corners, in the mesh's unit of length.
    pub positions: Vec<Vec3>,
    /// Texture coordinates of the same corners; (0, 0) is the top left of the image.
    pub uvs: Vec<Vec2>,
    /// Three corner indices a triangle, each below the number of positions.
    pub triangles: Vec<[u32; 3]>,
}

impl UvMesh {
    /// Whether every index names a corner with position and coordinate, and all numbers are finite.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.positions.len() == self.uvs.len()
            && self.positions.iter().all(|p| p.is_finite())
            && self.uvs.iter().all(|uv| uv.is_finite())
            && self.triangles.iter().flatten().all(|&i| (i as usize) < self.positions.len())
    }
}
