//! Quality against bits as a curve through the settings of a series, and the bits of two curves at equal quality.

/// Steps of the integral.
const STEPS: u32 = 200;
/// Curves are compared where they have this share of the shorter one's range of quality in common.
const LEAST_SHARE: f64 = 0.25;

/// A monotone cubic through points (Fritsch and Butland 1984), as in PCHIP.
#[derive(Debug, Clone, PartialEq)]
struct Cubic {
    points: Vec<(f64, f64)>,
    slopes: Vec<f64>,
}

impl Cubic {
    /// Through two points and more whose first coordinates rise.
    fn through(points: Vec<(f64, f64)>) -> Cubic {
        let secants: Vec<(f64, f64)> = points
            .windows(2)
            .map(|pair| (pair[1].0 - pair[0].0, (pair[1].1 - pair[0].1) / (pair[1].0 - pair[0].0)))
            .collect();
        let inner = secants.windows(2).map(|pair| {
            let [(width, slope), (next_width, next)] = [pair[0], pair[1]];
            if slope * next <= 0.0 {
                return 0.0;
            }
            let (one, other) = (2.0 * next_width + width, next_width + 2.0 * width);
            (one + other) / (one / slope + other / next)
        });
        let ends = [secants[0].1, secants[secants.len() - 1].1];
        let slopes = [ends[0]].into_iter().chain(inner).chain([ends[1]]).collect();
        Cubic { points, slopes }
    }

    fn range(&self) -> (f64, f64) {
        (self.points[0].0, self.points[self.points.len() - 1].0)
    }

    fn at(&self, x: f64) -> f64 {
        let next = self.points.partition_point(|point| point.0 < x).clamp(1, self.points.len() - 1);
        let ((x0, y0), (x1, y1)) = (self.points[next - 1], self.points[next]);
        let (width, t) = (x1 - x0, (x - x0) / (x1 - x0));
        let (slope, end) = (self.slopes[next - 1] * width, self.slopes[next] * width);
        let (square, cube) = (t * t, t * t * t);
        (2.0 * cube - 3.0 * square + 1.0) * y0
            + (cube - 2.0 * square + t) * slope
            + (3.0 * square - 2.0 * cube) * y1
            + (cube - square) * end
    }
}

/// The settings of a series that no other of its settings beats, by bits.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Curve(Vec<(f64, f64)>);

impl Curve {
    /// Of bits and qualities in any order.
    pub(crate) fn new(points: impl IntoIterator<Item = (f64, f64)>) -> Curve {
        let mut points: Vec<(f64, f64)> =
            points.into_iter().filter(|(bits, quality)| *bits > 0.0 && quality.is_finite()).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1)));
        let mut best = f64::NEG_INFINITY;
        points.retain(|&(_, quality)| {
            let is_better = quality > best;
            best = best.max(quality);
            is_better
        });
        points.dedup_by(|later, first| later.0 <= first.0);
        Curve(points)
    }

    /// Bits and qualities, the fewest bits first.
    pub(crate) fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        self.0.iter().copied()
    }

    /// Quality at so many bits; `None` beyond the ends, and for one point alone.
    pub(crate) fn quality_at(&self, bits: f64) -> Option<f64> {
        let place = bits.log2();
        let cubic = self.cubic(|(bits, quality)| (bits.log2(), quality))?;
        let (first, last) = cubic.range();
        (first <= place && place <= last).then(|| cubic.at(place))
    }

    /// Bits of this curve as a multiple of those of `other` at equal quality, over the qualities of both (Bjontegaard 2001); `None` where they
    /// have too little in common.
    pub(crate) fn bits_beside(&self, other: &Curve) -> Option<f64> {
        let by_quality = |curve: &Curve| curve.cubic(|(bits, quality)| (quality, bits.log2()));
        let (ours, theirs) = (by_quality(self)?, by_quality(other)?);
        let (low, high) = (ours.range().0.max(theirs.range().0), ours.range().1.min(theirs.range().1));
        let width = |cubic: &Cubic| cubic.range().1 - cubic.range().0;
        if high - low < LEAST_SHARE * width(&ours).min(width(&theirs)) {
            return None;
        }
        let difference = |step: u32| {
            let quality = low + (high - low) * (f64::from(step) + 0.5) / f64::from(STEPS);
            ours.at(quality) - theirs.at(quality)
        };
        Some(((0..STEPS).map(difference).sum::<f64>() / f64::from(STEPS)).exp2())
    }

    fn cubic(&self, of: fn((f64, f64)) -> (f64, f64)) -> Option<Cubic> {
        (self.0.len() > 1).then(|| Cubic::through(self.0.iter().map(|&point| of(point)).collect()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_the_bits_at_every_quality_are_half_the_bits() {
        let of =
            |factor: f64| Curve::new((0..5).map(|i| (factor * f64::from(1 << i), 30.0 + 6.0 * f64::from(i))));
        assert!((of(0.5).bits_beside(&of(1.0)).unwrap() - 0.5).abs() < 1e-9);
        assert!((of(1.0).bits_beside(&of(0.5)).unwrap() - 2.0).abs() < 1e-9);
        // A part of the curve gives the same.
        let part = Curve::new([(2.0, 36.0), (4.0, 42.0)]);
        assert!((part.bits_beside(&of(0.5)).unwrap() - 2.0).abs() < 1e-9);
    }

    #[test]
    fn cubics_are_those_of_pchip_and_never_turn_between_points() {
        // The inner slopes of scipy.interpolate.PchipInterpolator([0, 1, 3, 4], [0, 1, 2, 6]).
        let cubic = Cubic::through(vec![(0.0, 0.0), (1.0, 1.0), (3.0, 2.0), (4.0, 6.0)]);
        assert!(
            (cubic.slopes[1] - 9.0 / 13.0).abs() < 1e-12 && (cubic.slopes[2] - 36.0 / 37.0).abs() < 1e-12
        );
        let mut before = f64::NEG_INFINITY;
        for step in 0..=400 {
            let value = cubic.at(f64::from(step) / 100.0);
            assert!(value >= before - 1e-12);
            before = value;
        }
    }

    #[test]
    fn what_has_nothing_in_common_is_not_compared() {
        let low = Curve::new([(1.0, 20.0), (2.0, 25.0)]);
        let high = Curve::new([(1.0, 30.0), (2.0, 35.0)]);
        assert_eq!(low.bits_beside(&high), None);
        assert_eq!(low.bits_beside(&Curve::new([(1.0, 22.0)])), None);
        // Settings that others beat are left out, and of equal bits the better one stays.
        let curve = Curve::new([(1.0, 30.0), (2.0, 29.0), (1.0, 31.0), (3.0, 35.0), (0.0, 1.0)]);
        assert_eq!(curve, Curve(vec![(1.0, 31.0), (3.0, 35.0)]));
        assert_eq!(curve.quality_at(0.5), None);
        assert!((curve.quality_at(3f64.sqrt()).unwrap() - 33.0).abs() < 1e-9);
    }
}
