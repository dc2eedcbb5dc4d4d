//! Mip chains: a box filter in the space where averaging means something.
//!
//! sRGB colour is averaged in linear light, normals are renormalised, straight-alpha colour is weighted by
//! alpha so that hidden colours do not bleed in, and cut-out alpha is scaled so that each level covers the
//! same share of the image as level 0 (Castaño, "Computing alpha mipmaps", 2010). A level has half the size rounded
//! down; an odd side is filtered over 3 texels with the exact weights of the area each output texel covers.

use glam::{Vec3, Vec4};

use super::{Alpha, ColorSpace, ImageSize, PixelInfo, Raster, linear_to_srgb, srgb_to_linear};
use crate::Texel;

/// Steps of the search for the alpha scale: 2^-12 is finer than 8-bit alpha.
const COVERAGE_STEPS: u32 = 12;

/// Texels between two questions whether to go on: less than a millisecond of work.
const TEXELS_A_LOOK: usize = 1 << 13;

/// Which filter makes a level from the one above.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MipFilter {
    /// The mean over the area that a texel covers.
    #[default]
    Box,
}

/// Levels 0 to `levels - 1` of `image`; level 0 is the image itself. A chain that reaches 1x1 early repeats it.
#[must_use]
pub fn mip_chain(image: &Raster, levels: u32, filter: MipFilter) -> Vec<Raster> {
    chain_while(image, levels, filter, &|| true).unwrap_or_default()
}

/// The same as long as `goes_on` says so, which is asked every few thousand texels; `None` where it has said no.
pub(crate) fn chain_while(
    image: &Raster,
    levels: u32,
    filter: MipFilter,
    goes_on: &dyn Fn() -> bool,
) -> Option<Vec<Raster>> {
    let MipFilter::Box = filter;
    let info = image.info();
    let mut chain = vec![image.clone()];
    if levels < 2 {
        return Some(chain);
    }
    let mut light = map_while(image.texels(), goes_on, |texel| to_light(texel, info))?;
    let coverage = match info.alpha {
        Alpha::Cutout(threshold) => covered_share(&light, threshold),
        _ => 0.0,
    };
    for level in 1..levels {
        let above = image.size().at_level(level - 1);
        let size = image.size().at_level(level);
        light = halve(&light, above, size, goes_on)?;
        let scale = match info.alpha {
            Alpha::Cutout(threshold) => coverage_scale(&light, threshold, coverage),
            _ => 1.0,
        };
        let data = map_while(light.iter(), goes_on, |&value| from_light(value, info, scale))?;
        match Raster::from_texels(size.width, size.height, info, &data) {
            Ok(raster) => chain.push(raster),
            Err(_) => break,
        }
    }
    Some(chain)
}

/// What `work` makes of all items; `None` where `goes_on` has said no.
fn map_while<T, R>(
    items: impl ExactSizeIterator<Item = T>,
    goes_on: &dyn Fn() -> bool,
    mut work: impl FnMut(T) -> R,
) -> Option<Vec<R>> {
    let one = |(index, item)| (!is_look(index) || goes_on()).then(|| work(item));
    let mut made = Vec::new();
    made.reserve_exact(items.len());
    for item in items.enumerate().map(one) {
        made.push(item?);
    }
    Some(made)
}

/// Whether it is time to ask whether to go on: every so many texels.
fn is_look(index: usize) -> bool {
    index.is_multiple_of(TEXELS_A_LOOK)
}

/// Linear light, premultiplied; normals as vectors.
fn to_light(texel: Texel, info: PixelInfo) -> Vec4 {
    let color = match info.color {
        ColorSpace::Srgb => texel.truncate().to_array().map(srgb_to_linear).into(),
        ColorSpace::Linear => texel.truncate(),
        ColorSpace::Normal => texel.truncate() * 2.0 - 1.0,
    };
    let weight = if info.has_alpha() { texel.w } else { 1.0 };
    (color * weight).extend(texel.w)
}

fn from_light(value: Vec4, info: PixelInfo, alpha_scale: f32) -> Texel {
    let weight = if info.has_alpha() { value.w } else { 1.0 };
    let color = if weight > 0.0 { value.truncate() / weight } else { Vec3::ZERO };
    let color: Vec3 = match info.color {
        ColorSpace::Srgb => color.to_array().map(|light| linear_to_srgb(light.clamp(0.0, 1.0))).into(),
        ColorSpace::Linear => color,
        ColorSpace::Normal => color.normalize_or(Vec3::Z) * 0.5 + 0.5,
    };
    color.extend((value.w * alpha_scale).clamp(0.0, 1.0))
}

/// First source texel and the weights of up to three for each output texel along one axis.
fn spans(from: u32, to: u32) -> Vec<(usize, [f32; 3])> {
    let scale = from as f32 / to as f32;
    let span = |index: u32| {
        let (start, end) = (index as f32 * scale, (index + 1) as f32 * scale);
        let first = start.floor() as usize;
        let weight = |k: usize| {
            let (low, high) = ((first + k) as f32, (first + k + 1) as f32);
            (end.min(high) - start.max(low)).max(0.0) / scale
        };
        (first, [weight(0), weight(1), weight(2)])
    };
    (0..to).map(span).collect()
}

fn halve(light: &[Vec4], from: ImageSize, to: ImageSize, goes_on: &dyn Fn() -> bool) -> Option<Vec<Vec4>> {
    let (columns, rows) = (spans(from.width, to.width), spans(from.height, to.height));
    let at = |x: usize, y: usize| {
        light[y.min(from.height as usize - 1) * from.width as usize + x.min(from.width as usize - 1)]
    };
    let row_mean = |y: usize, (x, weights): &(usize, [f32; 3])| -> Vec4 {
        (0..3).map(|k| at(x + k, y) * weights[k]).fold(Vec4::ZERO, |sum, value| sum + value)
    };
    let mean = |(y, row_weights): &(usize, [f32; 3]), column: &(usize, [f32; 3])| {
        (0..3).map(|k| row_mean(y + k, column) * row_weights[k]).fold(Vec4::ZERO, |sum, value| sum + value)
    };
    let mut halved = Vec::new();
    halved.reserve_exact(columns.len() * rows.len());
    for row in &rows {
        // A row has at most 32768 texels.
        if !goes_on() {
            return None;
        }
        halved.extend(columns.iter().map(|column| mean(row, column)));
    }
    Some(halved)
}

fn covered_share(light: &[Vec4], threshold: f32) -> f32 {
    light.iter().filter(|value| value.w >= threshold).count() as f32 / light.len() as f32
}

/// The factor on alpha under which the share of texels at or above the threshold is nearest to `coverage`.
fn coverage_scale(light: &[Vec4], threshold: f32, coverage: f32) -> f32 {
    let (mut low, mut high) = (0.0f32, 8.0f32);
    for _ in 0..COVERAGE_STEPS {
        let middle = (low + high) * 0.5;
        let covered = light.iter().filter(|value| value.w * middle >= threshold).count() as f32;
        if covered / (light.len() as f32) < coverage {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chain_of(width: u32, height: u32, channels: u8, color: ColorSpace, bytes: &[u8]) -> Vec<Raster> {
        let raster = Raster::from_u8(width, height, channels, color, bytes).unwrap();
        mip_chain(&raster, raster.size().full_levels(), MipFilter::Box)
    }

    #[test]
    fn srgb_is_averaged_in_linear_light() {
        let chain = chain_of(2, 1, 1, ColorSpace::Srgb, &[0, 255]);
        assert_eq!(chain[1].to_bytes(), [188]);
        let chain = chain_of(2, 1, 1, ColorSpace::Linear, &[0, 255]);
        assert_eq!(chain[1].to_bytes(), [128]);
    }

    #[test]
    fn odd_sides_weigh_every_texel_alike() {
        let chain = chain_of(3, 1, 1, ColorSpace::Linear, &[255, 0, 0]);
        assert_eq!(chain[1].to_bytes(), [85]);
        let chain = chain_of(5, 1, 1, ColorSpace::Linear, &[0, 0, 255, 0, 0]);
        let bytes = chain[1].to_bytes();
        assert_eq!((bytes.len(), bytes[0]), (2, bytes[1]));
    }

    #[test]
    fn normals_stay_unit_vectors() {
        let chain = chain_of(2, 1, 3, ColorSpace::Normal, &[255, 128, 128, 128, 255, 128]);
        let value = chain[1].texel(0, 0).truncate() * 2.0 - 1.0;
        assert!((value.length() - 1.0).abs() < 1e-5, "{value}");
    }

    #[test]
    fn hidden_colour_does_not_bleed() {
        let chain = chain_of(2, 1, 4, ColorSpace::Linear, &[255, 0, 0, 255, 0, 255, 0, 0]);
        assert_eq!(chain[1].to_bytes(), [255, 0, 0, 128]);
    }

    #[test]
    fn cutout_levels_cover_the_same_share() {
        let hash = |i: u32| (i ^ (i >> 7)).wrapping_mul(0x9e37_79b1) ^ (i.wrapping_mul(0x85eb_ca6b) >> 11);
        let alpha: Vec<u8> = (0..64 * 64).map(|i| (hash(hash(i)) >> 8) as u8).collect();
        let bytes: Vec<u8> = alpha.iter().flat_map(|&a| [200, 200, 200, a]).collect();
        let raster = Raster::from_u8(64, 64, 4, ColorSpace::Srgb, &bytes).unwrap();
        let raster = raster.tagged(ColorSpace::Srgb, Alpha::Cutout(0.75));
        let share = |raster: &Raster| {
            raster.texels().filter(|texel| texel.w >= 0.75).count() as f32 / raster.size().texels() as f32
        };
        let chain = mip_chain(&raster, 4, MipFilter::Box);
        for level in &chain[1..] {
            assert!((share(level) - share(&raster)).abs() < 0.05, "{} {}", share(level), share(&raster));
        }
    }
}
