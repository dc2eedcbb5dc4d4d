//! Files that are read: regular ones alone, as a device or a FIFO may never end.

use std::io::{self, Read};
use std::path::Path;

pub(crate) use texfold::bank::open_file as open;

use crate::CaptureError;

/// The bytes of a file.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, CaptureError> {
    let mut bytes = Vec::new();
    let done = open(path).and_then(|mut file| file.read_to_end(&mut bytes));
    done.map(|_| bytes).map_err(|source| CaptureError::Read { path: path.to_owned(), source })
}

/// The first `count` bytes of a file, or as many as it has.
pub(crate) fn read_head(path: &Path, count: u64) -> io::Result<Vec<u8>> {
    let mut head = Vec::new();
    open(path)?.take(count).read_to_end(&mut head)?;
    Ok(head)
}

/// The text of a file, in UTF-8.
pub(crate) fn read_text(path: &Path) -> Result<String, CaptureError> {
    open(path)
        .and_then(io::read_to_string)
        .map_err(|source| CaptureError::Read { path: path.to_owned(), source })
}
