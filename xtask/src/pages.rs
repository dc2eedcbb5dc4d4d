//! `pages`: every page that the commands write, looked at by headless Chromium.

use std::io;
use std::path::Path;
use std::process::{Command, ExitCode};

use crate::root;
use crate::run::cargo;

/// Inputs of `compare` and `view`.
const IMAGES: [&str; 2] = ["fixtures/images/facade.png", "fixtures/images/terrain.png"];
const CAPTURE: &str = "fixtures/captures/ball";

/// Runs the command.
pub(crate) fn run() -> ExitCode {
    match pages() {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Writes all pages into target/pages and checks them; whether nothing is wrong.
fn pages() -> io::Result<bool> {
    let out = root().join("target/pages");
    let at = |name: &str| out.join(name).display().to_string();
    let (compare, stability, files, view) = (at("compare"), at("stability"), at("files"), at("view.html"));
    let all_images = [IMAGES[0], IMAGES[1], CAPTURE];
    let compress =
        [&["compress"], &all_images[..], &["--out", &files, "--effort", "fast", "--mips"]].concat();
    let texfold = |name: &str| format!("{files}/{name}.txf");
    let made = ["facade", "terrain", "ball"].map(texfold);
    let made: Vec<&str> = made.iter().map(String::as_str).collect();
    let originals = ["--original", IMAGES[0], "--original", IMAGES[1], "--out", &view];
    let written = checks(&[&["compare"], &IMAGES[..], &["--out", &compare, "--effort", "fast"]].concat())?
        && checks(&["stability", "--bounds", "--out", &stability])?
        && checks(&compress)?
        && checks(&[&["view"], &made[..], &originals].concat())?
        && npm(&["ci", "--silent"])?
        && npm(&["run", "build", "--silent"])?;
    if !written {
        return Ok(false);
    }
    let web = root().join("web");
    let mut node = Command::new("node");
    node.current_dir(root()).arg(web.join("pages.mjs")).arg(out.join("screenshots"));
    node.args(["compare/report.html", "compare/images.html", "stability/report.html"].map(at));
    node.arg(view);
    node.args(["dist/conformance.html", "dist/try.html"].map(|page| web.join(page)));
    Ok(node.status()?.success())
}

/// A command of the package of checks, which has those of the program, too.
fn checks(arguments: &[&str]) -> io::Result<bool> {
    let run = ["run", "--quiet", "--package", "texfold-checks", "--"];
    Ok(cargo().args(run).args(arguments).status()?.success())
}

/// A command of npm in web/.
pub(crate) fn npm(arguments: &[&str]) -> io::Result<bool> {
    let web: &Path = &root().join("web");
    let status = Command::new("npm").current_dir(web).args(arguments).status();
    let missing = |error: io::Error| match error.kind() {
        io::ErrorKind::NotFound => {
            io::Error::other("npm cannot be started; install Node.js 20 or later with npm")
        }
        _ => error,
    };
    Ok(status.map_err(missing)?.success())
}
