//! Project automation: `cargo xtask COMMAND`.
//!
//! This program depends on no codec, so that it is built in seconds. Commands that need codecs are those of the package
//! `texfold-checks` and of the program `texfold`, which are built for release and started.

mod api;
mod chart;
mod ci;
mod fuzz;
mod mutate;
mod pages;
mod python;
mod quick;
mod run;
mod tidy;
mod timed;
mod torment;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;

/// Chores of Texfold's repository.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask", after_help = run::OTHERS)]
struct Tasks {
    #[command(subcommand)]
    task: Task,
}

#[derive(Debug, clap::Subcommand)]
enum Task {
    /// Check the invariants that can be seen in manifests and source text.
    Tidy,
    /// Break the code in known ways and expect a test to fail for each.
    Mutate(mutate::MutateArgs),
    /// Lint and test the packages that changed, and what holds for every codec.
    Quick(quick::QuickArgs),
    /// Compare codecs as README shows it, and draw its charts again (benches/chart).
    Chart(chart::ChartArgs),
    /// Run the fuzz targets of fuzz/.
    Fuzz(fuzz::FuzzArgs),
    /// Kill the program, take its space and its threads, and expect whole files.
    Torment(torment::TormentArgs),
    /// Write every page that commands write, and look at them in headless Chromium.
    Pages,
    /// Build the package for Python in a virtual environment, target/python, and run its tests.
    Python,
    /// Run all that continuous integration runs; stops at the first failure.
    Ci(ci::CiArgs),
    /// Run a test program for cargo and note the time of each test.
    #[command(hide = true)]
    TimeTests { program: PathBuf, arguments: Vec<OsString> },
    #[command(external_subcommand)]
    Other(Vec<OsString>),
}

fn main() -> ExitCode {
    match Tasks::parse().task {
        Task::Tidy => tidy::run(),
        Task::Chart(args) => chart::run(&args),
        Task::Mutate(args) => mutate::run(&args),
        Task::Quick(args) => quick::run(&args),
        Task::Fuzz(args) => fuzz::run(&args),
        Task::Torment(args) => torment::run(&args),
        Task::Pages => pages::run(),
        Task::Python => python::run(),
        Task::Ci(args) => ci::run(&args),
        Task::TimeTests { program, arguments } => timed::run(&program, &arguments),
        Task::Other(arguments) => run::other(&arguments),
    }
}

/// The workspace's root: the folder above this package's.
fn root() -> PathBuf {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.parent().unwrap_or(package).to_owned()
}
