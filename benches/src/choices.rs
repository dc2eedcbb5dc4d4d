//! How well a choice among all codecs does: what it returns beside the best of all, and what it costs.
//!
//! `cargo run --release -p texfold-benches --bin choices -- [--check] [--out DIR] [--psnr DB | --bpp BITS] [--effort fast|normal|high] [--budget MINUTES] [IMAGE_OR_FOLDER …]`;
//! without images, the fixtures. Images are cut to their middle 512x512 texels. Every codec encodes every image by itself, and so
//! does the choice; `excess` is how many more bits than the best the choice takes, for goals of bits how many dB it stays below. With
//! `--check` the run fails where the choice is beyond 5 % (0.3 dB) on more than one image of twenty.

use std::path::{Path, PathBuf};

use texfold::core::image::{ImageSet, Raster};
use texfold::core::metric::measure;
use texfold::core::target::Measured;
use texfold::{
    Effort, EncodeSettings, Goal, Guidance, Job, encode_images, encoding::ENCODINGS, epitome::Epitome,
};
use texfold_benches::budget::Run;
use texfold_benches::report::{Outcome, Table, cpu_seconds, images_of, middle};

/// Longest side of an image.
const SIDE: u32 = 512;
/// Share of more bits, and dB, within which the choice is as good as the best.
const WITHIN: (f64, f64) = (0.05, 0.3);
/// Share of the images on which it must be.
const MOST: f64 = 0.95;

/// What a run is to do.
struct Request {
    check: bool,
    out: Option<PathBuf>,
    goal: Goal,
    effort: Effort,
    images: Vec<PathBuf>,
}

/// What a codec comes to.
struct Found {
    name: &'static str,
    measured: Measured,
    seconds: f64,
}

fn main() -> Outcome<()> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let run = Run::new("choices", 20.0, &mut arguments)?;
    let request = request(arguments)?;
    let columns = [
        "image",
        "reuse",
        "best",
        "its bits",
        "its dB",
        "chosen",
        "its bits",
        "its dB",
        "excess",
        "s/MT",
        "s/MT of the codec alone",
    ];
    let mut table = Table::new(&columns);
    let mut far = 0;
    let measure = |path: &Path| {
        let image = middle(&texfold_testkit::png(path), SIDE, SIDE)?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let (mut row, is_far) = compared(&name, image, &request)?;
        row.push(is_far.to_string());
        Ok(vec![row])
    };
    for mut row in run.rows(&request.images, measure)?.into_iter().flatten() {
        far += usize::from(row.pop().as_deref() == Some("true"));
        table.row(row);
    }
    if let Some(out) = &request.out {
        std::fs::create_dir_all(out)?;
        table.write(out, "choices", "Seconds are CPU seconds a megatexel.")?;
    }
    let near = 1.0 - far as f64 / request.images.len().max(1) as f64;
    println!(
        "{:.0} % of {} images within {:.0} % of the best",
        100.0 * near,
        request.images.len(),
        100.0 * WITHIN.0
    );
    if request.check && near < MOST { Err("the choice is too often not the best".into()) } else { Ok(()) }
}

/// A line of the table, and whether the choice is too far from the best.
fn compared(name: &str, image: Raster, request: &Request) -> Outcome<(Vec<String>, bool)> {
    let megatexels = image.size().texels() as f64 / 1e6;
    let set = ImageSet::single(image);
    let settings = EncodeSettings { goal: request.goal, effort: request.effort, ..EncodeSettings::default() };
    let mut all = Vec::new();
    for encoding in &ENCODINGS {
        let start = cpu_seconds();
        let made = encoding.encode(&set, Guidance::default(), &settings, &mut Job::default());
        let seconds = cpu_seconds() - start;
        if let Ok(made) = made {
            all.push(Found { name: encoding.id.name, measured: measure(&set, made.as_encoded()), seconds });
        }
    }
    let start = cpu_seconds();
    let made = encode_images(&set, Guidance::default(), &settings, &mut Job::default())?;
    let seconds = cpu_seconds() - start;
    let chosen = measure(&set, made.as_encoded());
    let better = |a: &&Found, b: &&Found| {
        if request.goal.prefers(&a.measured, &b.measured) {
            std::cmp::Ordering::Less
        } else {
            std::cmp::Ordering::Greater
        }
    };
    let best = all.iter().min_by(better).ok_or("no codec encodes it")?;
    let alone =
        all.iter().find(|found| found.name == made.codec().name).map_or(f64::NAN, |found| found.seconds);
    let by_bits = matches!(request.goal, Goal::Bpp(_));
    let excess =
        if by_bits { best.measured.psnr - chosen.psnr } else { chosen.bpp / best.measured.bpp - 1.0 };
    let is_far = excess > if by_bits { WITHIN.1 } else { WITHIN.0 };
    let reuse = Epitome::estimated_reuse(&set, &chosen, &Job::default())?;
    let row = vec![
        name.to_owned(),
        format!("{reuse:.3}"),
        best.name.to_owned(),
        format!("{:.3}", best.measured.bpp),
        format!("{:.2}", best.measured.psnr),
        made.codec().name.to_owned(),
        format!("{:.3}", chosen.bpp),
        format!("{:.2}", chosen.psnr),
        if by_bits { format!("{excess:.2} dB") } else { format!("{:.1} %", 100.0 * excess) },
        format!("{:.1}", seconds / megatexels),
        format!("{:.1}", alone / megatexels),
    ];
    Ok((row, is_far))
}

fn request(arguments: Vec<String>) -> Outcome<Request> {
    let mut request = Request {
        check: false,
        out: None,
        goal: Goal::Psnr(34.0),
        effort: Effort::Normal,
        images: Vec::new(),
    };
    let mut arguments = arguments.into_iter();
    while let Some(argument) = arguments.next() {
        let mut next = |what: &str| arguments.next().ok_or_else(|| what.to_owned());
        match argument.as_str() {
            "--check" => request.check = true,
            "--out" => request.out = Some(next("name the folder to write to")?.into()),
            "--psnr" => request.goal = Goal::Psnr(next("how many dB?")?.parse()?),
            "--bpp" => request.goal = Goal::Bpp(next("how many bits?")?.parse()?),
            "--effort" => {
                request.effort = match next("an effort is fast, normal or high")?.as_str() {
                    "fast" => Effort::Fast,
                    "normal" => Effort::Normal,
                    "high" => Effort::High,
                    _ => return Err("an effort is fast, normal or high".into()),
                }
            }
            path => request.images.extend(images_of(Path::new(path))?),
        }
    }
    if request.images.is_empty() {
        request.images = images_of(Path::new("fixtures/images"))?;
    }
    Ok(request)
}
