//! The maps of materials, by the ends of their files' names.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use texfold_core::SourceError;
use texfold_core::image::{Alpha, ColorSpace, ImageSet, MapInfo, MapKind, Raster};

use super::find::{Inputs, Unusable, folder_name};
use super::{Content, Found, Remarks, container, read};
use crate::config::MapName;
use crate::error::CliError;
use crate::settings::{Kind, Settings};

/// A file that is a map by its name, as a material of one map.
pub(super) fn of_file(path: PathBuf) -> Option<Found> {
    let name = MapName::of(&path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let stem = if name.material.is_empty() { folder_name(folder) } else { OsString::from(name.material) };
    Some(Found { path: folder.join(&stem), kind: Kind::Material, files: vec![path], stem })
}

/// The maps among the files of a folder, each as a material of one map; what is none is not read.
pub(super) fn of_folder(path: &Path, files: Vec<PathBuf>, not_read: &mut Vec<PathBuf>) -> Vec<Found> {
    let of_file = |file: PathBuf| match of_file(file.clone()) {
        Some(found) if found.path == path.join(folder_name(path)) => {
            Some(Found { path: path.to_owned(), ..found })
        }
        Some(found) => Some(found),
        None => {
            not_read.push(file);
            None
        }
    };
    files.into_iter().filter_map(of_file).collect()
}

/// Puts maps of the same material together. Of normals in two conventions, those of OpenGL are taken.
pub(super) fn gather(inputs: &mut Inputs) {
    let mut gathered: Vec<Result<Found, Unusable>> = Vec::new();
    for input in inputs.found.drain(..) {
        let same = input.as_ref().ok().filter(|found| found.kind == Kind::Material).and_then(|found| {
            let is_same = |known: &Found| known.kind == Kind::Material && known.path == found.path;
            gathered.iter().position(|known| known.as_ref().is_ok_and(is_same))
        });
        match (same.and_then(|index| gathered.get_mut(index)), input) {
            (Some(Ok(known)), Ok(found)) => known.files.extend(found.files),
            (_, input) => gathered.push(input),
        }
    }
    for found in gathered.iter_mut().flatten().filter(|found| found.kind == Kind::Material) {
        found.files.sort();
        let is_directx = |file: &PathBuf| MapName::of(file).is_some_and(|name| name.is_directx());
        let is_opengl = |file: &PathBuf| {
            MapName::of(file).is_some_and(|name| name.kind == MapKind::Normal && !name.is_directx())
        };
        if found.files.iter().any(is_opengl) {
            let (left, kept) = found.files.drain(..).partition(is_directx);
            found.files = kept;
            inputs.not_read.extend::<Vec<PathBuf>>(left);
        }
    }
    inputs.found = gathered;
}

/// Reads the maps of a material. Gray that is stored as RGB becomes one channel.
pub(crate) fn read_maps(
    files: &[PathBuf],
    settings: &Settings,
    limit_bytes: u64,
    remarks: &mut Remarks,
) -> Result<ImageSet, CliError> {
    let mut maps: Vec<(MapKind, String, Raster)> = Vec::new();
    for path in files {
        let name = MapName::of(path).ok_or_else(|| CliError::NoMaps { path: path.clone() })?;
        let color = name.color();
        // Beside data stands more data, whatever the format calls it.
        let beside = if color == ColorSpace::Srgb { settings.alpha } else { Some(Alpha::Band) };
        let of_map = Settings { color, alpha: beside, ..settings.clone() };
        let raster = match read(path, &of_map, limit_bytes, remarks)? {
            Content::Pixels(raster) => raster,
            Content::Blocks { image, alpha } => container::decode(path, image, alpha, &of_map)?,
        };
        if name.is_directx() {
            remarks.note(path, "normals of DirectX, whose green points down, are kept as they are");
        }
        let raster = if is_gray(&raster) && color == ColorSpace::Linear {
            remarks.note(path, "gray that is stored as RGB: one channel is kept");
            raster.with_channels(1)
        } else {
            raster
        };
        maps.push((name.kind, map_name(path, name.kind, &maps), raster));
    }
    let first = files.first().cloned().unwrap_or_default();
    // Colour comes first, whatever the files are named.
    maps.sort_by_key(|(kind, ..)| MapKind::ALL.iter().position(|other| other == kind));
    ImageSet::of_maps(maps).map_err(|source: SourceError| CliError::Source { path: first, source })
}

/// The file's name without extension, or the kind where that is no name for a map.
fn map_name(path: &Path, kind: MapKind, others: &[(MapKind, String, Raster)]) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let is_free = |name: &String| others.iter().all(|(_, other, _)| other != name);
    if MapInfo::is_name(&stem) && is_free(&stem) {
        return stem;
    }
    let numbered = |number: usize| match number {
        0 => kind.name().to_owned(),
        _ => format!("{}-{number}", kind.name()),
    };
    (0..=others.len()).map(numbered).find(is_free).unwrap_or_default()
}

/// Whether an image of three channels has the same in all of them.
pub(crate) fn is_gray(image: &Raster) -> bool {
    image.info().channels == 3 && image.texels().all(|texel| texel.x == texel.y && texel.y == texel.z)
}
