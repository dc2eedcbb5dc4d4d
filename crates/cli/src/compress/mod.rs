//! `compress`: images into `.txf` files.
//!
//! Inputs are found and given their settings and output names first; then each is checked against the index of the
//! output folder, read, encoded, measured from its own bytes, and written, several at a time within a memory limit.

mod bank;
mod cache;
mod encode;
mod folder;
mod grow;
pub(crate) mod light;
mod schedule;
mod task;
mod zoom;

use std::collections::HashMap;
use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Instant;

use crate::bank::BankTask;
use crate::config::{Config, Options, RunOptions};
use crate::console::say;
use crate::error::{CliError, UsageError, explain, guarded};
use crate::input::{Found, find};
use crate::memory;
use crate::output::{make_folder, remove_stale, write_whole};
use crate::progress::{Progress, Remark};
use crate::report::{Entry, Row, Views};
use crate::settings::{Kind, LightSettings, ZoomSettings};

use cache::Cache;
pub(crate) use cache::add_file;
use folder::FolderTask;
use task::{Finished, Task, Workplace};

/// Arguments of `compress`.
#[derive(Debug, clap::Args)]
pub struct CompressArgs {
    /// Files, folders or globs: PNG, JPEG, TIFF, WebP, GIF, BMP, TGA, QOI, PNM, OpenEXR, Radiance HDR, DDS or KTX2.
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// Folder that the .txf files are written to.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Add the inputs' images, in their order, behind those of this file, of a codec that can grow (vq): those that are there keep every
    /// texel. The result has the file's name in the output folder.
    #[arg(long, value_name = "FILE.txf")]
    add_to: Option<PathBuf>,
    /// A TOML file with the same options, also per glob: [[rule]] with glob = "*.png".
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    #[command(flatten)]
    run: RunOptions,
    #[command(flatten)]
    options: Options,
}

/// An input in its place in the report: something to do, or why nothing can be done.
enum Planned {
    Task(Work),
    Failed(PathBuf, CliError),
    NotRead(Vec<PathBuf>),
}

impl Planned {
    fn not_read(paths: Vec<PathBuf>) -> Option<Planned> {
        (!paths.is_empty()).then_some(Planned::NotRead(paths))
    }
}

/// Something to do.
enum Work {
    Images(Box<Task>),
    Light(Box<FolderTask<LightSettings>>),
    /// An image for the bank that the output folder is.
    Bank(Box<Found>, Box<BankTask>),
    Zoom(Box<FolderTask<ZoomSettings>>),
}

impl Work {
    fn found(&self) -> &Found {
        match self {
            Work::Images(task) => &task.found,
            Work::Light(task) => &task.found,
            Work::Bank(found, _) => found,
            Work::Zoom(task) => &task.found,
        }
    }

    fn for_bank(&self) -> Option<&BankTask> {
        match self {
            Work::Bank(_, task) => Some(task),
            _ => None,
        }
    }

    fn cost_bytes(&self) -> u64 {
        match self {
            Work::Images(task) => task.cost_bytes(),
            Work::Light(task) => task.cost_bytes(),
            Work::Bank(_, task) => task.cost_bytes(),
            Work::Zoom(task) => task.cost_bytes(),
        }
    }

    fn run(&self, place: &Workplace<'_>) -> Result<Finished, CliError> {
        match self {
            Work::Images(task) => task.run(place),
            Work::Light(task) => task.run(place),
            // Those are added together: see `bank`.
            Work::Bank(found, _) => {
                let message = "it was not added with the others".to_owned();
                Err(CliError::Internal { path: found.path.clone(), message })
            }
            Work::Zoom(task) => task.run(place),
        }
    }
}

/// Runs the command; gives the number of inputs that failed, and with `--strict` that of warnings.
pub(crate) fn run(args: CompressArgs) -> Result<usize, CliError> {
    if let Some(file) = &args.add_to {
        return guarded(file, || grow::grow(&args, file)).map(|()| 0);
    }
    let planned = |args: &CompressArgs, of_path: &dyn Fn(&std::path::Path) -> Options| {
        args.options.check()?;
        plan(&args.inputs, &args.out, of_path)
    };
    run_planned(args, planned)
}

/// Runs `bank add`: all images into the bank that the output folder is.
pub(crate) fn add(args: CompressArgs) -> Result<usize, CliError> {
    let planned = |args: &CompressArgs, of_path: &dyn Fn(&std::path::Path) -> Options| {
        args.options.of_bank()?.check()?;
        if args.add_to.is_some() {
            return Err(UsageError::Excluded { option: "add-to", other: "bank add" }.into());
        }
        plan_bank(&args.inputs, of_path)
    };
    run_planned(args, planned)
}

fn run_planned(
    args: CompressArgs,
    planned: impl Fn(&CompressArgs, &dyn Fn(&std::path::Path) -> Options) -> Result<Vec<Planned>, CliError>,
) -> Result<usize, CliError> {
    let start = Instant::now();
    let config = args.config.as_deref().map(Config::read).transpose()?.unwrap_or_default();
    let run = args.run.clone().or(config.run.clone());
    run.check()?;
    let planned = planned(&args, &|path| args.options.or(&config.options(path)))?;
    make_folder(&args.out)?;
    remove_stale(&args.out);
    let cache = Cache::open(&args.out);
    let entries = work(&planned, &run, &cache, &args.out)?;
    cache.close();
    if let Some(report) = &run.report {
        write_report(report, &entries)?;
    }
    say(&summary(&entries, start.elapsed().as_secs_f64()));
    let failed = failed_of(&entries);
    Ok(if run.strict == Some(true) { failed + warnings_of(&entries) } else { failed })
}

/// Number of inputs that failed.
fn failed_of(entries: &[(Entry, bool)]) -> usize {
    entries.iter().filter(|(entry, _)| matches!(entry, Entry::Failed { .. })).count()
}

/// Number of all warnings.
fn warnings_of(entries: &[(Entry, bool)]) -> usize {
    let warnings = |(entry, _): &(Entry, bool)| match entry {
        Entry::Done(row) => row.warnings.len(),
        _ => 0,
    };
    entries.iter().map(warnings).sum()
}

/// Finds the inputs and gives each its settings and its output.
fn plan(
    inputs: &[PathBuf],
    out: &std::path::Path,
    of_path: &dyn Fn(&std::path::Path) -> Options,
) -> Result<Vec<Planned>, CliError> {
    let mut writers: HashMap<OsString, PathBuf> = HashMap::new();
    let mut planned = Vec::new();
    let inputs = find(inputs, |path| of_path(path).kind());
    inputs.say_not_read();
    for found in inputs.found {
        let found = match found {
            Ok(found) => found,
            Err(unusable) => {
                planned.push(Planned::Failed(unusable.path, *unusable.error));
                continue;
            }
        };
        let options = of_path(&found.path);
        options.check()?;
        if options.category().is_some() {
            return Err(UsageError::Category.into());
        }
        let path = found.path.clone();
        planned.push(match plan_one(found, &options, out, &mut writers) {
            Ok(task) => Planned::Task(task),
            Err(error) => Planned::Failed(path, error),
        });
    }
    planned.extend(Planned::not_read(inputs.not_read));
    Ok(planned)
}

/// Finds the images of a bank, each with its own settings.
fn plan_bank(
    inputs: &[PathBuf],
    of_path: &dyn Fn(&std::path::Path) -> Options,
) -> Result<Vec<Planned>, CliError> {
    let mut names: HashMap<OsString, PathBuf> = HashMap::new();
    let mut planned = Vec::new();
    let inputs = find(inputs, |path| of_path(path).kind());
    inputs.say_not_read();
    for found in inputs.found {
        let found = match found {
            Ok(found) if matches!(found.kind, Kind::Image | Kind::Set | Kind::Sequence) => found,
            Ok(found) => {
                let error = CliError::NotForBank { path: found.path.clone() };
                planned.push(Planned::Failed(found.path, error));
                continue;
            }
            Err(unusable) => {
                planned.push(Planned::Failed(unusable.path, *unusable.error));
                continue;
            }
        };
        for part in one_by_one(&found) {
            let options = of_path(&part.path).of_bank()?;
            options.check()?;
            let path = part.path.clone();
            let first = names.get(&part.stem).cloned();
            planned.push(match (first, options.resolve_files(&path, &part.files)) {
                (Some(first), _) => {
                    let output = PathBuf::from(&part.stem);
                    Planned::Failed(path.clone(), CliError::Collision { path, output, first })
                }
                (None, Err(error)) => Planned::Failed(path, error),
                (None, Ok(settings)) => {
                    names.insert(part.stem.clone(), path.clone());
                    let name = part.stem.to_string_lossy().into_owned();
                    let category = options.category().map(str::to_owned);
                    Planned::Task(Work::Bank(
                        Box::new(part),
                        Box::new(BankTask { path, name, category, settings }),
                    ))
                }
            });
        }
    }
    planned.extend(Planned::not_read(inputs.not_read));
    Ok(planned)
}

/// The images of a set, each as an input.
fn one_by_one(found: &Found) -> Vec<Found> {
    let part = |file: &PathBuf| Found {
        path: file.clone(),
        kind: Kind::Set,
        files: vec![file.clone()],
        stem: file.file_stem().unwrap_or_default().to_owned(),
    };
    found.files.iter().map(part).collect()
}

fn plan_one(
    found: Found,
    options: &Options,
    out: &std::path::Path,
    writers: &mut HashMap<OsString, PathBuf>,
) -> Result<Work, CliError> {
    let mut name = found.stem.clone();
    name.push(".txf");
    let output = out.join(&name);
    if let Some(first) = writers.get(&name) {
        return Err(CliError::Collision { path: found.path, output, first: first.clone() });
    }
    let work = if found.kind == Kind::Lightfield {
        let settings = options.resolve_light(&found.path)?;
        Work::Light(Box::new(FolderTask { found, settings, output }))
    } else if found.kind == Kind::Zoom {
        let settings = options.resolve_zoom(&found.path)?;
        Work::Zoom(Box::new(FolderTask { found, settings, output }))
    } else if found.kind == Kind::Material {
        let settings = options.resolve_material(&found.path)?;
        Work::Images(Box::new(Task { found, settings, output }))
    } else {
        let settings = options.resolve_files(&found.path, &found.files)?;
        Work::Images(Box::new(Task { found, settings, output }))
    };
    writers.insert(name, work.found().path.clone());
    Ok(work)
}

/// Carries the tasks out; the entries are in the order of the plan, each with whether it was up to date already.
fn work(
    planned: &[Planned],
    run: &RunOptions,
    cache: &Cache,
    out: &std::path::Path,
) -> Result<Vec<(Entry, bool)>, CliError> {
    let tasks: Vec<&Work> = planned
        .iter()
        .filter_map(|planned| match planned {
            Planned::Task(task) => Some(task),
            Planned::Failed(..) | Planned::NotRead(_) => None,
        })
        .collect();
    let progress = Progress::new(tasks.len());
    for planned in planned {
        if let Planned::Failed(_, error) = planned {
            progress.complain(&explain(error));
        }
    }
    let limit_bytes = memory::limit(run.memory);
    let force = run.force.unwrap_or(false);
    let outside = run.outside.unwrap_or(false);
    let place = Workplace { cache, limit_bytes, force, outside, progress: &progress };
    let jobs = run.jobs.map_or_else(schedule::cores, |jobs| jobs as usize);
    let cost = |task: &&Work| task.cost_bytes();
    let work = |task: &&Work| settle(task, task.run(&place), &progress);
    let (of_bank, alone): (Vec<&Work>, Vec<&Work>) = tasks.iter().partition(|task| task.for_bank().is_some());
    let mut done = schedule::run(&alone, jobs, limit_bytes, cost, work).into_iter();
    let mut added = bank::add_all(&of_bank, out, jobs, &place)?.into_iter();
    let finished = tasks.iter().map(|task| match task.for_bank() {
        Some(_) => added.next(),
        None => done.next().flatten(),
    });
    let mut finished = finished.collect::<Vec<_>>().into_iter();
    progress.finish();
    let in_place = |planned: &Planned| match planned {
        Planned::Failed(path, error) => (failed(path, error), false),
        Planned::NotRead(paths) => {
            let not_read = paths.iter().map(|path| path.display().to_string()).collect();
            (Entry::NotRead { not_read }, false)
        }
        // The scheduler gives one result a task, in order.
        Planned::Task(task) => finished.next().flatten().unwrap_or_else(|| {
            let message = "the work was not finished".to_owned();
            let path = &task.found().path;
            (failed(path, &CliError::Internal { path: path.clone(), message }), false)
        }),
    };
    Ok(planned.iter().map(in_place).collect())
}

/// Says how one task went.
fn settle(task: &Work, finished: Result<Finished, CliError>, progress: &Progress) -> (Entry, bool) {
    match finished {
        Ok(Finished { row, skipped }) => {
            progress.say(&line(task, &row, skipped));
            let stem = task.found().stem.to_string_lossy();
            for (kind, texts) in [(Remark::Note, &row.notes), (Remark::Warning, &row.warnings)] {
                texts.iter().for_each(|text| progress.remark(kind, &stem, text));
            }
            (Entry::Done(Box::new(row)), skipped)
        }
        Err(error) => {
            progress.complain(&explain(&error));
            (failed(&task.found().path, &error), false)
        }
    }
}

fn failed(path: &std::path::Path, error: &CliError) -> Entry {
    Entry::Failed { input: path.display().to_string(), error: explain(error) }
}

fn line(task: &Work, row: &Row, skipped: bool) -> String {
    let stem = task.found().stem.to_string_lossy();
    let angle = row.degrees.map_or(String::new(), |degrees| format!("  {degrees:.2} degrees"));
    let note = if skipped { "  (up to date)" } else { "" };
    let Row { codec, psnr, sizes, encode_seconds: seconds, .. } = row;
    let memory = format!("{:7.3} bpp memory  {:7.3} bpp disk", sizes.bpp_memory, sizes.bpp_disk);
    if let Some(Views { psnr: drawn, count, are_new }) = row.views {
        let which = if are_new { "new views" } else { "of its views" };
        let megabytes = sizes.bits_disk as f64 / 8e6;
        return format!(
            "{stem:24} {codec:4} {drawn:7.2} dB for {count} {which}, {psnr:.2} dB of its samples  {megabytes:7.3} MB  \
             {seconds:7.2} s{note}"
        );
    }
    match row.psnr_merged {
        Some(merged) => format!(
            "{stem:24} {codec:4} {merged:7.2} dB for merged images, {psnr:.2} dB against the photographs  {memory}  \
             {seconds:7.2} s{note}"
        ),
        None => format!("{stem:24} {codec:4} {psnr:7.2} dB  {memory}  {seconds:7.2} s{angle}{note}"),
    }
}

fn write_report(path: &std::path::Path, entries: &[(Entry, bool)]) -> Result<(), CliError> {
    let rows: Vec<&Entry> = entries.iter().map(|(entry, _)| entry).collect();
    let write = |source: serde_json::Error| CliError::Write { path: path.to_owned(), source: source.into() };
    let mut text = serde_json::to_vec_pretty(&rows).map_err(write)?;
    text.push(b'\n');
    if let Some(dir) = path.parent().filter(|dir| !dir.as_os_str().is_empty()) {
        make_folder(dir)?;
    }
    write_whole(path, &text)
}

fn summary(entries: &[(Entry, bool)], seconds: f64) -> String {
    let rows: Vec<&Row> = entries
        .iter()
        .filter_map(|(entry, _)| match entry {
            Entry::Done(row) => Some(row.as_ref()),
            _ => None,
        })
        .collect();
    let skipped = entries.iter().filter(|(_, skipped)| *skipped).count();
    let (written, failed) = (rows.len() - skipped, failed_of(entries));
    let warned = match warnings_of(entries) {
        0 => String::new(),
        1 => ", 1 warning".to_owned(),
        count => format!(", {count} warnings"),
    };
    let counts =
        format!("{written} written, {skipped} up to date, {failed} failed{warned} in {seconds:.1} s");
    // Figures of light fields and zoom stacks are of another kind.
    let is_image = |row: &&Row| row.views.is_none() && row.psnr_merged.is_none();
    let rows: Vec<&Row> = rows.into_iter().filter(is_image).collect();
    if rows.is_empty() {
        return counts;
    }
    let mean = |figure: fn(&Row) -> f64| rows.iter().map(|row| figure(row)).sum::<f64>() / rows.len() as f64;
    format!(
        "{counts}; mean {:.2} dB at {:.3} bpp memory, {:.3} bpp disk",
        mean(|row| row.psnr),
        mean(|row| row.sizes.bpp_memory),
        mean(|row| row.sizes.bpp_disk)
    )
}
