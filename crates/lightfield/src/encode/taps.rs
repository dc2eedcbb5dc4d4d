//! Where observations lie in a view map, and what is read there.

use glam::{UVec2, Vec3A};

use super::ring::Ring;

/// Where an observation lies in a view map of `grid` texels a side.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tap {
    /// The upper left of four texels.
    pub(super) low: u32,
    /// Weights of the four.
    pub(super) weights: [f32; 4],
    /// How much the observation counts.
    pub(super) weight: f32,
}

impl Tap {
    /// The value of a view map of `grid` texels a side there.
    pub(super) fn read(&self, view: &[Vec3A], grid: usize) -> Vec3A {
        let low = self.low as usize;
        view[low] * self.weights[0]
            + view[low + 1] * self.weights[1]
            + view[low + grid] * self.weights[2]
            + view[low + grid + 1] * self.weights[3]
    }
}

/// Where all observations lie in view maps of `grid` texels a side; those of photographs that `counts` does not admit weigh nothing.
pub(super) fn taps(ring: &Ring, grid: u32, counts: impl Fn(u16) -> bool) -> Vec<Tap> {
    let mut taps = Vec::new();
    for (row, range) in ring.of_rows() {
        for observation in &ring.observations[range] {
            let at = observation.at * (grid - 1) as f32;
            let low = at.as_uvec2().min(UVec2::splat(grid - 2));
            let part = at - low.as_vec2();
            let (left, upper) = (1.0 - part.x, 1.0 - part.y);
            taps.push(Tap {
                low: low.y * grid + low.x,
                weights: [left * upper, part.x * upper, left * part.y, part.x * part.y],
                weight: if counts(observation.view) { observation.weight * row.hat * row.hat } else { 0.0 },
            });
        }
    }
    taps
}
