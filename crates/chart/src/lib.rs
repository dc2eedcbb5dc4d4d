//! Charts as SVG: series of points over two axes, each with its name at the right in its colour.
//!
//! A chart stands alone or in a page, has colours for light and for dark pages, and needs no script. Several charts of the same series may
//! share a [`legend`], with which a page switches them.

mod axis;
mod names;

use std::fmt::Write;

pub use axis::Scale;
use axis::Span;

/// Size in SVG units of a chart whose points have names.
pub const LARGE: (f64, f64) = (860.0, 520.0);
/// Size of other charts.
pub const SMALL: (f64, f64) = (640.0, 360.0);
/// Size of charts whose names stand outside of them, readable on a screen of 400 pixels.
pub const NARROW: (f64, f64) = (480.0, 340.0);

/// Room around the points; at the right there is room for names.
const LEFT: f64 = 52.0;
const TOP: f64 = 48.0;
const BOTTOM: f64 = 46.0;
/// Distance of two names at least.
const LINE_HEIGHT: f64 = 16.0;
/// Width of a letter in SVG units, at most.
const LETTER: f64 = 7.5;

const STYLE: &str = ".chart{color:#222;font:13px system-ui,sans-serif}.chart text{fill:currentColor}\
.chart .title{font-weight:600}.chart .middle{text-anchor:middle}.chart .end{text-anchor:end}\
.chart .paper,.chart .hollow{fill:#fff}.chart .grid{stroke:#ddd}\
.chart polyline{fill:none;stroke:currentColor;stroke-width:2}\
.chart circle{fill:currentColor;stroke:currentColor;stroke-width:2}";
const DARK: &str = ".chart{color:#ddd}.chart .paper,.chart .hollow{fill:#161616}.chart .grid{stroke:#3a3a3a}";
/// Colours of series on light and on dark pages.
const COLOURS: [(&str, &str); 12] = [
    ("#b34700", "#ffa263"),
    ("#005fa8", "#7dbdf5"),
    ("#8e248a", "#dc9bdb"),
    ("#b3182b", "#ff8f9b"),
    ("#00756f", "#62d1c9"),
    ("#7a6500", "#d9c35c"),
    ("#3a7d2c", "#86d07a"),
    ("#5b4bb5", "#a99cf5"),
    ("#6b5b53", "#c0aea5"),
    ("#444444", "#cccccc"),
    ("#c2185b", "#ff9fc6"),
    ("#007a99", "#6fdcf2"),
];

/// A point of a series.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Point {
    /// Where it is along the lower axis.
    pub x: f64,
    /// Where it is along the left axis.
    pub y: f64,
    /// Whether its mark is open.
    pub hollow: bool,
    /// A name beside it; empty for none.
    pub name: String,
}

impl From<(f64, f64)> for Point {
    fn from((x, y): (f64, f64)) -> Point {
        Point { x, y, ..Point::default() }
    }
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A line alone.
    Line,
    /// A broken line alone.
    Dashed,
    /// Marks alone.
    Marks,
    /// A line with a mark at each point.
    Both,
}

/// Points that belong together.
#[derive(Debug, Clone)]
pub struct Series {
    /// Its name at the right.
    pub name: String,
    /// Which of the colours; `None` for that of text.
    pub colour: Option<usize>,
    /// How it is drawn.
    pub kind: Kind,
    /// In the order of a line.
    pub points: Vec<Point>,
}

/// An axis.
#[derive(Debug, Clone, Copy)]
pub struct Axis<'c> {
    /// What it measures, with its unit.
    pub label: &'c str,
    /// How values lie along it.
    pub scale: Scale,
}

/// Where the names of series and of points stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Names {
    /// At the right of the chart; those of points below them where there is room.
    Below,
    /// At the right of the chart; those of points above them where there is room.
    Above,
    /// In a [`legend`], and those of points where they are pointed at.
    Outside,
}

/// A chart.
#[derive(Debug, Clone)]
pub struct Chart<'c> {
    /// What it is of.
    pub title: &'c str,
    /// The lower axis.
    pub across: Axis<'c>,
    /// The left axis.
    pub up: Axis<'c>,
    /// Width and height in SVG units.
    pub size: (f64, f64),
    /// Where names stand.
    pub names: Names,
    /// What is drawn.
    pub series: Vec<Series>,
}

impl Chart<'_> {
    /// The chart as an SVG element, which also is a file.
    #[must_use]
    pub fn svg(&self) -> String {
        let (width, height) = self.size;
        let points = || self.series.iter().flat_map(|series| &series.points);
        let is_named = self.names != Names::Outside;
        let room = |names: f64| if is_named { names } else { 0.0 };
        let edge = width - 20.0 - room(width_of(self.series.iter().map(|series| &series.name)));
        let right = edge - room(width_of(points().map(|point| &point.name)));
        let across = Span::of(points().map(|point| point.x), self.across.scale, (LEFT, right));
        let up = Span::of(points().map(|point| point.y), self.up.scale, (height - BOTTOM, TOP));
        let mut text = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"chart\" viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{}\">\
             <style>{}</style><rect class=\"paper\" width=\"100%\" height=\"100%\"/>",
            escaped(self.title),
            style()
        );
        label(&mut text, ("title", 8.0, 18.0), self.title);
        label(&mut text, ("", 8.0, 36.0), self.up.label);
        label(&mut text, ("middle", 0.5 * (LEFT + right), height - 8.0), self.across.label);
        for (y, value) in up.ticks() {
            let _ = write!(
                text,
                "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{edge:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>"
            );
            label(&mut text, ("end", LEFT - 8.0, y + 4.0), &value);
        }
        for (x, value) in across.ticks() {
            let x = x.min(width - 0.5 * LETTER * value.chars().count() as f64);
            label(&mut text, ("middle", x, height - BOTTOM + 18.0), &value);
        }
        for series in &self.series {
            draw(&mut text, series, (&across, &up));
        }
        if is_named {
            self.name_series(&mut text, &up, edge + 8.0);
            self.name_points(&mut text, (&across, &up));
        }
        text + "</svg>"
    }

    /// Names of series that have points, at the heights where lines end, as far from one another as they must be.
    fn name_series(&self, text: &mut String, up: &Span, x: f64) {
        let height = |series: &Series| match series.points.last() {
            Some(last) if series.kind != Kind::Marks => up.place(last.y),
            _ => TOP,
        };
        let drawn = self.series.iter().filter(|series| !series.points.is_empty());
        let mut names: Vec<(f64, &Series)> = drawn.map(|series| (height(series), series)).collect();
        names.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut above = f64::NEG_INFINITY;
        for (index, &(y, series)) in names.iter().enumerate() {
            let room = self.size.1 - BOTTOM - LINE_HEIGHT * (names.len() - 1 - index) as f64;
            above = y.min(room).max(above + LINE_HEIGHT);
            label(text, (&class(series), x, above + 4.0), &series.name);
        }
    }

    fn name_points(&self, text: &mut String, (across, up): (&Span, &Span)) {
        let named: Vec<(&Series, &Point)> = self
            .series
            .iter()
            .flat_map(|series| series.points.iter().map(move |point| (series, point)))
            .filter(|(_, point)| !point.name.is_empty())
            .collect();
        let at = |point: &Point| (across.place(point.x) as i32, up.place(point.y) as i32);
        let places: Vec<(i32, i32)> = named.iter().map(|(_, point)| at(point)).collect();
        let words: Vec<&str> = named.iter().map(|(_, point)| point.name.as_str()).collect();
        let ends = (LEFT as i32, (self.size.1 - BOTTOM) as i32);
        let corners = names::place(&places, &words, self.names == Names::Below, ends);
        for ((series, point), (x, y)) in named.iter().zip(corners) {
            label(text, (&class(series), f64::from(x), f64::from(y + names::FONT - 2)), &point.name);
        }
    }
}

fn draw(text: &mut String, series: &Series, (across, up): (&Span, &Span)) {
    let at = |point: &Point| (across.place(point.x), up.place(point.y));
    let class = class(series);
    let _ = write!(text, "<g data-series=\"{}\">", escaped(&series.name));
    if series.kind != Kind::Marks {
        let path: Vec<String> = series.points.iter().map(at).map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        let dashes = if series.kind == Kind::Dashed { " stroke-dasharray=\"5 4\"" } else { "" };
        let _ = write!(text, "<polyline class=\"{class}\"{dashes} points=\"{}\"/>", path.join(" "));
    }
    for point in series.points.iter().filter(|_| matches!(series.kind, Kind::Marks | Kind::Both)) {
        let (x, y) = at(point);
        let hollow = if point.hollow { " hollow" } else { "" };
        let _ = write!(
            text,
            "<circle class=\"{class}{hollow}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\"><title>{} {}: {} at {}</title></circle>",
            escaped(&series.name),
            escaped(&point.name),
            short(point.y),
            short(point.x)
        );
    }
    text.push_str("</g>");
}

/// Buttons with the names of series in their colours, as HTML: [`SCRIPT`] switches series with them.
#[must_use]
pub fn legend(series: &[Series]) -> String {
    let mut text = format!("<div class=\"legend chart\"><style>{}</style>", style());
    for series in series {
        let mark = match series.kind {
            Kind::Line => "\u{2500}",
            Kind::Dashed => "\u{254c}",
            Kind::Marks | Kind::Both => "\u{25cf}",
        };
        let name = escaped(&series.name);
        let _ = write!(
            text,
            "<button type=\"button\" aria-pressed=\"true\" data-series=\"{name}\"><span class=\"{}\">{mark}</span> {name}</button>",
            class(series)
        );
    }
    text + "</div>"
}

/// The script of a page with charts and a [`legend`]: buttons switch series; what is pointed at is named in the `output` behind its chart.
pub const SCRIPT: &str = include_str!("legend.js");

/// Width of the longest of these names, at most.
fn width_of<'n>(names: impl Iterator<Item = &'n String>) -> f64 {
    LETTER * names.map(|name| name.chars().count()).max().unwrap_or(0) as f64
}

fn class(series: &Series) -> String {
    series.colour.map_or(String::new(), |colour| format!("c{}", colour % COLOURS.len()))
}

fn label(text: &mut String, (class, x, y): (&str, f64, f64), words: &str) {
    let _ = write!(text, "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\">{}</text>", escaped(words));
}

fn style() -> String {
    let colours = |of: fn(&(&'static str, &'static str)) -> &'static str| -> String {
        COLOURS
            .iter()
            .enumerate()
            .map(|(index, both)| format!(".chart .c{index}{{color:{}}}", of(both)))
            .collect()
    };
    let (light, dark) = (colours(|both| both.0), colours(|both| both.1));
    format!("{STYLE}{light}@media(prefers-color-scheme:dark){{{DARK}{dark}}}")
}

/// Text as HTML.
#[must_use]
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A number in few letters: 0.25, 12.5, 3.5M.
#[must_use]
pub fn short(value: f64) -> String {
    let (scaled, unit) = match value.abs() {
        size if !size.is_finite() => return value.to_string(),
        size if size >= 1e9 => (value / 1e9, "G"),
        size if size >= 1e6 => (value / 1e6, "M"),
        size if size >= 1e4 => (value / 1e3, "k"),
        _ => (value, ""),
    };
    let digits = match scaled.abs() {
        size if size >= 100.0 => 0,
        size if size >= 10.0 => 1,
        _ => 3,
    };
    let text = format!("{scaled:.digits$}");
    let text = if digits > 0 { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    format!("{}{unit}", if text == "-0" { "0" } else { text })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_and_name_lies_within_the_chart() {
        let point = |x: f64, y: f64| Point { x, y, hollow: y > 3.0, name: String::new() };
        let series = |line: u32| Series {
            name: format!("codec {line}"),
            colour: Some(line as usize),
            kind: Kind::Both,
            points: (0..4).map(|i| point(f64::from(i), f64::from(line))).collect(),
        };
        let axis = Axis { label: "units", scale: Scale::Linear };
        let series = (0..6).map(series).collect();
        let chart =
            Chart { title: "a < b", across: axis, up: axis, size: SMALL, names: Names::Above, series };
        let text = chart.svg();
        assert!(text.contains("a &lt; b") && text.matches(" hollow\"").count() == 8);
        let figures = |name: &str| -> Vec<f64> {
            let quoted = text.split(name).skip(1).filter_map(|rest| rest.split('"').next()?.parse().ok());
            quoted.collect()
        };
        // The last tick's text ends within the chart.
        let last = text
            .split("class=\"middle\" x=\"")
            .skip(1)
            .filter_map(|rest| rest.split('"').next()?.parse().ok());
        assert!(last.fold(0.0, f64::max) <= SMALL.0 - LETTER);
        for (name, most) in [(" x=\"", SMALL.0), (" cx=\"", SMALL.0), (" y=\"", SMALL.1), (" cy=\"", SMALL.1)]
        {
            let found = figures(name);
            assert!(!found.is_empty() && found.iter().all(|&at| at >= 0.0 && at <= most), "{name} {found:?}");
        }
    }

    #[test]
    fn numbers_are_short() {
        let texts = [0.25, 12.5, 250.4, 0.0, -0.0001, 2048.0, 3_500_000.0, 1e9, f64::INFINITY].map(short);
        assert_eq!(texts, ["0.25", "12.5", "250", "0", "0", "2048", "3.5M", "1G", "inf"]);
    }
}
