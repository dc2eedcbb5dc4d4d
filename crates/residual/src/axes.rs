//! Axes of residuals: luma and chroma, rotated to what a texture's residuals need.

#[cfg(feature = "encode")]
use glam::Vec3;

use crate::decode::TEXFOLD_RESIDUAL_AXES_BITS;
#[cfg(feature = "encode")]
use crate::decode::TEXFOLD_RESIDUAL_AXES_ONE;

/// A rotation of luma and both axes of chroma: three numbers of 10 bits in a word, the first in the lowest bits. In 1/511 they are
/// the axis of the rotation times the tangent of half its angle (Rodrigues). 0 turns nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Axes(u32);

impl Axes {
    /// From what [`Axes::packed`] gives; `None` where bits are set that mean nothing.
    #[must_use]
    pub fn unpacked(word: u32) -> Option<Axes> {
        (word >> (3 * TEXFOLD_RESIDUAL_AXES_BITS) == 0).then_some(Axes(word))
    }

    /// As the shader reads it.
    #[must_use]
    pub fn packed(self) -> u32 {
        self.0
    }

    /// The nearest one; `None` where a part is above 1.
    #[cfg(feature = "encode")]
    pub(crate) fn nearest(rotation: Vec3) -> Option<Axes> {
        let part = |value: f32| {
            (value * TEXFOLD_RESIDUAL_AXES_ONE).round() as i32 as u32
                & ((1 << TEXFOLD_RESIDUAL_AXES_BITS) - 1)
        };
        let word = part(rotation.x)
            | part(rotation.y) << TEXFOLD_RESIDUAL_AXES_BITS
            | part(rotation.z) << (2 * TEXFOLD_RESIDUAL_AXES_BITS);
        (rotation.abs().max_element() <= 1.0).then_some(Axes(word))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::{texfold_residual_axes, texfold_residual_turned};

    #[test]
    fn words_say_rotations() {
        assert_eq!(texfold_residual_axes(0), Vec3::ZERO);
        let parts = Vec3::new(3.0, -1.0, 2.0);
        assert_eq!(texfold_residual_turned(parts, Vec3::ZERO), parts);
        for rotation in [Vec3::new(1.0, 0.0, 0.0), Vec3::new(-0.3, 0.9, -1.0), Vec3::new(0.002, -0.002, 0.4)]
        {
            let axes = Axes::nearest(rotation).unwrap();
            assert_eq!(Axes::unpacked(axes.packed()), Some(axes));
            let found = texfold_residual_axes(axes.packed());
            assert!((found - rotation).abs().max_element() < 0.001, "{found} {rotation}");
            let turned = texfold_residual_turned(parts, found);
            assert!((turned.length() / parts.length() - 1.0).abs() < 1e-5);
            let back = texfold_residual_turned(turned, -found);
            assert!((back - parts).abs().max_element() < 1e-5, "{back}");
        }
        // A quarter turn about the first axis.
        let turned = texfold_residual_turned(Vec3::Y, Vec3::X);
        assert!((turned - Vec3::Z).abs().max_element() < 1e-6, "{turned}");
        assert_eq!(Axes::nearest(Vec3::new(0.0, 1.1, 0.0)), None);
        assert_eq!(Axes::unpacked(1 << 30), None);
    }
}
