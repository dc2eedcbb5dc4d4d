//! `reference`: quality and size of every codec against figures that are kept in the repository.
//!
//! Each case is a `compress` command over some images; PSNR and bits come from its report, so they are those of the shipped files. The check
//! fails where an image's PSNR is more than [`figures::LESS_DB`] below its reference or its bits are more than [`figures::MORE_BITS`]
//! above it. `--write` replaces the references: a change of quality is then a change of a file under review.

mod cases;
mod figures;
mod sources;

use std::env;
use std::fs;
use std::io::{self, Error};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Instant;

use crate::root;
use cases::{Case, Suite};
use figures::Figures;

/// Where files and reports are written, below the workspace's root.
const WORK: &str = "target/reference";
/// Where the references are, below the workspace's root.
const KEPT: &str = "benches/reference";

/// Arguments of `reference`.
#[derive(Debug, clap::Args)]
pub(crate) struct ReferenceArgs {
    /// Replace the references by what is found.
    #[arg(long)]
    write: bool,
    /// Only these images: `fixtures` or `data`; both where this is not given.
    #[arg(long, value_enum)]
    only: Option<Suite>,
    /// Only the cases of this codec; references of others stay as they are.
    #[arg(long, value_name = "CODEC")]
    codec: Option<String>,
    /// Only the five images that every codec encodes.
    #[arg(long, conflicts_with = "write")]
    quick: bool,
    /// Another build of the `texfold` program, to measure instead of this one.
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &ReferenceArgs) -> ExitCode {
    let suites = args.only.map_or(vec![Suite::Fixtures, Suite::Data], |only| vec![only]);
    let mut passed = true;
    for suite in suites {
        match check_suite(suite, args) {
            Ok(found) => passed &= found,
            Err(error) => {
                eprintln!("error: the {} cannot be measured: {error}", suite.name());
                return ExitCode::FAILURE;
            }
        }
    }
    if passed { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn check_suite(suite: Suite, args: &ReferenceArgs) -> io::Result<bool> {
    let work = root().join(WORK).join(suite.name());
    if work.exists() {
        fs::remove_dir_all(&work)?;
    }
    fs::create_dir_all(&work)?;
    let wanted = |case: &Case| args.codec.as_deref().is_none_or(|codec| case.codec == codec);
    let cases: Vec<Case> = suite.cases(&work, args.quick)?.into_iter().filter(wanted).collect();
    let mut found = Vec::new();
    for case in &cases {
        let start = Instant::now();
        found.extend(measure(case, &work, args.program.as_deref())?);
        println!("reference: {} {} in {:.1} s", suite.name(), case.name(), start.elapsed().as_secs_f64());
    }
    let path = root().join(KEPT).join(suite.name()).with_extension("csv");
    let kept = if path.exists() { figures::parse(&fs::read_to_string(&path)?)? } else { Vec::new() };
    if args.write {
        let others = kept.into_iter().filter(|old| cases.iter().all(|case| case.name() != old.case));
        let all: Vec<Figures> = others.chain(found).collect();
        fs::write(&path, figures::csv(&all))?;
        println!("reference: {} figures written to {}", all.len(), path.display());
        return Ok(true);
    }
    let is_wanted = |old: &Figures| {
        cases.iter().any(|case| case.name() == old.case && (!args.quick || case.reads(&old.image)))
    };
    let kept: Vec<Figures> = kept.into_iter().filter(is_wanted).collect();
    let faults = figures::compare(&kept, &found);
    for fault in &faults {
        eprintln!("error: {fault}");
    }
    println!("reference: {} figures of the {}, {} worse", found.len(), suite.name(), faults.len());
    Ok(faults.is_empty())
}

/// Runs a case and reads its report.
fn measure(case: &Case, work: &Path, program: Option<&Path>) -> io::Result<Vec<Figures>> {
    let out = work.join(case.folder());
    let report = out.with_extension("json");
    let program = program.map_or_else(env::current_exe, |program| Ok(program.to_owned()))?;
    let mut command = Command::new(program);
    let name: &[&str] = if case.is_bank { &["bank", "add"] } else { &["compress"] };
    command.args(name).args(&case.inputs).arg("--out").arg(&out).arg("--report").arg(&report);
    if !case.is_bank {
        // A method is measured with its fallback.
        command.arg("--or-plain");
    }
    let output = command.args(&case.arguments).current_dir(root()).output()?;
    if !report.is_file() {
        let text = String::from_utf8_lossy(&output.stderr);
        return Err(Error::other(format!("case {} wrote no report: {text}", case.name())));
    }
    figures::from_report(&case.name(), &fs::read_to_string(&report)?)
}
