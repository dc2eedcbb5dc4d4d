//! Residuals block by block as coefficients: the forward transform of [`crate::decode`].

use rayon::prelude::*;
use texfold_core::Texel;
use texfold_core::image::Raster;

use crate::decode::{BLOCK_CELLS, SUBBANDS};
use crate::plane::{BLOCK_SIDE, blocks_of};

/// Coded coefficients of a cell: in the order of their bits.
pub(crate) const CELL_STEPS: usize = 48;

/// Subband of each of them.
pub(crate) const SUBBAND_OF: [u8; CELL_STEPS] = {
    let mut subbands = [6; CELL_STEPS];
    let coarse = [0, 1, 1, 1, 4, 4, 5, 5, 5, 5, 5, 5];
    let mut step = 0;
    while step < coarse.len() {
        subbands[step] = coarse[step];
        step += 1;
    }
    while step < CELL_STEPS {
        (subbands[step], subbands[step + 1], subbands[step + 2]) = (2, 2, 3);
        step += QUAD_STEPS;
    }
    subbands
};

/// Coefficients of a quarter of a cell.
const QUAD_STEPS: usize = 9;

/// The residual of a block of 8x8 texels, in 8-bit units.
#[derive(Debug, Clone, PartialEq)]
pub struct ResidualBlock {
    /// Coefficients of each cell.
    pub(crate) cells: [[f32; CELL_STEPS]; BLOCK_CELLS as usize],
    /// Squares of those of a subband, summed.
    pub(crate) energy: [f32; SUBBANDS],
}

impl ResidualBlock {
    /// Sums the energy of each subband.
    pub(crate) fn measure(&mut self) {
        self.energy = [0.0; SUBBANDS];
        for (value, subband) in self.cells.as_flattened().iter().zip(SUBBAND_OF.into_iter().cycle()) {
            self.energy[usize::from(subband)] += value * value;
        }
    }
}

/// The residuals of all blocks of one level of an image: `source` less `base`, which has as many texels. Texels beyond the
/// edge repeat it.
pub(crate) fn blocks(source: &Raster, base: &[Texel]) -> Vec<ResidualBlock> {
    let size = source.size();
    let (columns, rows) = blocks_of(size);
    (0..columns * rows)
        .into_par_iter()
        .map(|index| {
            let (left, top) = (index % columns * BLOCK_SIDE, index / columns * BLOCK_SIDE);
            let at = |x: u32, y: u32| {
                let (x, y) = ((left + x).min(size.width - 1), (top + y).min(size.height - 1));
                let base = base[(y as usize) * size.width as usize + x as usize];
                chromatic(((source.texel(x, y) - base) * 255.0).to_array())
            };
            block(at)
        })
        .collect()
}

fn block(at: impl Fn(u32, u32) -> [f32; 3]) -> ResidualBlock {
    let mut block =
        ResidualBlock { cells: [[0.0; CELL_STEPS]; BLOCK_CELLS as usize], energy: [0.0; SUBBANDS] };
    for number in 0..BLOCK_CELLS {
        let (left, top) = (number % 2 * 4, number / 2 * 4);
        let texels: [[f32; 3]; 16] = std::array::from_fn(|n| at(left + n as u32 % 4, top + n as u32 / 4));
        let [luma, first, second] = [0, 1, 2].map(|axis| haar(texels.map(|texel| texel[axis])));
        let mut cell = [0.0; CELL_STEPS];
        cell[..4].copy_from_slice(&luma[..4]);
        for n in 0..4 {
            cell[4 + 2 * n] = first[n];
            cell[5 + 2 * n] = second[n];
        }
        for quad in 0..4 {
            let (from, to) = (4 + 3 * quad, 12 + QUAD_STEPS * quad);
            cell[to..to + 3].copy_from_slice(&luma[from..from + 3]);
            for n in 0..3 {
                cell[to + 3 + 2 * n] = first[from + n];
                cell[to + 4 + 2 * n] = second[from + n];
            }
        }
        block.cells[number as usize] = cell;
    }
    block.measure();
    block
}

/// Luma and two axes of chroma by an orthonormal matrix.
fn chromatic([red, green, blue, _]: [f32; 4]) -> [f32; 3] {
    [(red + green + blue) / 3f32.sqrt(), (red - blue) / 2f32.sqrt(), (red - 2.0 * green + blue) / 6f32.sqrt()]
}

/// Two-level orthonormal Haar transform of 4x4 texels: mean, across, down, diagonal; then these three of each 2x2.
fn haar(texels: [f32; 16]) -> [f32; 16] {
    let mut out = [0.0; 16];
    let mut means = [0.0; 4];
    for quad in 0..4 {
        let corner = quad / 2 * 8 + quad % 2 * 2;
        let four = [texels[corner], texels[corner + 1], texels[corner + 4], texels[corner + 5]];
        let [mean, details @ ..] = quarter(four);
        means[quad] = mean;
        out[4 + 3 * quad..7 + 3 * quad].copy_from_slice(&details);
    }
    out[..4].copy_from_slice(&quarter(means));
    out
}

/// Mean, across, down and diagonal of 2x2 values.
fn quarter([a, b, c, d]: [f32; 4]) -> [f32; 4] {
    [(a + b + c + d) / 2.0, (a - b + c - d) / 2.0, (a + b - c - d) / 2.0, (a - b - c + d) / 2.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_transform_keeps_squared_error() {
        let at = |x: u32, y: u32| {
            let value = |n: u32| ((x * 37 + y * 101 + n * 53) % 97) as f32 - 48.0;
            [value(0), value(1), value(2)]
        };
        let block = block(at);
        let total: f32 = (0..64).flat_map(|n| at(n % 8, n / 8)).map(|value| value * value).sum();
        let kept = block.energy.iter().sum::<f32>();
        assert!((kept / total - 1.0).abs() < 1e-5, "{kept} {total}");
    }
}
