//! What is recorded: checks of a regime with their bounds, and lines of sensitivity.

use std::error::Error;

use serde_json::{Value, json};

/// Which side of its bound a figure must lie on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Bound {
    /// At most so much.
    Most(f64),
    /// At least so much.
    Least(f64),
}

/// A figure and the bound that it has to keep.
#[derive(Debug, Clone)]
pub(super) struct Check {
    /// What is measured, with its unit.
    pub(super) what: &'static str,
    pub(super) bound: Bound,
    pub(super) measured: f64,
}

impl Check {
    pub(super) fn most(what: &'static str, measured: f64, limit: f64) -> Check {
        Check { what, bound: Bound::Most(limit), measured }
    }

    pub(super) fn least(what: &'static str, measured: f64, limit: f64) -> Check {
        Check { what, bound: Bound::Least(limit), measured }
    }

    /// Whether the bound is kept; what is not a number keeps none.
    pub(super) fn holds(&self) -> bool {
        match self.bound {
            Bound::Most(limit) => self.measured <= limit,
            Bound::Least(limit) => self.measured >= limit,
        }
    }

    fn json(&self) -> Value {
        let (side, limit) = match self.bound {
            Bound::Most(limit) => ("at most", limit),
            Bound::Least(limit) => ("at least", limit),
        };
        json!({
            "what": self.what, "side": side, "bound": finite(limit), "measured": finite(self.measured),
            "holds": self.holds(),
        })
    }
}

/// JSON has no infinite numbers: lossless results are written as words.
fn finite(value: f64) -> Value {
    if value.is_finite() { json!(value) } else { json!(value.to_string()) }
}

/// An error with its causes, as users read it.
pub(super) fn words(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text = format!("{text}: {error}");
        cause = error.source();
    }
    text
}

/// How a codec fared in a regime.
#[derive(Debug)]
pub(super) enum Outcome {
    /// It made a texture, held to these bounds.
    Made {
        /// What the method says of it.
        verdict: String,
        /// PSNR of its colours in dB.
        psnr: f64,
        /// Bits a texel, compressed.
        bpp: f64,
        checks: Vec<Check>,
    },
    /// It refused with an error that says what to do.
    Refused(String),
    /// It panicked, or did not end in time.
    Broken(String),
}

/// One regime for one codec.
#[derive(Debug)]
pub(super) struct Row {
    pub(super) regime: &'static str,
    pub(super) codec: String,
    pub(super) outcome: Outcome,
    pub(super) seconds: f64,
    /// PNG files: what went in, and what came out.
    pub(super) pictures: Vec<Vec<u8>>,
}

impl Row {
    pub(super) fn holds(&self) -> bool {
        match &self.outcome {
            Outcome::Made { checks, .. } => checks.iter().all(Check::holds),
            Outcome::Refused(_) => true,
            Outcome::Broken(_) => false,
        }
    }

    pub(super) fn json(&self) -> Value {
        let mut row = json!({
            "regime": self.regime, "codec": self.codec, "holds": self.holds(), "seconds": self.seconds,
        });
        match &self.outcome {
            Outcome::Made { verdict, psnr, bpp, checks } => {
                row["psnr"] = finite(*psnr);
                row["bpp"] = json!(bpp);
                row["verdict"] = json!(verdict);
                row["checks"] = checks.iter().map(Check::json).collect();
            }
            Outcome::Refused(error) => row["refused"] = json!(error),
            Outcome::Broken(fault) => row["broken"] = json!(fault),
        }
        row
    }
}

/// One point of a line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    pub(super) x: f64,
    pub(super) y: f64,
    /// Whether the method had given way to a plainer one.
    pub(super) gave_way: bool,
}

/// How one figure of several methods depends on one property of what is encoded.
#[derive(Debug)]
pub(super) struct Curve {
    pub(super) title: String,
    /// What is varied, with its unit.
    pub(super) across: &'static str,
    /// What is measured, with its unit.
    pub(super) up: &'static str,
    pub(super) lines: Vec<(String, Vec<Point>)>,
}

impl Curve {
    pub(super) fn json(&self) -> Value {
        let point = |point: &Point| json!({"x": point.x, "y": finite(point.y), "gave_way": point.gave_way});
        let line = |(name, points): &(String, Vec<Point>)| json!({"name": name, "points": points.iter().map(point).collect::<Vec<_>>()});
        json!({
            "title": self.title, "across": self.across, "up": self.up,
            "lines": self.lines.iter().map(line).collect::<Vec<_>>(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_that_is_no_number_keeps_no_bound() {
        assert!(Check::most("", 1.0, 1.0).holds() && Check::least("", f64::INFINITY, 30.0).holds());
        assert!(!Check::most("", f64::NAN, 1.0).holds() && !Check::least("", f64::NAN, 1.0).holds());
        assert!(!Check::most("", 1.1, 1.0).holds() && !Check::least("", 0.9, 1.0).holds());
    }
}
