//! Captures made by code: an object whose colour is known in closed form, photographed from all around.

use glam::{Mat4, Quat, Vec2, Vec3};
use texfold_core::{Camera, Capture, Mesh, Photograph};

use crate::fixtures::sin_turns;

/// Rays a pixel across and down.
const RAYS: u32 = 2;

/// What an object looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// A pattern with a highlight that moves with the eye.
    Glossy,
    /// The pattern alone.
    Diffuse,
    /// The pattern, finer, of the direction that it reflects.
    Mirror,
    /// Nothing but black.
    Black,
}

/// Where the light comes from.
fn light() -> Vec3 {
    Vec3::new(0.4, 0.7, 0.6).normalize()
}

impl Look {
    /// The colour at a place with a smooth normal, towards a unit vector.
    #[must_use]
    pub fn colour(self, place: Vec3, normal: Vec3, direction: Vec3) -> Vec3 {
        let wave =
            |at: Vec3| (at * Vec3::new(0.8, 0.64, 0.48)).map(sin_turns) * 0.2 + Vec3::new(0.4, 0.35, 0.3);
        let reflected = 2.0 * direction.dot(normal) * normal - direction;
        // The 24th power, about 20 degrees wide, by products, which are the same on every machine.
        let eighth = [0; 3].iter().fold(reflected.dot(light()).max(0.0), |power, _| power * power);
        let highlight = 0.5 * eighth * eighth * eighth;
        match self {
            Look::Glossy => wave(place) + highlight,
            Look::Diffuse => wave(place),
            Look::Mirror => wave(2.0 * reflected),
            Look::Black => Vec3::ZERO,
        }
    }
}

/// A sphere of 20 times 4 to the power of `subdivisions` triangles around the origin.
#[must_use]
pub fn icosphere(subdivisions: u32) -> Mesh {
    let golden = 0.5 * (1.0 + 5f32.sqrt());
    let mut positions: Vec<Vec3> = Vec::new();
    for (a, b) in [(-1.0, golden), (1.0, golden), (-1.0, -golden), (1.0, -golden)] {
        positions.extend([Vec3::new(a, b, 0.0), Vec3::new(0.0, a, b), Vec3::new(b, 0.0, a)]);
    }
    positions.iter_mut().for_each(|place| *place = place.normalize());
    // The faces are the triples of mutually nearest corners, turned outwards.
    let side = positions[0].distance(positions[3]).min(positions[0].distance(positions[1])) * 1.05;
    let near = |a: usize, b: usize, positions: &[Vec3]| positions[a].distance(positions[b]) < side;
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b, &positions) && near(b, c, &positions) && near(c, a, &positions) {
                    let [p, q, r] = [a, b, c].map(|index| positions[index]);
                    let outwards = (q - p).cross(r - p).dot(p) > 0.0;
                    let [a, b, c] = [a, b, c].map(|index| index as u32);
                    triangles.push(if outwards { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }
    for _ in 0..subdivisions {
        let mut middles = std::collections::BTreeMap::new();
        let mut finer = Vec::new();
        for [a, b, c] in triangles {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(a, b)| {
                *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    positions.push(positions[a as usize].midpoint(positions[b as usize]).normalize());
                    positions.len() as u32 - 1
                })
            });
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    Mesh { positions, triangles }
}

/// A camera at `eye` that looks at the origin, where a unit sphere fills most of an image of `size` pixels a side.
#[must_use]
pub fn camera(eye: Vec3, size: u32) -> Camera {
    let back = eye.normalize();
    let right = back.any_orthonormal_vector();
    let rotation = Quat::from_mat3(&glam::Mat3::from_cols(right, back.cross(right), back));
    let focal = 0.4 * size as f32 * eye.length();
    Camera {
        width: size,
        height: size,
        focal: Vec2::splat(focal),
        centre: Vec2::splat(0.5 * size as f32),
        to_world: Mat4::from_rotation_translation(rotation, eye),
    }
}

/// Places around the origin, `count` of them evenly spread at `distance` (a Fibonacci lattice), turned by `phase`.
#[must_use]
pub fn eyes(count: u32, distance: f32, phase: f32) -> Vec<Vec3> {
    let golden_turns = 0.5 * (3.0 - 5f32.sqrt());
    (0..count)
        .map(|index| {
            let z = 1.0 - (2 * index + 1) as f32 / count as f32;
            let turns = golden_turns * index as f32 + phase / std::f32::consts::TAU;
            let (sine, cosine) = (sin_turns(turns), sin_turns(turns + 0.25));
            let radius = (1.0 - z * z).sqrt();
            distance * Vec3::new(radius * cosine, radius * sine, z)
        })
        .collect()
}

/// A photograph of `mesh`: a few rays a pixel, each against every triangle.
#[must_use]
pub fn photograph(mesh: &Mesh, look: Look, camera: Camera) -> Photograph {
    let normals = mesh.normals();
    let eye = camera.eye();
    let mut pixels = Vec::new();
    for (y, x) in (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (y, x))) {
        let (mut sum, mut hits) = (Vec3::ZERO, 0u32);
        for (j, i) in (0..RAYS).flat_map(|j| (0..RAYS).map(move |i| (j, i))) {
            let offset = (Vec2::new(i as f32, j as f32) + 0.5) / RAYS as f32;
            let ray = camera.ray(Vec2::new(x as f32, y as f32) + offset);
            if let Some((place, normal)) = nearest(mesh, &normals, eye, ray) {
                sum += look.colour(place, normal, -ray);
                hits += 1;
            }
        }
        let colour = sum / hits.max(1) as f32 * 255.0;
        let [red, green, blue] = colour.to_array().map(|value| value.round().clamp(0.0, 255.0) as u8);
        pixels.push([red, green, blue, (255 * hits / (RAYS * RAYS)) as u8]);
    }
    Photograph { camera, pixels }
}

/// Place and smooth normal of the nearest triangle along a ray.
fn nearest(mesh: &Mesh, normals: &[Vec3], eye: Vec3, ray: Vec3) -> Option<(Vec3, Vec3)> {
    // Nothing lies outside of the unit sphere.
    let closest = eye - eye.dot(ray) * ray;
    if closest.length_squared() > 1.0 {
        return None;
    }
    let mut best: Option<(f32, Vec3)> = None;
    for &triangle in &mesh.triangles {
        let [a, b, c] = mesh.corners(triangle);
        let (ab, ac) = (b - a, c - a);
        let across = ray.cross(ac);
        let scale = ab.dot(across);
        let u = (eye - a).dot(across) / scale;
        let other = (eye - a).cross(ab);
        let v = ray.dot(other) / scale;
        let distance = ac.dot(other) / scale;
        let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 0.0;
        if inside && best.is_none_or(|(nearest, _)| distance < nearest) {
            let [p, q, r] = triangle.map(|index| normals[index as usize]);
            best = Some((distance, (p * (1.0 - u - v) + q * u + r * v).normalize_or_zero()));
        }
    }
    best.map(|(distance, normal)| (eye + distance * ray, normal))
}

/// A sphere of 80 triangles in `views` photographs of `size` pixels a side, from all around.
#[must_use]
pub fn sphere(look: Look, views: u32, size: u32) -> Capture {
    let mesh = icosphere(1);
    let views = eyes(views, 4.0, 0.0).into_iter();
    let views = views.map(|eye| photograph(&mesh, look, camera(eye, size))).collect();
    Capture { mesh, views }
}

/// A capture as the text of its `transforms.json`, which names its photographs `images/00.png` and so on.
#[must_use]
pub fn cameras_text(capture: &Capture) -> String {
    let mut frames = Vec::new();
    for (index, view) in capture.views.iter().enumerate() {
        let rows = view.camera.to_world.transpose().to_cols_array_2d();
        let rows = rows.map(|row| format!("[{}]", row.map(|value| format!("{value:?}")).join(", ")));
        frames.push(format!(
            "    {{ \"file_path\": \"images/{index:02}.png\", \"transform_matrix\": [{}] }}",
            rows.join(", ")
        ));
    }
    let (focal, width, height) = capture
        .views
        .first()
        .map_or((1.0, 1, 1), |view| (view.camera.focal.x, view.camera.width, view.camera.height));
    let head = format!("  \"fl_x\": {focal:?},\n  \"w\": {width},\n  \"h\": {height},\n");
    format!("{{\n{head}  \"frames\": [\n{}\n  ]\n}}\n", frames.join(",\n"))
}

/// A mesh as the text of an OBJ file.
#[must_use]
pub fn mesh_text(mesh: &Mesh) -> String {
    let places = mesh.positions.iter().map(|p| format!("v {:?} {:?} {:?}\n", p.x, p.y, p.z));
    let faces = mesh.triangles.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    places.chain(faces).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spheres_are_closed_and_turned_outwards() {
        for subdivisions in 0..3 {
            let mesh = icosphere(subdivisions);
            assert_eq!(mesh.triangles.len(), 20 << (2 * subdivisions));
            assert_eq!(mesh.positions.len(), mesh.triangles.len() / 2 + 2);
            for &triangle in &mesh.triangles {
                let [a, b, c] = mesh.corners(triangle);
                assert!((b - a).cross(c - a).dot(a) > 0.0);
            }
        }
    }

    #[test]
    fn photographs_show_the_object_in_the_middle_and_nothing_around_it() {
        let capture = sphere(Look::Glossy, 3, 16);
        for view in &capture.views {
            assert_eq!(view.pixels[0], [0; 4]);
            assert_eq!(view.pixels[8 * 16 + 8][3], 255);
            let shown = view.pixels.iter().filter(|pixel| pixel[3] == 255).count();
            assert!((80..160).contains(&shown), "{shown}");
        }
    }
}
