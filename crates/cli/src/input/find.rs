//! From what the command line names to inputs: files, folders and globs, in sorted order, each once.

use std::collections::HashSet;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use super::formats::is_image;
use super::remarks::few;
use super::{capture, material, stack};
use crate::bank::is_bank;
use crate::console::say;
use crate::error::CliError;
use crate::settings::Kind;

/// One input: one output file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Found {
    /// The file or folder, as named or found.
    pub(crate) path: PathBuf,
    /// What it is taken for.
    pub(crate) kind: Kind,
    /// Its image files, in sorted order.
    pub(crate) files: Vec<PathBuf>,
    /// Name of the output without extension.
    pub(crate) stem: OsString,
}

impl Found {
    /// True for one file of which all frames or pages are taken.
    pub(crate) fn takes_all_frames(&self) -> bool {
        matches!(self.kind, Kind::Set | Kind::Sequence) && self.files == [self.path.as_path()]
    }
}

/// The inputs of a command line.
#[derive(Debug, Default)]
pub(crate) struct Inputs {
    pub(crate) found: Vec<Result<Found, Unusable>>,
    /// Files in folders that are no images.
    pub(crate) not_read: Vec<PathBuf>,
}

impl Inputs {
    /// A line about files that are not read, where there are any.
    pub(crate) fn say_not_read(&self) {
        if !self.not_read.is_empty() {
            let name = |path: &PathBuf| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            say(&format!("not read: {}", few(&self.not_read.iter().map(name).collect::<Vec<_>>())));
        }
    }
}

/// An input that was named but cannot be worked on.
#[derive(Debug)]
pub(crate) struct Unusable {
    pub(crate) path: PathBuf,
    pub(crate) error: Box<CliError>,
}

/// All inputs that `named` stands for. `kind_of` tells what a path is to be taken for, where that is said.
pub(crate) fn find(named: &[PathBuf], kind_of: impl Fn(&Path) -> Option<Kind>) -> Inputs {
    let mut seen = HashSet::new();
    let mut inputs = Inputs::default();
    for name in named {
        match expand(name) {
            Ok(paths) => {
                for path in paths {
                    if seen.insert(path.canonicalize().unwrap_or_else(|_| path.clone())) {
                        take(path, &kind_of, &mut inputs);
                    }
                }
            }
            Err(error) => inputs.found.push(Err(Unusable { path: name.clone(), error: Box::new(error) })),
        }
    }
    material::gather(&mut inputs);
    inputs
}

/// The files that names, folders of textures and globs stand for; a bank stays a folder.
pub(crate) fn expand_all(named: &[PathBuf]) -> Vec<Result<PathBuf, CliError>> {
    let files = |name: &PathBuf| if name.is_dir() && !is_bank(name) { textures(name) } else { expand(name) };
    named
        .iter()
        .flat_map(|name| match files(name) {
            Ok(paths) => paths.into_iter().map(Ok).collect(),
            Err(error) => vec![Err(error)],
        })
        .collect()
}

/// A path that exists, or what a glob matches.
fn expand(name: &Path) -> Result<Vec<PathBuf>, CliError> {
    if name.exists() {
        return Ok(vec![name.to_owned()]);
    }
    let pattern = name.to_str().filter(|text| text.contains(['*', '?', '[']));
    let Some(matches) = pattern.and_then(|text| glob::glob(text).ok()) else {
        return Err(CliError::NotFound { path: name.to_owned() });
    };
    let mut paths: Vec<PathBuf> = matches.flatten().collect();
    paths.sort();
    if paths.is_empty() {
        return Err(CliError::NoMatch { pattern: name.display().to_string() });
    }
    Ok(paths)
}

/// The `.txf` files of a folder, sorted.
fn textures(dir: &Path) -> Result<Vec<PathBuf>, CliError> {
    let entries = fs::read_dir(dir).map_err(|source| CliError::Read { path: dir.to_owned(), source })?;
    let is_texture = |path: &PathBuf| {
        path.extension().is_some_and(|extension| extension == "txf") && path.is_file() && !is_hidden(path)
    };
    let mut found: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(is_texture).collect();
    found.sort();
    if found.is_empty() {
        return Err(CliError::NoTextures { path: dir.to_owned() });
    }
    Ok(found)
}

fn take(path: PathBuf, kind_of: &impl Fn(&Path) -> Option<Kind>, inputs: &mut Inputs) {
    let Inputs { found, not_read } = inputs;
    let chosen = kind_of(&path);
    if !path.is_dir() {
        found.push(file(path, chosen.unwrap_or(Kind::Image)));
        return;
    }
    let kind = chosen.unwrap_or_else(|| kind_of_folder(&path));
    match folder(&path, kind, not_read) {
        Ok(files) if kind == Kind::Image => {
            found.extend(files.into_iter().map(|path| file(path, Kind::Image)));
        }
        Ok(files) if kind == Kind::Material => match material::of_folder(&path, files, not_read) {
            maps if maps.is_empty() => {
                let error = Box::new(CliError::NoMaps { path: path.clone() });
                found.push(Err(Unusable { path, error }));
            }
            maps => found.extend(maps.into_iter().map(Ok)),
        },
        Ok(files) => found.push(Ok(Found { stem: folder_name(&path), path, kind, files })),
        Err(error) => found.push(Err(Unusable { path, error: Box::new(error) })),
    }
}

fn file(path: PathBuf, kind: Kind) -> Result<Found, Unusable> {
    let fault = match kind {
        Kind::Lightfield => CliError::NotCapture { path: path.clone() },
        Kind::Zoom => CliError::NotStack { path: path.clone() },
        Kind::Material => match material::of_file(path.clone()) {
            Some(found) => return Ok(found),
            None => CliError::NoMaps { path: path.clone() },
        },
        Kind::Image | Kind::Set | Kind::Sequence => {
            let stem = path.file_stem().unwrap_or_default().to_owned();
            return Ok(Found { files: vec![path.clone()], path, kind, stem });
        }
    };
    Err(Unusable { path, error: Box::new(fault) })
}

/// Light fields and zoom stacks are told by the file that describes them.
fn kind_of_folder(path: &Path) -> Kind {
    if capture::is_capture(path) {
        Kind::Lightfield
    } else if path.join(stack::LIST_NAME).exists() {
        Kind::Zoom
    } else {
        Kind::Set
    }
}

/// The images of a folder, sorted by name.
fn folder(path: &Path, kind: Kind, not_read: &mut Vec<PathBuf>) -> Result<Vec<PathBuf>, CliError> {
    if kind == Kind::Lightfield {
        return Ok(capture::image_files(path)?);
    }
    if kind == Kind::Zoom && path.join(stack::LIST_NAME).exists() {
        return stack::image_files(path);
    }
    let entries = fs::read_dir(path).map_err(|source| CliError::Read { path: path.to_owned(), source })?;
    let mut all: Vec<PathBuf> =
        entries.flatten().map(|entry| entry.path()).filter(|path| path.is_file()).collect();
    all.sort();
    let (files, others): (Vec<PathBuf>, Vec<PathBuf>) = all.into_iter().partition(|path| is_image(path));
    not_read.extend(others.into_iter().filter(|path| !is_hidden(path)));
    if files.is_empty() {
        return Err(CliError::EmptyFolder { path: path.to_owned() });
    }
    Ok(files)
}

fn is_hidden(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'))
}

/// The folder's own name, also where it was named as "." or "..".
pub(super) fn folder_name(path: &Path) -> OsString {
    let own = |path: &Path| path.file_name().map(ToOwned::to_owned);
    own(path).or_else(|| own(&path.canonicalize().ok()?)).unwrap_or_else(|| "set".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(inputs: &Inputs) -> Vec<String> {
        inputs
            .found
            .iter()
            .map(|item| match item {
                Ok(found) => format!("{} {}", found.stem.to_string_lossy(), found.files.len()),
                Err(unusable) => unusable.error.to_string(),
            })
            .collect()
    }

    #[test]
    fn files_folders_and_globs_are_sorted_and_taken_once() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::create_dir_all(at("set")).unwrap();
        for name in ["b.png", "a.png", "note.txt", "set/2.JPG", "set/1.png", "set/.hidden", "set/list.txt"] {
            fs::write(at(name), b"x").unwrap();
        }
        let named = [at("*.png"), at("b.png"), at("set")];
        assert_eq!(names(&find(&named, |_| None)), ["a 1", "b 1", "set 2"]);
        assert_eq!(names(&find(&[at("set")], |_| Some(Kind::Image))), ["1 1", "2 1"]);
        let of_folder = find(&[at("set/.")], |_| None);
        assert_eq!(names(&of_folder), ["set 2"]);
        assert_eq!(of_folder.not_read, [at("set/list.txt")]);
    }

    #[test]
    fn what_cannot_be_worked_on_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::create_dir_all(at("empty")).unwrap();
        fs::create_dir_all(at("field")).unwrap();
        fs::write(at("field/transforms.json"), b"{}").unwrap();
        let Inputs { found, .. } = find(&[at("none.png"), at("*.jpg"), at("empty"), at("field")], |_| None);
        let kinds: Vec<bool> = found
            .iter()
            .zip([0, 1, 2, 3])
            .map(|(item, index)| match item.as_ref().map_err(|unusable| unusable.error.as_ref()) {
                Err(CliError::NotFound { .. }) => index == 0,
                Err(CliError::NoMatch { .. }) => index == 1,
                Err(CliError::EmptyFolder { .. }) => index == 2,
                Err(CliError::Capture(texfold_capture::CaptureError::Cameras { .. })) => index == 3,
                _ => false,
            })
            .collect();
        assert_eq!(kinds, [true; 4]);
    }
}
