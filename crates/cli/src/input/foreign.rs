//! Any bytes as an input of a kind, for the fuzz target of inputs.

use std::path::Path;

use texfold::bank::Manifest;
use texfold_capture::{read_cameras, read_mesh, read_uv_mesh};

use super::{bands::Bands, frames, pixels, stack};
use crate::config::Options;
use crate::error::{CliError, guarded};
use crate::files;
use crate::input::{Remarks, read_files};

/// Names of files, one a kind of input. What an image is its bytes tell, but for TGA. A file of cameras by COLMAP is two files, with a zero between them; as binary the length of the first comes first.
pub const FOREIGN: [&str; 13] = [
    "image.png",
    "image.tga",
    "mesh.obj",
    "mesh.ply",
    "mesh.glb",
    "transforms.json",
    "images.txt",
    "zipmap.toml",
    "bank.json",
    "images.bin",
    "toy_par.txt",
    "cameras.xml",
    "scene.mvs",
];

/// Reads a file of one of the names in [`FOREIGN`] with at most so many bytes; the fault that a user would see. A panic of a decoder becomes one, too.
///
/// # Errors
/// The fault of the file, in words.
pub fn read_foreign(path: &Path, limit_bytes: u64) -> Result<(), String> {
    guarded(path, || read(path, limit_bytes)).map_err(|error| error.to_string())
}

fn read(path: &Path, limit_bytes: u64) -> Result<(), CliError> {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let ending = name.rsplit('.').next().unwrap_or_default();
    match ending {
        "png" | "tga" => image(path, limit_bytes),
        "obj" | "ply" | "glb" => {
            // Each takes what the other may refuse.
            let with_coordinates = read_uv_mesh(path).map(|_| ());
            Ok(read_mesh(path).map(|_| ()).and(with_coordinates)?)
        }
        "txt" if name.ends_with("_par.txt") => cameras(path),
        "bin" => {
            let bytes = files::read(path)?;
            let (length, rest) = bytes.split_first_chunk().unwrap_or((&[0; 2], &[]));
            let (images, lenses) = rest.split_at(usize::from(u16::from_le_bytes(*length)).min(rest.len()));
            for (name, bytes) in [(name, images), ("cameras.bin", lenses)] {
                let path = path.with_file_name(name);
                std::fs::write(&path, bytes).map_err(|source| CliError::Write { path, source })?;
            }
            cameras(path)
        }
        "txt" => {
            let bytes = files::read(path)?;
            let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
            let (images, lenses) = bytes.split_at(end);
            for (name, text) in [(name, images), ("cameras.txt", lenses.get(1..).unwrap_or_default())] {
                let path = path.with_file_name(name);
                std::fs::write(&path, text).map_err(|source| CliError::Write { path, source })?;
            }
            cameras(path)
        }
        "json" if name == "bank.json" => {
            let bytes = files::read(path)?;
            let parsed = Manifest::<crate::report::Row>::parse(&bytes);
            parsed
                .map(|_| ())
                .map_err(|what| texfold::bank::BankError::Manifest { path: path.to_owned(), what }.into())
        }
        "json" | "xml" | "mvs" => cameras(path),
        _ => stack::image_files(path.parent().unwrap_or(Path::new(""))).map(|_| ()),
    }
}

fn cameras(path: &Path) -> Result<(), CliError> {
    for shot in read_cameras(path)? {
        shot.camera(path, Some((8, 6)))?;
    }
    Ok(())
}

/// All frames, and the first image band by band.
fn image(path: &Path, limit_bytes: u64) -> Result<(), CliError> {
    let (settings, mut remarks) = (Options::default().resolve(path)?, Remarks::default());
    let files = [path.to_owned()];
    let whole = read_files(&files, false, &settings, limit_bytes, &mut remarks).map(|_| ());
    if frames::count(path) > 1 {
        read_files(&files, true, &settings, limit_bytes, &mut remarks)?;
    }
    let mut bands = Bands::open(path, &settings, limit_bytes, &mut remarks, |remarks| {
        pixels::read(path, settings.color, settings.alpha, limit_bytes, remarks)
    })?;
    // As many rows at a time as 16 MB hold.
    let size = bands.size();
    let rows = ((1 << 20) / size.width.max(1)).clamp(1, size.height);
    let mut left = size.height;
    while left > 0 {
        bands.next(rows.min(left))?;
        left -= rows.min(left);
    }
    whole
}
