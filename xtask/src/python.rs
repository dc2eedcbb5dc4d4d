//! `python`: the package for Python, built and tested in a virtual environment.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::io;
use std::process::{Command, ExitCode};

use crate::root;

/// Runs the command.
pub(crate) fn run() -> ExitCode {
    match check(true) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: python3 cannot be run; install python3-venv: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Runs the package's tests; whether they passed. `wheel`: in the wheel that maturin builds; otherwise around the library from the build of the
/// whole workspace, so that nothing is compiled again.
///
/// # Errors
/// Where python3 cannot be started.
pub(crate) fn check(wheel: bool) -> io::Result<bool> {
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
    ]);
    let mut test = Command::new(bin.join("python"));
    test.args(["-m", "pytest", "-q", "-p", "no:cacheprovider", "crates/python/tests"]);
    if wheel {
        install.arg("./crates/python[zarr,gpu]").env("MATURIN_PEP517_ARGS", "--profile dev");
    } else {
        let folder = place.join("assembled");
        let mut assemble = Command::new(bin.join("python"));
        assemble.arg("crates/python/tests/assemble.py");
        assemble.arg(format!("target/debug/{DLL_PREFIX}_texfold{DLL_SUFFIX}")).arg(&folder);
        let needed = assemble.current_dir(root()).output()?;
        if !needed.status.success() {
            eprintln!("error: {}", String::from_utf8_lossy(&needed.stderr));
            return Ok(false);
        }
        install.args(String::from_utf8_lossy(&needed.stdout).lines());
        test.env("PYTHONPATH", folder);
    }
    Ok(runs(&mut install)? && runs(&mut test)?)
}
