//! `quick`: what to run while working: lints and tests of the packages that changed, and the tests that hold for every codec.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::Path;
use std::process::{Command, ExitCode};
use std::time::Instant;

use crate::run::succeeds;
use crate::timed::test;
use crate::{root, tidy};

/// Arguments of `quick`.
#[derive(Debug, clap::Args)]
pub(crate) struct QuickArgs {
    /// Packages, by name or by folder below crates/; otherwise those of the files that differ from the last commit, and where none
    /// differs, those of the last commit's files.
    #[arg(value_name = "CRATE")]
    packages: Vec<String>,
}

/// Runs the command.
pub(crate) fn run(args: &QuickArgs) -> ExitCode {
    let start = Instant::now();
    match checked(args) {
        Ok(passed) => {
            let outcome = if passed { "passed" } else { "FAILED" };
            println!("quick: {outcome} in {:.0} s", start.elapsed().as_secs_f64());
            if passed { ExitCode::SUCCESS } else { ExitCode::FAILURE }
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn checked(args: &QuickArgs) -> io::Result<bool> {
    let named: BTreeSet<String> =
        args.packages.iter().map(|name| package_of(name)).collect::<io::Result<_>>()?;
    let packages = if named.is_empty() { changed()? } else { named };
    let list: Vec<&str> = packages.iter().map(String::as_str).collect();
    println!(
        "quick: {}",
        if list.is_empty() { "no package has changed".to_owned() } else { list.join(", ") }
    );
    if !succeeds(&["fmt", "--all", "--check"])? || !tidy::check(&root())? || list.is_empty() {
        return Ok(list.is_empty());
    }
    let selected: Vec<String> =
        list.iter().flat_map(|name| ["--package".to_owned(), (*name).to_owned()]).collect();
    let lint: Vec<String> = ["clippy".to_owned()].into_iter().chain(selected.clone()).collect();
    let strict = ["--all-targets", "--", "-D", "warnings"].map(str::to_owned);
    if !succeeds(&[lint, strict.to_vec()].concat())? || !test(&selected, false)? {
        return Ok(false);
    }
    let every_codec = ["--package", "texfold", "--test", "main", "codecs::"].map(str::to_owned);
    Ok(list.contains(&"texfold") || test(&every_codec, false)?)
}

/// Packages of the files that git sees changed.
fn changed() -> io::Result<BTreeSet<String>> {
    let mut files = git(&["status", "--porcelain", "--untracked-files=all", "--no-renames"])?
        .lines()
        .filter_map(|line| line.get(3..).map(str::to_owned))
        .collect::<Vec<_>>();
    if files.is_empty() {
        files = git(&["diff", "--name-only", "HEAD~1"])?.lines().map(str::to_owned).collect();
    }
    Ok(files.iter().filter_map(|file| owner(Path::new(file))).collect())
}

fn git(arguments: &[&str]) -> io::Result<String> {
    let output = Command::new("git").args(arguments).current_dir(root()).output()?;
    if output.status.success() {
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    } else {
        Err(io::Error::other("git cannot tell what has changed; name a package"))
    }
}

/// The package that a file below the workspace's root belongs to; `None` for those beside all packages and for fuzz targets and the
/// program with a window, which are workspaces of their own.
fn owner(file: &Path) -> Option<String> {
    let folder = file.ancestors().skip(1).find(|folder| root().join(folder).join("Cargo.toml").is_file())?;
    let is_apart = ["fuzz", "crates/window"].iter().any(|apart| folder.starts_with(apart));
    if folder.as_os_str().is_empty() || is_apart { None } else { name_in(folder) }
}

fn name_in(folder: &Path) -> Option<String> {
    let manifest = fs::read_to_string(root().join(folder).join("Cargo.toml")).ok()?;
    let name = manifest.lines().find_map(|line| line.strip_prefix("name = \""))?;
    name.strip_suffix('"').map(str::to_owned)
}

/// A package that is named by its name or its folder.
fn package_of(name: &str) -> io::Result<String> {
    let folders = [
        format!("crates/{name}"),
        name.to_owned(),
        format!("crates/{}", name.trim_start_matches("texfold-")),
    ];
    let unknown = || io::Error::other(format!("there is no package {name}; give a folder of crates/"));
    folders.iter().find_map(|folder| name_in(Path::new(folder))).ok_or_else(unknown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_belong_to_the_nearest_package() {
        assert_eq!(owner(Path::new("crates/bc/src/lib.rs")).as_deref(), Some("texfold-bc"));
        assert_eq!(owner(Path::new("shaders/wgsl/vq.wgsl")).as_deref(), Some("texfold-shaders"));
        assert_eq!(owner(Path::new("README.md")), None);
        assert_eq!(owner(Path::new("fuzz/fuzz_targets/open.rs")), None);
        assert_eq!(owner(Path::new("crates/window/src/main.rs")), None);
    }

    #[test]
    fn packages_are_known_by_name_and_by_folder() {
        for name in ["residual", "texfold-residual", "crates/residual"] {
            assert_eq!(package_of(name).ok().as_deref(), Some("texfold-residual"), "{name}");
        }
        assert!(package_of("nothing").is_err());
    }
}
