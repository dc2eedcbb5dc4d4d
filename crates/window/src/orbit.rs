//! A camera that turns around a place.

use glam::camera::rh::proj::directx::perspective;
use glam::camera::rh::view::look_at_mat4;
use glam::{Mat4, Vec3};

/// Radians of a pixel of a drag.
const TURN: f32 = 0.006;
/// Share of the distance that a pixel of the wheel takes.
const ZOOM: f32 = 0.002;
/// Nearest to straight up or down.
const STEEPEST: f32 = 1.5;

/// A camera.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Orbit {
    middle: Vec3,
    radius: f32,
    distance: f32,
    /// Around the vertical axis, and above the horizon, in radians.
    angles: (f32, f32),
}

impl Orbit {
    /// A camera that sees all of a sphere.
    pub(crate) fn around(middle: Vec3, radius: f32, height: f32) -> Orbit {
        Orbit { middle, radius, distance: 2.2 * radius, angles: (0.0, height) }
    }

    pub(crate) fn turn(&mut self, across: f32, down: f32) {
        let (around, above) = self.angles;
        self.angles = (around - TURN * across, (above + TURN * down).clamp(-STEEPEST, STEEPEST));
    }

    pub(crate) fn zoom(&mut self, pixels: f32) {
        let factor = (-ZOOM * pixels).exp();
        self.distance = (self.distance * factor).clamp(1e-3 * self.radius, 20.0 * self.radius);
    }

    pub(crate) fn eye(&self) -> Vec3 {
        let (around, above) = self.angles;
        let direction = Vec3::new(above.cos() * around.sin(), above.sin(), above.cos() * around.cos());
        self.middle + self.distance * direction
    }

    /// From the scene's space to clip space.
    pub(crate) fn projection(&self, aspect: f32) -> Mat4 {
        let (near, far) = (0.05 * self.distance, self.distance + 4.0 * self.radius);
        perspective(50f32.to_radians(), aspect, near, far) * look_at_mat4(self.eye(), self.middle, Vec3::Y)
    }
}
