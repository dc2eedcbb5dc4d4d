//! Quality of new views against size: a line for each mesh, factors with signs and without.

use std::path::Path;

use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use texfold_benches::report::Outcome;

/// Places of kilobytes and dB.
type Points = Vec<(f64, f64)>;

/// One line: which colour and whether it is full, its name, and its points.
pub(crate) struct Curve {
    pub(crate) colour: usize,
    pub(crate) full: bool,
    pub(crate) name: String,
    pub(crate) points: Points,
}

/// Width of lines in pixels; those that are not full are half as wide, with open marks.
const WIDTH: u32 = 2;
/// Colours of the palette that stand out on white.
const COLOURS: [usize; 5] = [0, 1, 5, 3, 4];
/// The least size of the axis, in kB, from which its marks double.
const LEAST: f64 = 62.5;
/// Doublings that it shows.
const DOUBLINGS: f64 = 6.2;

/// Draws curves over the logarithm of their size, and a level beside them.
///
/// # Errors
/// Where the file cannot be written.
pub(crate) fn draw(curves: &[Curve], level: (&str, f64), path: &Path) -> Outcome<()> {
    let root = SVGBackend::new(path, (860, 520)).into_drawing_area();
    root.fill(&WHITE)?;
    let highest = curves.iter().flat_map(|curve| &curve.points).map(|point| point.1).fold(0.0, f64::max);
    let lowest = curves.iter().flat_map(|curve| &curve.points).map(|point| point.1).fold(highest, f64::min);
    let mut chart = ChartBuilder::on(&root)
        .caption("New views by size of the file", ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(56)
        .build_cartesian_2d(0.0..DOUBLINGS, lowest.floor()..highest.ceil() + 0.5)?;
    let size = |doublings: &f64| format!("{:.0}", LEAST * doublings.exp2());
    let mut mesh = chart.configure_mesh();
    mesh.x_labels(8).light_line_style(WHITE).x_label_formatter(&size).x_desc("kB").y_desc("dB").draw()?;
    for curve in curves {
        add(&mut chart, curve)?;
    }
    let (name, height) = level;
    let dashes = DashedLineSeries::new([(0.0, height), (DOUBLINGS, height)], 6, 4, BLACK.stroke_width(1));
    chart
        .draw_series(dashes)?
        .label(name)
        .legend(|(x, y)| PathElement::new([(x, y), (x + 18, y)], BLACK.stroke_width(1)));
    let mut names = chart.configure_series_labels();
    names.position(SeriesLabelPosition::LowerRight).background_style(WHITE).border_style(BLACK).draw()?;
    root.present()?;
    Ok(())
}

fn add<'a>(
    chart: &mut ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>,
    curve: &Curve,
) -> Outcome<()> {
    let colour = Palette99::pick(COLOURS[curve.colour % COLOURS.len()]).to_rgba();
    let style = colour.stroke_width(if curve.full { WIDTH } else { WIDTH / 2 });
    let mark = if curve.full { colour.filled() } else { colour.stroke_width(1) };
    let points: Points = curve.points.iter().map(|&(size, db)| ((size / LEAST).log2(), db)).collect();
    chart
        .draw_series(LineSeries::new(points.iter().copied(), style))?
        .label(&curve.name)
        .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
    chart.draw_series(points.into_iter().map(|point| Circle::new(point, 3, mark)))?;
    Ok(())
}
