//! SSIM, from rows of pixels around a few others at a time.

use rayon::prelude::*;

use super::counted_channels;
use crate::image::{Raster, to_u8};

const SIGMA: f64 = 1.5;
const RADIUS: usize = 5;
const TAPS: usize = 2 * RADIUS + 1;
const C1: f64 = (0.01 * 255.0) * (0.01 * 255.0);
const C2: f64 = (0.03 * 255.0) * (0.03 * 255.0);
/// Rows that one thread compares; it holds the rows around them, too.
const BAND_ROWS: usize = 32;
/// What is averaged in each window: both images, their squares, and their product.
const SIGNALS: usize = 5;

/// SSIM of two images of the same size, mean over the colour channels and a band; 1 where they are equal.
#[must_use]
pub fn ssim(source: &Raster, decoded: &Raster) -> f64 {
    let channels = counted_channels(source, decoded);
    let size = source.size();
    let (width, height) = (size.width as usize, size.height as usize);
    let fits = width > 2 * RADIUS && height > 2 * RADIUS;
    let margin = if fits { RADIUS } else { 0 };
    let windows = Windows { width, height, margin, weights: weights() };
    let tops = (margin..height - margin).step_by(BAND_ROWS);
    let bands: Vec<(usize, usize)> =
        channels.iter().flat_map(|&channel| tops.clone().map(move |top| (channel, top))).collect();
    let sums: Vec<f64> =
        bands.into_par_iter().map(|(channel, top)| windows.band((source, decoded), channel, top)).collect();
    let places = (height - 2 * margin) * (width - 2 * margin) * channels.len();
    sums.iter().sum::<f64>() / places as f64
}

/// The Gaussian along one axis.
fn weights() -> [f64; TAPS] {
    let raw: [f64; TAPS] = std::array::from_fn(|tap| {
        let away = tap as f64 - RADIUS as f64;
        (-(away * away) / (2.0 * SIGMA * SIGMA)).exp()
    });
    let total: f64 = raw.iter().sum();
    raw.map(|weight| weight / total)
}

/// Windows around the places of an image that are `margin` away from its edges; mirrored at the edges (…b a | a b c…).
struct Windows {
    width: usize,
    height: usize,
    margin: usize,
    weights: [f64; TAPS],
}

impl Windows {
    /// The sum of the SSIM of one channel over the rows of a band.
    fn band(&self, (a, b): (&Raster, &Raster), channel: usize, top: usize) -> f64 {
        let rows = BAND_ROWS.min(self.height - self.margin - top);
        let mut blurred = Blurred::new(self.width);
        for row in 0..rows + 2 * RADIUS {
            let y = mirrored(top as i64 + row as i64 - RADIUS as i64, self.height);
            blurred.push(&self.weights, (a, b), channel, y);
        }
        let mut sum = 0.0;
        let mut means: [Vec<f64>; SIGNALS] = std::array::from_fn(|_| vec![0.0; self.width]);
        for row in 0..rows {
            for (signal, means) in means.iter_mut().enumerate() {
                let lines = (row..).map(|line| blurred.line(line, signal));
                convolve(&self.weights, lines, means);
                // As single precision holds them.
                means.iter_mut().for_each(|mean| *mean = f64::from(*mean as f32));
            }
            let [mean_a, mean_b, aa, bb, ab] = &means;
            for x in self.margin..self.width - self.margin {
                let (ma, mb) = (mean_a[x], mean_b[x]);
                let (va, vb) = (aa[x] - ma * ma, bb[x] - mb * mb);
                let covariance = ab[x] - ma * mb;
                sum += (2.0 * ma * mb + C1) * (2.0 * covariance + C2)
                    / ((ma * ma + mb * mb + C1) * (va + vb + C2));
            }
        }
        sum
    }
}

/// Rows of signals that are averaged along x, each signal of a row behind the other.
struct Blurred {
    width: usize,
    values: Vec<f64>,
    /// A row with what lies beyond its ends.
    padded: [Vec<f64>; SIGNALS],
}

impl Blurred {
    fn new(width: usize) -> Blurred {
        let padded = std::array::from_fn(|_| vec![0.0; width + 2 * RADIUS]);
        Blurred { width, values: Vec::new(), padded }
    }

    fn line(&self, row: usize, signal: usize) -> &[f64] {
        &self.values[(row * SIGNALS + signal) * self.width..][..self.width]
    }

    fn push(&mut self, weights: &[f64; TAPS], (a, b): (&Raster, &Raster), channel: usize, y: usize) {
        let gain = a.peak().recip();
        let (a, b) = (Line::of(a, channel, y, gain), Line::of(b, channel, y, gain));
        for at in 0..self.width + 2 * RADIUS {
            let x = match at.checked_sub(RADIUS) {
                Some(x) if x < self.width => x,
                _ => mirrored(at as i64 - RADIUS as i64, self.width),
            };
            let (a, b) = (a.byte(x), b.byte(x));
            // Products of bytes are exact.
            for (signal, value) in self.padded.iter_mut().zip([a, b, a * a, b * b, a * b]) {
                signal[at] = f64::from(value);
            }
        }
        for signal in &self.padded {
            let start = self.values.len();
            self.values.resize(start + self.width, 0.0);
            let out = &mut self.values[start..];
            convolve(weights, (0..TAPS).map(|tap| &signal[tap..]), out);
            out.iter_mut().for_each(|value| *value = f64::from(*value as f32));
        }
    }
}

/// The sum of lines, each times its weight.
fn convolve<'l>(weights: &[f64; TAPS], lines: impl Iterator<Item = &'l [f64]>, out: &mut [f64]) {
    out.fill(0.0);
    for (weight, line) in weights.iter().zip(lines) {
        for (out, value) in out.iter_mut().zip(line) {
            *out += weight * value;
        }
    }
}

fn mirrored(index: i64, size: usize) -> usize {
    let period = 2 * size as i64;
    let folded = index.rem_euclid(period);
    (if folded < size as i64 { folded } else { period - 1 - folded }) as usize
}

/// A row of a raster, of which one channel of texels is looked at.
struct Line<'r> {
    raster: &'r Raster,
    row: u32,
    /// The channel's place in a texel; `None` for alpha that is not there.
    place: Option<usize>,
    /// What values are multiplied with.
    gain: f32,
}

impl<'r> Line<'r> {
    fn of(raster: &'r Raster, channel: usize, y: usize, gain: f32) -> Line<'r> {
        let channels = usize::from(raster.info().channels);
        let place = match (channels, channel) {
            (2, 3) => Some(1),
            (1 | 2, 0..=2) => Some(0),
            _ => Some(channel).filter(|&channel| channel < channels),
        };
        Line { raster, row: y as u32, place, gain }
    }

    fn byte(&self, x: usize) -> f32 {
        let byte = |place| f32::from(to_u8(self.gain * self.raster.value(x as u32, self.row, place)));
        self.place.map_or(255.0, byte)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
                        mb += window(dx, dy) * value(b, x + dx, y + dy, c);
                    }
                    (ma, mb) = (ma / w, mb / w);
                    let (mut va, mut vb, mut cov) = (0.0, 0.0, 0.0);
                    for (dy, dx) in (-5..=5).flat_map(|dy| (-5..=5).map(move |dx| (dy, dx))) {
                        let (p, q) = (value(a, x + dx, y + dy, c) - ma, value(b, x + dx, y + dy, c) - mb);
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
        for (width, height, channels) in [(19, 14, 3), (17, 77, 1), (33, 45, 4)] {
            let a = pseudo_random(width, height, channels, 1).tagged(ColorSpace::Srgb, Alpha::Band);
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
