//! What the surroundings of a feature look like: gradients in 4x4 fields and 8 directions, by its own scale and
//! orientation.
//!
//! Source: Lowe 2004, section 6; the square root before normalisation: Arandjelovic and Zisserman, "Three things
//! everyone should know to improve object retrieval", CVPR 2012. Values are whole numbers, so that comparing is exact
//! and fast.

use glam::Vec2;

use super::gray::Gray;

/// Fields a side.
const FIELDS: usize = 4;
/// Directions a field.
const DIRECTIONS: usize = 8;
/// Values of a descriptor.
const VALUES: usize = FIELDS * FIELDS * DIRECTIONS;
/// Side of a field in scales of the feature.
const FIELD_SCALES: f32 = 3.0;
/// Length of a descriptor: its values are below 2^15, and sums of their products below 2^31.
const LENGTH: f32 = 16384.0;

/// A unit vector in units of 1 / [`LENGTH`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Descriptor([i16; VALUES]);

impl Descriptor {
    /// Squared distance to another as unit vectors, 0 to 2.
    pub(crate) fn distance(&self, other: &Descriptor) -> f32 {
        // Sums cannot overflow; said so, they are computed eight at a time in builds with checks too.
        let products =
            self.0.iter().zip(other.0.iter()).map(|(&a, &b)| i32::from(a).wrapping_mul(i32::from(b)));
        let dot = products.fold(0i32, i32::wrapping_add);
        2.0 - 2.0 * dot as f32 / (LENGTH * LENGTH)
    }
}

/// The descriptor around the pixel `at` of a blurred image.
pub(crate) fn describe(blur: &Gray, at: Vec2, sigma: f32, angle: f32) -> Descriptor {
    let side = FIELD_SCALES * sigma;
    let reach = side * std::f32::consts::SQRT_2 * (FIELDS as f32 + 1.0) * 0.5;
    let radius = (reach.round() as isize).min((blur.width + blur.height) as isize);
    let turn = Vec2::from_angle(-angle) / side;
    let (cx, cy) = (at.x.round() as isize, at.y.round() as isize);
    let mut sums = [0f32; VALUES];
    let (top, bottom) = ((cy - radius).max(1), (cy + radius).min(blur.height as isize - 2));
    let (left, right) = ((cx - radius).max(1), (cx + radius).min(blur.width as isize - 2));
    for (y, x) in (top..=bottom).flat_map(|y| (left..=right).map(move |x| (y, x))) {
        let place = turn.rotate(Vec2::new(x as f32, y as f32) - at);
        let field = place + 0.5 * FIELDS as f32 - 0.5;
        if field.min_element() <= -1.0 || field.max_element() >= FIELDS as f32 {
            continue;
        }
        let slope =
            Vec2::new(blur.get(x + 1, y) - blur.get(x - 1, y), blur.get(x, y + 1) - blur.get(x, y - 1));
        let half = 0.5 * FIELDS as f32;
        let weight = (-place.length_squared() / (2.0 * half * half)).exp() * slope.length();
        let direction = (slope.y.atan2(slope.x) - angle) / std::f32::consts::TAU * DIRECTIONS as f32;
        share(&mut sums, field, direction, weight);
    }
    finish(&sums)
}

/// Adds a gradient to the two fields on each axis and the two directions that it lies between.
fn share(sums: &mut [f32; VALUES], field: Vec2, direction: f32, weight: f32) {
    let (corner, first) = (field.floor(), direction.floor());
    let (part, turned) = (field - corner, direction - first);
    for (dy, down) in [(0, 1.0 - part.y), (1, part.y)] {
        for (dx, across) in [(0, 1.0 - part.x), (1, part.x)] {
            let (x, y) = (corner.x as isize + dx, corner.y as isize + dy);
            let inside = 0..FIELDS as isize;
            if !inside.contains(&x) || !inside.contains(&y) {
                continue;
            }
            for (next, by) in [(0, 1.0 - turned), (1, turned)] {
                let direction = (first as isize + next).rem_euclid(DIRECTIONS as isize) as usize;
                sums[(y as usize * FIELDS + x as usize) * DIRECTIONS + direction] +=
                    weight * down * across * by;
            }
        }
    }
}

fn finish(sums: &[f32; VALUES]) -> Descriptor {
    let length = sums.iter().map(|value| value * value).sum::<f32>().sqrt().max(1e-12);
    // Lowe's bound on single values, against highlights, then square roots of shares.
    let bounded = sums.map(|value| (value / length).min(0.2));
    let total = bounded.iter().sum::<f32>().max(1e-12);
    Descriptor(bounded.map(|value| ((value / total).sqrt() * LENGTH) as i16))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waves(angle: f32) -> Gray {
        let turn = Vec2::from_angle(angle);
        let value = |i: usize| {
            let place = turn.rotate(Vec2::new((i % 101) as f32 - 50.0, (i / 101) as f32 - 50.0));
            0.5 + 0.2 * (place.x * 0.3).sin() + 0.1 * (place.y * 0.23 + 0.4).cos() + 0.004 * place.x
        };
        Gray { width: 101, height: 101, data: (0..101 * 101).map(value).collect() }
    }

    #[test]
    fn turned_surroundings_look_alike_by_their_own_orientation() {
        let at = Vec2::splat(50.0);
        let upright = describe(&waves(0.0), at, 2.0, 0.0);
        // What is turned by -0.7 has its gradients at angles 0.7 less.
        let turned = describe(&waves(0.7), at, 2.0, -0.7);
        let other = describe(&waves(0.7), at, 2.0, 0.9);
        assert!(upright.distance(&turned) < 0.05, "{}", upright.distance(&turned));
        assert!(upright.distance(&other) > 0.2, "{}", upright.distance(&other));
        assert!(upright.distance(&upright).abs() < 0.01);
    }
}
