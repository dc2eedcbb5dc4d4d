//! Meshes with texture coordinates: OBJ by `tobj`, glTF and GLB by `gltf`.
//!
//! OBJ counts v from below, glTF from above; [`UvMesh`] from above.

use std::error::Error;
use std::io::BufReader;
use std::path::Path;

use base64::alphabet;
use base64::engine::{DecodePaddingMode, Engine, GeneralPurpose, GeneralPurposeConfig};
use glam::{Mat4, Vec2, Vec3};
use texfold::core::mesh::UvMesh;

use crate::error::CaptureError;
use crate::files;

/// Buffers and images within glTF files, which some exporters write without padding.
pub const BASE64: GeneralPurpose = GeneralPurpose::new(
    &alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// Deepest nesting of glTF nodes that is followed; deeper scenes are loops in practice.
const MAX_DEPTH: u32 = 64;

/// Faults of meshes that may have triangles all the same.
pub(crate) const NO_COORDINATES: &str = "has no triangles with texture coordinates";
pub(crate) const OTHER_FORMAT: &str = "is none of OBJ, glTF and GLB";

/// Reads a mesh with texture coordinates, by its extension: OBJ, glTF or GLB.
///
/// # Errors
/// [`CaptureError::Read`], [`CaptureError::Mesh`], [`CaptureError::UvMeshContent`].
pub fn read(path: &Path) -> Result<UvMesh, CaptureError> {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let mesh = match extension.to_ascii_lowercase().as_str() {
        "obj" => read_obj(path)?,
        "gltf" | "glb" => read_gltf(path)?,
        _ => {
            return Err(CaptureError::UvMeshContent { path: path.to_owned(), what: OTHER_FORMAT });
        }
    };
    let fault = |what| CaptureError::UvMeshContent { path: path.to_owned(), what };
    if mesh.triangles.is_empty() {
        Err(fault(NO_COORDINATES))
    } else if !mesh.is_valid() {
        Err(fault("has indices or numbers out of range"))
    } else {
        Ok(mesh)
    }
}

fn wrong<E: Into<Box<dyn Error + Send + Sync>>>(path: &Path) -> impl Fn(E) -> CaptureError {
    move |source| CaptureError::Mesh { path: path.to_owned(), source: source.into() }
}

fn read_obj(path: &Path) -> Result<UvMesh, CaptureError> {
    let file = files::open(path).map_err(|source| CaptureError::Read { path: path.to_owned(), source })?;
    let options = tobj::LoadOptions { triangulate: true, single_index: true, ..tobj::LoadOptions::default() };
    let no_materials = |_: &Path| Ok(Default::default());
    let (models, _) =
        tobj::load_obj_buf(&mut BufReader::new(file), &options, no_materials).map_err(wrong(path))?;
    let mut whole = UvMesh::default();
    for tobj::Mesh { positions, texcoords, indices, .. } in models.into_iter().map(|model| model.mesh) {
        if texcoords.is_empty() {
            continue;
        }
        let positions = positions.chunks_exact(3).map(Vec3::from_slice);
        let uvs = texcoords.chunks_exact(2).map(|uv| Vec2::new(uv[0], 1.0 - uv[1]));
        append(&mut whole, positions.collect(), uvs.collect(), &indices);
    }
    Ok(whole)
}

fn append(whole: &mut UvMesh, positions: Vec<Vec3>, uvs: Vec<Vec2>, indices: &[u32]) {
    let first = whole.positions.len() as u32;
    whole.positions.extend(positions);
    whole.uvs.extend(uvs);
    // An index that overflows stays out of range and is reported as such.
    let corner = |index: u32| index.saturating_add(first);
    whole.triangles.extend(indices.chunks_exact(3).map(|t| [corner(t[0]), corner(t[1]), corner(t[2])]));
}

fn read_gltf(path: &Path) -> Result<UvMesh, CaptureError> {
    let mut whole = UvMesh::default();
    each_primitive(path, |primitive, positions, indices, buffers| {
        let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(Vec::as_slice));
        if let Some(uvs) = reader.read_tex_coords(0) {
            append(&mut whole, positions, uvs.into_f32().map(Vec2::from).collect(), &indices);
        }
    })?;
    Ok(whole)
}

/// Places and triangles of a glTF or GLB file, with or without texture coordinates.
pub(crate) fn read_gltf_shape(path: &Path) -> Result<(Vec<Vec3>, Vec<[u32; 3]>), CaptureError> {
    let mut whole = UvMesh::default();
    each_primitive(path, |_, positions, indices, _| append(&mut whole, positions, Vec::new(), &indices))?;
    Ok((whole.positions, whole.triangles))
}

/// Shows all triangles of a scene, primitive by primitive: places, in the scene's space, and indices.
fn each_primitive(
    path: &Path,
    mut see: impl FnMut(&gltf::Primitive<'_>, Vec<Vec3>, Vec<u32>, &[Vec<u8>]),
) -> Result<(), CaptureError> {
    let bytes = files::read(path)?;
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice(&bytes).map_err(wrong(path))?;
    let buffers = buffers(path, &document, blob)?;
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let roots: Vec<gltf::Node<'_>> = match scene {
        Some(scene) => scene.nodes().collect(),
        None => document.nodes().collect(),
    };
    let mut open: Vec<(gltf::Node<'_>, Mat4, u32)> =
        roots.into_iter().map(|node| (node, Mat4::IDENTITY, 0)).collect();
    while let Some((node, above, depth)) = open.pop() {
        let place = above * Mat4::from_cols_array_2d(&node.transform().matrix());
        for primitive in node.mesh().iter().flat_map(|mesh| mesh.primitives()) {
            if primitive.mode() != gltf::mesh::Mode::Triangles {
                continue;
            }
            let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(Vec::as_slice));
            let Some(positions) = reader.read_positions() else { continue };
            let positions: Vec<Vec3> =
                positions.map(|position| place.transform_point3(Vec3::from(position))).collect();
            let indices: Vec<u32> = match reader.read_indices() {
                Some(indices) => indices.into_u32().collect(),
                None => (0..positions.len() as u32).collect(),
            };
            see(&primitive, positions, indices, &buffers);
        }
        if depth < MAX_DEPTH {
            open.extend(node.children().map(|child| (child, place, depth + 1)));
        }
    }
    Ok(())
}

/// The bytes of all buffers: the GLB's own, base64 within the file, or files beside it.
fn buffers(
    path: &Path,
    document: &gltf::Document,
    mut blob: Option<Vec<u8>>,
) -> Result<Vec<Vec<u8>>, CaptureError> {
    let fault = |what| CaptureError::UvMeshContent { path: path.to_owned(), what };
    let load = |buffer: gltf::Buffer<'_>| {
        let bytes = match buffer.source() {
            gltf::buffer::Source::Bin => blob.take().ok_or(fault("lacks its binary chunk"))?,
            gltf::buffer::Source::Uri(uri) if uri.starts_with("data:") => {
                let text = uri.split_once(";base64,").map(|(_, text)| text);
                text.and_then(|text| BASE64.decode(text).ok())
                    .ok_or(fault("has a buffer that is no base64"))?
            }
            gltf::buffer::Source::Uri(uri) => {
                let file = path.parent().unwrap_or(Path::new("")).join(uri);
                files::read(&file)?
            }
        };
        if bytes.len() < buffer.length() {
            return Err(fault("has a buffer shorter than stated"));
        }
        Ok(bytes)
    };
    document.buffers().map(load).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn obj_and_gltf_give_the_same_mesh() {
        let dir = tempfile::tempdir().unwrap();
        let obj = dir.path().join("a.obj");
        std::fs::write(&obj, "v 0 0 0\nv 2 0 0\nv 0 3 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n").unwrap();
        let numbers = [0.0f32, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0];
        let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        let text = format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}}}}]}}],
            "buffers":[{{"byteLength":60,"uri":"data:application/octet-stream;base64,{}"}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":24}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[2,3,0]}},
            {{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}}]}}"#,
            BASE64.encode(&bytes)
        );
        let gltf = dir.path().join("a.gltf");
        std::fs::write(&gltf, text).unwrap();
        let expected = read(&obj).unwrap();
        assert_eq!(expected.uvs, [Vec2::new(0.0, 1.0), Vec2::new(1.0, 1.0), Vec2::new(0.0, 0.0)]);
        assert_eq!(expected.triangles, [[0, 1, 2]]);
        assert_eq!(read(&gltf).unwrap(), expected);
    }

    #[test]
    fn meshes_without_coordinates_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let obj = dir.path().join("a.obj");
        std::fs::write(&obj, "v 0 0 0\nv 2 0 0\nv 0 3 0\nf 1 2 3\n").unwrap();
        assert!(matches!(read(&obj), Err(CaptureError::UvMeshContent { .. })));
        std::fs::write(&obj, "v 0 0 0\nf 1/1 2/2 9/9\n").unwrap();
        assert!(read(&obj).is_err());
        let other = dir.path().join("a.stl");
        std::fs::write(&other, "solid").unwrap();
        assert!(matches!(read(&other), Err(CaptureError::UvMeshContent { .. })));
    }
}
