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
    encode_bytes((size.width, size.height), raster.info().channels, &raster.to_bytes())
}

fn encode_bytes(
    (width, height): (u32, u32),
    channels: u8,
    texels: &[u8],
) -> Result<Vec<u8>, image::ImageError> {
    let color = match channels {
        1 => ExtendedColorType::L8,
        2 => ExtendedColorType::La8,
        3 => ExtendedColorType::Rgb8,
        _ => ExtendedColorType::Rgba8,
    };
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Default, FilterType::Adaptive)
        .write_image(texels, width, height, color)?;
    Ok(bytes)
}

/// Writes bytes, channels interleaved, as a PNG file.
pub(crate) fn write_bytes(
    path: &Path,
    size: (u32, u32),
    channels: u8,
    texels: &[u8],
) -> Result<(), CliError> {
    let draw = |source: image::ImageError| CliError::Draw { path: path.to_owned(), source: Box::new(source) };
    write_whole(path, &encode_bytes(size, channels, texels).map_err(draw)?)
}

/// Writes the raster as a PNG file.
pub(crate) fn write(path: &Path, raster: &Raster) -> Result<(), CliError> {
    let draw = |source: image::ImageError| CliError::Draw { path: path.to_owned(), source: Box::new(source) };
    write_whole(path, &encode(raster).map_err(draw)?)
}
