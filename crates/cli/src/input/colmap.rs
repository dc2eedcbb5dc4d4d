//! COLMAP's models as text: `images.txt` with the poses of a capture's images, and `cameras.txt` beside it with their lenses.

use std::collections::HashMap;
use std::path::Path;

use glam::{Mat4, Quat, Vec3, Vec4};

use super::capture::Shot;
use super::lens::Lens;
use crate::error::CliError;
use crate::files;

/// The file of cameras beside the one of images.
pub(super) const LENSES_NAME: &str = "cameras.txt";
/// The folder of images, beside both.
const IMAGES: &str = "images";
/// From OpenGL's axes of a camera (y up, looking along -z) to COLMAP's (y down, looking along z).
const AXES: Mat4 = Mat4::from_cols(
    Vec4::new(1.0, 0.0, 0.0, 0.0),
    Vec4::new(0.0, -1.0, 0.0, 0.0),
    Vec4::new(0.0, 0.0, -1.0, 0.0),
    Vec4::new(0.0, 0.0, 0.0, 1.0),
);
const OTHER_MODEL: &str = "has a camera whose model is none of SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV and \
                           FULL_OPENCV; run colmap image_undistorter";

/// Reads the cameras of `images`, in the order of their images' names.
pub(super) fn read(images: &Path) -> Result<Vec<Shot>, CliError> {
    let lenses_file = images.with_file_name(LENSES_NAME);
    let fault = |file: &Path, what| CliError::CameraContent { path: file.to_owned(), what };
    let lenses: HashMap<u32, Lens> = lines(&lenses_file)?
        .iter()
        .filter(|line| !line.trim().is_empty())
        .map(|line| lens(line).map_err(|what| fault(&lenses_file, what)))
        .collect::<Result<_, _>>()?;
    let folder = images.with_file_name(IMAGES);
    // Each image is followed by a line of its points, which may be empty.
    let text = lines(images)?;
    let poses = text.iter().step_by(2).map(|line| pose(line)).collect::<Result<Vec<_>, _>>();
    let mut poses = poses.map_err(|what| fault(images, what))?;
    poses.sort_by_key(|&(name, ..)| name);
    let shot = |(frame, (name, camera, to_world)): (usize, (&str, u32, Mat4))| {
        let lens =
            lenses.get(&camera).ok_or(fault(images, "names a camera that cameras.txt does not have"))?;
        Shot::new(folder.join(name), frame, lens.clone(), to_world).map_err(|what| fault(&lenses_file, what))
    };
    poses.into_iter().enumerate().map(shot).collect()
}

/// Lines that are no comments.
fn lines(path: &Path) -> Result<Vec<String>, CliError> {
    let text = files::read_text(path)?;
    Ok(text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect())
}

/// `CAMERA_ID MODEL WIDTH HEIGHT PARAMS...`.
fn lens(line: &str) -> Result<(u32, Lens), &'static str> {
    let fault = "has a line that is not CAMERA_ID MODEL WIDTH HEIGHT PARAMS";
    let words: Vec<&str> = line.split_whitespace().collect();
    let [id, model, width, height, params @ ..] = &words[..] else { return Err(fault) };
    let number = |word: &str| word.parse::<f32>().map_err(|_| fault);
    let params = params.iter().map(|word| number(word)).collect::<Result<Vec<f32>, _>>()?;
    let [mut k1, mut k2, mut k3, mut p1, mut p2] = [0.0; 5];
    let [fl_x, fl_y, cx, cy] = match (*model, &params[..]) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => [f, f, cx, cy],
        ("PINHOLE", &[fx, fy, cx, cy]) => [fx, fy, cx, cy],
        ("SIMPLE_RADIAL", &[f, cx, cy, k]) => {
            k1 = k;
            [f, f, cx, cy]
        }
        ("RADIAL", &[f, cx, cy, a, b]) => {
            [k1, k2] = [a, b];
            [f, f, cx, cy]
        }
        ("OPENCV", &[fx, fy, cx, cy, a, b, c, d]) => {
            [k1, k2, p1, p2] = [a, b, c, d];
            [fx, fy, cx, cy]
        }
        ("FULL_OPENCV", &[fx, fy, cx, cy, a, b, c, d, e, 0.0, 0.0, 0.0]) => {
            [k1, k2, p1, p2, k3] = [a, b, c, d, e];
            [fx, fy, cx, cy]
        }
        _ => return Err(OTHER_MODEL),
    };
    let id = id.parse().map_err(|_| fault)?;
    let (w, h) = (number(width)?, number(height)?);
    let [w, h, fl_x, fl_y, cx, cy, k1, k2, k3, p1, p2] =
        [w, h, fl_x, fl_y, cx, cy, k1, k2, k3, p1, p2].map(Some);
    Ok((id, Lens { w, h, fl_x, fl_y, cx, cy, k1, k2, k3, p1, p2, ..Lens::default() }))
}

/// `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`: name, camera and the matrix from camera to world.
fn pose(line: &str) -> Result<(&str, u32, Mat4), &'static str> {
    let fault = "has a line that is not IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME";
    let mut words = line.splitn(10, ' ');
    let _id = words.next();
    let mut number = || words.next().and_then(|word| word.parse::<f32>().ok()).ok_or(fault);
    let [w, x, y, z, tx, ty, tz] =
        [number()?, number()?, number()?, number()?, number()?, number()?, number()?];
    let camera = words.next().and_then(|word| word.parse().ok()).ok_or(fault)?;
    let name = words.next().ok_or(fault)?;
    let to_camera =
        Mat4::from_rotation_translation(Quat::from_xyzw(x, y, z, w).normalize(), Vec3::new(tx, ty, tz));
    Ok((name.trim_end(), camera, to_camera.inverse() * AXES))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use glam::Vec2;

    use super::*;

    fn read_texts(images: &str, cameras: &str) -> Result<Vec<Shot>, String> {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("images.txt");
        fs::write(&file, images).unwrap();
        fs::write(file.with_file_name(LENSES_NAME), cameras).unwrap();
        read(&file).map_err(|error| error.to_string())
    }

    const CAMERAS: &str =
        "# comment\n1 SIMPLE_RADIAL 640 480 500 320 240 0\n2 PINHOLE 640 480 500 400 320 240\n";

    /// Places by the formulas of COLMAP's manual, computed by hand: R and t from world to camera, x right, y down, z ahead.
    #[test]
    fn cameras_draw_points_where_colmap_does() {
        let images =
            "# comment\n7 0.70710678 0 0.70710678 0 0 0 0 2 b c.png\n1.0 2.0 -1\n3 1 0 0 0 0 0 2 1 a.png\n\n";
        let shots = read_texts(images, CAMERAS).unwrap();
        let names: Vec<_> = shots.iter().map(|shot| shot.image.file_name().unwrap().to_owned()).collect();
        assert_eq!(names, ["a.png", "b c.png"]);
        let points = [
            (Vec3::new(0.0, 1.0, 3.0), Vec2::new(320.0, 340.0)),
            (Vec3::new(-5.0, 0.5, 1.0), Vec2::new(420.0, 280.0)),
        ];
        for (shot, (point, wanted)) in shots.iter().zip(points) {
            let camera = shot.camera(Path::new("images.txt"), None).unwrap();
            let place = camera.project(camera.to_camera().transform_point3(point)).unwrap();
            assert!(place.distance(wanted) < 1e-3, "{place}");
        }
    }

    #[test]
    fn faults_of_models_are_named() {
        for (images, cameras, wanted) in [
            ("1 1 0 0 0 0 0 0 9 a.png\n\n", CAMERAS, "cameras.txt does not have"),
            ("1 1 0 0 0 0 0 9 a.png\n\n", CAMERAS, "not IMAGE_ID"),
            ("", "1 PINHOLE 640\n", "not CAMERA_ID"),
            ("", "1 OPENCV_FISHEYE 640 480 1 1 1 1 0 0 0 0\n", "image_undistorter"),
            ("", "1 PINHOLE 640 480 500 400 320 240 7\n", "image_undistorter"),
        ] {
            let fault = read_texts(images, cameras).unwrap_err();
            assert!(fault.contains(wanted), "{fault}");
        }
    }
}
