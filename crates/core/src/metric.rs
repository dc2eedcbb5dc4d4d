//! Quality figures, each defined once, all taken from 8-bit output, or from 8 bits of the range up to [`Raster::peak`] of the source.
//!
//! * squared error: over the colour channels (1 for gray, 3 for RGB) of all texels, in 8-bit units; alpha apart.
//! * PSNR = 10 log10(255^2 / MSE) dB; a lossless result reads [`PSNR_LOSSLESS`].
//! * RMS = sqrt(MSE), 8-bit units.
//! * SSIM: Wang, Bovik, Sheikh and Simoncelli 2004: Gaussian window of sigma 1.5 cut at 11x11, K1 = 0.01,
//!   K2 = 0.03, biased covariances, the mean over all places where the window fits (over all places, mirrored at
//!   the edges, where the image is smaller), then over the colour channels.

mod compare;
mod ssim;

use rayon::prelude::*;

use crate::image::{Depth, ImageSet, ImageSize, Raster, to_u8, write_texels};
use crate::target::{Goal, Measured};
use crate::{CancelCheck, EncodeError, Encoded, Image2d, Rect, RegionError, Texel};
pub use compare::compare;
pub use ssim::ssim;

/// MSE below which a result counts as lossless: no 8-bit image can have a smaller one that is not 0.
pub const MSE_FLOOR: f64 = 1e-9;
/// PSNR of a lossless result in dB: that of [`MSE_FLOOR`].
pub const PSNR_LOSSLESS: f64 = 138.130_803_608_679_1;

/// A sum of squared errors in 8-bit units and how many values went in; sums of several images add.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SquaredError {
    /// Sum of squared differences.
    pub sum: f64,
    /// Number of values.
    pub count: u64,
}

impl std::ops::Add for SquaredError {
    type Output = SquaredError;
    fn add(self, other: SquaredError) -> SquaredError {
        SquaredError { sum: self.sum + other.sum, count: self.count + other.count }
    }
}

impl SquaredError {
    /// Mean squared error in 8-bit units.
    #[must_use]
    pub fn mse(self) -> f64 {
        self.sum / self.count.max(1) as f64
    }

    /// Root of the mean squared error in 8-bit units.
    #[must_use]
    pub fn rms(self) -> f64 {
        self.mse().sqrt()
    }

    /// PSNR in dB against a peak of 255.
    #[must_use]
    pub fn psnr(self) -> f64 {
        10.0 * (255.0 * 255.0 / self.mse().max(MSE_FLOOR)).log10()
    }
}

/// Squared error of the colour channels, and of a band, of two images; see [`compare`].
#[must_use]
pub fn color_error(source: &Raster, decoded: &Raster) -> SquaredError {
    compare(source, decoded).color
}

/// Squared error of alpha; `None` where the source has none.
#[must_use]
pub fn alpha_error(source: &Raster, decoded: &Raster) -> Option<SquaredError> {
    compare(source, decoded).alpha
}

/// Channels of texels that count as colours in one of two images.
fn counted_channels(a: &Raster, b: &Raster) -> &'static [usize] {
    let (a, b) = (a.info().counted_channels(), b.info().counted_channels());
    if a.len() < b.len() { b } else { a }
}

/// Rows of texels that one thread decodes: a multiple of every codec's blocks, so that none is decoded twice.
pub const BAND_ROWS: u32 = 64;

/// Level `level` of image `image` of an encoded texture, decoded on several threads; `None` where there is no such image
/// or level.
#[must_use]
pub fn decode_image(encoded: &dyn Encoded<Domain = Image2d>, image: u32, level: u32) -> Option<Raster> {
    decode_rect(encoded, encoded.layout().whole(image, level)?)
}

/// A rectangle of an encoded texture, decoded on several threads; `None` where it is empty or leaves its level.
#[must_use]
pub fn decode_rect(encoded: &dyn Encoded<Domain = Image2d>, rect: Rect) -> Option<Raster> {
    decode_rect_of(encoded, rect, CancelCheck::default())
}

/// Level 0 of image `image`, as [`decode_image`] decodes it; pixels of 8 bits are rounded to them, as metrics round, and take a quarter of
/// the memory.
#[must_use]
pub fn decode_rounded(encoded: &dyn Encoded<Domain = Image2d>, image: u32) -> Option<Raster> {
    let layout = encoded.layout();
    let rect = layout.whole(image, 0)?;
    let pixel = layout.pixel_of(image);
    if pixel.depth != Depth::Eight {
        return decode_rect(encoded, rect);
    }
    layout.check(rect).ok().filter(|()| rect.width > 0 && rect.height > 0)?;
    let row = rect.width as usize * usize::from(pixel.channels);
    let mut bytes = vec![0; row * rect.height as usize];
    let bands = bytes.par_chunks_mut(row * BAND_ROWS as usize).enumerate();
    let decode = |(band, out): (usize, &mut [u8])| {
        let (y, height) = (BAND_ROWS * band as u32, (out.len() / row) as u32);
        let mut texels = vec![[0; 4]; rect.width as usize * height as usize];
        encoded.decode_rgba8(Rect { y, height, ..rect }, &mut texels)?;
        write_texels(texels, pixel.channels, out, |value| value);
        Ok::<_, RegionError>(())
    };
    bands.try_for_each(decode).ok()?;
    Raster::of_bytes(ImageSize { width: rect.width, height: rect.height }, pixel, bytes).ok()
}

/// As [`decode_rect`]; of no use once the job is cancelled.
fn decode_rect_of(
    encoded: &dyn Encoded<Domain = Image2d>,
    rect: Rect,
    cancel: CancelCheck<'_>,
) -> Option<Raster> {
    let data = decode_values(encoded, rect, cancel, |value| value)?;
    Raster::new(rect.width, rect.height, encoded.layout().pixel_of(rect.image), data).ok()
}

/// The values of a rectangle, each turned by `of`.
fn decode_values<T: Clone + Default + Send>(
    encoded: &dyn Encoded<Domain = Image2d>,
    rect: Rect,
    cancel: CancelCheck<'_>,
    of: impl Fn(f32) -> T + Sync,
) -> Option<Vec<T>> {
    let layout = encoded.layout();
    layout.check(rect).ok().filter(|()| rect.width > 0 && rect.height > 0)?;
    let channels = layout.pixel_of(rect.image).channels;
    let row = rect.width as usize * usize::from(channels);
    let mut data = vec![T::default(); row * rect.height as usize];
    let bands = data.par_chunks_mut(row * BAND_ROWS as usize).enumerate();
    let decode = |(band, out): (usize, &mut [T])| {
        if cancel.is_cancelled() {
            return Ok(());
        }
        let texels = decode_band(encoded, rect, BAND_ROWS * band as u32)?;
        write_texels(texels.iter().map(Texel::to_array), channels, out, &of);
        Ok::<_, RegionError>(())
    };
    bands.try_for_each(decode).ok()?;
    (!cancel.is_cancelled()).then_some(data)
}

/// At most [`BAND_ROWS`] rows of a rectangle, from row `top` of it on.
fn decode_band(
    encoded: &dyn Encoded<Domain = Image2d>,
    rect: Rect,
    top: u32,
) -> Result<Vec<Texel>, RegionError> {
    let height = BAND_ROWS.min(rect.height - top);
    let mut texels = vec![Texel::ZERO; rect.width as usize * height as usize];
    encoded.decode(Rect { y: rect.y + top, height, ..rect }, &mut texels)?;
    Ok(texels)
}

/// How an encoded texture differs from its source, all images together.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Quality {
    /// Error of the colour channels.
    pub color: SquaredError,
    /// Error of alpha, where there is any.
    pub alpha: Option<SquaredError>,
    /// RMS error over colour and alpha of the worst 4x4 block, 8-bit units; blocks at the edge count what is inside.
    pub worst_block_rms: f64,
    /// Mean squared error of colours in the worst of the tiles of 64x64 texels that images are cut into from their upper left
    /// corners; tiles at the edge count what is inside.
    pub worst_tile_mse: f64,
}

impl Quality {
    /// Quality of these and of other texels together.
    #[must_use]
    pub fn and(self, other: Quality) -> Quality {
        let alpha = match (self.alpha, other.alpha) {
            (Some(one), Some(other)) => Some(one + other),
            (one, other) => one.or(other),
        };
        Quality {
            color: self.color + other.color,
            alpha,
            worst_block_rms: self.worst_block_rms.max(other.worst_block_rms),
            worst_tile_mse: self.worst_tile_mse.max(other.worst_tile_mse),
        }
    }

    /// PSNR in dB of colours in the worst tile of 64x64 texels.
    #[must_use]
    pub fn psnr_worst_tile(&self) -> f64 {
        SquaredError { sum: self.worst_tile_mse, count: 1 }.psnr()
    }

    /// What a goal of quality is held against, in dB: the worse of colours and alpha.
    #[must_use]
    pub fn psnr(&self) -> f64 {
        let color = self.color.psnr();
        self.alpha.map_or(color, |alpha| alpha.psnr().min(color))
    }

    /// Errors of colours of that sum, however counted, and of alpha together.
    #[must_use]
    pub fn with_alpha(&self, color: f64) -> SquaredError {
        let sum = color + self.alpha.map_or(0.0, |alpha| alpha.sum);
        SquaredError { sum, count: self.color.count.max(self.alpha.map_or(0, |alpha| alpha.count)) }
    }

    /// As that goal judges a texture of this quality: PSNR is [`Quality::psnr`] for a goal of PSNR, that of the errors of colours and
    /// alpha together for one of bits, else that of colours.
    #[must_use]
    pub fn judged(&self, goal: Goal, source: &ImageSet, encoded: &dyn Encoded<Domain = Image2d>) -> Measured {
        let psnr = match goal {
            Goal::Psnr(_) => self.psnr(),
            Goal::Bpp(_) => self.with_alpha(self.color.sum).psnr(),
            Goal::Tolerance(_) => self.color.psnr(),
        };
        Measured { psnr, ..measured(source, encoded, *self) }
    }
}

/// Decodes level 0 of every image and compares it with the source.
#[must_use]
pub fn quality(source: &ImageSet, encoded: &dyn Encoded<Domain = Image2d>) -> Quality {
    quality_of(source, encoded, CancelCheck::default())
}

/// As [`quality`], with a look at whether to stop every few thousand texels.
///
/// # Errors
/// [`EncodeError::Cancelled`] where the caller asked to stop.
pub fn quality_cancellable(
    source: &ImageSet,
    encoded: &dyn Encoded<Domain = Image2d>,
    cancel: CancelCheck<'_>,
) -> Result<Quality, EncodeError> {
    let quality = quality_of(source, encoded, cancel);
    cancel.checkpoint()?;
    Ok(quality)
}

/// As [`quality`]; of no use once the job is cancelled.
fn quality_of(
    source: &ImageSet,
    encoded: &dyn Encoded<Domain = Image2d>,
    cancel: CancelCheck<'_>,
) -> Quality {
    let mut quality = Quality::default();
    for (index, image) in source.images().iter().enumerate() {
        let Some(whole) = encoded.layout().whole(index as u32, 0) else { continue };
        let Some(found) = quality_of_image(image, encoded, whole, cancel) else { continue };
        quality = quality.and(found);
    }
    quality
}

/// Band by band, so that no more than a band a thread is held decoded.
fn quality_of_image(
    image: &Raster,
    encoded: &dyn Encoded<Domain = Image2d>,
    whole: Rect,
    cancel: CancelCheck<'_>,
) -> Option<Quality> {
    let (size, pixel) = (image.size(), encoded.layout().pixel_of(whole.image));
    if (size.width, size.height) != (whole.width, whole.height) {
        let decoded = decode_rect_of(encoded, whole, cancel)?;
        return Some(compare(image, &decoded));
    }
    let of_band = |top: u32| -> Option<Quality> {
        if cancel.is_cancelled() {
            return None;
        }
        let texels = decode_band(encoded, whole, top).ok()?;
        let rows = texels.len() as u32 / size.width;
        let (size, values) = (ImageSize { height: rows, ..size }, texels.len() * usize::from(pixel.channels));
        // As metrics round.
        let decoded = if pixel.depth == Depth::Eight {
            let mut bytes = vec![0; values];
            write_texels(texels.iter().map(Texel::to_array), pixel.channels, &mut bytes, to_u8);
            Raster::of_bytes(size, pixel, bytes).ok()?
        } else {
            let mut data = vec![0.0; values];
            write_texels(texels.iter().map(Texel::to_array), pixel.channels, &mut data, |value| value);
            Raster::new(size.width, rows, pixel, data).ok()?
        };
        Some(compare::of_band(image, (&decoded, 0), top))
    };
    let bands: Vec<u32> = (0..size.height).step_by(BAND_ROWS as usize).collect();
    let bands: Option<Vec<Quality>> = bands.into_par_iter().map(of_band).collect();
    bands?.into_iter().reduce(Quality::and)
}

/// [`quality`], and the bits a source texel that [`MemoryBits::goal`] defines; PSNR is that of colours.
///
/// [`MemoryBits::goal`]: crate::MemoryBits::goal
#[must_use]
pub fn measure(source: &ImageSet, encoded: &dyn Encoded<Domain = Image2d>) -> Measured {
    measured(source, encoded, quality(source, encoded))
}

/// As [`Quality::judged`] says, with a look before every 64 rows
/// that are decoded and compared at whether to stop.
///
/// # Errors
/// [`EncodeError::Cancelled`] where the caller asked to stop.
pub fn measure_for(
    goal: Goal,
    source: &ImageSet,
    encoded: &dyn Encoded<Domain = Image2d>,
    cancel: CancelCheck<'_>,
) -> Result<Measured, EncodeError> {
    Ok(quality_cancellable(source, encoded, cancel)?.judged(goal, source, encoded))
}

fn measured(source: &ImageSet, encoded: &dyn Encoded<Domain = Image2d>, quality: Quality) -> Measured {
    Measured {
        psnr: quality.color.psnr(),
        bpp: encoded.memory().goal as f64 / source.texel_count() as f64,
        worst_block_rms: quality.worst_block_rms,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Alpha, ColorSpace};

    #[test]
    fn psnr_of_known_errors() {
        let a = Raster::from_u8(2, 1, 3, ColorSpace::Srgb, &[10, 20, 30, 40, 50, 60]).unwrap();
        let b = Raster::from_u8(2, 1, 3, ColorSpace::Srgb, &[11, 20, 30, 40, 48, 60]).unwrap();
        let error = color_error(&a, &b);
        assert_eq!((error.sum, error.count), (5.0, 6));
        assert!((error.psnr() - 48.922_612).abs() < 1e-5, "{}", error.psnr());
        assert!((color_error(&a, &a).psnr() - PSNR_LOSSLESS).abs() < 1e-9);
    }

    #[test]
    fn the_worst_tile_is_found_wherever_it_lies() {
        let of = |value: &dyn Fn(u32, u32) -> u8| {
            let bytes: Vec<u8> = (0..100 * 70).map(|i| value(i % 100, i / 100)).collect();
            Raster::from_u8(100, 70, 1, ColorSpace::Srgb, &bytes).unwrap()
        };
        let source = of(&|_, _| 50);
        for (column, row) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let decoded = of(&|x, y| if (x / 64, y / 64) == (column, row) { 60 } else { 51 });
            let wanted = SquaredError { sum: 100.0, count: 1 }.psnr();
            assert!((compare(&source, &decoded).psnr_worst_tile() - wanted).abs() < 1e-9, "{column} {row}");
        }
    }

    #[test]
    fn alpha_is_counted_apart() {
        let a = Raster::from_u8(1, 1, 4, ColorSpace::Srgb, &[1, 2, 3, 100]).unwrap();
        let b = Raster::from_u8(1, 1, 4, ColorSpace::Srgb, &[1, 2, 3, 90]).unwrap();
        assert_eq!(color_error(&a, &b).sum, 0.0);
        assert_eq!(alpha_error(&a, &b), Some(SquaredError { sum: 100.0, count: 1 }));
        let opaque = Raster::from_u8(1, 1, 3, ColorSpace::Srgb, &[1, 2, 3]).unwrap();
        assert_eq!(alpha_error(&opaque, &b), None);
    }

    #[test]
    fn deep_sources_are_measured_against_their_own_peak() {
        let of = |values: &[u16]| Raster::from_u16(4, 1, 1, ColorSpace::Linear, values).unwrap();
        let source = of(&[0, 2047, 1024, 512]).with_own_peak();
        let gray = of(&[1024; 4]);
        // By hand: 8-bit steps of 128, 127, 0 and 64.
        let sum = f64::from(128 * 128 + 127 * 127 + 64 * 64);
        assert_eq!(color_error(&source, &gray), SquaredError { sum, count: 4 });
        assert!((compare(&source, &gray).worst_block_rms - (sum / 4.0).sqrt()).abs() < 1e-9);
        assert!(color_error(&of(&[0, 2047, 1024, 512]), &gray).psnr() > 35.0);
        assert!(ssim(&source, &gray) < 0.9);
    }

    #[test]
    fn a_band_counts_as_colours_do() {
        let of = |channels, bytes: &[u8]| {
            Raster::from_u8(1, 1, channels, ColorSpace::Srgb, bytes)
                .unwrap()
                .tagged(ColorSpace::Srgb, Alpha::Band)
        };
        let (a, b) = (of(4, &[1, 2, 3, 100]), of(4, &[1, 2, 3, 90]));
        assert_eq!(color_error(&a, &b), SquaredError { sum: 100.0, count: 4 });
        assert_eq!(alpha_error(&a, &b), None);
        let (a, b) = (of(2, &[1, 100]), of(2, &[3, 90]));
        assert_eq!(color_error(&a, &b), SquaredError { sum: 104.0, count: 2 });
        assert!(ssim(&a, &b) < 0.99);
    }
}
