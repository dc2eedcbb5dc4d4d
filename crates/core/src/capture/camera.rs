//! Pinhole cameras.

use glam::{Mat4, Vec2, Vec3, Vec4};

/// A pinhole camera: in its own space it looks along -z with x to the right and y up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Columns of the image in pixels.
    pub width: u32,
    /// Rows of the image in pixels.
    pub height: u32,
    /// Focal lengths in pixels, across and down.
    pub focal: Vec2,
    /// Where the axis meets the image, in pixels from the upper left corner.
    pub centre: Vec2,
    /// From the camera's space to the mesh's, a rigid motion.
    pub to_world: Mat4,
}

impl Camera {
    /// Whether all numbers are finite, the matrix can be inverted and the image has pixels.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let scale = self.to_world.determinant();
        self.width > 0
            && self.height > 0
            && self.focal.is_finite()
            && self.focal.min_element() > 0.0
            && self.centre.is_finite()
            && self.to_world.is_finite()
            && scale.is_finite()
            && scale.abs() > f32::MIN_POSITIVE
    }

    /// Where the camera is.
    #[must_use]
    pub fn eye(&self) -> Vec3 {
        self.to_world.w_axis.truncate()
    }

    /// From the mesh's space to the camera's.
    #[must_use]
    pub fn to_camera(&self) -> Mat4 {
        self.to_world.inverse()
    }

    /// Where `point`, in the camera's space, is in the image, in pixels from the upper left corner; `None` behind
    /// the camera.
    #[must_use]
    pub fn project(&self, point: Vec3) -> Option<Vec2> {
        let depth = -point.z;
        let place = self.centre + self.focal * Vec2::new(point.x, -point.y) / depth;
        (depth > 0.0 && place.is_finite()).then_some(place)
    }

    /// The unit vector from the eye through a place of the image, in the mesh's space.
    #[must_use]
    pub fn ray(&self, place: Vec2) -> Vec3 {
        let at = (place - self.centre) / self.focal;
        self.to_world.transform_vector3(Vec3::new(at.x, -at.y, -1.0)).normalize_or_zero()
    }

    /// From the mesh's space to clip space with depths 0 at `near` to 1 at `far`.
    #[must_use]
    pub fn view_projection(&self, near: f32, far: f32) -> Mat4 {
        let size = Vec2::new(self.width as f32, self.height as f32);
        let (scale, shift) = (2.0 * self.focal / size, 2.0 * self.centre / size - 1.0);
        let depth = far / (near - far);
        let projection = Mat4::from_cols(
            Vec4::new(scale.x, 0.0, 0.0, 0.0),
            Vec4::new(0.0, scale.y, 0.0, 0.0),
            Vec4::new(-shift.x, shift.y, depth, -1.0),
            Vec4::new(0.0, 0.0, near * depth, 0.0),
        );
        projection * self.to_camera()
    }

    /// The same view in an image of another size.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Camera {
        let factor = Vec2::new(width as f32 / self.width as f32, height as f32 / self.height as f32);
        Camera { width, height, focal: self.focal * factor, centre: self.centre * factor, ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let to_world = Mat4::from_rotation_translation(
            glam::Quat::from_euler(glam::EulerRot::XYZ, 0.3, -0.8, 0.2),
            Vec3::new(1.0, 2.0, 3.0),
        );
        Camera {
            width: 40,
            height: 30,
            focal: Vec2::new(50.0, 45.0),
            centre: Vec2::new(19.0, 16.5),
            to_world,
        }
    }

    #[test]
    fn a_ray_comes_back_to_its_pixel() {
        let camera = camera();
        for place in [Vec2::new(0.5, 0.5), Vec2::new(39.0, 2.0), Vec2::new(19.0, 16.5)] {
            let point = camera.eye() + 7.0 * camera.ray(place);
            let back = camera.project(camera.to_camera().transform_point3(point)).unwrap();
            assert!(back.distance(place) < 1e-3, "{place} {back}");
        }
        assert_eq!(camera.project(Vec3::new(0.0, 0.0, 1.0)), None);
    }

    #[test]
    fn clip_space_agrees_with_projection() {
        let camera = camera();
        let point = camera.eye() + 4.0 * camera.ray(Vec2::new(7.0, 25.0));
        let clip = camera.view_projection(0.5, 50.0) * point.extend(1.0);
        let ndc = clip.truncate() / clip.w;
        let place = Vec2::new((ndc.x + 1.0) * 20.0, (1.0 - ndc.y) * 15.0);
        assert!(place.distance(Vec2::new(7.0, 25.0)) < 1e-3, "{place}");
        assert!(ndc.z > 0.0 && ndc.z < 1.0);
        let near = camera.view_projection(0.5, 50.0) * (camera.to_world * Vec4::new(0.0, 0.0, -0.5, 1.0));
        assert!((near.z / near.w).abs() < 1e-5);
    }
}
