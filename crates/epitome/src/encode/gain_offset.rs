//! Gain-offset pairs: gain and offset for each colour channel, and the palette of them.

use glam::{DVec4, Vec4};
use texfold_core::CancelCheck;

use crate::format::{GAIN_ONE, GainOffset, NEUTRAL, OFFSET_ZERO};

/// Gain at most this much above 1: content is taken from the brighter place, where its steps are finer (paper section
/// 3.1).
const MOST_GAIN: f64 = 1.25;
/// Prior of gain 1, in 8-bit squared steps a texel: flat content says nothing of contrast.
const GAIN_PRIOR: f64 = 1.0;
/// Gain-offset pairs are seeded in order of their mean offset in steps of this many 8-bit units, and of their gain
/// within a step.
const SEED_OFFSETS: u32 = 4;
/// Rounds in which the palette is fitted.
const ROUNDS: usize = 8;

/// Sums over a leaf's texels of content x and target y, both less a mean, for each channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stats {
    count: f32,
    mean: Vec4,
    sx: Vec4,
    sy: Vec4,
    sxx: Vec4,
    sxy: Vec4,
    syy: Vec4,
}

impl Stats {
    /// Empty sums around the mean of `target`.
    pub(crate) fn around(target: &[Vec4]) -> Self {
        let count = target.len() as f32;
        let mean = target.iter().copied().sum::<Vec4>() / count.max(1.0);
        let zero = Vec4::ZERO;
        Stats { count, mean, sx: zero, sy: zero, sxx: zero, sxy: zero, syy: zero }
    }

    /// The same, of `count` texels only.
    pub(crate) fn of_some(self, count: u32) -> Self {
        Stats { count: count as f32, ..self }
    }

    #[inline]
    pub(crate) fn add(&mut self, content: Vec4, target: Vec4) {
        let (x, y) = (content - self.mean, target - self.mean);
        self.sx += x;
        self.sy += y;
        self.sxx += x * x;
        self.sxy += x * y;
        self.syy += y * y;
    }

    /// Squared error of the content as it is.
    pub(crate) fn plain_error(&self) -> f32 {
        let squared = self.syy - 2.0 * self.sxy + self.sxx;
        squared.max(Vec4::ZERO).element_sum()
    }

    /// Squared error under a gain-offset pair.
    pub(crate) fn error(&self, gain_offset: &GainOffset) -> f32 {
        let (gain, offset) = values(gain_offset);
        // Offset that acts on values less the mean.
        let offset = offset + (gain - 1.0) * self.mean;
        let squared = self.syy + gain * gain * self.sxx + self.count * offset * offset
            - 2.0 * gain * self.sxy
            - 2.0 * offset * self.sy
            + 2.0 * gain * offset * self.sx;
        squared.max(Vec4::ZERO).element_sum()
    }

    /// The gain-offset pair of least error.
    pub(crate) fn best(&self) -> GainOffset {
        Sums::default().with(self).gain_offset()
    }
}

/// Gain and offset in 8-bit units; alpha keeps its value.
pub(crate) fn values(gain_offset: &GainOffset) -> (Vec4, Vec4) {
    let one = f32::from(GAIN_ONE);
    let gain =
        Vec4::new(f32::from(gain_offset[0]), f32::from(gain_offset[1]), f32::from(gain_offset[2]), one) / one;
    let signed = |index: usize| f32::from(gain_offset[index]) - f32::from(OFFSET_ZERO);
    let offset = Vec4::new(signed(3), signed(4), signed(5), 0.0);
    (gain, offset)
}

/// Sums of several leaves, around zero.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    count: f64,
    sx: DVec4,
    sy: DVec4,
    sxx: DVec4,
    sxy: DVec4,
}

impl Sums {
    fn with(mut self, stats: &Stats) -> Self {
        let (n, m) = (f64::from(stats.count), stats.mean.as_dvec4());
        let (sx, sy) = (stats.sx.as_dvec4(), stats.sy.as_dvec4());
        self.count += n;
        self.sx += sx + n * m;
        self.sy += sy + n * m;
        self.sxx += stats.sxx.as_dvec4() + 2.0 * m * sx + n * m * m;
        self.sxy += stats.sxy.as_dvec4() + m * (sx + sy) + n * m * m;
        self
    }

    /// Least squares, channel by channel, rounded to what can be stored.
    fn gain_offset(&self) -> GainOffset {
        let mut gain_offset = NEUTRAL;
        let n = self.count.max(1.0);
        for channel in 0..3 {
            let (sx, sy) = (self.sx[channel], self.sy[channel]);
            let vxx = self.sxx[channel] - sx * sx / n;
            let vxy = self.sxy[channel] - sx * sy / n;
            let prior = GAIN_PRIOR * n;
            let gain = ((vxy + prior) / (vxx + prior)).clamp(0.0, MOST_GAIN);
            let (one, zero) = (f64::from(GAIN_ONE), f64::from(OFFSET_ZERO));
            let gain = (gain * one).round() / one;
            let offset = ((sy - gain * sx) / n).round().clamp(-zero, f64::from(u8::MAX) - zero);
            gain_offset[channel] = (gain * one) as u8;
            gain_offset[channel + 3] = (offset + zero) as u8;
        }
        gain_offset
    }
}

/// At most `count` gain-offset pairs, the neutral one first, fitted to the leaves by Lloyd's iteration on their
/// errors.
pub(crate) fn palette(leaves: &[Stats], count: usize, cancel: CancelCheck<'_>) -> Vec<GainOffset> {
    let mut gain_offsets = vec![NEUTRAL];
    if count <= 1 || leaves.is_empty() {
        return gain_offsets;
    }
    // Seeds: the own gain-offset pairs of leaves, evenly spread by brightness shift.
    let mut own: Vec<GainOffset> = leaves.iter().map(Stats::best).collect();
    own.sort_by_key(|gain_offset| {
        let sum =
            |range: std::ops::Range<usize>| gain_offset[range].iter().map(|&v| u32::from(v)).sum::<u32>();
        (sum(3..6) / (3 * SEED_OFFSETS), sum(0..3), *gain_offset)
    });
    let step = own.len() as f64 / (count - 1) as f64;
    gain_offsets.extend((0..count - 1).map(|index| own[((index as f64 + 0.5) * step) as usize]));
    gain_offsets.dedup();
    for _ in 0..ROUNDS {
        let mut sums = vec![Sums::default(); gain_offsets.len()];
        for stats in leaves {
            if cancel.is_cancelled() {
                return gain_offsets;
            }
            let nearest = nearest(&gain_offsets, stats).0;
            sums[nearest] = sums[nearest].with(stats);
        }
        for (gain_offset, sums) in gain_offsets.iter_mut().zip(&sums).skip(1) {
            if sums.count > 0.0 {
                *gain_offset = sums.gain_offset();
            }
        }
    }
    gain_offsets
}

/// Number and error of the gain-offset pair of least error, the first of equals.
pub(crate) fn nearest(gain_offsets: &[GainOffset], stats: &Stats) -> (usize, f32) {
    let mut best = (0, f32::INFINITY);
    for (index, gain_offset) in gain_offsets.iter().enumerate() {
        let error = stats.error(gain_offset);
        if error < best.1 {
            best = (index, error);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_give_the_error_that_texels_give() {
        let content: Vec<Vec4> =
            (0..64).map(|i| Vec4::new(i as f32 * 3.0, 200.0 - i as f32, 50.0, 255.0)).collect();
        let target: Vec<Vec4> =
            content.iter().map(|x| Vec4::new(x.x * 0.8 + 9.0, x.y, 70.0, 255.0)).collect();
        let mut stats = Stats::around(&target);
        content.iter().zip(&target).for_each(|(&x, &y)| stats.add(x, y));
        let gain_offset: GainOffset = [100, 128, 120, 140, 128, 160];
        let (gain, offset) = values(&gain_offset);
        let slow: f32 =
            content.iter().zip(&target).map(|(&x, &y)| (y - gain * x - offset).length_squared()).sum();
        assert!(
            (stats.error(&gain_offset) - slow).abs() < slow * 1e-3,
            "{} {slow}",
            stats.error(&gain_offset)
        );
        assert!(stats.error(&stats.best()) < 64.0, "{:?}", stats.best());
        assert!((stats.plain_error() - stats.error(&NEUTRAL)).abs() < 1.0);
        let gain_offsets = palette(&[stats; 3], 8, CancelCheck::default());
        assert_eq!(gain_offsets[0], NEUTRAL);
        assert!(nearest(&gain_offsets, &stats).1 < 64.0);
    }
}
