//! Scenes of OpenMVS (`*.mvs` in the form of libs/MVS/Interface.h): cameras that draw points of the world at K R (X - C), with whole
//! numbers in the middle of pixels, of photographs without distortion.

use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DVec3};

use crate::cameras::Shot;
use crate::colmap::{AXES, take};
use crate::error::CaptureError;
use crate::files;
use crate::lens::Lens;
use crate::middlebury::LEAST_SKEW;

/// The scene that is taken where a folder has several: those of later steps have the same cameras.
const SCENE: &str = "scene.mvs";
const MAGIC: [u8; 4] = *b"MVSI";
/// The latest version of the form that is read.
const VERSION: u32 = 7;
/// Number of an image's pose where it has none.
const NONE: u32 = u32::MAX;
/// Bytes of what an image knows of another.
const SCORE_BYTES: u64 = 24;
const CUT: &str = "ends within a record; copy it again";

/// Whether a file is a scene, by its name.
pub(super) fn is_scene(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mvs"))
}

/// The scene of a folder: `scene.mvs`, else the first by name.
pub(super) fn scene(dir: &Path) -> Option<PathBuf> {
    let scenes = dir.read_dir().ok()?.flatten().map(|entry| entry.path()).filter(|path| is_scene(path));
    scenes.min_by_key(|path| (path.file_name().is_none_or(|name| name != SCENE), path.clone()))
}

/// Reads the cameras of a scene, in the order of its images; images without a pose are left out.
pub(super) fn read(path: &Path) -> Result<Vec<Shot>, CaptureError> {
    let fault = |what| CaptureError::CameraContent { path: path.to_owned(), what };
    let bytes = files::read(path)?;
    let mut rest = bytes.as_slice();
    if take(&mut rest) != Some(MAGIC) {
        return Err(fault("is not in OpenMVS's interface form; write it again with --archive-type -1"));
    }
    let version = take(&mut rest).map(u32::from_le_bytes).ok_or(fault(CUT))?;
    if version > VERSION {
        return Err(fault(
            "is of a later form than 7 of OpenMVS's interface; write it with an earlier OpenMVS",
        ));
    }
    let (platforms, images) = scene_of(&mut rest, version).ok_or(fault(CUT))?;
    let mut shots = Vec::new();
    for image in images.into_iter().filter(|image| image.pose != NONE) {
        let platform = platforms.get(image.platform as usize);
        let eye = platform.and_then(|platform| platform.eyes.get(image.camera as usize));
        let pose = platform.and_then(|platform| platform.poses.get(image.pose as usize));
        let (Some(eye), Some(pose)) = (eye, pose) else {
            return Err(fault("has an image whose camera or pose it does not have"));
        };
        let file = find_image(path, &image.name);
        let lens = eye.lens(&file).map_err(fault)?;
        shots.push(Shot::new(file, shots.len(), lens, eye.to_world(pose)).map_err(fault)?);
    }
    Ok(shots)
}

/// Path of a scene's image: as the scene has it, else its name alone in `images` or beside the scene, as scenes are moved.
fn find_image(scene: &Path, name: &str) -> PathBuf {
    let name = name.replace('\\', "/");
    let dir = scene.parent().unwrap_or(Path::new(""));
    let file = Path::new(&name).file_name().unwrap_or_default();
    let mut places = [dir.join(&name), dir.join("images").join(file), dir.join(file)].into_iter();
    let first = places.next().unwrap_or_default();
    if first.is_file() { first } else { places.find(|path| path.is_file()).unwrap_or(first) }
}

/// A pose: rotation from world to camera, and place.
#[derive(Debug, Clone, Copy)]
struct Pose {
    rotation: DMat3,
    place: DVec3,
}

/// A camera of a platform.
#[derive(Debug)]
struct Eye {
    /// Columns and rows in pixels; 0 where `matrix` is for images whose longer side is 1.
    size: [u32; 2],
    matrix: DMat3,
    /// From the platform to the camera.
    pose: Pose,
}

#[derive(Debug)]
struct Platform {
    eyes: Vec<Eye>,
    poses: Vec<Pose>,
}

#[derive(Debug)]
struct Image {
    name: String,
    platform: u32,
    camera: u32,
    pose: u32,
}

impl Eye {
    /// The lens in pixels; `image` is asked for its size where the scene does not have it.
    fn lens(&self, image: &Path) -> Result<Lens, &'static str> {
        let [[fx, zero, null], [skew, fy, nought], [cx, cy, one]] = self.matrix.to_cols_array_2d();
        let is_pinhole = [zero, null, nought, one - 1.0].iter().all(|value| value.abs() < LEAST_SKEW.into());
        if !is_pinhole || skew.abs() > f64::from(LEAST_SKEW) * fx.abs() {
            return Err("has a camera with skew; resample its image");
        }
        let [w, h] = self.size;
        let is_unit = w == 0 || h == 0;
        let (w, h) = match is_unit {
            true => image::image_dimensions(image)
                .map_err(|_| "has no size of an image, and the image is not there or not readable")?,
            false => (w, h),
        };
        // Centres of unit cameras are scaled with the image, others are counted from the middle of the first pixel.
        let (scale, shift) = if is_unit { (f64::from(w.max(h)), 0.0) } else { (1.0, 0.5) };
        let value = |value: f64| Some((scale * value) as f32);
        Ok(Lens {
            w: Some(w as f32),
            h: Some(h as f32),
            fl_x: value(fx),
            fl_y: value(fy),
            cx: value(cx + shift),
            cy: value(cy + shift),
            ..Lens::default()
        })
    }

    /// The matrix from camera to world.
    fn to_world(&self, platform: &Pose) -> glam::Mat4 {
        let rotation = (self.pose.rotation * platform.rotation).transpose();
        let place = platform.rotation.transpose() * self.pose.place + platform.place;
        DMat4::from_cols(
            rotation.x_axis.extend(0.0),
            rotation.y_axis.extend(0.0),
            rotation.z_axis.extend(0.0),
            place.extend(1.0),
        )
        .as_mat4()
            * AXES
    }
}

/// Platforms and images, which come first.
fn scene_of(rest: &mut &[u8], version: u32) -> Option<(Vec<Platform>, Vec<Image>)> {
    // Four bytes are kept for later.
    take::<4>(rest)?;
    let platforms = list(rest, |rest| {
        text(rest)?;
        let eyes = list(rest, |rest| eye(rest, version))?;
        Some(Platform { eyes, poses: list(rest, pose)? })
    })?;
    Some((platforms, list(rest, |rest| image(rest, version))?))
}

fn eye(rest: &mut &[u8], version: u32) -> Option<Eye> {
    text(rest)?;
    if version > 3 {
        text(rest)?;
    }
    let size = if version > 0 { [number(rest)?, number(rest)?] } else { [0; 2] };
    Some(Eye { size, matrix: matrix(rest)?, pose: pose(rest)? })
}

fn image(rest: &mut &[u8], version: u32) -> Option<Image> {
    let name = text(rest)?;
    if version > 4 {
        text(rest)?;
    }
    let image = Image { name, platform: number(rest)?, camera: number(rest)?, pose: number(rest)? };
    if version > 2 {
        number(rest)?;
    }
    if version > 6 {
        take::<12>(rest)?;
        let scores = take(rest).map(u64::from_le_bytes)?.checked_mul(SCORE_BYTES)?;
        *rest = rest.get(usize::try_from(scores).ok()?..)?;
    }
    Some(image)
}

/// Records behind their number. Each has a byte at least, so that a number that no file holds ends at the file's end.
fn list<T>(rest: &mut &[u8], read: impl Fn(&mut &[u8]) -> Option<T>) -> Option<Vec<T>> {
    let count = take(rest).map(u64::from_le_bytes)?;
    (0..count).map(|_| read(rest)).collect()
}

fn text(rest: &mut &[u8]) -> Option<String> {
    let length = usize::try_from(take(rest).map(u64::from_le_bytes)?).ok()?;
    let (found, behind) = rest.split_at_checked(length)?;
    *rest = behind;
    Some(String::from_utf8_lossy(found).into_owned())
}

fn number(rest: &mut &[u8]) -> Option<u32> {
    take(rest).map(u32::from_le_bytes)
}

fn double(rest: &mut &[u8]) -> Option<f64> {
    take(rest).map(f64::from_le_bytes)
}

/// A matrix, row by row.
fn matrix(rest: &mut &[u8]) -> Option<DMat3> {
    let mut values = [0.0; 9];
    for value in &mut values {
        *value = double(rest)?;
    }
    Some(DMat3::from_cols_array(&values).transpose())
}

fn pose(rest: &mut &[u8]) -> Option<Pose> {
    let rotation = matrix(rest)?;
    Some(Pose { rotation, place: DVec3::new(double(rest)?, double(rest)?, double(rest)?) })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use glam::{Vec2, Vec3};

    use super::*;

    /// A scene of a version with one platform, whose camera is turned and moved, and three images, the second without a pose.
    fn scene_bytes(version: u32, size: [u32; 2], matrix: [f64; 9]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        let text = |bytes: &mut Vec<u8>, text: &str| {
            bytes.extend((text.len() as u64).to_le_bytes());
            bytes.extend(text.as_bytes());
        };
        let doubles =
            |bytes: &mut Vec<u8>, values: &[f64]| bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(version.to_le_bytes());
        bytes.extend([0; 4]);
        bytes.extend(1u64.to_le_bytes());
        text(&mut bytes, "platform");
        bytes.extend(1u64.to_le_bytes());
        text(&mut bytes, "camera");
        if version > 3 {
            text(&mut bytes, "RGB");
        }
        if version > 0 {
            bytes.extend(size.iter().flat_map(|side| side.to_le_bytes()));
        }
        doubles(&mut bytes, &matrix);
        // A quarter turn about the viewing axis, half a unit to the right.
        doubles(&mut bytes, &[0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0]);
        bytes.extend(1u64.to_le_bytes());
        // Looking along x from (-3, 0, 0), the world's z up.
        doubles(&mut bytes, &[0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0, -3.0, 0.0, 0.0]);
        bytes.extend(3u64.to_le_bytes());
        for (name, pose) in [("a.png", 0), ("b.png", NONE), ("images\\c.png", 0)] {
            text(&mut bytes, name);
            if version > 4 {
                text(&mut bytes, "");
            }
            bytes.extend([0, 0, pose].iter().flat_map(|value: &u32| value.to_le_bytes()));
            if version > 2 {
                bytes.extend([0; 4]);
            }
            if version > 6 {
                bytes.extend([0; 12]);
                bytes.extend(1u64.to_le_bytes());
                bytes.extend([0; SCORE_BYTES as usize]);
            }
        }
        bytes
    }

    fn read_bytes(bytes: &[u8]) -> Result<Vec<Shot>, String> {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join(SCENE);
        fs::write(&file, bytes).unwrap();
        image::RgbImage::new(64, 48).save(place.path().join("a.png")).unwrap();
        image::RgbImage::new(64, 48).save(place.path().join("c.png")).unwrap();
        read(&file).map_err(|error| error.to_string())
    }

    const PIXELS: [f64; 9] = [50.0, 0.0, 31.5, 0.0, 40.0, 23.5, 0.0, 0.0, 1.0];

    /// Places by the formula of the interface, computed by hand: K R (X - C), from the middle of the first pixel.
    #[test]
    fn cameras_draw_points_where_openmvs_does() {
        let unit = [50.0 / 64.0, 0.0, 0.5, 0.0, 40.0 / 64.0, 24.0 / 64.0, 0.0, 0.0, 1.0];
        for (version, size, matrix) in
            [(0, [0; 2], unit), (3, [64, 48], PIXELS), (6, [0; 2], unit), (7, [64, 48], PIXELS)]
        {
            let shots = read_bytes(&scene_bytes(version, size, matrix)).unwrap();
            let names: Vec<_> = shots.iter().map(|shot| shot.image.file_name().unwrap().to_owned()).collect();
            assert_eq!(names, ["a.png", "c.png"]);
            let camera = shots[0].camera(Path::new(SCENE), None).unwrap();
            assert_eq!((camera.width, camera.height), (64, 48));
            // The platform sees (1, -2, 1) at (2, -1, 4); the camera is at (-3, -0.5, 0) and sees it at (1, 1.5, 4).
            let place = camera.project(camera.to_camera().transform_point3(Vec3::new(1.0, -2.0, 1.0)));
            let wanted = Vec2::new(32.0 + 50.0 * 1.0 / 4.0, 24.0 + 40.0 * 1.5 / 4.0);
            assert!(place.unwrap().distance(wanted) < 1e-3, "{version}: {place:?} for {wanted}");
        }
    }

    #[test]
    fn faults_of_scenes_are_named() {
        let whole = scene_bytes(7, [64, 48], PIXELS);
        for length in 4..whole.len() {
            assert!(read_bytes(&whole[..length]).unwrap_err().contains("ends within"), "{length} bytes");
        }
        assert!(read_bytes(b"MVS\0").unwrap_err().contains("--archive-type -1"));
        assert!(
            read_bytes(&[&whole[..4], &[8, 0, 0, 0], &whole[8..]].concat()).unwrap_err().contains("later")
        );
        let skewed = [50.0, 3.0, 31.5, 0.0, 40.0, 23.5, 0.0, 0.0, 1.0];
        assert!(read_bytes(&scene_bytes(3, [64, 48], skewed)).unwrap_err().contains("skew"));
        // Counts that no file holds.
        let many = [&whole[..12], &u64::MAX.to_le_bytes(), &whole[20..]].concat();
        assert!(read_bytes(&many).is_err());
    }

    #[test]
    fn the_scene_of_a_folder_is_the_first_step() {
        let place = tempfile::tempdir().unwrap();
        assert_eq!(scene(place.path()), None);
        for name in ["b.mvs", "a.mvs", SCENE] {
            fs::write(place.path().join(name), "").unwrap();
            let wanted = if name == SCENE { SCENE } else { name };
            assert_eq!(scene(place.path()).unwrap().file_name().unwrap(), wanted);
        }
    }
}
