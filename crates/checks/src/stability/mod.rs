//! `stability`: what the methods do where they fail.
//!
//! Every regime of inputs that a method does not suit, for every codec and its shader, held to bounds: correct within them, or
//! a typed error; never a panic, a hang, a value that is no number, or more bytes than the plain form and its header. Beside it charts of where each
//! method stops working. `--full` takes more values of each chart and more forged files.

mod atlas;
mod files;
mod guard;
mod images;
mod light;
mod page;
mod record;
mod zoom;

use std::error::Error;
use std::fs;
use std::path::PathBuf;
use std::process::ExitCode;

use rayon::{ThreadPool, ThreadPoolBuilder};
use serde_json::json;
use texfold::EncodeError;
use texfold_gpu::{Gpu, Policy};

use atlas::Failure;
use record::{Check, Curve, Row};

/// What may go wrong before anything is measured.
pub(crate) type Outcome<T> = Result<T, Box<dyn Error>>;

/// Arguments of `stability`.
#[derive(Debug, clap::Args)]
pub(crate) struct StabilityArgs {
    /// Folder that report.html and results.json are written to.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// More values of each chart, and more forged files.
    #[arg(long)]
    full: bool,
    /// Bounds alone: no charts, one thread, without a GPU.
    #[arg(long, conflicts_with = "full")]
    bounds: bool,
}

/// How much is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Extent {
    Bounds,
    Quick,
    Full,
}

/// What measuring needs.
struct Tools {
    gpu: Option<Gpu>,
    /// Why there is none.
    no_gpu: Option<String>,
    single: ThreadPool,
    /// Two threads, to compare the files of one with; `None` for bounds alone.
    double: Option<ThreadPool>,
    /// The unit of times, in CPU seconds; 0 where the system does not report them.
    unit: f64,
}

impl Tools {
    /// For bounds alone without GPU and without a second pool: the tests of the codecs and of their shaders cover both on other images.
    fn open(extent: Extent) -> Outcome<Tools> {
        let pool = |threads| ThreadPoolBuilder::new().num_threads(threads).build();
        let (single, unit) = (pool(1)?, images::unit());
        if extent == Extent::Bounds {
            let no_gpu = Some("bounds alone are checked on the CPU".to_owned());
            return Ok(Tools { gpu: None, no_gpu, single, double: None, unit });
        }
        let policy = Policy::from_env();
        let (gpu, no_gpu) = match Gpu::new(policy) {
            Ok(gpu) => (Some(gpu), None),
            Err(error) if policy == Policy::Require => return Err(error.into()),
            Err(error) => (None, Some(error.to_string())),
        };
        Ok(Tools { gpu, no_gpu, single, double: Some(pool(2)?), unit })
    }

    /// Whether `encode` gives the same file on two threads; `None` where this is not checked.
    fn is_independent_of_threads<T>(
        &self,
        bytes: &[u8],
        encode: impl FnOnce(&ThreadPool) -> Result<T, EncodeError>,
        file: impl FnOnce(&T) -> Vec<u8>,
    ) -> Option<Check> {
        let same = encode(self.double.as_ref()?).is_ok_and(|other| file(&other) == bytes);
        Some(Check::most("files that differ with the number of threads", f64::from(u8::from(!same)), 0.0))
    }
}

/// Runs the command; 1 where a bound is broken.
pub(crate) fn run(args: &StabilityArgs) -> ExitCode {
    match measured(args) {
        Ok(0) => ExitCode::SUCCESS,
        Ok(broken) => {
            eprintln!(
                "error: {broken} results break a bound; see {}",
                args.out.join("report.html").display()
            );
            ExitCode::FAILURE
        }
        Err(error) => {
            eprintln!("error: stability cannot be measured: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Number of results that break a bound.
fn measured(args: &StabilityArgs) -> Outcome<usize> {
    let extent = match (args.full, args.bounds) {
        (true, _) => Extent::Full,
        (_, true) => Extent::Bounds,
        _ => Extent::Quick,
    };
    fs::create_dir_all(&args.out)?;
    let tools = Tools::open(extent)?;
    let mut rows: Vec<Row> = Vec::new();
    // What is expected to panic says so in the report, not on stderr.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let done = all_rows(&tools, extent, &mut |row| {
        if !row.holds() {
            eprintln!("broken: {} / {}", row.regime, row.codec);
        }
        rows.push(row);
    });
    std::panic::set_hook(hook);
    done?;
    let curves = if extent == Extent::Bounds { Vec::new() } else { all_curves(extent)? };
    let failures = if extent == Extent::Bounds { Vec::new() } else { all_failures(&curves)? };
    write(args, &tools, &rows, (&curves, &failures))?;
    let broken = rows.iter().filter(|row| !row.holds()).count();
    println!(
        "{} results, {broken} break a bound; {} charts in {}",
        rows.len(),
        curves.len(),
        args.out.join("report.html").display()
    );
    Ok(broken)
}

fn all_rows(tools: &Tools, extent: Extent, say: &mut dyn FnMut(Row)) -> Outcome<()> {
    images::rows(tools, extent, say)?;
    light::rows(tools, say)?;
    zoom::rows(tools, say)?;
    files::rows(extent, say)
}

fn all_curves(extent: Extent) -> Outcome<Vec<Curve>> {
    let mut curves = images::curves(extent)?;
    curves.extend(light::curves(extent)?);
    curves.extend(zoom::curves(extent)?);
    Ok(curves)
}

/// Where each method stops working.
fn all_failures(curves: &[Curve]) -> Outcome<Vec<Failure>> {
    let mut failures = images::failures(curves)?;
    failures.push(light::failure(curves)?);
    failures.push(zoom::failure(curves)?);
    Ok(failures)
}

fn write(
    args: &StabilityArgs,
    tools: &Tools,
    rows: &[Row],
    (curves, failures): (&[Curve], &[Failure]),
) -> Outcome<()> {
    let results = json!({
        "adapter": tools.gpu.as_ref().map(|gpu| gpu.info().name),
        "rows": rows.iter().map(Row::json).collect::<Vec<_>>(),
        "curves": curves.iter().map(Curve::json).collect::<Vec<_>>(),
        "failures": failures.iter().map(|failure| json!({
            "method": failure.method, "sentence": failure.sentence,
        })).collect::<Vec<_>>(),
    });
    fs::write(args.out.join("results.json"), serde_json::to_vec_pretty(&results)?)?;
    let about: Vec<_> = [images::about(), light::about(), zoom::about(), files::about()].concat();
    fs::write(args.out.join("report.html"), page::html(tools, rows, (curves, failures), &about))?;
    Ok(())
}
