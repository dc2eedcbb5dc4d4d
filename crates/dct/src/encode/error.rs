//! Errors of a texture against its source, over all channels together, in 8-bit units.

use texfold_core::metric::SquaredError;
use texfold_core::{Rect, parallel};

use super::source::DctSource;
use crate::decode::DctTexture;

/// Squared errors of the texels of a row of 4x4 blocks, a sum for each block with its number of samples.
fn block_errors(source: &DctSource, texture: &DctTexture) -> Vec<(f64, u32)> {
    let (width, height) = (source.size.width as usize, source.size.height as usize);
    let channels = source.channels();
    let mut decoded = vec![0u16; source.samples.len()];
    let rect = Rect { image: 0, level: 0, x: 0, y: 0, width: source.size.width, height: source.size.height };
    // The texture has the source's size.
    if texture.decode(rect, &mut decoded).is_err() {
        return Vec::new();
    }
    let rows = parallel::map(height.div_ceil(4), |row| {
        let mut sums = vec![(0.0, 0u32); width.div_ceil(4)];
        for y in 4 * row..(4 * row + 4).min(height) {
            let line = y * width * channels..(y + 1) * width * channels;
            let pairs = source.samples[line.clone()].iter().zip(&decoded[line]);
            for (at, (&one, &other)) in pairs.enumerate() {
                let difference = f64::from(one.abs_diff(other));
                let sum = &mut sums[at / channels / 4];
                *sum = (sum.0 + difference * difference, sum.1 + 1);
            }
        }
        sums
    });
    rows.concat()
}

fn unit(source: &DctSource) -> f64 {
    if source.depth > 8 { 257.0 } else { 1.0 }
}

/// PSNR in dB.
pub(super) fn psnr(source: &DctSource, texture: &DctTexture) -> f64 {
    let sum: f64 = block_errors(source, texture).iter().map(|(sum, _)| sum).sum();
    SquaredError { sum: sum / (unit(source) * unit(source)), count: source.samples.len() as u64 }.psnr()
}

/// RMS error of the worst block of 4x4 texels.
pub(super) fn worst_block_rms(source: &DctSource, texture: &DctTexture) -> f64 {
    let means = block_errors(source, texture).into_iter().map(|(sum, count)| sum / f64::from(count.max(1)));
    means.fold(0.0, f64::max).sqrt() / unit(source)
}
