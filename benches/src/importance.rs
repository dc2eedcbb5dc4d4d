//! Charts what the salient quarter of images gains, and what the whole loses, with the weight of importance.
//!
//! `cargo run --release -p texfold-benches --bin importance -- [OUT_DIR] [IMAGE.png …]`: without images, the
//! Kodak photographs where they are, else fixtures. Writes importance.csv and importance.svg.

use std::error::Error;
use std::path::PathBuf;

use texfold::core::image::{ImageSet, Raster};
use texfold::core::metric::decode_image;
use texfold::{Content, vq::VqParams};
use texfold_benches::report::chart;
use texfold_benches::salient_psnr;
use texfold_chart::Scale;

/// Weights of importance that are charted; 1 is the default.
const WEIGHTS: [f32; 6] = [0.0, 0.25, 0.5, 1.0, 2.0, 4.0];

/// PSNR of the whole and of the most salient quarter.
#[derive(Debug, Clone, Copy, Default)]
struct Row {
    weight: f32,
    whole: f64,
    salient: f64,
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let out = PathBuf::from(arguments.next().unwrap_or_else(|| "target/importance".to_owned()));
    let given: Vec<PathBuf> = arguments.map(PathBuf::from).collect();
    let paths = if given.is_empty() { usual_images()? } else { given };
    let images: Vec<Raster> = paths.iter().map(|path| texfold_testkit::png(path)).collect();
    let rows: Vec<Row> = WEIGHTS.iter().filter_map(|&weight| measure(&images, weight)).collect();
    std::fs::create_dir_all(&out)?;
    let mut csv = "importance,psnr,psnr_salient_quarter\n".to_owned();
    for row in &rows {
        csv += &format!("{},{:.3},{:.3}\n", row.weight, row.whole, row.salient);
    }
    print!("{} images at 9.6:1, raw codebook\n{csv}", images.len());
    std::fs::write(out.join("importance.csv"), csv)?;
    let line = |name: &str, value: fn(&Row) -> f64| {
        (name.to_owned(), rows.iter().map(|row| (f64::from(row.weight), value(row))).collect())
    };
    let lines = [line("whole image", |row| row.whole), line("most salient quarter", |row| row.salient)];
    let axes = [("weight of importance", Scale::Linear), ("PSNR in dB", Scale::Linear)];
    chart(&out.join("importance.svg"), "Importance: what the salient quarter gains", axes, &lines)
}

fn usual_images() -> Result<Vec<PathBuf>, Box<dyn Error>> {
    let Some(data) = texfold_testkit::data_dir("the chart on Kodak photographs") else {
        let fixture = |name: &str| texfold_testkit::fixtures_dir().join(format!("images/{name}.png"));
        return Ok(["facade", "salient", "terrain", "cloth", "floor"].map(fixture).to_vec());
    };
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(data.join("vq/kodak"))?.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    Ok(paths)
}

/// Means over the images, a codebook of 1/16 of each (9.6:1 against 24 bits), no sample.
fn measure(images: &[Raster], weight: f32) -> Option<Row> {
    let mut row = Row { weight, ..Row::default() };
    for image in images {
        let set = ImageSet::single(image.clone());
        let cells = image.size().texels() / 256;
        let width = (((cells as f64).sqrt() * 1.2) as u32).clamp(1, 64);
        let height = (cells as u32 / width).clamp(1, 64);
        let params = VqParams::default()
            .with_codebook((width * 4, height * 4))
            .with_samples((0, 0))
            .with_importance(weight)
            .with_content(Content::Raw);
        let texture = texfold_benches::vq(&set, &params)?;
        let decoded = decode_image(texture.as_encoded(), 0, 0)?;
        let (whole, salient) = salient_psnr(image, &decoded);
        row.whole += whole / images.len() as f64;
        row.salient += salient / images.len() as f64;
    }
    Some(row)
}
