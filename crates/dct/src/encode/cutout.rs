//! Alpha of 0 and 1 alone, coded coarsely and still decoded as it was.
//!
//! A channel is clamped to its range when it is decoded. So such an alpha is coded with its contrast raised by [`GAIN`] around the middle: errors of up to
//! 3/8 of the range are clamped away, and its step can be coarser than that of colours. Steps of all axes are alike, hence colours' axes
//! are [`SCALE_LOG2`] larger instead, and their weights as much smaller.

use super::source::DctSource;
use crate::form::{AXIS_BITS, DctForm};

/// Contrast of alpha.
pub(super) const GAIN: f64 = 4.0;
/// Binary logarithm of the scale of colours' axes, and with them of the steps.
pub(super) const SCALE_LOG2: u16 = 4;
/// Largest step of alpha, as a share of its range, in steps of colours.
const MOST_RATIO: f64 = 4.0;
/// Step of colours, in 8-bit units, from which on alpha is coded as finely as they are: with coarser ones the clamp begins to lose texels.
const COARSEST: f64 = 60.0;

/// The axis of such an alpha: the only one of the last of several groups. Samples have 8 bits, as sums of 32 bits hold no more.
pub(super) fn axis_of(source: &DctSource) -> Option<usize> {
    let channels = source.channels();
    let is_alone = source.groups.len() > 1 && source.groups.last() == Some(&1);
    if !source.has_alpha || !is_alone || source.depth > 8 {
        return None;
    }
    let mut seen = [false; 2];
    for texel in source.samples.chunks_exact(channels) {
        match texel[channels - 1] {
            0 => seen[0] = true,
            255 => seen[1] = true,
            _ => return None,
        }
    }
    (seen == [true; 2]).then(|| channels - 1)
}

/// Sets the weight of alpha's axis, for colours' steps of that size: the smaller it is, the finer alpha is coded.
pub(super) fn weigh(form: &mut DctForm, size: f64) {
    let ratio = (COARSEST / size).sqrt().clamp(1.0, MOST_RATIO);
    if let Some(group) = form.groups.last_mut() {
        group.axes[0][0] = (f64::from(1 << AXIS_BITS) * ratio / MOST_RATIO).round() as i16;
    }
}

/// Scale of alpha's axis for its weight.
pub(super) fn scale_of(form: &DctForm) -> f32 {
    let weight = form.groups.last().map_or(0, |group| group.axes[0][0]);
    f32::from(1i16 << AXIS_BITS) / f32::from(weight.max(1))
}

#[cfg(test)]
mod tests {
    use texfold_core::{CancelCheck, ImageSize, Metric, Rect};

    use super::*;
    use crate::encode::{DctEncoder, DctSettings};

    const SIZE: ImageSize = ImageSize { width: 96, height: 80 };

    /// Waves behind discs whose alpha is `inside`, between discs 0.
    fn discs(inside: u16, has_alpha: bool) -> DctSource {
        let texel = |at: u32| {
            let (x, y) = (at % 96, at / 96);
            let near = |at: u32| (at % 24) as i32 - 12;
            let is_inside = near(x).pow(2) + near(y).pow(2) < 80;
            let wave = |turn: u32| (128.0 + 90.0 * (f64::from(x * turn + y) / 21.0).sin()) as u16;
            [wave(1), wave(2), wave(3), if is_inside { inside } else { 0 }]
        };
        let samples = (0..96 * 80).flat_map(texel).collect();
        DctSource { has_alpha, ..DctSource::new(SIZE, &[3, 1], 8, samples).unwrap() }
    }

    #[test]
    fn alpha_of_two_values_survives_with_fewer_bytes() {
        let (plain, cut) = (discs(255, false), discs(255, true));
        for metric in [Metric::Psnr, Metric::Perceptual] {
            let at = |source: &DctSource, step: u16| {
                let settings = DctSettings::default().with_metric(metric);
                let encoder = DctEncoder::new(source, &settings, CancelCheck::default()).unwrap();
                let texture = encoder.at_step(step).unwrap();
                let rect = Rect { image: 0, level: 0, x: 0, y: 0, width: SIZE.width, height: SIZE.height };
                let mut decoded = vec![0u16; source.samples.len()];
                texture.decode(rect, &mut decoded).unwrap();
                let errors = |channel: usize| -> u64 {
                    let pairs = source.samples.iter().zip(&decoded).skip(channel).step_by(4);
                    pairs.map(|(one, other)| u64::from(one.abs_diff(*other)).pow(2)).sum()
                };
                (texture.to_bytes().len(), errors(0) + errors(1) + errors(2), errors(3))
            };
            for step in [300, 700, 1000] {
                let ((bytes, colors, alpha), (cut_bytes, cut_colors, cut_alpha)) =
                    (at(&plain, step), at(&cut, step));
                assert!(cut_alpha == 0 && alpha > 0, "{metric:?}, {step}: {cut_alpha} for {alpha}");
                assert!(cut_bytes < bytes, "{metric:?}, {step}: {cut_bytes} bytes for {bytes}");
                let ratio = cut_colors as f64 / colors as f64;
                assert!(ratio < 1.1, "{metric:?}, {step}: {cut_colors} for {colors}");
            }
        }
    }

    #[test]
    fn other_alphas_are_coded_as_they_are() {
        assert_eq!(axis_of(&discs(255, true)), Some(3));
        assert_eq!(axis_of(&discs(255, false)), None);
        assert_eq!(axis_of(&discs(254, true)), None);
        assert_eq!(axis_of(&discs(0, true)), None);
        let deep = DctSource { depth: 16, ..discs(255, true) };
        assert_eq!(axis_of(&deep), None);
        let together = DctSource { groups: vec![4], ..discs(255, true) };
        assert_eq!(axis_of(&together), None);
    }
}
