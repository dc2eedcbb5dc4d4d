//! Gray images for registration: blurs, pyramids and lookups between pixels.
//!
//! Places are in pixels, (0, 0) the upper left corner of the image: the centre of its first pixel lies at (0.5, 0.5).

use glam::{DVec2, Vec2};
use rayon::prelude::*;
use texfold_core::CancelCheck;
use texfold_core::image::Raster;

/// Blurs are cut off where the Gaussian has fallen to 1 in 2000.
const CUT_SIGMAS: f32 = 3.9;

/// One channel, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Gray {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) data: Vec<f32>,
}

impl Gray {
    /// The mean of the colour channels.
    pub(crate) fn of(image: &Raster) -> Gray {
        let size = image.size();
        let data = image.texels().map(|texel| (texel.x + texel.y + texel.z) / 3.0).collect();
        Gray { width: size.width as usize, height: size.height as usize, data }
    }

    /// Columns and rows.
    pub(crate) fn extent(&self) -> DVec2 {
        DVec2::new(self.width as f64, self.height as f64)
    }

    pub(crate) fn row(&self, y: usize) -> &[f32] {
        &self.data[y * self.width..][..self.width]
    }

    /// The pixel at (`x`, `y`), both clamped to the image.
    pub(crate) fn get(&self, x: isize, y: isize) -> f32 {
        let x = x.clamp(0, self.width as isize - 1) as usize;
        let y = y.clamp(0, self.height as isize - 1) as usize;
        self.data[y * self.width + x]
    }

    /// The value at a place, between four pixels.
    pub(crate) fn at(&self, place: Vec2) -> f32 {
        let place = place - 0.5;
        let corner = place.floor();
        let weight = place - corner;
        let (x, y) = (corner.x as isize, corner.y as isize);
        let upper = self.get(x, y) + (self.get(x + 1, y) - self.get(x, y)) * weight.x;
        let lower = self.get(x, y + 1) + (self.get(x + 1, y + 1) - self.get(x, y + 1)) * weight.x;
        upper + (lower - upper) * weight.y
    }

    /// The value at a place and its change by a pixel to the right and downwards.
    pub(crate) fn at_with_slope(&self, place: Vec2) -> (f32, Vec2) {
        let right = self.at(place + Vec2::new(0.5, 0.0)) - self.at(place - Vec2::new(0.5, 0.0));
        let down = self.at(place + Vec2::new(0.0, 0.5)) - self.at(place - Vec2::new(0.0, 0.5));
        (self.at(place), Vec2::new(right, down))
    }

    /// A Gaussian blur; edges are repeated outwards. Of no use once the job is cancelled.
    pub(crate) fn blurred(&self, sigma: f32, cancel: CancelCheck<'_>) -> Gray {
        let radius = (CUT_SIGMAS * sigma).ceil() as usize;
        let weights: Vec<f32> = (0..=2 * radius)
            .map(|k| (-(k as f32 - radius as f32).powi(2) / (2.0 * sigma * sigma)).exp())
            .collect();
        let total: f32 = weights.iter().sum();
        let weights: Vec<f32> = weights.into_iter().map(|weight| weight / total).collect();
        let mut across = vec![0.0; self.data.len()];
        across.par_chunks_mut(self.width).zip(self.data.par_chunks(self.width)).for_each(|(out, row)| {
            if cancel.is_cancelled() {
                return;
            }
            let (first, last) = (row[0], row[self.width - 1]);
            let mut padded = vec![first; radius];
            padded.extend_from_slice(row);
            padded.resize(self.width + 2 * radius, last);
            for (k, weight) in weights.iter().enumerate() {
                for (out, value) in out.iter_mut().zip(&padded[k..]) {
                    *out += weight * value;
                }
            }
        });
        let mut data = vec![0.0; self.data.len()];
        data.par_chunks_mut(self.width).enumerate().for_each(|(y, out)| {
            if cancel.is_cancelled() {
                return;
            }
            for (k, weight) in weights.iter().enumerate() {
                let row = (y + k).saturating_sub(radius).min(self.height - 1);
                for (out, value) in out.iter_mut().zip(&across[row * self.width..]) {
                    *out += weight * value;
                }
            }
        });
        Gray { width: self.width, height: self.height, data }
    }

    /// Every second pixel of every second row.
    pub(crate) fn thinned(&self) -> Gray {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let data = (0..height).flat_map(|y| self.row(2 * y).iter().step_by(2).copied()).collect();
        Gray { width, height, data }
    }

    /// Half of the columns and rows, rounded down: means of four.
    pub(crate) fn halved(&self) -> Gray {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let mean = |x: usize, y: usize| {
            let (x, y) = (2 * x as isize, 2 * y as isize);
            0.25 * (self.get(x, y) + self.get(x + 1, y) + self.get(x, y + 1) + self.get(x + 1, y + 1))
        };
        let data = (0..height).flat_map(|y| (0..width).map(move |x| mean(x, y))).collect();
        Gray { width, height, data }
    }

    /// Twice the columns and rows, between pixels. A place of this image has twice its coordinates in the other.
    pub(crate) fn doubled(&self) -> Gray {
        let (width, height) = (2 * self.width, 2 * self.height);
        let mut data = vec![0.0; width * height];
        data.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
            for (x, out) in out.iter_mut().enumerate() {
                *out = self.at((Vec2::new(x as f32, y as f32) + 0.5) * 0.5);
            }
        });
        Gray { width, height, data }
    }
}

/// An image and its halvings, down to a side below 4 pixels.
#[derive(Debug, Clone)]
pub(crate) struct Pyramid {
    pub(crate) levels: Vec<Gray>,
}

impl Pyramid {
    pub(crate) fn new(gray: Gray) -> Pyramid {
        let mut levels = vec![gray];
        while let Some(last) = levels.last().filter(|last| last.width.min(last.height) >= 8) {
            levels.push(last.halved());
        }
        Pyramid { levels }
    }

    /// The level whose pixels are nearest to `pixels` pixels of the first, and how many they are on both axes.
    pub(crate) fn level_for(&self, pixels: f64) -> (&Gray, DVec2) {
        let level = (pixels.max(1.0).log2().round() as usize).min(self.levels.len() - 1);
        let found = &self.levels[level];
        (found, self.levels[0].extent() / found.extent())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(width: usize, height: usize) -> Gray {
        let data = (0..width * height).map(|i| (i % width) as f32 + 2.0 * (i / width) as f32).collect();
        Gray { width, height, data }
    }

    #[test]
    fn lookups_of_a_ramp_are_exact_between_pixels() {
        let gray = ramp(9, 7);
        let (value, slope) = gray.at_with_slope(Vec2::new(3.75, 2.25));
        assert!((value - (3.25 + 2.0 * 1.75)).abs() < 1e-5, "{value}");
        assert!((slope - Vec2::new(1.0, 2.0)).length() < 1e-4, "{slope}");
        // Beyond the edge the edge is repeated.
        assert_eq!(gray.at(Vec2::new(-9.0, -9.0)), 0.0);
    }

    #[test]
    fn a_blur_keeps_a_ramp_away_from_the_edges() {
        let gray = ramp(41, 41).blurred(1.6, CancelCheck::default());
        assert!((gray.get(20, 20) - 60.0).abs() < 1e-3);
    }

    #[test]
    fn doubling_keeps_places() {
        let gray = ramp(8, 8);
        let doubled = gray.doubled();
        let place = Vec2::new(3.5, 4.5);
        assert!((doubled.at(place * 2.0) - gray.at(place)).abs() < 1e-5);
    }
}
