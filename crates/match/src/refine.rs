//! Affine refinement of a match by damped inverse-compositional Gauss-Newton steps (Baker and Matthews 2004).
//!
//! Gradients are those of the target, so the normal matrix is built once. Brightness and contrast are solved for at every
//! step. A step counts only where it lowers the error: the result is never worse than the seed.

use std::ops::Range;

use glam::{Mat2, Vec2};

/// Most steps.
const STEPS: usize = 8;
/// Diagonal of the normal matrix is scaled up by this share: along edges it is near singular.
const DAMPING: f32 = 0.02;
/// Contrast at most this much above the source's.
const MOST_GAIN: f32 = 1.25;

/// Where a patch lies in another image: texel `d` from the patch's centre is at `position + matrix * d`, texel (x, y)
/// covering x to x + 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transform {
    /// Place of the patch's centre.
    pub position: Vec2,
    /// 2x2 matrix.
    pub matrix: Mat2,
}

/// What of a transform may change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Freedom {
    /// Its position.
    Position,
    /// Its position and its 2x2 matrix.
    Affine,
}

/// A refined match.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refined {
    /// The transform.
    pub transform: Transform,
    /// Sum of squared differences of luma that gain and offset leave.
    pub error: f32,
}

/// A plane of luma.
#[derive(Debug, Clone, Copy)]
struct Luma<'a> {
    width: usize,
    height: usize,
    values: &'a [f32],
}

impl Luma<'_> {
    /// Bilinear value at a place in texels, clamped to the plane.
    #[inline]
    fn at(&self, place: Vec2) -> f32 {
        let at =
            (place - 0.5).clamp(Vec2::ZERO, Vec2::new(self.width as f32 - 1.001, self.height as f32 - 1.001));
        let (x, y) = (at.x as usize, at.y as usize);
        let (u, v) = (at.x - x as f32, at.y - y as f32);
        let start = y * self.width + x;
        let right = usize::from(x + 1 < self.width);
        let below = if y + 1 < self.height { self.width } else { 0 };
        let row = |start: usize| {
            let a = self.values[start];
            a + (self.values[start + right] - a) * u
        };
        let (upper, lower) = (row(start), row(start + below));
        upper + (lower - upper) * v
    }
}

/// A patch that is looked for, with what does not change from one match to another.
pub struct Refiner<'a> {
    system: System<'a>,
}

impl std::fmt::Debug for Refiner<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Refiner").field("patch", &self.system.patch).finish_non_exhaustive()
    }
}

impl<'a> Refiner<'a> {
    /// `target` is the patch's luma, `patch.0` columns by `patch.1` rows.
    #[must_use]
    pub fn new(target: &'a [f32], patch: (usize, usize)) -> Self {
        Refiner { system: System::new(target, patch) }
    }

    /// Changes what may change of `seed` until the error stops falling. `source` is the luma of the image that is searched,
    /// `size` its columns and rows.
    #[must_use]
    pub fn refine(&self, source: &[f32], size: (usize, usize), seed: Transform, freedom: Freedom) -> Refined {
        let system = &self.system;
        let parameters = match freedom {
            Freedom::Affine => 0..6,
            Freedom::Position => 4..6,
        };
        let luma = Luma { width: size.0, height: size.1, values: source };
        let (mut warped, mut moved) = (vec![0.0; system.target.len()], vec![0.0; system.target.len()]);
        let (error, mut gain_offset) = system.warp(&luma, seed, &mut warped);
        let mut best = Refined { transform: seed, error };
        let mut damping = DAMPING;
        for _ in 0..STEPS {
            let Some(step) = system.step(&warped, gain_offset, parameters.clone(), damping) else { break };
            let transform = compose(best.transform, step);
            let (error, new_gain_offset) = system.warp(&luma, transform, &mut moved);
            if error < best.error {
                let gain = best.error - error;
                best = Refined { transform, error };
                gain_offset = new_gain_offset;
                std::mem::swap(&mut warped, &mut moved);
                damping = (damping * 0.3).max(1e-3);
                if gain < 0.002 * best.error {
                    break;
                }
            } else {
                if damping > 1.0 {
                    break;
                }
                damping *= 8.0;
            }
        }
        best
    }
}

/// Transform after the inverse of a small step of the target: (a, b, c, d) of the 2x2 matrix, then the translation.
fn compose(transform: Transform, step: [f32; 6]) -> Transform {
    let small = Mat2::from_cols(Vec2::new(1.0 + step[0], step[2]), Vec2::new(step[1], 1.0 + step[3]));
    let determinant = small.determinant();
    if determinant.abs() < 0.2 {
        return transform;
    }
    let inverse = small.inverse();
    let matrix = transform.matrix * inverse;
    let shift = Vec2::new(step[4], step[5]);
    Transform { position: transform.position - matrix * shift, matrix }
}

/// Gain and offset that carry the source to the target.
type GainOffset = (f32, f32);

/// What does not change while a match is refined.
struct System<'a> {
    target: &'a [f32],
    patch: (usize, usize),
    /// For each texel the target's change by each of the six parameters.
    jacobian: Vec<[f32; 6]>,
    normal: [[f32; 6]; 6],
}

impl<'a> System<'a> {
    fn new(target: &'a [f32], patch: (usize, usize)) -> Self {
        let (width, height) = patch;
        let at = |x: usize, y: usize| target[y * width + x];
        let centre = Vec2::new(width as f32, height as f32) * 0.5;
        let mut jacobian = Vec::new();
        let mut normal = [[0.0; 6]; 6];
        for y in 0..height {
            for x in 0..width {
                let (left, right) = (x.saturating_sub(1), (x + 1).min(width - 1));
                let (up, down) = (y.saturating_sub(1), (y + 1).min(height - 1));
                let gx = (at(right, y) - at(left, y)) / (right - left).max(1) as f32;
                let gy = (at(x, down) - at(x, up)) / (down - up).max(1) as f32;
                let d = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - centre;
                let row = [gx * d.x, gx * d.y, gy * d.x, gy * d.y, gx, gy];
                for i in 0..6 {
                    for j in 0..=i {
                        normal[i][j] += row[i] * row[j];
                    }
                }
                jacobian.push(row);
            }
        }
        for i in 0..6 {
            for j in 0..i {
                normal[j][i] = normal[i][j];
            }
        }
        System { target, patch, jacobian, normal }
    }

    /// Reads the source under `transform`; the error and gain and offset that fit best.
    fn warp(&self, luma: &Luma<'_>, transform: Transform, warped: &mut [f32]) -> (f32, GainOffset) {
        let (width, height) = self.patch;
        let centre = Vec2::new(width as f32, height as f32) * 0.5;
        let (mut sx, mut sy, mut sxx, mut sxy, mut syy) = (0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32);
        for y in 0..height {
            let start = Vec2::new(0.5, y as f32 + 0.5) - centre;
            let mut place = transform.position + transform.matrix * start;
            for x in 0..width {
                // Around middle gray, so that sums keep their precision.
                let (value, wanted) = (luma.at(place) - 128.0, self.target[y * width + x] - 128.0);
                warped[y * width + x] = value + 128.0;
                sx += value;
                sy += wanted;
                sxx += value * value;
                sxy += value * wanted;
                syy += wanted * wanted;
                place += transform.matrix.x_axis;
            }
        }
        let n = (width * height) as f32;
        let (vxx, vxy, vyy) = (sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n);
        let gain = if vxx > 1e-3 { (vxy / vxx).clamp(0.0, MOST_GAIN) } else { 1.0 };
        let offset = (sy - gain * sx) / n + 128.0 * (1.0 - gain);
        ((vyy - 2.0 * gain * vxy + gain * gain * vxx).max(0.0), (gain, offset))
    }

    /// The step of those `parameters` that the linearised error asks for.
    fn step(
        &self,
        warped: &[f32],
        (gain, offset): GainOffset,
        parameters: Range<usize>,
        damping: f32,
    ) -> Option<[f32; 6]> {
        let mut right = [0.0f32; 6];
        for ((row, &value), &wanted) in self.jacobian.iter().zip(warped).zip(self.target) {
            let difference = gain * value + offset - wanted;
            for (sum, &slope) in right.iter_mut().zip(row) {
                *sum += slope * difference;
            }
        }
        solve(&self.normal, right, parameters, damping)
    }
}

/// Solves the damped normal equations for the parameters of `range` by Cholesky's method; the others are 0.
fn solve(normal: &[[f32; 6]; 6], right: [f32; 6], range: Range<usize>, damping: f32) -> Option<[f32; 6]> {
    let (start, n) = (range.start, range.len());
    let mut lower = [[0.0f32; 6]; 6];
    for i in 0..n {
        for j in 0..=i {
            let mut sum = normal[start + i][start + j];
            if i == j {
                sum = sum * (1.0 + damping) + 1.0;
            }
            for k in 0..j {
                sum -= lower[i][k] * lower[j][k];
            }
            if i == j {
                if sum <= 1e-6 {
                    return None;
                }
                lower[i][i] = sum.sqrt();
            } else {
                lower[i][j] = sum / lower[j][j];
            }
        }
    }
    let mut y = [0.0f32; 6];
    for i in 0..n {
        let known: f32 = (0..i).map(|k| lower[i][k] * y[k]).sum();
        y[i] = (right[start + i] - known) / lower[i][i];
    }
    let mut solution = [0.0f32; 6];
    for i in (0..n).rev() {
        let known: f32 = (i + 1..n).map(|k| lower[k][i] * solution[start + k]).sum();
        solution[start + i] = (y[i] - known) / lower[i][i];
    }
    solution.iter().all(|value| value.is_finite()).then_some(solution)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn scene(at: Vec2) -> f32 {
        128.0 + 50.0 * (at.x * 0.35).sin() * (at.y * 0.27).cos() + 30.0 * (at.x * 0.11 + at.y * 0.23).sin()
    }

    fn source() -> Vec<f32> {
        (0..64 * 64).map(|i| scene(Vec2::new((i % 64) as f32 + 0.5, (i / 64) as f32 + 0.5))).collect()
    }

    fn patch(transform: Transform, gain: f32, offset: f32) -> Vec<f32> {
        let at = |i: usize| Vec2::new((i % 16) as f32 - 7.5, (i / 16) as f32 - 7.5);
        (0..256).map(|i| gain * scene(transform.position + transform.matrix * at(i)) + offset).collect()
    }

    proptest! {
        #[test]
        fn a_disturbed_transform_is_found_again(
            dx in -1.0f32..1.0, dy in -1.0f32..1.0, a in -0.08f32..0.08, b in -0.08f32..0.08, gain in 0.7f32..1.1,
        ) {
            let truth = Transform {
                position: Vec2::new(30.0, 33.0),
                matrix: Mat2::from_cols(Vec2::new(1.0 + a, b), Vec2::new(-b, 1.0 - a)),
            };
            let seed = Transform { position: truth.position + Vec2::new(dx, dy), matrix: Mat2::IDENTITY };
            let target = patch(truth, gain, 9.0);
            let found = Refiner::new(&target, (16, 16)).refine(&source(), (64, 64), seed, Freedom::Affine);
            let position = found.transform.position - truth.position;
            prop_assert!(position.length() < 0.1, "{position}");
            prop_assert!((found.error / 256.0).sqrt() < 1.5, "{}", found.error);
        }

        #[test]
        fn never_worse_than_its_seed(
            target in proptest::collection::vec(0.0f32..255.0, 64),
            x in -10.0f32..80.0, y in -10.0f32..80.0, a in -2.0f32..2.0, b in -2.0f32..2.0, affine: bool,
        ) {
            let matrix = Mat2::from_cols(Vec2::new(a, b), Vec2::new(b, 1.0));
            let seed = Transform { position: Vec2::new(x, y), matrix };
            let source = source();
            let luma = Luma { width: 64, height: 64, values: &source };
            let freedom = if affine { Freedom::Affine } else { Freedom::Position };
            let before = System::new(&target, (8, 8)).warp(&luma, seed, &mut [0.0; 64]).0;
            let found = Refiner::new(&target, (8, 8)).refine(&source, (64, 64), seed, freedom);
            prop_assert!(affine || found.transform.matrix == seed.matrix);
            prop_assert!(found.error <= before);
            prop_assert!(found.transform.position.is_finite() && found.transform.matrix.is_finite());
        }
    }

    #[test]
    fn stripes_and_flat_patches_do_not_run_away() {
        let stripes: Vec<f32> = (0..256).map(|i| if i % 16 / 4 % 2 == 0 { 40.0 } else { 200.0 }).collect();
        let flat = vec![77.0; 256];
        let seed = Transform { position: Vec2::new(32.0, 32.0), matrix: Mat2::IDENTITY };
        for target in [stripes, flat] {
            let found = Refiner::new(&target, (16, 16)).refine(&source(), (64, 64), seed, Freedom::Affine);
            assert!((found.transform.position - seed.position).length() < 32.0);
        }
    }
}
