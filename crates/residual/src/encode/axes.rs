//! Axes for residuals: their principal components, the smallest rotation that leads to them.

use glam::{Mat3, Vec3};
use rayon::prelude::*;
use texfold_core::principal_axes;

use super::transform::{CELL_STEPS, ResidualBlock};
use crate::axes::Axes;
use crate::decode::BLOCK_CELLS;
use crate::decode::{texfold_residual_axes, texfold_residual_turned};
use crate::rates::SUBBAND_COUNTS;

/// Most sweeps of the Jacobi method; 3x3 matrices converge in 5.
const MAX_SWEEPS: u32 = 10;
/// Share of off-diagonal energy at which it has converged.
const OFF_DIAGONAL: f64 = 1e-24;
/// Share of the bits that axes must save: what they save by less is within what estimates are off.
const LEAST_GAIN: f64 = 0.02;
/// Most blocks that bits are estimated of.
const SAMPLE: usize = 1024;
/// Squared errors a coefficient, in 8-bit units, for which bits are estimated: 42, 36, 30 and 24 dB.
const ERRORS: [f64; 4] = [4.0, 16.0, 64.0, 256.0];
/// Places of luma and of both axes of chroma of each coefficient of a cell.
const TRIPLES: [[usize; 3]; CELL_STEPS / 3] = {
    let mut triples = [[0; 3]; CELL_STEPS / 3];
    let mut n = 0;
    while n < 4 {
        triples[n] = [n, 4 + 2 * n, 5 + 2 * n];
        n += 1;
    }
    while n < CELL_STEPS / 3 {
        let (quad, own) = ((n - 4) / 3, (n - 4) % 3);
        let first = 12 + 9 * quad;
        triples[n] = [first + own, first + 3 + 2 * own, first + 4 + 2 * own];
        n += 1;
    }
    triples
};

/// The principal components of the counted blocks' residuals, as the smallest rotation that leads to them; luma and chroma where
/// bits are estimated to be less than [`LEAST_GAIN`] fewer.
pub(crate) fn suited(blocks: &[ResidualBlock], counted: &[bool]) -> Axes {
    let counted: Vec<&ResidualBlock> =
        blocks.iter().zip(counted).filter(|(_, counted)| **counted).map(|(block, _)| block).collect();
    let axes = learned(&counted);
    let stride = counted.len().div_ceil(SAMPLE).max(1);
    let mut sample: Vec<ResidualBlock> = counted.into_iter().step_by(stride).cloned().collect();
    let before = bits(&sample);
    turn(&mut sample, axes);
    if bits(&sample) < (1.0 - LEAST_GAIN) * before { axes } else { Axes::default() }
}

/// The axes in which blocks have most of their energy in the first, least in the last. Blocks count by the root of their energy: so
/// blocks of little energy, of which there are many, have a say beside those at edges, which get most of the bits.
fn learned(blocks: &[&ResidualBlock]) -> Axes {
    let mut products = vec![0.0f64; 9];
    for block in blocks {
        let energy: f32 = block.energy.iter().sum();
        let weight = 1.0 / f64::from(energy).max(1.0).sqrt();
        for cell in &block.cells {
            for places in TRIPLES {
                let parts = places.map(|place| f64::from(cell[place]));
                for (sums, part) in products.chunks_exact_mut(3).zip(parts) {
                    sums.iter_mut().zip(parts).for_each(|(sum, other)| *sum += weight * part * other);
                }
            }
        }
    }
    let vectors = principal_axes(&mut products, 3, MAX_SWEEPS, OFF_DIAGONAL);
    let vector = |at: usize| Vec3::new(vectors[at] as f32, vectors[at + 1] as f32, vectors[at + 2] as f32);
    smallest_rotation(vector(0), vector(3), vector(6)).and_then(Axes::nearest).unwrap_or_default()
}

/// Bits that blocks would take for each of [`ERRORS`], together: of a subband half the binary logarithm of its energy over the error, by
/// coefficient.
fn bits(blocks: &[ResidualBlock]) -> f64 {
    let of_subband = |energy: f32, count: u32, error: f64| {
        let count = f64::from(BLOCK_CELLS * count);
        0.5 * count * (f64::from(energy) / (count * error)).log2().max(0.0)
    };
    let of_block = |block: &ResidualBlock| -> f64 {
        let subbands = || block.energy.iter().zip(SUBBAND_COUNTS);
        ERRORS
            .iter()
            .flat_map(|&error| subbands().map(move |(&energy, count)| of_subband(energy, count, error)))
            .sum()
    };
    blocks.iter().map(of_block).sum()
}

/// The smallest rotation from unit vectors to these, flipped and the last two swapped as one likes: axis times the tangent of
/// half the angle.
fn smallest_rotation(first: Vec3, second: Vec3, third: Vec3) -> Option<Vec3> {
    let mut best: Option<Mat3> = None;
    for (second, third) in [(second, third), (third, second)] {
        for signs in 0..4 {
            let sign = |bit: u32| if signs >> bit & 1 == 0 { 1.0 } else { -1.0 };
            let (first, second) = (first * sign(0), second * sign(1));
            let third = third * first.cross(second).dot(third).signum();
            let matrix = Mat3::from_cols(first, second, third);
            if best.is_none_or(|best| trace(&matrix) > trace(&best)) {
                best = Some(matrix);
            }
        }
    }
    best.map(|m| {
        let twist = Vec3::new(m.y_axis.z - m.z_axis.y, m.z_axis.x - m.x_axis.z, m.x_axis.y - m.y_axis.x);
        twist / (1.0 + trace(&m))
    })
}

fn trace(matrix: &Mat3) -> f32 {
    matrix.x_axis.x + matrix.y_axis.y + matrix.z_axis.z
}

/// Blocks as coefficients of such axes.
pub(crate) fn turn(blocks: &mut [ResidualBlock], axes: Axes) {
    if axes == Axes::default() {
        return;
    }
    let back = -texfold_residual_axes(axes.packed());
    blocks.par_iter_mut().for_each(|block| {
        for cell in &mut block.cells {
            for places in TRIPLES {
                let parts = Vec3::from_array(places.map(|place| cell[place]));
                let turned = texfold_residual_turned(parts, back).to_array();
                places.into_iter().zip(turned).for_each(|(place, part)| cell[place] = part);
            }
        }
        block.measure();
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::SUBBANDS;

    fn block(parts: impl Fn(usize) -> Vec3) -> ResidualBlock {
        let mut block =
            ResidualBlock { cells: [[0.0; CELL_STEPS]; BLOCK_CELLS as usize], energy: [0.0; SUBBANDS] };
        for (number, cell) in block.cells.iter_mut().enumerate() {
            for (at, places) in TRIPLES.into_iter().enumerate() {
                let parts = parts(16 * number + at).to_array();
                places.into_iter().zip(parts).for_each(|(place, part)| cell[place] = part);
            }
        }
        block.measure();
        block
    }

    #[test]
    fn every_coefficient_has_its_place() {
        let mut places: Vec<usize> = TRIPLES.into_iter().flatten().collect();
        places.sort_unstable();
        assert_eq!(places, (0..CELL_STEPS).collect::<Vec<_>>());
    }

    #[test]
    fn energy_goes_where_the_first_axes_are() {
        for direction in [Vec3::new(0.2, 1.0, -0.5), Vec3::new(0.0, 0.0, 1.0), Vec3::new(1.0, 0.3, 0.0)] {
            let direction = direction.normalize();
            let other = direction.any_orthonormal_vector();
            let value = |n: usize| ((n * 37 % 64) as f32 - 31.5, (n * 23 % 64) as f32 / 8.0 - 4.0);
            let mut blocks = vec![block(|n| direction * value(n).0 + other * value(n).1)];
            let total: f32 = blocks[0].energy.iter().sum();
            let axes = suited(&blocks, &[true]);
            turn(&mut blocks, axes);
            let luma: f32 = blocks[0].energy[..4].iter().sum();
            assert!((blocks[0].energy.iter().sum::<f32>() / total - 1.0).abs() < 1e-4);
            assert!(luma > 0.97 * total, "{luma} of {total} along {direction}");
        }
        // What is not counted says nothing; of nothing there are no axes.
        let blocks = vec![block(|n| Vec3::Y * n as f32)];
        assert_eq!(suited(&blocks, &[false]), Axes::default());
        // Luma stays where it is, and chroma without reason, too.
        let blocks = vec![block(|n| Vec3::new(90.0, 9.0, 9.0) * [1.0, -1.0][n % 2] + Vec3::Y * n as f32)];
        assert_eq!(suited(&blocks, &[true]), Axes::default());
    }
}
