//! How far colours at both sides of an edge are apart.

use std::collections::BTreeMap;

use glam::Vec3;
use texfold::{Encoded, core::LightAddress, lightfield::LightTexture};

/// Places along an edge, and directions at each.
const PLACES: u32 = 5;
const DIRECTIONS: u32 = 4;

/// Differences in steps of 255.
pub(crate) struct Steps {
    /// Of all places, directions and channels.
    pub(crate) mean: f64,
    pub(crate) most: f64,
}

/// Compares the two sides of each edge of two triangles, seen from outside.
pub(crate) fn steps(texture: &LightTexture) -> Steps {
    let mesh = texture.mesh();
    let mut first_of: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    let (mut sum, mut count, mut most) = (0.0, 0u64, 0f32);
    for (number, &[a, b, c]) in (0..).zip(&mesh.triangles) {
        for (p, q) in [(a, b), (b, c), (c, a)] {
            let Some(other) = first_of.insert((p.min(q), p.max(q)), number) else { continue };
            for at in 0..PLACES * DIRECTIONS {
                let part = ((at % PLACES) as f32 + 0.5) / PLACES as f32;
                let direction = outside(mesh.corners([a, b, c]), at / PLACES);
                let colour = |triangle: u32| {
                    let corners = mesh.triangles[triangle as usize];
                    let weight = |vertex| match vertex {
                        _ if vertex == p => 1.0 - part,
                        _ if vertex == q => part,
                        _ => 0.0,
                    };
                    let barycentric = Vec3::from(corners.map(weight));
                    texture.texel(LightAddress { triangle, barycentric, direction }).truncate()
                };
                let step = (colour(number) - colour(other)).abs() * 255.0;
                sum += f64::from(step.element_sum());
                count += 3;
                most = most.max(step.max_element());
            }
        }
    }
    Steps { mean: sum / count.max(1) as f64, most: f64::from(most) }
}

/// One of some directions around a triangle's normal.
fn outside([a, b, c]: [Vec3; 3], number: u32) -> Vec3 {
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let along = (b - a).normalize_or_zero();
    let turn = number as f32 / DIRECTIONS as f32 * std::f32::consts::TAU;
    let side = along * turn.cos() + normal.cross(along) * turn.sin();
    (normal + 0.7 * side).normalize_or_zero()
}
