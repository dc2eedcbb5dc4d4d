//! `fuzz`: builds the targets of fuzz/ for libFuzzer, on a stable compiler, and runs them in turn.

use std::env;
use std::fs;
use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use crate::root;
use crate::run::cargo;

/// Seeds of a fuzz target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Seeds {
    /// Golden files.
    Golden,
    /// Nothing: it reads instructions.
    None,
    /// Files of all forms that the command line reads.
    Inputs,
}

/// Fuzz targets.
const TARGETS: [(&str, Seeds); 4] =
    [("open", Seeds::Golden), ("blocks", Seeds::None), ("sections", Seeds::None), ("inputs", Seeds::Inputs)];
/// Inputs that are texts, each with the number of its kind: `texfold_cli::FOREIGN`.
const TEXTS: [(u8, &str); 9] = [
    (
        3,
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float u\nproperty float v\n\
         element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n",
    ),
    (
        4,
        r#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":60,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAAAAAAAAAAAAIA/AAAAAAAAAAAAAIA/"}],"bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":24}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}],"meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1}}]}],"nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}]}"#,
    ),
    (6, "1 1 0 0 0 0 0 0 1 a.png\n\n\x001 OPENCV 8 6 5 5 4 3 0.1 0 0 0\n"),
    (7, "root = \"a.png\"\ntau = 1.5\n[[patch]]\nimage = \"b.png\"\nmatrix = [1, 0, 0, 0, 1, 0, 0, 0, 1]\n"),
    // No image, and no camera.
    (9, "\x08\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0"),
    (10, "1\na.png 5 0 4 0 5 3 0 0 1 1 0 0 0 1 0 0 0 1 0 0 2\n"),
    (
        11,
        r#"<document version="1.5.0"><chunk><sensors><sensor id="0"><calibration><resolution width="8" height="6"/><f>5</f></calibration></sensor></sensors><cameras><camera id="0" sensor_id="0" label="a"><transform>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</transform></camera></cameras></chunk></document>"#,
    ),
    // No platform, and no image.
    (12, "MVSI\x07\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0"),
    (8, r#"{"version":1,"next":0,"categories":[],"images":[]}"#),
];
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
    /// Afterwards write the smallest inputs that reach as much to fixtures/fuzz, where tests find them.
    #[arg(long)]
    keep: bool,
}

/// Most bytes of the inputs of a target that are kept.
const KEPT_BYTES: usize = 1 << 20;

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
    let named = |(name, _): &&(&str, Seeds)| args.target.as_deref().is_none_or(|wanted| wanted == *name);
    let targets: Vec<_> = TARGETS.iter().filter(named).collect();
    if targets.is_empty() {
        let all = TARGETS.map(|(name, _)| name).join(", ");
        return Err(io::Error::other(format!("there is no such target; give one of {all}")));
    }
    let programs = build()?;
    let seconds = 60 * args.minutes / targets.len() as u32;
    let mut is_clean = true;
    for (name, seeds) in targets {
        let place = root().join("fuzz");
        let (corpus, faults) = (place.join("corpus").join(name), place.join("artifacts").join(name));
        fs::create_dir_all(&corpus)?;
        fs::create_dir_all(&faults)?;
        match seeds {
            Seeds::Golden => seed(&corpus)?,
            Seeds::Inputs => seed_inputs(&corpus)?,
            Seeds::None => {}
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
        // Inputs of the command line are kept by no test.
        if args.keep && passed && *seeds != Seeds::Inputs {
            keep(&programs.join(name), name, &corpus)?;
        }
    }
    Ok(is_clean)
}

/// Writes inputs that reach all that a corpus reaches, the shortest first, each behind its length in four bytes.
fn keep(program: &Path, name: &str, corpus: &Path) -> io::Result<()> {
    let merged = root().join("target/fuzz").join(format!("{name}-merged"));
    let _ = fs::remove_dir_all(&merged);
    fs::create_dir_all(&merged)?;
    let mut command = Command::new(program);
    command.args(LIMITS).arg("-merge=1").arg(&merged).arg(corpus);
    if !command.stdout(Stdio::null()).stderr(Stdio::null()).status()?.success() {
        return Err(io::Error::other(format!("the inputs of {name} cannot be merged")));
    }
    let read = |entry: io::Result<fs::DirEntry>| fs::read(entry?.path());
    let mut inputs: Vec<Vec<u8>> = fs::read_dir(&merged)?.map(read).collect::<io::Result<_>>()?;
    inputs.sort_by_key(|input| (input.len(), input.clone()));
    let mut out = Vec::new();
    let mut count = 0;
    for input in inputs {
        if out.len() + 4 + input.len() > KEPT_BYTES {
            break;
        }
        out.extend((input.len() as u32).to_le_bytes());
        out.extend(input);
        count += 1;
    }
    let folder = root().join("fixtures/fuzz");
    fs::create_dir_all(&folder)?;
    fs::write(folder.join(format!("{name}.bin")), &out)?;
    println!("{name}: {count} inputs of {} bytes kept", out.len());
    Ok(())
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

/// Writes inputs of all kinds: what the tests of the command line make, a capture's, and texts.
fn seed_inputs(corpus: &Path) -> io::Result<()> {
    let test = ["test", "-q", "-p", "texfold-cli", "--test", "corpus", "every_form_has_its_outcome"];
    let made = cargo().args(test).env("TEXFOLD_SEEDS", corpus).stdout(Stdio::null()).status()?;
    if !made.success() {
        return Err(io::Error::other("the test of all forms of inputs fails; mend that first"));
    }
    let capture = root().join("fixtures/captures/ball");
    for (kind, name) in [(2, "mesh.obj"), (5, "transforms.json")] {
        let bytes = [fs::read(capture.join(name))?, vec![kind]].concat();
        fs::write(corpus.join(name), bytes)?;
    }
    for (kind, text) in TEXTS {
        fs::write(corpus.join(format!("text-{kind}")), [text.as_bytes(), &[kind]].concat())?;
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
    // The crate tiff prints some of its errors.
    let is_foreign = line.starts_with('[') && line.contains("registry");
    is_numbered || is_foreign || line.is_empty() || start.iter().any(|start| line.starts_with(start))
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
