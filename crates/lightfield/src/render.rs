//! The CPU reference of a rendered view: one ray a pixel, from its middle.

use glam::{Vec2, Vec3};
use texfold_core::image::to_u8;
use texfold_core::{Encoded, LightAddress, parallel};

use crate::bvh::Bvh;
use crate::{Camera, LightTexture};

/// Draws a light field from any side.
#[derive(Debug)]
pub struct Renderer<'t> {
    texture: &'t LightTexture,
    bvh: Bvh,
}

impl<'t> Renderer<'t> {
    /// Prepares the mesh.
    #[must_use]
    pub fn new(texture: &'t LightTexture) -> Renderer<'t> {
        let mesh = texture.mesh();
        let corners: Vec<_> = mesh.triangles.iter().map(|&triangle| mesh.corners(triangle)).collect();
        Renderer { texture, bvh: Bvh::new(&corners) }
    }

    /// What `camera` sees, row by row, on transparent black; nearest triangle in front, both sides of a triangle alike.
    #[must_use]
    pub fn render(&self, camera: &Camera) -> Vec<[u8; 4]> {
        let width = camera.width as usize;
        let mut pixels = vec![[0; 4]; width * camera.height as usize];
        parallel::for_each_row(&mut pixels, width, |row, line| self.row(camera, row, line));
        pixels
    }

    /// One row of what `camera` sees.
    pub(crate) fn row(&self, camera: &Camera, row: usize, line: &mut [[u8; 4]]) {
        for (column, pixel) in line.iter_mut().enumerate() {
            *pixel = self.pixel(camera, Vec2::new(column as f32, row as f32) + 0.5);
        }
    }

    /// What a ray meets first: how far in lengths of `direction`, and where.
    #[must_use]
    pub fn meet(&self, origin: Vec3, direction: Vec3) -> Option<(f32, LightAddress)> {
        let hit = self.bvh.nearest(origin, direction, 0.0)?;
        let address =
            LightAddress { triangle: hit.triangle, barycentric: hit.barycentric, direction: -direction };
        Some((hit.distance, address))
    }

    fn pixel(&self, camera: &Camera, place: Vec2) -> [u8; 4] {
        let ray = camera.ray(place);
        self.meet(camera.eye(), ray)
            .map_or([0; 4], |(_, address)| self.texture.texel(address).to_array().map(to_u8))
    }
}
