//! Meshes without texture coordinates: OBJ by `tobj`, glTF and GLB by `gltf`, PLY by `serde-ply`.
//!
//! *Not taken*: `ply-rs-bw`, which keeps a map from names to values for each vertex.

use std::io::BufReader;
use std::path::Path;

use glam::Vec3;
use serde::Deserialize;
use serde::de::DeserializeSeed;
use serde_ply::{DeserializeError, PlyChunkedReader, PlyFormat, RowVisitor};
use texfold::core::Mesh;

use crate::error::CaptureError;
use crate::files;
use crate::uv_mesh::read_gltf_shape;

/// Most vertices or faces of a PLY file: rows without properties take no bytes of it.
const MAX_ELEMENTS: usize = 1 << 24;

/// Reads a mesh, by its extension: OBJ, PLY, glTF or GLB.
///
/// # Errors
/// [`CaptureError::Read`], [`CaptureError::Mesh`], [`CaptureError::MeshContent`].
pub fn read(path: &Path) -> Result<Mesh, CaptureError> {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let fault = |what| CaptureError::MeshContent { path: path.to_owned(), what };
    let mesh = match extension.to_ascii_lowercase().as_str() {
        "obj" => read_obj(path)?,
        "ply" => {
            let bytes = files::read(path)?;
            read_ply(bytes).map_err(|error| match error {
                PlyError::Content(what) => fault(what),
                PlyError::Read(source) => CaptureError::Mesh { path: path.to_owned(), source: source.into() },
            })?
        }
        "gltf" | "glb" => {
            let (positions, triangles) = read_gltf_shape(path)?;
            Mesh { positions, triangles }
        }
        _ => return Err(fault("is none of OBJ, PLY, glTF and GLB")),
    };
    if mesh.triangles.is_empty() {
        Err(fault("has no triangles"))
    } else if !mesh.is_valid() {
        Err(fault("has indices or numbers out of range"))
    } else {
        Ok(mesh)
    }
}

fn read_obj(path: &Path) -> Result<Mesh, CaptureError> {
    let file = files::open(path).map_err(|source| CaptureError::Read { path: path.to_owned(), source })?;
    let options = tobj::LoadOptions { triangulate: true, ..tobj::LoadOptions::default() };
    let no_materials = |_: &Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut BufReader::new(file), &options, no_materials)
        .map_err(|source| CaptureError::Mesh { path: path.to_owned(), source: source.into() })?;
    let mut whole = Mesh::default();
    for tobj::Mesh { positions, indices, .. } in models.into_iter().map(|model| model.mesh) {
        let first = whole.positions.len() as u32;
        whole.positions.extend(positions.chunks_exact(3).map(Vec3::from_slice));
        // An index that overflows stays out of range and is reported as such.
        let corner = |index: u32| index.saturating_add(first);
        whole.triangles.extend(indices.chunks_exact(3).map(|t| [corner(t[0]), corner(t[1]), corner(t[2])]));
    }
    Ok(whole)
}

/// Why a PLY file is no mesh.
#[derive(Debug)]
enum PlyError {
    Content(&'static str),
    Read(DeserializeError),
}

#[derive(Deserialize)]
struct Vertex {
    x: f32,
    y: f32,
    z: f32,
}

#[derive(Deserialize)]
struct Face {
    #[serde(alias = "vertex_index")]
    vertex_indices: Vec<u32>,
}

/// A row of an element that is no part of a mesh.
#[derive(Deserialize)]
struct Skipped {}

fn read_ply(bytes: Vec<u8>) -> Result<Mesh, PlyError> {
    let mut file = PlyChunkedReader::new();
    *file.buffer_mut() = bytes;
    let header = file.header().ok_or(PlyError::Content("has no PLY header"))?.clone();
    if header.format == PlyFormat::Ascii {
        // The last word may lack the space or line that ends a word.
        file.buffer_mut().push(b'\n');
    }
    let mut mesh = Mesh::default();
    for element in header.elem_defs {
        if element.count > MAX_ELEMENTS {
            return Err(PlyError::Content("has more than 16 million vertices or faces"));
        }
        let mut rows = 0;
        let read = match element.name.as_str() {
            "vertex" => RowVisitor::new(|Vertex { x, y, z }| {
                rows += 1;
                mesh.positions.push(Vec3::new(x, y, z));
            })
            .deserialize(&mut file),
            "face" => RowVisitor::new(|Face { vertex_indices: corners }| {
                rows += 1;
                if let [first, rest @ ..] = corners.as_slice() {
                    mesh.triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
                }
            })
            .deserialize(&mut file),
            _ => RowVisitor::new(|Skipped {}| rows += 1).deserialize(&mut file),
        };
        read.map_err(PlyError::Read)?;
        if rows < element.count {
            return Err(PlyError::Content("ends early"));
        }
    }
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use base64::prelude::{BASE64_STANDARD, Engine};

    use super::*;

    const HEAD: &str = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n\
        element edge 1\nproperty uchar from\nproperty uchar to\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";

    #[test]
    fn text_and_bytes_give_the_same_mesh() {
        let text =
            format!("ply\nformat ascii 1.0\n{HEAD}0 0 0 9\n1 0 0 9\n1 1.5 0 9\n0 1 -2 9\n7 8\n4 0 1 2 3");
        let mesh = read_ply(text.into_bytes()).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.positions[2], Vec3::new(1.0, 1.5, 0.0));
        for order in ["little", "big"] {
            let turned = |mut word: [u8; 4]| {
                if order == "big" {
                    word.reverse();
                }
                word
            };
            let mut bytes = format!("ply\nformat binary_{order}_endian 1.0\n{HEAD}").into_bytes();
            for position in &mesh.positions {
                bytes.extend(position.to_array().map(|value| turned(value.to_le_bytes())).concat());
                bytes.push(9);
            }
            bytes.extend([7, 8, 4]);
            bytes.extend([0i32, 1, 2, 3].map(|index| turned(index.to_le_bytes())).concat());
            assert_eq!(read_ply(bytes.clone()).unwrap(), mesh);
            for length in 0..bytes.len() {
                assert!(read_ply(bytes[..length].to_vec()).is_err(), "{length} bytes");
            }
        }
    }

    #[test]
    fn gltf_gives_places_and_triangles_without_texture_coordinates() {
        let dir = tempfile::tempdir().unwrap();
        let numbers: [f32; 9] = [0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0, 0.0];
        let mut bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        bytes.extend([0u16, 1, 2, 0, 2, 1].map(u16::to_le_bytes).concat());
        let text = |indices: &str| {
            format!(
                r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
                "nodes":[{{"mesh":0,"translation":[0,0,5]}}],
                "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}{indices}}}]}}],
                "buffers":[{{"byteLength":48,"uri":"data:application/octet-stream;base64,{}"}}],
                "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":12}}],
                "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[2,3,0]}},
                {{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}}]}}"#,
                BASE64_STANDARD.encode(&bytes)
            )
        };
        let path = dir.path().join("a.gltf");
        std::fs::write(&path, text(r#","indices":1"#)).unwrap();
        let mesh = read(&path).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 1]]);
        assert_eq!(mesh.positions[1], Vec3::new(2.0, 0.0, 5.0));
        std::fs::write(&path, text("")).unwrap();
        assert_eq!(read(&path).unwrap().triangles, [[0, 1, 2]]);
        std::fs::write(&path, &text("")[..200]).unwrap();
        assert!(matches!(read(&path), Err(CaptureError::Mesh { .. })));
        std::fs::write(&path, text("").replace("48", "480")).unwrap();
        assert!(matches!(read(&path), Err(CaptureError::UvMeshContent { .. })));
        std::fs::write(&path, text("").replace("POSITION", "NORMAL")).unwrap();
        assert!(read(&path).is_err());
    }

    #[test]
    fn damaged_files_are_named() {
        let fails = |text: &str| read_ply(text.as_bytes().to_vec()).unwrap_err();
        assert!(matches!(fails("obj"), PlyError::Content("has no PLY header")));
        let many = "ply\nformat ascii 1.0\nelement vertex 99999999999\nend_header\n";
        assert!(matches!(fails(many), PlyError::Content(_)));
        let face =
            "ply\nformat ascii 1.0\nelement face 1\nproperty list uint int vertex_indices\nend_header\n";
        assert!(matches!(fails(&format!("{face}3 0 -1 7\n")), PlyError::Read(_)));
        assert!(matches!(fails(&format!("{face}4294967295 0\n")), PlyError::Content("ends early")));
        let seed = "ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty list char float x\nend_header\n";
        assert!(matches!(fails(&format!("{seed}\u{1}aaaa")), PlyError::Read(_)));
    }
}
