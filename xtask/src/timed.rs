//! Running tests by cargo, with the time of each test.

use std::env;
use std::ffi::OsString;
use std::fs::{self, OpenOptions};
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use crate::root;
use crate::run::cargo;

/// Where times are noted, below the workspace's root: a line of seconds and name for each test.
const TIMES: &str = "target/ci/tests";

/// The time of a test, in seconds.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Timed {
    pub(crate) seconds: f64,
    /// Program and test.
    pub(crate) name: String,
}

/// Runs `cargo test` with these arguments on a GPU or software Vulkan; whether all tests pass. `full` takes their long forms.
///
/// # Errors
/// Where cargo cannot be started or times cannot be noted.
pub(crate) fn test(arguments: &[String], full: bool) -> io::Result<bool> {
    let times = root().join(TIMES);
    fs::create_dir_all(times.parent().unwrap_or(&times))?;
    fs::write(&times, "")?;
    let mut command = cargo();
    // cfg(all()) holds for every target.
    let runner = format!(
        "target.\"cfg(all())\".runner=[{:?},\"time-tests\"]",
        env::current_exe()?.display().to_string()
    );
    command
        .args(["--config", &runner, "test"])
        .args(arguments)
        .env("TEXFOLD_GPU", "require")
        .env("TEXFOLD_TOOLS", "require");
    if full {
        // A run of half an hour tells all that is wrong.
        command.arg("--no-fail-fast").env("TEXFOLD_FULL", "1");
    }
    Ok(command.status()?.success())
}

/// The slowest tests of the last run, slowest first.
///
/// # Errors
/// Where the file of times cannot be read.
pub(crate) fn slowest(count: usize) -> io::Result<Vec<Timed>> {
    let text = fs::read_to_string(root().join(TIMES))?;
    let timed = |line: &str| {
        let (seconds, name) = line.split_once(' ')?;
        Some(Timed { seconds: seconds.parse().ok()?, name: name.to_owned() })
    };
    let mut all: Vec<Timed> = text.lines().filter_map(timed).collect();
    all.sort_by(|a, b| b.seconds.total_cmp(&a.seconds));
    all.truncate(count);
    Ok(all)
}

/// Runs a test program, prints what is not the name of a test that passes, and notes times; its exit code.
pub(crate) fn run(program: &Path, arguments: &[OsString]) -> ExitCode {
    match timed(program, arguments) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {} cannot be run: {error}", program.display());
            ExitCode::FAILURE
        }
    }
}

fn timed(program: &Path, arguments: &[OsString]) -> io::Result<ExitCode> {
    let mut command = Command::new(program);
    command.args(arguments);
    // Programs of documentation's examples, which rustdoc writes elsewhere, have no such options.
    if program.parent().is_some_and(|folder| folder.ends_with("deps")) {
        // Times are an unstable option of the test harness; the variable allows it to the harness, which reads it when it runs.
        command.args(["-Zunstable-options", "--report-time"]).env("RUSTC_BOOTSTRAP", "1");
    }
    let mut child = command.stdout(Stdio::piped()).spawn()?;
    let mut notes = OpenOptions::new().append(true).create(true).open(root().join(TIMES))?;
    if let Some(output) = child.stdout.take() {
        for line in BufReader::new(output).lines() {
            let line = line?;
            match passed(&line) {
                Some((name, seconds)) => writeln!(notes, "{seconds} {} {name}", package(program))?,
                None if line.is_empty() => {}
                None => println!("{line}"),
            }
        }
    }
    let status = child.wait()?;
    Ok(ExitCode::from(status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1)))
}

/// Name and seconds of a line such as `test a::b ... ok <0.123s>`.
fn passed(line: &str) -> Option<(&str, &str)> {
    let (name, seconds) = line.strip_prefix("test ")?.split_once(" ... ok <")?;
    Some((name, seconds.strip_suffix("s>")?))
}

/// The package whose tests are run: cargo sets it for what it starts.
fn package(program: &Path) -> String {
    let folder = env::var_os("CARGO_MANIFEST_DIR").map(PathBuf::from).unwrap_or_default();
    let name = folder.file_name().or(program.file_stem()).unwrap_or_default();
    name.to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_from_lines_of_tests_that_pass() {
        assert_eq!(passed("test a::b ... ok <0.123s>"), Some(("a::b", "0.123")));
        assert_eq!(passed("test a::b ... FAILED <0.123s>"), None);
        assert_eq!(passed("test result: ok. 42 passed"), None);
    }
}
