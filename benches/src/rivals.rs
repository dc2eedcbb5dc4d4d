//! Texture formats that others ship.

use std::process::{Command, Stdio};

use texfold::image::{ColorSpace, Raster};

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

/// ASTC in blocks of that side by `astcenc -thorough`, decoded, and its bits a texel; `None` where it is not installed.
///
/// # Errors
/// Where the program fails.
pub fn astc(image: &Raster, side: u32) -> Outcome<Option<(Raster, f64)>> {
    let dir = tempfile::tempdir()?;
    let (input, output) = (dir.path().join("in.png"), dir.path().join("out.png"));
    let size = image.size();
    image::save_buffer(&input, &image.to_bytes(), size.width, size.height, image::ExtendedColorType::Rgb8)?;
    let mut program = Command::new("astcenc");
    program
        .arg("-tl")
        .args([&input, &output])
        .args([&format!("{side}x{side}"), "-thorough", "-silent"])
        .stdout(Stdio::null());
    match program.status() {
        Ok(status) if status.success() => {}
        Ok(status) => return Err(format!("astcenc ended with {status}").into()),
        Err(_) => return Ok(None),
    }
    let decoded = texfold_testkit::png(&output).with_channels(3);
    let blocks = size.width.div_ceil(side) * size.height.div_ceil(side);
    Ok(Some((decoded, 128.0 * f64::from(blocks) / size.texels() as f64)))
}
