//! Colours that alpha hides, replaced by smooth ones that cost next to no bits.
//!
//! Source: push-pull interpolation (Gortler and others, "The lumigraph", 1996, section 3.4.2): visible texels are averaged
//! down to smaller and smaller images, and hidden ones are filled from the smaller image, by bilinear interpolation.

use texfold_core::ImageSize;

/// Sums of visible values, channel by channel, and how many there are.
struct Level {
    width: usize,
    height: usize,
    /// Values, texel by texel; means where the weight is not 0.
    values: Vec<f32>,
    weights: Vec<f32>,
}

/// Replaces all channels but `alpha`, of samples of `channels` channels, in texels that do not count.
pub(super) fn fill(samples: &mut [u16], size: ImageSize, (channels, alpha): (usize, usize), counts: &[bool]) {
    let count = counts.iter().filter(|&&counts| counts).count();
    if count == 0 || count == counts.len() {
        return;
    }
    let first = Level {
        width: size.width as usize,
        height: size.height as usize,
        values: samples.iter().map(|&sample| f32::from(sample)).collect(),
        weights: counts.iter().map(|&counts| f32::from(u8::from(counts))).collect(),
    };
    let filled = filled(first, channels);
    let texels = samples.chunks_exact_mut(channels).zip(filled.chunks_exact(channels));
    for ((texel, filled), _) in texels.zip(counts).filter(|(_, counts)| !**counts) {
        for channel in (0..channels).filter(|&channel| channel != alpha) {
            texel[channel] = filled[channel].round() as u16;
        }
    }
}

/// The values of a level, with those of no weight filled.
fn filled(mut level: Level, channels: usize) -> Vec<f32> {
    if level.weights.iter().all(|&weight| weight > 0.0) {
        return level.values;
    }
    let smaller = filled_size(&level);
    let coarse = filled(halved(&level, channels), channels);
    for y in 0..level.height {
        for x in 0..level.width {
            let at = y * level.width + x;
            if level.weights[at] > 0.0 {
                continue;
            }
            for channel in 0..channels {
                // The four nearest of the smaller image, by 9, 3, 3 and 1 sixteenths.
                let near = |at: usize, all: usize| {
                    let other = if at.is_multiple_of(2) { (at / 2).saturating_sub(1) } else { at / 2 + 1 };
                    [(at / 2, 0.75), (other.min(all - 1), 0.25)]
                };
                let mut value = 0.0;
                for (row, share) in near(y, smaller.1) {
                    for (column, part) in near(x, smaller.0) {
                        value += share * part * coarse[(row * smaller.0 + column) * channels + channel];
                    }
                }
                level.values[at * channels + channel] = value;
            }
        }
    }
    level.values
}

fn filled_size(level: &Level) -> (usize, usize) {
    (level.width.div_ceil(2), level.height.div_ceil(2))
}

/// The means of what is visible in 2x2 texels.
fn halved(level: &Level, channels: usize) -> Level {
    let (width, height) = filled_size(level);
    let mut half = Level {
        width,
        height,
        values: vec![0.0; width * height * channels],
        weights: vec![0.0; width * height],
    };
    for at in (0..level.weights.len()).filter(|&at| level.weights[at] > 0.0) {
        let to = at / level.width / 2 * width + at % level.width / 2;
        half.weights[to] += 1.0;
        for channel in 0..channels {
            half.values[to * channels + channel] += level.values[at * channels + channel];
        }
    }
    for (values, weight) in half.values.chunks_exact_mut(channels).zip(&half.weights) {
        values.iter_mut().for_each(|value| *value /= weight.max(1.0));
    }
    half
}

#[cfg(test)]
mod tests {
    use texfold_core::ImageSize;
    use texfold_core::rng::Rng;

    use crate::encode::DctSource;

    #[test]
    fn hidden_colours_become_smooth_and_visible_ones_stay() {
        let mut rng = Rng::new(2);
        let size = ImageSize { width: 37, height: 20 };
        let texel = |at: u32, noise: u16| {
            let inside = at % 37 > 20;
            [
                if inside { 100 } else { noise },
                if inside { 200 } else { noise },
                7,
                if inside { 255 } else { 0 },
            ]
        };
        let samples: Vec<u16> = (0..37 * 20).flat_map(|at| texel(at, rng.below(256) as u16)).collect();
        let source = DctSource::new(size, &[3, 1], 8, samples).unwrap();
        let filled = source.with_free_colours(3);
        assert!(filled.samples().chunks_exact(4).all(|texel| texel[..3] == [100, 200, 7]));
        let alpha = |at: usize| if at % 37 > 20 { 255 } else { 0 };
        assert!((0..37 * 20).all(|at| filled.samples()[4 * at + 3] == alpha(at)));
    }
}
