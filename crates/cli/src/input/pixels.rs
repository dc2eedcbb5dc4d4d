//! PNG, JPEG, TIFF, BMP, TGA and PNM, by the `image` crate within limits.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageError, ImageReader};
use texfold_core::image::{Alpha, ColorSpace, Raster};
use texfold_core::{ImageSize, MAX_IMAGE_SIDE};
use tiff::decoder::Decoder as TiffDecoder;
use tiff::tags::Tag;

use super::check_side;
use crate::error::CliError;

type Reader = ImageReader<BufReader<File>>;

fn open(path: &Path) -> Result<Reader, CliError> {
    let failed = |source| CliError::Read { path: path.to_owned(), source };
    // The content decides; the extension only where content tells nothing, as in TGA.
    let reader = ImageReader::open(path).map_err(failed)?.with_guessed_format().map_err(failed)?;
    if reader.format().is_none_or(|format| !format.reading_enabled()) {
        return Err(CliError::UnknownFormat { path: path.to_owned() });
    }
    Ok(reader)
}

/// Columns and rows from the header, upright as [`decode`] gives the image.
pub(crate) fn size(path: &Path) -> Result<ImageSize, CliError> {
    let fault = |error| fault(path, error);
    let mut decoder = open(path)?.into_decoder().map_err(fault)?;
    let (width, height) = decoder.dimensions();
    let is_turned = matches!(
        decoder.orientation().map_err(fault)?,
        Orientation::Rotate90
            | Orientation::Rotate270
            | Orientation::Rotate90FlipH
            | Orientation::Rotate270FlipH
    );
    let (width, height) = if is_turned { (height, width) } else { (width, height) };
    check_side(path, ImageSize { width, height })
}

/// Decodes the file, upright; its decoder may allocate up to `limit_bytes`.
pub(crate) fn read(
    path: &Path,
    color: ColorSpace,
    alpha: Option<Alpha>,
    limit_bytes: u64,
) -> Result<Raster, CliError> {
    tagged(path, decode(path, limit_bytes)?, (color, alpha))
}

/// As [`read`], but with rows and columns as they are stored: what cameras of a capture are given for.
pub(crate) fn read_stored(path: &Path, limit_bytes: u64) -> Result<Raster, CliError> {
    tagged(path, decode_stored(path, limit_bytes)?.0, (ColorSpace::Srgb, None))
}

fn tagged(
    path: &Path,
    decoded: DynamicImage,
    (color, alpha): (ColorSpace, Option<Alpha>),
) -> Result<Raster, CliError> {
    let mut raster = raster(path, decoded, color)?;
    // Near infrared, as in aerial photographs.
    if raster.info().has_alpha() && ends_with_band(path) {
        raster = raster.with_channels(raster.info().channels - 1);
    }
    let alpha = alpha.unwrap_or(raster.info().alpha);
    Ok(raster.tagged(color, alpha))
}

/// Whether a TIFF file says that what it has beside gray or RGB is no alpha, as aerial photographs with infrared do.
/// Many writers of alpha say nothing. `None` where it cannot be told.
pub(super) fn no_alpha(decoder: &mut TiffDecoder<BufReader<File>>) -> Option<bool> {
    let extra = decoder.find_tag_unsigned_vec::<u16>(Tag::ExtraSamples).ok()?;
    Some(extra.is_some_and(|extra| !extra.contains(&1) && !extra.contains(&2)))
}

/// Whether the last channel of a file is a band of its own, and no alpha.
fn ends_with_band(path: &Path) -> bool {
    let decoder = File::open(path).ok().and_then(|file| TiffDecoder::new(BufReader::new(file)).ok());
    decoder.and_then(|mut decoder| no_alpha(&mut decoder)).unwrap_or(false)
}

/// The file's pixels, turned and mirrored as its EXIF orientation asks for.
pub(crate) fn decode(path: &Path, limit_bytes: u64) -> Result<DynamicImage, CliError> {
    let (mut decoded, orientation) = decode_stored(path, limit_bytes)?;
    decoded.apply_orientation(orientation);
    Ok(decoded)
}

/// The file's pixels as they are stored, and their orientation.
fn decode_stored(path: &Path, limit_bytes: u64) -> Result<(DynamicImage, Orientation), CliError> {
    size(path)?;
    let mut reader = open(path)?;
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(MAX_IMAGE_SIDE);
    limits.max_image_height = Some(MAX_IMAGE_SIDE);
    limits.max_alloc = Some(limit_bytes);
    reader.limits(limits.clone());
    let decode = || {
        let mut decoder = reader.into_decoder()?;
        let orientation = decoder.orientation()?;
        limits.reserve(decoder.total_bytes())?;
        Ok((DynamicImage::from_decoder(decoder)?, orientation))
    };
    decode().map_err(|error| fault(path, error))
}

fn raster(path: &Path, decoded: DynamicImage, color: ColorSpace) -> Result<Raster, CliError> {
    let (width, height) = (decoded.width(), decoded.height());
    let channels = decoded.color().channel_count();
    let raster = match &decoded {
        DynamicImage::ImageLuma8(_)
        | DynamicImage::ImageLumaA8(_)
        | DynamicImage::ImageRgb8(_)
        | DynamicImage::ImageRgba8(_) => Raster::from_u8(width, height, channels, color, decoded.as_bytes()),
        DynamicImage::ImageLuma16(image) => Raster::from_u16(width, height, channels, color, image),
        DynamicImage::ImageLumaA16(image) => Raster::from_u16(width, height, channels, color, image),
        DynamicImage::ImageRgb16(image) => Raster::from_u16(width, height, channels, color, image),
        DynamicImage::ImageRgba16(image) => Raster::from_u16(width, height, channels, color, image),
        _ => {
            let format = format!("{:?}", decoded.color());
            return Err(CliError::PixelFormat { path: path.to_owned(), format });
        }
    };
    raster.map_err(|source| CliError::Source { path: path.to_owned(), source })
}

fn fault(path: &Path, error: ImageError) -> CliError {
    let path = path.to_owned();
    match error {
        ImageError::Limits(_) => CliError::ImageLimits { path, source: Box::new(error) },
        ImageError::Unsupported(unsupported) => {
            CliError::PixelFormat { path, format: format!("these ({unsupported})") }
        }
        ImageError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            CliError::Read { path, source }
        }
        error => CliError::Decode { path, source: Box::new(error) },
    }
}
