//! What the benches that write tables and charts share: parts of images, CPU time, tables, charts of lines.

use std::error::Error;
use std::path::Path;

use texfold::core::image::Raster;
use texfold_chart::{Axis, Chart, Kind, Names, SMALL, Scale, Series};
pub use texfold_cli::cpu_seconds;

/// What a bench may fail with.
pub type Outcome<T> = Result<T, Box<dyn Error>>;

/// The middle of an image, at most `width` x `height` texels.
///
/// # Errors
/// None for images that are.
pub fn middle(image: &Raster, width: u32, height: u32) -> Outcome<Raster> {
    let size = image.size();
    let (width, height) = (size.width.min(width), size.height.min(height));
    let (left, top) = ((size.width - width) / 2, (size.height - height) / 2);
    let texel = |i: u32| image.texel(left + i % width, top + i / width);
    let texels: Vec<_> = (0..width * height).map(texel).collect();
    Ok(Raster::from_texels(width, height, image.info(), &texels)?)
}

/// An image at 1 / `factor` of its size, each texel the mean of those it stands for.
///
/// # Errors
/// Where nothing would be left.
pub fn reduced(image: &Raster, factor: u32) -> Outcome<Raster> {
    let size = image.size();
    let (width, height) = (size.width / factor, size.height / factor);
    let texel = |i: u32| {
        let (left, top) = (i % width * factor, i / width * factor);
        let mut sum = texfold::Texel::ZERO;
        for (y, x) in (0..factor).flat_map(|y| (0..factor).map(move |x| (y, x))) {
            sum += image.texel(left + x, top + y);
        }
        sum / (factor * factor) as f32
    };
    let texels: Vec<_> = (0..width * height).map(texel).collect();
    Ok(Raster::from_texels(width, height, image.info(), &texels)?)
}

/// RMS error in percent of the full range, as the paper gives it.
#[must_use]
pub fn rms_percent(psnr: f64) -> f64 {
    100.0 / 10f64.powf(psnr / 20.0)
}

/// A table that is written as CSV and as Markdown.
#[derive(Debug)]
pub struct Table {
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table with these columns.
    #[must_use]
    pub fn new(columns: &[&str]) -> Self {
        Table { rows: vec![columns.iter().map(|&column| column.to_owned()).collect()] }
    }

    /// A row, which also goes to stdout.
    pub fn row(&mut self, cells: Vec<String>) {
        println!("{}", cells.join(", "));
        self.rows.push(cells);
    }

    /// Writes `<name>.csv` and `<name>.md` into `out`; the latter begins with `text`.
    ///
    /// # Errors
    /// Where a file cannot be written.
    pub fn write(&self, out: &Path, name: &str, text: &str) -> Outcome<()> {
        let quoted = |cell: &String| if cell.contains(',') { format!("\"{cell}\"") } else { cell.clone() };
        let line = |row: &Vec<String>| row.iter().map(quoted).collect::<Vec<_>>().join(",") + "\n";
        std::fs::write(out.join(name).with_extension("csv"), self.rows.iter().map(line).collect::<String>())?;
        let line = |row: &Vec<String>| format!("| {} |\n", row.join(" | "));
        let mut lines = self.rows.iter().map(line);
        let head = lines.next().unwrap_or_default();
        let rule = format!("|{}\n", "---|".repeat(self.rows[0].len()));
        let table = head + &rule + &lines.collect::<String>();
        std::fs::write(out.join(name).with_extension("md"), format!("{text}\n\n{table}"))?;
        Ok(())
    }
}

/// A line of a chart: its name and points.
pub type Line = (String, Vec<(f64, f64)>);

/// Draws lines with a mark at each point as SVG, over a lower and a left axis.
///
/// # Errors
/// Where the file cannot be written.
pub fn chart(path: &Path, title: &str, [across, up]: [(&str, Scale); 2], lines: &[Line]) -> Outcome<()> {
    let axis = |(label, scale)| Axis { label, scale };
    let series = lines.iter().enumerate().map(|(index, (name, points))| Series {
        name: name.clone(),
        colour: Some(index),
        kind: Kind::Both,
        points: points.iter().map(|&point| point.into()).collect(),
    });
    let series = series.collect();
    let chart = Chart { title, across: axis(across), up: axis(up), size: SMALL, names: Names::Above, series };
    Ok(std::fs::write(path, chart.svg())?)
}
