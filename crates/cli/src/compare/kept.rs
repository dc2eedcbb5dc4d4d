//! What was measured stays in the output folder, so that a run goes on where the one before has stopped.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use texfold_core::image::{ImageSet, PixelInfo};

use super::measure::Measured;
use super::rival::read_back;
use super::table::Row;
use crate::error::CliError;
use crate::output::{make_folder, write_whole};
use crate::{files, png};

/// The folder within the output folder.
const FOLDER: &str = "measured";

/// Settings that were measured before.
#[derive(Debug)]
pub(super) struct Kept {
    folder: PathBuf,
    /// The program, on which rows depend beside images and settings.
    program: String,
    /// Names of the files of this run.
    used: BTreeSet<String>,
}

impl Kept {
    /// Those of an output folder, by this program.
    pub(super) fn open(out: &Path) -> Result<Kept, CliError> {
        let folder = out.join(FOLDER);
        make_folder(&folder)?;
        // Another build may encode in another way.
        let program = std::env::current_exe().and_then(std::fs::metadata);
        let built = program.map(|found| (found.len(), found.modified().unwrap_or(SystemTime::UNIX_EPOCH)));
        Ok(Kept { folder, program: format!("{built:?}"), used: BTreeSet::new() })
    }

    /// A name for a setting on an input of that hash.
    pub(super) fn name(&self, input: &blake3::Hash, candidate: &impl std::fmt::Debug) -> String {
        let of = format!("{input} {candidate:?} {}", self.program);
        blake3::hash(of.as_bytes()).to_hex()[..32].to_owned()
    }

    /// The row of that name, and its image where that is wanted; `None` where it is not there as a whole.
    pub(super) fn find(&mut self, name: &str, info: PixelInfo, with_image: bool) -> Option<Measured> {
        let at = |ending: &str| self.folder.join(format!("{name}.{ending}"));
        let row: Row = serde_json::from_slice(&files::read(&at("json")).ok()?).ok()?;
        let (mut decoded, mut file) = (None, None);
        if with_image {
            let (texture, picture) = (at("txf"), at("png"));
            if texture.exists() {
                let bytes = files::read(&texture).ok()?;
                let loaded = texfold::open(&bytes).ok()?.into_image().ok()?;
                decoded = Some(crate::decompress::decode(&texture, loaded.as_encoded(), 0, 0).ok()?);
                file = Some(bytes);
            } else {
                decoded = Some(read_back(&picture, info).ok()?);
            }
        }
        self.used.insert(name.to_owned());
        Some(Measured { row, decoded, file })
    }

    /// Keeps a row, and its image where that is drawn.
    pub(super) fn keep(&mut self, name: &str, measured: &Measured, with_image: bool) -> Result<(), CliError> {
        let at = |ending: &str| self.folder.join(format!("{name}.{ending}"));
        let fault = |source: serde_json::Error| CliError::Write { path: at("json"), source: source.into() };
        match (&measured.file, &measured.decoded) {
            (Some(file), _) if with_image => write_whole(&at("txf"), file)?,
            (None, Some(decoded)) if with_image => png::write(&at("png"), decoded)?,
            _ => {}
        }
        // The row last: with it the image is there.
        write_whole(&at("json"), &serde_json::to_vec(&measured.row).map_err(fault)?)?;
        self.used.insert(name.to_owned());
        Ok(())
    }

    /// Removes what this run has not used.
    pub(super) fn prune(&self) {
        for entry in std::fs::read_dir(&self.folder).into_iter().flatten().flatten() {
            let path = entry.path();
            let stem = path.file_stem().unwrap_or_default().to_string_lossy();
            if !self.used.contains(&*stem) {
                // What stays is found by no name; it takes room alone.
                let _ = std::fs::remove_file(&path);
            }
        }
    }
}

/// A hash of all values of images.
pub(super) fn hash(images: &ImageSet) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    for (image, map) in
        images.images().iter().zip(images.maps().iter().map(Some).chain(std::iter::repeat(None)))
    {
        hasher.update(format!("{:?} {:?} {map:?}", image.size(), image.info()).as_bytes());
        let values: Vec<u8> = image.values().flat_map(f32::to_le_bytes).collect();
        hasher.update(&values);
    }
    hasher.finalize()
}
