//! Banks: folders of many images that grow by further ones. Images are cut into tiles, which are stored by block, with
//! one step for all tiles of an image, or by texel, with public codebooks that images share.
//!
//! [`texfold::bank`] has how banks are written and how tiles are encoded; here files are read, and figures of them collected.

mod add;
mod encode;
mod manifest;
mod map;
mod show;
mod sums;
mod task;
mod tiles;

use std::path::Path;

use texfold::bank::{Codebooks, WriteError};

use crate::error::CliError;
use crate::output::make_folder;
pub(crate) use add::{Add, Made, Step, plan};
use manifest::{Bank, Writer};
pub(crate) use map::BankMap;
pub(crate) use show::{Choice, decompress, describe, is_bank};
pub(crate) use task::BankTask;

/// A bank that is added to; the lock is held while this lives.
#[derive(Debug)]
pub(crate) struct Open {
    writer: Writer,
}

impl Open {
    /// Opens or begins the bank in a folder, and takes away what an interrupted run left there.
    pub(crate) fn new(dir: &Path) -> Result<Open, CliError> {
        make_folder(dir)?;
        let writer = Writer::open(dir).map_err(|error| fault(dir, error))?;
        manifest::warn_of_georeferences(writer.bank());
        Ok(Open { writer })
    }

    /// What is listed.
    pub(crate) fn bank(&self) -> &Bank {
        self.writer.bank()
    }

    /// The public codebooks that an image may use: none by block.
    pub(crate) fn books_for(&self, add: &Add) -> Result<Codebooks, CliError> {
        let categories = if add.uses_codebooks() { add.categories.as_slice() } else { &[] };
        categories.iter().map(|&number| Ok((number, self.bank().codebook(number)?))).collect()
    }
}

/// The error of adding the image at `path`.
fn fault(path: &Path, error: WriteError) -> CliError {
    let path = path.to_owned();
    match error {
        WriteError::Bank(source) => CliError::Bank(source),
        WriteError::Write { path, source } => CliError::Write { path, source },
        WriteError::Locked { path } => CliError::BankLocked { path },
        WriteError::Encode(source) => CliError::Encode { path, source },
        WriteError::Categories { most } => CliError::BankCategories { path, most },
        WriteError::Source(source) => match source.downcast::<CliError>() {
            Ok(error) => *error,
            Err(source) => CliError::Rows { path, source },
        },
        // An image that is no longer what it was when its tiles were counted.
        _ => CliError::BankName { path },
    }
}
