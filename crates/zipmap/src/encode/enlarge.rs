//! What an image loses when a coarser one of its mip levels stands for it, upsampled.

use rayon::prelude::*;
use texfold_core::CancelCheck;

/// Texels a side of a block that errors are told of.
const BLOCK: u32 = 4;

/// How far an image is from its upsampled level, as far as it is visible: errors are weighted by alpha, and those of alpha
/// by how much the image differs from what lies under it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Change {
    /// Sum of squares over texels and channels, 8-bit units.
    pub(crate) squares: f64,
    /// RMS error of the worst 4x4 block, 8-bit units.
    pub(crate) worst_block: f64,
}

/// Two texels of a line and how much the second counts.
fn taps(count: u32, of: u32) -> Vec<(usize, usize, f32)> {
    let tap = |at: u32| {
        let place = (at as f32 + 0.5) / count as f32 * of as f32 - 0.5;
        let place = place.clamp(0.0, (of - 1) as f32);
        let low = place as u32;
        (low as usize, (low + 1).min(of - 1) as usize, place - low as f32)
    };
    (0..count).map(tap).collect()
}

/// The change from an image of `size` to `coarse`, one of its levels that has its sides halved `level` times. It differs
/// by
/// `contrast` from what lies under it, RMS in 8-bit units. Of no use once the job is cancelled.
pub(crate) fn change(
    source: &[[u8; 4]],
    size: (u32, u32),
    (coarse, level): (&[[u8; 4]], usize),
    contrast: f64,
    cancel: CancelCheck<'_>,
) -> Change {
    let contrast = contrast as f32 / 255.0;
    let of = ((size.0 >> level).max(1), (size.1 >> level).max(1));
    let (columns, rows) = (taps(size.0, of.0), taps(size.1, of.1));
    let row_of_blocks = |top: u32| {
        let mut blocks = vec![(0.0f64, 0u32); size.0.div_ceil(BLOCK) as usize];
        let bottom = if cancel.is_cancelled() { top } else { (top + BLOCK).min(size.1) };
        for y in top..bottom {
            let (low, high, down) = rows[y as usize];
            let lines = [low, high].map(|row| &coarse[row * of.0 as usize..(row + 1) * of.0 as usize]);
            let texels = &source[(y * size.0) as usize..((y + 1) * size.0) as usize];
            for (x, (texel, &(left, right, across))) in texels.iter().zip(&columns).enumerate() {
                let block = &mut blocks[x / BLOCK as usize];
                block.0 += f64::from(squares(texel, (lines, contrast), (left, right), (across, down)));
                block.1 += 3;
            }
        }
        let sum = blocks.iter().map(|block| block.0).sum::<f64>();
        let worst = blocks.iter().map(|&(sum, count)| sum / f64::from(count.max(1))).fold(0.0, f64::max);
        (sum, worst)
    };
    let found: Vec<(f64, f64)> =
        (0..size.1.div_ceil(BLOCK)).into_par_iter().map(|row| row_of_blocks(row * BLOCK)).collect();
    Change {
        squares: found.iter().map(|row| row.0).sum(),
        worst_block: found.iter().map(|row| row.1).fold(0.0, f64::max).sqrt(),
    }
}

/// Squared error of one texel against four blended, as far as it is seen.
fn squares(
    texel: &[u8; 4],
    ([upper, lower], contrast): ([&[[u8; 4]]; 2], f32),
    (left, right): (usize, usize),
    (across, down): (f32, f32),
) -> f32 {
    let of = |line: &[[u8; 4]], k: usize| {
        f32::from(line[left][k]) * (1.0 - across) + f32::from(line[right][k]) * across
    };
    let seen = f32::from(texel[3]) / 255.0;
    let step = |k: usize| f32::from(texel[k]) - of(upper, k) * (1.0 - down) - of(lower, k) * down;
    let of_alpha = contrast * step(3);
    seen * seen * (0..3).map(|k| step(k) * step(k)).sum::<f32>() + 3.0 * of_alpha * of_alpha
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_is_shown_by_half_of_its_texels_and_a_dot_is_not() {
        let ramp = |width: u32, step: u8| -> Vec<[u8; 4]> {
            (0..8 * width / 8 * 8).map(|i| [(i % width) as u8 * step + step / 2; 4].map(|v| v)).collect()
        };
        let opaque = |texels: Vec<[u8; 4]>| -> Vec<[u8; 4]> {
            texels.into_iter().map(|[r, g, b, _]| [r, g, b, 255]).collect()
        };
        let (fine, coarse) = (opaque(ramp(8, 10)), opaque(ramp(4, 20)));
        let found = change(&fine, (8, 8), (&coarse, 1), 0.0, CancelCheck::default());
        // Only the outermost columns differ, by a quarter of a coarse step.
        assert!((found.squares - 2.0 * 8.0 * 3.0 * 25.0).abs() < 1e-3, "{found:?}");
        assert_eq!(
            change(&fine, (8, 8), (&fine, 0), 99.0, CancelCheck::default()),
            Change { squares: 0.0, worst_block: 0.0 }
        );
        let mut dotted = fine.clone();
        dotted[9][0] += 60;
        assert!(
            (change(&dotted, (8, 8), (&fine, 0), 0.0, CancelCheck::default()).worst_block
                - (3600.0f64 / 48.0).sqrt())
            .abs()
                < 1e-6
        );
        // What is not seen does not count.
        dotted[9][3] = 0;
        assert_eq!(change(&dotted, (8, 8), (&fine, 0), 0.0, CancelCheck::default()).squares, 0.0);
        // But that it is hidden, where it looks otherwise than what lies under it.
        assert!(
            (change(&dotted, (8, 8), (&fine, 0), 10.0, CancelCheck::default()).squares - 300.0).abs() < 1e-3
        );
    }
}
