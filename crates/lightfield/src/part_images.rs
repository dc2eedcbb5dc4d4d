//! Images of a light field's parts.

use glam::{Mat4, Vec2, Vec3};
use texfold_core::image::Raster;
use texfold_core::{Encoded, SourceError, Texel};

use crate::parts::{Atlas, PIXEL};
use crate::{Camera, LightTexture, Renderer};

/// Pixels a side of the drawn mesh.
const SIDE: u32 = 384;

impl LightTexture {
    /// Images of the parts by name: the mean's atlas, those of the maps as they are stored, and the number of terms of each vertex on the mesh,
    /// from two sides: black for none, white for all.
    ///
    /// # Errors
    /// None for light fields that loaded.
    pub fn part_images(&self) -> Result<Vec<(&'static str, Raster)>, SourceError> {
        let mut images = Vec::new();
        let parts = &self.parts;
        let layout = parts.layout();
        for (name, atlas) in
            [("mean", Atlas::Mean), ("surface-maps", Atlas::Surface), ("view-maps", Atlas::View)]
        {
            let (width, height) = parts.size_of(&layout, atlas);
            images.push((name, Raster::from_texels(width, height, PIXEL, &parts.texels(atlas))?));
        }
        let drawn = self.drawn_terms();
        images.push(("terms", Raster::from_texels(2 * SIDE, SIDE, PIXEL, &drawn)?));
        Ok(images)
    }

    /// The number of terms of the vertices, blended over the triangles, seen along -z and along z.
    fn drawn_terms(&self) -> Vec<Texel> {
        let terms = self.layout().terms.max(1) as f32;
        let shares: Vec<f32> = self.terms_of_vertices().into_iter().map(|used| used as f32 / terms).collect();
        let renderer = Renderer::new(self);
        let cameras = [false, true].map(|behind| self.overview(behind));
        let pixel = |index: u32| {
            let (x, y) = (index % (2 * SIDE), index / (2 * SIDE));
            let camera = &cameras[(x / SIDE) as usize];
            let ray = camera.ray(Vec2::new((x % SIDE) as f32, y as f32) + 0.5);
            let Some((_, at)) = renderer.meet(camera.eye(), ray) else {
                return Texel::new(0.2, 0.2, 0.4, 1.0);
            };
            let corners = self.mesh().triangles[at.triangle as usize].map(|vertex| shares[vertex as usize]);
            Vec3::splat(at.barycentric.dot(Vec3::from(corners))).extend(1.0)
        };
        (0..2 * SIDE * SIDE).map(pixel).collect()
    }

    /// A camera that sees the whole mesh, along -z or, from behind, along z.
    fn overview(&self, behind: bool) -> Camera {
        let positions = &self.mesh().positions;
        let low = positions.iter().fold(Vec3::INFINITY, |low, &place| low.min(place));
        let high = positions.iter().fold(Vec3::NEG_INFINITY, |high, &place| high.max(place));
        let (centre, radius) = ((low + high) * 0.5, (high - low).length() * 0.5);
        // From four radii away a sphere of one radius fills two thirds of the image.
        let turn = Mat4::from_rotation_y(if behind { std::f32::consts::PI } else { 0.0 });
        let to_world =
            Mat4::from_translation(centre) * turn * Mat4::from_translation(Vec3::new(0.0, 0.0, 4.0 * radius));
        Camera {
            width: SIDE,
            height: SIDE,
            focal: Vec2::splat(1.6 * SIDE as f32),
            centre: Vec2::splat(0.5 * SIDE as f32),
            to_world,
        }
    }
}
