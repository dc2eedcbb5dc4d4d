//! `chart`: draws again what README and the tables of benches show of comparisons.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::{env, fs, io};

use crate::root;
use crate::run::succeeds;

/// Arguments of `chart`.
#[derive(Debug, clap::Args)]
pub(crate) struct ChartArgs {
    /// Suites; by default all: sheet, peers, speed.
    #[arg(value_parser = ["sheet", "peers", "speed"])]
    suites: Vec<String>,
}

/// A comparison, and the files of it that are shown.
struct Shown {
    suite: &'static str,
    inputs: fn() -> Vec<PathBuf>,
    /// Files of the comparison, and their names in benches/chart.
    files: &'static [(&'static str, &'static str)],
}

const ALL: [Shown; 3] = [
    Shown {
        suite: "sheet",
        inputs: || {
            let fixture = |name| root().join("fixtures/images").join(name);
            ["salient.png", "floor.png", "tile_repeat.png"].map(fixture).into()
        },
        files: &[("sheet.png", "sheet.png")],
    },
    Shown {
        suite: "peers",
        inputs: || photographs(2),
        files: &[
            ("charts/compressed-size-psnr.svg", "peers-psnr.svg"),
            ("charts/compressed-size-ssimulacra2.svg", "peers-ssimulacra2.svg"),
        ],
    },
    Shown {
        suite: "speed",
        inputs: || photographs(4),
        files: &[
            ("charts/encoding-psnr.svg", "speed-psnr.svg"),
            ("charts/encoding-ssimulacra2.svg", "speed-ssimulacra2.svg"),
        ],
    },
];

/// Every so many of the photographs in the folder for data.
fn photographs(step: usize) -> Vec<PathBuf> {
    let data = env::var_os("TEXFOLD_DATA").map_or_else(|| root().join("../shared/data"), PathBuf::from);
    let entries = fs::read_dir(data.join("vq/kodak")).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    paths.into_iter().step_by(step).collect()
}

/// Runs the command.
pub(crate) fn run(args: &ChartArgs) -> ExitCode {
    let is_wanted =
        |shown: &&Shown| args.suites.is_empty() || args.suites.iter().any(|name| name == shown.suite);
    match ALL.iter().filter(is_wanted).try_for_each(draw) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn draw(Shown { suite, inputs, files }: &Shown) -> io::Result<()> {
    let inputs = inputs();
    if inputs.is_empty() {
        return Err(io::Error::other("there are no photographs; name their folder by TEXFOLD_DATA"));
    }
    let out = root().join("target/chart").join(suite);
    let mut arguments: Vec<PathBuf> =
        ["run", "--release", "-p", "texfold-cli", "--", "compare", "--suite", suite, "--out"]
            .map(PathBuf::from)
            .into();
    arguments.push(out.clone());
    arguments.extend(inputs);
    if !succeeds(&arguments)? {
        return Err(io::Error::other(format!("compare --suite {suite} failed")));
    }
    for (from, to) in *files {
        copy(&out.join(from), &root().join("benches/chart").join(to))?;
    }
    Ok(())
}

fn copy(from: &Path, to: &Path) -> io::Result<()> {
    fs::copy(from, to).map(drop).map_err(|error| io::Error::other(format!("{}: {error}", from.display())))
}
