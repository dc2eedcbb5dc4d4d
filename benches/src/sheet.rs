//! A sheet to look at: parts of images as ASTC, JPEG and our blocks decode them at equal bits.
//!
//! `cargo run --release -p texfold-benches --bin sheet -- OUT.png IMAGE X Y [IMAGE X Y …]`. A part is 192x192 texels from column X
//! and row Y on. For each part a row of the sheet for each rate (0.5, 1 and 2 bits a texel); from left to right the source,
//! ASTC (`astcenc -thorough`: 8x8 of half the width and height, 12x10 with 1.07 bits, 8x8; the source again where it is not
//! installed), JPEG with 0.17 bits a texel for an index, at the highest quality within the rate (the lowest where none is), and
//! `dct`, coded for the eye. Of each image the 1024x1024 texels around the part are coded.

use std::path::Path;

use texfold::core::image::{ImageSet, Raster};
use texfold::core::metric::decode_surface;
use texfold::{
    Goal, Job,
    core::Encoder,
    dct::{Dct, DctParams},
};
use texfold_benches::report::{Outcome, part};
use texfold_benches::rivals;

/// ASTC in blocks of that size, of the image or of one of half its width and height.
#[derive(Debug, Clone, Copy)]
enum Astc {
    Whole(u32, u32),
    Halved(u32, u32),
}

/// Bits a texel, and the ASTC that takes about as many.
const RATES: [(f64, Astc); 3] =
    [(0.5, Astc::Halved(8, 8)), (1.0, Astc::Whole(12, 10)), (2.0, Astc::Whole(8, 8))];
/// Texels along the side of what is coded.
const CODED: u32 = 1024;
/// Texels along the side of a part.
const SIDE: u32 = 192;
/// Columns of the sheet.
const COLUMNS: u32 = 4;
/// Texels between parts.
const GAP: u32 = 4;

/// A sheet of white.
struct Sheet {
    width: u32,
    bytes: Vec<u8>,
}

impl Sheet {
    fn new(rows: u32) -> Sheet {
        let (width, height) = (COLUMNS * (SIDE + GAP) - GAP, rows * (SIDE + GAP) - GAP);
        Sheet { width, bytes: vec![255; 3 * width as usize * height as usize] }
    }

    /// Puts the part of an image from (`x`, `y`) on into a cell.
    fn put(&mut self, image: &Raster, (x, y): (u32, u32), (column, row): (u32, u32)) {
        let (left, top) = (column * (SIDE + GAP), row * (SIDE + GAP));
        for (line, at) in (0..SIDE).flat_map(|line| (0..SIDE).map(move |at| (line, at))) {
            let texel = image.texel(x + at, y + line).truncate().to_array();
            let start = 3 * ((top + line) * self.width + left + at) as usize;
            self.bytes[start..start + 3].copy_from_slice(&texel.map(texfold::core::image::to_u8));
        }
    }
}

/// What is coded of an image for the part at `x`, `y`, and where the part begins in it.
fn coded(image: &Raster, (x, y): (u32, u32)) -> Outcome<(Raster, (u32, u32))> {
    let size = image.size();
    let first = |at: u32, all: u32| (at + SIDE / 2).saturating_sub(CODED / 2).min(all.saturating_sub(CODED));
    let (left, top) = (first(x, size.width), first(y, size.height));
    let part = part(image, (left, top), (size.width.min(CODED), size.height.min(CODED)))?;
    Ok((part, (x - left, y - top)))
}

fn astc(image: &Raster, form: Astc) -> Outcome<Raster> {
    let decoded = match form {
        Astc::Whole(width, height) => rivals::astc(image, (width, height))?,
        Astc::Halved(width, height) => rivals::halved_astc(image, (width, height))?,
    };
    Ok(decoded.map_or_else(|| image.clone(), |(decoded, _)| decoded))
}

/// The best JPEG within so many bits, or the smallest.
fn jpeg(image: &Raster, rate: f64) -> Outcome<Raster> {
    let mut best = rivals::jpeg(image, 1)?.0;
    for quality in (4..=98).step_by(2) {
        let (decoded, bits) = rivals::jpeg(image, quality)?;
        if bits > rate {
            break;
        }
        best = decoded;
    }
    Ok(best)
}

fn ours(image: &Raster, rate: f64) -> Outcome<Raster> {
    let params = DctParams::default().with_goal(Goal::Bpp(rate));
    let texture = Dct::encode(&ImageSet::single(image.clone()), &params, &mut Job::default())?;
    decode_surface(&texture, 0, 0).ok_or("an image does not decode".into())
}

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (out, parts) = arguments.split_first().ok_or("name the sheet's file, then images with X and Y")?;
    let (parts, rest) = parts.as_chunks::<3>();
    if parts.is_empty() || !rest.is_empty() {
        return Err("name X and Y behind each image".into());
    }
    let mut sheet = Sheet::new((parts.len() * RATES.len()) as u32);
    for (number, [path, x, y]) in (0..).zip(parts) {
        let image = texfold_testkit::png(Path::new(path)).with_channels(3);
        let (image, at) = coded(&image, (x.parse()?, y.parse()?))?;
        for (line, (rate, form)) in (0..).zip(RATES) {
            let row = number * RATES.len() as u32 + line;
            let cells = [image.clone(), astc(&image, form)?, jpeg(&image, rate)?, ours(&image, rate)?];
            (0..).zip(&cells).for_each(|(column, cell)| sheet.put(cell, at, (column, row)));
        }
    }
    let height = sheet.bytes.len() as u32 / 3 / sheet.width;
    image::save_buffer(out, &sheet.bytes, sheet.width, height, image::ExtendedColorType::Rgb8)?;
    Ok(())
}
