//! Charts of means: curves of series over bits, and what a series costs at equal bits.

use texfold_chart::{Chart, Kind, NARROW, Names, Point, Scale, Series};

use super::curve::Curve;
use super::light;
use super::storage;
use super::table::Row;

/// PSNR above which a point is drawn at the edge: lossless results would flatten all others.
pub(super) const CEILING_DB: f64 = 60.0;

/// Bits a texel at which speeds are compared.
pub(super) const EQUAL_BPP: f64 = 2.0;

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
    /// Whether it is compared at [`EQUAL_BPP`] alone.
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
    title: "Encoding at 2 bits",
    label: "CPU seconds a megatexel",
    value: Row::cpu_seconds_a_megatexel,
    unit: 1.0,
    is_at_equal_bits: true,
};
const CPU: Across = Across {
    title: "Decoding at 2 bits on one CPU thread",
    label: "texels decoded a second",
    value: |row| row.decode_cpu_texels_per_second,
    unit: 1e6,
    is_at_equal_bits: true,
};
const GPU: Across =
    Across { title: "Decoding at 2 bits on the GPU", value: |row| row.decode_gpu_texels_per_second, ..CPU };

/// The settings of a series.
#[derive(Debug)]
pub(super) struct Line<'r> {
    pub(super) name: &'r str,
    pub(super) rows: Vec<&'r Row>,
}

impl Line<'_> {
    pub(super) fn curve(&self, quality: Quality) -> Curve {
        Curve::new(self.rows.iter().filter_map(|row| Some((row.bpp_memory, (quality.value)(row)?))))
    }

    /// A figure at [`EQUAL_BPP`], between the settings beside it by the logarithms of both.
    fn at_equal_bits(&self, value: fn(&Row) -> Option<f64>) -> Option<f64> {
        let mut points: Vec<(f64, f64)> = self
            .rows
            .iter()
            .filter_map(|row| Some((row.bpp_memory.log2(), value(row).filter(|value| *value > 0.0)?.log2())))
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let place = EQUAL_BPP.log2();
        let next = points.iter().position(|point| point.0 >= place)?;
        let ((x0, y0), (x1, y1)) = (points[next.checked_sub(1).unwrap_or(next)], points[next]);
        if next == 0 && x1 > place {
            return None;
        }
        let share = if x1 > x0 { (place - x0) / (x1 - x0) } else { 1.0 };
        Some((y0 + (y1 - y0) * share).exp2())
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
pub(super) fn svgs(means: &[Row]) -> (String, Vec<String>) {
    let lines = lines(means);
    let charts: &[(Across, Quality)] =
        if means.iter().any(light::is_light) { &LIGHT_CHARTS } else { &CHARTS };
    let drawn: Vec<Vec<Series>> =
        charts.iter().map(|&(across, quality)| series(&lines, across, quality)).collect();
    let legend = texfold_chart::legend(&drawn[0]);
    let charts =
        charts.iter().zip(drawn).filter(|(_, series)| series.iter().any(|series| !series.points.is_empty()));
    let svg = |(&(across, quality), series): (&(Across, Quality), Vec<Series>)| {
        let title = format!("{} and {}", across.title, quality.name);
        let scale = Scale::Doublings(across.unit);
        Chart {
            title: &title,
            across: texfold_chart::Axis { label: across.label, scale },
            up: texfold_chart::Axis { label: quality.label, scale: Scale::Linear },
            size: NARROW,
            names: Names::Outside,
            series,
        }
        .svg()
    };
    (legend, charts.map(svg).collect())
}

/// The series of a chart, and the front of what no other setting beats, of series whose texels are read at random.
fn series(lines: &[Line<'_>], across: Across, quality: Quality) -> Vec<Series> {
    let mut all = Vec::new();
    for (index, line) in lines.iter().enumerate() {
        let is_stored = storage::names().any(|name| name == line.name);
        let (kind, mut points) = if across.is_at_equal_bits {
            let point = line.at_equal_bits(across.value).zip(line.curve(quality).quality_at(EQUAL_BPP));
            (Kind::Marks, point.into_iter().map(|(x, y)| Point { x, y, ..Point::default() }).collect())
        } else {
            let place = |row: &&Row| {
                let x = (across.value)(row).filter(|value| *value > 0.0)?;
                Some(Point { x, y: (quality.value)(row)?, hollow: is_stored, name: row.settings.clone() })
            };
            (Kind::Both, line.rows.iter().filter_map(place).collect::<Vec<_>>())
        };
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        all.push(Series { name: line.name.to_owned(), colour: Some(index), kind, points });
    }
    if !across.is_at_equal_bits {
        let at_random = lines.iter().flat_map(|line| &line.rows).filter(|row| row.random_access == 1);
        let front =
            Curve::new(at_random.filter_map(|row| Some(((across.value)(row)?, (quality.value)(row)?))));
        let points = front.points().map(Point::from).collect();
        all.insert(0, Series { name: "Pareto front".to_owned(), colour: None, kind: Kind::Dashed, points });
    }
    all
}
