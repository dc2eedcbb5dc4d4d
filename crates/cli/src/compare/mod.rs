//! `compare`: every codec that fits at several settings, beside plain block compression and other peers; light fields beside photographs and
//! harmonics; zoom stacks beside the plain texture that they stand for.
//!
//! One row for each input and setting; charts over the means of all inputs, with the front of settings that no other
//! beats in both figures; bits at equal quality; images of what each setting does to the middle of each input.

mod batch;
mod candidate;
mod chart;
mod choices;
mod curve;
mod equal;
mod images;
mod jpeg;
mod kept;
mod light;
mod measure;
mod page;
mod rival;
mod storage;
mod suite;
mod table;
mod zoom;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::config::{AlphaChoice, ColorName, EffortName, Options};
use crate::console::{say, warn};
use crate::error::{CliError, explain, guarded};
use crate::input::{Found, find, material::read_maps, read_set};
use crate::memory::{self, MemoryArgs};
use crate::output::{make_folder, remove_stale, write_whole};
use crate::png;
use crate::progress::Progress;
use crate::settings::Kind;
use candidate::candidates;
use images::Pictures;
use kept::Kept;
use measure::{Bench, Measured, Searches};
use page::Subject;
use suite::Suite;
use table::Row;
use texfold_core::image::{ImageSet, PixelInfo};
use zoom::Zoom;

pub use light::draw_photographs;
pub use measure::cpu_seconds;

/// Inputs that the report shows images of; further ones are in the table alone.
const THUMBNAIL_INPUTS: usize = 24;

/// Folder of the charts.
const CHARTS: &str = "charts";

/// Folder of the files that codec-compare.json lists.
const BATCHES: &str = "codec-compare";

/// Bytes of a texel that the codec which needs most takes, with what is measured.
const BYTES_PER_TEXEL: u64 = 160;

/// Arguments of `compare`.
#[derive(Debug, clap::Args)]
pub struct CompareArgs {
    /// Files, folders or globs, as for compress.
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// Folder that results.csv, results.json, codec-compare.json, report.html, its charts as SVG, images.html, the images to zoom into, and
    /// sheet.png, parts of the first inputs and settings side by side, are written to. What is measured stays in it: the same command goes on where it has stopped.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// What an input is; by default a file is an image, and a folder a capture or a zoom stack where it is one, else a set.
    #[arg(long = "as", value_enum)]
    kind: Option<Kind>,
    /// Which codecs and settings are compared: all, those that suit each codec; rates, the same bits for all; limits, the fewest bits, beside
    /// formats for storage; peers, formats that engines ship; speed, what encoding time buys; readme, a few; sheet, one setting to
    /// look at; choices, what auto returns beside each codec alone; materials, with --as material; or a file NAME.toml.
    #[arg(long, value_name = "NAME", default_value = "all")]
    suite: String,
    /// Measure no further setting after so many minutes.
    #[arg(long, value_name = "MINUTES", value_parser = minutes)]
    budget: Option<f64>,
    /// How long each codec searches, where the suite has no efforts.
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

fn minutes(text: &str) -> Result<f64, String> {
    let found = text.parse().ok().filter(|minutes: &f64| (0.0..1e6).contains(minutes));
    found.ok_or_else(|| "give a number of minutes".to_owned())
}

/// What a run has and goes through.
struct Run<'a> {
    args: &'a CompareArgs,
    suite: &'a Suite,
    bench: &'a Bench,
    progress: &'a Progress,
    kept: Kept,
    deadline: Option<Instant>,
    /// Settings that the time did not suffice for.
    left_out: usize,
}

/// Runs the command; gives the number of inputs that failed.
pub(crate) fn run(args: &CompareArgs) -> Result<usize, CliError> {
    let suite = suite::find(&args.suite)?;
    make_folder(&args.out)?;
    remove_stale(&args.out);
    let bench = Bench::open(&suite, args.storage || !suite.storage.is_empty());
    let inputs = find(&args.inputs, |_| args.kind);
    inputs.say_not_read();
    let inputs = inputs.found;
    let progress = Progress::new(inputs.len());
    let (mut rows, mut subjects, mut pictures, mut failed) = (Vec::new(), Vec::new(), Pictures::default(), 0);
    let mut run = Run {
        args,
        suite: &suite,
        bench: &bench,
        progress: &progress,
        kept: Kept::open(&args.out)?,
        deadline: args.budget.map(|minutes| Instant::now() + Duration::from_secs_f64(60.0 * minutes)),
        left_out: 0,
    };
    for input in inputs {
        let share = progress.share(String::new());
        let outcome = input.map_err(|unusable| *unusable.error).and_then(|found| {
            let path = found.path.clone();
            let pictures = (subjects.len() < THUMBNAIL_INPUTS).then_some(&mut pictures);
            guarded(&path, || run.compare(&found, pictures))
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
    run.write(&rows, &subjects)?;
    pictures.write(&args.out.join("images.html"))?;
    if run.left_out > 0 {
        warn(&format!(
            "{} settings are not measured, as the time did not suffice; the same command goes on with them",
            run.left_out
        ));
    } else {
        run.kept.prune();
    }
    say(&format!("{} rows in {}", rows.len(), args.out.join("report.html").display()));
    Ok(failed)
}

impl Run<'_> {
    /// All settings on one input.
    fn compare(
        &mut self,
        found: &Found,
        pictures: Option<&mut Pictures>,
    ) -> Result<(Vec<Row>, Subject), CliError> {
        if found.kind == Kind::Lightfield {
            return self.compare_light(found, pictures.is_some());
        }
        self.compare_images(found, pictures)
    }

    /// All ways to show a capture.
    fn compare_light(&mut self, found: &Found, with_images: bool) -> Result<(Vec<Row>, Subject), CliError> {
        let scene = light::Scene::read(found, self.args.memory.bytes())?;
        let (input, wanted) = (found.path.display().to_string(), scene.wanted()?);
        let mut subject = Subject::new(&input, with_images.then_some(&wanted));
        let mut rows = Vec::new();
        for candidate in light::candidates() {
            let with_image = with_images && candidate.has_thumbnail;
            let name = self.kept.name(&scene.hash, &candidate);
            let of = (name.as_str(), wanted.info(), with_image);
            let measured = self.measured(of, || scene.measure(&candidate, &found.path));
            let made = self.said(&input, measured, &candidate.settings);
            let Some(Measured { row, decoded, .. }) = made else { continue };
            if let (Some(decoded), true) = (&decoded, with_image) {
                subject.add(&row, decoded, None);
            }
            rows.push(row);
        }
        Ok((rows, subject))
    }

    /// All settings on images, and on the plain texture that a zoom stack stands for.
    fn compare_images(
        &mut self,
        found: &Found,
        mut pictures: Option<&mut Pictures>,
    ) -> Result<(Vec<Row>, Subject), CliError> {
        let bench = self.bench;
        let (images, zoom) = match found.kind {
            Kind::Zoom => self.read_zoom(found).map(|zoom| (zoom.plain.clone(), Some(zoom)))?,
            _ => (self.read(found)?, None),
        };
        let input = found.path.display().to_string();
        let original = pictures.is_some().then(|| &images.images()[0]);
        let mut subject = Subject::new(&input, original);
        if let Some(pictures) = &mut pictures {
            pictures.add_original(&input, &images.images()[0])?;
        }
        let (mut rows, hash, info) = (Vec::new(), kept::hash(&images), images.images()[0].info());
        let with_images = pictures.is_some();
        let mut take = |measured: Measured, with_image: bool| -> Result<(), CliError> {
            let Measured { row, decoded, file } = measured;
            if let (Some(pictures), Some(decoded), true) = (&mut pictures, &decoded, with_image) {
                let place = pictures.add(&row, decoded, file)?;
                subject.add(&row, decoded, place);
            }
            rows.push(row);
            Ok(())
        };
        let mut searches = Searches::new(&images);
        for candidate in
            candidates(self.suite, images.info(), self.args.effort, bench.rival(), bench.storage())
        {
            let with_image = with_images && candidate.has_thumbnail;
            let name = self.kept.name(&hash, &candidate);
            let measure = || bench.measure(&mut searches, &candidate, &found.path);
            let measured = self.measured((&name, info, with_image), measure);
            let what = format!("{} {}", candidate.codec, candidate.settings);
            self.said(&input, measured, &what).map_or(Ok(()), |made| take(made, with_image))?;
        }
        let of_zoom = zoom.iter().flat_map(|zoom| zoom.candidates().map(move |candidate| (zoom, candidate)));
        for (zoom, candidate) in of_zoom {
            let with_image = with_images && candidate.has_thumbnail;
            let name = self.kept.name(&hash, &candidate);
            let measure = || zoom.measure(&candidate, &found.path);
            let measured = self.measured((&name, info, with_image), measure);
            self.said(&input, measured, &candidate.settings).map_or(Ok(()), |made| take(made, with_image))?;
        }
        Ok((rows, subject))
    }

    /// A zoom stack; says what is left out of it.
    fn read_zoom(&self, found: &Found) -> Result<Zoom, CliError> {
        let options = Options::of_pixels(self.args.color, self.args.alpha);
        let (zoom, warnings) = Zoom::read(found, &options, self.args.memory.bytes())?;
        for warning in warnings {
            self.progress.mention(&format!("warning: {}: {warning}", found.path.display()));
        }
        Ok(zoom)
    }

    /// A setting as it was kept, or measured now; `None` where there is no time left.
    fn measured(
        &mut self,
        (name, info, with_image): (&str, PixelInfo, bool),
        measure: impl FnOnce() -> Result<Measured, CliError>,
    ) -> Result<Option<Measured>, CliError> {
        if let Some(measured) = self.kept.find(name, info, with_image) {
            return Ok(Some(measured));
        }
        if self.deadline.is_some_and(|deadline| Instant::now() >= deadline) {
            self.left_out += 1;
            return Ok(None);
        }
        let measured = measure()?;
        self.kept.keep(name, &measured, with_image)?;
        Ok(Some(measured))
    }

    /// Says what a setting of an input came to; or why it is left out, as a codebook that is larger than its image.
    fn said(
        &self,
        input: &str,
        measured: Result<Option<Measured>, CliError>,
        what: &str,
    ) -> Option<Measured> {
        match measured {
            Ok(made) => made.map(|made| {
                let row = Row { input: input.to_owned(), ..made.row };
                self.progress.say(&row.line());
                Measured { row, ..made }
            }),
            Err(error) => {
                self.progress.mention(&format!("left out: {what}: {}", explain(&error)));
                None
            }
        }
    }

    /// The images of an input; says what is noteworthy of them.
    fn read(&self, found: &Found) -> Result<ImageSet, CliError> {
        let Run { args, progress, .. } = *self;
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
        if found.kind == Kind::Set && images.images().len() > 1 && !self.bench.storage().is_empty() {
            progress.say(&format!(
                "note: {}: codecs share the bits of a set out among its images, formats for storage take those asked for of each; give \
                 the images one by one to compare them so",
                found.path.display()
            ));
        }
        for warning in remarks.warnings(files) {
            progress.mention(&format!("warning: {}: {warning}", found.path.display()));
        }
        Ok(images)
    }

    fn write(&self, rows: &[Row], subjects: &[Subject]) -> Result<(), CliError> {
        let out = &self.args.out;
        write_json(out.join("results.json"), &rows)?;
        write_whole(&out.join("results.csv"), table::csv(rows).as_bytes())?;
        let batches = out.join(BATCHES);
        make_folder(&batches)?;
        let mut list = Vec::new();
        for (number, line) in chart::lines(rows).iter().enumerate() {
            let name = format!("{number:02}.json");
            write_json(batches.join(&name), &batch::batch(line))?;
            list.push([format!("{BATCHES}/{name}")]);
        }
        write_json(out.join("codec-compare.json"), &list)?;
        // Charts and a sheet of another suite are removed where this one has none of their name.
        let charts = out.join(CHARTS);
        make_folder(&charts)?;
        remove_all(&charts, "svg");
        for (name, svg) in chart::files(rows, self.suite.equal_bpp()) {
            write_whole(&charts.join(name), svg.as_bytes())?;
        }
        let sheet = out.join("sheet.png");
        match page::sheet(subjects) {
            Some(parts) => png::write(&sheet, &parts)?,
            None => drop(fs::remove_file(&sheet)),
        }
        let report = out.join("report.html");
        let draw = |source| CliError::Draw { path: report.clone(), source };
        let html = page::html(self.suite, rows, subjects, self.bench, self.left_out).map_err(draw)?;
        write_whole(&report, html.as_bytes())
    }
}

/// Removes the files of a folder with that extension; what cannot be removed stays.
fn remove_all(folder: &Path, extension: &str) {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    for path in
        entries.map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|of| of == extension))
    {
        let _ = fs::remove_file(path);
    }
}

fn write_json(path: PathBuf, value: &impl serde::Serialize) -> Result<(), CliError> {
    let fault = |source: serde_json::Error| CliError::Write { path: path.clone(), source: source.into() };
    write_whole(&path, &serde_json::to_vec_pretty(value).map_err(fault)?)
}
