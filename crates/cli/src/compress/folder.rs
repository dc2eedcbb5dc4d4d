//! Folders that become one file: what captures and zoom stacks have in common.

use std::fmt::Debug;
use std::path::{Component, Path, PathBuf};

use crate::error::{CliError, guarded};
use crate::input::{Found, size_of};
use crate::output::write_whole;
use crate::progress::Share;
use crate::report::Row;

use super::cache::{add_file, program};
use super::task::{Finished, Workplace};

/// A kind of folder, with the settings for one.
pub(crate) trait Folder: Debug {
    /// Bytes that encoding takes at its peak for each pixel of the photographs.
    const BYTES_PER_PIXEL: u64;

    /// Files beside the photographs that the output depends on.
    fn other_files(&self, dir: &Path) -> Result<Vec<PathBuf>, CliError>;

    /// Folders that photographs are read from without `--outside`.
    fn folders(&self, dir: &Path) -> Vec<PathBuf> {
        vec![dir.to_owned()]
    }

    /// Reads the folder and encodes it.
    fn encode(&self, task: &FolderTask<Self>, limit_bytes: u64, share: &Share<'_>) -> Result<Made, CliError>
    where
        Self: Sized;
}

/// True for a path that leaves the folder that it starts from.
fn climbs(path: &Path) -> bool {
    let mut depth = 0i32;
    path.components().any(|component| {
        depth += match component {
            Component::Normal(_) => 1,
            Component::CurDir => 0,
            Component::ParentDir => -1,
            Component::RootDir | Component::Prefix(_) => i32::MIN / 2,
        };
        depth < 0
    })
}

/// What a folder came to.
#[derive(Debug)]
pub(crate) struct Made {
    /// The file.
    pub(crate) bytes: Vec<u8>,
    /// Its row in the report.
    pub(crate) row: Row,
    /// A file that goes beside it, with its bytes.
    pub(crate) beside: Option<(PathBuf, Vec<u8>)>,
}

/// What is to be made of one folder.
#[derive(Debug)]
pub(crate) struct FolderTask<F> {
    pub(crate) found: Found,
    pub(crate) settings: F,
    pub(crate) output: PathBuf,
}

impl<F: Folder> FolderTask<F> {
    /// About how many bytes the task needs at its peak.
    pub(crate) fn cost_bytes(&self) -> u64 {
        let pixels = || self.found.files.iter().map(|file| size_of(file).map(|size| size.texels())).sum();
        // A folder whose sizes cannot be read fails when it is worked on.
        guarded(&self.found.path, pixels).unwrap_or(0u64).saturating_mul(F::BYTES_PER_PIXEL)
    }

    /// Does the work, unless the output was made of the same. A panic within becomes an error of this input.
    pub(crate) fn run(&self, place: &Workplace<'_>) -> Result<Finished, CliError> {
        guarded(&self.found.path, || {
            if !place.outside {
                self.check_names()?;
            }
            let key = self.key()?;
            if let Some(row) = place.cache.up_to_date(&self.output, &key).filter(|_| !place.force) {
                let input = self.found.path.display().to_string();
                let output = self.output.display().to_string();
                return Ok(Finished { row: Row { input, output, ..row }, skipped: true });
            }
            let share = place.progress.share(self.found.stem.to_string_lossy().into_owned());
            let Made { bytes, row, beside } = self.settings.encode(self, place.limit_bytes, &share)?;
            if let Some((path, bytes)) = beside {
                write_whole(&path, &bytes)?;
            }
            write_whole(&self.output, &bytes)?;
            place.cache.record(&self.output, &key, &bytes, &row);
            Ok(Finished { row, skipped: false })
        })
    }

    /// Refuses files outside of the folder, so that a list of files from elsewhere cannot read the rest of this machine.
    /// Paths are compared as they are written: symbolic links within the folder are followed.
    fn check_names(&self) -> Result<(), CliError> {
        let folders = self.settings.folders(&self.found.path);
        let is_inside = |file: &&PathBuf| {
            folders.iter().any(|folder| file.strip_prefix(folder).is_ok_and(|rest| !climbs(rest)))
        };
        match self.found.files.iter().find(|file| !is_inside(file)) {
            Some(file) => Err(CliError::Outside { path: self.found.path.clone(), file: file.clone() }),
            None => Ok(()),
        }
    }

    /// Hash of all that the output depends on.
    fn key(&self) -> Result<String, CliError> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(program().as_bytes());
        hasher.update(format!("{:?}", self.settings).as_bytes());
        for file in self.settings.other_files(&self.found.path)?.iter().chain(&self.found.files) {
            add_file(&mut hasher, file).map_err(|source| CliError::Read { path: file.clone(), source })?;
        }
        Ok(hasher.finalize().to_hex().to_string())
    }
}
