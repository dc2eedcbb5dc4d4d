//! Harmonic functions from their values on the border of a rectangle, by multigrid.
//!
//! An image whose gradients are those of a patch and whose border is that of its parent is the patch plus the harmonic
//! function of the border's difference (Pérez, Gangnet, Blake, "Poisson image editing", SIGGRAPH 2003, equation 4,
//! whose guidance field is a gradient here), so that the equation is Laplace's and its solution smooth. Full multigrid
//! with V-cycles of two damped Jacobi steps before and after (Briggs, Henson, McCormick, "A multigrid tutorial", 2000);
//! grids need not nest, so that any size will do. Four channels at a time. Cost: some 40 operations a texel and cycle,
//! 5 to 7 cycles.

use glam::Vec4;
use rayon::prelude::*;
use texfold_core::CancelCheck;

/// Damping of Jacobi's method that smooths best in two dimensions.
const DAMPING: f32 = 0.8;
/// Steps before and after a coarser grid.
const STEPS: usize = 2;
/// Steps on the coarsest grid, which has at most [`COARSEST`] nodes a side.
const LAST_STEPS: usize = 40;
/// As above.
const COARSEST: usize = 5;
/// Residual, as a share of that of no solution, at which cycles end.
const RESIDUAL: f32 = 1e-5;
/// Most cycles.
const CYCLES: usize = 12;
/// A cycle that leaves more than this share of the residual is the last: V-cycles of this kind leave a tenth, and
/// rounding of single precision, once it is reached, leaves all of it.
const LEAST_REDUCTION: f32 = 0.7;
/// Fine nodes that a coarse one is averaged from, on each axis: those nearer than one coarse distance, which is at most
/// two fine ones.
const AROUND: usize = 5;

/// Values at `width` x `height` nodes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Grid {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) values: Vec<Vec4>,
}

impl Grid {
    pub(crate) fn new(width: usize, height: usize) -> Grid {
        Grid { width, height, values: vec![Vec4::ZERO; width * height] }
    }

    fn is_border(&self, x: usize, y: usize) -> bool {
        x == 0 || y == 0 || x + 1 == self.width || y + 1 == self.height
    }
}

/// Distances between nodes, squared and inverted, on both axes.
#[derive(Debug, Clone, Copy)]
struct Spacing {
    x: f32,
    y: f32,
}

/// Where the nodes of one axis lie between those of a coarser one.
struct Axis {
    /// For each fine node the coarse one before it and the weight of the next.
    fine: Vec<(usize, f32)>,
    /// For each coarse node the first of the fine ones around it, and their weights, which sum to 1.
    coarse: Vec<(usize, [f32; AROUND])>,
    /// How much farther coarse nodes are apart.
    ratio: f32,
}

impl Axis {
    fn new(fine: usize, coarse: usize) -> Axis {
        let ratio = (fine - 1) as f32 / (coarse - 1) as f32;
        let place = |node: usize| {
            let at = node as f32 / ratio;
            let before = (at as usize).min(coarse - 2);
            (before, at - before as f32)
        };
        let around = |node: usize| {
            let at = node as f32 * ratio;
            let first = (at.round() as usize).saturating_sub(2).min(fine.saturating_sub(AROUND));
            let mut weights = [0.0; AROUND];
            for (k, weight) in weights.iter_mut().enumerate().filter(|(k, _)| first + k < fine) {
                *weight = (1.0 - ((first + k) as f32 - at).abs() / ratio).max(0.0);
            }
            let total: f32 = weights.iter().sum();
            (first, weights.map(|weight| weight / total.max(1e-6)))
        };
        Axis { fine: (0..fine).map(place).collect(), coarse: (0..coarse).map(around).collect(), ratio }
    }
}

fn halved(side: usize) -> usize {
    if side > COARSEST { side.div_ceil(2) } else { side }
}

/// Fills the inside of a grid with the harmonic function of its border; returns the residual as a share of that of an
/// inside of 0. Of no use once the job is cancelled.
pub(crate) fn harmonic(grid: &mut Grid, cancel: CancelCheck<'_>) -> f32 {
    if grid.width < 3 || grid.height < 3 {
        return 0.0;
    }
    let spacing = Spacing { x: 1.0, y: 1.0 };
    let right = Grid::new(grid.width, grid.height);
    let mut empty = grid.clone();
    inside(&mut empty, |_, _| Vec4::ZERO);
    let start = length(&residual(&empty, &right, spacing));
    if start == 0.0 {
        return 0.0;
    }
    drop(empty);
    full(grid, spacing, cancel);
    let mut share = length(&residual(grid, &right, spacing)) / start;
    for _ in 0..CYCLES {
        if share <= RESIDUAL || cancel.is_cancelled() {
            break;
        }
        cycle(grid, &right, spacing, cancel);
        let now = length(&residual(grid, &right, spacing)) / start;
        if now > LEAST_REDUCTION * share {
            share = now;
            break;
        }
        share = now;
    }
    share
}

/// A first solution from that of the coarser grid.
fn full(grid: &mut Grid, spacing: Spacing, cancel: CancelCheck<'_>) {
    if cancel.is_cancelled() {
        return;
    }
    let (width, height) = (halved(grid.width), halved(grid.height));
    let right = Grid::new(grid.width, grid.height);
    if (width, height) == (grid.width, grid.height) {
        inside(grid, |_, _| Vec4::ZERO);
        smooth(grid, &right, spacing, LAST_STEPS, cancel);
        return;
    }
    let (x, y) = (Axis::new(grid.width, width), Axis::new(grid.height, height));
    // The border alone counts: its nodes are averaged along the border.
    let mut coarse = Grid::new(width, height);
    for (at, value) in coarse.values.iter_mut().enumerate() {
        let (cx, cy) = (at % width, at / width);
        let edge = |c: usize, last: usize, fine: usize| match c {
            0 => Some(0),
            c if c == last => Some(fine - 1),
            _ => None,
        };
        let (ex, ey) = (edge(cx, width - 1, grid.width), edge(cy, height - 1, grid.height));
        let node = |x: usize, y: usize| grid.values[y * grid.width + x];
        let along = |(first, weights): &(usize, [f32; AROUND]), node: &dyn Fn(usize) -> Vec4| {
            (0..AROUND).filter(|&k| weights[k] > 0.0).map(|k| node(first + k) * weights[k]).sum::<Vec4>()
        };
        *value = match (ex, ey) {
            (Some(ex), Some(ey)) => node(ex, ey),
            (Some(ex), None) => along(&y.coarse[cy], &|row| node(ex, row)),
            (None, Some(ey)) => along(&x.coarse[cx], &|column| node(column, ey)),
            (None, None) => Vec4::ZERO,
        };
    }
    let coarser = Spacing { x: spacing.x / (x.ratio * x.ratio), y: spacing.y / (y.ratio * y.ratio) };
    full(&mut coarse, coarser, cancel);
    let from = |at_x: usize, at_y: usize| between(&coarse, x.fine[at_x], y.fine[at_y]);
    inside(grid, from);
    cycle(grid, &right, spacing, cancel);
}

/// One V-cycle for `laplacian(grid) = right`.
fn cycle(grid: &mut Grid, right: &Grid, spacing: Spacing, cancel: CancelCheck<'_>) {
    if cancel.is_cancelled() {
        return;
    }
    let (width, height) = (halved(grid.width), halved(grid.height));
    if (width, height) == (grid.width, grid.height) {
        smooth(grid, right, spacing, LAST_STEPS, cancel);
        return;
    }
    smooth(grid, right, spacing, STEPS, cancel);
    let left = residual(grid, right, spacing);
    let (x, y) = (Axis::new(grid.width, width), Axis::new(grid.height, height));
    let mut coarse_right = Grid::new(width, height);
    inside(&mut coarse_right, |cx, cy| {
        let ((first_x, across), (first_y, down)) = (&x.coarse[cx], &y.coarse[cy]);
        let row = |k: usize| {
            let start = (first_y + k) * left.width + first_x;
            (0..AROUND).filter(|&k| across[k] > 0.0).map(|k| left.values[start + k] * across[k]).sum::<Vec4>()
        };
        (0..AROUND).filter(|&k| down[k] > 0.0).map(|k| row(k) * down[k]).sum()
    });
    let coarser = Spacing { x: spacing.x / (x.ratio * x.ratio), y: spacing.y / (y.ratio * y.ratio) };
    let mut change = Grid::new(width, height);
    cycle(&mut change, &coarse_right, coarser, cancel);
    let old = &grid.values;
    let mut next = Grid { values: old.clone(), ..*grid };
    inside(&mut next, |at_x, at_y| {
        old[at_y * right.width + at_x] + between(&change, x.fine[at_x], y.fine[at_y])
    });
    *grid = next;
    smooth(grid, right, spacing, STEPS, cancel);
}

fn between(grid: &Grid, (x, part_x): (usize, f32), (y, part_y): (usize, f32)) -> Vec4 {
    let row = |y: usize| {
        let (a, b) = (grid.values[y * grid.width + x], grid.values[y * grid.width + x + 1]);
        a + (b - a) * part_x
    };
    let (upper, lower) = (row(y), row(y + 1));
    upper + (lower - upper) * part_y
}

/// Sets all nodes but those of the border.
fn inside(grid: &mut Grid, value: impl Fn(usize, usize) -> Vec4 + Sync) {
    let (width, height) = (grid.width, grid.height);
    grid.values.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        if y > 0 && y + 1 < height {
            for x in 1..width - 1 {
                row[x] = value(x, y);
            }
        }
    });
}

/// Damped steps of Jacobi's method.
fn smooth(grid: &mut Grid, right: &Grid, spacing: Spacing, steps: usize, cancel: CancelCheck<'_>) {
    let centre = 1.0 / (2.0 * (spacing.x + spacing.y));
    for _ in (0..steps).take_while(|_| !cancel.is_cancelled()) {
        let old = &grid.values;
        let width = grid.width;
        let mut next = Grid { values: old.clone(), ..*grid };
        inside(&mut next, |x, y| {
            let at = y * width + x;
            let around =
                (old[at - 1] + old[at + 1]) * spacing.x + (old[at - width] + old[at + width]) * spacing.y;
            old[at] + ((around - right.values[at]) * centre - old[at]) * DAMPING
        });
        *grid = next;
    }
}

/// The residual of the equation at each node; 0 on the border.
fn residual(grid: &Grid, right: &Grid, spacing: Spacing) -> Grid {
    let mut left = Grid::new(grid.width, grid.height);
    let (width, values) = (grid.width, &grid.values);
    inside(&mut left, |x, y| {
        let at = y * width + x;
        let across = (values[at - 1] + values[at + 1] - 2.0 * values[at]) * spacing.x;
        let down = (values[at - width] + values[at + width] - 2.0 * values[at]) * spacing.y;
        right.values[at] - across - down
    });
    left
}

fn length(grid: &Grid) -> f32 {
    let row = |row: &[Vec4]| row.iter().map(|value| f64::from(value.length_squared())).sum::<f64>();
    let rows: Vec<f64> = grid.values.par_chunks(grid.width).map(row).collect();
    rows.into_iter().sum::<f64>().sqrt() as f32
}

/// Sets the border from a function of column and row.
pub(crate) fn with_border(width: usize, height: usize, value: impl Fn(usize, usize) -> Vec4) -> Grid {
    let mut grid = Grid::new(width, height);
    for at in 0..width * height {
        let (x, y) = (at % width, at / width);
        if grid.is_border(x, y) {
            grid.values[at] = value(x, y);
        }
    }
    grid
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_harmonic_function_is_found_from_its_border() {
        for (width, height) in [(3, 3), (4, 9), (17, 33), (65, 64), (100, 37), (211, 150)] {
            // x^2 - y^2, x y and a plane: each second difference cancels exactly.
            let value = |x: usize, y: usize| {
                let (x, y) = (x as f32 / width as f32, y as f32 / width as f32);
                Vec4::new(x * x - y * y, x * y, 1.0 - 0.5 * x + y, 0.25)
            };
            let mut grid = with_border(width, height, value);
            let left = harmonic(&mut grid, CancelCheck::default());
            assert!(left < 1e-4, "{width}x{height}: {left}");
            for (at, found) in grid.values.iter().enumerate() {
                let wanted = value(at % width, at / width);
                assert!((*found - wanted).abs().max_element() < 2e-4, "{width}x{height}: {found} {wanted}");
            }
        }
    }

    #[test]
    fn rough_borders_converge_too() {
        let noise = |x: usize, y: usize| {
            let hash = (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca6b);
            Vec4::splat((hash >> 8) as f32 / (1 << 24) as f32 - 0.5)
        };
        let mut grid = with_border(130, 90, noise);
        assert!(harmonic(&mut grid, CancelCheck::default()) < 1e-4);
        // No value inside is beyond those of the border.
        assert!(grid.values.iter().all(|value| value.x.abs() <= 0.5001));
    }

    /// By `cargo test --release -p texfold-zipmap -- --ignored --nocapture large`; idle, two cores.
    #[test]
    #[ignore = "a measurement, for an idle machine"]
    fn a_large_border_takes_at_most_three_seconds() {
        let wave = |x: usize, y: usize| Vec4::splat((x as f32 * 0.01).sin() + (y as f32 * 0.3).cos());
        let mut grid = with_border(2048, 2048, wave);
        let start = std::time::Instant::now();
        let left = harmonic(&mut grid, CancelCheck::default());
        let seconds = start.elapsed().as_secs_f64();
        println!("2048x2048, four channels: {seconds:.2} s, residual {left:.1e}");
        assert!(left < 1e-4 && seconds < 3.0, "{left} {seconds}");
    }

    #[test]
    fn degenerate_sizes_are_left_alone() {
        for (width, height) in [(1, 1), (2, 7), (9, 1)] {
            let mut grid = with_border(width, height, |x, y| Vec4::splat((x + y) as f32));
            let before = grid.clone();
            assert_eq!((harmonic(&mut grid, CancelCheck::default()), &grid), (0.0, &before));
        }
    }
}
