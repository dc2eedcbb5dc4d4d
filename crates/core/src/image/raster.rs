//! Images in memory: 1 to 4 channels in the depth of their source, tagged with what they mean.

use glam::Vec4;

use super::{Alpha, ColorSpace, Depth, ImageSize, PixelInfo};
use crate::{Rect, SourceError, Texel};

/// The largest value of the deepest source.
const DEEPEST: f32 = u16::MAX as f32;
/// Most bits of sensors.
const SENSOR_BITS: u32 = 14;

/// An image: `height` rows of `width` texels of 1 to 4 interleaved channels, values nominally in [0, 1]. Sources of 8 and 16 bits
/// take 1 and 2 bytes a value, others 4. Images are equal where their values are, whatever they are held in.
#[derive(Debug, Clone)]
pub struct Raster {
    size: ImageSize,
    info: PixelInfo,
    data: Values,
    /// The value that errors are measured against.
    peak: f32,
}

impl Raster {
    /// Takes `data`, row by row from the top, channels interleaved.
    ///
    /// # Errors
    /// [`SourceError`]: a side of 0, channels other than 1 to 4, a wrong length, or values that are not finite.
    pub fn new(width: u32, height: u32, info: PixelInfo, data: Vec<f32>) -> Result<Self, SourceError> {
        if data.iter().any(|value| !value.is_finite()) {
            return Err(SourceError::NotFinite { index: 0 });
        }
        Raster::of(width, height, info, Values::Float(data))
    }

    /// The values of a source of 8 bits.
    #[cfg(feature = "encode")]
    pub(crate) fn bytes(&self) -> Option<&[u8]> {
        match &self.data {
            Values::Eight(bytes) => Some(bytes),
            _ => None,
        }
    }

    /// An image of bytes in the channels of `info`; opaque alpha is kept.
    #[cfg(feature = "encode")]
    pub(crate) fn of_bytes(size: ImageSize, info: PixelInfo, bytes: Vec<u8>) -> Result<Self, SourceError> {
        Raster::of(size.width, size.height, info, Values::Eight(bytes))
    }

    fn of(width: u32, height: u32, info: PixelInfo, data: Values) -> Result<Self, SourceError> {
        if width == 0 || height == 0 {
            return Err(SourceError::ZeroSize { index: 0, width, height });
        }
        if !(1..=4).contains(&info.channels) {
            return Err(SourceError::Channels { channels: info.channels });
        }
        let size = ImageSize { width, height };
        let needed = usize::try_from(size.texels().saturating_mul(u64::from(info.channels)));
        let needed = needed.unwrap_or(usize::MAX);
        if data.len() != needed {
            return Err(SourceError::Length { found: data.len(), needed });
        }
        Ok(Raster { size, info, data, peak: 1.0 })
    }

    /// From bytes: 0 is 0.0, 255 is 1.0. Fully opaque alpha is dropped.
    ///
    /// # Errors
    /// As [`Raster::new`].
    pub fn from_u8(
        width: u32,
        height: u32,
        channels: u8,
        color: ColorSpace,
        bytes: &[u8],
    ) -> Result<Self, SourceError> {
        let alpha = if channels.is_multiple_of(2) { Alpha::Straight } else { Alpha::Opaque };
        let info = PixelInfo { channels, depth: Depth::Eight, color, alpha };
        Raster::of(width, height, info, Values::Eight(bytes.to_vec())).map(Raster::without_opaque_alpha)
    }

    /// From 16-bit values: 0 is 0.0, 65535 is 1.0. Fully opaque alpha is dropped.
    ///
    /// # Errors
    /// As [`Raster::new`].
    pub fn from_u16(
        width: u32,
        height: u32,
        channels: u8,
        color: ColorSpace,
        values: &[u16],
    ) -> Result<Self, SourceError> {
        let alpha = if channels.is_multiple_of(2) { Alpha::Straight } else { Alpha::Opaque };
        let info = PixelInfo { channels, depth: Depth::Sixteen, color, alpha };
        Raster::of(width, height, info, Values::Sixteen(values.to_vec())).map(Raster::without_opaque_alpha)
    }

    /// Drops an alpha channel that is 1 everywhere: an opaque image need not pay for it.
    fn without_opaque_alpha(self) -> Self {
        if !self.info.has_alpha() || self.texels().any(|texel| texel.w < 1.0) {
            return self;
        }
        self.with_channels(self.info.channels - 1)
    }

    /// A map in RGB of values from 0 to 1: black, red, yellow and white for 0, 1/3, 2/3 and 1.
    ///
    /// # Errors
    /// [`SourceError`] for a size of 0 or beyond the limits.
    pub fn heat_map(size: ImageSize, value: impl Fn(u32, u32) -> f32) -> Result<Raster, SourceError> {
        let info = PixelInfo { channels: 3, color: ColorSpace::Srgb, ..PixelInfo::default() };
        let texel = |at: u32| {
            let value = value(at % size.width, at / size.width);
            let ramp = |from: f32| (3.0 * value - from).clamp(0.0, 1.0);
            Texel::new(ramp(0.0), ramp(1.0), ramp(2.0), 1.0)
        };
        let texels: Vec<Texel> = (0..size.width * size.height).map(texel).collect();
        Raster::from_texels(size.width, size.height, info, &texels)
    }

    /// From texels, keeping the channels that `info` names.
    ///
    /// # Errors
    /// As [`Raster::new`].
    pub fn from_texels(
        width: u32,
        height: u32,
        info: PixelInfo,
        texels: &[Texel],
    ) -> Result<Self, SourceError> {
        Raster::new(width, height, info, split_texels(texels.iter().copied(), info.channels))
    }

    /// Columns and rows.
    #[must_use]
    pub fn size(&self) -> ImageSize {
        self.size
    }

    /// What the channels are.
    #[must_use]
    pub fn info(&self) -> PixelInfo {
        self.info
    }

    /// The same image with another reading of its values.
    #[must_use]
    pub fn tagged(mut self, color: ColorSpace, alpha: Alpha) -> Self {
        self.info.color = color;
        self.info.alpha = if self.info.has_extra() { alpha } else { Alpha::Opaque };
        self
    }

    /// The same image, made of `channels` channels, whose second or fourth counts as colours do. What was dropped as fully opaque alpha is
    /// there again.
    #[must_use]
    pub fn with_band(self, channels: u8) -> Self {
        let extra = channels.is_multiple_of(2);
        let (all, color) = (self.info.color_channels() + u8::from(extra), self.info.color);
        self.with_channels(all).tagged(color, if extra { Alpha::Band } else { Alpha::Opaque })
    }

    /// The texels of a rectangle, as far as it lies inside; at least one. `rect.image` and `rect.level` do not count.
    #[must_use]
    pub fn crop(&self, rect: Rect) -> Raster {
        let side = |first: u32, count: u32, all: u32| {
            let first = first.min(all - 1);
            (first..first + count.clamp(1, all - first)).collect::<Vec<u32>>()
        };
        self.pick(&side(rect.x, rect.width, self.size.width), &side(rect.y, rect.height, self.size.height))
    }

    /// The texels of some columns in some rows, each clamped to the image; of none the first.
    #[must_use]
    pub fn pick(&self, columns: &[u32], rows: &[u32]) -> Raster {
        let or_first = |places: &[u32]| if places.is_empty() { vec![0] } else { places.to_vec() };
        let (columns, rows) = (or_first(columns), or_first(rows));
        let channels = usize::from(self.info.channels);
        let places = rows.iter().flat_map(|&y| columns.iter().map(move |&x| (x, y)));
        let texels = places.map(|(x, y)| self.number(x, y) * channels);
        let data = match &self.data {
            Values::Eight(values) => Values::Eight(joined(values, texels, channels)),
            Values::Sixteen(values) => Values::Sixteen(joined(values, texels, channels)),
            Values::Float(values) => Values::Float(joined(values, texels, channels)),
        };
        let size = ImageSize { width: columns.len() as u32, height: rows.len() as u32 };
        Raster { size, data, ..*self }
    }

    /// The same image with exactly `channels` channels: gray is copied to RGB, missing alpha is 1, and
    /// what `channels` has no room for is dropped (RGB to gray keeps red).
    #[must_use]
    pub fn with_channels(&self, channels: u8) -> Raster {
        let channels = channels.clamp(1, 4);
        let data = self.data.with_channels(self.info.channels.into(), channels.into());
        let info = PixelInfo { channels, ..self.info };
        let alpha = match (self.info.has_extra(), info.has_extra()) {
            (true, true) => self.info.alpha,
            (false, true) => Alpha::Straight,
            (_, false) => Alpha::Opaque,
        };
        Raster { size: self.size, info: PixelInfo { alpha, ..info }, data, peak: self.peak }
    }

    /// The same image with one colour channel: the mean of red, green and blue, which is the gray with the least squared
    /// error.
    #[must_use]
    pub fn to_gray(&self) -> Raster {
        let extra = self.info.has_extra();
        let gray = |texel: &Texel| (texel.x + texel.y + texel.z) / 3.0;
        // Of known length, so that megatexels take no tenths of a second.
        let data = if extra {
            self.texels().map(|texel| [gray(&texel), texel.w]).collect::<Vec<_>>().into_flattened()
        } else {
            self.texels().map(|texel| gray(&texel)).collect()
        };
        let info = PixelInfo { channels: 1 + u8::from(extra), ..self.info };
        Raster { size: self.size, info, data: Values::Float(data), peak: self.peak }
    }

    /// The same image with its values rounded to 16 bits; those of sources of 8 and 16 bits are so already.
    pub(super) fn settled(mut self) -> Raster {
        if let Values::Float(values) = &mut self.data {
            let rounded = |value: f32| (value * DEEPEST).round();
            if values.iter().all(|&value| (0.0..=DEEPEST).contains(&rounded(value))) {
                self.data = Values::Sixteen(values.iter().map(|&value| rounded(value) as u16).collect());
            } else {
                values.iter_mut().for_each(|value| *value = rounded(*value) / DEEPEST);
            }
        }
        self
    }

    /// The same image, whose errors are measured against the bits that its colours and band use where it has 16: 0 to 2047 for a
    /// source of 11 bits, of which one gray would else be near enough. Sensors have up to 14 bits; what uses 15 is a dark image. Values
    /// stay.
    #[must_use]
    pub fn with_own_peak(self) -> Raster {
        let peak = self.own_peak();
        self.with_peak(peak)
    }

    /// The peak that [`Raster::with_own_peak`] takes, 0 where all values are 0: that of an image in parts is the largest of theirs.
    #[must_use]
    pub fn own_peak(&self) -> f32 {
        if self.info.depth != Depth::Sixteen {
            return 1.0;
        }
        let channels = usize::from(self.info.channels);
        let counted = channels - usize::from(self.info.has_alpha());
        let values = self.values().enumerate().filter(|(index, _)| index % channels < counted);
        let largest = values.map(|(_, value)| value).fold(0.0, f32::max);
        let largest = (largest.min(1.0) * DEEPEST).round() as u32;
        if largest < 1 << SENSOR_BITS {
            ((largest + 1).next_power_of_two() - 1) as f32 / DEEPEST
        } else {
            1.0
        }
    }

    /// The same image, whose errors are measured against a value above 0 and up to 1; 0 stands for 1.
    #[must_use]
    pub fn with_peak(self, peak: f32) -> Raster {
        Raster { peak: if peak > 0.0 { peak.min(1.0) } else { 1.0 }, ..self }
    }

    /// The value that errors are measured against: 1, or what [`Raster::with_own_peak`] found.
    #[must_use]
    pub fn peak(&self) -> f32 {
        self.peak
    }

    /// All values, channels interleaved.
    pub fn values(&self) -> impl ExactSizeIterator<Item = f32> + '_ {
        (0..self.data.len()).map(|index| self.data.value(index))
    }

    /// The value of channel `channel` of the texel at (`x`, `y`), in the order of the image's own channels; the place is clamped to
    /// the image, the channel to the last.
    #[must_use]
    pub fn value(&self, x: u32, y: u32, channel: usize) -> f32 {
        let channels = usize::from(self.info.channels);
        self.data.value(self.number(x, y) * channels + channel.min(channels - 1))
    }

    /// The number in row order of the texel at (`x`, `y`), both clamped to the image.
    fn number(&self, x: u32, y: u32) -> usize {
        let (x, y) = (x.min(self.size.width - 1) as usize, y.min(self.size.height - 1) as usize);
        y * self.size.width as usize + x
    }

    /// The texel at (`x`, `y`), both clamped to the image: gray is copied to RGB, missing alpha is 1.
    #[must_use]
    pub fn texel(&self, x: u32, y: u32) -> Texel {
        self.data.texel(self.number(x, y), self.info.channels.into())
    }

    /// All texels in row order.
    pub fn texels(&self) -> impl ExactSizeIterator<Item = Texel> + '_ {
        let channels = usize::from(self.info.channels);
        (0..self.data.len() / channels).map(move |number| self.data.texel(number, channels))
    }

    /// At most `count` texels in row order from number `start` on.
    #[cfg(feature = "encode")]
    pub(crate) fn texels_from(&self, start: usize, count: usize) -> impl Iterator<Item = Texel> + '_ {
        let channels = usize::from(self.info.channels);
        let end = (start + count).min(self.data.len() / channels);
        (start..end).map(move |number| self.data.texel(number, channels))
    }

    /// Interleaved bytes of the raster's own channels.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        match &self.data {
            Values::Eight(bytes) => bytes.clone(),
            _ => self.values().map(to_u8).collect(),
        }
    }
}

impl PartialEq for Raster {
    fn eq(&self, other: &Self) -> bool {
        let same = match (&self.data, &other.data) {
            (Values::Eight(a), Values::Eight(b)) => a == b,
            (Values::Sixteen(a), Values::Sixteen(b)) => a == b,
            _ => self.values().eq(other.values()),
        };
        same && (self.size, self.info, self.peak) == (other.size, other.info, other.peak)
    }
}

/// Values of an image, channels interleaved.
#[derive(Debug, Clone)]
enum Values {
    /// In units of 1/255.
    Eight(Vec<u8>),
    /// In units of 1/65535.
    Sixteen(Vec<u16>),
    Float(Vec<f32>),
}

impl Values {
    fn len(&self) -> usize {
        match self {
            Values::Eight(values) => values.len(),
            Values::Sixteen(values) => values.len(),
            Values::Float(values) => values.len(),
        }
    }

    #[inline]
    fn value(&self, index: usize) -> f32 {
        match self {
            Values::Eight(values) => f32::from(values[index]) / 255.0,
            Values::Sixteen(values) => f32::from(values[index]) / DEEPEST,
            Values::Float(values) => values[index],
        }
    }

    /// Texel `number` of texels of `channels` channels.
    #[inline]
    fn texel(&self, number: usize, channels: usize) -> Texel {
        let place = number * channels..(number + 1) * channels;
        match self {
            Values::Eight(values) => join_texel(&values[place], 255.0),
            Values::Sixteen(values) => join_texel(&values[place], DEEPEST),
            Values::Float(values) => join_texel(&values[place], 1.0),
        }
    }

    /// Texels of `before` channels with `after` instead; see [`Raster::with_channels`].
    fn with_channels(&self, before: usize, after: usize) -> Values {
        match self {
            Values::Eight(values) => Values::Eight(rejoined(values, before, after, u8::MAX)),
            Values::Sixteen(values) => Values::Sixteen(rejoined(values, before, after, u16::MAX)),
            Values::Float(values) => Values::Float(rejoined(values, before, after, 1.0)),
        }
    }
}

/// The texels that begin at such places.
fn joined<T: Copy>(values: &[T], texels: impl Iterator<Item = usize>, channels: usize) -> Vec<T> {
    texels.flat_map(|first| &values[first..first + channels]).copied().collect()
}

/// Texels with another number of channels, 1 to 4: gray is copied to red, green and blue, and `one` is alpha where there is none.
/// Of two channels the second is alpha.
fn rejoined<T: Copy>(values: &[T], before: usize, after: usize, one: T) -> Vec<T> {
    let place = |channel: usize| match (before, after, channel) {
        (1 | 3, 2, 1) | (1 | 3, 4, 3) => None,
        (2 | 4, 2, 1) | (2 | 4, 4, 3) => Some(before - 1),
        (1 | 2, _, _) => Some(0),
        _ => Some(channel),
    };
    let places: Vec<Option<usize>> = (0..after).map(place).collect();
    let mut out = vec![one; values.len() / before * after];
    for (out, from) in out.chunks_exact_mut(after).zip(values.chunks_exact(before)) {
        for (out, place) in out.iter_mut().zip(&places) {
            *out = place.map_or(one, |place| from[place]);
        }
    }
    out
}

/// Nearest byte of a value in [0, 1]; what is outside is clamped.
#[must_use]
pub fn to_u8(value: f32) -> u8 {
    // Adding a half and truncating rounds half up, as `floor(255 v + 0.5)` does in the shaders.
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

/// RGBA of texels, each value as [`to_u8`] rounds it.
pub fn to_rgba8(texels: &[Texel], out: &mut [[u8; 4]]) {
    for (out, texel) in out.iter_mut().zip(texels) {
        // Through 32 bits: vectors convert to those.
        *out = (texel.clamp(Vec4::ZERO, Vec4::ONE) * 255.0 + 0.5).to_array().map(|value| value as i32 as u8);
    }
}

/// The texel of 1 to 4 values in units of 1 / `one`.
#[inline]
fn join_texel<T: Copy + Into<f32>>(channels: &[T], one: f32) -> Texel {
    let texel = match *channels {
        [gray] => Vec4::splat(gray.into()).with_w(one),
        [gray, alpha] => Vec4::splat(gray.into()).with_w(alpha.into()),
        [red, green, blue] => Vec4::new(red.into(), green.into(), blue.into(), one),
        [red, green, blue, alpha] => Vec4::new(red.into(), green.into(), blue.into(), alpha.into()),
        _ => Vec4::ZERO,
    };
    texel / one
}

/// The channels of all texels; of two channels the second is alpha. Of known length, so that megatexels take no tenths of
/// a second.
fn split_texels(texels: impl ExactSizeIterator<Item = Texel>, channels: u8) -> Vec<f32> {
    match channels {
        1 => texels.map(|texel| texel.x).collect(),
        2 => texels.map(|texel| [texel.x, texel.w]).collect::<Vec<_>>().into_flattened(),
        3 => texels.map(|texel| texel.truncate().to_array()).collect::<Vec<_>>().into_flattened(),
        _ => texels.map(|texel| texel.to_array()).collect::<Vec<_>>().into_flattened(),
    }
}

/// Writes the channels of texels one after the other, each turned by `of`; of two channels the second is alpha.
#[cfg(feature = "encode")]
pub(crate) fn write_texels<V: Copy, T>(
    texels: impl IntoIterator<Item = [V; 4]>,
    channels: u8,
    out: &mut [T],
    of: impl Fn(V) -> T,
) {
    for (out, texel) in out.chunks_exact_mut(channels.clamp(1, 4).into()).zip(texels) {
        let [red, _, _, alpha] = texel;
        match out {
            [gray] => *gray = of(red),
            [gray, alpha_out] => (*gray, *alpha_out) = (of(red), of(alpha)),
            _ => out.iter_mut().zip(texel).for_each(|(out, value)| *out = of(value)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::ImageSet;
    use super::*;

    #[test]
    fn rectangles_and_picked_lines_have_the_texels_of_their_places() {
        let bytes: Vec<u8> = (0..7 * 5 * 4).map(|value| value as u8).collect();
        let info = PixelInfo {
            channels: 4,
            color: ColorSpace::Srgb,
            alpha: Alpha::Straight,
            ..PixelInfo::default()
        };
        let of_bytes = Raster::from_u8(7, 5, 4, ColorSpace::Srgb, &bytes).unwrap();
        let of_floats = Raster::new(7, 5, info, of_bytes.values().collect()).unwrap();
        for image in [of_bytes.with_peak(0.5), of_floats.with_peak(0.5)] {
            let part = image.crop(Rect { image: 0, level: 0, x: 2, y: 3, width: 4, height: 9 });
            assert_eq!((part.size(), part.peak()), (ImageSize { width: 4, height: 2 }, 0.5));
            assert!((0..8).all(|i| part.texel(i % 4, i / 4) == image.texel(2 + i % 4, 3 + i / 4)));
            let picked = image.pick(&[6, 0, 99], &[4]);
            assert!([6, 0, 6].into_iter().zip(0..).all(|(x, i)| picked.texel(i, 0) == image.texel(x, 4)));
            assert_eq!(image.pick(&[], &[]).texel(0, 0), image.texel(0, 0));
            assert_eq!(
                image.crop(Rect { image: 0, level: 0, x: 99, y: 99, width: 0, height: 0 }).texel(0, 0),
                image.texel(6, 4)
            );
        }
    }

    #[test]
    fn opaque_alpha_is_dropped_and_real_alpha_kept() {
        let opaque = Raster::from_u8(1, 2, 4, ColorSpace::Srgb, &[1, 2, 3, 255, 4, 5, 6, 255]).unwrap();
        assert_eq!(opaque.info().channels, 3);
        assert_eq!(opaque.to_bytes(), [1, 2, 3, 4, 5, 6]);
        let clear = Raster::from_u8(1, 2, 4, ColorSpace::Srgb, &[1, 2, 3, 255, 4, 5, 6, 254]).unwrap();
        assert_eq!(clear.info().channels, 4);
    }

    #[test]
    fn wrong_shapes_are_named() {
        let info = PixelInfo { channels: 3, ..PixelInfo::default() };
        assert!(matches!(Raster::new(0, 4, info, vec![]), Err(SourceError::ZeroSize { .. })));
        assert!(matches!(Raster::new(1, 1, info, vec![0.0]), Err(SourceError::Length { needed: 3, .. })));
        assert!(matches!(Raster::new(1, 1, info, vec![f32::NAN; 3]), Err(SourceError::NotFinite { .. })));
        let five = PixelInfo { channels: 5, ..info };
        assert!(matches!(Raster::new(1, 1, five, vec![0.0; 5]), Err(SourceError::Channels { channels: 5 })));
    }

    #[test]
    fn sixteen_bits_are_kept() {
        let raster = Raster::from_u16(1, 1, 1, ColorSpace::Linear, &[257]).unwrap();
        assert!((raster.value(0, 0, 0) - 257.0 / 65535.0).abs() < 1e-9);
    }

    #[test]
    fn peaks_are_of_the_bits_that_are_used() {
        let peak = |values: &[u16], channels| {
            let width = values.len() as u32 / u32::from(channels);
            let raster = Raster::from_u16(width, 1, channels, ColorSpace::Linear, values).unwrap();
            (raster.with_own_peak().peak() * DEEPEST).round() as u32
        };
        assert_eq!(
            [peak(&[0, 2047], 1), peak(&[2048, 7], 1), peak(&[1, 1], 1), peak(&[0, 0], 1)],
            [2047, 4095, 1, 65535]
        );
        assert_eq!([peak(&[16383], 1), peak(&[16384], 1), peak(&[300, 60000], 2)], [16383, 65535, 511]);
        let eight = Raster::from_u8(1, 1, 1, ColorSpace::Linear, &[3]).unwrap();
        assert_eq!(eight.with_own_peak().peak(), 1.0);
        let deep = |value| Raster::from_u16(1, 1, 1, ColorSpace::Linear, &[value]).unwrap().with_own_peak();
        let set = ImageSet::new(vec![deep(7), deep(300)]).unwrap();
        assert!(set.images().iter().all(|image| (image.peak() * DEEPEST).round() == 511.0));
    }

    #[test]
    fn a_band_is_no_alpha() {
        let band = PixelInfo { channels: 4, alpha: Alpha::Band, ..PixelInfo::default() };
        let with = |info| Raster::new(1, 1, info, vec![0.25, 0.5, 0.75, 0.0]).unwrap();
        assert!(band.has_extra() && !band.has_alpha());
        let [colours, gray, back] = [3, 2, 4].map(|channels| with(band).with_channels(channels).info());
        assert_eq!((colours.alpha, gray.alpha, back), (Alpha::Opaque, Alpha::Band, band));
        assert_eq!(with(band).to_gray().info().alpha, Alpha::Band);
        let rgb = Raster::from_u8(1, 1, 3, ColorSpace::Srgb, &[1, 2, 3]).unwrap();
        assert_eq!(ImageSet::new(vec![rgb, with(band)]).unwrap().info(), band);
        // Colours of a mip level are means, however small the band's values are there.
        let half = PixelInfo { color: ColorSpace::Linear, ..band };
        let pair = Raster::new(2, 1, half, vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0]).unwrap();
        let mean = super::super::mip_chain(&pair, 2, super::super::MipFilter::Box)[1].texel(0, 0);
        assert_eq!(mean, Texel::splat(0.5));
    }

    #[test]
    fn every_byte_survives() {
        let bytes: Vec<u8> = (0..=255).collect();
        let raster = Raster::from_u8(16, 16, 1, ColorSpace::Linear, &bytes).unwrap();
        assert_eq!(raster.to_bytes(), bytes);
    }
}
