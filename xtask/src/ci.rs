//! `ci`: every check in order, each with its name and time; the first that fails ends it.

use std::fs;
use std::hint::black_box;
use std::io;
use std::process::{Command, ExitCode};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crate::pages::npm;
use crate::run::{cargo, succeeds};
use crate::timed::{slowest, test};
use crate::{python, root, tidy, torment};

/// Arguments of `ci`.
#[derive(Debug, clap::Args)]
pub(crate) struct CiArgs {
    /// Also the long forms of tests, all references and charts of stability, and the documentation of every package: an hour.
    #[arg(long)]
    full: bool,
    /// When the run began, in seconds since 1970: what was built before is then counted.
    #[arg(long, hide = true)]
    since: Option<u64>,
}

/// A check: its name, the time that it may take as a multiple of [`calibration`], and what is done; whether it passed. The multiples
/// are half as much again as on two cores with nothing else to do and nothing built before. A step that takes longer is named at the end.
type Step = (&'static str, f64, fn(full: bool) -> io::Result<bool>);

const STEPS: [Step; 13] = [
    ("fmt", 50.0, |_| succeeds(&["fmt", "--all", "--check"])),
    ("tidy", 20.0, |_| tidy::check(&root())),
    ("build", 10_500.0, |_| succeeds(&BUILD)),
    ("test", 11_000.0, |full| test(&["--workspace".to_owned()], full)),
    ("clippy", 2600.0, |_| succeeds(&["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"])),
    ("web", 2600.0, |_| web()),
    ("python", 2100.0, python::check),
    ("decode only", 650.0, |_| decode_only()),
    ("doc", 500.0, doc),
    ("torment", 10.0, |full| if full { torment::short() } else { Ok(true) }),
    ("features", 10.0, |full| if full { features() } else { Ok(true) }),
    ("bevy", 10.0, |full| if full { bevy() } else { Ok(true) }),
    ("window", 10.0, |full| if full { window() } else { Ok(true) }),
];

/// All that `cargo test --workspace` runs, and the library for Python.
const BUILD: [&str; 5] = ["build", "--workspace", "--lib", "--tests", "--examples"];

/// Packages whose documentation users read: an error in one of the others is found by full runs.
const DOCUMENTED: [&str; 4] = ["texfold", "texfold-core", "texfold-gpu", "texfold-shaders"];

/// Runs the command.
pub(crate) fn run(args: &CiArgs) -> ExitCode {
    let start = Instant::now();
    let before = args.since.map_or(Duration::ZERO, since);
    let unit = calibration();
    let mut times = vec![("before", f64::INFINITY, before.as_secs_f64())];
    let mut all_passed = true;
    for (name, budget, step) in STEPS {
        println!("ci: {name} ...");
        let began = Instant::now();
        let passed = step(args.full);
        times.push((name, budget, began.elapsed().as_secs_f64()));
        if let Err(error) = &passed {
            eprintln!("error: {error}");
        }
        all_passed = matches!(passed, Ok(true));
        if !all_passed {
            eprintln!("ci: {name} FAILED");
            break;
        }
    }
    report(&times, unit, args.full);
    let total = (before + start.elapsed()).as_secs_f64();
    println!("ci: {} in {total:.0} s", if all_passed { "all passed" } else { "FAILED" });
    if all_passed { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Seconds of each step, the slowest tests, and steps beyond their budget.
fn report(times: &[(&str, f64, f64)], unit: f64, full: bool) {
    println!("\n{:>8}  step", "seconds");
    for (name, _, seconds) in times {
        println!("{seconds:8.1}  {name}");
    }
    if let Ok(slowest) = slowest(10) {
        println!("\n{:>8}  slowest tests", "seconds");
        for test in slowest {
            println!("{:8.1}  {}", test.seconds, test.name);
        }
    }
    for (name, budget, seconds) in
        times.iter().filter(|(_, budget, seconds)| !full && *seconds > budget * unit)
    {
        println!(
            "ci: warning: {name} takes {:.0} units of {unit:.3} s; its budget is {budget}",
            seconds / unit
        );
    }
    println!();
}

/// Time since a moment in seconds since 1970.
fn since(moment: u64) -> Duration {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    now.saturating_sub(Duration::from_secs(moment))
}

/// Seconds that this machine takes for a fixed number of dependent additions and multiplications: the shortest of three.
fn calibration() -> f64 {
    let once = || {
        let start = Instant::now();
        let sum =
            (0..50_000_000u64).fold(1u64, |sum, i| black_box(sum.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ i));
        black_box(sum);
        start.elapsed().as_secs_f64()
    };
    (0..3).map(|_| once()).fold(f64::INFINITY, f64::min)
}

/// The browser package: its types, and its tests in Node.js and in headless Chromium.
fn web() -> io::Result<bool> {
    Ok(npm(&["ci", "--silent"])? && npm(&["test", "--silent"])?)
}

/// The program that shows files in a window, which is a workspace of its own: it compiles without warnings, and under a display
/// without a screen, where there is Xvfb, it draws each golden file.
fn window() -> io::Result<bool> {
    let place = ["--release", "--manifest-path", "crates/window/Cargo.toml", "--target-dir", "target/window"];
    let clippy = [&["clippy"], &place[..], &["--", "-D", "warnings"]].concat();
    if !succeeds(&clippy)? || !succeeds(&[&["build"], &place[..]].concat())? {
        return Ok(false);
    }
    let mut all = true;
    for entry in fs::read_dir(root().join("fixtures/golden"))? {
        let path = entry?.path();
        if path.extension().is_none_or(|extension| extension != "txf") {
            continue;
        }
        let run = Command::new("xvfb-run")
            .args(["--auto-servernum", "target/window/release/texfold-window", "--frames", "3"])
            .arg(&path)
            .current_dir(root())
            .output();
        match run {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                println!("ci: no xvfb-run: nothing is drawn in a window");
                return Ok(true);
            }
            Err(error) => return Err(error),
            Ok(run) if run.status.success() => {}
            Ok(run) => {
                eprintln!("error: {} in a window: {}", path.display(), String::from_utf8_lossy(&run.stderr));
                all = false;
            }
        }
    }
    Ok(all)
}

/// Packages that only encoders need, threads among them, and those that need a C compiler.
const NOT_FOR_DECODING: [&str; 8] =
    ["delaunator", "kiddo", "ndarray", "rayon", "texfold-codebook", "texfold-match", "texpresso", "zstd-sys"];

/// The facade without encoders: it compiles without warnings, and depends on nothing that only encoders need.
fn decode_only() -> io::Result<bool> {
    let clean = succeeds(&["clippy", "-p", "texfold", "--no-default-features", "--", "-D", "warnings"])?;
    let tree = ["tree", "-p", "texfold", "--no-default-features", "-e", "normal", "--prefix", "none"];
    let output = cargo().args(tree).output()?;
    let listed = String::from_utf8_lossy(&output.stdout).into_owned();
    let found: Vec<&str> = needless(&listed).collect();
    for name in &found {
        eprintln!("error: texfold without encoders depends on {name}; put it behind the feature `encode`");
    }
    Ok(clean && output.status.success() && found.is_empty())
}

/// Packages of a dependency tree that decoding must not need, each once.
fn needless(tree: &str) -> impl Iterator<Item = &'static str> + '_ {
    let has = |name: &str| tree.lines().any(|line| line.split_whitespace().next() == Some(name));
    NOT_FOR_DECODING.into_iter().filter(move |name| has(name))
}

/// The loader and the material for Bevy, where the compiler suffices.
fn bevy() -> io::Result<bool> {
    let place = ["--manifest-path", "crates/bevy/Cargo.toml", "--target-dir", "target/bevy"];
    let clippy = [&["clippy", "--all-targets"], &place[..], &["--", "-D", "warnings"]].concat();
    Ok(succeeds(&clippy)? && succeeds(&[&["test"], &place[..]].concat())?)
}

/// Tests of the program with the features that take a C++ compiler or long to build, and the other version of wgpu.
fn features() -> io::Result<bool> {
    let older =
        ["clippy", "--package", "texfold-gpu", "--no-default-features", "--features", "wgpu29,offscreen"];
    Ok(succeeds(&["test", "--package", "texfold-cli", "--features", "astc,jxl"])? && succeeds(&older)?)
}

fn doc(full: bool) -> io::Result<bool> {
    let some: Vec<&str> = DOCUMENTED.iter().flat_map(|name| ["--package", name]).collect();
    let packages = if full { vec!["--workspace"] } else { some };
    let arguments = [&["doc", "--no-deps"], &packages[..]].concat();
    Ok(cargo().args(arguments).env("RUSTDOCFLAGS", "-D warnings").status()?.success())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn needless_packages_are_found_in_a_tree() {
        let tree = "texfold v0.1.0 (/x)\ntexfold-core v0.1.0 (/y)\nrayon v1.11.0\nrayon v1.11.0 (*)\nrayon-core v1.13.0\n";
        assert_eq!(needless(tree).collect::<Vec<_>>(), ["rayon"]);
        assert_eq!(needless("texfold v0.1.0\nglam v0.34.2\n").count(), 0);
    }
}
