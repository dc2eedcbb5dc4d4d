//! Project automation: `cargo xtask COMMAND`.
//!
//! compress, decompress, info, render and compare are those of the `texfold` program; the others are the project's own.

mod ci;
mod fixtures;
mod mutate;
mod reference;
mod stability;
mod tidy;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;

/// Texfold, and the chores of its repository.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask")]
struct Tasks {
    #[command(subcommand)]
    task: Task,
}

#[derive(Debug, clap::Subcommand)]
enum Task {
    #[command(flatten)]
    Texfold(texfold_cli::Command),
    /// Rebuild fixtures/ from code.
    Fixtures(fixtures::FixturesArgs),
    /// Compare quality and size of every codec with the figures in benches/reference.
    Reference(reference::ReferenceArgs),
    /// Every codec on inputs that methods do not suit, held to bounds, and where each stops working.
    Stability(stability::StabilityArgs),
    /// Check the invariants that can be seen in manifests and source text.
    Tidy,
    /// Break the code in known ways and expect a test to fail for each.
    Mutate(mutate::MutateArgs),
    /// Run all that continuous integration runs; stops at the first failure.
    Ci,
}

fn main() -> ExitCode {
    match Tasks::parse().task {
        Task::Texfold(command) => texfold_cli::run(command),
        Task::Fixtures(args) => fixtures::run(&args),
        Task::Reference(args) => reference::run(&args),
        Task::Stability(args) => stability::run(&args),
        Task::Tidy => tidy::run(),
        Task::Mutate(args) => mutate::run(&args),
        Task::Ci => ci::run(),
    }
}

/// The workspace's root: the folder above this package's.
fn root() -> PathBuf {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.parent().unwrap_or(package).to_owned()
}
