//! Lines over one property as SVG: few points, a name at the end of each line, colours of the page.

use std::fmt::Write;

use super::record::{Curve, Point};

/// Text as HTML.
pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Size of a chart, and of the room around its points, in SVG units.
const SIZE: (f64, f64) = (560.0, 300.0);
const LEFT: f64 = 52.0;
const RIGHT: f64 = 118.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 46.0;
/// Distance of two names at least.
const LINE_HEIGHT: f64 = 15.0;
/// Ticks of an axis, about.
const TICKS: f64 = 5.0;

/// The chart of a curve; its lines have the classes `line0`, `line1` and so on, which the page colours.
pub(super) fn svg(curve: &Curve) -> String {
    let points = || curve.lines.iter().flat_map(|(_, points)| points);
    let across = Axis::of(points().map(|point| point.x), SIZE.0 - RIGHT, LEFT);
    let up = Axis::of(points().map(|point| point.y), TOP, SIZE.1 - BOTTOM);
    let mut text = format!(
        "<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">",
        SIZE.0,
        SIZE.1,
        escaped(&curve.title)
    );
    grid(&mut text, &across, &up);
    let mut names: Vec<(f64, usize)> = Vec::new();
    for (index, (name, line)) in curve.lines.iter().enumerate() {
        draw(&mut text, index, line, (&across, &up), name);
        if let Some(last) = line.last() {
            names.push((up.place(last.y), index));
        }
    }
    // Names keep their order and their distance.
    names.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut lowest = f64::NEG_INFINITY;
    for (y, index) in names {
        let y = y.max(lowest + LINE_HEIGHT);
        lowest = y;
        let x = SIZE.0 - RIGHT + 8.0;
        let _ = write!(
            text,
            "<text class=\"line{index}\" x=\"{x}\" y=\"{:.1}\">{}</text>",
            y + 4.0,
            escaped(&curve.lines[index].0)
        );
    }
    let middle = 0.5 * (LEFT + SIZE.0 - RIGHT);
    let _ = write!(
        text,
        "<text class=\"axis\" x=\"{middle}\" y=\"{}\">{}</text></svg>",
        SIZE.1 - 8.0,
        curve.across
    );
    text
}

/// A line with a mark at each point, hollow where the method had given way.
fn draw(text: &mut String, index: usize, line: &[Point], (across, up): (&Axis, &Axis), name: &str) {
    let at = |point: &Point| (across.place(point.x), up.place(point.y));
    let path: Vec<String> = line.iter().map(at).map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
    let _ = write!(text, "<polyline class=\"line{index}\" points=\"{}\"/>", path.join(" "));
    for point in line {
        let (x, y) = at(point);
        let (kind, word) =
            if point.gave_way { ("hollow", " (gave way to a plainer form)") } else { ("", "") };
        let _ = write!(
            text,
            "<circle class=\"line{index} {kind}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\"><title>{}: {} at {}{word}</title></circle>",
            escaped(name),
            short(point.y),
            short(point.x)
        );
    }
}

fn grid(text: &mut String, across: &Axis, up: &Axis) {
    for tick in up.ticks() {
        let y = up.place(tick);
        let _ = write!(
            text,
            "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/><text class=\"up\" x=\"{}\" y=\"{:.1}\">{}</text>",
            SIZE.0 - RIGHT,
            LEFT - 8.0,
            y + 4.0,
            short(tick)
        );
    }
    for tick in across.ticks() {
        let _ = write!(
            text,
            "<text class=\"axis\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            across.place(tick),
            SIZE.1 - BOTTOM + 18.0,
            short(tick)
        );
    }
}

/// Values of an axis and where they lie.
struct Axis {
    low: f64,
    high: f64,
    step: f64,
    /// Places of the high and the low end.
    to: f64,
    from: f64,
}

impl Axis {
    /// Around these values, with ends at round numbers.
    fn of(values: impl Iterator<Item = f64>, to: f64, from: f64) -> Axis {
        let (low, high) = values
            .filter(|value| value.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        let (low, high) = if low < high {
            (low, high)
        } else if low.is_finite() {
            (low - 1.0, low + 1.0)
        } else {
            (0.0, 1.0)
        };
        let rough = (high - low) / TICKS;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|times| times * power).into_iter().find(|&step| step >= rough);
        let step = step.unwrap_or(10.0 * power);
        Axis { low: (low / step).floor() * step, high: (high / step).ceil() * step, step, to, from }
    }

    fn place(&self, value: f64) -> f64 {
        self.from
            + (self.to - self.from) * (value.clamp(self.low, self.high) - self.low) / (self.high - self.low)
    }

    fn ticks(&self) -> impl Iterator<Item = f64> + '_ {
        let count = ((self.high - self.low) / self.step).round() as u32;
        (0..=count).map(|index| self.low + f64::from(index) * self.step)
    }
}

/// A number in few letters.
pub(super) fn short(value: f64) -> String {
    let digits = if value.abs() >= 100.0 {
        0
    } else if value.abs() >= 10.0 {
        1
    } else {
        3
    };
    let text = format!("{value:.digits$}");
    let trimmed = if digits > 0 && value.is_finite() {
        text.trim_end_matches('0').trim_end_matches('.')
    } else {
        &text
    };
    if trimmed == "-0" { "0".to_owned() } else { trimmed.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_and_name_lies_within_the_chart() {
        let point = |x: f64, y: f64| Point { x, y, gave_way: y > 3.0 };
        let lines = (0..6).map(|line| {
            (format!("codec {line}"), (0..4).map(|i| point(f64::from(i), f64::from(line))).collect())
        });
        let curve = Curve { title: "a < b".to_owned(), across: "units", up: "dB", lines: lines.collect() };
        let text = svg(&curve);
        assert!(text.contains("a &lt; b") && text.matches("hollow").count() == 8);
        let figures = |name: &str| -> Vec<f64> {
            let quoted = text.split(name).skip(1).filter_map(|rest| rest.split('"').next()?.parse().ok());
            quoted.collect()
        };
        for (name, most) in [(" x=\"", SIZE.0), (" cx=\"", SIZE.0), (" y=\"", SIZE.1), (" cy=\"", SIZE.1)] {
            let found = figures(name);
            assert!(!found.is_empty() && found.iter().all(|&at| at >= 0.0 && at <= most), "{name} {found:?}");
        }
    }

    #[test]
    fn axes_end_at_round_numbers_and_hold_lone_values() {
        let axis = Axis::of([0.0, 22.5, 45.0].into_iter(), 100.0, 0.0);
        assert_eq!((axis.low, axis.high, axis.step), (0.0, 50.0, 10.0));
        assert!(Axis::of(std::iter::once(3.0), 1.0, 0.0).place(3.0).is_finite());
        assert!(Axis::of(std::iter::empty(), 1.0, 0.0).place(3.0).is_finite());
        assert_eq!([0.25, 12.5, 250.4, 0.0, f64::INFINITY].map(short), ["0.25", "12.5", "250", "0", "inf"]);
    }
}
