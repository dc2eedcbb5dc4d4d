//! Banks: folders of many images that grow by further ones. Images are cut into tiles, which are stored by block, with
//! one step for all tiles of an image, or by texel, with public codebooks that images share.
//!
//! `bank.json` says which files count; all others are leftovers. An image is added by writing files of new names, each
//! whole and on the disk, and then renaming a new `bank.json` over the old: a crash at any time leaves the bank as it
//! was before that image. Public codebooks grow by rows behind those that are there; a grown one is a new file, whose
//! first rows are the old one's bytes. One process at a time adds, held off by a lock on `bank.lock` that the system
//! gives back when the process ends, however it ends.

mod add;
mod blocks;
mod category;
mod manifest;
mod map;
mod show;
mod sums;
mod task;
mod texel;
mod tiles;

use std::collections::HashSet;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use texfold::bank::MANIFEST;
use texfold_progressive::Codebook;

use crate::error::CliError;
use crate::output::{make_folder, remove_stale};
pub(crate) use add::{Add, Made, Step, plan};
use manifest::{Bank, Manifest};
pub(crate) use map::BankMap;
pub(crate) use show::{Choice, decompress, describe, is_bank};
pub(crate) use task::{BankTask, Books};

/// Name of the file that is locked while images are added.
const LOCK: &str = "bank.lock";

/// A bank that is added to; the lock is held while this lives.
#[derive(Debug)]
pub(crate) struct Open {
    bank: Bank,
    /// Public codebooks that have been read or made, by category.
    books: Vec<Option<Arc<Codebook>>>,
    _lock: File,
}

impl Open {
    /// Opens or begins the bank in a folder, and takes away what an interrupted run left there.
    pub(crate) fn new(dir: &Path) -> Result<Open, CliError> {
        make_folder(dir)?;
        let lock = lock(dir)?;
        remove_stale(dir);
        let bank = if dir.join(MANIFEST).exists() {
            manifest::open(dir)?
        } else {
            Bank::of(dir, Manifest::default())
        };
        let books = bank.manifest().categories.iter().map(|_| None).collect();
        let open = Open { bank, books, _lock: lock };
        open.remove_leftovers();
        Ok(open)
    }

    /// Removes files of banks that the manifest does not name. Others are left alone.
    fn remove_leftovers(&self) {
        let manifest = self.bank.manifest();
        let tiles = manifest.images.iter().flat_map(|image| &image.tiles).map(|tile| tile.file.as_str());
        let books = manifest.categories.iter().filter_map(|category| category.file.as_deref());
        let named: HashSet<&str> = tiles.chain(books).collect();
        let Ok(entries) = std::fs::read_dir(self.bank.dir()) else { return };
        for entry in entries.flatten() {
            let name = entry.file_name();
            let ours = name.to_str().is_some_and(|name| {
                (name.starts_with("image-") || name.starts_with("category-")) && name.ends_with(".txf")
            });
            if ours && name.to_str().is_some_and(|name| !named.contains(name)) {
                // A file that cannot be removed does no harm: nothing names it.
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }

    /// What is listed.
    pub(crate) fn bank(&self) -> &Bank {
        &self.bank
    }

    /// The public codebooks that an image may use: none by block.
    pub(crate) fn books_for(&mut self, add: &Add) -> Result<Books, CliError> {
        let categories = if add.uses_codebooks() { add.categories.as_slice() } else { &[] };
        categories.iter().map(|&number| Ok((number, self.book(number)?))).collect()
    }

    fn book(&mut self, number: usize) -> Result<Option<Arc<Codebook>>, CliError> {
        self.books.resize(self.bank.manifest().categories.len(), None);
        if self.books[number].is_none() {
            self.books[number] = self.bank.codebook(number)?;
        }
        Ok(self.books[number].clone())
    }
}

/// Takes the lock of a bank.
fn lock(dir: &Path) -> Result<File, CliError> {
    let path = dir.join(LOCK);
    let failed = |source| CliError::Write { path: path.clone(), source };
    let file = File::options().create(true).append(true).open(&path).map_err(failed)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(std::fs::TryLockError::WouldBlock) => Err(CliError::BankLocked { path: dir.to_owned() }),
        Err(std::fs::TryLockError::Error(source)) => Err(failed(source)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_process_at_a_time_adds() {
        let dir = tempfile::tempdir().unwrap();
        let first = Open::new(dir.path()).unwrap();
        assert!(matches!(Open::new(dir.path()), Err(CliError::BankLocked { .. })));
        drop(first);
        assert!(Open::new(dir.path()).is_ok());
    }

    #[test]
    fn leftovers_of_an_interrupted_run_go_and_other_files_stay() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["image-0007.txf", "category-000-0001.txf", "notes.txt", "photo.txf"] {
            std::fs::write(dir.path().join(name), b"x").unwrap();
        }
        drop(Open::new(dir.path()).unwrap());
        let there = |name: &str| dir.path().join(name).exists();
        assert!(!there("image-0007.txf") && !there("category-000-0001.txf"));
        assert!(there("notes.txt") && there("photo.txf"));
    }
}
