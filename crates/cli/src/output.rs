//! Files that appear whole or not at all.

use std::fs;
use std::path::{Path, PathBuf};

pub(crate) use texfold::bank::remove_stale;
use texfold::bank::write_and_rename;

use crate::error::CliError;
use crate::files::irregular;

/// Makes `dir` and everything above it.
pub(crate) fn make_folder(dir: &Path) -> Result<(), CliError> {
    fs::create_dir_all(dir).map_err(|source| CliError::MakeFolder { path: dir.to_owned(), source })
}

/// Writes `bytes` to `path`: into a temporary file beside it, to the disk, then renamed. A symbolic link stays, and the file that it leads
/// to is replaced.
///
/// # Errors
/// [`CliError::NotAFile`] where a folder, a device, a FIFO or a socket is there.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    let target = target_of(path)?;
    write_and_rename(&target, bytes).map_err(|source| CliError::Write { path: path.to_owned(), source })
}

/// The file that an output replaces.
fn target_of(path: &Path) -> Result<PathBuf, CliError> {
    // What is not there or cannot be looked at is told by writing.
    let Ok(found) = fs::symlink_metadata(path) else { return Ok(path.to_owned()) };
    if !found.is_symlink() {
        return regular(path, found.file_type()).map(|()| path.to_owned());
    }
    let dangling = |_| CliError::DanglingLink { path: path.to_owned() };
    let target = fs::canonicalize(path).map_err(dangling)?;
    let kind = fs::metadata(&target).map_err(dangling)?.file_type();
    regular(path, kind).map(|()| target)
}

fn regular(path: &Path, kind: fs::FileType) -> Result<(), CliError> {
    match irregular(kind) {
        None => Ok(()),
        Some(found) => Err(CliError::NotAFile { path: path.to_owned(), found }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn what_is_no_regular_file_is_not_replaced_and_links_stay() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::create_dir(at("folder")).unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        assert!(std::process::Command::new("mkfifo").arg(at("fifo")).status().unwrap().success());
        for (name, link) in
            [("folder", "to-folder"), ("socket", "to-socket"), ("fifo", "to-fifo"), ("none", "to-none")]
        {
            std::os::unix::fs::symlink(at(name), at(link)).unwrap();
            for name in [name, link].into_iter().filter(|name| *name != "none") {
                let before = fs::symlink_metadata(at(name)).unwrap().file_type();
                let fault = write_whole(&at(name), b"x").unwrap_err();
                assert!(
                    matches!(fault, CliError::NotAFile { .. } | CliError::DanglingLink { .. }),
                    "{name}: {fault}"
                );
                assert_eq!(fs::symlink_metadata(at(name)).unwrap().file_type(), before, "{name}");
            }
        }
        fs::write(at("file"), b"before").unwrap();
        fs::create_dir(at("elsewhere")).unwrap();
        std::os::unix::fs::symlink("../file", at("elsewhere/link")).unwrap();
        write_whole(&at("elsewhere/link"), b"after").unwrap();
        assert!(fs::symlink_metadata(at("elsewhere/link")).unwrap().is_symlink());
        assert_eq!(fs::read(at("file")).unwrap(), b"after");
    }

    #[test]
    fn a_file_is_replaced_whole_and_nothing_else_is_left() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        write_whole(&path, b"first").unwrap();
        write_whole(&path, b"second").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
        let missing = dir.path().join("no/such/folder.bin");
        assert!(matches!(write_whole(&missing, b"x"), Err(CliError::Write { path, .. }) if path == missing));
    }
}
