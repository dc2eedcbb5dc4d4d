//! Checks of all codecs: `cargo xtask fixtures`, `reference`, `stability` and `web`. The commands of the `texfold` program are here too, as
//! `reference` compares their reports.

mod fixtures;
mod reference;
mod stability;
mod web;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;

/// Checks of all codecs.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask")]
struct Checks {
    /// Commands of texfold: print errors alone, and what `info` and `bank list` are asked for.
    #[arg(long, global = true)]
    quiet: bool,
    #[command(subcommand)]
    check: Check,
}

#[derive(Debug, clap::Subcommand)]
enum Check {
    #[command(flatten)]
    Texfold(texfold_cli::Command),
    /// Rebuild fixtures/ from code.
    Fixtures(fixtures::FixturesArgs),
    /// Compare quality and size of every codec with the figures in benches/reference.
    Reference(reference::ReferenceArgs),
    /// Hold every codec to bounds on inputs that methods do not suit, and chart where each stops working.
    Stability(stability::StabilityArgs),
    /// Write what the browser package takes from this code.
    Web(web::WebArgs),
}

fn main() -> ExitCode {
    let Checks { quiet, check } = Checks::parse();
    match check {
        Check::Texfold(command) => texfold_cli::run(command, quiet),
        Check::Fixtures(args) => fixtures::run(&args),
        Check::Reference(args) => reference::run(&args),
        Check::Stability(args) => stability::run(&args),
        Check::Web(args) => web::run(&args),
    }
}

/// The workspace's root: two folders above this package's.
fn root() -> PathBuf {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.ancestors().nth(2).unwrap_or(package).to_owned()
}
