//! Middlebury's tables of cameras (vision.middlebury.edu/mview/data): `NAME_par.txt` with a line an image, `image K R t`, by which a point is
//! drawn at K (R point + t) with whole numbers in the middle of pixels.

use std::path::{Path, PathBuf};

use glam::{Mat3, Mat4, Vec3};

use crate::cameras::Shot;
use crate::colmap::AXES;
use crate::error::CaptureError;
use crate::files;
use crate::lens::Lens;

/// End of the names of tables.
const ENDING: &str = "_par.txt";
/// Skew of pixels, over the focal length, that moves none.
pub(super) const LEAST_SKEW: f32 = 1e-5;

/// Whether a file is such a table, by its name.
pub(super) fn is_table(path: &Path) -> bool {
    path.file_name().and_then(|name| name.to_str()).is_some_and(|name| name.ends_with(ENDING))
}

/// The table of a folder, where it has one and no more.
pub(super) fn table(dir: &Path) -> Option<PathBuf> {
    let mut tables = dir.read_dir().ok()?.flatten().map(|entry| entry.path()).filter(|path| is_table(path));
    tables.next().filter(|_| tables.next().is_none())
}

/// Reads the cameras of a table, in its order.
pub(super) fn read(path: &Path) -> Result<Vec<Shot>, CaptureError> {
    let text = files::read_text(path)?;
    let fault = |what| CaptureError::CameraContent { path: path.to_owned(), what };
    // The number of images comes first.
    let lines = text.lines().skip(1).filter(|line| !line.trim().is_empty());
    let shot = |(frame, line): (usize, &str)| {
        let (name, lens, to_world) = camera(line)?;
        Shot::new(path.with_file_name(name), frame, lens, to_world)
    };
    lines.enumerate().map(shot).collect::<Result<_, _>>().map_err(fault)
}

/// The image, lens and matrix from camera to world of a line.
fn camera(line: &str) -> Result<(&str, Lens, Mat4), &'static str> {
    let fault = "has a line that is not an image's name and 21 numbers";
    let (name, numbers) = line.trim().split_once(char::is_whitespace).ok_or(fault)?;
    let numbers = numbers.split_whitespace().map(|word| word.parse().map_err(|_| fault));
    let numbers = numbers.collect::<Result<Vec<f32>, _>>()?;
    let Some((&lens, &[r11, r12, r13, r21, r22, r23, r31, r32, r33, tx, ty, tz])) =
        numbers.split_first_chunk::<9>().and_then(|(lens, pose)| Some((lens, pose.first_chunk::<12>()?)))
    else {
        return Err(fault);
    };
    let [fl_x, skew, cx, zero, fl_y, cy, null, nought, one] = lens;
    let is_pinhole = [zero, null, nought, one - 1.0].iter().all(|value| value.abs() < LEAST_SKEW);
    if numbers.len() != 21 || !is_pinhole || skew.abs() > LEAST_SKEW * fl_x.abs() {
        return Err(if numbers.len() == 21 { "has a camera with skew; resample its image" } else { fault });
    }
    let rotation = Mat3::from_cols_array(&[r11, r21, r31, r12, r22, r32, r13, r23, r33]);
    let mut to_camera = Mat4::from_mat3(rotation);
    to_camera.w_axis = Vec3::new(tx, ty, tz).extend(1.0);
    let [fl_x, fl_y, cx, cy] = [fl_x, fl_y, cx + 0.5, cy + 0.5].map(Some);
    Ok((name, Lens { fl_x, fl_y, cx, cy, ..Lens::default() }, to_camera.inverse() * AXES))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use glam::Vec2;

    use super::*;

    #[test]
    fn cameras_draw_points_where_the_table_says() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("toy_par.txt");
        // Turned by a quarter about y: x looks along -z of the world.
        let line = "a.png 500 0 320 0 400 240 0 0 1 0 0 1 0 1 0 -1 0 0 0.5 0 2";
        fs::write(&path, format!("1\n{line}\n")).unwrap();
        assert_eq!(table(place.path()), Some(path.clone()));
        let shots = read(&path).unwrap();
        assert_eq!(shots[0].image, place.path().join("a.png"));
        let camera = shots[0].camera(&path, Some((640, 480))).unwrap();
        // In the camera's axes at (0.5, 1, 3).
        let found = camera.project(camera.to_camera().transform_point3(Vec3::new(-1.0, 1.0, 0.0))).unwrap();
        let wanted = Vec2::new(500.0 * 0.5 / 3.0 + 320.5, 400.0 / 3.0 + 240.5);
        assert!(found.distance(wanted) < 1e-3, "{found} {wanted}");
        for (line, what) in [
            (line.replace("500 0 320", "500 1 320"), "skew"),
            (line.replace(" 2", ""), "21 numbers"),
            (line.replace("240", "x"), "21 numbers"),
            (format!("{line} 7"), "21 numbers"),
            ("a.png".to_owned(), "21 numbers"),
        ] {
            fs::write(&path, format!("1\n{line}\n")).unwrap();
            let fault = read(&path).unwrap_err().to_string();
            assert!(fault.contains(what), "{fault}");
        }
    }
}
