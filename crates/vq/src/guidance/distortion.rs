//! Distortion: where a mesh stretches the texture, so that errors are seen enlarged.
//!
//! Method: paper section 3.3. The parameterisation S(u, v) of a mesh is linear on every triangle; the largest
//! singular value of its Jacobian [dS/du, dS/dv] is the largest stretch (Sander, Snyder, Gortler, Hoppe,
//! "Texture mapping progressive meshes", 2001). Corners take the mean of the triangles around them, triangles
//! are drawn into the texture with values interpolated between corners.
//!
//! Cost: linear in the triangles and in the texels of their bounding boxes, at most [`MAX_VISITS`].
//!
//! Deviations:
//! - Coordinates are counted in texels, not in images: for images that are not square, the stretch of a texel is
//!   what enlarges its error.
//! - The mean around a corner is weighted by texture area: a sliver of next to no texels can have any stretch, and
//!   after normalisation nothing else would be seen. Triangles whose height is within rounding of their
//!   coordinates do not count at all.
//! - Corners at one place of space and texture are one corner: files repeat corners where normals differ.
//! - A texel is covered if a triangle touches it, even where the centre stays outside: bilinear sampling reads
//!   it, and meshes finer than texels leave no holes.

use std::collections::HashMap;

use glam::{DVec2, DVec3};
use texfold_core::mesh::UvMesh;
use texfold_core::{CancelCheck, ImageSize, SourceError};

use super::{Map, normalise};

/// Most texels that the bounding boxes of all triangles may hold: some 4 s of work, and a 1024x1024 texture
/// repeated 20 times both ways by one quad. Without a limit, one coordinate of 1e9 would run for years.
const MAX_VISITS: f64 = (1_u64 << 30) as f64;
/// Heights of a triangle below this many units in the last place of its coordinates are rounding: each of the
/// two ends is off by half a unit in both coordinates, and differences double that.
const LEAST_HEIGHT_ULPS: f64 = 4.0;

/// How much each texel of a `width` x `height` texture is stretched on `mesh`, relative to the most stretched
/// one; 0 where no triangle is, the larger where triangles overlap. Coordinates outside [0, 1] repeat the texture.
///
/// # Errors
/// [`SourceError::Guidance`]: an invalid mesh, one without a triangle that covers any of the texture, or one that
/// repeats the texture so often that drawing it would not end.
pub fn distortion_map(mesh: &UvMesh, width: u32, height: u32) -> Result<Map, SourceError> {
    distortion(mesh, ImageSize { width, height }, CancelCheck::default())
}

/// As [`distortion_map`]; of no use once the job is cancelled.
pub(crate) fn distortion(
    mesh: &UvMesh,
    ImageSize { width, height }: ImageSize,
    cancel: CancelCheck<'_>,
) -> Result<Map, SourceError> {
    let error = |what| Err(SourceError::Guidance { map: "mesh", what });
    if !mesh.is_valid() {
        return error("its corners, texture coordinates and indices do not agree, or are not finite");
    }
    let scale = DVec2::new(f64::from(width), f64::from(height));
    let faces: Vec<Face> =
        mesh.triangles.iter().filter_map(|&corners| Face::new(mesh, corners, scale)).collect();
    if faces.is_empty() {
        return error("no triangle covers any of the texture");
    }
    if faces.iter().map(Face::visits).sum::<f64>() > MAX_VISITS {
        return error("its triangles repeat the texture too often");
    }
    let stretch = corner_stretch(mesh, &faces);
    let mut map = Map::zeros((height as usize, width as usize));
    for face in &faces {
        face.draw(face.corners.map(|corner| stretch[corner as usize]), &mut map, cancel);
    }
    normalise(&mut map);
    Ok(map)
}

/// A triangle that covers some of the texture.
struct Face {
    corners: [u32; 3],
    /// Corners in texels, moved by whole textures so that the smallest coordinates are in the first texture.
    texels: [DVec2; 3],
    /// Twice the area in texels, with the sign of the orientation.
    area: f64,
    /// Largest singular value of the Jacobian, in units of length a texel.
    stretch: f64,
}

impl Face {
    /// The triangle of `corners`, or none if it has no area in a texture of `scale` texels.
    fn new(mesh: &UvMesh, corners: [u32; 3], scale: DVec2) -> Option<Self> {
        let uvs = corners.map(|corner| mesh.uvs[corner as usize].as_dvec2());
        let first = uvs[0].min(uvs[1]).min(uvs[2]).floor();
        let texels = uvs.map(|uv| (uv - first) * scale);
        let (right, down) = (texels[1] - texels[0], texels[2] - texels[0]);
        let area = right.perp_dot(down);
        let longest = right.length().max(down.length()).max(right.distance(down));
        let largest = uvs.iter().map(|uv| (uv.abs() * scale).max_element()).fold(0.0, f64::max);
        let rounding = LEAST_HEIGHT_ULPS * f64::from(f32::EPSILON) * largest;
        if area.abs() <= rounding * longest {
            return None;
        }
        let points = corners.map(|corner| mesh.positions[corner as usize].as_dvec3());
        let stretch = largest_singular_value(jacobian(points, texels));
        Some(Face { corners, texels, area, stretch })
    }

    /// Columns and rows of the first texel touched and of the one after the last.
    fn bounds(&self) -> (DVec2, DVec2) {
        let [a, b, c] = self.texels;
        let low = a.min(b).min(c).floor();
        (low, a.max(b).max(c).ceil().max(low + 1.0))
    }

    /// Texels of the bounding box.
    fn visits(&self) -> f64 {
        let (low, high) = self.bounds();
        (high - low).element_product()
    }

    /// Draws the triangle with `values` at its corners where they are above what `map` has.
    fn draw(&self, values: [f64; 3], map: &mut Map, cancel: CancelCheck<'_>) {
        let (low, high) = self.bounds();
        let (rows, columns) = map.dim();
        let [a, b, c] = self.texels;
        let weights = [(b, c), (c, a), (a, b)].map(|(from, to)| Weight::new(from, to, self.area));
        for y in (low.y as usize..high.y as usize).take_while(|_| !cancel.is_cancelled()) {
            for x in low.x as usize..high.x as usize {
                let centre = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let shares = weights.each_ref().map(|weight| weight.at(centre));
                if shares.iter().zip(&weights).any(|(share, weight)| *share <= -weight.reach) {
                    continue;
                }
                let shares = shares.map(|share| share.max(0.0));
                let sum: f64 = shares.iter().zip(&values).map(|(share, value)| share * value).sum();
                let value = (sum / shares.iter().sum::<f64>()) as f32;
                let texel = &mut map[[y % rows, x % columns]];
                *texel = texel.max(value);
            }
        }
    }
}

/// One barycentric weight as a linear function of the place.
struct Weight {
    origin: DVec2,
    gradient: DVec2,
    /// How far below 0 the weight may be at a texel's centre while a corner of the texel is still inside.
    reach: f64,
}

impl Weight {
    /// The weight of the corner opposite the edge `from`-`to` in a triangle of twice the signed `area`.
    fn new(from: DVec2, to: DVec2, area: f64) -> Self {
        let gradient = (to - from).perp() / area;
        Weight { origin: from, gradient, reach: 0.5 * (gradient.x.abs() + gradient.y.abs()) }
    }

    fn at(&self, place: DVec2) -> f64 {
        self.gradient.dot(place - self.origin)
    }
}

/// dS/ds and dS/dt of the triangle with corners `points` in space and `texels` in the texture, which must have
/// some area there.
fn jacobian(points: [DVec3; 3], texels: [DVec2; 3]) -> [DVec3; 2] {
    let (right, down) = (texels[1] - texels[0], texels[2] - texels[0]);
    let (along, across) = (points[1] - points[0], points[2] - points[0]);
    let area = right.perp_dot(down);
    [(along * down.y - across * right.y) / area, (across * right.x - along * down.x) / area]
}

/// The largest |J v| over unit vectors v, J the 3x2 matrix with these columns.
fn largest_singular_value([s, t]: [DVec3; 2]) -> f64 {
    let (a, b, c) = (s.dot(s), s.dot(t), t.dot(t));
    (0.5 * ((a + c) + (a - c).hypot(2.0 * b))).sqrt()
}

/// The stretch at each corner, the largest being 1 (or all 0, if the mesh is a point in space).
fn corner_stretch(mesh: &UvMesh, faces: &[Face]) -> Vec<f64> {
    let mut numbers = HashMap::new();
    let place = |corner: usize| {
        let (p, uv) = (mesh.positions[corner], mesh.uvs[corner]);
        // Adding 0 turns -0 into 0.
        [p.x, p.y, p.z, uv.x, uv.y].map(|value| (value + 0.0).to_bits())
    };
    let merged: Vec<usize> =
        (0..mesh.uvs.len()).map(|corner| *numbers.entry(place(corner)).or_insert(corner)).collect();
    let mut sums = vec![(0.0, 0.0); merged.len()];
    for face in faces {
        for corner in face.corners {
            let sum = &mut sums[merged[corner as usize]];
            sum.0 += face.stretch * face.area.abs();
            sum.1 += face.area.abs();
        }
    }
    let mean = |&corner: &usize| if sums[corner].1 > 0.0 { sums[corner].0 / sums[corner].1 } else { 0.0 };
    let means: Vec<f64> = merged.iter().map(mean).collect();
    let max = means.iter().copied().fold(0.0, f64::max);
    if max > 0.0 { means.iter().map(|mean| mean / max).collect() } else { means }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Vec2, Vec3};
    use proptest::prelude::*;

    /// A strip of quads along x; `xs` are their borders in space, the borders in the texture are even.
    fn strip(xs: &[f32], low: Vec2, high: Vec2) -> UvMesh {
        let mut mesh = UvMesh::default();
        for (i, &x) in xs.iter().enumerate() {
            let u = low.x + (high.x - low.x) * i as f32 / (xs.len() - 1) as f32;
            mesh.positions.extend([Vec3::new(x, 0.0, 0.0), Vec3::new(x, 1.0, 0.0)]);
            mesh.uvs.extend([Vec2::new(u, low.y), Vec2::new(u, high.y)]);
        }
        for i in (0..2 * (xs.len() as u32 - 1)).step_by(2) {
            mesh.triangles.extend([[i, i + 2, i + 1], [i + 1, i + 2, i + 3]]);
        }
        mesh
    }

    fn whats(result: Result<Map, SourceError>) -> &'static str {
        match result {
            Err(SourceError::Guidance { map: "mesh", what }) => what,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn an_even_plane_is_even_where_it_covers() {
        let map =
            distortion_map(&strip(&[0.0, 1.0, 2.0], Vec2::splat(0.25), Vec2::splat(0.75)), 64, 32).unwrap();
        for ((y, x), &value) in map.indexed_iter() {
            let covered = (16..48).contains(&x) && (8..24).contains(&y);
            assert!((value - f32::from(u8::from(covered))).abs() < 1e-5, "{value} at {x}, {y}");
        }
    }

    #[test]
    fn a_strip_stretched_by_three_counts_three() {
        // Unstretched, a quad is 1/6 of the texture by 1/6 of a unit: both singular values are 1 a texture.
        let xs = [0.0, 1.0, 2.0, 3.0, 6.0, 9.0, 12.0].map(|x| x / 6.0);
        let map = distortion_map(&strip(&xs, Vec2::ZERO, Vec2::ONE), 96, 96).unwrap();
        for y in 0..96 {
            assert!((map[[y, 90]] / map[[y, 5]] - 3.0).abs() < 1e-4, "row {y}");
        }
        // The corners between touch two triangles of one half and one of the other: 5/9 above, 7/9 below.
        assert!((map[[1, 48]] - 5.0 / 9.0).abs() < 0.02 || (map[[1, 48]] - 7.0 / 9.0).abs() < 0.02);
        assert!((map[[1, 48]] + map[[94, 48]] - 4.0 / 3.0).abs() < 0.04);
    }

    #[test]
    fn texels_are_the_unit_of_images_that_are_not_square() {
        // 2x1 units of space on 128x64 texels: no stretch anywhere; on 64x64 twice along x.
        let mesh = strip(&[0.0, 2.0], Vec2::ZERO, Vec2::ONE);
        let face = |width| Face::new(&mesh, mesh.triangles[0], DVec2::new(width, 64.0)).unwrap();
        assert!((face(128.0).stretch - 1.0 / 64.0).abs() < 1e-9);
        assert!((face(64.0).stretch - 2.0 / 64.0).abs() < 1e-9);
    }

    #[test]
    fn coordinates_outside_repeat_the_texture() {
        let inside =
            distortion_map(&strip(&[0.0, 1.0, 4.0], Vec2::ZERO, Vec2::new(0.5, 0.5)), 32, 32).unwrap();
        for shift in [Vec2::new(-3.0, 7.0), Vec2::new(100.0, -1.0)] {
            let moved = strip(&[0.0, 1.0, 4.0], shift, shift + 0.5);
            assert_eq!(distortion_map(&moved, 32, 32).unwrap(), inside);
        }
        let across =
            distortion_map(&strip(&[0.0, 1.0], Vec2::new(0.75, 0.0), Vec2::new(1.25, 1.0)), 32, 32).unwrap();
        for (x, covered) in [(0, 1.0), (7, 1.0), (8, 0.0), (23, 0.0), (24, 1.0), (31, 1.0)] {
            assert!((across[[16, x]] - covered).abs() < 1e-5, "column {x}");
        }
    }

    #[test]
    fn overlapping_charts_take_the_larger() {
        let mut mesh = strip(&[0.0, 1.0], Vec2::ZERO, Vec2::ONE);
        let large = strip(&[0.0, 8.0], Vec2::ZERO, Vec2::new(0.5, 1.0));
        mesh.positions.extend(large.positions.iter().map(|p| *p + Vec3::Z));
        mesh.uvs.extend(large.uvs);
        mesh.triangles.extend(large.triangles.iter().map(|t| t.map(|i| i + 4)));
        let map = distortion_map(&mesh, 16, 16).unwrap();
        assert!((map[[8, 4]] - 1.0).abs() < 1e-5);
        assert!((map[[8, 12]] - 1.0 / 16.0).abs() < 1e-5);
    }

    #[test]
    fn triangles_without_texture_area_are_ignored() {
        let plain = strip(&[0.0, 1.0], Vec2::ZERO, Vec2::ONE);
        let mut mesh = plain.clone();
        mesh.positions.push(Vec3::splat(1e6));
        // On the diagonal, but for rounding.
        mesh.uvs.push(Vec2::new(0.4, 0.6));
        mesh.triangles.extend([[1, 2, 4], [0, 0, 4], [4, 4, 4]]);
        assert_eq!(distortion_map(&mesh, 64, 64).unwrap(), distortion_map(&plain, 64, 64).unwrap());
    }

    #[test]
    fn meshes_finer_than_texels_leave_no_holes() {
        let xs: Vec<f32> = (0..=1000).map(|i| i as f32).collect();
        let map = distortion_map(&strip(&xs, Vec2::ZERO, Vec2::ONE), 7, 5).unwrap();
        assert!(map.iter().all(|value| (value - 1.0).abs() < 1e-3));
    }

    #[test]
    fn corners_repeated_for_normals_are_one() {
        let mut mesh = strip(&[0.0, 1.0, 4.0, 16.0], Vec2::ZERO, Vec2::ONE);
        let whole = distortion_map(&mesh, 32, 32).unwrap();
        let corners: Vec<usize> = mesh.triangles.iter().flatten().map(|&i| i as usize).collect();
        mesh.positions = corners.iter().map(|&i| mesh.positions[i]).collect();
        mesh.uvs = corners.iter().map(|&i| mesh.uvs[i]).collect();
        mesh.triangles = (0..corners.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        assert_eq!(distortion_map(&mesh, 32, 32).unwrap(), whole);
    }

    #[test]
    fn unusable_meshes_are_named() {
        let plain = strip(&[0.0, 1.0], Vec2::ZERO, Vec2::ONE);
        let wrong = UvMesh { triangles: vec![[0, 1, 4]], ..plain.clone() };
        assert!(whats(distortion_map(&wrong, 8, 8)).contains("do not agree"));
        for empty in [UvMesh::default(), UvMesh { triangles: vec![[0, 1, 1]], ..plain }] {
            assert!(whats(distortion_map(&empty, 8, 8)).contains("no triangle"));
        }
        for side in [1e4, 1e9, 1e30, f32::MAX] {
            let enormous = strip(&[0.0, 1.0], Vec2::ZERO, Vec2::splat(side));
            assert!(whats(distortion_map(&enormous, 256, 256)).contains("too often"), "side {side}");
        }
    }

    #[test]
    fn a_mesh_without_size_in_space_gives_zeros() {
        let mut mesh = strip(&[0.0, 1.0], Vec2::ZERO, Vec2::ONE);
        mesh.positions.fill(Vec3::ONE);
        assert_eq!(distortion_map(&mesh, 8, 8).unwrap(), Map::zeros((8, 8)));
    }

    proptest! {
        #[test]
        fn the_singular_value_is_the_largest_stretch(
            p in prop::array::uniform9(-10.0..10.0_f64),
            t in prop::array::uniform6(0.0..100.0_f64),
        ) {
            let points = [0, 3, 6].map(|i| DVec3::new(p[i], p[i + 1], p[i + 2]));
            let texels = [0, 2, 4].map(|i| DVec2::new(t[i], t[i + 1]));
            prop_assume!((texels[1] - texels[0]).perp_dot(texels[2] - texels[0]).abs() > 1e-3);
            let [ds, dt] = jacobian(points, texels);
            // The Jacobian maps the texture's edges to the edges in space.
            for i in [1, 2] {
                let edge = texels[i] - texels[0];
                let mapped = ds * edge.x + dt * edge.y;
                prop_assert!(mapped.distance(points[i] - points[0]) < 1e-6);
            }
            let stretch = |i: u32| {
                let (sin, cos) = (f64::from(i) * std::f64::consts::PI / 3600.0).sin_cos();
                (ds * cos + dt * sin).length()
            };
            let brute = (0..3600).map(stretch).fold(0.0, f64::max);
            let exact = largest_singular_value([ds, dt]);
            // Between two of the directions the stretch exceeds both by a factor of 1 / cos(half a step) at most.
            prop_assert!(brute <= exact * (1.0 + 1e-9));
            prop_assert!(exact <= brute * (1.0 + 1e-6), "{exact} above {brute}");
        }
    }
}
