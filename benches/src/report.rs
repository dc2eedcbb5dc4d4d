//! What the benches that write tables and charts share: parts of images, CPU time, tables, charts of lines.

use std::error::Error;
use std::path::{Path, PathBuf};

use plotters::prelude::*;
use texfold::core::image::Raster;

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

/// The image of that name, or all PNG and JPEG images of the folder, in the order of their names.
///
/// # Errors
/// A folder that cannot be read.
pub fn images_of(path: &Path) -> Outcome<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let entries = std::fs::read_dir(path)?.collect::<Result<Vec<_>, _>>()?;
    let is_image = |path: &PathBuf| path.extension().is_some_and(|name| name == "png" || name == "jpg");
    let mut images: Vec<PathBuf> = entries.iter().map(|entry| entry.path()).filter(is_image).collect();
    images.sort();
    Ok(images)
}

/// CPU seconds that this process has used, all threads together, to a hundredth of a second; 0 where the system has no
/// `/proc`.
#[must_use]
pub fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // Fields 14 and 15, counted after the name, which may hold anything but ends with the last bracket.
    let after = stat.rsplit(')').next().unwrap_or_default();
    let ticks: f64 =
        after.split_whitespace().skip(11).take(2).filter_map(|field| field.parse::<f64>().ok()).sum();
    ticks / 100.0
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

/// What a chart of lines says beside its lines.
#[derive(Debug, Clone, Copy)]
pub struct Chart<'c> {
    /// Above it.
    pub caption: &'c str,
    /// Below it.
    pub across: &'c str,
    /// At its left.
    pub up: &'c str,
    /// Whether both axes are logarithmic.
    pub logarithmic: bool,
}

impl Chart<'_> {
    /// Draws lines with a mark at each point, as SVG.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn draw(&self, lines: &[Line], path: &Path) -> Outcome<()> {
        let points = || lines.iter().flat_map(|(_, line)| line);
        let least = |of: fn(&(f64, f64)) -> f64| points().map(of).fold(f64::INFINITY, f64::min);
        let most = |of: fn(&(f64, f64)) -> f64| points().map(of).fold(0.0, f64::max);
        let (left, right) = (least(|p| p.0), most(|p| p.0));
        let (low, high) = (least(|p| p.1), most(|p| p.1));
        let root = SVGBackend::new(path, (720, 480)).into_drawing_area();
        root.fill(&WHITE)?;
        let mut builder = ChartBuilder::on(&root);
        builder
            .caption(self.caption, ("sans-serif", 20))
            .margin(12)
            .x_label_area_size(44)
            .y_label_area_size(56);
        if self.logarithmic {
            let across = (left * 0.9..right * 1.1).log_scale();
            let mut chart = builder.build_cartesian_2d(across, (low * 0.8..high * 1.25).log_scale())?;
            let mut mesh = chart.configure_mesh();
            // More labels run into each other where the axis is narrow.
            mesh.x_labels(4).light_line_style(WHITE).x_desc(self.across).y_desc(self.up).draw()?;
            draw_lines(&mut chart, lines, SeriesLabelPosition::LowerRight)?;
        } else {
            // Room at the right for the names.
            // From zero, unless all values lie far above: decibels.
            let floor = if low > 0.4 * high { low - 0.1 * (high - low) } else { low.min(0.0) };
            let mut chart =
                builder.build_cartesian_2d(0.0..right * 1.4, floor..(high * 1.08).max(floor + 1e-9))?;
            let mut mesh = chart.configure_mesh();
            mesh.light_line_style(WHITE).x_desc(self.across).y_desc(self.up).draw()?;
            draw_lines(&mut chart, lines, SeriesLabelPosition::UpperRight)?;
        }
        root.present()?;
        Ok(())
    }
}

fn draw_lines<'a, X, Y>(
    chart: &mut ChartContext<'a, SVGBackend<'a>, Cartesian2d<X, Y>>,
    lines: &[Line],
    names: SeriesLabelPosition,
) -> Outcome<()>
where
    X: Ranged<ValueType = f64>,
    Y: Ranged<ValueType = f64>,
{
    for (index, (name, line)) in lines.iter().enumerate() {
        let color = Palette99::pick(index).to_rgba();
        chart
            .draw_series(LineSeries::new(line.iter().copied(), color.stroke_width(2)))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(2)));
        chart.draw_series(line.iter().map(|&point| Circle::new(point, 4, color.filled())))?;
    }
    chart
        .configure_series_labels()
        .position(names)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK)
        .draw()?;
    Ok(())
}
