//! Images by the `image` crate, and by the `tiff` crate where that takes more, within limits.

use std::path::Path;

use image::metadata::Orientation;
use image::{DynamicImage, ImageBuffer, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};
use texfold_core::ImageSize;
use texfold_core::image::{Alpha, ColorSpace, Depth, PixelInfo, Raster};
use tiff::decoder::{Decoder as TiffDecoder, DecodingResult};
use tiff::tags::{PlanarConfiguration, SampleFormat, Tag};

use super::frames::{self, Source};
use super::jpeg::{self, Outline};
use super::remarks::Remarks;
use super::samples::{self, Bands, Form, Sample, Texels, texels_of};
use super::{check_side, exr_gray, formats, profile};
use crate::error::CliError;
use crate::files;

type Decoder = Box<dyn ImageDecoder>;

/// Pixels as a file stores them, with what it tells of them.
struct Stored {
    image: DynamicImage,
    format: Option<ImageFormat>,
    orientation: Orientation,
    profile: Option<Vec<u8>>,
    is_cmyk: bool,
    /// True for linear values.
    is_linear: bool,
    /// True if the channel beside gray or RGB is no alpha.
    has_band: bool,
}

/// Pixels as they can be used, and how their colours are to be handled.
pub(crate) struct Decoded {
    pub(crate) image: DynamicImage,
    pub(crate) color: ColorSpace,
    /// True if the channel beside gray or RGB is no alpha.
    pub(crate) has_band: bool,
}

/// Limits of memory; [`check_side`] knows those of sides.
fn limits(limit_bytes: u64) -> Limits {
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(limit_bytes);
    limits
}

/// The decoder of a file, or of a page of it.
fn open(
    path: &Path,
    page: Option<u64>,
    limits: Limits,
) -> Result<(Result<Decoder, ImageError>, Option<ImageFormat>), CliError> {
    let failed = |source| CliError::Read { path: path.to_owned(), source };
    let head = super::head_of(path)?;
    formats::check(path, &head)?;
    #[cfg(feature = "jxl")]
    if formats::is_jpeg_xl(&head) {
        let decoder = jxl_oxide::integration::JxlDecoder::new(frames::open(path, None).map_err(failed)?);
        let limited = decoder.and_then(|mut decoder| {
            decoder.set_limits(limits)?;
            Ok(Box::new(decoder) as Decoder)
        });
        return Ok((limited, None));
    }
    // The content decides; the extension only where content tells nothing, as in TGA.
    let mut reader = ImageReader::new(frames::open(path, page).map_err(failed)?);
    if let Ok(format) = ImageFormat::from_path(path) {
        reader.set_format(format);
    }
    let mut reader = reader.with_guessed_format().map_err(failed)?;
    let Some(format) = reader.format().filter(ImageFormat::reading_enabled) else {
        return Err(formats::unknown(path));
    };
    reader.limits(limits);
    Ok((reader.into_decoder().map(|decoder| Box::new(decoder) as Decoder), Some(format)))
}

/// Columns and rows from the header, upright as [`decode`] gives the image.
pub(crate) fn size(path: &Path) -> Result<ImageSize, CliError> {
    size_and_orientation(path).map(|(size, _)| size)
}

/// Columns and rows as [`decode`] gives the image, and how it is turned for that.
pub(super) fn size_and_orientation(path: &Path) -> Result<(ImageSize, Orientation), CliError> {
    let ((width, height), orientation) = match open(path, None, limits(u64::MAX))? {
        (Ok(mut decoder), _) => {
            let orientation = decoder.orientation().map_err(|error| fault(path, None, error))?;
            (decoder.dimensions(), orientation)
        }
        (Err(error), format) => {
            if let Some(size) = gray_exr_size(path, format) {
                return Ok((check_side(path, size)?, Orientation::NoTransforms));
            }
            let decoder = special_tiff(path, None, format).ok_or_else(|| fault(path, format, error))?;
            let dimensions = { decoder }.dimensions().map_err(|error| damaged(path, error))?;
            (dimensions, Orientation::NoTransforms)
        }
    };
    let is_turned = matches!(
        orientation,
        Orientation::Rotate90
            | Orientation::Rotate270
            | Orientation::Rotate90FlipH
            | Orientation::Rotate270FlipH
    );
    let (width, height) = if is_turned { (height, width) } else { (width, height) };
    Ok((check_side(path, ImageSize { width, height })?, orientation))
}

/// Decodes the file, upright; its decoder may allocate up to `limit_bytes`.
pub(crate) fn read(
    path: &Path,
    color: ColorSpace,
    alpha: Option<Alpha>,
    limit_bytes: u64,
    remarks: &mut Remarks,
) -> Result<Raster, CliError> {
    raster(path, decode(path, color, limit_bytes, remarks)?, alpha)
}

/// As [`read`], without a band beside colours, which a warning tells of.
pub(crate) fn read_colours(
    path: &Path,
    color: ColorSpace,
    alpha: Option<Alpha>,
    limit_bytes: u64,
    remarks: &mut Remarks,
) -> Result<Raster, CliError> {
    let raster = read(path, color, alpha, limit_bytes, remarks)?;
    if has_band(&raster) {
        remarks.warn(path, "zoom stacks hold colours and alpha alone: the band beside them is left out");
    }
    Ok(without_band(raster))
}

fn has_band(raster: &Raster) -> bool {
    raster.info().has_extra() && !raster.info().has_alpha()
}

fn without_band(raster: Raster) -> Raster {
    if has_band(&raster) { raster.with_channels(raster.info().channels - 1) } else { raster }
}

/// As [`read`], with all frames or pages of the file.
pub(crate) fn read_all(
    path: &Path,
    color: ColorSpace,
    alpha: Option<Alpha>,
    limit_bytes: u64,
    remarks: &mut Remarks,
) -> Result<Vec<Raster>, CliError> {
    let pages = frames::pages(path);
    let limits = limits(limit_bytes);
    let mut left = limit_bytes;
    let mut one = |page| {
        let decoded = finished(path, stored(path, page, left, remarks)?, color, remarks)?;
        left = left.saturating_sub(decoded.image.as_bytes().len() as u64);
        Ok(decoded)
    };
    let decoded: Vec<Decoded> = if pages.len() > 1 {
        pages.into_iter().map(|page| one(Some(page))).collect::<Result<_, CliError>>()?
    } else {
        let first = stored(path, None, limit_bytes, remarks)?;
        match frames::of_animation(path, limits).map_err(|error| fault(path, first.format, error))? {
            Some(images) => {
                let of_frame = |image| Stored { image, profile: first.profile.clone(), ..first };
                let frames = images.into_iter().map(of_frame);
                frames.map(|frame| finished(path, frame, color, remarks)).collect::<Result<_, _>>()?
            }
            None => vec![finished(path, first, color, remarks)?],
        }
    };
    decoded.into_iter().map(|decoded| raster(path, decoded, alpha)).collect()
}

/// As [`read`], but with rows and columns as they are stored: what cameras of a capture are given for.
pub(crate) fn read_stored(path: &Path, limit_bytes: u64) -> Result<Raster, CliError> {
    let stored = Stored {
        orientation: Orientation::NoTransforms,
        ..stored(path, None, limit_bytes, &mut Remarks::default())?
    };
    // What is beside colours hides what is not the object.
    raster(path, finished(path, stored, ColorSpace::Srgb, &mut Remarks::default())?, None).map(without_band)
}

/// The file's first image, turned and mirrored as its EXIF orientation asks for.
pub(crate) fn decode(
    path: &Path,
    color: ColorSpace,
    limit_bytes: u64,
    remarks: &mut Remarks,
) -> Result<Decoded, CliError> {
    frames::warn_of_rest(path, &super::head_of(path)?, remarks);
    finished(path, stored(path, None, limit_bytes, remarks)?, color, remarks)
}

/// Number of images that the bands of a file's first image take; 1 of other files.
pub(crate) fn band_images(path: &Path) -> u16 {
    let is_tiff = super::head_of(path).is_ok_and(|head| frames::is_tiff(&head));
    let mut decoder = is_tiff.then(|| tiff_decoder(path, None, Some(ImageFormat::Tiff))).flatten();
    decoder.as_mut().and_then(Bands::of).map_or(1, Bands::images)
}

/// All bands of the file's first image, as images of up to four channels.
pub(crate) fn read_bands(
    path: &Path,
    color: ColorSpace,
    limit_bytes: u64,
    remarks: &mut Remarks,
) -> Result<Vec<Raster>, CliError> {
    frames::warn_of_rest(path, &super::head_of(path)?, remarks);
    let banded = Banded::open(path, None, Some(ImageFormat::Tiff));
    let banded = banded.ok_or_else(|| formats::unknown(path))?;
    let images = banded.images(path, limit_bytes, remarks)?.into_iter();
    images.map(|stored| raster(path, finished(path, stored, color, remarks)?, None)).collect()
}

/// A TIFF file of which texels have bands.
struct Banded {
    decoder: TiffDecoder<Box<dyn Source>>,
    bands: Bands,
    metadata: String,
    /// The profile of RGB, which is not followed beside bands.
    profile: Option<Vec<u8>>,
}

impl Banded {
    fn open(path: &Path, page: Option<u64>, format: Option<ImageFormat>) -> Option<Banded> {
        let mut known = tiff_decoder(path, page, format)?;
        let bands = Bands::of(&mut known)?;
        let metadata = samples::metadata(&mut known);
        let source = frames::open_as_gray(path, page, known.ifd_pointer()?.0).ok()?;
        let profile = known.get_tag_u8_vec(Tag::IccProfile).ok().filter(|_| bands.is_rgb);
        Some(Banded { decoder: TiffDecoder::new(source).ok()?, bands, metadata, profile })
    }

    /// The bands in images of up to four channels; what the last one lacks is 0.
    fn images(self, path: &Path, limit_bytes: u64, remarks: &mut Remarks) -> Result<Vec<Stored>, CliError> {
        let Banded { mut decoder, bands, metadata, profile } = self;
        let failed = |error| damaged(path, error);
        let (width, height) = decoder.dimensions().map_err(failed)?;
        let texels = check_side(path, ImageSize { width, height })?.texels();
        // Up to four bytes a sample are read, and as many are made of them.
        check_memory(path, texels.saturating_mul(8 * u64::from(bands.count)), limit_bytes)?;
        let orientation = decoder.find_tag_unsigned::<u8>(Tag::Orientation).ok().flatten();
        let orientation = orientation.and_then(Orientation::from_exif).unwrap_or(Orientation::NoTransforms);
        let mut decoder = decoder.with_limits(tiff_limits(limit_bytes));
        let Texels { values, sample, is_planar } = texels_of(path, &mut decoder, bands.count)?;
        if sample == Sample::Float {
            remarks.note(path, FLOATS);
        }
        let form = Form { size: (width, height), count: bands.count, is_planar };
        let image = |values: Vec<u16>, channels| match (sample, channels) {
            (Sample::Byte, _) => {
                let bytes = values.into_iter().map(|value| value as u8).collect();
                match channels {
                    2 => ImageBuffer::from_raw(width, height, bytes).map(DynamicImage::ImageLumaA8),
                    3 => ImageBuffer::from_raw(width, height, bytes).map(DynamicImage::ImageRgb8),
                    _ => ImageBuffer::from_raw(width, height, bytes).map(DynamicImage::ImageRgba8),
                }
            }
            (_, 2) => ImageBuffer::from_raw(width, height, values).map(DynamicImage::ImageLumaA16),
            (_, 3) => ImageBuffer::from_raw(width, height, values).map(DynamicImage::ImageRgb16),
            _ => ImageBuffer::from_raw(width, height, values).map(DynamicImage::ImageRgba16),
        };
        let images =
            form.split(&values, image).ok_or_else(|| damaged(path, tiff::TiffError::IntSizeError))?;
        remarks.note(path, bands.note(&metadata));
        if !profile::keeps_values(profile.as_deref(), 3) {
            remarks.warn(
                path,
                "the colour profile is not followed in an image of bands: values are taken as they are",
            );
        }
        let stored = |image: DynamicImage| Stored {
            has_band: image.color().has_alpha(),
            image,
            format: Some(ImageFormat::Tiff),
            orientation,
            profile: None,
            is_cmyk: false,
            is_linear: !bands.is_rgb,
        };
        Ok(images.into_iter().map(stored).collect())
    }
}

/// The note on floats.
const FLOATS: &str = "float samples are taken as 16 bits, linear";

fn check_memory(path: &Path, needed: u64, allowed: u64) -> Result<(), CliError> {
    let (needed_mib, allowed_mib) = (needed >> 20, allowed >> 20);
    let refused = || CliError::Memory { path: path.to_owned(), needed_mib, allowed_mib };
    (needed <= allowed).then_some(()).ok_or_else(refused)
}

fn tiff_limits(limit_bytes: u64) -> tiff::decoder::Limits {
    let mut limits = tiff::decoder::Limits::default();
    let most = usize::try_from(limit_bytes).unwrap_or(usize::MAX);
    (limits.decoding_buffer_size, limits.intermediate_buffer_size) = (most, most);
    limits
}

/// Decodes a file, or a page of it.
fn stored(
    path: &Path,
    page: Option<u64>,
    limit_bytes: u64,
    remarks: &mut Remarks,
) -> Result<Stored, CliError> {
    use image::ExtendedColorType::{Cmyk8, Cmyk16};
    let mut limits = limits(limit_bytes);
    let (decoder, format) = open(path, page, limits.clone())?;
    if let Some(banded) = Banded::open(path, page, format) {
        let bands = banded.bands.count;
        if bands > samples::MOST_CHANNELS {
            return Err(CliError::ManyBands { path: path.to_owned(), bands });
        }
        let image = banded.images(path, limit_bytes, remarks)?.pop();
        return image.ok_or_else(|| CliError::ManyBands { path: path.to_owned(), bands });
    }
    let mut decoder = match decoder {
        Ok(decoder) => decoder,
        Err(error) => {
            if let Some(size) = gray_exr_size(path, format) {
                return gray_exr(path, size, limit_bytes, remarks);
            }
            let special = special_tiff(path, page, format).ok_or_else(|| fault(path, format, error))?;
            return special_image(path, special, limit_bytes, remarks);
        }
    };
    let (width, height) = decoder.dimensions();
    check_side(path, ImageSize { width, height })?;
    let is_jpeg = format == Some(ImageFormat::Jpeg);
    let jpeg = if is_jpeg { jpeg::outline(&files::read(path)?) } else { Outline::default() };
    if is_jpeg && !jpeg.is_whole {
        // Its decoder gives gray for what is missing.
        return Err(CliError::Rows { path: path.to_owned(), source: "the JPEG has no end marker".into() });
    }
    let decode = || {
        let orientation = decoder.orientation()?;
        // A profile that cannot be read is none that could be followed.
        let profile = match tiff_decoder(path, page, format) {
            // The limits that `image` sets for TIFF forbid profiles in small images.
            Some(mut tiff) => tiff.get_tag_u8_vec(Tag::IccProfile).ok(),
            None => decoder.icc_profile().ok().flatten(),
        };
        // The JPEG decoder converts four components to RGB.
        let is_cmyk = matches!(decoder.original_color_type(), Cmyk8 | Cmyk16) || jpeg.components == Some(4);
        let is_float = decoder.color_type().bytes_per_pixel() / decoder.color_type().channel_count() > 2;
        // Values of 32 bits are held beside those of 16.
        limits.reserve(decoder.total_bytes().saturating_mul(if is_float { 2 } else { 1 }))?;
        // Floats of JPEG XL are as its profile says.
        let is_linear = is_float && format.is_some();
        let image = DynamicImage::from_decoder(decoder)?;
        Ok(Stored { image, format, orientation, profile, is_cmyk, is_linear, has_band: false })
    };
    let stored = decode().map_err(|error| fault(path, format, error))?;
    if stored.is_linear {
        remarks.note(path, FLOATS);
    }
    Ok(stored)
}

/// Makes pixels usable: 16 bits for floats, sRGB for other profiles, upright.
fn finished(
    path: &Path,
    stored: Stored,
    color: ColorSpace,
    remarks: &mut Remarks,
) -> Result<Decoded, CliError> {
    let Stored { mut image, format, orientation, profile, is_cmyk, is_linear, has_band } = stored;
    if let DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) = image {
        image = sixteen(image, format == Some(ImageFormat::OpenExr))
            .ok_or_else(|| CliError::HighRange { path: path.to_owned() })?;
    }
    let color = if is_linear && color == ColorSpace::Srgb { ColorSpace::Linear } else { color };
    if is_cmyk {
        remarks.note(path, "CMYK colours are converted to RGB without a colour profile");
    } else if let Some(profile) = profile.filter(|_| color == ColorSpace::Srgb) {
        match profile::to_srgb(&mut image, &profile) {
            Ok(None) => {}
            Ok(Some(name)) => remarks.note(path, format!("{name} converted to sRGB")),
            Err(_) => remarks.warn(
                path,
                "the colour profile cannot be used: values are taken as sRGB; convert the image to sRGB before",
            ),
        }
    }
    if orientation != Orientation::NoTransforms {
        image.apply_orientation(orientation);
        remarks.note(path, "turned as its EXIF orientation asks");
    }
    Ok(Decoded { image, color, has_band })
}

/// A float in 16 bits; `None` outside of 0 to 1.
pub(super) fn unit(value: f32) -> Option<u16> {
    (0.0..=1.0).contains(&value).then(|| (value * f32::from(u16::MAX)).round() as u16)
}

/// Floats in 16 bits; `None` where one is outside of 0 to 1. OpenEXR stores colours times alpha.
fn sixteen(image: DynamicImage, times_alpha: bool) -> Option<DynamicImage> {
    let (width, height) = (image.width(), image.height());
    Some(match image {
        DynamicImage::ImageRgb32F(image) => {
            let values = image.iter().map(|&value| unit(value)).collect::<Option<Vec<u16>>>()?;
            DynamicImage::ImageRgb16(ImageBuffer::from_raw(width, height, values)?)
        }
        DynamicImage::ImageRgba32F(mut image) => {
            for texel in image.pixels_mut().filter(|texel| times_alpha && texel.0[3] > 0.0) {
                let [red, green, blue, alpha] = texel.0;
                texel.0 = [red / alpha, green / alpha, blue / alpha, alpha];
            }
            let values = image.iter().map(|&value| unit(value)).collect::<Option<Vec<u16>>>()?;
            DynamicImage::ImageRgba16(ImageBuffer::from_raw(width, height, values)?)
        }
        image => image,
    })
}

fn tiff_decoder(
    path: &Path,
    page: Option<u64>,
    format: Option<ImageFormat>,
) -> Option<TiffDecoder<Box<dyn Source>>> {
    let source = frames::open(path, page).ok().filter(|_| format == Some(ImageFormat::Tiff))?;
    TiffDecoder::new(source).ok()
}

fn is_float(decoder: &mut TiffDecoder<Box<dyn Source>>) -> bool {
    let formats = decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).ok().flatten();
    formats.is_some_and(|formats| formats.contains(&SampleFormat::IEEEFP.to_u16()))
}

/// The decoder of a TIFF file that the `image` crate does not take: gray floats, gray with a second sample, bands, palettes,
/// and YCbCr as in JPEG.
fn special_tiff(
    path: &Path,
    page: Option<u64>,
    format: Option<ImageFormat>,
) -> Option<TiffDecoder<Box<dyn Source>>> {
    let mut decoder = tiff_decoder(path, page, format)?;
    if palette(&mut decoder).is_some() {
        // Indices, of which the decoder makes no colours.
        return TiffDecoder::new(frames::open_as_gray(path, page, decoder.ifd_pointer()?.0).ok()?).ok();
    }
    let is_jpeg = decoder.find_tag_unsigned::<u16>(Tag::Compression).ok().flatten() == Some(7);
    let has_bands = Bands::of(&mut decoder).is_some();
    let is_special = match decoder.colortype().ok()? {
        _ if has_bands => true,
        tiff::ColorType::Gray(16 | 32 | 64) => is_float(&mut decoder),
        tiff::ColorType::Multiband { bit_depth: 8 | 16, num_samples: 2 } => {
            let planes = decoder.find_tag_unsigned::<u16>(Tag::PlanarConfiguration).ok().flatten();
            planes != Some(PlanarConfiguration::Planar.to_u16())
        }
        tiff::ColorType::YCbCr(8) => is_jpeg,
        _ => false,
    };
    is_special.then_some(decoder)
}

fn special_image(
    path: &Path,
    mut decoder: TiffDecoder<Box<dyn Source>>,
    limit_bytes: u64,
    remarks: &mut Remarks,
) -> Result<Stored, CliError> {
    let damaged = |error| damaged(path, error);
    let (width, height) = decoder.dimensions().map_err(damaged)?;
    let texels = check_side(path, ImageSize { width, height })?.texels();
    let profile = decoder.get_tag_u8_vec(Tag::IccProfile).ok();
    let orientation = decoder.find_tag_unsigned::<u8>(Tag::Orientation).ok().flatten();
    // Four bytes a texel are read, and up to three are made of them.
    check_memory(path, texels.saturating_mul(8), limit_bytes)?;
    let samples = decoder.colortype().map_err(damaged)?.num_samples();
    let palette = palette(&mut decoder);
    let mut is_linear = false;
    let image = match decoder.with_limits(tiff_limits(limit_bytes)).read_image().map_err(damaged)? {
        values @ (DecodingResult::F16(_) | DecodingResult::F32(_) | DecodingResult::F64(_)) => {
            is_linear = true;
            remarks.note(path, FLOATS);
            let values =
                floats(values).unwrap_or_default().into_iter().map(unit).collect::<Option<Vec<u16>>>();
            let values = values.ok_or_else(|| CliError::HighRange { path: path.to_owned() })?;
            ImageBuffer::from_raw(width, height, values).map(DynamicImage::ImageLuma16)
        }
        DecodingResult::U8(values) if samples == 2 => {
            ImageBuffer::from_raw(width, height, values).map(DynamicImage::ImageLumaA8)
        }
        DecodingResult::U16(values) if samples == 2 => {
            ImageBuffer::from_raw(width, height, values).map(DynamicImage::ImageLumaA16)
        }
        DecodingResult::U8(indices) if palette.is_some() => {
            let palette = palette.unwrap_or([[0; 3]; 256]);
            let colours = indices.into_iter().flat_map(|index| palette[usize::from(index)]).collect();
            ImageBuffer::from_raw(width, height, colours).map(DynamicImage::ImageRgb8)
        }
        DecodingResult::U8(mut values) => {
            values.chunks_exact_mut(3).for_each(to_rgb);
            ImageBuffer::from_raw(width, height, values).map(DynamicImage::ImageRgb8)
        }
        _ => None,
    };
    let image = image.ok_or_else(|| CliError::Rows {
        path: path.to_owned(),
        source: Box::new(std::io::Error::from(std::io::ErrorKind::InvalidData)),
    })?;
    let orientation = orientation.and_then(Orientation::from_exif).unwrap_or(Orientation::NoTransforms);
    let format = Some(ImageFormat::Tiff);
    Ok(Stored { image, format, orientation, profile, is_cmyk: false, is_linear, has_band: false })
}

/// Columns and rows of an OpenEXR file of one channel.
fn gray_exr_size(path: &Path, format: Option<ImageFormat>) -> Option<ImageSize> {
    (format == Some(ImageFormat::OpenExr)).then(|| exr_gray::size(path)).flatten()
}

/// An OpenEXR file of one channel.
fn gray_exr(
    path: &Path,
    size: ImageSize,
    limit_bytes: u64,
    remarks: &mut Remarks,
) -> Result<Stored, CliError> {
    check_memory(path, check_side(path, size)?.texels().saturating_mul(10), limit_bytes)?;
    let failed = |source| CliError::Rows { path: path.to_owned(), source };
    let values = exr_gray::values(path).map_err(|error| failed(Box::new(error)))?;
    let values: Option<Vec<u16>> = values.into_iter().map(unit).collect();
    let values = values.ok_or_else(|| CliError::HighRange { path: path.to_owned() })?;
    let image = ImageBuffer::from_raw(size.width, size.height, values).map(DynamicImage::ImageLuma16);
    remarks.note(path, FLOATS);
    Ok(Stored {
        image: image.ok_or_else(|| failed("rows are missing".into()))?,
        format: Some(ImageFormat::OpenExr),
        orientation: Orientation::NoTransforms,
        profile: None,
        is_cmyk: false,
        is_linear: true,
        has_band: false,
    })
}

/// Samples of floats; `None` for others.
pub(super) fn floats(values: DecodingResult) -> Option<Vec<f32>> {
    Some(match values {
        DecodingResult::F16(values) => values.into_iter().map(|value| value.to_f32()).collect(),
        DecodingResult::F32(values) => values,
        DecodingResult::F64(values) => values.into_iter().map(|value| value as f32).collect(),
        _ => return None,
    })
}

/// The colours of the palette that a TIFF file's bytes are indices of, which are stored as all red, all green and all blue values of 16 bits.
fn palette(decoder: &mut TiffDecoder<Box<dyn Source>>) -> Option<[[u8; 3]; 256]> {
    let bits = decoder.find_tag_unsigned::<u16>(Tag::BitsPerSample).ok()??;
    let values = decoder.get_tag_u16_vec(Tag::ColorMap).ok();
    let values = values.filter(|values| bits == 8 && values.len() == 3 * 256)?;
    let byte = |value: u16| ((u32::from(value) * 255 + 32767) / 65535) as u8;
    Some(std::array::from_fn(|entry| [0, 1, 2].map(|channel| byte(values[256 * channel + entry]))))
}

/// Luma and two differences of colour become RGB, as JPEG files have them.
fn to_rgb(texel: &mut [u8]) {
    let [luma, blue, red] = [0, 1, 2].map(|channel| f32::from(texel[channel]));
    let (blue, red) = (blue - 128.0, red - 128.0);
    let rgb = [luma + 1.402 * red, luma - 0.344_136 * blue - 0.714_136 * red, luma + 1.772 * blue];
    texel.iter_mut().zip(rgb).for_each(|(value, rgb)| *value = rgb.round() as u8);
}

fn raster(path: &Path, decoded: Decoded, alpha: Option<Alpha>) -> Result<Raster, CliError> {
    let Decoded { image, color, has_band } = decoded;
    let (width, height, channels) = (image.width(), image.height(), image.color().channel_count());
    let raster = if has_band {
        // Opaque alpha is dropped, but no band.
        let (depth, data): (_, Vec<f32>) = match &image {
            DynamicImage::ImageLumaA16(image) => (Depth::Sixteen, image.iter().map(sixteenth).collect()),
            DynamicImage::ImageRgba16(image) => (Depth::Sixteen, image.iter().map(sixteenth).collect()),
            image => (Depth::Eight, image.as_bytes().iter().map(|&byte| f32::from(byte) / 255.0).collect()),
        };
        Raster::new(width, height, PixelInfo { channels, depth, color, alpha: Alpha::Band }, data)
    } else {
        match &image {
            DynamicImage::ImageLuma8(_)
            | DynamicImage::ImageLumaA8(_)
            | DynamicImage::ImageRgb8(_)
            | DynamicImage::ImageRgba8(_) => {
                Raster::from_u8(width, height, channels, color, image.as_bytes())
            }
            DynamicImage::ImageLuma16(image) => Raster::from_u16(width, height, channels, color, image),
            DynamicImage::ImageLumaA16(image) => Raster::from_u16(width, height, channels, color, image),
            DynamicImage::ImageRgb16(image) => Raster::from_u16(width, height, channels, color, image),
            DynamicImage::ImageRgba16(image) => Raster::from_u16(width, height, channels, color, image),
            _ => {
                return Err(CliError::PixelFormat {
                    path: path.to_owned(),
                    what: "float samples".to_owned(),
                });
            }
        }
    };
    let raster = raster.map_err(|source| CliError::Source { path: path.to_owned(), source })?;
    let alpha = alpha.unwrap_or(raster.info().alpha);
    Ok(raster.tagged(color, alpha).with_own_peak())
}

fn sixteenth(value: &u16) -> f32 {
    f32::from(*value) / f32::from(u16::MAX)
}

pub(super) fn damaged(path: &Path, error: tiff::TiffError) -> CliError {
    CliError::Rows { path: path.to_owned(), source: Box::new(error) }
}

/// The property of a TIFF file that is not supported, in words.
fn tiff_words(path: &Path) -> Option<String> {
    use tiff::ColorType::{CMYK, Gray, GrayA, Multiband, RGB, RGBA};
    let mut decoder = tiff_decoder(path, None, Some(ImageFormat::Tiff))?;
    let is_float = is_float(&mut decoder);
    match decoder.find_tag_unsigned::<u16>(Tag::PhotometricInterpretation).ok().flatten() {
        Some(3) => {
            let bits = decoder.find_tag_unsigned::<u16>(Tag::BitsPerSample).ok().flatten().unwrap_or(1);
            return Some(format!("palettes of colours of {bits} bits"));
        }
        Some(6) => return Some("YCbCr colours without JPEG".to_owned()),
        Some(8..=10) => return Some("Lab colours".to_owned()),
        _ => {}
    }
    Some(match decoder.colortype().ok()? {
        Multiband { num_samples, .. } => format!("{num_samples} bands"),
        Gray(bits) | GrayA(bits) | RGB(bits) | RGBA(bits) | CMYK(bits) => match (bits, is_float) {
            (bits, true) => format!("float{bits} samples"),
            (8 | 16, false) => "samples of this compression".to_owned(),
            (bits, false) => format!("samples of {bits} bits"),
        },
        _ => "colours of this kind".to_owned(),
    })
}

fn fault(path: &Path, format: Option<ImageFormat>, error: ImageError) -> CliError {
    let what = || tiff_words(path).filter(|_| format == Some(ImageFormat::Tiff));
    let path = path.to_owned();
    match error {
        ImageError::Limits(_) => CliError::ImageLimits { path, source: Box::new(error) },
        ImageError::Unsupported(_) => {
            CliError::PixelFormat { what: what().unwrap_or("pixels of this form".to_owned()), path }
        }
        ImageError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            CliError::Read { path, source }
        }
        error => CliError::Decode { path, source: Box::new(error) },
    }
}
