//! How strongly a texture is deblocked: as its errors are least.
//!
//! Errors are those that its coefficients were quantised by, in squared steps: with the steps of all coefficients alike squared errors
//! of the samples, with those for the eye the same by frequency. So a stronger filter is never taken where it is worse.

use texfold_core::{CancelCheck, EncodeError, Metric, parallel};

use super::forward::{Coefficients, Forward};
use crate::deblock::{MAX_DEBLOCKING, deblock};
use crate::decode::DctTexture;
use crate::form::Steps;
use crate::scan::COEFFICIENTS;

/// Strengths, none among them.
const STRENGTHS: usize = MAX_DEBLOCKING as usize + 1;

/// Largest strength that is tried: mean gains over seven photographs at 0.5 bits for PSNR are 0.15, 0.18 and 0.18 dB and 0.5, 0.5
/// and 0.3 points of SSIMULACRA2, for the eye 0.10, 0.15 and 0.17 dB and 0.2, 0.1 and -0.1 points.
pub(super) fn strongest(metric: Metric) -> u8 {
    match metric {
        Metric::Psnr => MAX_DEBLOCKING,
        Metric::Perceptual => 1,
    }
}

/// What is tried.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tried {
    /// Largest strength.
    pub most: u8,
    /// Every so many superblocks one is looked at.
    pub stride: usize,
}

/// The texture at the strength with the least error of those tried; `source` has the image's coefficients.
pub(super) fn deblocked(
    texture: DctTexture,
    source: &Coefficients,
    Tried { most, stride }: Tried,
    check: CancelCheck<'_>,
) -> Result<DctTexture, EncodeError> {
    let judge = Judge::new(&texture, source, most);
    let errors = parallel::map(source.shape.count().div_ceil(stride), |number| {
        let number = number * stride;
        let place = (number % source.shape.superblocks.0, number / source.shape.superblocks.0);
        if check.is_cancelled() { [0.0; STRENGTHS] } else { judge.errors(place) }
    });
    check.checkpoint()?;
    // One after the other, so that the sums do not depend on threads.
    let mut sums = [0.0; STRENGTHS];
    for errors in errors {
        sums.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error);
    }
    let mut best = 0;
    for strength in 1..=usize::from(most) {
        if sums[strength] < sums[best] {
            best = strength;
        }
    }
    Ok(texture.with_deblocking(best as u8))
}

/// What errors are measured with.
struct Judge<'a> {
    texture: &'a DctTexture,
    source: &'a Coefficients,
    forward: Forward,
    steps: [f32; COEFFICIENTS],
    ranks: Vec<u8>,
    /// Largest jump that each strength takes away.
    limits: Vec<i32>,
}

impl<'a> Judge<'a> {
    fn new(texture: &'a DctTexture, source: &'a Coefficients, most: u8) -> Self {
        let form = texture.form();
        let steps = Steps::new(&form.quantiser, 0, form.fraction());
        Judge {
            texture,
            source,
            forward: Forward::new(),
            steps: std::array::from_fn(|at| steps.size(at)),
            ranks: form.ranks(),
            limits: (0..=most).map(|strength| form.deblocking_limit(strength)).collect(),
        }
    }

    /// Errors of a superblock at each strength.
    fn errors(&self, place: (usize, usize)) -> [f64; STRENGTHS] {
        let side = self.texture.superblock_side() as usize;
        let blocks = self.source.shape.blocks_in(place.0, place.1);
        let plain = self.texture.image_superblock(place);
        let mut errors = [0.0; STRENGTHS];
        for (error, &limit) in errors.iter_mut().zip(&self.limits) {
            let mut samples = plain.clone();
            deblock(&mut samples, side, blocks, &self.ranks, limit);
            *error = self.error(&samples, place, blocks);
        }
        errors
    }

    /// Error of a superblock of those samples.
    fn error(&self, samples: &[i32], place: (usize, usize), blocks: (usize, usize)) -> f64 {
        let (shape, side, axes) = (self.source.shape, 8 * self.source.shape.side, self.ranks.len());
        let mut sum = 0.0;
        for (column, row) in (0..blocks.0 * blocks.1).map(|block| (block % blocks.0, block / blocks.0)) {
            let number = (place.1 * shape.side + row) * shape.blocks.0 + place.0 * shape.side + column;
            // The errors of a cut-out are clamped away, mostly.
            for axis in (0..axes).filter(|&axis| self.source.cutout != Some(axis)) {
                let first = (axis * side + 8 * row) * side + 8 * column;
                let decoded = std::array::from_fn(|at| samples[first + at / 8 * side + at % 8] as f32);
                let pairs = self
                    .forward
                    .transform(&decoded)
                    .into_iter()
                    .zip(self.source.blocks[number * axes + axis]);
                let errors = pairs.zip(self.steps).map(|((found, wanted), step)| (found - wanted) / step);
                sum += f64::from(errors.map(|error| error * error).sum::<f32>());
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use texfold_core::rng::Rng;
    use texfold_core::{CancelCheck, ImageSize, Metric, Rect};

    use crate::DctTexture;
    use crate::encode::{DctEncoder, DctSettings, DctSource};

    const SIZE: ImageSize = ImageSize { width: 128, height: 96 };

    fn source(noise: u32) -> DctSource {
        let mut rng = Rng::new(4);
        let sample = |at: u32| {
            let (x, y) = (at / 3 % 128, at / 384);
            let slope = 90.0 + 60.0 * (f64::from(x) / 19.0).sin() * (f64::from(y) / 13.0).cos();
            (slope as u32 + at % 3 * 10 + rng.below(noise + 1)) as u8
        };
        let samples: Vec<u8> = (0..3 * 128 * 96).map(sample).collect();
        DctSource::from_u8(SIZE, &[3], &samples).unwrap()
    }

    fn error(source: &DctSource, texture: &DctTexture) -> f64 {
        let mut found = vec![0u16; source.samples().len()];
        let rect = Rect { image: 0, level: 0, x: 0, y: 0, width: SIZE.width, height: SIZE.height };
        texture.decode(rect, &mut found).unwrap();
        found.iter().zip(source.samples()).map(|(&a, &b)| f64::from(a.abs_diff(b)).powi(2)).sum()
    }

    #[test]
    fn the_strength_with_the_least_error_is_taken() {
        for noise in [0, 20] {
            let source = source(noise);
            let params = DctSettings::default().with_metric(Metric::Psnr);
            let encoder = DctEncoder::new(&source, &params, CancelCheck::default()).unwrap();
            for step in [600, 1400, 2000, 2600] {
                let texture = encoder.at_step(step).unwrap();
                let errors =
                    [0, 1, 2, 3].map(|strength| error(&source, &texture.clone().with_deblocking(strength)));
                let least = errors.into_iter().fold(f64::INFINITY, f64::min);
                // Rounding to samples is not what the encoder sees: a twelfth for each, which differs by chance.
                let rounding = source.samples().len() as f64 / 12.0;
                let taken = errors[usize::from(texture.form().deblocking)];
                assert!(
                    taken <= 1.005 * least + 0.01 * rounding,
                    "noise {noise}, step {step}: {taken} of {errors:?}"
                );
            }
        }
    }

    #[test]
    fn smooth_images_at_few_bits_are_deblocked() {
        let source = source(0);
        let params = DctSettings::default().with_metric(Metric::Psnr);
        let encoder = DctEncoder::new(&source, &params, CancelCheck::default()).unwrap();
        let texture = encoder.at_step(1700).unwrap();
        assert!(texture.form().deblocking > 0);
        let plain = texture.clone().with_deblocking(0);
        assert!(error(&source, &texture) < error(&source, &plain));
    }
}
