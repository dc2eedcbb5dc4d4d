//! Files of cameras.

use std::path::{Path, PathBuf};

use glam::{Mat4, Vec2, Vec4};
use serde::Deserialize;
use texfold::core::Camera;

use crate::error::CaptureError;
use crate::lens::{Distortion, Lens};
use crate::{colmap, files, metashape, middlebury, openmvs};

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
pub struct Shot {
    /// Path of the image.
    pub image: PathBuf,
    frame: usize,
    lens: Lens,
    pub(crate) distortion: Option<Distortion>,
    to_world: Mat4,
}

/// Reads a file of cameras: Middlebury's where its name ends in `_par.txt`, COLMAP's where it ends in `.txt` or `.bin`, OpenMVS's in `.mvs`,
/// Metashape's in `.xml`, else `transforms.json`. At least one.
///
/// # Errors
/// [`CaptureError::Read`], [`CaptureError::Cameras`], [`CaptureError::CameraContent`].
pub fn read_cameras(path: &Path) -> Result<Vec<Shot>, CaptureError> {
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
        return Err(CaptureError::CameraContent { path: path.to_owned(), what: "names no frame" });
    }
    Ok(shots)
}

fn read_transforms(path: &Path) -> Result<Vec<Shot>, CaptureError> {
    let text = files::read(path)?;
    let cameras: Cameras = serde_json::from_slice(&text)
        .map_err(|source| CaptureError::Cameras { path: path.to_owned(), source: source.into() })?;
    let dir = path.parent().unwrap_or(Path::new(""));
    let shot = |(frame, found): (usize, Frame)| {
        let [x, y, z, w] = found.transform_matrix.map(Vec4::from);
        let to_world = Mat4::from_cols(x, y, z, w).transpose();
        Shot::new(image_path(dir, &found.file_path), frame, found.lens.or(&cameras.lens), to_world)
            .map_err(|what| CaptureError::CameraContent { path: path.to_owned(), what })
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

    /// The pinhole camera, for an image of so many columns and rows where the file does not have them; `file` is named in errors.
    ///
    /// # Errors
    /// [`CaptureError::CameraContent`] without a size or a focal length, [`CaptureError::SingularCamera`].
    pub fn camera(&self, file: &Path, size: Option<(u32, u32)>) -> Result<Camera, CaptureError> {
        let fault = |what| CaptureError::CameraContent { path: file.to_owned(), what };
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
            return Err(CaptureError::SingularCamera { path: file.to_owned(), frame: self.frame });
        }
        Ok(camera)
    }
}
