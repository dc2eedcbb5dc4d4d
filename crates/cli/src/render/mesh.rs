//! A mesh with an image of a texture on it, as cameras around it or of a file see it.

use std::f32::consts::{PI, TAU};

use glam::{Mat4, UVec2, Vec2, Vec3, Vec4};
use texfold::AnyImage;
use texfold::core::{Camera, Mesh};
use texfold_capture::{read_mesh, read_uv_mesh};
use texfold_core::RegionError;
use texfold_core::address::{TEXFOLD_REPEAT, texfold_level, texfold_lod, texfold_tap};
use texfold_core::image::{Alpha, Raster};
use texfold_core::mesh::UvMesh;
use texfold_core::metric::decode_image;
use texfold_core::sample::{texfold_bilinear, texfold_mix};
use texfold_gpu::{AddressMode, Gpu, GpuError, Policy};

use super::{NUMBER_DIGITS, RenderArgs, cameras};
use crate::config::Sides;
use crate::console::warn;
use crate::decompress;
use crate::error::CliError;
use crate::memory;
use crate::output::{make_folder, remove_stale};
use crate::png;

/// Size of images where nobody says.
const SIZE: (u32, u32) = (640, 480);
/// Focal length of a turntable's cameras, in heights of the image: 45 degrees from top to bottom.
const FOCAL: f32 = 1.207;
/// Height of these cameras over the middle of the mesh, as a part of their distance.
const LIFT: f32 = 0.35;
/// Bytes of a decoded texel, its mip levels and what decodes them.
const BYTES_PER_TEXEL: u64 = 48;
/// Nearest depth, as a part of the farthest.
const NEAREST: f32 = 1e-3;

/// Sine of the angle from a pole within which a corner has no longitude.
const POLE: f32 = 1e-4;

/// Runs `render` with `--mesh`.
pub(super) fn run(args: &RenderArgs, path: &std::path::Path) -> Result<usize, CliError> {
    let texture = decompress::load(&args.file, &args.memory.limits())?;
    let mesh = match read_uv_mesh(path) {
        Err(error) if error.lacks_coordinates() => {
            let mapped = around(&read_mesh(path)?);
            let path = path.display();
            warn(&format!(
                "{path}: no texture coordinates are read; longitude and latitude around its middle take their place"
            ));
            mapped
        }
        read => read?,
    };
    let (middle, radius) = bounds(&mesh.positions);
    let size = args.size.map_or(SIZE, |Sides(width, height)| (width.max(1), height.max(1)));
    let cameras = match &args.camera {
        Some(path) => cameras(path, args.size)?,
        None => turntable(args.turntable.unwrap_or(1), (middle, radius), size),
    };
    make_folder(&args.out)?;
    remove_stale(&args.out);
    let digits = NUMBER_DIGITS.max((cameras.len().max(1) - 1).to_string().len());
    let mut draw = artist(args, &texture, &mesh)?;
    for (number, camera) in cameras.iter().enumerate() {
        let far = camera.eye().distance(middle) + radius;
        let near = (camera.eye().distance(middle) - radius).max(NEAREST * far);
        let pixels = draw(camera.view_projection(near, far), (camera.width, camera.height))?;
        let info = texture.as_encoded().layout().pixel;
        let raster = Raster::from_u8(camera.width, camera.height, 4, info.color, pixels.as_flattened())
            .map_err(|source| CliError::Source { path: args.file.clone(), source })?;
        let path = args.out.join(format!("{number:0digits$}.png"));
        png::write(&path, &raster.tagged(info.color, Alpha::Straight))?;
    }
    Ok(0)
}

/// The mesh with longitude and latitude around its middle as texture coordinates, y up; each triangle has corners of its own.
fn around(mesh: &Mesh) -> UvMesh {
    let (middle, _) = bounds(&mesh.positions);
    let mut mapped = UvMesh::default();
    for triangle in &mesh.triangles {
        let corners = triangle.map(|index| mesh.positions[index as usize]);
        let seen = corners.map(|corner| (corner - middle).normalize_or_zero());
        let longitude = |at: Vec3| at.x.atan2(at.z) / TAU + 0.5;
        // At a pole that of the triangle's middle, and none further from it than half a turn.
        let of_middle = longitude(seen.iter().sum());
        for (corner, at) in corners.into_iter().zip(seen) {
            let off = if at.x.hypot(at.z) < POLE { 0.0 } else { longitude(at) - of_middle };
            let u = of_middle + off - off.round();
            mapped.positions.push(corner);
            mapped.uvs.push(Vec2::new(u, at.y.clamp(-1.0, 1.0).acos() / PI));
        }
        let first = mapped.positions.len() as u32 - 3;
        mapped.triangles.push([first, first + 1, first + 2]);
    }
    mapped
}

/// Middle and radius of a ball around all corners.
fn bounds(positions: &[Vec3]) -> (Vec3, f32) {
    let low = positions.iter().copied().reduce(Vec3::min).unwrap_or(Vec3::ZERO);
    let high = positions.iter().copied().reduce(Vec3::max).unwrap_or(Vec3::ZERO);
    let middle = 0.5 * (low + high);
    let radius = positions.iter().map(|corner| corner.distance(middle)).fold(0.0, f32::max);
    (middle, radius.max(f32::MIN_POSITIVE))
}

/// Cameras on a circle around a ball, which fills their images; y is up.
fn turntable(count: u32, (middle, radius): (Vec3, f32), (width, height): (u32, u32)) -> Vec<Camera> {
    let size = Vec2::new(width as f32, height as f32);
    let focal = FOCAL * size.min_element();
    // The sine of half of the angle of the shorter side.
    let half = 0.5 / FOCAL;
    let distance = radius / (half / (1.0 + half * half).sqrt());
    let camera = |number: u32| {
        let angle = TAU * number as f32 / count as f32;
        let back = Vec3::new(angle.sin(), LIFT, angle.cos()).normalize();
        let right = Vec3::Y.cross(back).normalize();
        let up = back.cross(right);
        let eye = middle + distance * back;
        let to_world = Mat4::from_cols(right.extend(0.0), up.extend(0.0), back.extend(0.0), eye.extend(1.0));
        Camera { width, height, focal: Vec2::splat(focal), centre: 0.5 * size, to_world }
    };
    (0..count).map(camera).collect()
}

type Artist<'t> = Box<dyn FnMut(Mat4, (u32, u32)) -> Result<Vec<[u8; 4]>, CliError> + 't>;

/// The reference, or a GPU.
fn artist<'t>(args: &'t RenderArgs, texture: &'t AnyImage, mesh: &'t UvMesh) -> Result<Artist<'t>, CliError> {
    let images = texture.as_encoded().layout().images.len();
    if args.image as usize >= images {
        let source = RegionError::NoSuchImage { image: args.image, images };
        return Err(CliError::Region { path: args.file.clone(), source });
    }
    if args.cpu {
        let size = texture.as_encoded().layout().images[args.image as usize];
        memory::check(&args.file, size.texels().saturating_mul(BYTES_PER_TEXEL), args.memory.bytes())?;
        let levels = Levels::new(texture, args.image);
        return Ok(Box::new(move |camera, size| Ok(levels.draw(mesh, camera, size))));
    }
    let device =
        Gpu::new(Policy::from_env()).map_err(|source| CliError::NoDrawing { source: Box::new(source) })?;
    let failed =
        |source: GpuError| CliError::GpuDrawing { path: args.file.clone(), source: Box::new(source) };
    let uploaded = device.upload(&texture.as_encoded().gpu()).map_err(failed)?;
    let uploaded = uploaded.with_address_mode(AddressMode::Repeat);
    Ok(Box::new(move |camera, size| {
        device.draw_mesh(&uploaded, args.image, mesh, camera, size).map_err(failed)
    }))
}

/// The decoded mip levels of an image: the reference.
struct Levels(Vec<(UVec2, Vec<Vec4>)>);

/// A corner in clip space.
type Corner = (Vec4, Vec2);

impl Levels {
    fn new(texture: &AnyImage, image: u32) -> Levels {
        let encoded = texture.as_encoded();
        let level = |level: u32| {
            let raster = decode_image(encoded, image, level)?;
            let size = UVec2::new(raster.size().width, raster.size().height);
            Some((size, raster.texels().collect()))
        };
        Levels((0..encoded.layout().levels).filter_map(level).collect())
    }

    fn bilinear(&self, level: u32, uv: Vec2) -> Vec4 {
        let (size, texels) = &self.0[level as usize];
        let tap = texfold_tap(uv, *size, TEXFOLD_REPEAT);
        let texel = |x: u32, y: u32| texels[(y * size.x + x) as usize];
        let four = [
            texel(tap.low.x, tap.low.y),
            texel(tap.high.x, tap.low.y),
            texel(tap.low.x, tap.high.y),
            texel(tap.high.x, tap.high.y),
        ];
        texfold_bilinear(four, tap.weight)
    }

    /// Trilinear, of a footprint with these changes of `uv` across a pixel.
    fn sample(&self, uv: Vec2, across: Vec2, down: Vec2) -> Vec4 {
        let levels = self.0.len() as u32;
        let lod = texfold_lod(texfold_level(across, down, self.0[0].0), levels);
        let level = (lod as u32).min(levels - 1);
        let fine = self.bilinear(level, uv);
        if level + 1 == levels {
            return fine;
        }
        texfold_mix(fine, self.bilinear(level + 1, uv), lod - level as f32)
    }

    /// The mesh on transparent black, the nearest triangle in front, both sides alike.
    fn draw(&self, mesh: &UvMesh, camera: Mat4, (width, height): (u32, u32)) -> Vec<[u8; 4]> {
        let mut pixels = vec![[0; 4]; width as usize * height as usize];
        let mut depths = vec![1.0f32; pixels.len()];
        if self.0.is_empty() {
            return pixels;
        }
        for triangle in &mesh.triangles {
            let corner =
                |index: u32| (camera * mesh.positions[index as usize].extend(1.0), mesh.uvs[index as usize]);
            let polygon = before_near(&triangle.map(corner));
            for pair in polygon.windows(2).skip(1) {
                let corners = [polygon[0], pair[0], pair[1]];
                self.fill(&corners, (width, height), &mut pixels, &mut depths);
            }
        }
        pixels
    }

    /// Draws a triangle before the nearest depth.
    fn fill(
        &self,
        corners: &[Corner; 3],
        (width, height): (u32, u32),
        pixels: &mut [[u8; 4]],
        depths: &mut [f32],
    ) {
        let size = Vec2::new(width as f32, height as f32);
        let place = |clip: Vec4| (Vec2::new(clip.x, -clip.y) / clip.w * 0.5 + 0.5) * size;
        let places = corners.map(|(clip, _)| place(clip));
        let area = (places[1] - places[0]).perp_dot(places[2] - places[0]);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        // Of a pixel: shares of the corners in perspective, and depth.
        let at = |pixel: Vec2| {
            let share =
                |one: usize, other: usize| (places[one] - pixel).perp_dot(places[other] - pixel) / area;
            let shares = Vec3::new(share(1, 2), share(2, 0), share(0, 1));
            let inverse = Vec3::from_array(corners.map(|(clip, _)| 1.0 / clip.w));
            let depth = shares.dot(Vec3::from_array(corners.map(|(clip, _)| clip.z / clip.w)));
            let weights = shares * inverse;
            let uv = (0..3).map(|corner| weights[corner] * corners[corner].1).sum::<Vec2>();
            (shares, depth, uv / (weights.x + weights.y + weights.z))
        };
        let low = places.into_iter().reduce(Vec2::min).unwrap_or(Vec2::ZERO).max(Vec2::ZERO).as_uvec2();
        let high = places.into_iter().reduce(Vec2::max).unwrap_or(Vec2::ZERO).min(size).ceil().as_uvec2();
        for (y, x) in (low.y..high.y).flat_map(|y| (low.x..high.x).map(move |x| (y, x))) {
            let pixel = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let (shares, depth, uv) = at(pixel);
            let number = (y * width + x) as usize;
            if shares.min_element() < 0.0 || depth >= depths[number] || depth < 0.0 {
                continue;
            }
            depths[number] = depth;
            let (across, down) = (at(pixel + Vec2::X).2 - uv, at(pixel + Vec2::Y).2 - uv);
            let colour = self.sample(uv, across, down).clamp(Vec4::ZERO, Vec4::ONE);
            pixels[number] = colour.to_array().map(|value| (255.0 * value + 0.5) as u8);
        }
    }
}

/// The part of a triangle that lies before the nearest depth: up to four corners.
fn before_near(corners: &[Corner; 3]) -> Vec<Corner> {
    let mut polygon = Vec::new();
    for (&one, &other) in corners.iter().zip(corners.iter().cycle().skip(1)) {
        if one.0.z >= 0.0 {
            polygon.push(one);
        }
        if (one.0.z >= 0.0) != (other.0.z >= 0.0) {
            let share = one.0.z / (one.0.z - other.0.z);
            polygon.push((one.0.lerp(other.0, share), one.1.lerp(other.1, share)));
        }
    }
    polygon
}
