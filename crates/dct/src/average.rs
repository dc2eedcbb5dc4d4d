//! Texels of smaller mip levels: means of squares of texels.
//!
//! Values of sRGB are averaged as light, for which the squares of values stand (a gamma of 2 beside sRGB's 2.2: whole numbers, so
//! that a shader gives the same), and colours are weighted by alpha, so that hidden ones do not show.

use texfold_core::image::{ColorSpace, PixelInfo};
use texfold_core::{ImageSize, MipAverage};

use crate::form::MAX_CHANNELS;

/// How such pixels are averaged.
pub(super) fn average_of(pixel: PixelInfo) -> MipAverage {
    MipAverage { is_light: pixel.color == ColorSpace::Srgb, is_weighted: pixel.has_alpha() }
}

/// Samples of an image or of a part of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Samples<'a> {
    /// Columns and rows.
    pub size: ImageSize,
    /// Channels; the last is alpha where colours are weighted.
    pub channels: usize,
    /// Largest sample.
    pub largest: u16,
    /// Texel by texel, row by row.
    pub values: &'a [u16],
}

impl Samples<'_> {
    /// The means of squares of 2^`reduce_log2` (1 or 2) texels a side; beyond an edge the nearest texel counts again.
    pub(super) fn reduced(&self, reduce_log2: u32, size: ImageSize, average: MipAverage) -> Vec<u16> {
        let mut out = Vec::new();
        for y in 0..size.height {
            for x in 0..size.width {
                self.push_mean((x << reduce_log2, y << reduce_log2), 1 << reduce_log2, average, &mut out);
            }
        }
        out
    }

    fn push_mean(&self, (x, y): (u32, u32), side: u32, average: MipAverage, out: &mut Vec<u16>) {
        let deep = self.largest > u16::from(u8::MAX);
        let (square_shift, weight_shift) = if deep { (12, 8) } else { (0, 0) };
        // Alpha is averaged as it is.
        let colours = self.channels - usize::from(average.is_weighted);
        let mut sums = [0u32; MAX_CHANNELS];
        let (mut alpha, mut weights) = (0u32, 0u32);
        for (column, row) in (0..side * side).map(|place| (place % side, place / side)) {
            let column = (x + column).min(self.size.width - 1) as usize;
            let row = (y + row).min(self.size.height - 1) as usize;
            let first = (row * self.size.width as usize + column) * self.channels;
            let texel = &self.values[first..first + self.channels];
            let last = u32::from(texel[self.channels - 1]);
            // Never 0, so that where all is hidden all counts.
            let weight = if average.is_weighted { (last >> weight_shift) + 1 } else { 1 };
            for (sum, &value) in sums.iter_mut().zip(&texel[..colours]) {
                let value = u32::from(value);
                *sum += weight * if average.is_light { (value * value) >> square_shift } else { value };
            }
            alpha += last;
            weights += weight;
        }
        for sum in &sums[..colours.min(sums.len())] {
            let mean = (sum + weights / 2) / weights;
            let value = if average.is_light { root(mean << square_shift) } else { mean };
            out.push(value.min(u32::from(self.largest)) as u16);
        }
        if average.is_weighted {
            out.push(((alpha + side * side / 2) / (side * side)) as u16);
        }
    }
}

/// The square root of a number, rounded; `texfold_block_root` of the shader.
fn root(value: u32) -> u32 {
    let root = value.isqrt();
    root + u32::from(value - root * root > root)
}
