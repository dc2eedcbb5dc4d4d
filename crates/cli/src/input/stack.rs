//! Zoom stacks: a folder of photographs to be put in order, or with `zipmap.toml`, which says where each has its place,
//! or with which other stack it goes.

use std::path::{Component, Path, PathBuf};

use glam::DMat3;
use serde::{Deserialize, Serialize};
use texfold::{
    core::TextureCodec,
    zipmap::{LeftOut, PatchSource, PatchStack, ZipParams, Zipmap, masks as zip_masks, register},
};
use texfold_core::image::{Alpha, ColorSpace, Raster};
use texfold_core::{EncodeError, Job};

use super::{Remarks, pixels};
use crate::error::CliError;
use crate::files;
use crate::settings::ZoomSettings;

/// Name of the list of patches and of what the encoder does with them.
pub(crate) const LIST_NAME: &str = "zipmap.toml";

/// A list of patches as it is written.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct List {
    root: PathBuf,
    /// The folder of the stack at whose places these maps lie.
    with: Option<PathBuf>,
    /// Of the encoder: see [`ZipParams`].
    tau: Option<f32>,
    merge: Option<bool>,
    #[serde(default)]
    patch: Vec<Entry>,
}

#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    image: PathBuf,
    /// Row by row, from the root's texture coordinates to the patch's; none where they are those of another stack.
    #[serde(default)]
    matrix: Vec<f64>,
    mask: Option<PathBuf>,
    /// The image of the patch that it lies on.
    parent: Option<PathBuf>,
}

impl Entry {
    /// An image and nothing else.
    fn of(image: &Path) -> Entry {
        Entry { image: image.to_owned(), matrix: Vec::new(), mask: None, parent: None }
    }
}

impl List {
    /// Settings with those of the list. Maps that go with another stack are not merged: their values are no colours of one scene.
    fn params(&self, settings: &ZipParams) -> ZipParams {
        let params = settings.clone().with_merge(self.merge.unwrap_or(self.with.is_none()));
        match self.tau {
            Some(tau) => params.with_tau(tau),
            None => params,
        }
    }
}

fn read_list(dir: &Path) -> Result<List, CliError> {
    let path = dir.join(LIST_NAME);
    let text = files::read_text(&path)?;
    toml::from_str(&text).map_err(|source| CliError::StackFile { path, source: Box::new(source) })
}

/// The list of a folder, and of the folder that it goes with.
pub(crate) fn list_files(dir: &Path) -> Vec<PathBuf> {
    let own = Some(dir.join(LIST_NAME)).filter(|list| list.exists());
    let with = own.as_ref().and_then(|_| read_list(dir).ok()?.with);
    own.into_iter().chain(with.map(|with| dir.join(with).join(LIST_NAME))).collect()
}

/// Folders that images are read from without `--outside`: the stack's own, and that of the stack that it goes with, where
/// that lies within or beside it.
pub(crate) fn folders(dir: &Path) -> Vec<PathBuf> {
    let with = read_list(dir).ok().and_then(|list| list.with).filter(|with| {
        let inner = with.strip_prefix("..").unwrap_or(with);
        inner.file_name().is_some()
            && inner
                .components()
                .all(|component| matches!(component, Component::Normal(_) | Component::CurDir))
    });
    [dir.to_owned()].into_iter().chain(with.map(|with| dir.join(with))).collect()
}

/// All files that a list names, root first, each once; those of the stack that it goes with behind.
pub(crate) fn image_files(dir: &Path) -> Result<Vec<PathBuf>, CliError> {
    let list = read_list(dir)?;
    let mut files = named(dir, &list);
    if let Some(with) = &list.with {
        let alone = List { with: None, ..read_list(&dir.join(with))? };
        files.extend(named(&dir.join(with), &alone));
    }
    Ok(files)
}

fn named(dir: &Path, list: &List) -> Vec<PathBuf> {
    let mut files = vec![dir.join(&list.root)];
    for name in list.patch.iter().flat_map(|entry| [Some(&entry.image), entry.mask.as_ref()]).flatten() {
        let path = dir.join(name);
        if !files.contains(&path) {
            files.push(path);
        }
    }
    files
}

/// A stack, and a word about each photograph that is no part of it.
#[derive(Debug)]
pub(crate) struct Loaded {
    pub(crate) stack: PatchStack,
    pub(crate) left_out: Vec<String>,
    /// Notes and warnings on the photographs.
    pub(crate) remarks: Remarks,
    /// Where registration has put the photographs, as a list to correct by hand.
    pub(crate) list: Option<String>,
    /// Settings of the encoder, with those of the list.
    pub(crate) params: ZipParams,
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
    let mut remarks = Remarks::default();
    if dir.join(LIST_NAME).exists() {
        let list = read_list(dir)?;
        let stack = match &list.with {
            Some(with) => riding((dir, with), &list, settings, limit_bytes, job, &mut remarks)?,
            None => by_hand(dir, &list, (color, alpha), limit_bytes, &mut remarks)?,
        };
        let params = list.params(&settings.params);
        return Ok(Loaded { stack, left_out: Vec::new(), remarks, list: None, params });
    }
    let photos: Result<Vec<Raster>, CliError> = files
        .iter()
        .map(|file| pixels::read_colours(file, color, alpha, limit_bytes, &mut remarks))
        .collect();
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
    let list = Some(written(&stack, name(found.root), |index| name(found.placed[index].photo)));
    Ok(Loaded { stack, left_out, remarks, list, params: settings.params.clone() })
}

/// A stack as a list.
fn written(stack: &PatchStack, root: String, name: impl Fn(usize) -> String) -> String {
    let entry = |(index, patch): (usize, &PatchSource)| Entry {
        image: name(index).into(),
        matrix: patch.matrix.transpose().to_cols_array().to_vec(),
        mask: None,
        parent: patch.parent.map(|parent| name(parent).into()),
    };
    let patch = stack.patches.iter().enumerate().map(entry).collect();
    // A list of names and numbers can always be written.
    toml::to_string(&List { root: root.into(), with: None, tau: None, merge: None, patch })
        .unwrap_or_default()
}

/// Maps of another kind at the places of the stack in folder `with`, shown as far as its colours are.
fn riding(
    (dir, with): (&Path, &Path),
    list: &List,
    settings: &ZoomSettings,
    limit_bytes: u64,
    job: &mut Job<'_>,
    remarks: &mut Remarks,
) -> Result<PatchStack, CliError> {
    let path = || dir.join(LIST_NAME);
    if let Some(patch) = list.patch.iter().position(|entry| *entry != Entry::of(&entry.image)) {
        return Err(CliError::StackRide { path: path(), patch });
    }
    // That they are not merged is what their notes name, too.
    if list.tau.is_some() || list.merge == Some(true) {
        return Err(CliError::StackRideKeys { path: path() });
    }
    let host_dir = dir.join(with);
    let host_list = read_list(&host_dir)?;
    if host_list.with.is_some() {
        return Err(CliError::StackHost { path: path(), host: host_dir });
    }
    let host = by_hand(&host_dir, &host_list, (ColorSpace::Srgb, None), limit_bytes, remarks)?;
    let fault = |source| CliError::Encode { path: dir.to_owned(), source };
    let params = host_list.params(&settings.params);
    let masks = job.within(0.0, 0.4, |job| zip_masks(&host, &params, job)).map_err(fault)?;
    let mut read = |name: &PathBuf| {
        pixels::read_colours(&dir.join(name), settings.color, settings.alpha, limit_bytes, remarks)
    };
    let maps = list.patch.iter().map(|entry| read(&entry.image)).collect::<Result<_, _>>()?;
    let root = read(&list.root)?;
    host.riding(root, maps, masks)
        .map_err(|source| fault(EncodeError::Codec { codec: Zipmap::ID, source: Box::new(source) }))
}

fn by_hand(
    dir: &Path,
    list: &List,
    (color, alpha): (ColorSpace, Option<Alpha>),
    limit_bytes: u64,
    remarks: &mut Remarks,
) -> Result<PatchStack, CliError> {
    let root = pixels::read_colours(&dir.join(&list.root), color, alpha, limit_bytes, remarks)?;
    let mut names: Vec<&PathBuf> = Vec::new();
    let mut stack = PatchStack { root, images: Vec::new(), patches: Vec::new() };
    for (patch, entry) in list.patch.iter().enumerate() {
        let image = match names.iter().position(|name| **name == entry.image) {
            Some(known) => known,
            None => {
                let image =
                    pixels::read_colours(&dir.join(&entry.image), color, alpha, limit_bytes, remarks)?;
                stack.images.push(image);
                names.push(&entry.image);
                names.len() - 1
            }
        };
        let mask = entry
            .mask
            .as_ref()
            .map(|mask| pixels::read(&dir.join(mask), ColorSpace::Linear, None, limit_bytes, remarks));
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
    Ok(stack)
}
