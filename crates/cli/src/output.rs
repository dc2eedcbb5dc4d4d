//! Files that appear whole or not at all.

use std::fs;
use std::io::{self, Write};
use std::path::Path;

use crate::error::CliError;

/// First letters of the names of temporary files; the process id follows.
const TEMPORARY: &str = ".texfold-tmp-";

/// Makes `dir` and everything above it.
pub(crate) fn make_folder(dir: &Path) -> Result<(), CliError> {
    fs::create_dir_all(dir).map_err(|source| CliError::MakeFolder { path: dir.to_owned(), source })
}

/// Writes `bytes` to `path`: into a temporary file beside it, to the disk, then renamed.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    write_and_rename(path, bytes).map_err(|source| CliError::Write { path: path.to_owned(), source })
}

fn write_and_rename(path: &Path, bytes: &[u8]) -> io::Result<()> {
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
pub(crate) fn remove_stale(dir: &Path) {
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
