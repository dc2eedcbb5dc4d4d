//! Charts the memory of an epitome with raw content against the side of its blocks and against the tolerance (Figures 21 and
//! 22 of the paper).
//!
//! `cargo run --release -p texfold-benches --bin epitome -- [OUT_DIR] [PICTURE.png …]`: the middle of each picture, 504 x 504
//! texels at most; without pictures, photographs where they are, else fixtures. Writes epitome.csv, block.svg and
//! tolerance.svg.

use std::error::Error;
use std::path::{Path, PathBuf};

use plotters::prelude::*;
use texfold::image::{ImageSet, Raster};
use texfold::metric::measure;
use texfold::target::Measured;
use texfold::{Content, Epitome, EpitomeParams, EpitomeSource, Goal, Job, TextureCodec};

/// Sides of blocks that are charted.
const BLOCKS: [u32; 6] = [8, 12, 16, 20, 24, 28];
/// Tolerances that are charted: RMS error of the worst 4x4 block, 8-bit units.
const TOLERANCES: [f64; 6] = [6.0, 10.0, 16.0, 24.0, 36.0, 50.0];
/// Side and tolerance where the other one is charted.
const USUAL: (u32, f64) = (12, 24.0);
/// Texels a side of what is taken from a picture.
const SIDE: u32 = 504;

/// One picture's line: its name, and memory against raw at each value of what is charted.
type Line = (String, Vec<(f64, f64)>);

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let out = PathBuf::from(arguments.next().unwrap_or_else(|| "target/epitome".to_owned()));
    let given: Vec<PathBuf> = arguments.map(PathBuf::from).collect();
    let paths = if given.is_empty() { usual_pictures() } else { given };
    std::fs::create_dir_all(&out)?;
    let mut csv = "picture,block,tolerance,share_of_raw,psnr,rms\n".to_owned();
    let (mut by_block, mut by_tolerance): (Vec<Line>, Vec<Line>) = Default::default();
    for path in &paths {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let set = ImageSet::single(middle(&texfold_testkit::png(path))?);
        let mut point = |block: u32, tolerance: f64| -> Result<f64, Box<dyn Error>> {
            let measured = encode(&set, block, tolerance)?;
            let share = measured.bpp / f64::from(8 * set.info().channels);
            let rms = 255.0 / 10f64.powf(measured.psnr / 20.0);
            csv += &format!("{name},{block},{tolerance},{share:.4},{:.2},{rms:.2}\n", measured.psnr);
            Ok(share)
        };
        let mut line = Vec::new();
        for block in BLOCKS {
            line.push((f64::from(block), point(block, USUAL.1)?));
        }
        by_block.push((name.clone(), line));
        let mut line = Vec::new();
        for tolerance in TOLERANCES {
            line.push((tolerance, point(USUAL.0, tolerance)?));
        }
        by_tolerance.push((name.clone(), line));
    }
    print!("{csv}");
    std::fs::write(out.join("epitome.csv"), csv)?;
    chart(&by_block, ("Memory against the side of blocks", "texels a side"), &out.join("block.svg"))?;
    let axes = ("Memory against tolerance", "RMS error of the worst 4x4 block, 8-bit units");
    chart(&by_tolerance, axes, &out.join("tolerance.svg"))
}

fn usual_pictures() -> Vec<PathBuf> {
    match texfold_testkit::data_dir("the charts on photographs") {
        Some(data) => ["skimage_brick", "urban100_021", "urban100_100"]
            .map(|name| data.join(format!("epitome/{name}.png")))
            .to_vec(),
        None => ["facade", "cloth", "tile_repeat"]
            .map(|name| texfold_testkit::fixtures_dir().join(format!("images/{name}.png")))
            .to_vec(),
    }
}

/// The middle of a picture.
fn middle(picture: &Raster) -> Result<Raster, Box<dyn Error>> {
    let size = picture.size();
    let (width, height) = (size.width.min(SIDE), size.height.min(SIDE));
    let (left, top) = ((size.width - width) / 2, (size.height - height) / 2);
    let texel = |i: u32| picture.texel(left + i % width, top + i / width);
    let texels: Vec<_> = (0..width * height).map(texel).collect();
    Ok(Raster::from_texels(width, height, picture.info(), &texels)?)
}

fn encode(set: &ImageSet, block: u32, tolerance: f64) -> Result<Measured, Box<dyn Error>> {
    let params = EpitomeParams {
        goal: Goal::Tolerance(tolerance),
        content: Some(Content::Raw),
        block: Some(block),
        ..EpitomeParams::default()
    };
    let texture = Epitome::encode(EpitomeSource::new(set), &params, &mut Job::default())?;
    Ok(measure(set, &texture))
}

fn chart(lines: &[Line], (caption, across): (&str, &str), path: &Path) -> Result<(), Box<dyn Error>> {
    let points = || lines.iter().flat_map(|(_, line)| line);
    let right = points().map(|point| point.0).fold(0.0, f64::max);
    let root = SVGBackend::new(path, (720, 480)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .caption(caption, ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(56)
        .build_cartesian_2d(0.0..right * 1.05, 0.0..1.1)?;
    chart.configure_mesh().x_desc(across).y_desc("share of raw memory").draw()?;
    for (index, (name, line)) in lines.iter().enumerate() {
        let color = Palette99::pick(index).to_rgba();
        chart
            .draw_series(LineSeries::new(line.iter().copied(), color.stroke_width(2)))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(2)));
        chart.draw_series(line.iter().map(|&point| Circle::new(point, 4, color.filled())))?;
    }
    chart.configure_series_labels().background_style(WHITE).border_style(BLACK).draw()?;
    root.present()?;
    Ok(())
}
