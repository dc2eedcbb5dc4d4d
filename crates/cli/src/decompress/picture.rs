//! Decoded images as files: the formats, and pixels as these hold them.

use std::io::Cursor;
use std::path::Path;

use image::codecs::{openexr::OpenExrEncoder, webp::WebPEncoder};
use image::{ExtendedColorType, ImageEncoder};
use texfold_core::ImageSize;
use texfold_core::image::{Alpha, ColorSpace, Depth, PixelInfo, Raster, srgb_to_linear};
use tiff::encoder::colortype::{ColorType, Gray8, Gray16, RGB8, RGB16};
use tiff::encoder::{TiffEncoder, TiffValue};
use tiff::tags::ExtraSamples;

use super::cog::{self, Samples};
use crate::console::{say, warn};
use crate::error::CliError;
use crate::input::georeference::Georeference;
use crate::input::samples::Bands;
use crate::output::write_whole;
use crate::png;

/// Most texels a side of a WebP image.
const WEBP_SIDE: u32 = 1 << 14;

/// Formats that are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Format {
    #[default]
    Png,
    Tiff,
    /// Cloud-optimised GeoTIFF.
    Cog,
    Webp,
    Exr,
}

impl Format {
    /// TIFF of either kind, which holds any number of bands, and georeferences.
    pub(super) fn is_tiff(self) -> bool {
        matches!(self, Format::Tiff | Format::Cog)
    }

    /// The extension of its files.
    pub(super) fn extension(self) -> &'static str {
        match self {
            Format::Png => "png",
            Format::Tiff | Format::Cog => "tiff",
            Format::Webp => "webp",
            Format::Exr => "exr",
        }
    }
}

/// The storage of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sample {
    Eight,
    Sixteen,
    Float,
}

/// An image that rasters are placed in, as its file holds it.
#[derive(Debug)]
pub(crate) struct Picture {
    format: Format,
    size: ImageSize,
    /// Pixels of the rasters that are placed.
    info: PixelInfo,
    /// Channels of the file.
    channels: u16,
    /// Whether the first three are red, green and blue.
    is_rgb: bool,
    /// True where the format has no place for a band that the texture has.
    lacks_band: bool,
    sample: Sample,
    /// Channels interleaved, samples in the byte order of the machine.
    bytes: Vec<u8>,
    /// Tags of a TIFF file; other formats warn that they leave them out.
    georeference: Option<Georeference>,
}

impl Picture {
    /// An image without texels, of those channels and that depth; with `bands` it has all of them.
    pub(super) fn new(format: Format, size: ImageSize, info: PixelInfo, bands: Option<Bands>) -> Picture {
        let mut picture = Picture::empty(format, size, info, bands);
        picture.bytes = vec![0; size.texels() as usize * picture.texel_bytes()];
        picture
    }

    /// Bytes of its samples and its file; of a [`Format::Cog`] with overviews and with tiles on their way into the file.
    pub(super) fn bytes(format: Format, size: ImageSize, info: PixelInfo, bands: Option<Bands>) -> u64 {
        let samples = size.texels() * Picture::empty(format, size, info, bands).texel_bytes() as u64;
        if format == Format::Cog { 4 * samples } else { 2 * samples }
    }

    fn empty(format: Format, size: ImageSize, mut info: PixelInfo, bands: Option<Bands>) -> Picture {
        let sample = match (format, info.depth) {
            (Format::Exr, _) => Sample::Float,
            (Format::Png | Format::Tiff | Format::Cog, Depth::Sixteen) => Sample::Sixteen,
            _ => Sample::Eight,
        };
        let has_band = info.has_extra() && !info.has_alpha();
        let lacks_band = has_band && !format.is_tiff();
        if lacks_band {
            info = PixelInfo { channels: info.channels - 1, alpha: Alpha::Opaque, ..info };
        }
        if sample == Sample::Float && info.channels < 3 {
            info.channels += 2;
        }
        let is_rgb = bands.map_or(info.channels > 2, |bands| bands.is_rgb);
        let channels = bands.map_or(info.channels.into(), |bands| bands.count);
        Picture {
            format,
            size,
            info,
            channels,
            is_rgb,
            lacks_band,
            sample,
            bytes: Vec::new(),
            georeference: None,
        }
    }

    /// The same with a georeference.
    pub(crate) fn with_georeference(self, georeference: Option<Georeference>) -> Picture {
        Picture { georeference, ..self }
    }

    fn texel_bytes(&self) -> usize {
        let sample = match self.sample {
            Sample::Eight => 1,
            Sample::Sixteen => 2,
            Sample::Float => 4,
        };
        usize::from(self.channels) * sample
    }

    /// Puts a raster in its place; what does not fit is cut. Alpha that it lacks is 1.
    pub(crate) fn place(&mut self, corner: (u32, u32), raster: &Raster) {
        self.place_bands(0, corner, raster);
    }

    /// As [`Picture::place`], into channels from number `first` on.
    pub(super) fn place_bands(&mut self, first: u16, (left, top): (u32, u32), raster: &Raster) {
        let (ImageSize { width, height }, texel) = (raster.size(), self.texel_bytes());
        let sample = texel / usize::from(self.channels);
        let columns = width.min(self.size.width.saturating_sub(left)) as usize;
        let rows = height.min(self.size.height.saturating_sub(top)) as usize;
        let channels = self.info.channels;
        let matched = (raster.info().channels != channels).then(|| raster.with_channels(channels));
        let texels = self.samples(matched.as_ref().unwrap_or(raster));
        let own = usize::from(channels) * sample;
        // The last of several images may have more channels than there are bands.
        let used = own.min(usize::from(self.channels.saturating_sub(first)) * sample);
        let to = self.bytes.chunks_exact_mut(self.size.width as usize * texel).skip(top as usize);
        for (to, from) in to.zip(texels.chunks_exact(width as usize * own)).take(rows) {
            let to = to.chunks_exact_mut(texel).skip(left as usize).take(columns);
            for (to, from) in to.zip(from.chunks_exact(own)) {
                to[usize::from(first) * sample..][..used].copy_from_slice(&from[..used]);
            }
        }
    }

    fn samples(&self, raster: &Raster) -> Vec<u8> {
        let sixteen = |value: f32| ((value.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16).to_ne_bytes();
        match self.sample {
            Sample::Eight => raster.to_bytes(),
            Sample::Sixteen => raster.values().map(sixteen).collect::<Vec<_>>().into_flattened(),
            Sample::Float => {
                let linear = |value: f32| match self.info.color {
                    ColorSpace::Srgb => srgb_to_linear(value),
                    ColorSpace::Linear | ColorSpace::Normal => value,
                };
                let extra = self.info.channels > 3;
                let floats = raster.texels().flat_map(|texel| {
                    let colour = texel.truncate().to_array().map(|value| linear(value) * texel.w);
                    colour.into_iter().chain(extra.then_some(texel.w))
                });
                floats.map(f32::to_ne_bytes).collect::<Vec<_>>().into_flattened()
            }
        }
    }

    /// Writes the file, and says so; warns where it holds less than the texture.
    pub(crate) fn write(&self, path: &Path) -> Result<(), CliError> {
        if self.format == Format::Webp && self.size.width.max(self.size.height) > WEBP_SIDE {
            return Err(CliError::WebpSide { path: path.to_owned(), most: WEBP_SIDE });
        }
        let bytes = self.encode().map_err(|source| CliError::Draw { path: path.to_owned(), source })?;
        write_whole(path, &bytes)?;
        say(&format!("wrote {}", path.display()));
        if self.georeference.is_some() && !self.format.is_tiff() {
            warn(&format!(
                "{}: the georeference is left out; give --to tiff or cog to keep it",
                path.display()
            ));
        }
        if self.lacks_band {
            warn(&format!(
                "{}: the band beside the colours is left out; give --to tiff or cog to keep it",
                path.display()
            ));
        }
        if self.sample == Sample::Eight && self.info.depth == Depth::Sixteen {
            let path = path.display();
            warn(&format!(
                "{path}: WebP keeps 8 of the texture's 16 bits; give --to png or tiff to keep all"
            ));
        }
        Ok(())
    }

    fn encode(&self) -> Result<Vec<u8>, Box<dyn std::error::Error + Send + Sync>> {
        let (ImageSize { width, height }, mut out) = (self.size, Cursor::new(Vec::new()));
        let color = match self.sample {
            Sample::Eight => png::color(self.info.channels),
            Sample::Sixteen => match self.info.channels {
                1 => ExtendedColorType::L16,
                2 => ExtendedColorType::La16,
                3 => ExtendedColorType::Rgb16,
                _ => ExtendedColorType::Rgba16,
            },
            Sample::Float if self.info.has_alpha() => ExtendedColorType::Rgba32F,
            Sample::Float => ExtendedColorType::Rgb32F,
        };
        match self.format {
            Format::Png => return Ok(png::encode_bytes((width, height), color, &self.bytes)?),
            Format::Webp => {
                WebPEncoder::new_lossless(&mut out).write_image(&self.bytes, width, height, color)?;
            }
            Format::Exr => OpenExrEncoder::new(&mut out).write_image(&self.bytes, width, height, color)?,
            Format::Cog => {
                let samples = Samples {
                    size: self.size,
                    channels: self.channels,
                    is_rgb: self.is_rgb,
                    has_alpha: self.info.has_alpha(),
                    sample_bytes: self.texel_bytes() / usize::from(self.channels),
                    no_data: self.georeference.as_ref().and_then(Georeference::no_data),
                    bytes: &self.bytes,
                };
                return Ok(cog::encode(samples, self.georeference.as_ref())?);
            }
            Format::Tiff if self.sample == Sample::Eight => match self.is_rgb {
                false => self.tiff::<Gray8>(&mut out, &self.bytes)?,
                true => self.tiff::<RGB8>(&mut out, &self.bytes)?,
            },
            Format::Tiff => {
                let pairs = self.bytes.chunks_exact(2).map(|pair| u16::from_ne_bytes([pair[0], pair[1]]));
                let samples: Vec<u16> = pairs.collect();
                match self.is_rgb {
                    false => self.tiff::<Gray16>(&mut out, &samples)?,
                    true => self.tiff::<RGB16>(&mut out, &samples)?,
                }
            }
        }
        Ok(out.into_inner())
    }

    /// Writes TIFF, with alpha or bands as extra samples.
    fn tiff<C: ColorType>(&self, out: &mut Cursor<Vec<u8>>, samples: &[C::Inner]) -> tiff::TiffResult<()>
    where
        [C::Inner]: TiffValue,
    {
        let mut encoder = TiffEncoder::new(out)?;
        let mut image = encoder.new_image::<C>(self.size.width, self.size.height)?;
        let extra = usize::from(self.channels).saturating_sub(C::BITS_PER_SAMPLE.len());
        let kind =
            if self.info.has_alpha() { ExtraSamples::UnassociatedAlpha } else { ExtraSamples::Unspecified };
        if extra > 0 {
            image.extra_samples(&vec![kind; extra])?;
        }
        if let Some(georeference) = &self.georeference {
            georeference.write(image.encoder())?;
        }
        image.write_data(samples)
    }
}
