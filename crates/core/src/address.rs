//! CPU twins of `shaders/wgsl/shared/address.wgsl`: from texture coordinates to texels.

use glam::{IVec2, UVec2, Vec2};

/// Coordinates outside [0, 1) start again at the other side.
pub const TEXFOLD_REPEAT: u32 = 0;
/// Coordinates outside are moved to the edge.
pub const TEXFOLD_CLAMP: u32 = 1;

/// The upper left of the four texels around a place, and how far the place lies from it (0 to 1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexfoldTap {
    /// Column and row; may lie outside the texture by one.
    pub low: IVec2,
    /// Weight of the right column and of the lower row.
    pub weight: Vec2,
}

/// Brings a texel coordinate into `0..size` by address mode.
#[must_use]
pub fn texfold_wrap(coord: i32, size: u32, mode: u32) -> u32 {
    let count = size as i32;
    if mode == TEXFOLD_REPEAT {
        let rest = coord % count;
        return if rest < 0 { (rest + count) as u32 } else { rest as u32 };
    }
    coord.clamp(0, count - 1) as u32
}

/// The four texels around `uv` in a level of `size` texels.
#[must_use]
pub fn texfold_tap(uv: Vec2, size: UVec2) -> TexfoldTap {
    let at = uv * size.as_vec2() - Vec2::splat(0.5);
    let low = at.floor();
    TexfoldTap { low: low.as_ivec2(), weight: at - low }
}

/// The texel that `uv` lies in, before wrapping.
#[must_use]
pub fn texfold_nearest(uv: Vec2, size: UVec2) -> IVec2 {
    (uv * size.as_vec2()).floor().as_ivec2()
}

/// Size of mip level `level`.
#[must_use]
pub fn texfold_level_size(size: UVec2, level: u32) -> UVec2 {
    UVec2::new(size.x >> level, size.y >> level).max(UVec2::ONE)
}

/// Mip level for a pixel that moves `dx` and `dy` in uv from its neighbours; below 0 the texture is magnified.
#[must_use]
pub fn texfold_level(dx: Vec2, dy: Vec2, size: UVec2) -> f32 {
    let (across, down) = (dx * size.as_vec2(), dy * size.as_vec2());
    let squared = across.dot(across).max(down.dot(down));
    0.5 * squared.max(1e-12).log2()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_repeats_and_clamps() {
        assert_eq!(texfold_wrap(-1, 5, TEXFOLD_REPEAT), 4);
        assert_eq!(texfold_wrap(-6, 5, TEXFOLD_REPEAT), 4);
        assert_eq!(texfold_wrap(12, 5, TEXFOLD_REPEAT), 2);
        assert_eq!(texfold_wrap(-3, 5, TEXFOLD_CLAMP), 0);
        assert_eq!(texfold_wrap(9, 5, TEXFOLD_CLAMP), 4);
    }

    #[test]
    fn a_texel_centre_has_weight_zero() {
        let tap = texfold_tap(Vec2::new(2.5 / 8.0, 0.5 / 4.0), UVec2::new(8, 4));
        assert_eq!((tap.low, tap.weight), (IVec2::new(2, 0), Vec2::ZERO));
        assert_eq!(texfold_nearest(Vec2::new(2.5 / 8.0, -0.1), UVec2::new(8, 4)), IVec2::new(2, -1));
    }

    #[test]
    fn one_texel_a_pixel_is_level_zero() {
        let size = UVec2::new(256, 128);
        let level = texfold_level(Vec2::new(1.0 / 256.0, 0.0), Vec2::new(0.0, 1.0 / 128.0), size);
        assert!(level.abs() < 1e-6);
        let level = texfold_level(Vec2::new(4.0 / 256.0, 0.0), Vec2::new(0.0, 1.0 / 128.0), size);
        assert!((level - 2.0).abs() < 1e-6);
    }
}
