//! Factors of a resampled matrix, as in the paper: to compare with, and for captures dense enough.
//!
//! For each vertex, edge and triangle around a vertex the photographs that see all of it are placed on the disc of directions and joined by a
//! Delaunay triangulation; every texel of the view map is blended from the three photographs around it (paper section 5.2). Texels
//! outside of the hull take the nearest photograph, with a weight that falls with the distance. The matrix of samples by texels is then
//! factored by power iteration, one term after the other (paper, appendix). O(samples x texels x terms x rounds), one
//! vertex in memory at a time.

use delaunator::{Point, triangulate};
use glam::{Vec2, Vec3, Vec3A};
use texfold_core::CancelCheck;

use super::maps::{Term, VertexMaps};
use super::observe::SeenBy;
use super::scene::Scene;
use crate::decode::{texfold_lightfield_direction, texfold_lightfield_disc, texfold_lightfield_local};
use crate::params::LightParams;

/// Rounds of power iteration: what is left of the next singular value is its ratio to the power of twice that.
const ROUNDS: usize = 12;
/// Distance on the disc, of radius 1, at which a photograph outside of the hull counts half.
const REACH: f32 = 0.25;

/// What a texel of a view map is blended from: photographs and their weights, and how much the whole counts.
#[derive(Debug, Clone, Copy, Default)]
struct Blend {
    views: [u32; 3],
    weights: [f32; 3],
    share: f32,
}

/// The matrix of one vertex less its mean, the hat function included.
struct Matrix {
    texels: usize,
    values: Vec<Vec3A>,
}

/// The photographs that see all of an element, and what texels of a vertex' view map are blended from, among them.
fn wholly_seen(scene: &Scene, vertex: u32, number: u32, grid: u32) -> (Vec<SeenBy<'_>>, Vec<Blend>) {
    let all = |by: &SeenBy<'_>| by.weights.iter().all(|&weight| weight > 0);
    let whole: Vec<_> = scene.seen[number as usize].iter().filter(all).collect();
    let views: Vec<u16> = whole.iter().map(|by| by.view).collect();
    let blends = blends(&places(scene, vertex, number, &views), grid);
    (whole, blends)
}

/// Fits the terms around one vertex.
pub(super) fn fit(scene: &Scene, vertex: u32, params: &LightParams, cancel: CancelCheck<'_>) -> VertexMaps {
    let texels = (params.maps.grid * params.maps.grid) as usize;
    let mut matrix = Matrix { texels, values: Vec::new() };
    let mut maps = VertexMaps { rows: Vec::new(), mean: Vec::new(), terms: Vec::new() };
    for &number in &scene.surface.around[vertex as usize] {
        let element = &scene.surface.elements[number as usize];
        let (whole, blends) = wholly_seen(scene, vertex, number, params.maps.grid);
        for sample in (0..element.weights.len()).take_while(|_| !cancel.is_cancelled()) {
            let hat = element.hat(vertex, sample);
            let colour =
                |view: u32| Vec3A::from(whole[view as usize].colours[sample].map(f32::from)) / 255.0 * hat;
            let mean = whole.iter().map(|by| Vec3A::from(by.colours[sample].map(f32::from))).sum::<Vec3A>()
                / (255.0 * whole.len().max(1) as f32)
                * hat;
            matrix.values.extend(blends.iter().map(|blend| {
                let blended = (0..3)
                    .filter(|&i| blend.weights[i] > 0.0)
                    .map(|i| colour(blend.views[i]) * blend.weights[i]);
                if blend.share > 0.0 { (blended.sum::<Vec3A>() - mean) * blend.share } else { Vec3A::ZERO }
            }));
            maps.rows.push(element.first + sample as u32);
            maps.mean.push(mean.into());
        }
    }
    for _ in 0..params.terms {
        maps.terms.push(matrix.take_term(cancel));
    }
    maps
}

/// Where the photographs `views` of an element lie on the disc of a vertex, by the direction of the element's middle.
fn places(scene: &Scene, vertex: u32, number: u32, views: &[u16]) -> Vec<Vec2> {
    let element = &scene.surface.elements[number as usize];
    let samples = element.weights.len();
    let sum = |value: &dyn Fn(usize) -> Vec3| (0..samples).map(value).sum::<Vec3>();
    let middle = sum(&|sample| element.position(&scene.mesh, sample)) / samples as f32;
    let normal = sum(&|sample| element.normal(&scene.normals, sample)).normalize_or_zero();
    let place = |&view: &u16| {
        let direction = (scene.eyes[usize::from(view)] - middle).normalize_or_zero();
        let towards = texfold_lightfield_direction(scene.directions, direction, normal);
        let local = texfold_lightfield_local(scene.directions, towards, scene.normals[vertex as usize]);
        texfold_lightfield_disc(scene.directions, local)
    };
    views.iter().map(place).collect()
}

/// What each texel of a view map of `grid` texels a side is blended from.
fn blends(places: &[Vec2], grid: u32) -> Vec<Blend> {
    let mut blends = vec![Blend::default(); (grid * grid) as usize];
    let points: Vec<Point> =
        places.iter().map(|place| Point { x: f64::from(place.x), y: f64::from(place.y) }).collect();
    for corners in triangulate(&points).triangles.chunks_exact(3) {
        let corners = [corners[0], corners[1], corners[2]];
        cover(corners, corners.map(|corner| places[corner]), grid, &mut blends);
    }
    for (texel, blend) in blends.iter_mut().enumerate().filter(|(_, blend)| blend.share == 0.0) {
        let at = disc_of(texel, grid);
        let distance = |view: &usize| places[*view].distance_squared(at);
        let nearest = (0..places.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        if let Some(view) = nearest {
            let share = 1.0 / (1.0 + distance(&view) / (REACH * REACH));
            *blend = Blend { views: [view as u32; 3], weights: [1.0, 0.0, 0.0], share };
        }
    }
    blends
}

/// The place of a texel's middle on the disc.
fn disc_of(texel: usize, grid: u32) -> Vec2 {
    let (x, y) = (texel as u32 % grid, texel as u32 / grid);
    Vec2::new(x as f32, y as f32) / (grid - 1) as f32 * 2.0 - 1.0
}

/// Gives the texels within a triangle of photographs their weights.
fn cover(views: [usize; 3], [a, b, c]: [Vec2; 3], grid: u32, blends: &mut [Blend]) {
    let doubled = (b - a).perp_dot(c - a);
    if doubled == 0.0 {
        return;
    }
    let across = |value: f32| (value * 0.5 + 0.5) * (grid - 1) as f32;
    let low = a.min(b).min(c).map(|value| across(value).ceil().max(0.0));
    let high = a.max(b).max(c).map(|value| across(value).floor().min((grid - 1) as f32));
    for y in low.y as u32..=high.y.max(0.0) as u32 {
        for x in low.x as u32..=high.x.max(0.0) as u32 {
            let texel = (y * grid + x) as usize;
            let at = disc_of(texel, grid);
            let (u, v) = ((at - a).perp_dot(c - a) / doubled, (b - a).perp_dot(at - a) / doubled);
            if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
                let views = views.map(|view| view as u32);
                blends[texel] = Blend { views, weights: [1.0 - u - v, u, v], share: 1.0 };
            }
        }
    }
}

impl Matrix {
    /// The largest term, taken out of the matrix.
    fn take_term(&mut self, cancel: CancelCheck<'_>) -> Term {
        let mut view = normalised(self.row_of_most());
        for _ in (0..ROUNDS).take_while(|_| !cancel.is_cancelled()) {
            view = normalised(self.transposed_times(&normalised(self.times(&view))));
        }
        let surface = self.times(&view);
        for (row, &value) in self.values.chunks_exact_mut(self.texels).zip(&surface) {
            row.iter_mut().zip(&view).for_each(|(entry, &view)| *entry -= value * view);
        }
        Term {
            surface: surface.into_iter().map(Vec3::from).collect(),
            view: view.into_iter().map(Vec3::from).collect(),
        }
    }

    /// The row of most energy: a start that is not orthogonal to the largest term.
    fn row_of_most(&self) -> Vec<Vec3A> {
        let energy = |row: &&[Vec3A]| row.iter().map(|value| value.length_squared()).sum::<f32>();
        let most = self.values.chunks_exact(self.texels).max_by(|a, b| energy(a).total_cmp(&energy(b)));
        most.map_or(vec![Vec3A::ZERO; self.texels], <[Vec3A]>::to_vec)
    }

    fn times(&self, view: &[Vec3A]) -> Vec<Vec3A> {
        let product = |row: &[Vec3A]| row.iter().zip(view).map(|(&entry, &view)| entry * view).sum();
        self.values.chunks_exact(self.texels).map(product).collect()
    }

    fn transposed_times(&self, surface: &[Vec3A]) -> Vec<Vec3A> {
        let mut view = vec![Vec3A::ZERO; self.texels];
        for (row, &value) in self.values.chunks_exact(self.texels).zip(surface) {
            view.iter_mut().zip(row).for_each(|(view, &entry)| *view += entry * value);
        }
        view
    }
}

/// Of length 1 in each channel, or 0.
fn normalised(mut values: Vec<Vec3A>) -> Vec<Vec3A> {
    let squares: Vec3A = values.iter().map(|&value| value * value).sum();
    let scale =
        Vec3A::select(squares.cmpgt(Vec3A::splat(f32::MIN_POSITIVE)), squares.powf(-0.5), Vec3A::ZERO);
    values.iter_mut().for_each(|value| *value *= scale);
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use texfold_core::rng::Rng;

    #[test]
    fn terms_are_those_that_the_matrix_was_made_of() {
        // Orthogonal factors with singular values 9, 4 and 1.
        let (rows, texels) = (24, 16);
        let wave = |k: usize, at: usize, n: usize| {
            Vec3A::splat((std::f32::consts::PI * (k * (2 * at + 1)) as f32 / (2 * n) as f32).cos())
        };
        let factor = |k: usize, n: usize| normalised((0..n).map(|at| wave(k, at, n)).collect());
        let values = [9.0f32, 4.0, 1.0];
        let mut matrix = Matrix { texels, values: vec![Vec3A::ZERO; rows * texels] };
        for (k, &value) in values.iter().enumerate() {
            let (surface, view) = (factor(k + 1, rows), factor(k + 2, texels));
            for (row, &u) in matrix.values.chunks_exact_mut(texels).zip(&surface) {
                row.iter_mut().zip(&view).for_each(|(entry, &v)| *entry += value * u * v);
            }
        }
        for wanted in values.into_iter().chain([0.0]) {
            let term = matrix.take_term(CancelCheck::default());
            let found: f32 = term.surface.iter().map(|value| value.y * value.y).sum::<f32>().sqrt();
            assert!((found - wanted).abs() < 1e-3, "{found} {wanted}");
        }
        assert!(matrix.values.iter().all(|value| value.abs().max_element() < 1e-3));
    }

    #[test]
    fn repeated_singular_values_and_empty_matrices_end_well() {
        let mut identity = Matrix { texels: 4, values: vec![Vec3A::ZERO; 16] };
        (0..4).for_each(|at| identity.values[5 * at] = Vec3A::ONE);
        for _ in 0..6 {
            assert!(identity.take_term(CancelCheck::default()).surface.iter().all(|value| value.is_finite()));
        }
        assert!(identity.values.iter().all(|value| value.abs().max_element() < 1e-5));
        let mut empty = Matrix { texels: 4, values: Vec::new() };
        assert_eq!(empty.take_term(CancelCheck::default()).surface, []);
    }

    #[test]
    fn texels_are_blended_from_the_triangle_of_photographs_around_them() {
        let mut rng = Rng::new(5);
        for count in [0, 1, 2, 3, 30] {
            let places: Vec<Vec2> = (0..count)
                .map(|_| 0.7 * Vec2::new(rng.between(-1.0, 1.0) as f32, rng.between(-1.0, 1.0) as f32))
                .collect();
            let mut inside = 0;
            for (texel, blend) in blends(&places, 12).iter().enumerate() {
                assert_eq!(blend.share > 0.0, count > 0);
                if blend.share < 1.0 {
                    continue;
                }
                inside += 1;
                assert!((blend.weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
                let at: Vec2 = (0..3).map(|i| places[blend.views[i] as usize] * blend.weights[i]).sum();
                assert!(at.distance(disc_of(texel, 12)) < 1e-4);
                // No other photograph lies within the circle through the three (Delaunay's condition).
                let [a, b, c] = blend.views.map(|view| places[view as usize]);
                let (b, c) = (b - a, c - a);
                let centre = Vec2::new(
                    c.y * b.length_squared() - b.y * c.length_squared(),
                    b.x * c.length_squared() - c.x * b.length_squared(),
                ) / (2.0 * b.perp_dot(c));
                let nearest =
                    places.iter().map(|place| place.distance(a + centre)).fold(f32::INFINITY, f32::min);
                assert!(nearest > centre.length() - 1e-3, "{nearest} {}", centre.length());
            }
            assert!(count < 30 || inside > 20, "{count}: {inside}");
        }
    }
}
