//! CPU twins of `shaders/wgsl/shared/sample.wgsl`: blending of fetched texels.

use glam::{Vec2, Vec3, Vec4};

/// `a` at weight 0, `b` at weight 1. Written as the shader evaluates it, so that both agree bit for bit.
#[must_use]
pub fn texfold_mix(a: Vec4, b: Vec4, weight: f32) -> Vec4 {
    a + (b - a) * weight
}

/// Blends the four texels around a place: upper left, upper right, lower left, lower right.
#[must_use]
pub fn texfold_bilinear(texels: [Vec4; 4], weight: Vec2) -> Vec4 {
    let upper = texfold_mix(texels[0], texels[1], weight.x);
    let lower = texfold_mix(texels[2], texels[3], weight.x);
    texfold_mix(upper, lower, weight.y)
}

/// Rebuilds the third component of a unit normal from the first two, all stored as `v * 0.5 + 0.5`.
#[must_use]
pub fn texfold_normal_z(x: f32, y: f32) -> Vec3 {
    let (nx, ny) = (x * 2.0 - 1.0, y * 2.0 - 1.0);
    let z = (1.0 - nx * nx - ny * ny).max(0.0).sqrt();
    Vec3::new(x, y, z * 0.5 + 0.5)
}

/// Plane `a` holds red, green, blue and alpha.
pub const TEXFOLD_RGBA: u32 = 0;
/// Plane `a` holds red, green and blue; alpha is 1.
pub const TEXFOLD_RGB: u32 = 1;
/// Plane `a` holds gray; alpha is 1.
pub const TEXFOLD_GRAY: u32 = 2;
/// Plane `a` holds gray and alpha.
pub const TEXFOLD_GRAY_ALPHA: u32 = 3;
/// Plane `a` holds red and green, plane `b` blue; alpha is 1.
pub const TEXFOLD_SPLIT: u32 = 4;
/// Plane `a` holds x and y of a unit normal; alpha is 1.
pub const TEXFOLD_NORMAL: u32 = 5;

/// One texel from the values that its planes hold; `kind` is one of the swizzles above but that of normals.
#[must_use]
pub fn texfold_swizzle_colour(a: Vec4, b: Vec4, kind: u32) -> Vec4 {
    match kind {
        TEXFOLD_RGBA => a,
        TEXFOLD_GRAY => Vec4::new(a.x, a.x, a.x, 1.0),
        TEXFOLD_GRAY_ALPHA => Vec4::new(a.x, a.x, a.x, a.y),
        TEXFOLD_SPLIT => Vec4::new(a.x, a.y, b.x, 1.0),
        _ => Vec4::new(a.x, a.y, a.z, 1.0),
    }
}

/// One texel from the values that its planes hold. Blended values give a blended texel; a normal gets back its
/// length of 1.
#[must_use]
pub fn texfold_swizzle(a: Vec4, b: Vec4, kind: u32) -> Vec4 {
    if kind == TEXFOLD_NORMAL {
        texfold_normal_z(a.x, a.y).extend(1.0)
    } else {
        texfold_swizzle_colour(a, b, kind)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_and_middle() {
        let texels = [Vec4::ZERO, Vec4::X, Vec4::Y, Vec4::ONE];
        assert_eq!(texfold_bilinear(texels, Vec2::new(1.0, 0.0)), Vec4::X);
        assert_eq!(texfold_bilinear(texels, Vec2::new(0.0, 1.0)), Vec4::Y);
        assert_eq!(texfold_bilinear(texels, Vec2::splat(0.5)), Vec4::new(0.5, 0.5, 0.25, 0.25));
    }

    #[test]
    fn flat_normal_points_up() {
        assert_eq!(texfold_normal_z(0.5, 0.5), Vec3::new(0.5, 0.5, 1.0));
        assert_eq!(texfold_normal_z(1.0, 1.0).z, 0.5);
    }
}
