//! Files that are read: regular ones alone, as a device or a FIFO may never end.

use std::io::{self, Read};
use std::path::Path;

pub(crate) use texfold::bank::{irregular, open_file as open};

use crate::error::CliError;

/// The bytes of a file.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, CliError> {
    let mut bytes = Vec::new();
    let done = open(path).and_then(|mut file| file.read_to_end(&mut bytes));
    done.map(|_| bytes).map_err(|source| CliError::Read { path: path.to_owned(), source })
}

/// The text of a file, in UTF-8.
pub(crate) fn read_text(path: &Path) -> Result<String, CliError> {
    open(path).and_then(io::read_to_string).map_err(|source| CliError::Read { path: path.to_owned(), source })
}
