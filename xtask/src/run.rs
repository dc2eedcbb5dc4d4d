//! Starting cargo and the programs of this workspace.

use std::env;
use std::ffi::{OsStr, OsString};
use std::io::{self, IsTerminal};
use std::process::{Command, ExitCode};

use crate::root;

/// Commands of the package `texfold-checks`.
const CHECKS: [&str; 4] = ["fixtures", "reference", "stability", "web"];
/// Help for the commands of other programs.
pub(crate) const OTHERS: &str = "\
Further commands, built for release on first use:
  fixtures, reference, stability, web         checks of all codecs
  compress, decompress, info, view, render,
  compare, bank                               those of the program texfold

Each has its own --help.";

/// Cargo, in the workspace's root.
pub(crate) fn cargo() -> Command {
    let mut command = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(root());
    command
}

/// Runs cargo in the workspace's root; whether it succeeded.
///
/// # Errors
/// Where cargo cannot be started.
pub(crate) fn succeeds(arguments: &[impl AsRef<OsStr>]) -> io::Result<bool> {
    Ok(cargo().args(arguments).status()?.success())
}

/// Runs a command of another program of the workspace in the current folder, with its exit code.
pub(crate) fn other(arguments: &[OsString]) -> ExitCode {
    let is_check = arguments.first().is_some_and(|name| CHECKS.iter().any(|check| name == check));
    let (package, program) =
        if is_check { ("texfold-checks", "texfold-checks") } else { ("texfold-cli", "texfold") };
    let mut command = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(["run", "--release", "--package", package, "--bin", program, "--manifest-path"]);
    command.arg(root().join("Cargo.toml"));
    if !io::stderr().is_terminal() {
        command.arg("--quiet");
    }
    if env::var_os("XDG_RUNTIME_DIR").is_none() {
        // A layer of Mesa's drivers else prints an error that is none.
        command.env("XDG_RUNTIME_DIR", env::temp_dir());
    }
    match command.arg("--").args(arguments).status() {
        Ok(status) => ExitCode::from(status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1)),
        Err(error) => {
            eprintln!("error: cargo cannot be started; install Rust's toolchain: {error}");
            ExitCode::FAILURE
        }
    }
}
