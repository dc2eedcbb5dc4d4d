//! SSIMULACRA2 and butteraugli: how alike two images are to the eye.
//!
//! Sources: Sneyers, "SSIMULACRA 2 - Structural SIMilarity Unveiling Local And Compression Related Artifacts", 2022, computed by the
//! crate `fast-ssim2`: 100 is identical, 90 not to be told apart at a usual distance, 70 high, 50 medium and 30 low quality.
//! Alakuijala and others, "Guetzli: perceptually guided JPEG encoder", 2017, as libjxl has it, computed by the crate `butteraugli`: 0 is
//! identical, 1 is about what can just be seen side by side.

use butteraugli::{ButteraugliParams, ImgRef, RGB8};
use fast_ssim2::{PixelDescriptor, PixelSlice, compute_ssimulacra2};
use rayon::prelude::*;
use texfold_core::image::{ColorSpace, Raster, to_u8};
use texfold_core::metric::{Quality, compare, ssim};
use texfold_core::{ImageSize, Texel};

/// Likeness of a decoded image to its source of the same size.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Likeness {
    pub(crate) quality: Quality,
    pub(crate) ssim: f64,
    pub(crate) ssimulacra2: Option<f64>,
}

impl Likeness {
    pub(crate) fn of(image: &Raster, decoded: &Raster) -> Likeness {
        let (quality, (ssim, ssimulacra2)) = rayon::join(
            || compare(image, decoded),
            || rayon::join(|| ssim(image, decoded), || ssimulacra2(image, decoded)),
        );
        Likeness { quality, ssim, ssimulacra2 }
    }
}

/// Longest side of what is compared at a time: the crate holds many planes of it in floats.
const TILE: u32 = 1024;
/// Bytes that comparing a tile takes, and how many for each texel of the image may be taken: so many tiles are compared at a time, at
/// least [`TILES`].
const TILE_BYTES: u64 = 80 << 20;
const BYTES_PER_TEXEL: u64 = 10;
const TILES: u64 = 4;
/// Least side that the figure is defined for.
const LEAST_SIDE: u32 = 8;

/// SSIMULACRA2 of `decoded` against `image`, of the same size, both in 8 bits; colours with alpha count as over black. Larger images than
/// 1024 x 1024 are cut into equal tiles, whose mean counts, each weighted by its texels. `None` for images that are no sRGB
/// colours, have a side below 8 texels, or differ in size.
#[must_use]
pub fn ssimulacra2(image: &Raster, decoded: &Raster) -> Option<f64> {
    by_tiles(image, decoded, |[image, decoded], ImageSize { width, height }| {
        let row = 3 * width as usize;
        let slice = |bytes| PixelSlice::new(bytes, width, height, row, PixelDescriptor::RGB8_SRGB).ok();
        compute_ssimulacra2(&slice(image)?, &slice(decoded)?).ok()
    })
}

/// The 3-norm of butteraugli's differences (libjxl's, the mean of the norms of 3, 6 and 12) at 80 nits, of images as for
/// [`ssimulacra2`]; the cubes of tiles are averaged.
#[must_use]
pub fn butteraugli(image: &Raster, decoded: &Raster) -> Option<f64> {
    let cubes = by_tiles(image, decoded, |tiles, ImageSize { width, height }| {
        let [image, decoded] = tiles.map(|bytes| -> Vec<RGB8> {
            bytes.chunks_exact(3).map(|texel| RGB8::new(texel[0], texel[1], texel[2])).collect()
        });
        let [image, decoded] =
            [&image, &decoded].map(|texels| ImgRef::new(texels, width as usize, height as usize));
        let found = butteraugli::butteraugli(image, decoded, &ButteraugliParams::default()).ok()?;
        Some(found.pnorm_3.powi(3))
    });
    cubes.map(f64::cbrt)
}

/// Mean of what `of` finds of each tile of both images, their bytes.
fn by_tiles(
    image: &Raster,
    decoded: &Raster,
    of: impl Fn([&[u8]; 2], ImageSize) -> Option<f64> + Sync,
) -> Option<f64> {
    let size = image.size();
    let small = size.width.min(size.height) < LEAST_SIDE;
    if image.info().color != ColorSpace::Srgb || small || decoded.size() != size {
        return None;
    }
    let tiles: Vec<_> =
        parts(size.height).flat_map(|rows| parts(size.width).map(move |columns| (columns, rows))).collect();
    let of_tile = |((x, width), (y, height)): ((u32, u32), (u32, u32))| {
        let (corner, size) = ((x, y), ImageSize { width, height });
        let [image, decoded] =
            [image, decoded].map(|raster| bytes(raster, corner, size, image.peak().recip()));
        Some(of([&image, &decoded], size)? * size.texels() as f64)
    };
    let at_once = (size.texels() * BYTES_PER_TEXEL / TILE_BYTES).max(TILES) as usize;
    let sums = tiles
        .chunks(at_once)
        .flat_map(|tiles| -> Vec<Option<f64>> { tiles.par_iter().copied().map(of_tile).collect() });
    Some(sums.sum::<Option<f64>>()? / size.texels() as f64)
}

/// First texel and length of each of the nearly equal parts of a side.
fn parts(side: u32) -> impl Iterator<Item = (u32, u32)> {
    let count = side.div_ceil(TILE);
    let start = move |part: u32| (u64::from(side) * u64::from(part) / u64::from(count)) as u32;
    (0..count).map(move |part| (start(part), start(part + 1) - start(part)))
}

/// Colours of a tile, times `gain`, in bytes over black.
fn bytes(raster: &Raster, (x, y): (u32, u32), size: ImageSize, gain: f32) -> Vec<u8> {
    let has_alpha = raster.info().has_alpha();
    let over_black =
        |texel: Texel| if has_alpha { gain * texel.truncate() * texel.w } else { gain * texel.truncate() };
    let row = |y: u32| (x..x + size.width).map(move |x| over_black(raster.texel(x, y)).to_array().map(to_u8));
    (y..y + size.height).flat_map(row).collect::<Vec<_>>().into_flattened()
}

/// The mean of figures, each with its weight; `None` where one is missing or there are none.
pub(crate) fn mean(figures: impl Iterator<Item = (Option<f64>, f64)>) -> Option<f64> {
    let mut sums = (0.0, 0.0);
    for (figure, weight) in figures {
        sums = (sums.0 + figure? * weight, sums.1 + weight);
    }
    (sums.1 > 0.0).then(|| sums.0 / sums.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_images_are_the_best_and_blurred_ones_worse() {
        let image = texfold_testkit::image("facade");
        assert_eq!(butteraugli(&image, &image), Some(0.0));
        assert!(ssimulacra2(&image, &image).is_some_and(|found| (found - 100.0).abs() < 1e-6));
        let size = image.size();
        let blurred: Vec<Texel> = (0..size.width * size.height)
            .map(|at| image.texel(at % size.width / 4 * 4, at / size.width / 4 * 4))
            .collect();
        let blurred = Raster::from_texels(size.width, size.height, image.info(), &blurred).unwrap();
        assert!(ssimulacra2(&image, &blurred).is_some_and(|found| found < 40.0));
        assert!(butteraugli(&image, &blurred).is_some_and(|found| found > 3.0));
        let [small, other] = ["odd_37x61", "facade"].map(texfold_testkit::image);
        assert_eq!((ssimulacra2(&small, &other), butteraugli(&small, &other)), (None, None));
        let normals = image.clone().tagged(ColorSpace::Linear, image.info().alpha);
        assert_eq!(ssimulacra2(&normals, &normals), None);
    }

    #[test]
    fn parts_of_a_side_are_nearly_equal_and_cover_it() {
        for side in [8, 1024, 1025, 3000, 16_384] {
            let parts: Vec<(u32, u32)> = parts(side).collect();
            assert_eq!(parts.iter().map(|part| part.1).sum::<u32>(), side);
            assert!(parts.windows(2).all(|pair| pair[0].0 + pair[0].1 == pair[1].0));
            assert!(parts.iter().all(|part| part.1 <= TILE && part.1 >= TILE.min(side) / 2));
        }
        assert_eq!(mean([(Some(80.0), 1.0), (Some(60.0), 3.0)].into_iter()), Some(65.0));
        assert_eq!(mean([(Some(80.0), 1.0), (None, 3.0)].into_iter()), None);
    }
}
