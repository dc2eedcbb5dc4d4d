//! `python`: the package for Python, built and tested in a virtual environment.

use std::io;
use std::process::{Command, ExitCode};

use crate::root;

/// Runs the command.
pub(crate) fn run() -> ExitCode {
    match check() {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: python3 cannot be run; install python3-venv: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Builds the wheel as tests of Rust are built, installs it and runs its tests; whether they passed.
pub(crate) fn check() -> io::Result<bool> {
    let place = root().join("target/python");
    let bin = place.join("bin");
    let runs = |program: &mut Command| Ok::<bool, io::Error>(program.current_dir(root()).status()?.success());
    if !bin.join("python").exists() && !runs(Command::new("python3").args(["-m", "venv"]).arg(&place))? {
        eprintln!("error: no virtual environment; install python3-venv");
        return Ok(false);
    }
    let mut install = Command::new(bin.join("pip"));
    install.args([
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "pytest",
        "dask",
        "distributed",
        "xarray",
        "./crates/python[zarr,gpu]",
    ]);
    let mut test = Command::new(bin.join("python"));
    test.args(["-m", "pytest", "-q", "-p", "no:cacheprovider", "crates/python/tests"]);
    Ok(runs(install.env("MATURIN_PEP517_ARGS", "--profile dev"))? && runs(&mut test)?)
}
