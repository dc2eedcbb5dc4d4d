//! The normal equations of a view map that observations are read from bilinearly, and Gauss-Seidel sweeps over them.

use glam::Vec3A;

use super::taps::Tap;

/// Weight of the difference of two neighbouring texels of a view map, in mean weights of a texel's observations: less leaves noise and
/// holes, more blurs highlights.
const SMOOTHNESS: f32 = 0.005;

/// The normal equations of a view map: a symmetric matrix with the eight neighbours of each texel.
pub(super) struct System {
    grid: usize,
    /// Each texel with itself, and with those right, lower left, below and lower right.
    matrix: Vec<[Vec3A; 5]>,
    right: Vec<Vec3A>,
}

impl System {
    pub(super) fn new(grid: usize) -> System {
        let texels = grid * grid;
        System { grid, matrix: vec![[Vec3A::ZERO; 5]; texels], right: vec![Vec3A::ZERO; texels] }
    }

    /// Adds an observation.
    pub(super) fn add(&mut self, tap: &Tap, square: Vec3A, product: Vec3A) {
        let low = tap.low as usize;
        let [a, b, c, d] = tap.weights;
        let (square_a, square_b) = (square * a, square * b);
        let first = &mut self.matrix[low];
        first[0] += square_a * a;
        first[1] += square_a * b;
        first[3] += square_a * c;
        first[4] += square_a * d;
        let second = &mut self.matrix[low + 1];
        second[0] += square_b * b;
        second[2] += square_b * c;
        second[3] += square_b * d;
        let square_c = square * c;
        let third = &mut self.matrix[low + self.grid];
        third[0] += square_c * c;
        third[1] += square_c * d;
        self.matrix[low + self.grid + 1][0] += square * (d * d);
        for (at, weight) in [(low, a), (low + 1, b), (low + self.grid, c), (low + self.grid + 1, d)] {
            self.right[at] += product * weight;
        }
    }

    /// Adds the weight of differences between neighbours.
    pub(super) fn smooth(&mut self) {
        let total: Vec3A = self.matrix.iter().map(|row| row[0]).sum();
        let weight = total / self.matrix.len() as f32 * SMOOTHNESS + f32::MIN_POSITIVE;
        for at in 0..self.matrix.len() {
            for (step, entry, exists) in
                [(1, 1, at % self.grid + 1 < self.grid), (self.grid, 3, at + self.grid < self.matrix.len())]
            {
                if exists {
                    self.matrix[at][0] += weight;
                    self.matrix[at + step][0] += weight;
                    self.matrix[at][entry] -= weight;
                }
            }
        }
    }

    /// One Gauss-Seidel sweep.
    pub(super) fn sweep(&self, view: &mut [Vec3A], floor: Vec3A) {
        let grid = self.grid;
        for at in 0..view.len() {
            let (x, y) = (at % grid, at / grid);
            let mut sum = self.right[at];
            let own = &self.matrix[at];
            if x + 1 < grid {
                sum -= own[1] * view[at + 1];
            }
            if x > 0 {
                sum -= self.matrix[at - 1][1] * view[at - 1];
            }
            if y + 1 < grid {
                sum -= own[3] * view[at + grid];
                if x > 0 {
                    sum -= own[2] * view[at + grid - 1];
                }
                if x + 1 < grid {
                    sum -= own[4] * view[at + grid + 1];
                }
            }
            if y > 0 {
                sum -= self.matrix[at - grid][3] * view[at - grid];
                if x + 1 < grid {
                    sum -= self.matrix[at - grid + 1][2] * view[at - grid + 1];
                }
                if x > 0 {
                    sum -= self.matrix[at - grid - 1][4] * view[at - grid - 1];
                }
            }
            view[at] = (sum / own[0].max(Vec3A::splat(f32::MIN_POSITIVE))).max(floor);
        }
    }
}
