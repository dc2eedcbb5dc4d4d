//! Spherical harmonics of the colour at the vertices, as clouds of splats and probes have them, or at points of a lattice over each triangle: a peer
//! of light fields.

use std::collections::HashMap;

use glam::Vec3;
use texfold::lightfield::Renderer;
use texfold_core::{LightAddress, Mesh, Photograph, parallel};

use super::photographs::colour_of;

/// Largest degree.
pub(super) const MOST_DEGREE: u32 = 3;
/// Functions of [`MOST_DEGREE`].
const MOST: usize = 16;
/// Weight of small coefficients beside samples: directions that no photograph has stay near what all have.
const RIDGE: f64 = 0.02;
/// Largest step of a coefficient of 8 bits.
const LEVELS: f32 = 127.0;

/// Three colours for each function.
type Colour = [Vec3; MOST];

/// Coefficients of all points.
pub(super) struct Harmonics {
    count: usize,
    lattice: Lattice,
    points: Vec<Colour>,
    /// Bytes of the coefficients, of a point after the other of one function after the other.
    pub(super) bytes: Vec<u8>,
}

impl Harmonics {
    /// Fits each point of a lattice of `steps` along the sides of triangles, the vertices alone where that is 1, to the photographs that see it,
    /// by least squares, and rounds coefficients to 8 bits.
    pub(super) fn fit(
        mesh: &Mesh,
        views: &[Photograph],
        renderer: &Renderer<'_>,
        (degree, steps): (u32, u32),
    ) -> Harmonics {
        let count = ((degree.min(MOST_DEGREE) + 1) * (degree.min(MOST_DEGREE) + 1)) as usize;
        let (lattice, places) = Lattice::over(mesh, steps);
        let mut points = vec![[Vec3::ZERO; MOST]; places.len()];
        parallel::for_each_row(&mut points, 1, |number, point| {
            point[0] = fitted(places[number], views, renderer, count);
        });
        let mut bytes = Vec::new();
        for function in 0..count {
            let most = points.iter().map(|point| point[function].abs().max_element()).fold(1e-6, f32::max);
            for point in &mut points {
                let steps = (point[function] / most * LEVELS).round();
                bytes.extend(steps.to_array().map(|step| (step as i8) as u8));
                point[function] = steps * most / LEVELS;
            }
        }
        Harmonics { count, lattice, points, bytes }
    }

    /// The colour at a place of the mesh towards a direction.
    pub(super) fn colour(&self, address: &LightAddress) -> Vec3 {
        let functions = basis(address.direction.normalize_or_zero());
        let of = |point: usize| {
            let coefficients = &self.points[point];
            coefficients.iter().zip(functions).take(self.count).map(|(c, f)| *c * f).sum::<Vec3>()
        };
        self.lattice.around(address).into_iter().map(|(point, weight)| weight * of(point)).sum()
    }
}

/// Points of all triangles.
struct Lattice {
    /// Steps along a side.
    steps: u32,
    /// Of each triangle its points, in rows along the side from the first to the second corner.
    numbers: Vec<u32>,
}

impl Lattice {
    /// The lattice of a mesh and the place of each point; triangles share the points of their common sides.
    fn over(mesh: &Mesh, steps: u32) -> (Lattice, Vec<Vec3>) {
        let (mut numbers, mut places) = (Vec::new(), Vec::new());
        let mut known: HashMap<[(u32, u32); 3], u32> = HashMap::new();
        for &triangle in &mesh.triangles {
            for (row, column) in
                (0..=steps).flat_map(|row| (0..=steps - row).map(move |column| (row, column)))
            {
                let parts = [steps - row - column, column, row];
                // A point is its corners and their parts, those without a part left out, whichever triangle names them.
                let mut key = [0, 1, 2].map(|corner| match parts[corner] {
                    0 => (u32::MAX, 0),
                    part => (triangle[corner], part),
                });
                key.sort_unstable();
                numbers.push(*known.entry(key).or_insert_with(|| {
                    let weighted = mesh.corners(triangle).into_iter().zip(parts);
                    places.push(
                        weighted.map(|(corner, part)| corner * part as f32).sum::<Vec3>() / steps as f32,
                    );
                    places.len() as u32 - 1
                }));
            }
        }
        (Lattice { steps, numbers }, places)
    }

    /// The three points around a place, and their weights.
    fn around(&self, address: &LightAddress) -> [(usize, f32); 3] {
        let steps = self.steps as usize;
        let at = address.barycentric * self.steps as f32;
        let cell = |value: f32, most: usize| (value.max(0.0) as usize).min(most);
        let row = cell(at.z, steps - 1);
        let column = cell(at.y, steps - 1 - row);
        let (right, down) = (at.y - column as f32, at.z - row as f32);
        let first = address.triangle as usize * ((steps + 1) * (steps + 2) / 2);
        let point = |row: usize, column: usize| {
            self.numbers[first + row * (steps + 1) - row * row.saturating_sub(1) / 2 + column] as usize
        };
        let (beside, below) = (point(row, column + 1), point(row + 1, column));
        // The far half of a cell, which the last of a row does not have.
        if right + down > 1.0 && row + column + 1 < steps {
            [(beside, 1.0 - down), (below, 1.0 - right), (point(row + 1, column + 1), right + down - 1.0)]
        } else {
            [(point(row, column), 1.0 - right - down), (beside, right), (below, down)]
        }
    }
}

/// Coefficients of a place.
fn fitted(place: Vec3, views: &[Photograph], renderer: &Renderer<'_>, count: usize) -> Colour {
    let mut matrix = [[0f64; MOST]; MOST];
    let mut right = [[0f64; 3]; MOST];
    let mut samples = 0.0;
    for view in views {
        let Some(pixel) = colour_of(view, renderer, place) else { continue };
        let functions = basis((view.camera.eye() - place).normalize_or_zero()).map(f64::from);
        for row in 0..count {
            for column in 0..count {
                matrix[row][column] += functions[row] * functions[column];
            }
            for channel in 0..3 {
                right[row][channel] += functions[row] * f64::from(pixel[channel]) / 255.0;
            }
        }
        samples += 1.0;
    }
    for (number, row) in matrix.iter_mut().enumerate().take(count) {
        row[number] += if number == 0 { 1e-6 } else { RIDGE * samples + 1e-6 };
    }
    solve(&mut matrix, &mut right, count);
    right.map(|values| Vec3::from(values.map(|value| value as f32)))
}

/// Solves a symmetric positive definite system by elimination; `right` becomes the solution.
fn solve(matrix: &mut [[f64; MOST]; MOST], right: &mut [[f64; 3]; MOST], count: usize) {
    for pivot in 0..count {
        let (pivot_row, pivot_right) = (matrix[pivot], right[pivot]);
        for row in (0..count).filter(|&row| row != pivot) {
            let factor = matrix[row][pivot] / pivot_row[pivot];
            for column in pivot..count {
                matrix[row][column] -= factor * pivot_row[column];
            }
            for channel in 0..3 {
                right[row][channel] -= factor * pivot_right[channel];
            }
        }
    }
    for row in 0..count {
        right[row] = right[row].map(|value| value / matrix[row][row]);
    }
}

/// Real spherical harmonics of degrees 0 to 3 (Sloan 2008, appendix A2).
fn basis(Vec3 { x, y, z }: Vec3) -> [f32; MOST] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        0.282_095,
        0.488_603 * y,
        0.488_603 * z,
        0.488_603 * x,
        1.092_548 * x * y,
        1.092_548 * y * z,
        0.315_392 * (3.0 * zz - 1.0),
        1.092_548 * x * z,
        0.546_274 * (xx - yy),
        0.590_044 * y * (3.0 * xx - yy),
        2.890_611 * x * y * z,
        0.457_046 * y * (5.0 * zz - 1.0),
        0.373_176 * z * (5.0 * zz - 3.0),
        0.457_046 * x * (5.0 * zz - 1.0),
        1.445_306 * z * (xx - yy),
        0.590_044 * x * (xx - 3.0 * yy),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_are_orthonormal_over_the_sphere() {
        // A spiral has points of equal area.
        let count = 20_000;
        let mut products = [[0f64; MOST]; MOST];
        for number in 0..count {
            let z = 1.0 - (2.0 * number as f32 + 1.0) / count as f32;
            let (turn, side) = (number as f32 * 2.399_963, (1.0 - z * z).sqrt());
            let functions = basis(Vec3::new(side * turn.cos(), side * turn.sin(), z));
            for (row, one) in functions.iter().enumerate() {
                for (column, other) in functions.iter().enumerate() {
                    products[row][column] +=
                        f64::from(one * other) * 4.0 * std::f64::consts::PI / f64::from(count);
                }
            }
        }
        for (row, line) in products.iter().enumerate() {
            for (column, product) in line.iter().enumerate() {
                let wanted = if row == column { 1.0 } else { 0.0 };
                assert!((product - wanted).abs() < 1e-3, "{row} {column}: {product}");
            }
        }
    }

    #[test]
    fn places_lie_between_the_points_around_them() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(1.0, 1.0, 0.5)];
        let mesh = Mesh { positions, triangles: vec![[0, 1, 2], [3, 2, 1]] };
        for steps in [1, 2, 5] {
            let (lattice, places) = Lattice::over(&mesh, steps);
            assert_eq!(places.len() as u32, (steps + 1) * (steps + 1));
            for (triangle, at) in (0..2).flat_map(|triangle| (0..100).map(move |at| (triangle, at))) {
                let (b, c) = ((at % 10) as f32 / 9.0, (at / 10) as f32 / 9.0);
                let barycentric = Vec3::new(1.0 - b - c, b, c);
                if barycentric.min_element() < 0.0 {
                    continue;
                }
                let address = LightAddress { triangle, barycentric, direction: Vec3::Z };
                let around = lattice.around(&address);
                let found: Vec3 = around.iter().map(|&(point, weight)| weight * places[point]).sum();
                let corners = mesh.corners(mesh.triangles[triangle as usize]);
                let wanted: Vec3 =
                    corners.into_iter().zip(barycentric.to_array()).map(|(corner, part)| corner * part).sum();
                assert!(found.distance(wanted) < 1e-5, "{steps} {barycentric}: {found} {wanted}");
                assert!(around.iter().all(|&(_, weight)| weight > -1e-5));
            }
        }
    }

    #[test]
    fn systems_are_solved() {
        let mut matrix = [[0.0; MOST]; MOST];
        let mut right = [[0.0; 3]; MOST];
        (matrix[0][0], matrix[0][1], matrix[1][0], matrix[1][1]) = (4.0, 1.0, 1.0, 3.0);
        (right[0], right[1]) = ([1.0, 5.0, 0.0], [2.0, 4.0, 0.0]);
        solve(&mut matrix, &mut right, 2);
        for (found, wanted) in
            right[0].iter().chain(&right[1]).zip([1.0 / 11.0, 1.0, 0.0, 7.0 / 11.0, 1.0, 0.0])
        {
            assert!((found - wanted).abs() < 1e-12);
        }
    }
}
