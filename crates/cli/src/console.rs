//! What the program says: results on stdout, errors on stderr.

use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, Ordering};

/// True where only errors and requested results are printed.
static QUIET: AtomicBool = AtomicBool::new(false);

/// Suppresses all output but errors and requested results from here on.
pub(crate) fn be_quiet() {
    QUIET.store(true, Ordering::Relaxed);
}

pub(crate) fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// True where stdout did not take a line, as on a full device.
static CUT: AtomicBool = AtomicBool::new(false);

/// Prints a requested result on stdout. A closed pipe is no error; all else that stdout does not take fails the run ([`is_cut`]).
pub(crate) fn answer(text: &str) {
    note_cut(writeln!(io::stdout().lock(), "{text}"));
}

/// Records a failed write to stdout.
pub(crate) fn note_cut(written: io::Result<()>) {
    if written.is_err_and(|error| error.kind() != io::ErrorKind::BrokenPipe) {
        CUT.store(true, Ordering::Relaxed);
    }
}

/// True where stdout is incomplete.
pub(crate) fn is_cut() -> bool {
    note_cut(io::stdout().lock().flush());
    CUT.load(Ordering::Relaxed)
}

/// A line on stdout about what was done.
pub(crate) fn say(line: &str) {
    if !is_quiet() {
        answer(line);
    }
}

/// A warning on stderr: the exit code does not follow from it.
pub(crate) fn warn(line: &str) {
    mention(&format!("warning: {line}"));
}

/// A line on stderr that is no error.
pub(crate) fn mention(line: &str) {
    if !is_quiet() {
        let _ = writeln!(io::stderr().lock(), "{line}");
    }
}

/// An error on stderr.
pub(crate) fn complain(line: &str) {
    let _ = writeln!(io::stderr().lock(), "error: {line}");
}
