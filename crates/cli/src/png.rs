//! Rasters as PNG files.

use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use texfold_core::image::Raster;

use crate::error::CliError;
use crate::output::write_whole;

/// The raster as a PNG of its own channels, 8 bits each.
pub(crate) fn encode(raster: &Raster) -> Result<Vec<u8>, image::ImageError> {
    let size = raster.size();
    encode_bytes((size.width, size.height), color(raster.info().channels), &raster.to_bytes())
}

/// That many channels of 8 bits.
pub(crate) fn color(channels: u8) -> ExtendedColorType {
    match channels {
        1 => ExtendedColorType::L8,
        2 => ExtendedColorType::La8,
        3 => ExtendedColorType::Rgb8,
        _ => ExtendedColorType::Rgba8,
    }
}

/// Bytes, channels interleaved, as a PNG.
pub(crate) fn encode_bytes(
    (width, height): (u32, u32),
    color: ExtendedColorType,
    texels: &[u8],
) -> Result<Vec<u8>, image::ImageError> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Default, FilterType::Adaptive)
        .write_image(texels, width, height, color)?;
    Ok(bytes)
}

/// Writes the raster as a PNG file.
pub(crate) fn write(path: &Path, raster: &Raster) -> Result<(), CliError> {
    let draw = |source: image::ImageError| CliError::Draw { path: path.to_owned(), source: Box::new(source) };
    write_whole(path, &encode(raster).map_err(draw)?)
}
