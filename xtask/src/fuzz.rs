//! `fuzz`: builds the targets of fuzz/ for libFuzzer, on a stable compiler, and runs them in turn.

use std::env;
use std::fs;
use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use crate::root;
use crate::run::cargo;

/// Fuzz targets, and whether golden files are seeds of theirs; the others read instructions.
const TARGETS: [(&str, bool); 3] = [("open", true), ("blocks", false), ("sections", false)];
/// Coverage for libFuzzer, and what debug builds check.
const FLAGS: &str = "-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
    -Cllvm-args=-sanitizer-coverage-trace-compares -Ccodegen-units=1 -Cdebug-assertions -Coverflow-checks --cfg fuzzing";
/// An execution that takes more memory or time than this is a fault.
const LIMITS: [&str; 2] = ["-rss_limit_mb=2048", "-timeout=10"];
/// Longest input in bytes: most golden files are shorter.
const LONGEST: u32 = 40_000;

/// Arguments of `fuzz`.
#[derive(Debug, clap::Args)]
pub(crate) struct FuzzArgs {
    /// Minutes of all targets together.
    #[arg(long, value_name = "N", default_value_t = 6)]
    minutes: u32,
    /// Only this target.
    target: Option<String>,
}

/// Runs the command.
pub(crate) fn run(args: &FuzzArgs) -> ExitCode {
    match fuzz(args) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Runs the targets; true where no fault was found.
fn fuzz(args: &FuzzArgs) -> io::Result<bool> {
    let named = |(name, _): &&(&str, bool)| args.target.as_deref().is_none_or(|wanted| wanted == *name);
    let targets: Vec<_> = TARGETS.iter().filter(named).collect();
    if targets.is_empty() {
        let all = TARGETS.map(|(name, _)| name).join(", ");
        return Err(io::Error::other(format!("there is no such target; give one of {all}")));
    }
    let programs = build()?;
    let seconds = 60 * args.minutes / targets.len() as u32;
    let mut is_clean = true;
    for (name, takes_files) in targets {
        let place = root().join("fuzz");
        let (corpus, faults) = (place.join("corpus").join(name), place.join("artifacts").join(name));
        fs::create_dir_all(&corpus)?;
        fs::create_dir_all(&faults)?;
        if *takes_files {
            seed(&corpus)?;
        }
        let mut command = Command::new(programs.join(name));
        command.args(LIMITS).arg(format!("-max_total_time={seconds}")).arg(format!("-max_len={LONGEST}"));
        command
            .arg(format!("-artifact_prefix={}/", faults.display()))
            .arg("-print_final_stats=1")
            .arg(&corpus);
        let (passed, executions) = watched(&mut command)?;
        let outcome = if passed { "no fault" } else { "FAILED" };
        println!("{name}: {executions} executions in {seconds} s, {outcome}");
        is_clean &= passed;
    }
    Ok(is_clean)
}

/// Builds the targets; the folder of their programs.
fn build() -> io::Result<PathBuf> {
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let told = Command::new(rustc).arg("-vV").output()?;
    let told = String::from_utf8_lossy(&told.stdout).into_owned();
    let host = told.lines().find_map(|line| line.strip_prefix("host: "));
    let host = host.ok_or_else(|| io::Error::other("rustc does not name its host"))?;
    let target = root().join("target/fuzz");
    // With a target named, flags are not those of build scripts and macros.
    let built = cargo()
        .args(["build", "--release", "--manifest-path", "fuzz/Cargo.toml", "--target", host, "--target-dir"])
        .arg(&target)
        .env("RUSTFLAGS", FLAGS)
        .status()?;
    if built.success() {
        Ok(target.join(host).join("release"))
    } else {
        Err(io::Error::other("fuzz/ cannot be built; a C++ compiler is needed"))
    }
}

/// Copies the golden files where they are not.
fn seed(corpus: &Path) -> io::Result<()> {
    for entry in fs::read_dir(root().join("fixtures/golden"))? {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension == "txf") {
            fs::copy(&path, corpus.join(path.file_name().unwrap_or_default()))?;
        }
    }
    Ok(())
}

/// Runs a target and prints what it finds; true where it finds no fault, and its executions.
fn watched(command: &mut Command) -> io::Result<(bool, u64)> {
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
    let mut executions = 0;
    if let Some(told) = child.stderr.take() {
        for line in BufReader::new(told).split(b'\n') {
            let line = String::from_utf8_lossy(&line?).into_owned();
            if let Some(count) = line.strip_prefix("stat::number_of_executed_units:") {
                executions = count.trim().parse().unwrap_or(0);
            } else if !is_progress(&line) {
                eprintln!("{line}");
            }
        }
    }
    Ok((child.wait()?.success(), executions))
}

/// True for lines that tell how far libFuzzer is.
fn is_progress(line: &str) -> bool {
    let is_numbered = line.starts_with('#') && line.contains("cov:");
    let start = ["INFO:", "WARNING: Failed to find function", "stat::", "Done", "#", "\tNEW_FUNC", "\""];
    is_numbered || line.is_empty() || start.iter().any(|start| line.starts_with(start))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_target_is_listed() -> io::Result<()> {
        let manifest = fs::read_to_string(root().join("fuzz/Cargo.toml"))?;
        let named: Vec<&str> =
            manifest.lines().filter_map(|line| line.strip_prefix("name = \"")).skip(1).collect();
        assert_eq!(named, TARGETS.map(|(name, _)| format!("{name}\"")));
        Ok(())
    }

    #[test]
    fn faults_are_printed_and_progress_is_not() {
        assert!(is_progress("#2048\tNEW    cov: 310 ft: 400"));
        assert!(!is_progress("thread '<unnamed>' panicked at src/lib.rs:3:5:"));
    }
}
