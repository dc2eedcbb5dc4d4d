//! Meshes without texture coordinates: OBJ by `tobj`, glTF and GLB by `gltf`, PLY (text and little-endian) read here.

use std::io::BufReader;
use std::path::Path;

use glam::Vec3;
use texfold::core::Mesh;

use super::mesh::read_gltf_shape;
use crate::error::CliError;

/// Most vertices or faces of a PLY file, so that a header cannot ask for more memory than there is.
const MAX_ELEMENTS: usize = 1 << 24;

/// Reads a mesh by its extension.
pub(crate) fn read(path: &Path) -> Result<Mesh, CliError> {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let fault = |what| CliError::ShapeContent { path: path.to_owned(), what };
    let mesh = match extension.to_ascii_lowercase().as_str() {
        "obj" => read_obj(path)?,
        "ply" => {
            let bytes =
                std::fs::read(path).map_err(|source| CliError::Read { path: path.to_owned(), source })?;
            read_ply(&bytes).map_err(fault)?
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

fn read_obj(path: &Path) -> Result<Mesh, CliError> {
    let file =
        std::fs::File::open(path).map_err(|source| CliError::Read { path: path.to_owned(), source })?;
    let options = tobj::LoadOptions { triangulate: true, ..tobj::LoadOptions::default() };
    let no_materials = |_: &Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut BufReader::new(file), &options, no_materials)
        .map_err(|source| CliError::Mesh { path: path.to_owned(), source: source.into() })?;
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

/// A type of numbers in a PLY file, by its bytes.
#[derive(Debug, Clone, Copy)]
enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

/// A property of an element: the type of a list's length where it is a list, the type of its values, and its name.
#[derive(Debug)]
struct Property<'t> {
    length: Option<Number>,
    value: Number,
    name: &'t str,
}

#[derive(Debug)]
struct Element<'t> {
    name: &'t str,
    count: usize,
    properties: Vec<Property<'t>>,
}

fn number(name: &str) -> Option<Number> {
    Some(match name {
        "char" | "int8" => Number::I8,
        "uchar" | "uint8" => Number::U8,
        "short" | "int16" => Number::I16,
        "ushort" | "uint16" => Number::U16,
        "int" | "int32" => Number::I32,
        "uint" | "uint32" => Number::U32,
        "float" | "float32" => Number::F32,
        "double" | "float64" => Number::F64,
        _ => return None,
    })
}

/// Values of a PLY file in their order, from text or from bytes.
enum Values<'t> {
    Text(std::str::SplitAsciiWhitespace<'t>),
    Bytes(&'t [u8]),
}

impl Values<'_> {
    fn next(&mut self, kind: Number) -> Result<f64, &'static str> {
        match self {
            Values::Text(words) => {
                let word = words.next().ok_or("ends early")?;
                word.parse().map_err(|_| "has a word that is no number")
            }
            Values::Bytes(bytes) => {
                let mut take = |count: usize| {
                    let (head, tail) = bytes.split_at_checked(count)?;
                    *bytes = tail;
                    let mut word = [0; 8];
                    word[..count].copy_from_slice(head);
                    Some(word)
                };
                let low = |word: [u8; 8]| [word[0], word[1], word[2], word[3]];
                let value = match kind {
                    Number::I8 => take(1).map(|word| f64::from(word[0] as i8)),
                    Number::U8 => take(1).map(|word| f64::from(word[0])),
                    Number::I16 => take(2).map(|word| f64::from(i16::from_le_bytes([word[0], word[1]]))),
                    Number::U16 => take(2).map(|word| f64::from(u16::from_le_bytes([word[0], word[1]]))),
                    Number::I32 => take(4).map(|word| f64::from(i32::from_le_bytes(low(word)))),
                    Number::U32 => take(4).map(|word| f64::from(u32::from_le_bytes(low(word)))),
                    Number::F32 => take(4).map(|word| f64::from(f32::from_le_bytes(low(word)))),
                    Number::F64 => take(8).map(f64::from_le_bytes),
                };
                value.ok_or("ends early")
            }
        }
    }
}

fn read_ply(bytes: &[u8]) -> Result<Mesh, &'static str> {
    let marker = b"end_header";
    let end = bytes.windows(marker.len()).position(|window| window == marker).ok_or("has no PLY header")?;
    let body = bytes[end..].iter().position(|&byte| byte == b'\n').ok_or("has no PLY body")? + end + 1;
    let head = std::str::from_utf8(&bytes[..end]).map_err(|_| "has a header that is no text")?;
    let (elements, is_text) = read_header(head)?;
    let mut values = if is_text {
        let text = std::str::from_utf8(&bytes[body..]).map_err(|_| "has a body that is no text")?;
        Values::Text(text.split_ascii_whitespace())
    } else {
        Values::Bytes(&bytes[body..])
    };
    let mut mesh = Mesh::default();
    for element in &elements {
        for _ in 0..element.count {
            read_element(element, &mut values, &mut mesh)?;
        }
    }
    Ok(mesh)
}

fn read_header(head: &str) -> Result<(Vec<Element<'_>>, bool), &'static str> {
    let mut elements: Vec<Element<'_>> = Vec::new();
    let mut is_text = true;
    for (index, line) in head.lines().enumerate() {
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            ["ply"] if index == 0 => {}
            _ if index == 0 => return Err("has no PLY header"),
            ["format", "ascii", _] => is_text = true,
            ["format", "binary_little_endian", _] => is_text = false,
            ["format", ..] => return Err("is PLY in an order of bytes that is not read"),
            ["element", name, count] => {
                let count = count.parse().map_err(|_| "has an element without a count")?;
                if count > MAX_ELEMENTS {
                    return Err("has more than 16 million vertices or faces");
                }
                elements.push(Element { name, count, properties: Vec::new() });
            }
            ["property", ref rest @ ..] => {
                let unknown = "has a property of an unknown type";
                let property = match *rest {
                    ["list", length, value, name] => Property {
                        length: Some(number(length).ok_or(unknown)?),
                        value: number(value).ok_or(unknown)?,
                        name,
                    },
                    [value, name] => Property { length: None, value: number(value).ok_or(unknown)?, name },
                    _ => return Err(unknown),
                };
                elements.last_mut().ok_or("has a property before its element")?.properties.push(property);
            }
            _ => {}
        }
    }
    Ok((elements, is_text))
}

fn read_element(element: &Element<'_>, values: &mut Values<'_>, mesh: &mut Mesh) -> Result<(), &'static str> {
    let mut place = Vec3::ZERO;
    for property in &element.properties {
        let Some(length) = property.length else {
            let value = values.next(property.value)? as f32;
            match property.name {
                "x" => place.x = value,
                "y" => place.y = value,
                "z" => place.z = value,
                _ => {}
            }
            continue;
        };
        let length = values.next(length)?;
        let is_face = element.name == "face" && matches!(property.name, "vertex_indices" | "vertex_index");
        let mut fan: Option<(u32, u32)> = None;
        let mut first = 0;
        for corner in 0..length as u64 {
            // Negative and fractional numbers name no vertex and are reported as such.
            let value = values.next(property.value)?;
            let index = if value >= 0.0 && value.fract() == 0.0 { value as u32 } else { u32::MAX };
            if !is_face {
                continue;
            }
            match (corner, fan) {
                (0, _) => first = index,
                (_, None) => fan = Some((first, index)),
                (_, Some((first, last))) => {
                    mesh.triangles.push([first, last, index]);
                    fan = Some((first, index));
                }
            }
        }
    }
    if element.name == "vertex" {
        mesh.positions.push(place);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use base64::prelude::{BASE64_STANDARD, Engine};

    use super::*;

    const HEAD: &str = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n";

    #[test]
    fn text_and_bytes_give_the_same_mesh() {
        let text = format!("ply\nformat ascii 1.0\n{HEAD}0 0 0 9\n1 0 0 9\n1 1.5 0 9\n0 1 -2 9\n4 0 1 2 3\n");
        let mesh = read_ply(text.as_bytes()).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.positions[2], Vec3::new(1.0, 1.5, 0.0));
        let mut bytes = format!("ply\nformat binary_little_endian 1.0\n{HEAD}").into_bytes();
        for position in &mesh.positions {
            bytes.extend(position.to_array().map(f32::to_le_bytes).concat());
            bytes.push(9);
        }
        bytes.push(4);
        bytes.extend([0i32, 1, 2, 3].map(i32::to_le_bytes).concat());
        assert_eq!(read_ply(&bytes), Ok(mesh));
        bytes.pop();
        assert_eq!(read_ply(&bytes), Err("ends early"));
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
        assert!(matches!(read(&path), Err(CliError::Mesh { .. })));
        std::fs::write(&path, text("").replace("48", "480")).unwrap();
        assert!(matches!(read(&path), Err(CliError::MeshContent { .. })));
        std::fs::write(&path, text("").replace("POSITION", "NORMAL")).unwrap();
        assert!(read(&path).is_err());
    }

    #[test]
    fn damaged_files_are_named() {
        assert_eq!(read_ply(b"obj"), Err("has no PLY header"));
        assert_eq!(
            read_ply(b"ply\nformat binary_big_endian 1.0\nend_header\n").map(|_| ()),
            Err("is PLY in an order of bytes that is not read")
        );
        assert!(read_ply(b"ply\nformat ascii 1.0\nelement vertex 99999999999\nend_header\n").is_err());
        let bad = "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n3 0 -1 7\n";
        assert!(!read_ply(bad.as_bytes()).unwrap().is_valid());
    }
}
