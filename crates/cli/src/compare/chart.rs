//! Charts of means.

use texfold::encoding::ENCODINGS;
use texfold_chart::{Chart, Kind, LARGE, Point, Scale, Series};

use super::candidate::RIVAL;
use super::storage;
use super::table::{Row, front};

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

/// A figure on the vertical axis, better where it is larger.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Quality {
    pub(crate) name: &'static str,
    pub(crate) label: &'static str,
    pub(crate) value: fn(&Row) -> Option<f64>,
}

const PSNR: Quality = Quality {
    name: "PSNR",
    label: "PSNR in dB, mean over inputs",
    value: |row| Some(row.psnr.min(CEILING_DB)),
};
const PERCEIVED: Quality =
    Quality { name: "SSIMULACRA2", label: "SSIMULACRA2, mean over inputs", value: |row| row.ssimulacra2 };

/// The charts of a report.
pub(crate) const CHARTS: [(Axis, Quality); 6] = [
    (AXES[0], PSNR),
    (AXES[0], PERCEIVED),
    (AXES[1], PSNR),
    (AXES[2], PSNR),
    (AXES[3], PSNR),
    (AXES[4], PSNR),
];

const AXES: [Axis; 5] = [
    Axis {
        title: "Compressed size",
        label: "bits per texel, compressed",
        value: |row| Some(row.bpp_memory),
        unit: 1.0,
        smaller_is_better: true,
    },
    Axis {
        title: "GPU memory decoded whole",
        label: "bits of GPU memory per texel, decoded whole",
        value: |row| Some(row.bpp_resident),
        unit: 1.0,
        smaller_is_better: true,
    },
    Axis {
        title: "Speed of encoding",
        label: "texels encoded per second",
        value: |row| Some(row.encode_texels_per_second()),
        unit: 1e6,
        smaller_is_better: false,
    },
    Axis {
        title: "Speed of decoding on one CPU thread",
        label: "texels decoded per second, CPU",
        value: |row| row.decode_cpu_texels_per_second,
        unit: 1e6,
        smaller_is_better: false,
    },
    Axis {
        title: "Speed of decoding on the GPU",
        label: "texels decoded per second, GPU",
        value: |row| row.decode_gpu_texels_per_second,
        unit: 1e6,
        smaller_is_better: false,
    },
];

/// The chart; `None` where no row has the figure.
pub(crate) fn svg(means: &[Row], axis: Axis, quality: Quality) -> Option<String> {
    let place = |row: &Row| {
        let x = (axis.value)(row).filter(|&value| value > 0.0)?;
        Some(Point { x, y: (quality.value)(row)?, hollow: false, name: row.settings.clone() })
    };
    let placed: Vec<(&Row, Point)> = means.iter().filter_map(|row| Some((row, place(row)?))).collect();
    // Of files for storage no part can be read alone: they are beside the front.
    let at_random = placed.iter().filter(|(row, _)| row.random_access == 1);
    let compared: Vec<(f64, f64)> = at_random.map(|(_, point)| (point.x, point.y)).collect();
    let best = front(&compared, axis.smaller_is_better);
    let mut series = vec![Series {
        name: "Pareto front".to_owned(),
        colour: None,
        kind: Kind::Line,
        points: best.iter().map(|&index| compared[index].into()).collect(),
    }];
    let codecs = ENCODINGS.iter().map(|encoding| encoding.id.name).chain([RIVAL]);
    series.extend(codecs.enumerate().map(|(index, codec)| Series {
        name: codec.to_owned(),
        colour: Some(index),
        kind: Kind::Marks,
        points: placed.iter().filter(|(row, _)| row.codec == codec).map(|(_, point)| point.clone()).collect(),
    }));
    let lines = storage::names().map(|name| {
        let of_format = placed.iter().filter(|(row, _)| row.codec == name);
        let mut points: Vec<Point> = of_format.map(|(_, point)| (point.x, point.y).into()).collect();
        if let Some(last) = points.last_mut() {
            name.clone_into(&mut last.name);
        }
        Series { name: String::new(), colour: None, kind: Kind::Dashed, points }
    });
    series.extend(lines);
    let chart = Chart {
        title: &format!("{} and {}", axis.title, quality.name),
        across: texfold_chart::Axis { label: axis.label, scale: Scale::Doublings(axis.unit) },
        up: texfold_chart::Axis { label: quality.label, scale: Scale::Linear },
        size: LARGE,
        names_below: axis.smaller_is_better,
        series,
    };
    (!placed.is_empty()).then(|| chart.svg())
}
