//! Where each method stops working, in a sentence and in pictures, taken from the charts.

use super::record::{Curve, Point};

/// A picture with what it shows.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    pub(super) png: Vec<u8>,
    pub(super) caption: String,
}

/// What a method withstands least.
#[derive(Debug, Clone)]
pub(super) struct Failure {
    pub(super) method: String,
    pub(super) sentence: String,
    /// In pairs: what was encoded, and what came of it, before the method fails and after.
    pub(super) pictures: Vec<Picture>,
}

/// A line of a chart from its best value to its worst.
#[derive(Debug, Clone)]
pub(super) struct Fall<'c> {
    /// Number of the chart among those that were looked at.
    pub(super) index: usize,
    pub(super) curve: &'c Curve,
    points: &'c [Point],
    pub(super) best: Point,
    pub(super) worst: Point,
}

impl Fall<'_> {
    fn drop(&self) -> f64 {
        self.best.y - self.worst.y
    }

    /// The values at which something holds, in words; `None` where at none.
    pub(super) fn values_where(&self, holds: impl Fn(&Point) -> bool) -> Option<String> {
        let values: Vec<String> =
            self.points.iter().filter(|point| holds(point)).map(|point| point.x.to_string()).collect();
        (!values.is_empty()).then(|| values.join(", "))
    }
}

/// How a line falls in each of these charts, the one first in which it falls most: from its value at `plain`, where nothing is made harder yet, or
/// from its best. Charts in which it has fewer than two points are left out.
pub(super) fn falls<'c>(
    curves: impl Iterator<Item = &'c Curve>,
    line: &str,
    plain: Option<f64>,
) -> Vec<Fall<'c>> {
    let of = |(index, curve): (usize, &'c Curve)| {
        let (_, points) = curve.lines.iter().find(|(name, _)| name == line)?;
        let best = match plain {
            Some(plain) => points.iter().find(|point| point.x == plain)?,
            None => points.iter().max_by(|a, b| a.y.total_cmp(&b.y))?,
        };
        let others = points.iter().filter(|point| point.x != best.x);
        let worst = others.min_by(|a, b| a.y.total_cmp(&b.y))?;
        (points.len() > 1).then_some(Fall { index, curve, points, best: *best, worst: *worst })
    };
    let mut falls: Vec<Fall<'c>> = curves.enumerate().filter_map(of).collect();
    falls.sort_by(|a, b| b.drop().total_cmp(&a.drop()));
    falls
}

/// What a method withstands least and best; `name` shortens titles, `figure` is what charts have upwards.
pub(super) fn sentence(
    method: &str,
    falls: &[Fall<'_>],
    name: fn(&str) -> String,
    figure: &str,
    fallback: &str,
) -> String {
    let (Some(least), Some(most)) = (falls.first(), falls.last()) else {
        return format!("{method} takes part in no chart.");
    };
    let from_to = |Fall { curve, best, worst, .. }: &Fall<'_>| {
        format!(
            "from {:.1} {figure} at {} to {:.1} at {} ({})",
            best.y, best.x, worst.y, worst.x, curve.across
        )
    };
    format!(
        "{method} withstands {} least: it goes {}, {fallback}. It withstands {} best: {}.",
        name(&least.curve.title).to_lowercase(),
        from_to(least),
        name(&most.curve.title).to_lowercase(),
        from_to(most)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(title: &str, figures: [f64; 3], gave_way: [bool; 3]) -> Curve {
        let point =
            |number: usize| Point { x: number as f64, y: figures[number], gave_way: gave_way[number] };
        Curve {
            title: title.to_owned(),
            across: "steps",
            up: "dB",
            lines: vec![("dct".to_owned(), (0..3).map(point).collect())],
        }
    }

    #[test]
    fn the_chart_of_the_greatest_fall_comes_first() {
        let curves = [
            curve("Blur", [30.0, 31.0, 29.0], [false; 3]),
            curve("Noise", [30.0, 25.0, 20.0], [false, true, true]),
            curve("Turn", [30.0, 30.0, 35.0], [true, false, true]),
        ];
        let found = falls(curves.iter(), "dct", None);
        assert_eq!(found.iter().map(|fall| fall.index).collect::<Vec<_>>(), [1, 2, 0]);
        let gave_way: Vec<_> = found.iter().map(|fall| fall.values_where(|point| point.gave_way)).collect();
        assert_eq!(gave_way, [Some("1, 2".to_owned()), Some("0, 2".to_owned()), None]);
        let text = sentence("dct", &found, str::to_owned, "dB", "and stays as it is");
        assert!(
            text.starts_with("dct withstands noise least: it goes from 30.0 dB at 0 to 20.0 at 2 (steps)"),
            "{text}"
        );
        assert!(text.contains("blur best"), "{text}");
        // Of what becomes easier nothing falls.
        let found = falls(curves.iter(), "dct", Some(0.0));
        assert_eq!(found.iter().map(|fall| fall.index).collect::<Vec<_>>(), [1, 0, 2]);
        assert_eq!((found[2].best.y, found[2].worst.y), (30.0, 30.0));
        assert!(falls(curves.iter(), "none", None).is_empty());
    }
}
