//! COLMAP's models, as text or binary: `images.txt` or `images.bin` with the poses of a capture's images, and `cameras.txt` or `cameras.bin`
//! beside it with their lenses (colmap.github.io/format.html).

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{Mat4, Quat, Vec3, Vec4};

use crate::cameras::Shot;
use crate::error::CaptureError;
use crate::files;
use crate::lens::Lens;

/// The files of images and of cameras, one beside the other.
pub(super) const NAMES: [[&str; 2]; 2] = [["images.txt", "cameras.txt"], ["images.bin", "cameras.bin"]];
/// Folders of a capture that models lie in: its own, and those that COLMAP makes.
pub(super) const FOLDERS: [&str; 3] = ["", "sparse/0", "sparse"];
/// The folder of images: beside the model, or in the folders above.
pub(super) const IMAGES: &str = "images";
/// Folders above a model in which the images are looked for.
const ABOVE: usize = 3;
/// Models by their numbers in binary files, with the numbers of their parameters.
const MODELS: [(&str, usize); 11] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
];
/// From OpenGL's axes of a camera (y up, looking along -z) to COLMAP's (y down, looking along z).
pub(super) const AXES: Mat4 = Mat4::from_cols(
    Vec4::new(1.0, 0.0, 0.0, 0.0),
    Vec4::new(0.0, -1.0, 0.0, 0.0),
    Vec4::new(0.0, 0.0, -1.0, 0.0),
    Vec4::new(0.0, 0.0, 0.0, 1.0),
);
const OTHER_MODEL: &str = "has a camera of the model FOV or THIN_PRISM_FISHEYE, of FULL_OPENCV with k4 to k6, or of none that COLMAP has; run colmap \
                           image_undistorter";

/// An image of a model: name, camera, matrix from camera to world.
type Pose = (String, u32, Mat4);

/// Reads the cameras of a file of images, in the order of their images' names.
pub(super) fn read(images: &Path) -> Result<Vec<Shot>, CaptureError> {
    let is_binary = images.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("bin"));
    let lenses_file = images.with_file_name(NAMES[usize::from(is_binary)][1]);
    let fault = |file: &Path, what| CaptureError::CameraContent { path: file.to_owned(), what };
    let (lenses, poses) = if is_binary {
        let lenses = records(&files::read(&lenses_file)?, binary_lens);
        (lenses, records(&files::read(images)?, binary_pose))
    } else {
        let lenses = lines(&lenses_file)?;
        let lenses = lenses.iter().filter(|line| !line.trim().is_empty()).map(|line| lens(line)).collect();
        // Each image is followed by a line of its points, which may be empty.
        (lenses, lines(images)?.iter().step_by(2).map(|line| pose(line)).collect())
    };
    let lenses: HashMap<u32, Lens> = lenses.map_err(|what| fault(&lenses_file, what))?.into_iter().collect();
    let mut poses: Vec<Pose> = poses.map_err(|what| fault(images, what))?;
    poses.sort_by(|(a, ..), (b, ..)| a.cmp(b));
    let folder = folder_of(images);
    let shot = |(frame, (name, camera, to_world)): (usize, Pose)| {
        let lens = lenses
            .get(&camera)
            .ok_or(fault(images, "names a camera that its file of cameras does not have"))?;
        Shot::new(folder.join(name), frame, lens.clone(), to_world).map_err(|what| fault(&lenses_file, what))
    };
    poses.into_iter().enumerate().map(shot).collect()
}

/// The folder of images of a model.
fn folder_of(images: &Path) -> PathBuf {
    let above = images.ancestors().skip(1).take(ABOVE).map(|folder| folder.join(IMAGES));
    above.clone().find(|folder| folder.is_dir()).unwrap_or_else(|| images.with_file_name(IMAGES))
}

/// Records of a binary file behind their number.
fn records<T>(
    bytes: &[u8],
    read: impl Fn(&mut &[u8]) -> Option<Result<T, &'static str>>,
) -> Result<Vec<T>, &'static str> {
    const CUT: &str = "ends within a record; copy it again";
    let mut rest = bytes;
    let count = take(&mut rest).map(u64::from_le_bytes).ok_or(CUT)?;
    (0..count).map(|_| read(&mut rest).ok_or(CUT)?).collect()
}

/// The next bytes.
pub(super) fn take<const COUNT: usize>(rest: &mut &[u8]) -> Option<[u8; COUNT]> {
    let (found, behind) = rest.split_first_chunk()?;
    *rest = behind;
    Some(*found)
}

fn double(rest: &mut &[u8]) -> Option<f32> {
    take(rest).map(|bytes| f64::from_le_bytes(bytes) as f32)
}

/// Number, model, width, height and parameters of a camera.
fn binary_lens(rest: &mut &[u8]) -> Option<Result<(u32, Lens), &'static str>> {
    let (id, model) = (u32::from_le_bytes(take(rest)?), u32::from_le_bytes(take(rest)?));
    let [width, height] = [u64::from_le_bytes(take(rest)?), u64::from_le_bytes(take(rest)?)];
    let Some(&(model, count)) = MODELS.get(model as usize) else { return Some(Err(OTHER_MODEL)) };
    let params = (0..count).map(|_| double(rest)).collect::<Option<Vec<f32>>>()?;
    Some(lens_of(model, [width as f32, height as f32], &params).map(|lens| (id, lens)))
}

/// Number, rotation, translation, camera, name and points of an image.
fn binary_pose(rest: &mut &[u8]) -> Option<Result<Pose, &'static str>> {
    /// Bytes of a point: its place and its number.
    const POINT: u64 = 24;
    take::<4>(rest)?;
    let mut numbers = [0.0; 7];
    for number in &mut numbers {
        *number = double(rest)?;
    }
    let camera = u32::from_le_bytes(take(rest)?);
    let end = rest.iter().position(|&byte| byte == 0)?;
    let name = String::from_utf8_lossy(&rest[..end]).into_owned();
    *rest = &rest[end + 1..];
    let points = u64::from_le_bytes(take(rest)?).checked_mul(POINT)?;
    *rest = rest.get(usize::try_from(points).ok()?..)?;
    Some(Ok((name, camera, to_world(numbers))))
}

/// Lines that are no comments.
fn lines(path: &Path) -> Result<Vec<String>, CaptureError> {
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
    let id = id.parse().map_err(|_| fault)?;
    Ok((id, lens_of(model, [number(width)?, number(height)?], &params)?))
}

/// The lens of a model.
fn lens_of(model: &str, [w, h]: [f32; 2], params: &[f32]) -> Result<Lens, &'static str> {
    let [mut k1, mut k2, mut k3, mut k4, mut p1, mut p2] = [0.0; 6];
    let [fl_x, fl_y, cx, cy] = match (model, params) {
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
        ("OPENCV_FISHEYE", &[fx, fy, cx, cy, a, b, c, d]) => {
            [k1, k2, k3, k4] = [a, b, c, d];
            [fx, fy, cx, cy]
        }
        ("SIMPLE_RADIAL_FISHEYE", &[f, cx, cy, k]) => {
            k1 = k;
            [f, f, cx, cy]
        }
        ("RADIAL_FISHEYE", &[f, cx, cy, a, b]) => {
            [k1, k2] = [a, b];
            [f, f, cx, cy]
        }
        _ => return Err(OTHER_MODEL),
    };
    let [w, h, fl_x, fl_y, cx, cy, k1, k2, k3, k4, p1, p2] =
        [w, h, fl_x, fl_y, cx, cy, k1, k2, k3, k4, p1, p2].map(Some);
    let is_fisheye = Some(model.ends_with("FISHEYE"));
    Ok(Lens { w, h, fl_x, fl_y, cx, cy, is_fisheye, k1, k2, k3, k4, p1, p2, ..Lens::default() })
}

/// `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`: name, camera and the matrix from camera to world.
fn pose(line: &str) -> Result<Pose, &'static str> {
    let fault = "has a line that is not IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME";
    let mut words = line.splitn(10, ' ');
    let _id = words.next();
    let mut number = || words.next().and_then(|word| word.parse::<f32>().ok()).ok_or(fault);
    let numbers = [number()?, number()?, number()?, number()?, number()?, number()?, number()?];
    let camera = words.next().and_then(|word| word.parse().ok()).ok_or(fault)?;
    let name = words.next().ok_or(fault)?;
    Ok((name.trim_end().to_owned(), camera, to_world(numbers)))
}

/// The matrix from camera to world, of a rotation (w, x, y, z) and translation from world to camera.
fn to_world([w, x, y, z, tx, ty, tz]: [f32; 7]) -> Mat4 {
    let to_camera =
        Mat4::from_rotation_translation(Quat::from_xyzw(x, y, z, w).normalize(), Vec3::new(tx, ty, tz));
    to_camera.inverse() * AXES
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
        fs::write(file.with_file_name(NAMES[0][1]), cameras).unwrap();
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
            ("1 1 0 0 0 0 0 0 9 a.png\n\n", CAMERAS, "file of cameras does not have"),
            ("1 1 0 0 0 0 0 9 a.png\n\n", CAMERAS, "not IMAGE_ID"),
            ("", "1 PINHOLE 640\n", "not CAMERA_ID"),
            ("", "1 FOV 640 480 1 1 1 1 0\n", "image_undistorter"),
            ("", "1 PINHOLE 640 480 500 400 320 240 7\n", "image_undistorter"),
        ] {
            let fault = read_texts(images, cameras).unwrap_err();
            assert!(fault.contains(wanted), "{fault}");
        }
    }

    /// The same model as text and as binary, in the folders that COLMAP makes.
    #[test]
    fn binary_models_are_those_of_text() {
        let place = tempfile::tempdir().unwrap();
        let (model, images) = (place.path().join("sparse/0"), place.path().join("images"));
        fs::create_dir_all(&model).unwrap();
        fs::create_dir(&images).unwrap();
        let text = "1 0.5 0.5 -0.5 0.5 0.25 -2 3 7 b.png\n\n2 1 0 0 0 0 0 2 8 a.png\n3 4 -1\n";
        let cameras = "7 OPENCV 640 480 500 400 320 240 0.125 0 0 0.5\n8 SIMPLE_RADIAL 64 48 50 32 24 0\n";
        fs::write(model.join("images.txt"), text).unwrap();
        fs::write(model.join("cameras.txt"), cameras).unwrap();
        let doubles =
            |values: &[f64]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
        let lens = |id: u32, model: u32, [w, h]: [u64; 2], params: &[f64]| {
            [
                &id.to_le_bytes()[..],
                &model.to_le_bytes(),
                &w.to_le_bytes(),
                &h.to_le_bytes(),
                &doubles(params),
            ]
            .concat()
        };
        let opencv = lens(7, 4, [640, 480], &[500.0, 400.0, 320.0, 240.0, 0.125, 0.0, 0.0, 0.5]);
        let radial = lens(8, 2, [64, 48], &[50.0, 32.0, 24.0, 0.0]);
        let lenses = [&2u64.to_le_bytes()[..], &opencv, &radial].concat();
        let pose = |values: [f64; 7], camera: u32, name: &[u8], points: u64| {
            let points = [&points.to_le_bytes()[..], &vec![9; 24 * points as usize]].concat();
            [&[1, 0, 0, 0], &doubles(&values)[..], &camera.to_le_bytes(), name, &points].concat()
        };
        let first = pose([0.5, 0.5, -0.5, 0.5, 0.25, -2.0, 3.0], 7, b"b.png\0", 0);
        let second = pose([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0], 8, b"a.png\0", 2);
        let poses = [&2u64.to_le_bytes()[..], &first, &second].concat();
        fs::write(model.join("images.bin"), &poses).unwrap();
        fs::write(model.join("cameras.bin"), &lenses).unwrap();
        let [text, binary] = ["images.txt", "images.bin"].map(|name| read(&model.join(name)).unwrap());
        assert_eq!(format!("{text:?}"), format!("{binary:?}"));
        assert_eq!(binary[0].image, images.join("a.png"));
        // Cut anywhere, and with counts that no file holds.
        for (name, bytes) in [("images.bin", &poses), ("cameras.bin", &lenses)] {
            for length in 0..bytes.len() {
                fs::write(model.join(name), &bytes[..length]).unwrap();
                assert!(read(&model.join("images.bin")).is_err(), "{name} of {length} bytes");
            }
            let many = [&u64::MAX.to_le_bytes()[..], &bytes[8..]].concat();
            fs::write(model.join(name), many).unwrap();
            assert!(read(&model.join("images.bin")).is_err());
            fs::write(model.join(name), bytes).unwrap();
        }
    }
}
