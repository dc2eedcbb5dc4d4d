//! Files that are read: regular ones alone, as a device or a FIFO may never end.

use std::fs::{self, File, FileType};
use std::io;
use std::path::Path;

/// Opens a file, through symbolic links.
pub fn open(path: &Path) -> io::Result<File> {
    // Opening a FIFO waits for its writer.
    match irregular(fs::metadata(path)?.file_type()) {
        Some(found) => {
            Err(io::Error::new(io::ErrorKind::InvalidInput, format!("it is {found}, not a regular file")))
        }
        None => File::open(path),
    }
}

/// The name of a kind of file that is not regular.
pub fn irregular(kind: FileType) -> Option<&'static str> {
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
