//! What a patch looks like, in few numbers, whatever its brightness and contrast.
//!
//! The patch is averaged to 8 x 8 values, these lose their mean and are divided by their length, and the lowest
//! frequencies of their cosine transform are kept. Mirroring a patch flips the sign of its odd frequencies, so one
//! descriptor serves all mirrorings.

use std::sync::OnceLock;

use crate::LumaSums;

/// Numbers of a descriptor.
pub const DESCRIPTOR_LENGTH: usize = 14;
/// Values a side that a patch is averaged to.
pub(crate) const SIDE: usize = 8;
/// Length of the mean-free values, in 8-bit steps, that counts as noise: contrast below it is not blown up.
const NOISE: f32 = 12.0;
/// Frequencies across and down, by rising sum; the constant is left out.
const FREQUENCIES: [(usize, usize); DESCRIPTOR_LENGTH] = [
    (1, 0),
    (0, 1),
    (2, 0),
    (1, 1),
    (0, 2),
    (3, 0),
    (2, 1),
    (1, 2),
    (0, 3),
    (4, 0),
    (3, 1),
    (2, 2),
    (1, 3),
    (0, 4),
];

/// The descriptor of a patch.
pub type Descriptor = [f32; DESCRIPTOR_LENGTH];

/// A mirroring of a patch in itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mirror {
    /// Left and right are exchanged.
    pub across: bool,
    /// Top and bottom are exchanged.
    pub down: bool,
}

impl Mirror {
    /// All of them, the one that changes nothing first.
    pub const ALL: [Mirror; 4] = [
        Mirror { across: false, down: false },
        Mirror { across: true, down: false },
        Mirror { across: false, down: true },
        Mirror { across: true, down: true },
    ];

    /// The descriptor of the mirrored patch.
    #[must_use]
    pub fn of(self, descriptor: &Descriptor) -> Descriptor {
        let mut mirrored = *descriptor;
        for (value, (u, v)) in mirrored.iter_mut().zip(FREQUENCIES) {
            let odd = (self.across && u % 2 == 1) != (self.down && v % 2 == 1);
            *value = if odd { -*value } else { *value };
        }
        mirrored
    }
}

/// Cosines: frequency by place, orthonormal.
fn cosines() -> &'static [[f32; SIDE]; SIDE] {
    static TABLE: OnceLock<[[f32; SIDE]; SIDE]> = OnceLock::new();
    TABLE.get_or_init(|| {
        std::array::from_fn(|u| {
            let scale = if u == 0 { 1.0 / SIDE as f64 } else { 2.0 / SIDE as f64 }.sqrt();
            std::array::from_fn(|x| {
                let angle = std::f64::consts::PI * (2 * x + 1) as f64 * u as f64 / (2 * SIDE) as f64;
                (scale * angle.cos()) as f32
            })
        })
    })
}

/// The descriptor of the patch of `width` x `height` texels (multiples of 4) at (`x`, `y`), and the length of its mean-free
/// values in 8-bit steps a texel: its contrast.
#[must_use]
pub fn describe(sums: &LumaSums, x: usize, y: usize, width: usize, height: usize) -> (Descriptor, f32) {
    let mut values = [[0.0f32; SIDE]; SIDE];
    let span = |index: usize, side: usize| {
        let start = index * side / SIDE;
        (start, ((index + 1) * side / SIDE).max(start + 1) - start)
    };
    for (v, row) in values.iter_mut().enumerate() {
        let (top, rows) = span(v, height);
        for (u, value) in row.iter_mut().enumerate() {
            let (left, columns) = span(u, width);
            *value = sums.sum(x + left, y + top, columns, rows) / (3 * columns * rows) as f32;
        }
    }
    transform(&values)
}

/// The low frequencies of 8 x 8 values less their mean, over their length, and that length a texel.
pub(crate) fn transform(values: &[[f32; SIDE]; SIDE]) -> (Descriptor, f32) {
    let table = cosines();
    // Rows first: only frequencies up to 4 are needed.
    let mut across = [[0.0f32; 5]; SIDE];
    for (line, row) in across.iter_mut().zip(values) {
        for (u, sum) in line.iter_mut().enumerate() {
            *sum = row.iter().zip(&table[u]).map(|(a, b)| a * b).sum();
        }
    }
    let mut descriptor = [0.0; DESCRIPTOR_LENGTH];
    for (value, (u, v)) in descriptor.iter_mut().zip(FREQUENCIES) {
        *value = across.iter().zip(&table[v]).map(|(line, b)| line[u] * b).sum();
    }
    let mean = values.as_flattened().iter().sum::<f32>() / (SIDE * SIDE) as f32;
    let squared: f32 = values.as_flattened().iter().map(|value| (value - mean) * (value - mean)).sum();
    let length = squared.sqrt();
    let scale = 1.0 / (length + NOISE);
    (descriptor.map(|value| value * scale), length / SIDE as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Field;
    use glam::Vec4;

    fn field(value: impl Fn(usize, usize) -> f32) -> LumaSums {
        let texels = (0..32 * 32).map(|i| Vec4::splat(value(i % 32, i / 32))).collect();
        LumaSums::new(&Field { width: 32, height: 32, texels })
    }

    #[test]
    fn mirrored_patches_have_mirrored_descriptors() {
        let value = |x: usize, y: usize| ((x * 7 + y * 3 + x * y) % 31) as f32 * 8.0;
        let plain = field(value);
        for mirror in Mirror::ALL {
            let flip = |at: usize, flip: bool| if flip { 31 - at } else { at };
            let mirrored = field(|x, y| value(flip(x, mirror.across), flip(y, mirror.down)));
            let (a, b) = (describe(&plain, 8, 8, 16, 16).0, describe(&mirrored, 8, 8, 16, 16).0);
            for (a, b) in mirror.of(&a).iter().zip(b) {
                assert!((a - b).abs() < 1e-5, "{mirror:?}: {a} {b}");
            }
        }
    }

    #[test]
    fn brightness_does_not_count_and_contrast_hardly() {
        let value = |x: usize, y: usize| ((x / 3 + y / 5) % 2) as f32;
        let a = describe(&field(|x, y| 200.0 * value(x, y)), 4, 0, 24, 24).0;
        let b = describe(&field(|x, y| 60.0 + 140.0 * value(x, y)), 4, 0, 24, 24).0;
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.02), "{a:?} {b:?}");
        let flat = describe(&field(|_, _| 77.0), 0, 0, 32, 32);
        assert!(flat.0.iter().all(|value| value.abs() < 1e-3) && flat.1 < 1e-3);
    }
}
