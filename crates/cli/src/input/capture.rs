//! Captures: `transforms.json` (the convention of NeRF and nerfstudio: intrinsics in pixels, matrices from camera to
//! world with OpenGL axes), COLMAP's models, OpenMVS's scenes, Metashape's XML or Middlebury's `*_par.txt`, the images that these name, and `mesh.obj`, `.ply`, `.glb` or `.gltf` or the
//! mesh of COLMAP or OpenMVS in the cameras' space. Photographs of lenses that distort are undistorted.

use std::error::Error;
use std::path::{Path, PathBuf};

use glam::{Mat4, Vec2, Vec4};
use rayon::prelude::*;
use serde::Deserialize;
use texfold::{
    core::{Camera, Capture, Mesh, Photograph},
    lightfield::simplify_mesh,
};

use super::lens::{Distortion, Lens};
use super::{colmap, metashape, middlebury, openmvs, pixels, shape};
use crate::error::CliError;
use crate::files;
use crate::memory;

/// The cameras of NeRF and nerfstudio, which make a folder a capture.
const CAMERAS_NAME: &str = "transforms.json";
/// Cameras of photographs that are kept for tests, as NeRF's captures have them.
const TEST_NAME: &str = "transforms_test.json";
/// Names of meshes, in the order in which they are looked for; the last ones are COLMAP's and OpenMVS's.
const MESH_NAMES: [&str; 10] = [
    "mesh.obj",
    "mesh.ply",
    "mesh.glb",
    "mesh.gltf",
    "meshed-poisson.ply",
    "meshed-delaunay.ply",
    "scene_dense_mesh_refine.ply",
    "scene_dense_mesh.ply",
    "scene_mesh_refine.ply",
    "scene_mesh.ply",
];

#[derive(Debug, Deserialize)]
struct Frame {
    file_path: String,
    transform_matrix: [[f32; 4]; 4],
    #[serde(flatten)]
    lens: Lens,
}

#[derive(Debug, Deserialize)]
struct Cameras {
    #[serde(flatten)]
    lens: Lens,
    frames: Vec<Frame>,
}

/// A camera of a file, and the image that it names.
#[derive(Debug, Clone)]
pub(crate) struct Shot {
    pub(crate) image: PathBuf,
    frame: usize,
    lens: Lens,
    distortion: Option<Distortion>,
    to_world: Mat4,
}

/// Reads a file of cameras: Middlebury's where its name ends in `_par.txt`, COLMAP's where it ends in `.txt` or `.bin`, OpenMVS's in `.mvs`,
/// Metashape's in `.xml`, else `transforms.json`.
pub(crate) fn read_cameras(path: &Path) -> Result<Vec<Shot>, CliError> {
    let ends_in =
        |extension: &str| path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension));
    let shots = if middlebury::is_table(path) {
        middlebury::read(path)
    } else if openmvs::is_scene(path) {
        openmvs::read(path)
    } else if metashape::is_cameras(path) {
        metashape::read(path)
    } else if ends_in("txt") || ends_in("bin") {
        colmap::read(path)
    } else {
        read_transforms(path)
    }?;
    if shots.is_empty() {
        return Err(CliError::CameraContent { path: path.to_owned(), what: "names no frame" });
    }
    Ok(shots)
}

fn read_transforms(path: &Path) -> Result<Vec<Shot>, CliError> {
    let text = files::read(path)?;
    let cameras: Cameras = serde_json::from_slice(&text)
        .map_err(|source| CliError::Cameras { path: path.to_owned(), source: source.into() })?;
    let dir = path.parent().unwrap_or(Path::new(""));
    let shot = |(frame, found): (usize, Frame)| {
        let [x, y, z, w] = found.transform_matrix.map(Vec4::from);
        let to_world = Mat4::from_cols(x, y, z, w).transpose();
        Shot::new(image_path(dir, &found.file_path), frame, found.lens.or(&cameras.lens), to_world)
            .map_err(|what| CliError::CameraContent { path: path.to_owned(), what })
    };
    cameras.frames.into_iter().enumerate().map(shot).collect()
}

/// NeRF's own files leave the extension out.
fn image_path(dir: &Path, name: &str) -> PathBuf {
    let path = dir.join(name);
    if path.extension().is_some() || path.is_file() { path } else { path.with_extension("png") }
}

impl Shot {
    /// A camera of the image at `image`, number `frame` of its file.
    ///
    /// # Errors
    /// A phrase for a lens that cannot be undistorted.
    pub(super) fn new(
        image: PathBuf,
        frame: usize,
        lens: Lens,
        to_world: Mat4,
    ) -> Result<Shot, &'static str> {
        Ok(Shot { image, frame, distortion: lens.distortion()?, lens, to_world })
    }

    /// The pinhole camera, for an image of `size` pixels where the file does not say; `file` is named in errors.
    pub(crate) fn camera(&self, file: &Path, size: Option<(u32, u32)>) -> Result<Camera, CliError> {
        let fault = |what| CliError::CameraContent { path: file.to_owned(), what };
        let side = |said: Option<f32>, found: Option<u32>| match (said, found) {
            (Some(said), _) if (1.0..65536.0).contains(&said) => Ok(said as u32),
            (None, Some(found)) => Ok(found),
            _ => Err(fault("has no image size; add w and h")),
        };
        let (width, height) = (side(self.lens.w, size.map(|s| s.0))?, side(self.lens.h, size.map(|s| s.1))?);
        let (w, h) = (width as f32, height as f32);
        let by_angle = self.lens.camera_angle_x.map(|angle| 0.5 * w / (0.5 * angle).tan());
        let focal = self.lens.fl_x.or(by_angle).ok_or(fault("has no focal length; add fl_x"))?;
        let camera = Camera {
            width,
            height,
            focal: Vec2::new(focal, self.lens.fl_y.unwrap_or(focal)),
            centre: Vec2::new(self.lens.cx.unwrap_or(0.5 * w), self.lens.cy.unwrap_or(0.5 * h)),
            to_world: self.to_world,
        };
        if !camera.is_valid() {
            return Err(CliError::SingularCamera { path: file.to_owned(), frame: self.frame });
        }
        Ok(camera)
    }
}

/// True for the folder of a capture.
pub(crate) fn is_capture(dir: &Path) -> bool {
    camera_files(dir).iter().all(|file| file.exists())
}

/// The files of a capture's cameras, that of the poses first: `transforms.json`, else the model of COLMAP, the scene of OpenMVS, the file of
/// Metashape or the table of Middlebury that is there; `transforms.json` where there is none.
pub(crate) fn camera_files(dir: &Path) -> Vec<PathBuf> {
    let transforms = vec![dir.join(CAMERAS_NAME)];
    let models = colmap::FOLDERS.into_iter().flat_map(|folder| {
        let names = colmap::NAMES.into_iter();
        names.map(move |names| names.map(|name| dir.join(folder).join(name)).to_vec())
    });
    let finders = [openmvs::scene, metashape::cameras, middlebury::table];
    let others = finders.into_iter().filter_map(|find| find(dir)).map(|file| vec![file]);
    let mut all = [transforms.clone()].into_iter().chain(models).chain(others);
    all.find(|files| files.iter().all(|file| file.is_file())).unwrap_or(transforms)
}

/// The file of cameras whose photographs a capture keeps for tests, where it has one.
pub(crate) fn test_cameras(dir: &Path) -> Option<PathBuf> {
    Some(dir.join(TEST_NAME)).filter(|file| file.is_file())
}

/// The images of a capture's folder, in the order of its cameras.
pub(crate) fn image_files(dir: &Path) -> Result<Vec<PathBuf>, CliError> {
    Ok(read_cameras(&camera_files(dir)[0])?.into_iter().map(|shot| shot.image).collect())
}

/// The mesh file of a capture: the one given, or its own.
pub(crate) fn mesh_file(dir: &Path, given: Option<&Path>) -> Result<PathBuf, CliError> {
    if let Some(mesh) = given {
        return Ok(mesh.to_owned());
    }
    let found = MESH_NAMES.iter().map(|name| dir.join(name)).find(|path| path.is_file());
    found.ok_or(CliError::NoMesh { path: dir.to_owned(), name: MESH_NAMES.join(" or ") })
}

/// Reads a capture's folder, its mesh simplified to so many triangles where that is given.
///
/// # Errors
/// What is wrong with its files, by name.
pub fn read_capture(dir: &Path, triangles: Option<u32>) -> Result<Capture, Box<dyn Error + Send + Sync>> {
    Ok(read(dir, None, triangles, memory::limit(None))?)
}

/// Reads the photographs that a file of cameras names.
///
/// # Errors
/// What is wrong with its files, by name.
pub fn read_views(cameras: &Path) -> Result<Vec<Photograph>, Box<dyn Error + Send + Sync>> {
    Ok(read_all(cameras)?)
}

/// As [`read_views`].
pub(crate) fn read_all(cameras: &Path) -> Result<Vec<Photograph>, CliError> {
    let shots = read_cameras(cameras)?;
    shots.iter().map(|shot| view(cameras, shot, memory::limit(None))).collect()
}

/// Reads at most `count` of the photographs that a file of cameras names, spread over all.
pub(crate) fn read_some(cameras: &Path, count: usize) -> Result<Vec<Photograph>, CliError> {
    let shots = read_cameras(cameras)?;
    let step = shots.len().div_ceil(count).max(1);
    shots.iter().step_by(step).map(|shot| view(cameras, shot, memory::limit(None))).collect()
}

/// Reads a whole capture.
pub(crate) fn read(
    dir: &Path,
    mesh: Option<&Path>,
    triangles: Option<u32>,
    limit_bytes: u64,
) -> Result<Capture, CliError> {
    let file = camera_files(dir).swap_remove(0);
    let shots = read_cameras(&file)?;
    let mesh: Mesh = shape::read(&mesh_file(dir, mesh)?)?;
    let mesh = match triangles {
        Some(count) => simplify_mesh(&mesh, count as usize),
        None => mesh,
    };
    let views: Result<Vec<Photograph>, CliError> =
        shots.par_iter().map(|shot| view(&file, shot, limit_bytes)).collect();
    Ok(Capture { mesh, views: views? })
}

fn view(file: &Path, shot: &Shot, limit_bytes: u64) -> Result<Photograph, CliError> {
    let raster = pixels::read_stored(&shot.image, limit_bytes)?;
    let size = raster.size();
    let camera = shot.camera(file, Some((size.width, size.height)))?;
    if (camera.width, camera.height) != (size.width, size.height) {
        return Err(CliError::ImageSize {
            path: shot.image.clone(),
            width: size.width,
            height: size.height,
            wanted: (camera.width, camera.height),
        });
    }
    let pixels = raster.texels().map(|texel| texel.to_array().map(texfold_core::image::to_u8)).collect();
    let photo = Photograph { camera, pixels };
    Ok(match shot.distortion {
        Some(distortion) => distortion.undistorted(&photo),
        None => photo,
    })
}
