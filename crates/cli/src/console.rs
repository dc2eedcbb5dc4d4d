//! What the program says: results on stdout, errors on stderr.

use std::io::Write;
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

/// Prints a requested result on stdout. A closed pipe is no error.
pub(crate) fn answer(text: &str) {
    let _ = writeln!(std::io::stdout().lock(), "{text}");
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
        let _ = writeln!(std::io::stderr().lock(), "{line}");
    }
}

/// An error on stderr.
pub(crate) fn complain(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "error: {line}");
}
