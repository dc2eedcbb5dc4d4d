//! Texture formats that others ship.

use std::process::{Command, Stdio};

use texfold::core::image::{ColorSpace, Raster};

use crate::report::Outcome;

/// Bits a texel of the index of a JPEG texture (Kristmann, Wimmer and Schuetz 2026).
pub const JPEG_INDEX: f64 = 0.17;

/// A baseline JPEG, 4:2:0, decoded, and its bits a texel with those of an index.
///
/// # Errors
/// Where it cannot be coded.
pub fn jpeg(image: &Raster, quality: u8) -> Outcome<(Raster, f64)> {
    use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
    let size = image.size();
    let coded = |optimised: bool| {
        let mut file = Vec::new();
        let mut encoder = Encoder::new(&mut file, quality);
        encoder.set_sampling_factor(SamplingFactor::F_2_2);
        encoder.set_optimized_huffman_tables(optimised);
        encoder.encode(&image.to_bytes(), size.width as u16, size.height as u16, ColorType::Rgb)?;
        Outcome::Ok(file)
    };
    // The same coefficients. Optimised tables are shorter, but with 4:2:0 zune-jpeg does not read what jpeg-encoder 0.7 writes.
    let (read, counted) = (coded(false)?, coded(true)?);
    let decoded = image::load_from_memory(&read)?.to_rgb8();
    let decoded = Raster::from_u8(size.width, size.height, 3, ColorSpace::Srgb, decoded.as_raw())?;
    Ok((decoded, 8.0 * counted.len() as f64 / size.texels() as f64 + JPEG_INDEX))
}

/// ASTC of half the width and height in blocks of that size, drawn enlarged with bilinear filtering: the decoded image, and bits a texel of
/// the large one; `None` where the program is not installed.
///
/// # Errors
/// Where the program fails.
pub fn halved_astc(image: &Raster, block: (u32, u32)) -> Outcome<Option<(Raster, f64)>> {
    use image::imageops::{FilterType, resize};
    let size = image.size();
    let resized = |image: &Raster, width: u32, height: u32, filter: FilterType| {
        let size = image.size();
        let buffer = image::RgbImage::from_raw(size.width, size.height, image.to_bytes());
        let buffer = buffer.ok_or("an image of three channels is needed")?;
        let resized = resize(&buffer, width, height, filter);
        Outcome::Ok(Raster::from_u8(width, height, 3, image.info().color, resized.as_raw())?)
    };
    let half = resized(image, size.width.div_ceil(2), size.height.div_ceil(2), FilterType::Lanczos3)?;
    let Some((decoded, bits)) = astc(&half, block)? else { return Ok(None) };
    let share = half.size().texels() as f64 / size.texels() as f64;
    Ok(Some((resized(&decoded, size.width, size.height, FilterType::Triangle)?, share * bits)))
}

/// ASTC in blocks of that size by `astcenc -thorough`, decoded, and its bits a texel; `None` where it is not installed.
///
/// # Errors
/// Where the program fails.
pub fn astc(image: &Raster, (width, height): (u32, u32)) -> Outcome<Option<(Raster, f64)>> {
    let dir = tempfile::tempdir()?;
    let (input, output) = (dir.path().join("in.png"), dir.path().join("out.png"));
    let size = image.size();
    image::save_buffer(&input, &image.to_bytes(), size.width, size.height, image::ExtendedColorType::Rgb8)?;
    let mut program = Command::new("astcenc");
    program
        .arg("-tl")
        .args([&input, &output])
        .args([&format!("{width}x{height}"), "-thorough", "-silent"])
        .stdout(Stdio::null());
    match program.status() {
        Ok(status) if status.success() => {}
        Ok(status) => return Err(format!("astcenc ended with {status}").into()),
        Err(_) => return Ok(None),
    }
    let decoded = texfold_testkit::png(&output).with_channels(3);
    let blocks = size.width.div_ceil(width) * size.height.div_ceil(height);
    Ok(Some((decoded, 128.0 * f64::from(blocks) / size.texels() as f64)))
}
