//! `ci`: every check in order, each with its name and time; the first that fails ends it.

use std::env;
use std::ffi::OsStr;
use std::io::{self, Write};
use std::path::Path;
use std::process::{Command, ExitCode};
use std::time::Instant;

use crate::{fixtures, reference, root, tidy};

/// Where the trial of the main commands writes, below the workspace's root.
const TRIAL: &str = "target/ci";

/// A name, and what is done; whether it passed.
type Step = (&'static str, fn() -> io::Result<bool>);

const STEPS: [Step; 12] = [
    ("fmt", || cargo(&["fmt", "--all", "--check"], &[])),
    ("tidy", || tidy::check(&root())),
    ("clippy", || cargo(&["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"], &[])),
    ("test", || cargo(&["test", "--workspace"], &[("TEXFOLD_GPU", "require")])),
    ("decode only", decode_only),
    ("doc", || cargo(&["doc", "--workspace", "--no-deps"], &[("RUSTDOCFLAGS", "-D warnings")])),
    ("fixtures", fixtures::check),
    ("compress and decompress", compress_and_decompress),
    ("compress and render", compress_and_render),
    ("compare", compare),
    ("stability", stability),
    ("reference", reference::check),
];

/// Runs the command.
pub(crate) fn run() -> ExitCode {
    let start = Instant::now();
    for (name, step) in STEPS {
        println!("ci: {name} ...");
        let began = Instant::now();
        let passed = step();
        let seconds = began.elapsed().as_secs_f64();
        // Output of what a step starts goes past this process's buffer.
        let _ = io::stdout().flush();
        match passed {
            Ok(true) => println!("ci: {name} passed in {seconds:.1} s"),
            Ok(false) => {
                eprintln!("ci: {name} FAILED after {seconds:.1} s");
                return ExitCode::FAILURE;
            }
            Err(error) => {
                eprintln!("ci: {name} FAILED after {seconds:.1} s: {error}");
                return ExitCode::FAILURE;
            }
        }
    }
    println!("ci: all passed in {:.1} s", start.elapsed().as_secs_f64());
    ExitCode::SUCCESS
}

/// Runs cargo in the workspace's root; whether it ended well.
fn cargo(arguments: &[&str], variables: &[(&str, &str)]) -> io::Result<bool> {
    let program = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    start(&program, arguments, variables)
}

/// Packages that only encoders need, threads among them, and those that need a C compiler.
const NOT_FOR_DECODING: [&str; 7] =
    ["delaunator", "ndarray", "rayon", "texfold-codebook", "texfold-match", "texpresso", "zstd-sys"];

/// The facade without encoders: it compiles without warnings, and depends on nothing that only encoders need.
fn decode_only() -> io::Result<bool> {
    let clean = cargo(&["clippy", "-p", "texfold", "--no-default-features", "--", "-D", "warnings"], &[])?;
    let program = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let tree = ["tree", "-p", "texfold", "--no-default-features", "-e", "normal", "--prefix", "none"];
    let output = Command::new(&program).args(tree).current_dir(root()).output()?;
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

/// Runs this program again: the same commands, as a user gives them.
fn this(arguments: &[&str]) -> io::Result<bool> {
    start(env::current_exe()?.as_os_str(), arguments, &[])
}

fn start(program: &OsStr, arguments: &[impl AsRef<OsStr>], variables: &[(&str, &str)]) -> io::Result<bool> {
    let mut command = Command::new(program);
    command.args(arguments).envs(variables.iter().copied()).current_dir(root());
    Ok(command.status()?.success())
}

fn compress_and_decompress() -> io::Result<bool> {
    let trial = root().join(TRIAL);
    if trial.exists() {
        std::fs::remove_dir_all(&trial)?;
    }
    let report = format!("{TRIAL}/report.json");
    let compressed = this(&["compress", "fixtures/images/*.png", "--out", TRIAL, "--report", &report])?;
    let set = this(&["compress", "fixtures/images/ripple", "--out", TRIAL])?;
    let files = format!("{TRIAL}/*.txf");
    let on_cpu = format!("{TRIAL}/cpu");
    let on_gpu = format!("{TRIAL}/gpu");
    let decoded = this(&["decompress", &files, "--out", &on_cpu])?
        && this(&["decompress", &files, "--out", &on_gpu, "--gpu"])?;
    Ok(compressed && set && decoded && alike(&root().join(on_cpu), &root().join(on_gpu))?)
}

/// A capture to a light field, and what its cameras see of that on both sides.
fn compress_and_render() -> io::Result<bool> {
    let out = format!("{TRIAL}/light");
    let cameras = "fixtures/captures/ball/transforms.json";
    let file = format!("{out}/ball.txf");
    let (on_cpu, on_gpu) = (format!("{out}/cpu"), format!("{out}/gpu"));
    let drawn = this(&["compress", "fixtures/captures/ball", "--out", &out])?
        && this(&["render", &file, "--camera", cameras, "--out", &on_cpu, "--cpu"])?
        && this(&["render", &file, "--camera", cameras, "--out", &on_gpu])?
        && this(&["info", &file])?;
    Ok(drawn && [&on_cpu, &on_gpu].iter().all(|dir| root().join(dir).join("019.png").is_file()))
}

/// What hardware decoders of BC1 to BC5 may round differently (Direct3D 11.3 specification, 19.5), in 8-bit steps.
const ROUNDING: u8 = 2;

/// Whether every image of `reference` is in `other`, each value within the rounding of block decoders.
fn alike(reference: &Path, other: &Path) -> io::Result<bool> {
    let mut alike = true;
    for entry in std::fs::read_dir(reference)? {
        let path = entry?.path();
        let open = |path: &Path| image::open(path).map(|image| image.to_rgba8()).map_err(io::Error::other);
        let (a, b) = (open(&path)?, open(&other.join(path.file_name().unwrap_or_default()))?);
        let near = a.dimensions() == b.dimensions()
            && a.iter().zip(b.iter()).all(|(a, b)| a.abs_diff(*b) <= ROUNDING);
        if !near {
            eprintln!("error: {} differs between CPU and GPU by more than 2 of 255", path.display());
            alike = false;
        }
    }
    Ok(alike)
}

fn compare() -> io::Result<bool> {
    let out = format!("{TRIAL}/compare");
    let done = this(&[
        "compare",
        "fixtures/images/facade.png",
        "fixtures/images/gray.png",
        "--out",
        &out,
        "--effort",
        "fast",
    ])?;
    let written =
        ["results.csv", "results.json", "report.html"].map(|name| root().join(&out).join(name).is_file());
    Ok(done && written == [true; 3])
}

/// The quick form: bounds of all regimes, and charts of few values.
fn stability() -> io::Result<bool> {
    let out = format!("{TRIAL}/stability");
    start(env::current_exe()?.as_os_str(), &["stability", "--out", &out], &[("TEXFOLD_GPU", "require")])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_decoding_must_not_need_is_found_in_a_tree() {
        let tree = "texfold v0.1.0 (/x)\ntexfold-core v0.1.0 (/y)\nrayon v1.11.0\nrayon v1.11.0 (*)\nrayon-core v1.13.0\n";
        assert_eq!(needless(tree).collect::<Vec<_>>(), ["rayon"]);
        assert_eq!(needless("texfold v0.1.0\nglam v0.34.2\n").count(), 0);
    }
}
