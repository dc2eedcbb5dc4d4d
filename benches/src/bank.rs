//! Banks: a picture of any size to add to one, and how codebook and cost grow with the images that are there.
//!
//! `cargo run --release -p texfold-benches --bin bank -- land FILE.tif [SIDE]` writes drawn land of 16384 x 16384 texels.

use std::error::Error;
use std::fs::File;
use std::io::BufWriter;

use texfold_benches::over;
use texfold_testkit::fixtures::land::land;
use tiff::encoder::{TiffEncoder, colortype::RGB8};

/// Texels a side of the land.
const SIDE: u32 = 16_384;
/// Rows that are drawn and written at a time.
const ROWS: u32 = 64;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments.as_slice() {
        ["land", path] => draw(path, SIDE),
        ["land", path, side] => draw(path, side.parse()?),
        _ => Err("say land FILE.tif [SIDE]".into()),
    }
}

/// Writes land as a TIFF file in strips.
fn draw(path: &str, side: u32) -> Result<(), Box<dyn Error>> {
    let mut encoder = TiffEncoder::new(BufWriter::new(File::create(path)?))?;
    let mut image = encoder.new_image::<RGB8>(side, side)?;
    image.rows_per_strip(ROWS)?;
    for top in (0..side).step_by(ROWS as usize) {
        let rows = ROWS.min(side - top);
        let strip = over(rows as usize, |row| land((0, top + row as u32), (side, 1))).concat();
        image.write_strip(&strip)?;
    }
    image.finish()?;
    Ok(())
}
