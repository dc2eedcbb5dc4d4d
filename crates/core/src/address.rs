//! CPU twins of `shaders/wgsl/shared/address.wgsl`: from texture coordinates to texels.

use glam::{IVec2, UVec2, Vec2};

/// Coordinates outside [0, 1) start again at the other side.
pub const TEXFOLD_REPEAT: u32 = 0;
/// Coordinates outside are moved to the edge.
pub const TEXFOLD_CLAMP: u32 = 1;
/// 1 - 2^-20: see [`texfold_divide`].
pub const TEXFOLD_BELOW_ONE: f32 = 0.99999905;

/// The four texels around a place, all of them inside the texture, and how far the place lies from the first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexfoldTap {
    /// Left column and upper row.
    pub low: UVec2,
    /// Right column and lower row.
    pub high: UVec2,
    /// Weight of the right column and of the lower row, 0 to 1.
    pub weight: Vec2,
}

/// Moves `uv` into 0 to 1 in repeat mode. 1 itself comes from negative numbers too small to differ from 0.
#[must_use]
pub fn texfold_fold(uv: Vec2, mode: u32) -> Vec2 {
    if mode == TEXFOLD_REPEAT { uv - uv.floor() } else { uv }
}

/// The four texels around `uv` in a level of `size` texels, by address mode. Where `uv` is no number, any texels.
#[must_use]
pub fn texfold_tap(uv: Vec2, size: UVec2, mode: u32) -> TexfoldTap {
    let at = texfold_fold(uv, mode) * size.as_vec2() - Vec2::splat(0.5);
    let corner = at.floor();
    let last = size.as_ivec2() - IVec2::ONE;
    // Folded coordinates are beyond an edge by one texel at most: no division brings them inside.
    let low = corner.as_ivec2().clamp(IVec2::NEG_ONE, last);
    let around = mode == TEXFOLD_REPEAT;
    let before = if around { last } else { IVec2::ZERO };
    let behind = if around { IVec2::ZERO } else { last };
    let weight = at - corner;
    TexfoldTap {
        low: IVec2::select(low.cmplt(IVec2::ZERO), before, low).as_uvec2(),
        high: IVec2::select(low.cmpge(last), behind, low + IVec2::ONE).as_uvec2(),
        // Infinity minus itself is no number, and so not above 0.
        weight: Vec2::select(weight.cmpgt(Vec2::ZERO), weight, Vec2::ZERO),
    }
}

/// The texel of a level of `size` texels that `uv` lies in, by address mode. Where `uv` is no number, any texel.
#[must_use]
pub fn texfold_nearest(uv: Vec2, size: UVec2, mode: u32) -> UVec2 {
    texfold_inside((texfold_fold(uv, mode) * size.as_vec2()).as_ivec2(), size)
}

/// The texel at column `at.x` and row `at.y` of a level of `size` texels, clamped to it.
#[must_use]
pub fn texfold_inside(at: IVec2, size: UVec2) -> UVec2 {
    at.clamp(IVec2::ZERO, size.as_ivec2() - IVec2::ONE).as_uvec2()
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

/// The level to look up for mip level `lod` of `levels`: 0 to `levels - 1`. What is no number becomes 0.
#[must_use]
pub fn texfold_lod(lod: f32, levels: u32) -> f32 {
    if lod > 0.0 { lod.min((levels - 1) as f32) } else { 0.0 }
}

/// `value` modulo and over `divisor`, exactly, for values below 2^31, divisors from 1 to 2^24 and quotients below
/// 2^18.
#[must_use]
pub fn texfold_divide(value: u32, divisor: u32) -> UVec2 {
    divide(value, divisor, TEXFOLD_BELOW_ONE / divisor as f32)
}

/// As [`texfold_divide`], which says what `share` is.
fn divide(value: u32, divisor: u32, share: f32) -> UVec2 {
    // Conversion, division (2.5 units in the last place on a GPU) and product are off by less than 2^-20 together:
    // scaled down by that much the estimate is the quotient or one less.
    let quotient = (value as f32 * share) as u32;
    let rest = value - quotient * divisor;
    if rest >= divisor { UVec2::new(rest - divisor, quotient + 1) } else { UVec2::new(rest, quotient) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The texel that holds `uv` and the four around it, with the division that shaders avoid.
    fn slowly(uv: f32, size: u32, mode: u32) -> (u32, u32, u32) {
        let wrap = |texel: f64| match mode {
            TEXFOLD_REPEAT => texel.rem_euclid(f64::from(size)) as u32,
            _ => texel.clamp(0.0, f64::from(size - 1)) as u32,
        };
        let at = f64::from(uv) * f64::from(size);
        let low = (at - 0.5).floor();
        (wrap(at.floor()), wrap(low), wrap(low + 1.0))
    }

    #[test]
    fn coordinates_repeat_and_clamp() {
        for mode in [TEXFOLD_REPEAT, TEXFOLD_CLAMP] {
            for size in [1, 2, 3, 5, 37, 64, 513] {
                // Sixteenths of a texel, exact in single precision where the size is a power of two; elsewhere not on
                // a boundary.
                for sixteenth in -48 * size as i32..48 * size as i32 {
                    let uv = (sixteenth as f32 / 16.0 + 1.0 / 32.0) / size as f32;
                    let (texel, low, high) = slowly(uv, size, mode);
                    let (uv, sizes) = (Vec2::new(uv, 0.25), UVec2::new(size, 8));
                    assert_eq!(texfold_nearest(uv, sizes, mode), UVec2::new(texel, 2), "{uv} of {size}");
                    let tap = texfold_tap(uv, sizes, mode);
                    assert_eq!(
                        (tap.low, tap.high),
                        (UVec2::new(low, 1), UVec2::new(high, 2)),
                        "{uv} of {size}"
                    );
                }
            }
        }
    }

    #[test]
    fn every_number_leads_into_the_texture() {
        let numbers = [
            0.0,
            -0.0,
            -1e-30,
            1.0,
            -1.0,
            0.99999994,
            1e10,
            -1e10,
            f32::MAX,
            f32::MIN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            f32::NAN,
        ];
        for (x, mode) in numbers.into_iter().flat_map(|x| [(x, TEXFOLD_REPEAT), (x, TEXFOLD_CLAMP)]) {
            for size in [UVec2::ONE, UVec2::new(37, 61), UVec2::new(32768, 2)] {
                let uv = Vec2::new(x, -x);
                let tap = texfold_tap(uv, size, mode);
                let texels = [tap.low, tap.high, texfold_nearest(uv, size, mode)];
                assert!(texels.iter().all(|texel| texel.cmplt(size).all()), "{uv} {size}: {tap:?}");
                assert!(tap.weight.cmpge(Vec2::ZERO).all() && tap.weight.cmple(Vec2::ONE).all(), "{tap:?}");
            }
            assert!((0.0..=3.0).contains(&texfold_lod(x, 4)));
        }
        assert_eq!([f32::NAN, 1.5, 9.0].map(|lod| texfold_lod(lod, 4)), [0.0, 1.5, 3.0]);
    }

    #[test]
    fn a_texel_centre_has_weight_zero() {
        let tap = texfold_tap(Vec2::new(2.5 / 8.0, 0.5 / 4.0), UVec2::new(8, 4), TEXFOLD_CLAMP);
        assert_eq!((tap.low, tap.high, tap.weight), (UVec2::new(2, 0), UVec2::new(3, 1), Vec2::ZERO));
    }

    #[test]
    fn every_block_of_every_width_is_divided_exactly() {
        // An image of 32768 x 32768 texels has 8192 x 8192 blocks and a third of that in its further levels.
        for width in 1..=8192u32 {
            // All rows of some widths, some rows of the others. Quotients change where rows of blocks begin and end.
            let step = if width % 1024 < 2 || width < 4 { 1 } else { 61 };
            for row in (0..11_000).step_by(step).chain([8191, 10_922, 32_767, 65_536]) {
                for x in [0, width / 2, width - 1] {
                    let value = row * width + x;
                    let expected = UVec2::new(x, row);
                    assert_eq!(texfold_divide(value, width), expected, "{value} / {width}");
                    // GPUs divide less exactly.
                    let share = (TEXFOLD_BELOW_ONE / width as f32).to_bits();
                    for share in [share - 3, share + 3].map(f32::from_bits) {
                        assert_eq!(divide(value, width, share), expected, "{value} / {width}");
                    }
                }
            }
        }
    }

    #[test]
    fn division_is_exact_up_to_its_bounds() {
        for divisor in [1, 2, 3, 5, 7, 1023, 8192, 16_383, (1 << 24) - 1, 1 << 24] {
            let most = (1u32 << 18).min(((1u64 << 31) / u64::from(divisor)) as u32);
            for quotient in [0, 1, 2, most / 3, most / 2, most - 1] {
                for rest in [0, 1, divisor / 2, divisor - 1].map(|rest| rest.min(divisor - 1)) {
                    let value = quotient * divisor + rest;
                    assert_eq!(
                        texfold_divide(value, divisor),
                        UVec2::new(rest, quotient),
                        "{value} / {divisor}"
                    );
                }
            }
        }
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
