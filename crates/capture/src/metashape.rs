//! Cameras that Agisoft Metashape exports as XML (File, Export, Export Cameras): for each sensor a calibration, for each aligned camera a matrix
//! to the space of its component, for each component a similarity to the world. Formulas: Metashape's manual, appendix "Camera models".
//!
//! Coordinates are read as doubles and kept as floats: of a georeferenced chunk, cameras and mesh are to be exported in local coordinates.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DVec3};
use roxmltree::{Document, Node};

use crate::cameras::Shot;
use crate::colmap::{AXES, IMAGES};
use crate::error::CaptureError;
use crate::files;
use crate::lens::Lens;
use crate::middlebury::LEAST_SKEW;

/// Bytes of a file in which its kind shows.
const HEAD: u64 = 4096;
const NUMBERS: &str = "has a matrix or calibration that is not numbers";

/// Whether a file is one of cameras, by its name.
pub(super) fn is_cameras(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("xml"))
}

/// The file of cameras of a folder, where it has one and no more: other XML is not of a chunk.
pub(super) fn cameras(dir: &Path) -> Option<PathBuf> {
    let files = dir.read_dir().ok()?.flatten().map(|entry| entry.path());
    let mut found = files.filter(|path| is_cameras(path) && is_of_chunk(path));
    found.next().filter(|_| found.next().is_none())
}

fn is_of_chunk(path: &Path) -> bool {
    let head = files::read_head(path, HEAD).unwrap_or_default();
    let head = String::from_utf8_lossy(&head);
    head.contains("<document") && head.contains("<chunk")
}

/// Reads the cameras that are aligned and enabled, in the order of the file.
pub(super) fn read(path: &Path) -> Result<Vec<Shot>, CaptureError> {
    let fault = |what| CaptureError::CameraContent { path: path.to_owned(), what };
    let text = files::read_text(path)?;
    let document = Document::parse(&text)
        .map_err(|source| CaptureError::Cameras { path: path.to_owned(), source: source.into() })?;
    let mut chunks = children(document.root_element(), "chunk");
    let chunk = chunks.next().ok_or(fault("is not one of Metashape's cameras"))?;
    if chunks.next().is_some() {
        return Err(fault("has more than one chunk; export the cameras of one"));
    }
    let by_id = |group: &str, name: &'static str| -> HashMap<String, Node<'_, '_>> {
        let all = child(chunk, group).into_iter().flat_map(|group| children(group, name));
        all.filter_map(|node| Some((node.attribute("id")?.to_owned(), node))).collect()
    };
    let (sensors, components) = (by_id("sensors", "sensor"), by_id("components", "component"));
    let images = Images::around(path);
    // Cameras may lie in groups.
    let cameras = child(chunk, "cameras").into_iter().flat_map(|all| all.descendants());
    let mut shots = Vec::new();
    for camera in cameras.filter(|node| node.has_tag_name("camera") && is_enabled(*node)) {
        let Some(matrix) = child(camera, "transform") else { continue };
        let label = camera.attribute("label").unwrap_or_default();
        let node = |all: &HashMap<String, Node<'_, '_>>, name| {
            camera.attribute(name).and_then(|id| all.get(id).map(|node| node.id()))
        };
        let found = |id| document.get_node(id);
        let sensor = node(&sensors, "sensor_id").and_then(found);
        let sensor = sensor.ok_or(fault("has a camera whose sensor it does not have"))?;
        // Files of before components have one similarity for all.
        let component = node(&components, "component_id").and_then(found).unwrap_or(chunk);
        let shot = || {
            let (scale, to_world) = similarity(component)?;
            let to_world = to_world * rigid(matrix, scale)?;
            Shot::new(images.find(label), shots.len(), lens(sensor)?, to_world.as_mat4() * AXES)
        };
        let shot = shot().map_err(fault)?;
        shots.push(shot);
    }
    Ok(shots)
}

fn children<'a, 'input>(
    node: Node<'a, 'input>,
    name: &'static str,
) -> impl Iterator<Item = Node<'a, 'input>> {
    node.children().filter(move |child| child.has_tag_name(name))
}

fn child<'a, 'input>(node: Node<'a, 'input>, name: &str) -> Option<Node<'a, 'input>> {
    node.children().find(|child| child.has_tag_name(name))
}

fn is_enabled(camera: Node<'_, '_>) -> bool {
    !matches!(camera.attribute("enabled"), Some("false" | "0"))
}

/// Endings of photographs' files, which stand beside others of the same name.
const PHOTOGRAPHS: [&str; 14] =
    ["png", "jpg", "jpeg", "tif", "tiff", "webp", "bmp", "tga", "exr", "hdr", "ppm", "pgm", "gif", "jxl"];

fn is_image(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    PHOTOGRAPHS.iter().any(|known| known.eq_ignore_ascii_case(&extension))
}

/// The images that labels of cameras name, mostly without an extension.
struct Images {
    folder: PathBuf,
    by_name: HashMap<String, PathBuf>,
}

impl Images {
    /// Of `images` beside a file, else of its own folder.
    fn around(file: &Path) -> Images {
        let beside = file.with_file_name(IMAGES);
        let folder = if beside.is_dir() { beside } else { file.parent().unwrap_or(Path::new("")).to_owned() };
        let mut paths: Vec<PathBuf> =
            folder.read_dir().into_iter().flatten().flatten().map(|entry| entry.path()).collect();
        paths.sort();
        let mut by_name = HashMap::new();
        for path in paths.into_iter().filter(|path| is_image(path)) {
            for name in [path.file_name(), path.file_stem()].into_iter().flatten() {
                by_name.entry(name.to_string_lossy().into_owned()).or_insert_with(|| path.clone());
            }
        }
        Images { folder, by_name }
    }

    fn find(&self, label: &str) -> PathBuf {
        self.by_name.get(label).cloned().unwrap_or_else(|| self.folder.join(label))
    }
}

/// The numbers of a node's text.
fn numbers<const COUNT: usize>(node: Node<'_, '_>) -> Result<[f64; COUNT], &'static str> {
    let words = node.text().unwrap_or_default().split_whitespace();
    let all = words.map(|word| word.parse().map_err(|_| NUMBERS)).collect::<Result<Vec<f64>, _>>()?;
    all.try_into().map_err(|_| NUMBERS)
}

/// The scale of a component or chunk, and its rotation and translation as a matrix.
fn similarity(node: Node<'_, '_>) -> Result<(f64, DMat4), &'static str> {
    let Some(transform) = child(node, "transform") else { return Ok((1.0, DMat4::IDENTITY)) };
    let part = |name| child(transform, name);
    let rotation = part("rotation").map_or(Ok(DMat3::IDENTITY.to_cols_array()), numbers)?;
    let translation = part("translation").map_or(Ok([0.0; 3]), numbers)?;
    let [scale] = part("scale").map_or(Ok([1.0]), numbers)?;
    // As the file has them, matrices are row by row.
    let rotation = DMat3::from_cols_array(&rotation).transpose();
    let mut matrix = DMat4::from_mat3(rotation);
    matrix.w_axis = DVec3::from_array(translation).extend(1.0);
    Ok((scale, matrix))
}

/// A matrix from camera to component, its translation scaled to the world.
fn rigid(node: Node<'_, '_>, scale: f64) -> Result<DMat4, &'static str> {
    let mut matrix = DMat4::from_cols_array(&numbers(node)?).transpose();
    matrix.w_axis = (scale * matrix.w_axis.truncate()).extend(1.0);
    Ok(matrix)
}

/// The lens of a sensor: the adjusted calibration where there are several.
fn lens(sensor: Node<'_, '_>) -> Result<Lens, &'static str> {
    let adjusted = children(sensor, "calibration").find(|node| node.attribute("class") == Some("adjusted"));
    let calibration = adjusted
        .or_else(|| child(sensor, "calibration"))
        .ok_or("has an aligned camera whose sensor has no calibration; export it again")?;
    let resolution = child(sensor, "resolution").or_else(|| child(calibration, "resolution"));
    let side = |name| resolution.and_then(|node| node.attribute(name)?.parse::<f64>().ok());
    let (Some(w), Some(h)) = (side("width"), side("height")) else {
        return Err("has a sensor without resolution");
    };
    let value = |name: &str| -> Result<Option<f64>, &'static str> {
        child(calibration, name).map(|node| numbers::<1>(node).map(|[value]| value)).transpose()
    };
    let or = |name: &str, other: f64| value(name).map(|value| value.unwrap_or(other));
    // The centre is counted from the image's; PhotoScan had both focal lengths, and the centre from the corner.
    let (fl_x, fl_y, skew, cx, cy) = match value("f")? {
        Some(f) => {
            let (cx, cy) = (or("cx", 0.0)?, or("cy", 0.0)?);
            (f + or("b1", 0.0)?, f, or("b2", 0.0)?, 0.5 * w + cx, 0.5 * h + cy)
        }
        None => {
            let fx = value("fx")?.ok_or("has a calibration without a focal length")?;
            (fx, or("fy", fx)?, or("skew", 0.0)?, or("cx", 0.5 * w)?, or("cy", 0.5 * h)?)
        }
    };
    if skew.abs() > f64::from(LEAST_SKEW) * fl_x.abs() || or("p3", 0.0)? != 0.0 || or("p4", 0.0)? != 0.0 {
        return Err(
            "has a camera with skew (b2) or p3 or p4; optimize the cameras without, or undistort the photographs",
        );
    }
    let some = |value: f64| Some(value as f32);
    let kind = sensor.attribute("type").unwrap_or("frame");
    Ok(Lens {
        w: some(w),
        h: some(h),
        fl_x: some(fl_x),
        fl_y: some(fl_y),
        cx: some(cx),
        cy: some(cy),
        camera_model: Some(kind.to_owned()),
        k1: value("k1")?.and_then(some),
        k2: value("k2")?.and_then(some),
        k3: value("k3")?.and_then(some),
        k4: value("k4")?.and_then(some),
        // OpenCV's first tangential coefficient is that of rows, Metashape's that of columns.
        p1: value("p2")?.and_then(some),
        p2: value("p1")?.and_then(some),
        ..Lens::default()
    })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use glam::{Vec2, Vec3};

    use super::*;

    const SENSOR: &str = r#"<sensor id="0" label="a lens" type="frame"><resolution width="64" height="48"/>
        <calibration type="frame" class="initial"><f>1</f></calibration>
        <calibration type="frame" class="adjusted"><resolution width="64" height="48"/><f>40</f><b1>10</b1><cx>1</cx><cy>-2</cy>
        <k1>0</k1></calibration></sensor>"#;
    const COMPONENT: &str = r#"<component id="0"><transform><rotation locked="true">0 -1 0 1 0 0 0 0 1</rotation>
        <translation>10 20 30</translation><scale>2</scale></transform></component>"#;

    fn file(sensor: &str, component: &str) -> String {
        format!(
            r#"<?xml version="1.0" encoding="UTF-8"?><document version="1.5.0"><chunk label="Chunk 1"><sensors>{sensor}</sensors>
            <components next_id="1">{component}</components><cameras next_id="4">
            <camera id="0" sensor_id="0" component_id="0" label="a"><transform>1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1</transform></camera>
            <camera id="1" sensor_id="0" component_id="0" label="not aligned"/>
            <camera id="2" sensor_id="0" component_id="0" label="off" enabled="false"><transform>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</transform></camera>
            <group label="more"><camera id="3" sensor_id="0" component_id="0" label="c.png"><transform>0 0 1 0 1 0 0 0 0 1 0 0 0 0 0 1</transform></camera>
            </group></cameras></chunk></document>"#
        )
    }

    fn read_text(text: &str) -> Result<Vec<Shot>, String> {
        let place = tempfile::tempdir().unwrap();
        fs::create_dir(place.path().join("images")).unwrap();
        fs::write(place.path().join("images/a.JPG"), "").unwrap();
        fs::write(place.path().join("images/c.png"), "").unwrap();
        let file = place.path().join("any.xml");
        fs::write(&file, text).unwrap();
        assert_eq!(cameras(place.path()).is_some(), text.contains("<chunk"));
        read(&file).map_err(|error| error.to_string())
    }

    /// Places by the formulas of the manual, computed by hand.
    #[test]
    fn cameras_draw_points_where_metashape_does() {
        let shots = read_text(&file(SENSOR, COMPONENT)).unwrap();
        let names: Vec<_> = shots.iter().map(|shot| shot.image.file_name().unwrap().to_owned()).collect();
        assert_eq!(names, ["a.JPG", "c.png"]);
        // The first camera is at (1, 2, 3) of its component, at 2 (-2, 1, 3) + (10, 20, 30) = (6, 22, 36) of the world, and looks along z; its
        // columns run along the world's y, its rows along the world's -x.
        // The second is at (10, 20, 30); its columns are the component's y, the world's -x, its rows z, and it looks along x, the world's y.
        let points = [
            (
                Vec3::new(6.0 - 1.0, 22.0 + 2.0, 36.0 + 4.0),
                Vec2::new(33.0 + 50.0 * 2.0 / 4.0, 22.0 + 40.0 * 1.0 / 4.0),
            ),
            (
                Vec3::new(10.0 - 1.0, 20.0 + 4.0, 30.0 - 2.0),
                Vec2::new(33.0 + 50.0 * 1.0 / 4.0, 22.0 - 40.0 * 2.0 / 4.0),
            ),
        ];
        for (shot, (point, wanted)) in shots.iter().zip(points) {
            let camera = shot.camera(Path::new("any.xml"), None).unwrap();
            let place = camera.project(camera.to_camera().transform_point3(point)).unwrap();
            assert!(place.distance(wanted) < 1e-3, "{place} for {wanted}");
        }
    }

    #[test]
    fn calibrations_are_read_as_the_manual_has_them() {
        let lens_of = |inner: &str| {
            let sensor = format!(
                r#"<sensor id="0" type="frame"><calibration><resolution width="64" height="48"/>{inner}</calibration></sensor>"#
            );
            let document = Document::parse(&sensor).unwrap();
            lens(document.root_element())
        };
        let found = lens_of("<f>40</f><k2>0.5</k2><p1>0.25</p1><p2>0.125</p2>").unwrap();
        assert_eq!((found.k1, found.k2, found.p1, found.p2), (None, Some(0.5), Some(0.125), Some(0.25)));
        assert_eq!((found.cx, found.cy, found.fl_x), (Some(32.0), Some(24.0), Some(40.0)));
        let old = lens_of("<fx>40</fx><fy>50</fy><cx>30</cx><cy>20</cy>").unwrap();
        assert_eq!((old.cx, old.cy, old.fl_x, old.fl_y), (Some(30.0), Some(20.0), Some(40.0), Some(50.0)));
        for (inner, wanted) in [
            ("<f>40</f><b2>3</b2>", "skew"),
            ("<f>40</f><p3>0.1</p3>", "p3"),
            ("<f>forty</f>", "not numbers"),
            ("<k1>0</k1>", "without a focal length"),
        ] {
            assert!(lens_of(inner).unwrap_err().contains(wanted), "{inner}");
        }
    }

    #[test]
    fn faults_of_files_are_named() {
        let whole = file(SENSOR, COMPONENT);
        for (text, wanted) in [
            (whole.replace("sensor id=\"0\"", "sensor id=\"7\""), "sensor it does not have"),
            (whole.replace("type=\"frame\"><resolution", "type=\"spherical\"><resolution"), "nor a fisheye"),
            (whole.replace("<scale>2</scale>", "<scale>two</scale>"), "not numbers"),
            (whole.replace("</document>", "<chunk/></document>"), "more than one chunk"),
            (whole.replace("</cameras>", ""), "any.xml"),
            ("<html/>".to_owned(), "not one of Metashape's"),
        ] {
            let fault = read_text(&text).unwrap_err();
            assert!(fault.contains(wanted), "{fault}");
        }
    }
}
