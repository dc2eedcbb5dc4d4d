//! Captures: folders of photographs, their cameras and a mesh, as light fields are made of.
//!
//! Cameras are those of COLMAP's models (text and binary), `transforms.json` (NeRF, nerfstudio, instant-ngp: intrinsics in pixels, matrices from
//! camera to world with OpenGL axes), OpenMVS's scenes, Metashape's XML and Middlebury's `*_par.txt`; meshes are `mesh.obj`, `.ply`, `.glb` or `.gltf`, or
//! the mesh of COLMAP or OpenMVS, in the cameras' space. Photographs of lenses that distort are undistorted.
//!
//! ```no_run
//! # fn main() -> Result<(), texfold_capture::CaptureError> {
//! let capture = texfold_capture::read("garden".as_ref(), None, Some(20_000), texfold_capture::read_image)?;
//! println!("{} photographs, {} triangles", capture.views.len(), capture.mesh.triangles.len());
//! # Ok(())
//! # }
//! ```

mod cameras;
mod colmap;
mod error;
mod files;
mod lens;
mod mesh;
mod metashape;
mod middlebury;
mod openmvs;
mod uv_mesh;

use std::error::Error;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use image::{ImageFormat, ImageReader};
use rayon::prelude::*;
use texfold::core::image::to_u8;
use texfold::core::{Capture, Photograph};
use texfold::lightfield::simplify_mesh;
use texfold::{ColorSpace, Raster};

pub use cameras::{Shot, read_cameras};
pub use error::CaptureError;
pub use mesh::read as read_mesh;
#[doc(hidden)]
pub use uv_mesh::BASE64;
pub use uv_mesh::read as read_uv_mesh;

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

/// Whether a folder has the cameras of a capture.
#[must_use]
pub fn is_capture(dir: &Path) -> bool {
    camera_files(dir).iter().all(|file| file.exists())
}

/// The files of a capture's cameras, that of the poses first: `transforms.json`, else the model of COLMAP, the scene of OpenMVS, the file of
/// Metashape or the table of Middlebury that is there; `transforms.json` where there is none.
#[must_use]
pub fn camera_files(dir: &Path) -> Vec<PathBuf> {
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
#[must_use]
pub fn test_cameras(dir: &Path) -> Option<PathBuf> {
    Some(dir.join(TEST_NAME)).filter(|file| file.is_file())
}

/// The images of a capture's folder, in the order of its cameras.
///
/// # Errors
/// As [`read_cameras`].
pub fn image_files(dir: &Path) -> Result<Vec<PathBuf>, CaptureError> {
    Ok(read_cameras(&camera_files(dir)[0])?.into_iter().map(|shot| shot.image).collect())
}

/// The mesh file of a capture: the one given, or its own.
///
/// # Errors
/// [`CaptureError::NoMesh`].
pub fn mesh_file(dir: &Path, given: Option<&Path>) -> Result<PathBuf, CaptureError> {
    if let Some(mesh) = given {
        return Ok(mesh.to_owned());
    }
    let found = MESH_NAMES.iter().map(|name| dir.join(name)).find(|path| path.is_file());
    found.ok_or(CaptureError::NoMesh { path: dir.to_owned(), name: MESH_NAMES.join(" or ") })
}

/// Reads a photograph: PNG, JPEG, TIFF, BMP, TGA or PNM, in 8 bits. Pixels are as they are stored, not turned as EXIF data ask for.
///
/// # Errors
/// [`CaptureError::Read`], [`CaptureError::Image`].
pub fn read_image(path: &Path) -> Result<Raster, CaptureError> {
    let failed = |source: Box<dyn Error + Send + Sync>| CaptureError::Image { path: path.to_owned(), source };
    let file = files::open(path).map_err(|source| CaptureError::Read { path: path.to_owned(), source })?;
    let mut reader = ImageReader::new(BufReader::new(file));
    // TGA has no first bytes of its own.
    if let Ok(format) = ImageFormat::from_path(path) {
        reader.set_format(format);
    }
    let reader = reader.with_guessed_format().map_err(|source| failed(source.into()))?;
    let pixels = reader.decode().map_err(|source| failed(source.into()))?.to_rgba8();
    let (width, height) = pixels.dimensions();
    Raster::from_u8(width, height, 4, ColorSpace::Srgb, pixels.as_raw())
        .map_err(|source| failed(source.into()))
}

/// Reads a capture's folder: the photographs by `image`, such as [`read_image`], which gives pixels as they are stored, with alpha that hides what is not
/// the object; the mesh that is given, or the folder's, simplified to at most so many triangles where that is given.
///
/// # Errors
/// [`CaptureError`], and those of `image`.
pub fn read<E: From<CaptureError> + Send>(
    dir: &Path,
    mesh: Option<&Path>,
    triangles: Option<u32>,
    image: impl Fn(&Path) -> Result<Raster, E> + Sync,
) -> Result<Capture, E> {
    let file = camera_files(dir).swap_remove(0);
    let shots = read_cameras(&file)?;
    let mesh = read_mesh(&mesh_file(dir, mesh)?)?;
    let mesh = match triangles {
        Some(count) => simplify_mesh(&mesh, count as usize),
        None => mesh,
    };
    let views: Result<Vec<Photograph>, E> = shots.par_iter().map(|shot| view(&file, shot, &image)).collect();
    Ok(Capture { mesh, views: views? })
}

/// Reads the photographs that a file of cameras names by `image`, as in [`read`]; at most `most` of them, spread over all, where that is given.
///
/// # Errors
/// As [`read`].
pub fn read_views<E: From<CaptureError>>(
    cameras: &Path,
    most: Option<usize>,
    image: impl Fn(&Path) -> Result<Raster, E>,
) -> Result<Vec<Photograph>, E> {
    let shots = read_cameras(cameras)?;
    let step = most.map_or(1, |most| shots.len().div_ceil(most.max(1)).max(1));
    shots.iter().step_by(step).map(|shot| view(cameras, shot, &image)).collect()
}

fn view<E: From<CaptureError>>(
    file: &Path,
    shot: &Shot,
    image: impl Fn(&Path) -> Result<Raster, E>,
) -> Result<Photograph, E> {
    let raster = image(&shot.image)?;
    let size = raster.size();
    let camera = shot.camera(file, Some((size.width, size.height)))?;
    if (camera.width, camera.height) != (size.width, size.height) {
        return Err(E::from(CaptureError::ImageSize {
            path: shot.image.clone(),
            width: size.width,
            height: size.height,
            wanted: (camera.width, camera.height),
        }));
    }
    let pixels = raster.texels().map(|texel| texel.to_array().map(to_u8)).collect();
    let photo = Photograph { camera, pixels };
    Ok(match shot.distortion {
        Some(distortion) => distortion.undistorted(&photo),
        None => photo,
    })
}
