//! Charts of means: curves of series over bits, and what a series costs at equal bits.

use texfold_chart::{Axis, Chart, Kind, NARROW, Names, Point, SMALL, Scale, Series};

use super::curve::Curve;
use super::light;
use super::storage;
use super::table::{Row, means};

/// PSNR above which a point is drawn at the edge: lossless results would flatten all others.
pub(super) const CEILING_DB: f64 = 60.0;

/// Octaves of bits within which a setting has the bits at which speeds are compared.
const EQUAL_OCTAVES: f64 = 0.1;

/// A figure of quality, better where it is larger.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quality {
    pub(super) name: &'static str,
    label: &'static str,
    pub(super) value: fn(&Row) -> Option<f64>,
}

pub(super) const PSNR: Quality =
    Quality { name: "PSNR", label: "PSNR in dB", value: |row| Some(row.psnr.min(CEILING_DB)) };
pub(super) const PERCEIVED: Quality =
    Quality { name: "SSIMULACRA2", label: "SSIMULACRA2", value: |row| row.ssimulacra2 };

/// A figure on the horizontal axis.
#[derive(Debug, Clone, Copy)]
struct Across {
    title: &'static str,
    label: &'static str,
    value: fn(&Row) -> Option<f64>,
    /// What ticks are powers of two of.
    unit: f64,
    /// Whether it is compared at equal bits alone.
    is_at_equal_bits: bool,
}

const CHARTS: [(Across, Quality); 8] = [
    (HELD, PSNR),
    (HELD, PERCEIVED),
    (STORED, PSNR),
    (DECODED, PSNR),
    (ENCODING, PSNR),
    (ENCODING, PERCEIVED),
    (CPU, PSNR),
    (GPU, PSNR),
];

/// Of captures: sizes are of the whole.
const LIGHT_CHARTS: [(Across, Quality); 4] =
    [(KILOBYTES, PSNR), (KILOBYTES, PERCEIVED), (MEMORY, PSNR), (SECONDS, PSNR)];

const KILOBYTES: Across = Across {
    title: "Files",
    label: "kB",
    value: |row| Some(row.bpp_disk * row.texels / 8e3),
    unit: 1.0,
    is_at_equal_bits: false,
};
const MEMORY: Across =
    Across { title: "Memory, compressed", value: |row| Some(row.bpp_memory * row.texels / 8e3), ..KILOBYTES };
const SECONDS: Across =
    Across { title: "Encoding", label: "CPU seconds", value: |row| row.encode_cpu_seconds, ..KILOBYTES };

const HELD: Across = Across {
    title: "Compressed size",
    label: "bits a texel, compressed",
    value: |row| Some(row.bpp_memory),
    unit: 1.0,
    is_at_equal_bits: false,
};
const STORED: Across =
    Across { title: "Files", label: "bits a texel, on disk", value: |row| Some(row.bpp_disk), ..HELD };
const DECODED: Across = Across {
    title: "GPU memory decoded whole",
    label: "bits of GPU memory a texel, decoded whole",
    value: |row| Some(row.bpp_resident),
    ..HELD
};
const ENCODING: Across = Across {
    title: "Encoding",
    label: "CPU seconds a megatexel",
    value: Row::cpu_seconds_a_megatexel,
    unit: 1.0,
    is_at_equal_bits: true,
};
const CPU: Across = Across {
    title: "Decoding on one CPU thread",
    label: "texels decoded a second",
    value: |row| row.decode_cpu_texels_per_second,
    unit: 1e6,
    is_at_equal_bits: true,
};
const GPU: Across =
    Across { title: "Decoding on the GPU", value: |row| row.decode_gpu_texels_per_second, ..CPU };

/// The settings of a series.
#[derive(Debug)]
pub(super) struct Line<'r> {
    pub(super) name: &'r str,
    pub(super) rows: Vec<&'r Row>,
}

impl<'r> Line<'r> {
    /// Its settings for each effort.
    fn by_effort(&self) -> Vec<Line<'r>> {
        let mut lines: Vec<Line<'r>> = Vec::new();
        for &row in &self.rows {
            match lines.iter_mut().find(|line| line.rows[0].effort == row.effort) {
                Some(line) => line.rows.push(row),
                None => lines.push(Line { name: self.name, rows: vec![row] }),
            }
        }
        lines
    }

    /// Its settings of the last effort, which is the slowest one.
    fn slowest(&self) -> impl Iterator<Item = &'r Row> {
        let effort = self.rows.last().map(|row| &row.effort);
        self.rows.iter().copied().filter(move |row| Some(&row.effort) == effort)
    }

    pub(super) fn curve(&self, quality: Quality) -> Curve {
        Curve::new(self.slowest().filter_map(|row| Some((row.bpp_memory, (quality.value)(row)?))))
    }

    /// A figure and a quality at so many bits: of the setting that has them, else between the settings beside them, of the figure
    /// by the logarithms of both.
    fn at_bits(&self, bpp: f64, value: fn(&Row) -> Option<f64>, quality: Quality) -> Option<(f64, f64)> {
        let away = |row: &Row| (row.bpp_memory / bpp).log2().abs();
        let near = self.rows.iter().min_by(|a, b| away(a).total_cmp(&away(b)))?;
        if away(near) < EQUAL_OCTAVES {
            return value(near).filter(|value| *value > 0.0).zip((quality.value)(near));
        }
        let mut points: Vec<(f64, f64)> = self
            .rows
            .iter()
            .filter_map(|row| Some((row.bpp_memory.log2(), value(row).filter(|value| *value > 0.0)?.log2())))
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let place = bpp.log2();
        let next = points.iter().position(|point| point.0 >= place)?;
        let ((x0, y0), (x1, y1)) = (points[next.checked_sub(1)?], points[next]);
        let share = if x1 > x0 { (place - x0) / (x1 - x0) } else { 1.0 };
        Some(((y0 + (y1 - y0) * share).exp2(), self.curve(quality).quality_at(bpp)?))
    }
}

/// The series of rows, in the order of their first appearance.
pub(super) fn lines(rows: &[Row]) -> Vec<Line<'_>> {
    let mut lines: Vec<Line<'_>> = Vec::new();
    for row in rows {
        match lines.iter_mut().find(|line| line.name == row.series) {
            Some(line) => line.rows.push(row),
            None => lines.push(Line { name: &row.series, rows: vec![row] }),
        }
    }
    lines
}

/// The settings that most inputs have: means over others are of other images.
pub(super) fn comparable(means: &[Row]) -> Vec<Row> {
    let most = means.iter().map(|row| row.inputs).max();
    means.iter().filter(|row| Some(row.inputs) == most).cloned().collect()
}

/// A legend of all series, and the charts that have points.
pub(super) fn svgs(means: &[Row], equal_bpp: f64) -> (String, Vec<String>) {
    let drawn = drawn(means, equal_bpp);
    let legend = drawn.first().map_or(String::new(), |(_, _, series)| texfold_chart::legend(series));
    let svg = |(across, quality, series)| svg(across, quality, series, equal_bpp, (NARROW, Names::Outside));
    (legend, drawn.into_iter().map(svg).collect())
}

/// The charts of rows as files, by their names.
pub(super) fn files(rows: &[Row], equal_bpp: f64) -> Vec<(String, String)> {
    let (of_light, of_images): (Vec<Row>, Vec<Row>) = rows.iter().cloned().partition(light::is_light);
    let mut files = Vec::new();
    for rows in [of_images, of_light] {
        for (across, quality, mut series) in drawn(&comparable(&means(&rows)), equal_bpp) {
            // The front is the line of a series, or near it.
            series.retain(|series| series.kind != Kind::Dashed);
            series.iter_mut().flat_map(|series| &mut series.points).for_each(|point| point.name.clear());
            let name = format!("{} {}.svg", across.title, quality.name).to_lowercase();
            let name = name.replace(", ", " ").replace(' ', "-");
            files.push((name, svg(across, quality, series, equal_bpp, (SMALL, Names::Above))));
        }
    }
    files
}

/// The charts that have points.
fn drawn(means: &[Row], equal_bpp: f64) -> Vec<(Across, Quality, Vec<Series>)> {
    let lines = lines(means);
    let charts: &[(Across, Quality)] =
        if means.iter().any(light::is_light) { &LIGHT_CHARTS } else { &CHARTS };
    let drawn =
        charts.iter().map(|&(across, quality)| (across, quality, series(&lines, across, quality, equal_bpp)));
    drawn.filter(|(_, _, series)| series.iter().any(|series| !series.points.is_empty())).collect()
}

fn svg(
    across: Across,
    quality: Quality,
    series: Vec<Series>,
    equal_bpp: f64,
    (size, names): ((f64, f64), Names),
) -> String {
    let unit = if equal_bpp == 1.0 { "bit" } else { "bits" };
    let bits =
        if across.is_at_equal_bits { format!(" at {equal_bpp} {unit} a texel") } else { String::new() };
    let title = format!("{}{bits} and {}", across.title, quality.name);
    let across = Axis { label: across.label, scale: Scale::Doublings(across.unit) };
    let up = Axis { label: quality.label, scale: Scale::Linear };
    Chart { title: &title, across, up, size, names, series }.svg()
}

/// The series of a chart, and the front of what no other setting beats, of series whose texels are read at random.
fn series(lines: &[Line<'_>], across: Across, quality: Quality, equal_bpp: f64) -> Vec<Series> {
    let mut all = Vec::new();
    for (index, line) in lines.iter().enumerate() {
        let is_stored = storage::names().any(|name| name == line.name);
        let of = |row: &Row, x: f64, y: f64| Point { x, y, hollow: is_stored, name: row.settings.clone() };
        let mut points: Vec<Point> = if across.is_at_equal_bits {
            let point = |line: Line<'_>| {
                let (x, y) = line.at_bits(equal_bpp, across.value, quality)?;
                Some(Point { name: line.rows[0].effort.clone(), ..of(line.rows[0], x, y) })
            };
            line.by_effort().into_iter().filter_map(point).collect()
        } else {
            let place = |row: &Row| {
                let x = (across.value)(row).filter(|value| *value > 0.0)?;
                Some(of(row, x, (quality.value)(row)?))
            };
            line.slowest().filter_map(place).collect()
        };
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        all.push(Series { name: line.name.to_owned(), colour: Some(index), kind: Kind::Both, points });
    }
    if !across.is_at_equal_bits {
        let at_random = lines.iter().flat_map(Line::slowest).filter(|row| row.random_access == 1);
        let front =
            Curve::new(at_random.filter_map(|row| Some(((across.value)(row)?, (quality.value)(row)?))));
        let points = front.points().map(Point::from).collect();
        all.insert(0, Series { name: "Pareto front".to_owned(), colour: None, kind: Kind::Dashed, points });
    }
    all
}
