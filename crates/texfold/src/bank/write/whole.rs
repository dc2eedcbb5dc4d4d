//! Files that appear whole or not at all.

use std::fs;
use std::io::{self, Write};
use std::path::Path;

use super::super::irregular;

/// First letters of the names of temporary files; the process id follows.
const TEMPORARY: &str = ".texfold-tmp-";

/// Writes `bytes` to `path` as [`write_and_rename`] does. A symbolic link stays, and the file that it leads to is replaced; a folder, a
/// device, a FIFO or a socket is not.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let is_link = fs::symlink_metadata(path).is_ok_and(|found| found.is_symlink());
    let target = if is_link { fs::canonicalize(path)? } else { path.to_owned() };
    // What cannot be looked at is told by writing.
    match fs::metadata(&target).ok().and_then(|found| irregular(found.file_type())) {
        Some(found) => {
            Err(io::Error::new(io::ErrorKind::InvalidInput, format!("it is {found}, not a regular file")))
        }
        None => write_and_rename(&target, bytes),
    }
}

/// Writes `bytes` to `path`: into a temporary file beside it, to the disk, then renamed.
#[doc(hidden)]
pub fn write_and_rename(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let dir = path.parent().filter(|dir| !dir.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let prefix = format!("{TEMPORARY}{}-", std::process::id());
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix);
    permit(&mut builder);
    let mut file = builder.tempfile_in(dir)?;
    file.write_all(bytes)?;
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

/// The usual permissions of a new file, as the umask has them, instead of the owner's alone.
#[cfg(unix)]
fn permit(builder: &mut tempfile::Builder<'_, '_>) {
    use std::os::unix::fs::PermissionsExt;
    builder.permissions(fs::Permissions::from_mode(0o666));
}

#[cfg(not(unix))]
fn permit(_: &mut tempfile::Builder<'_, '_>) {}

/// Removes temporary files in `dir` that an interrupted run left behind. Those of a process that still runs are kept.
#[doc(hidden)]
pub fn remove_stale(dir: &Path) {
    let Ok(entries) = fs::read_dir(dir) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let Some(rest) = name.to_str().and_then(|name| name.strip_prefix(TEMPORARY)) else { continue };
        let pid = rest.split('-').next().unwrap_or_default();
        if !is_running(pid) {
            // A file that cannot be removed does no harm: its name is never read.
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Whether a process of that id runs; where the system does not tell, it counts as running.
fn is_running(pid: &str) -> bool {
    let processes = Path::new("/proc");
    !processes.join("self").exists() || (!pid.is_empty() && processes.join(pid).exists())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn links_stay_and_folders_are_not_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::write(at("file"), b"before").unwrap();
        std::os::unix::fs::symlink(at("file"), at("link")).unwrap();
        write_whole(&at("link"), b"after").unwrap();
        assert!(fs::symlink_metadata(at("link")).unwrap().is_symlink());
        assert_eq!(fs::read(at("file")).unwrap(), b"after");
        fs::create_dir(at("folder")).unwrap();
        assert_eq!(write_whole(&at("folder"), b"x").unwrap_err().kind(), io::ErrorKind::InvalidInput);
    }

    #[test]
    fn leftovers_go_and_running_ones_stay() {
        let dir = tempfile::tempdir().unwrap();
        let mine = format!("{TEMPORARY}{}-abc", std::process::id());
        let gone = format!("{TEMPORARY}4194999-abc");
        for name in [mine.as_str(), &gone, "image.txf"] {
            fs::write(dir.path().join(name), b"x").unwrap();
        }
        remove_stale(dir.path());
        let left = |name: &str| dir.path().join(name).exists();
        assert_eq!((left(&mine), left("image.txf")), (true, true));
        assert_eq!(left(&gone), !Path::new("/proc/self").exists());
    }
}
