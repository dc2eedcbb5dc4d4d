//! Axes: ranges that end at round numbers, and their ticks.

use crate::short;

/// Ticks of an axis, about.
const TICKS: f64 = 5.0;
/// An axis begins at zero where its smallest value is below this share of its largest.
const FROM_ZERO: f64 = 0.4;

/// How values lie along an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// Evenly.
    Linear,
    /// By their logarithm; ticks double from this unit on. Values must be above zero.
    Doublings(f64),
}

impl Scale {
    fn place(self, value: f64) -> f64 {
        match self {
            Scale::Linear => value,
            Scale::Doublings(unit) => (value / unit).log2(),
        }
    }

    fn value(self, place: f64) -> f64 {
        match self {
            Scale::Linear => place,
            Scale::Doublings(unit) => place.exp2() * unit,
        }
    }
}

/// The range of an axis and where it lies in the drawing.
#[derive(Debug)]
pub(crate) struct Span {
    low: f64,
    high: f64,
    step: f64,
    scale: Scale,
    /// Places of the low and the high end.
    ends: (f64, f64),
}

impl Span {
    pub(crate) fn of(values: impl Iterator<Item = f64>, scale: Scale, ends: (f64, f64)) -> Span {
        let (low, high) = values
            .map(|value| scale.place(value))
            .filter(|value| value.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        let (low, high) = match scale {
            _ if low > high => (0.0, 1.0),
            Scale::Linear if low > 0.0 && low < FROM_ZERO * high => (0.0, high),
            _ if low == high => (low - 1.0, low + 1.0),
            _ => (low, high),
        };
        let rough = (high - low) / TICKS;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|times| times * power).into_iter().find(|&step| step >= rough);
        let step = match scale {
            Scale::Linear => step.unwrap_or(10.0 * power),
            Scale::Doublings(_) => (rough / 2.0).ceil(),
        };
        Span { low: (low / step).floor() * step, high: (high / step).ceil() * step, step, scale, ends }
    }

    pub(crate) fn place(&self, value: f64) -> f64 {
        let share = (self.scale.place(value).clamp(self.low, self.high) - self.low) / (self.high - self.low);
        self.ends.0 + (self.ends.1 - self.ends.0) * share
    }

    /// Places of ticks with their texts.
    pub(crate) fn ticks(&self) -> impl Iterator<Item = (f64, String)> {
        let count = ((self.high - self.low) / self.step).round() as u32;
        (0..=count).map(|index| {
            let value = self.scale.value(self.low + f64::from(index) * self.step);
            (self.place(value), short(value))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_end_at_round_numbers_and_hold_lone_values() {
        let texts = |values: &[f64], scale| -> Vec<String> {
            let span = Span::of(values.iter().copied(), scale, (0.0, 100.0));
            assert!(span.place(3.0).is_finite() && span.place(f64::INFINITY) == 100.0);
            span.ticks().map(|tick| tick.1).collect()
        };
        assert_eq!(texts(&[0.0, 22.5, 45.0], Scale::Linear), ["0", "10", "20", "30", "40", "50"]);
        assert_eq!(texts(&[30.5, 38.0], Scale::Linear), ["30", "32", "34", "36", "38"]);
        assert_eq!(texts(&[0.3, 7.0], Scale::Doublings(1.0)), ["0.25", "0.5", "1", "2", "4", "8"]);
        assert_eq!(texts(&[2.5e6], Scale::Doublings(1e6)), ["1M", "2M", "4M", "8M"]);
        assert_eq!(texts(&[3.0], Scale::Linear).first().map(String::as_str), Some("2"));
        assert!(!texts(&[], Scale::Linear).is_empty());
    }
}
