//! Files that are read: regular ones alone, as a device or a FIFO may never end.

use std::fs::{self, File, FileType};
use std::io::{self, Read};
use std::path::Path;

use crate::error::CliError;

/// Opens a file, through symbolic links.
pub(crate) fn open(path: &Path) -> io::Result<File> {
    // Opening a FIFO waits for its writer.
    match irregular(fs::metadata(path)?.file_type()) {
        Some(found) => {
            Err(io::Error::new(io::ErrorKind::InvalidInput, format!("it is {found}, not a regular file")))
        }
        None => File::open(path),
    }
}

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

/// The name of a kind of file that is not regular.
pub(crate) fn irregular(kind: FileType) -> Option<&'static str> {
    if kind.is_file() {
        return None;
    }
    if kind.is_dir() {
        return Some("a folder");
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if kind.is_fifo() {
            return Some("a FIFO");
        }
        if kind.is_socket() {
            return Some("a socket");
        }
    }
    Some("a device")
}
