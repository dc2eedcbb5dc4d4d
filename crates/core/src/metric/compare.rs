//! Squared errors of two images in one pass.

use rayon::prelude::*;

use super::{BAND_ROWS, Quality, SquaredError, counted_channels};
use crate::image::{Raster, to_u8};

/// Side of the tiles of which the worst is looked for: the rows of a band.
const TILE: usize = BAND_ROWS as usize;
/// Side of the blocks of which the worst is looked for.
const BLOCK: usize = 4;

/// Errors of a decoded image. Where the sizes differ, the upper left parts that both have are compared. Colours of texels whose
/// alpha is 0 in 8 bits are not compared where it hides them ([`crate::image::PixelInfo::hides_colors`]).
#[must_use]
pub fn compare(source: &Raster, decoded: &Raster) -> Quality {
    let height = source.size().height.min(decoded.size().height);
    let bands: Vec<u32> = (0..height).step_by(TILE).collect();
    let of_band = |top: u32| of_band(source, (decoded, top), top);
    // Sums are of whole numbers: the same in any order.
    bands.into_par_iter().map(of_band).reduce(Quality::default, Quality::and)
}

/// Errors of the rows of a band of `source` that begins at row `top`, a multiple of [`BAND_ROWS`]; it is `decoded` from the row
/// beside it on.
pub(super) fn of_band(source: &Raster, (decoded, from): (&Raster, u32), top: u32) -> Quality {
    let (size, other) = (source.size(), decoded.size());
    let rows = BAND_ROWS.min(size.height - top).min(other.height - from) as usize;
    let width = size.width.min(other.width) as usize;
    let gain = source.peak().recip();
    let gains = [gain, gain, gain, if source.info().has_alpha() { 1.0 } else { gain }];
    let counted = counted_channels(source, decoded);
    let in_block: &[usize] = if source.info().has_extra() { &[0, 1, 2, 3] } else { &[0, 1, 2] };
    let has_alpha = source.info().has_alpha();
    let hides_colors = source.info().hides_colors();
    let mut lines = [vec![[0; 4]; width], vec![[0; 4]; width]];
    // Sums of squared errors of each channel, and texels whose colours are hidden.
    let mut blocks = vec![[0u32; 5]; width.div_ceil(BLOCK)];
    let mut tiles = vec![[0u64; 5]; width.div_ceil(TILE)];
    let (mut worst_block, mut worst_tile) = (0.0f64, 0.0f64);
    for first in (0..rows).step_by(BLOCK) {
        let height = BLOCK.min(rows - first);
        blocks.fill([0; 5]);
        for row in (first..first + height).map(|row| row as u32) {
            let [a, b] = &mut lines;
            read(source, top + row, gains, a);
            read(decoded, from + row, gains, b);
            for (block, (a, b)) in blocks.iter_mut().zip(a.chunks(BLOCK).zip(b.chunks(BLOCK))) {
                for (a, b) in a.iter().zip(b) {
                    let is_hidden = hides_colors && a[3] == 0;
                    for channel in 0..4 {
                        let step = u32::from(a[channel].abs_diff(b[channel]));
                        block[channel] += if is_hidden && channel < 3 { 0 } else { step * step };
                    }
                    block[4] += u32::from(is_hidden);
                }
            }
        }
        for (number, block) in blocks.iter().enumerate() {
            let sums = block.map(u64::from);
            let texels = height * BLOCK.min(width - number * BLOCK);
            worst_block = worst_block.max(mean(&sums, in_block, texels));
            tiles[number * BLOCK / TILE].iter_mut().zip(sums).for_each(|(sum, own)| *sum += own);
        }
    }
    let mut all = [0; 5];
    for (number, sums) in tiles.iter().enumerate() {
        let texels = rows * TILE.min(width - number * TILE);
        worst_tile = worst_tile.max(mean(sums, counted, texels));
        all.iter_mut().zip(sums).for_each(|(all, sum)| *all += sum);
    }
    let texels = (rows * width) as u64;
    let sum = counted.iter().map(|&channel| all[channel]).sum::<u64>();
    Quality {
        color: SquaredError { sum: sum as f64, count: (texels - all[4]) * counted.len() as u64 },
        alpha: has_alpha.then_some(SquaredError { sum: all[3] as f64, count: texels }),
        worst_block_rms: worst_block.sqrt(),
        worst_tile_mse: worst_tile,
    }
}

/// The mean of sums over those channels of so many texels, of whose colours the hidden ones do not count; 0 where none does.
fn mean(sums: &[u64; 5], channels: &[usize], texels: usize) -> f64 {
    let sum = channels.iter().map(|&channel| sums[channel]).sum::<u64>();
    let count = |&channel: &usize| texels as u64 - if channel < 3 { sums[4] } else { 0 };
    sum as f64 / channels.iter().map(count).sum::<u64>().max(1) as f64
}

/// Texels of a row times `gains` in bytes, as [`Raster::texel`] has their channels.
pub(super) fn read(raster: &Raster, y: u32, gains: [f32; 4], out: &mut [[u8; 4]]) {
    let channels = usize::from(raster.info().channels);
    let first = y as usize * raster.size().width as usize;
    match raster.bytes() {
        Some(bytes) if gains == [1.0; 4] => {
            let texels = bytes[first * channels..].chunks_exact(channels);
            out.iter_mut().zip(texels).for_each(|(out, texel)| {
                *out = match *texel {
                    [gray] => [gray, gray, gray, u8::MAX],
                    [gray, alpha] => [gray, gray, gray, alpha],
                    [red, green, blue] => [red, green, blue, u8::MAX],
                    [red, green, blue, alpha] => [red, green, blue, alpha],
                    _ => [0; 4],
                };
            });
        }
        _ => {
            let texels = raster.texels_from(first, out.len());
            out.iter_mut().zip(texels).for_each(|(out, texel)| {
                let texel = texel.to_array();
                *out = std::array::from_fn(|channel| to_u8(texel[channel] * gains[channel]));
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Alpha, ColorSpace};
    use crate::rng::Rng;

    /// The definition, texel by texel and tile by tile.
    fn by_definition(source: &Raster, decoded: &Raster) -> Quality {
        let (width, height) = (source.size().width, source.size().height);
        let counted = counted_channels(source, decoded);
        let in_block: &[usize] = if source.info().has_extra() { &[0, 1, 2, 3] } else { &[0, 1, 2] };
        let step = |x: u32, y: u32, channel: usize| {
            let (a, b) = (source.texel(x, y), decoded.texel(x, y));
            f64::from(to_u8(a[channel]).abs_diff(to_u8(b[channel]))).powi(2)
        };
        let mean = |(left, top): (u32, u32), side: u32, channels: &[usize]| {
            let (mut sum, mut count) = (0.0, 0);
            for y in top..(top + side).min(height) {
                for x in left..(left + side).min(width) {
                    let is_hidden = source.info().hides_colors() && to_u8(source.texel(x, y).w) == 0;
                    for &channel in channels.iter().filter(|&&channel| channel == 3 || !is_hidden) {
                        sum += step(x, y, channel);
                        count += 1;
                    }
                }
            }
            (sum, count)
        };
        let worst = |side: u32, channels: &[usize]| {
            let corners = (0..height)
                .step_by(side as usize)
                .flat_map(|y| (0..width).step_by(side as usize).map(move |x| (x, y)));
            corners
                .map(|corner| mean(corner, side, channels))
                .map(|(sum, n)| sum / (n as f64).max(1.0))
                .fold(0.0, f64::max)
        };
        let all = |channels: &[usize]| {
            let (sum, count) = mean((0, 0), width.max(height), channels);
            SquaredError { sum, count }
        };
        Quality {
            color: all(counted),
            alpha: source.info().has_alpha().then(|| all(&[3])),
            worst_block_rms: worst(4, in_block).sqrt(),
            worst_tile_mse: worst(64, counted),
        }
    }

    #[test]
    fn bytes_and_floats_have_the_errors_of_the_definition() {
        let mut rng = Rng::new(3);
        for (channels, alpha) in [
            (1, Alpha::Straight),
            (2, Alpha::Straight),
            (3, Alpha::Band),
            (4, Alpha::Straight),
            (4, Alpha::Band),
        ] {
            for (width, height) in [(1, 1), (67, 66), (130, 9)] {
                let mut image = |clear: u8| {
                    let bytes: Vec<u8> = (0..width * height * u32::from(channels))
                        .map(|at| match at {
                            0 => clear,
                            // Some alpha of the source is 0.
                            at if clear == 0 && at / 8 % 3 == 1 => 0,
                            _ => rng.below(256) as u8,
                        })
                        .collect();
                    Raster::from_u8(width, height, channels, ColorSpace::Srgb, &bytes)
                        .unwrap()
                        .tagged(ColorSpace::Srgb, alpha)
                };
                let (a, b) = (image(0), image(9));
                let floats = |image: &Raster| {
                    Raster::new(width, height, image.info(), image.values().collect()).unwrap()
                };
                let wanted = by_definition(&a, &b);
                let found = compare(&a, &b);
                assert!((found.worst_block_rms - wanted.worst_block_rms).abs() < 1e-9);
                assert!((found.worst_tile_mse - wanted.worst_tile_mse).abs() < 1e-9);
                assert_eq!((found.color, found.alpha), (wanted.color, wanted.alpha), "{channels} {width}");
                assert_eq!(compare(&floats(&a), &b), found);
                assert_eq!(compare(&a, &floats(&b)), found);
            }
        }
    }
}
