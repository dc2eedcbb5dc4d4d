//! SSIM, from rows of pixels around a few others at a time.

use rayon::prelude::*;

use super::compare::read;
use super::counted_channels;
use crate::image::Raster;
use crate::vectorised;

const SIGMA: f64 = 1.5;
const RADIUS: usize = 5;
const TAPS: usize = 2 * RADIUS + 1;
const C1: f32 = (0.01 * 255.0) * (0.01 * 255.0);
const C2: f32 = (0.03 * 255.0) * (0.03 * 255.0);
/// Values that are worked on together.
const LANES: usize = 16;
/// Rows that one thread compares; it holds the rows around them, too.
const BAND_ROWS: usize = 32;
/// What is averaged in each window: both images, their squares, and their product.
const SIGNALS: usize = 5;

/// Offset of samples: variances and covariances do not change, and single precision loses less of them.
const MIDDLE: f32 = 128.0;

/// SSIM of two images of the same size, mean over the colour channels and a band; 1 where they are equal.
#[must_use]
pub fn ssim(source: &Raster, decoded: &Raster) -> f64 {
    let channels = counted_channels(source, decoded);
    let size = source.size();
    let (width, height) = (size.width as usize, size.height as usize);
    let fits = width > 2 * RADIUS && height > 2 * RADIUS;
    let margin = if fits { RADIUS } else { 0 };
    let windows = Windows { width, height, margin, weights: weights(), channels };
    let tops: Vec<usize> = (margin..height - margin).step_by(BAND_ROWS).collect();
    // Bands and rows are vectors, so these loops are compiled for the processor that runs them.
    let of_band = |top| {
        vectorised(
            #[inline(always)]
            || windows.band((source, decoded), top),
        )
    };
    let sums: Vec<f64> = tops.into_par_iter().map(of_band).collect();
    let places = (height - 2 * margin) * (width - 2 * margin) * channels.len();
    sums.iter().sum::<f64>() / places as f64
}

/// The Gaussian along one axis.
fn weights() -> [f32; TAPS] {
    let raw: [f64; TAPS] = std::array::from_fn(|tap| {
        let away = tap as f64 - RADIUS as f64;
        (-(away * away) / (2.0 * SIGMA * SIGMA)).exp()
    });
    let total: f64 = raw.iter().sum();
    raw.map(|weight| (weight / total) as f32)
}

/// Windows around the places of an image that are `margin` away from its edges; mirrored at the edges (…b a | a b c…).
struct Windows {
    width: usize,
    height: usize,
    margin: usize,
    weights: [f32; TAPS],
    /// Channels that are compared.
    channels: &'static [usize],
}

impl Windows {
    /// The sum of the SSIM of all channels over the rows of a band.
    #[inline(always)]
    fn band(&self, (a, b): (&Raster, &Raster), top: usize) -> f64 {
        let rows = BAND_ROWS.min(self.height - self.margin - top);
        let gains = [a.peak().recip(); 4];
        let lines = |raster: &Raster| -> Vec<Vec<[u8; 4]>> {
            let line = |row: usize| {
                let y = mirrored(top as i64 + row as i64 - RADIUS as i64, self.height);
                let mut line = vec![[0; 4]; self.width];
                read(raster, y as u32, gains, &mut line);
                line
            };
            (0..rows + 2 * RADIUS).map(line).collect()
        };
        let hides_colors = a.info().hides_colors();
        let (a, mut b) = (lines(a), lines(b));
        if hides_colors {
            // Hidden colours are alike.
            for (a, b) in a.iter().flatten().zip(b.iter_mut().flatten()).filter(|(a, _)| a[3] == 0) {
                b[..3].copy_from_slice(&a[..3]);
            }
        }
        let mut blurred = Blurred::new(self.width);
        let mut means: [Vec<f32>; SIGNALS] = std::array::from_fn(|_| vec![0.0; self.width]);
        let mut sum = 0.0;
        for &channel in self.channels {
            blurred.values.clear();
            for (a, b) in a.iter().zip(&b) {
                blurred.push(&self.weights, (a, b), channel);
            }
            for row in 0..rows {
                for (signal, means) in means.iter_mut().enumerate() {
                    let lines = std::array::from_fn(|tap| blurred.line(row + tap, signal));
                    convolve(&self.weights, lines, means);
                }
                sum += self.row(&means);
            }
        }
        sum
    }

    /// The sum of the SSIM of a row.
    #[inline(always)]
    fn row(&self, means: &[Vec<f32>; SIGNALS]) -> f64 {
        let inside = self.margin..self.width - self.margin;
        let [a, b, aa, bb, ab] = means.each_ref().map(|mean| &mean[inside.clone()]);
        let similarity = |a: f32, b: f32, aa: f32, bb: f32, ab: f32| {
            let (va, vb, covariance) = (aa - a * a, bb - b * b, ab - a * b);
            let (a, b) = (a + MIDDLE, b + MIDDLE);
            (2.0 * a * b + C1) * (2.0 * covariance + C2) / ((a * a + b * b + C1) * (va + vb + C2))
        };
        // Sums of lanes, in an order that does not depend on the processor.
        let mut sums = [0.0f64; LANES];
        let whole = a.len() / LANES * LANES;
        for first in (0..whole).step_by(LANES) {
            let lanes = first..first + LANES;
            let (a, b, ab) = (&a[lanes.clone()], &b[lanes.clone()], &ab[lanes.clone()]);
            let (aa, bb) = (&aa[lanes.clone()], &bb[lanes]);
            for lane in 0..LANES {
                sums[lane] += f64::from(similarity(a[lane], b[lane], aa[lane], bb[lane], ab[lane]));
            }
        }
        let rest = (whole..a.len()).map(|at| f64::from(similarity(a[at], b[at], aa[at], bb[at], ab[at])));
        rest.chain(sums).sum()
    }
}

/// Rows of signals that are averaged along x, each signal of a row behind the other.
struct Blurred {
    width: usize,
    values: Vec<f32>,
    /// A row with what lies beyond its ends.
    padded: [Vec<f32>; SIGNALS],
}

impl Blurred {
    fn new(width: usize) -> Blurred {
        let padded = std::array::from_fn(|_| vec![0.0; width + 2 * RADIUS]);
        Blurred { width, values: Vec::new(), padded }
    }

    fn line(&self, row: usize, signal: usize) -> &[f32] {
        &self.values[(row * SIGNALS + signal) * self.width..][..self.width]
    }

    #[inline(always)]
    fn push(&mut self, weights: &[f32; TAPS], (a, b): (&[[u8; 4]], &[[u8; 4]]), channel: usize) {
        let [mean_a, mean_b, aa, bb, ab] = &mut self.padded;
        for (at, (a, b)) in a.iter().zip(b).enumerate() {
            mean_a[at + RADIUS] = f32::from(a[channel]) - MIDDLE;
            mean_b[at + RADIUS] = f32::from(b[channel]) - MIDDLE;
        }
        for line in [&mut *mean_a, &mut *mean_b] {
            for at in (0..RADIUS).chain(RADIUS + self.width..self.width + 2 * RADIUS) {
                line[at] = line[RADIUS + mirrored(at as i64 - RADIUS as i64, self.width)];
            }
        }
        for at in 0..self.width + 2 * RADIUS {
            // Products of bytes are exact.
            (aa[at], bb[at], ab[at]) =
                (mean_a[at] * mean_a[at], mean_b[at] * mean_b[at], mean_a[at] * mean_b[at]);
        }
        for signal in &self.padded {
            let start = self.values.len();
            self.values.resize(start + self.width, 0.0);
            let lines = std::array::from_fn(|tap| &signal[tap..tap + self.width]);
            convolve(weights, lines, &mut self.values[start..]);
        }
    }
}

/// The sum of lines of one length, each times its weight.
#[inline(always)]
fn convolve(weights: &[f32; TAPS], lines: [&[f32]; TAPS], out: &mut [f32]) {
    let lines = lines.map(|line| &line[..out.len()]);
    let whole = out.len() / LANES * LANES;
    for first in (0..whole).step_by(LANES) {
        let mut sums = [0.0f32; LANES];
        for (weight, line) in weights.iter().zip(lines) {
            for (sum, value) in sums.iter_mut().zip(&line[first..first + LANES]) {
                *sum += weight * value;
            }
        }
        out[first..first + LANES].copy_from_slice(&sums);
    }
    for at in whole..out.len() {
        out[at] = weights.iter().zip(lines).fold(0.0, |sum, (weight, line)| sum + weight * line[at]);
    }
}

fn mirrored(index: i64, size: usize) -> usize {
    let period = 2 * size as i64;
    let folded = index.rem_euclid(period);
    (if folded < size as i64 { folded } else { period - 1 - folded }) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::to_u8;
    use crate::image::{Alpha, ColorSpace};

    fn pseudo_random(width: u32, height: u32, channels: u8, seed: u32) -> Raster {
        let count = width * height * u32::from(channels);
        let bytes: Vec<u8> = (0..count)
            .map(|i| ((i + seed).wrapping_mul(2_654_435_761).rotate_left(13) >> 24) as u8)
            .collect();
        Raster::from_u8(width, height, channels, ColorSpace::Srgb, &bytes).unwrap()
    }

    /// The definition, window by window, without separation or shared sums.
    fn ssim_by_definition(a: &Raster, b: &Raster) -> f64 {
        let (width, height) = (a.size().width as i64, a.size().height as i64);
        let channels = a.info().counted_channels();
        let value = |r: &Raster, x: i64, y: i64, c: usize| f64::from(to_u8(r.texel(x as u32, y as u32)[c]));
        let is_hidden = |x: i64, y: i64| a.info().hides_colors() && value(a, x, y, 3) == 0.0;
        let shown = |x: i64, y: i64, c: usize| value(if c < 3 && is_hidden(x, y) { a } else { b }, x, y, c);
        let mut total = 0.0;
        let mut places = 0.0;
        for &c in channels {
            for y in 5..height - 5 {
                for x in 5..width - 5 {
                    let (mut w, mut ma, mut mb) = (0.0, 0.0, 0.0);
                    let window = |dx: i64, dy: i64| (-((dx * dx + dy * dy) as f64) / 4.5).exp();
                    for (dy, dx) in (-5..=5).flat_map(|dy| (-5..=5).map(move |dx| (dy, dx))) {
                        w += window(dx, dy);
                        ma += window(dx, dy) * value(a, x + dx, y + dy, c);
                        mb += window(dx, dy) * shown(x + dx, y + dy, c);
                    }
                    (ma, mb) = (ma / w, mb / w);
                    let (mut va, mut vb, mut cov) = (0.0, 0.0, 0.0);
                    for (dy, dx) in (-5..=5).flat_map(|dy| (-5..=5).map(move |dx| (dy, dx))) {
                        let (p, q) = (value(a, x + dx, y + dy, c) - ma, shown(x + dx, y + dy, c) - mb);
                        va += window(dx, dy) * p * p / w;
                        vb += window(dx, dy) * q * q / w;
                        cov += window(dx, dy) * p * q / w;
                    }
                    total += (2.0 * ma * mb + 6.5025) * (2.0 * cov + 58.5225)
                        / ((ma * ma + mb * mb + 6.5025) * (va + vb + 58.5225));
                    places += 1.0;
                }
            }
        }
        total / places
    }

    #[test]
    fn ssim_equals_its_definition() {
        // Several bands of rows, the last one short, and a band beside colours.
        let (band, straight) = (Alpha::Band, Alpha::Straight);
        for (width, height, channels, alpha) in
            [(19, 14, 3, band), (17, 77, 1, band), (33, 45, 4, band), (33, 45, 4, straight)]
        {
            let a = pseudo_random(width, height, channels, 1).tagged(ColorSpace::Srgb, alpha);
            let values = a.to_bytes().into_iter().enumerate();
            let bytes: Vec<u8> = values.map(|(i, value)| value.saturating_add((i % 23) as u8)).collect();
            let b = Raster::from_u8(width, height, channels, ColorSpace::Srgb, &bytes).unwrap();
            let (fast, slow) = (ssim(&a, &b), ssim_by_definition(&a, &b));
            assert!((fast - slow).abs() < 1e-4, "{fast} {slow}");
            assert!((ssim(&a, &a) - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn tiny_images_have_an_ssim() {
        let (a, b) = (pseudo_random(3, 5, 1, 1), pseudo_random(3, 5, 1, 9));
        let value = ssim(&a, &b);
        assert!(value.is_finite() && value < 1.0);
        assert!((ssim(&a, &a) - 1.0).abs() < 1e-9);
    }
}
