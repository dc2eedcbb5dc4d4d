//! Charts of means as SVG.

use std::error::Error;
use std::ops::Range;

use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use texfold::encoding::ENCODINGS;

use super::candidate::RIVAL;
use super::names;
use super::table::{Row, front};

/// Size of a chart in SVG units.
const SIZE: (u32, u32) = (860, 520);

/// Room left of the points, in doublings; names stand to their right, where there is more.
const MARGIN_DOUBLINGS: f64 = 0.4;

/// Share of the width that is left right of the points.
const NAME_SHARE: f64 = 0.18;

/// Room below and above the points in dB.
const MARGIN_DB: f64 = 1.5;

/// Share of the height that is left above the points of a chart whose legend stands there.
const LEGEND_SHARE: f64 = 0.25;

/// PSNR above which a point is drawn at the edge: lossless results would flatten all others.
const CEILING_DB: f64 = 60.0;

/// A figure on the horizontal axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Axis {
    pub(crate) title: &'static str,
    pub(crate) label: &'static str,
    pub(crate) value: fn(&Row) -> Option<f64>,
    /// What the ticks are powers of two of.
    pub(crate) unit: f64,
    pub(crate) smaller_is_better: bool,
}

/// The charts of a report.
pub(crate) const AXES: [Axis; 5] = [
    Axis {
        title: "Compressed size and quality",
        label: "bits per texel, compressed",
        value: |row| Some(row.bpp_memory),
        unit: 1.0,
        smaller_is_better: true,
    },
    Axis {
        title: "GPU memory while drawn and quality",
        label: "bits of GPU memory per texel while drawn",
        value: |row| Some(row.bpp_resident),
        unit: 1.0,
        smaller_is_better: true,
    },
    Axis {
        title: "Speed of encoding and quality",
        label: "texels encoded per second",
        value: |row| Some(row.encode_texels_per_second()),
        unit: 1e6,
        smaller_is_better: false,
    },
    Axis {
        title: "Speed of decoding on one CPU thread and quality",
        label: "texels decoded per second, CPU",
        value: |row| row.decode_cpu_texels_per_second,
        unit: 1e6,
        smaller_is_better: false,
    },
    Axis {
        title: "Speed of decoding on the GPU and quality",
        label: "texels decoded per second, GPU",
        value: |row| row.decode_gpu_texels_per_second,
        unit: 1e6,
        smaller_is_better: false,
    },
];

type Fault = Box<dyn Error + Send + Sync>;

/// A mean in its place: doublings of the unit, and dB.
type Placed<'r> = (&'r Row, (f64, f64));

/// Colours of the codecs' points, in the order of [`ENCODINGS`]; further ones begin again.
const COLORS: [RGBColor; 6] = [
    RGBColor(0xc0, 0x5a, 0x00),
    RGBColor(0x00, 0x5f, 0xa8),
    RGBColor(0x8e, 0x24, 0x8a),
    RGBColor(0xc2, 0x18, 0x2b),
    RGBColor(0x00, 0x80, 0x80),
    RGBColor(0x80, 0x6a, 0x00),
];
/// Colour of the points of the external encoder.
const RIVAL_COLOR: RGBColor = RGBColor(0x3a, 0x7d, 0x2c);

/// Colour of a codec's points.
fn color(codec: &str) -> RGBColor {
    let place = ENCODINGS.iter().position(|encoding| encoding.id.name == codec);
    place.map_or(RIVAL_COLOR, |place| COLORS[place % COLORS.len()])
}

/// The chart; `None` where no row has the figure.
pub(crate) fn svg(means: &[Row], axis: Axis) -> Result<Option<String>, Fault> {
    let place = |row| -> Option<Placed<'_>> {
        let value = (axis.value)(row).filter(|&value| value > 0.0)?;
        Some((row, ((value / axis.unit).log2(), row.psnr.min(CEILING_DB))))
    };
    let placed: Vec<Placed<'_>> = means.iter().filter_map(place).collect();
    if placed.is_empty() {
        return Ok(None);
    }
    let mut text = String::new();
    draw(&mut text, &placed, axis).map_err(|message| Fault::from(message.to_string()))?;
    Ok(Some(text))
}

/// The drawing in progress.
type Chart<'a, 't> = ChartContext<'a, SVGBackend<'t>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

fn draw(text: &mut String, placed: &[Placed<'_>], axis: Axis) -> Result<(), Box<dyn Error>> {
    let area = SVGBackend::with_string(text, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let (across, up) = ranges(placed, axis);
    let mut chart = ChartBuilder::on(&area)
        .caption(axis.title, ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(46)
        .y_label_area_size(56)
        .build_cartesian_2d(across, up)?;
    draw_grid(&mut chart, axis)?;
    draw_points(&mut chart, placed, axis)?;
    let pixels: Vec<(i32, i32)> = placed.iter().map(|(_, point)| chart.backend_coord(point)).collect();
    let texts: Vec<&str> = placed.iter().map(|(row, _)| row.settings.as_str()).collect();
    for ((row, _), at) in placed.iter().zip(names::place(&pixels, &texts, axis.smaller_is_better)) {
        let style = ("sans-serif", names::FONT).into_font().color(&color(row.codec));
        area.draw(&Text::new(row.settings.clone(), at, style))?;
    }
    draw_legend(&mut chart, axis)?;
    area.present()?;
    Ok(())
}

fn draw_grid<'a, 't: 'a>(chart: &mut Chart<'a, 't>, axis: Axis) -> Result<(), Box<dyn Error>> {
    chart
        .configure_mesh()
        .x_desc(axis.label)
        .y_desc("PSNR in dB, mean over inputs")
        .x_labels(16)
        .x_label_formatter(&|doublings| tick(*doublings, axis.unit))
        .y_label_formatter(&|value| format!("{value:.0}"))
        .label_style(("sans-serif", 15))
        .axis_desc_style(("sans-serif", 16))
        .max_light_lines(1)
        .bold_line_style(RGBColor(0xe4, 0xe4, 0xe4))
        .draw()
        .map_err(|error| error.to_string().into())
}

/// The front as a line, and each setting as a dot in its codec's colour.
fn draw_points<'a, 't: 'a>(
    chart: &mut Chart<'a, 't>,
    placed: &[Placed<'_>],
    axis: Axis,
) -> Result<(), Box<dyn Error>> {
    let points: Vec<(f64, f64)> = placed.iter().map(|(_, point)| *point).collect();
    let best = front(&points, axis.smaller_is_better);
    let ink = BLACK.mix(0.6).stroke_width(2);
    chart
        .draw_series(LineSeries::new(best.iter().map(|&index| points[index]), ink))
        .map_err(|error| error.to_string())?
        .label("Pareto front")
        .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], ink));
    for codec in ENCODINGS.iter().map(|encoding| encoding.id.name).chain([RIVAL]) {
        let of_codec = placed.iter().filter(|(row, _)| row.codec == codec);
        let dots: Vec<_> = of_codec.map(|(_, point)| Circle::new(*point, 5, color(codec).filled())).collect();
        if !dots.is_empty() {
            let legend = move |(x, y)| Circle::new((x + 9, y), 5, color(codec).filled());
            chart.draw_series(dots).map_err(|error| error.to_string())?.label(codec).legend(legend);
        }
    }
    Ok(())
}

fn draw_legend<'a, 't: 'a>(chart: &mut Chart<'a, 't>, axis: Axis) -> Result<(), Box<dyn Error>> {
    // Quality rises with size and falls with speed: the legend stands where the front does not go.
    let corner = if axis.smaller_is_better {
        SeriesLabelPosition::LowerRight
    } else {
        SeriesLabelPosition::UpperRight
    };
    chart
        .configure_series_labels()
        .position(corner)
        .background_style(WHITE.mix(0.9))
        .border_style(RGBColor(0xbb, 0xbb, 0xbb))
        .label_font(("sans-serif", 15))
        .draw()
        .map_err(|error| error.to_string().into())
}

/// The axes' extents, with room around the points.
fn ranges(placed: &[Placed<'_>], axis: Axis) -> (Range<f64>, Range<f64>) {
    let extent = |values: &mut dyn Iterator<Item = f64>| {
        values
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
    };
    let (left, right) = extent(&mut placed.iter().map(|(_, point)| point.0));
    let (low, high) = extent(&mut placed.iter().map(|(_, point)| point.1));
    let right = right + MARGIN_DOUBLINGS + NAME_SHARE * (right - left);
    // The legend of a speed chart stands at the top.
    let legend = if axis.smaller_is_better { 0.0 } else { LEGEND_SHARE * (high - low + 2.0 * MARGIN_DB) };
    (left - MARGIN_DOUBLINGS..right, low - MARGIN_DB..high + MARGIN_DB + legend)
}

/// The text at a tick: whole doublings only.
fn tick(doublings: f64, unit: f64) -> String {
    if (doublings - doublings.round()).abs() > 1e-6 {
        return String::new();
    }
    short(doublings.round().exp2() * unit)
}

/// A number in few letters: 0.25, 12, 3.5M.
fn short(value: f64) -> String {
    let (scaled, unit) = match value {
        value if value >= 1e9 => (value / 1e9, "G"),
        value if value >= 1e6 => (value / 1e6, "M"),
        value if value >= 1e3 => (value / 1e3, "k"),
        value => (value, ""),
    };
    let digits = if scaled >= 10.0 { 0 } else { 2 };
    let text = format!("{scaled:.digits$}");
    let text = if digits > 0 { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    format!("{text}{unit}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_short_and_at_whole_doublings() {
        let texts = [0.25, 4.0, 12.4, 3_500.0, 2.25e7, 1e9].map(short);
        assert_eq!(texts, ["0.25", "4", "12", "3.5k", "22M", "1G"]);
        assert_eq!(
            (tick(-2.0, 1.0), tick(0.5, 1.0), tick(3.0, 1e6)),
            ("0.25".into(), String::new(), "8M".into())
        );
    }
}
