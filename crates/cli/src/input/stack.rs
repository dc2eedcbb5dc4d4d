//! Zoom stacks: a folder of photographs to be put in order, or with `zipmap.toml`, which says where each has its place.

use std::path::{Path, PathBuf};

use glam::DMat3;
use serde::Deserialize;
use texfold::{LeftOut, PatchSource, PatchStack, register};
use texfold_core::Job;
use texfold_core::image::{Alpha, ColorSpace, Raster};

use super::pixels;
use crate::config::ZoomSettings;
use crate::error::CliError;

/// Name of the list of patches.
pub(crate) const LIST_NAME: &str = "zipmap.toml";

/// A list of patches as it is written.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    root: PathBuf,
    #[serde(default)]
    patch: Vec<Entry>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    image: PathBuf,
    /// Row by row, from the root's texture coordinates to the patch's.
    matrix: Vec<f64>,
    mask: Option<PathBuf>,
    /// The image of the patch that it lies on.
    parent: Option<PathBuf>,
}

fn read_list(dir: &Path) -> Result<List, CliError> {
    let path = dir.join(LIST_NAME);
    let text =
        std::fs::read_to_string(&path).map_err(|source| CliError::Read { path: path.clone(), source })?;
    toml::from_str(&text).map_err(|source| CliError::StackFile { path, source: Box::new(source) })
}

/// All files that a list names, root first, each once.
pub(crate) fn image_files(dir: &Path) -> Result<Vec<PathBuf>, CliError> {
    let list = read_list(dir)?;
    let mut files = vec![dir.join(&list.root)];
    for name in list.patch.iter().flat_map(|entry| [Some(&entry.image), entry.mask.as_ref()]).flatten() {
        let path = dir.join(name);
        if !files.contains(&path) {
            files.push(path);
        }
    }
    Ok(files)
}

/// A stack, and a word about each photograph that is no part of it.
#[derive(Debug)]
pub(crate) struct Loaded {
    pub(crate) stack: PatchStack,
    pub(crate) left_out: Vec<String>,
}

/// Reads a folder and finds each photograph's place.
pub(crate) fn read(
    dir: &Path,
    files: &[PathBuf],
    settings: &ZoomSettings,
    limit_bytes: u64,
    job: &mut Job<'_>,
) -> Result<Loaded, CliError> {
    let ZoomSettings { color, alpha, .. } = *settings;
    if dir.join(LIST_NAME).exists() {
        return by_hand(dir, (color, alpha), limit_bytes);
    }
    let photos: Result<Vec<Raster>, CliError> =
        files.iter().map(|file| pixels::read(file, color, alpha, limit_bytes)).collect();
    let photos = photos?;
    let fault = |source| CliError::Encode { path: dir.to_owned(), source };
    let found = job.within(0.0, 0.5, |job| register(&photos, job)).map_err(fault)?;
    let name = |index: usize| {
        let file = files.get(index).and_then(|file| file.file_name());
        file.unwrap_or_default().to_string_lossy().into_owned()
    };
    let word = |&(photo, reason): &(usize, LeftOut)| match reason {
        LeftOut::NoFiner { than, zoom } => {
            format!("{}: is no finer than {}, which shows the same (zoom {zoom:.2})", name(photo), name(than))
        }
        reason => format!("{}: {reason}", name(photo)),
    };
    let left_out = found.left_out.iter().map(word).collect();
    let no_root = CliError::EmptyFolder { path: dir.to_owned() };
    let stack = PatchStack::registered(&photos, &found).ok_or(no_root)?;
    Ok(Loaded { stack, left_out })
}

fn by_hand(
    dir: &Path,
    (color, alpha): (ColorSpace, Option<Alpha>),
    limit_bytes: u64,
) -> Result<Loaded, CliError> {
    let list = read_list(dir)?;
    let root = pixels::read(&dir.join(&list.root), color, alpha, limit_bytes)?;
    let mut names: Vec<&PathBuf> = Vec::new();
    let mut stack = PatchStack { root, images: Vec::new(), patches: Vec::new() };
    for (patch, entry) in list.patch.iter().enumerate() {
        let image = match names.iter().position(|name| **name == entry.image) {
            Some(known) => known,
            None => {
                stack.images.push(pixels::read(&dir.join(&entry.image), color, alpha, limit_bytes)?);
                names.push(&entry.image);
                names.len() - 1
            }
        };
        let mask = entry
            .mask
            .as_ref()
            .map(|mask| pixels::read(&dir.join(mask), ColorSpace::Linear, None, limit_bytes));
        let parent = match &entry.parent {
            Some(parent) if *parent != list.root => {
                let found = list.patch.iter().position(|other| other.image == *parent);
                let missing = || CliError::StackParent {
                    path: dir.join(LIST_NAME),
                    patch,
                    parent: parent.display().to_string(),
                };
                Some(found.ok_or_else(missing)?)
            }
            _ => None,
        };
        let missing =
            || CliError::StackMatrix { path: dir.join(LIST_NAME), patch, found: entry.matrix.len() };
        // A list that is longer would be cut in silence were it read as nine numbers.
        let rows: [f64; 9] = entry.matrix.as_slice().try_into().map_err(|_| missing())?;
        stack.patches.push(PatchSource {
            image,
            matrix: DMat3::from_cols_array(&rows).transpose(),
            mask: mask.transpose()?,
            parent,
        });
    }
    Ok(Loaded { stack, left_out: Vec::new() })
}
