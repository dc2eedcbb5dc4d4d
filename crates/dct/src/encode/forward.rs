//! Coefficients of all planes: axes, transform, means.

use texfold_core::{CancelCheck, EncodeError, parallel};

use super::axes::{GroupAxes, axes, inverted};
use super::cutout;
use super::masking::energy;
use super::source::DctSource;
use crate::form::{DctForm, PlaneShape};
use crate::scan::COEFFICIENTS;
use crate::transform::inverse;

/// Samples of a block, row by row, or its coefficients, column by column, in the units of the inverse transform.
pub(super) type Block = [f32; COEFFICIENTS];

/// A plane's coefficients.
#[derive(Debug)]
pub(super) struct Coefficients {
    pub shape: PlaneShape,
    /// Blocks, axis by axis within each.
    pub blocks: Vec<Block>,
    /// The axis of an alpha of 0 and 1 alone, of weight 1.
    pub cutout: Option<usize>,
    /// [`energy`] of the first axis of each block.
    pub energies: Vec<f32>,
}

/// The source's header without its quantiser's numbers, and the coefficients of all planes.
pub(super) fn coefficients(
    source: &DctSource,
    form: &mut DctForm,
    check: CancelCheck<'_>,
) -> Result<Vec<Coefficients>, EncodeError> {
    let cutout = cutout::axis_of(source);
    let groups = axes(source, cutout, check)?;
    form.groups = groups.iter().map(|group| group.group).collect();
    let count = source.channels();
    let forward = Forward::new();
    let scale = f64::from(1u32 << form.fraction());
    let mut planes: Vec<Coefficients> = Vec::new();
    for shape in form.planes() {
        let blocks = shape.blocks;
        let finer = planes.last();
        let mut all = vec![[0.0; COEFFICIENTS]; blocks.0 * blocks.1 * count];
        parallel::for_each_row(&mut all, blocks.0 * count, |row, out| {
            let out = out.chunks_exact_mut(count).enumerate();
            for (column, out) in out.filter(|_| !check.is_cancelled()) {
                match finer {
                    None => image_block(source, &groups, scale, (column, row), out),
                    Some(finer) => means_block(finer, shape, (column, row), out),
                }
                out.iter_mut().for_each(|samples| *samples = forward.transform(samples));
            }
        });
        check.checkpoint()?;
        let energies = parallel::map(blocks.0 * blocks.1, |block| energy(&all[block * count]));
        planes.push(Coefficients { shape, blocks: all, cutout, energies });
    }
    Ok(planes)
}

/// Axes of the texels of a block; texels outside of the image repeat those at its border.
fn image_block(
    source: &DctSource,
    groups: &[GroupAxes],
    scale: f64,
    (column, row): (usize, usize),
    out: &mut [Block],
) {
    let count = out.len();
    let (width, height) = (source.size.width as usize, source.size.height as usize);
    for at in 0..COEFFICIENTS {
        let (x, y) = ((8 * column + at % 8).min(width - 1), (8 * row + at / 8).min(height - 1));
        let texel = &source.samples[(y * width + x) * count..][..count];
        for GroupAxes { group, first, forward } in groups {
            let channels = usize::from(group.channels);
            let texel = &texel[*first..first + channels];
            for axis in 0..channels {
                let parts = texel.iter().zip(group.means).zip(forward[axis]);
                let value: f64 = parts
                    .map(|((&sample, mean), weight)| (f64::from(sample) - f64::from(mean)) * weight)
                    .sum();
                out[first + axis][at] = (value * scale) as f32;
            }
        }
    }
}

/// Means of the blocks of the plane that is finer.
fn means_block(finer: &Coefficients, shape: PlaneShape, (column, row): (usize, usize), out: &mut [Block]) {
    let count = out.len();
    let (width, height) = (shape.size.width as usize, shape.size.height as usize);
    for at in 0..COEFFICIENTS {
        let (x, y) = ((8 * column + at % 8).min(width - 1), (8 * row + at / 8).min(height - 1));
        let blocks = &finer.blocks[(y * width + x) * count..][..count];
        out.iter_mut().zip(blocks).for_each(|(out, block)| out[at] = block[0]);
    }
}

/// The inverse of the inverse transform.
pub(super) struct Forward([[f32; 8]; 8]);

impl Forward {
    pub(super) fn new() -> Forward {
        // The inverse transform's answer to each frequency, large enough for its rounding not to count.
        const ONE: i32 = 1 << 20;
        let mut basis = [[0.0; 8]; 8];
        for frequency in 0..8 {
            let mut coefficients = [0; COEFFICIENTS];
            coefficients[8 * frequency] = ONE;
            let row = inverse(coefficients);
            (0..8).for_each(|place| basis[place][frequency] = f64::from(row[place]) / f64::from(ONE));
        }
        Forward(inverted(basis, 8).map(|row| row.map(|weight| weight as f32)))
    }

    /// A block's coefficients.
    #[inline(always)]
    pub(super) fn transform(&self, samples: &Block) -> Block {
        let mut half = [0.0; COEFFICIENTS];
        for (samples, half) in samples.chunks_exact(8).zip(half.chunks_exact_mut(8)) {
            for (out, weights) in half.iter_mut().zip(&self.0) {
                *out = weights.iter().zip(samples).map(|(weight, sample)| weight * sample).sum();
            }
        }
        let mut out = [0.0; COEFFICIENTS];
        for (v, weights) in self.0.iter().enumerate() {
            let mut row = [0.0; 8];
            for (weight, half) in weights.iter().zip(half.chunks_exact(8)) {
                row.iter_mut().zip(half).for_each(|(out, half)| *out += weight * half);
            }
            row.iter().enumerate().for_each(|(u, &value)| out[8 * u + v] = value);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The transform's definition: an orthonormal DCT, whose coefficients count by their scales.
    #[test]
    fn the_transform_is_a_cosine_transform() {
        let samples: Block = std::array::from_fn(|at| ((at * at * 31 + 7 * at) % 255) as f32);
        let found = Forward::new().transform(&samples);
        for v in 0..8 {
            for u in 0..8 {
                let cosine = |k: usize, x: usize| {
                    (std::f64::consts::PI * k as f64 * (2 * x + 1) as f64 / 16.0).cos()
                        * if k == 0 { 0.125f64.sqrt() } else { 0.5 }
                };
                let naive: f64 =
                    (0..64).map(|at| f64::from(samples[at]) * cosine(u, at % 8) * cosine(v, at / 8)).sum();
                let scale = |k: usize| f64::from(crate::form::SCALES[k]) / 4096.0;
                let scaled = naive * scale(u) * scale(v) / 8.0;
                assert!(
                    (scaled - f64::from(found[8 * u + v])).abs() < 0.5,
                    "{u} {v}: {scaled} {}",
                    found[8 * u + v]
                );
            }
        }
    }

    #[test]
    fn forward_and_inverse_give_the_samples_back() {
        let samples: Block = std::array::from_fn(|at| ((at * 2647 + 13 * at * at) % 255) as f32);
        // With 10 fractional bits.
        let coefficients = Forward::new().transform(&samples).map(|value| (1024.0 * value).round() as i32);
        for (&found, sample) in inverse(coefficients).iter().zip(samples) {
            assert!((found as f32 / 1024.0 - sample).abs() < 0.1, "{found} for {sample}");
        }
    }
}
