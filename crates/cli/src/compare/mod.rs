//! `compare`: every codec that fits at several settings, beside plain block compression.
//!
//! One row for each input and setting; charts over the means of all inputs, with the front of settings that no other
//! beats in both figures; images of what each setting does to the middle of each input.

mod candidate;
mod chart;
mod images;
mod measure;
mod page;
mod rival;
mod storage;
mod table;

use std::path::PathBuf;

use crate::config::{AlphaChoice, ColorName, EffortName, Options};
use crate::console::say;
use crate::error::{CliError, explain, guarded};
use crate::input::{Found, find, material::read_maps, read_set};
use crate::memory::{self, MemoryArgs};
use crate::output::{make_folder, remove_stale, write_whole};
use crate::progress::Progress;
use crate::settings::Kind;
use candidate::{Candidate, Suite, candidates};
use images::Pictures;
use measure::{Bench, Measured, Searches};
use page::Subject;
use table::Row;

pub use rival::astc_by_astcenc;

/// Inputs that the report shows images of; further ones are in the table alone.
const THUMBNAIL_INPUTS: usize = 24;

/// Bytes of a texel that the codec which needs most takes, with what is measured.
const BYTES_PER_TEXEL: u64 = 160;

/// Arguments of `compare`.
#[derive(Debug, clap::Args)]
pub struct CompareArgs {
    /// Files, folders or globs, as for compress.
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// Folder that results.csv, results.json, report.html and images.html, the images to zoom into, are written to.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// What an input is; by default a file is an image and a folder is a set.
    #[arg(long = "as", value_enum)]
    kind: Option<Kind>,
    /// Which codecs and settings are compared.
    #[arg(long, value_enum, default_value_t)]
    suite: Suite,
    /// How long each codec searches.
    #[arg(long, value_enum, default_value_t = EffortName::Fast)]
    effort: EffortName,
    /// Meaning of the images' values; by default the one that the ends of file names say, else srgb.
    #[arg(long, value_enum)]
    color: Option<ColorName>,
    /// Meaning of the channel beside gray or RGB: straight, cutout, cutout=THRESHOLD, band.
    #[arg(long, value_name = "ALPHA")]
    alpha: Option<AlphaChoice>,
    /// Also compare with AVIF, JPEG XL, JPEG 2000 and WebP, where their programs are installed (avifenc, cjxl, opj_compress, cwebp and their
    /// decoders): of such files no part can be read alone.
    #[arg(long)]
    storage: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// Runs the command; gives the number of inputs that failed.
pub(crate) fn run(args: &CompareArgs) -> Result<usize, CliError> {
    make_folder(&args.out)?;
    remove_stale(&args.out);
    let bench = Bench::open(args.effort, args.storage || args.suite == Suite::Limits);
    let inputs = find(&args.inputs, |_| args.kind);
    inputs.say_not_read();
    let inputs = inputs.found;
    let progress = Progress::new(inputs.len());
    let (mut rows, mut subjects, mut pictures, mut failed) = (Vec::new(), Vec::new(), Pictures::default(), 0);
    for input in inputs {
        let share = progress.share(String::new());
        let outcome = input.map_err(|unusable| *unusable.error).and_then(|found| {
            let path = found.path.clone();
            let pictures = (subjects.len() < THUMBNAIL_INPUTS).then_some(&mut pictures);
            guarded(&path, || compare(&found, args, &bench, &progress, pictures))
        });
        drop(share);
        match outcome {
            Ok((of_input, subject)) => {
                rows.extend(of_input);
                subjects.push(subject);
            }
            Err(error) => {
                progress.complain(&explain(&error));
                failed += 1;
            }
        }
    }
    progress.finish();
    write(args, &rows, &subjects, &bench)?;
    pictures.write(&args.out.join("images.html"))?;
    say(&format!("{} rows in {}", rows.len(), args.out.join("report.html").display()));
    Ok(failed)
}

/// All settings on one input.
fn compare(
    found: &Found,
    args: &CompareArgs,
    bench: &Bench,
    progress: &Progress,
    mut pictures: Option<&mut Pictures>,
) -> Result<(Vec<Row>, Subject), CliError> {
    let options = Options::of_pixels(args.color, args.alpha);
    let settings = match found.kind {
        Kind::Material => options.resolve_material(&found.path),
        _ => options.resolve_files(&found.path, &found.files),
    }?;
    let mut remarks = settings.remarks.clone();
    let limit = args.memory.bytes();
    let images = match found.kind {
        Kind::Material => read_maps(&found.files, &settings, limit, &mut remarks),
        _ => read_set(&found.files, found.takes_all_frames(), &settings, limit, &mut remarks),
    }?;
    let texels: u64 = images.images().iter().map(|image| image.size().texels()).sum();
    memory::check(&found.path, texels.saturating_mul(BYTES_PER_TEXEL), limit)?;
    let files = found.files.len();
    for note in remarks.notes(files) {
        progress.say(&format!("note: {}: {note}", found.path.display()));
    }
    for warning in remarks.warnings(files) {
        progress.mention(&format!("warning: {}: {warning}", found.path.display()));
    }
    let input = found.path.display().to_string();
    let original = pictures.is_some().then(|| &images.images()[0]);
    let mut subject = Subject::new(&input, original);
    if let Some(pictures) = &mut pictures {
        pictures.add_original(&input, &images.images()[0])?;
    }
    let mut rows = Vec::new();
    let mut searches = Searches::new(&images);
    let effort = bench.effort().effort();
    for candidate in candidates(args.suite, images.info(), effort, bench.rival(), bench.storage()) {
        // A setting that does not suit an input, such as a codebook larger than its image, is left out.
        let measured = match bench.measure(&mut searches, &candidate, &found.path) {
            Ok(Measured { row, decoded, file }) => {
                let row = Row { input: input.clone(), ..row };
                let place = match &mut pictures {
                    Some(pictures) if candidate.has_thumbnail => pictures.add(&row, &decoded, file)?,
                    _ => None,
                };
                subject.add(&candidate, &row, &decoded, place);
                row
            }
            Err(error) => {
                let Candidate { codec, settings, .. } = &candidate;
                progress.mention(&format!("left out: {codec} {settings}: {}", explain(&error)));
                continue;
            }
        };
        progress.say(&measured.line());
        rows.push(measured);
    }
    Ok((rows, subject))
}

fn write(args: &CompareArgs, rows: &[Row], subjects: &[Subject], bench: &Bench) -> Result<(), CliError> {
    let json = args.out.join("results.json");
    let fault = |source: serde_json::Error| CliError::Write { path: json.clone(), source: source.into() };
    write_whole(&json, &serde_json::to_vec_pretty(rows).map_err(fault)?)?;
    write_whole(&args.out.join("results.csv"), table::csv(rows).as_bytes())?;
    let report = args.out.join("report.html");
    let draw = |source| CliError::Draw { path: report.clone(), source };
    let html = page::html(rows, subjects, bench).map_err(draw)?;
    write_whole(&report, html.as_bytes())
}
