//! `fixtures`: the test images under fixtures/, from code.

use std::io;
use std::path::PathBuf;
use std::process::ExitCode;

use texfold_testkit::fixtures::{check_all, write_all};

use crate::root;

/// Arguments of `fixtures`.
#[derive(Debug, clap::Args)]
pub(crate) struct FixturesArgs {
    /// Change nothing; fail where a file differs from what the code gives.
    #[arg(long)]
    check: bool,
}

/// Runs the command.
pub(crate) fn run(args: &FixturesArgs) -> ExitCode {
    let done = if args.check { check() } else { write() };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: fixtures/ cannot be read or written; check its permissions: {error}");
            ExitCode::FAILURE
        }
    }
}

fn folder() -> PathBuf {
    root().join("fixtures")
}

fn write() -> io::Result<bool> {
    let written = write_all(&folder())?;
    println!("{} files written", written.len());
    Ok(true)
}

/// Whether all files are as the code gives them; names those that are not.
fn check() -> io::Result<bool> {
    let odd = check_all(&folder())?;
    for path in &odd {
        eprintln!("error: fixtures/{} is not what the code gives; run cargo xtask fixtures", path.display());
    }
    Ok(odd.is_empty())
}
