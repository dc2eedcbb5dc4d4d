//! Smaller images whose enlargement is nearest to an image, found by simultaneous iterative reconstruction (Gilbert, "Iterative
//! methods for the three-dimensional reconstruction of an object from projections", 1972), with momentum.

use std::ops::Range;

use rayon::prelude::*;
use texfold_core::address::TexfoldTap;
use texfold_core::{CancelCheck, EncodeError, ImageSize};

/// Length of a step, in units of the error that a texel leaves, and share of the last one that is added to it.
const STEP: f32 = 2.0;
const MOMENTUM: f32 = 0.5;

/// Bilinear enlargement of a smaller image, each channel alone.
#[derive(Debug)]
pub struct Enlargement {
    /// Columns and rows of the smaller image.
    pub small: ImageSize,
    /// Columns of the smaller image that each column of the image is read from, in `x`.
    pub columns: Vec<TexfoldTap>,
    /// Rows likewise, in `y`.
    pub rows: Vec<TexfoldTap>,
    /// Columns and rows of the image whose errors are counted.
    pub counted: [Range<usize>; 2],
    /// Factor of the contrast around one half behind the filter.
    pub gain: f32,
}

impl Enlargement {
    /// Moves `small`, the values of a channel row by row, towards those whose enlargement is nearest to `wanted`, by so many passes.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`].
    pub fn fit(
        &self,
        small: &mut [f32],
        wanted: &[f32],
        passes: usize,
        check: CancelCheck<'_>,
    ) -> Result<(), EncodeError> {
        let width = self.small.width as usize;
        let across = shares(&self.columns, width, 0);
        let down = shares(&self.rows, self.small.height as usize, 1);
        let mut speeds = vec![0.0; small.len()];
        for _ in 0..passes {
            check.checkpoint()?;
            let sums = self.gathered(&self.residuals(small, wanted));
            let step = STEP / self.gain;
            for (index, ((value, speed), sum)) in small.iter_mut().zip(&mut speeds).zip(sums).enumerate() {
                let weight = (across[index % width] * down[index / width]).max(f32::MIN_POSITIVE);
                *speed = *speed * MOMENTUM + sum / weight * step;
                *value = (*value + *speed).clamp(0.0, 1.0);
            }
        }
        Ok(())
    }

    /// The sum of squared errors of the enlargement, in units of the range.
    #[must_use]
    pub fn squared(&self, small: &[f32], wanted: &[f32]) -> f64 {
        let [columns, rows] = self.counted.clone();
        let away = self.residuals(small, wanted);
        let lines = away.chunks_exact(self.columns.len()).skip(rows.start).take(rows.len());
        lines.flat_map(|line| &line[columns.clone()]).map(|&away| f64::from(away).powi(2)).sum()
    }

    /// Difference of the image and the enlargement, texel by texel.
    #[must_use]
    pub fn residuals(&self, small: &[f32], wanted: &[f32]) -> Vec<f32> {
        let count = self.columns.len();
        let widened: Vec<f32> = small
            .par_chunks(self.small.width as usize)
            .flat_map_iter(|row| {
                let value = |tap: &TexfoldTap| {
                    let (left, right) = (row[tap.low.x as usize], row[tap.high.x as usize]);
                    left + (right - left) * tap.weight.x
                };
                self.columns.iter().map(value)
            })
            .collect();
        let mut away = wanted.to_vec();
        let offset = 0.5 * (self.gain - 1.0);
        away.par_chunks_mut(count).zip(&self.rows).for_each(|(line, tap)| {
            let row = |at: u32| &widened[at as usize * count..][..count];
            for ((away, upper), lower) in line.iter_mut().zip(row(tap.low.y)).zip(row(tap.high.y)) {
                let read = upper + (lower - upper) * tap.weight.y;
                *away -= (read * self.gain - offset).clamp(0.0, 1.0);
            }
        });
        away
    }

    /// For each texel of the smaller image the sum of the residuals that it contributes to, by its weights there.
    #[must_use]
    pub fn gathered(&self, away: &[f32]) -> Vec<f32> {
        let width = self.small.width as usize;
        let count = self.columns.len();
        let row = |at: u32| -> Vec<f32> {
            let mut line = vec![0.0; count];
            // Rows are read in order.
            let first = self.rows.partition_point(|tap| tap.high.y < at);
            for (tap, away) in self.rows.iter().zip(away.chunks_exact(count)).skip(first) {
                if tap.low.y > at {
                    break;
                }
                let low = if tap.low.y == at { 1.0 - tap.weight.y } else { 0.0 };
                let weight = low + if tap.high.y == at { tap.weight.y } else { 0.0 };
                line.iter_mut().zip(away).for_each(|(sum, away)| *sum += away * weight);
            }
            let mut sums = vec![0.0; width];
            for (tap, sum) in self.columns.iter().zip(line) {
                sums[tap.low.x as usize] += sum * (1.0 - tap.weight.x);
                sums[tap.high.x as usize] += sum * tap.weight.x;
            }
            sums
        };
        (0..self.small.height).into_par_iter().flat_map_iter(row).collect()
    }
}

/// Sum of the weights with which the enlargement reads each of `count` columns (`axis` 0) or rows (1).
fn shares(taps: &[TexfoldTap], count: usize, axis: usize) -> Vec<f32> {
    let mut shares = vec![0.0f32; count];
    for tap in taps {
        shares[tap.low[axis] as usize] += 1.0 - tap.weight[axis];
        shares[tap.high[axis] as usize] += tap.weight[axis];
    }
    shares
}
