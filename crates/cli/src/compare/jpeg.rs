//! JPEG as a texture that a GPU decodes by block (Kristmann, Wimmer and Schuetz 2026): baseline, 4:2:0, with the bits of its index.

use std::path::Path;
use std::time::Instant;

use jpeg_encoder::{ColorType, Encoder, EncodingError, SamplingFactor};
use texfold_core::image::Raster;

use super::measure::Cost;
use super::rival::Coded;
use crate::error::CliError;

/// Bits a texel of the index.
const INDEX_BITS: f64 = 0.17;

/// `image` of the file at `path` as a JPEG of a quality of 1 to 100, decoded.
pub(super) fn code(image: &Raster, quality: u8, path: &Path) -> Result<Coded, CliError> {
    let failed = |source: Box<dyn std::error::Error + Send + Sync>| CliError::Rival {
        path: path.to_owned(),
        program: "jpeg-encoder".into(),
        source: std::io::Error::other(source),
    };
    let start = Instant::now();
    // The same coefficients. Optimised tables are shorter, but with 4:2:0 zune-jpeg does not read what jpeg-encoder 0.7 writes.
    let counted = file(image, quality, true).map_err(|error| failed(error.into()))?;
    let cost = Cost::of_one_thread(start.elapsed().as_secs_f64());
    let read = file(image, quality, false).map_err(|error| failed(error.into()))?;
    let decoded = image::load_from_memory(&read).map_err(|error| failed(error.into()))?;
    let (size, info) = (image.size(), image.info());
    let values =
        if info.channels == 1 { decoded.into_luma8().into_raw() } else { decoded.into_rgb8().into_raw() };
    let decoded = Raster::from_u8(size.width, size.height, info.channels, info.color, &values);
    let decoded = decoded.map_err(|error| failed(error.into()))?;
    let bits = 8 * counted.len() as u64 + (INDEX_BITS * size.texels() as f64) as u64;
    Ok(Coded { decoded, cost, bits })
}

fn file(image: &Raster, quality: u8, is_optimised: bool) -> Result<Vec<u8>, EncodingError> {
    let size = image.size();
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, quality);
    encoder.set_sampling_factor(SamplingFactor::F_2_2);
    encoder.set_optimized_huffman_tables(is_optimised);
    let kind = if image.info().channels == 1 { ColorType::Luma } else { ColorType::Rgb };
    // Sides of 65536 texels and more are no JPEG.
    let side = |side: u32| u16::try_from(side).unwrap_or(0);
    encoder.encode(&image.to_bytes(), side(size.width), side(size.height), kind)?;
    Ok(file)
}
