//! Base and residual, by block or by texel, at given rates, image by image, beside JPEG and ASTC of equal bits.
//!
//! `cargo run --release -p texfold-benches --bin rates -- [--check] [--out DIR] [--effort fast|normal|high] [--access block|texel] [--budget MINUTES] [FOLDER_OR_IMAGE …]`;
//! without images, the Kodak photographs of the data folder. Images are cut to their middle 1024x1024 texels. Bits a texel
//! are those of the whole texture: header, index, tables, padding. JPEG stands for textures that are decoded by block on the
//! GPU: 4:2:0, with 0.17 bits a texel for the index; its figures are interpolated between qualities over the logarithm of
//! the bits. ASTC is encoded by the program `astcenc` (`-thorough`), where it is installed. With `--check` the run fails
//! where the means over the images miss what the 14 photographs must reach by block.

use std::path::{Path, PathBuf};

use texfold::core::image::{ImageSet, Raster};
use texfold::core::metric::{color_error, decode_surface};
use texfold::{
    Access, Effort, Encoded, Goal, Job, Metric, Rect,
    core::{CancelCheck, Encoder},
    progressive::{Progressive, ProgressiveParams},
};
use texfold_benches::budget::Run;
use texfold_benches::report::{Chart, Line, Outcome, Table, cpu_seconds, images_of, middle};
use texfold_benches::rivals;
use texfold_cli::ssimulacra2;
use texfold_dct::DctTexture;
use texfold_dct::encode::{DctEncoder, DctSettings, DctSource};

/// Bits a texel, the side of the ASTC blocks that take them, and the PSNR in dB that the photographs must reach.
const RATES: [(f64, u32, f64); 4] = [(0.89, 12, 33.5), (1.28, 10, 36.0), (2.0, 8, 39.4), (3.56, 6, 42.9)];
/// Qualities of JPEG, from the smallest to the largest.
const JPEG: [u8; 8] = [15, 30, 50, 65, 78, 86, 92, 96];
/// Longest side of an image.
const SIDE: u32 = 1024;
/// Times that a texture is decoded to measure the speed: CPU time is known to a hundredth of a second.
const DECODES: u32 = 20;

/// Bits a texel, PSNR in dB and SSIMULACRA2.
type Figures = [f64; 3];

/// What a run is to do.
struct Request {
    check: bool,
    out: Option<PathBuf>,
    effort: Effort,
    access: Access,
    images: Vec<PathBuf>,
}

fn main() -> Outcome<()> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let run = Run::new("rates", 60.0, &mut arguments)?;
    let request = request(arguments)?;
    let columns = [
        "image",
        "rate",
        "psnr: bits",
        "dB",
        "SSIMULACRA2",
        "eye: bits",
        "dB",
        "SSIMULACRA2",
        "ASTC: bits",
        "dB",
        "SSIMULACRA2",
        "JPEG dB",
        "SSIMULACRA2",
        "encode s/MT",
        "decode MT/s",
    ];
    let mut table = Table::new(&columns);
    let mut sums = vec![[0.0; 13]; RATES.len()];
    let measure = |path: &Path| {
        let image = middle(&texfold_testkit::png(path).with_channels(3), SIDE, SIDE)?;
        let figures = figures(&image, &request)?;
        Ok(figures.iter().map(|figures| figures.map(|figure| figure.to_string()).to_vec()).collect())
    };
    for (path, rows) in request.images.iter().zip(run.rows(&request.images, measure)?) {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        for ((rate, sum), row) in RATES.iter().zip(&mut sums).zip(rows) {
            let figures: Vec<f64> = row.iter().map(|cell| cell.parse()).collect::<Result<_, _>>()?;
            table.row(line(&name, rate.0, &figures));
            sum.iter_mut().zip(figures).for_each(|(sum, figure)| *sum += figure);
        }
    }
    let count = request.images.len() as f64;
    let means: Vec<[f64; 13]> = sums.iter().map(|sum| sum.map(|sum| sum / count)).collect();
    for (rate, mean) in RATES.iter().zip(&means) {
        table.row(line("mean", rate.0, mean));
    }
    if let Some(out) = request.out {
        std::fs::create_dir_all(&out)?;
        table.write(&out, "rates", "Bits a texel are those of the whole texture, without mips.")?;
        charts(&out, &means, request.access)?;
    }
    let missed = RATES.iter().zip(&means).find(|((_, _, target), mean)| mean[1] < *target);
    match missed {
        Some(((rate, _, target), mean)) if request.check => {
            Err(format!("{:.2} dB at {rate} bits, where {target} must be reached", mean[1]).into())
        }
        _ => Ok(()),
    }
}

fn request(arguments: Vec<String>) -> Outcome<Request> {
    let mut request = Request {
        check: false,
        out: None,
        effort: Effort::Normal,
        access: Access::Block,
        images: Vec::new(),
    };
    let mut arguments = arguments.into_iter();
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--check" => request.check = true,
            "--out" => request.out = Some(arguments.next().ok_or("name the folder to write to")?.into()),
            "--effort" => {
                request.effort = match arguments.next().as_deref() {
                    Some("fast") => Effort::Fast,
                    Some("normal") => Effort::Normal,
                    Some("high") => Effort::High,
                    _ => return Err("an effort is fast, normal or high".into()),
                }
            }
            "--access" => {
                request.access = match arguments.next().as_deref() {
                    Some("block") => Access::Block,
                    Some("texel") => Access::Texel,
                    _ => return Err("an access is block or texel".into()),
                }
            }
            path => request.images.extend(images_of(Path::new(path))?),
        }
    }
    if let Some(data) = texfold_testkit::data_dir("rates").filter(|_| request.images.is_empty()) {
        request.images = images_of(&data.join("vq/kodak"))?;
    }
    Ok(request)
}

/// Means over the images against bits a texel, PSNR and SSIMULACRA2.
fn charts(out: &Path, means: &[[f64; 13]], access: Access) -> Outcome<()> {
    let form = access.name();
    let forms =
        [(format!("by {form}, for PSNR"), 0), (format!("by {form}, for the eye"), 3), ("ASTC".to_owned(), 6)];
    let rate = |number: usize| RATES[number].0;
    for (figure, up, file) in
        [(1, "PSNR in dB", "rates-psnr.svg"), (2, "SSIMULACRA2", "rates-ssimulacra2.svg")]
    {
        let mut lines: Vec<Line> = Vec::new();
        for (form, first) in &forms {
            let points = means.iter().map(|mean| (mean[*first], mean[first + figure]));
            lines.push((form.clone(), points.filter(|point| !point.1.is_nan()).collect()));
        }
        let jpeg = means.iter().enumerate().map(|(number, mean)| (rate(number), mean[8 + figure]));
        lines.push(("JPEG texture".to_owned(), jpeg.filter(|point| !point.1.is_nan()).collect()));
        lines.retain(|(_, points)| !points.is_empty());
        let chart = Chart { caption: up, across: "bits a texel", up, logarithmic: false };
        chart.draw(&lines, &out.join(file))?;
    }
    Ok(())
}

/// All figures of an image, rate by rate; NaN where there are none.
fn figures(image: &Raster, request: &Request) -> Outcome<Vec<[f64; 13]>> {
    let mut jpegs = Vec::new();
    for quality in JPEG {
        let (decoded, bits) = rivals::jpeg(image, quality)?;
        jpegs.push(judged(image, &decoded, bits)?);
    }
    let source = DctSource::from_u8(image.size(), &[3], &image.to_bytes())?;
    let mut all = Vec::new();
    for (rate, side, _) in RATES {
        let ours = |metric| match request.access {
            Access::Block => by_block(image, &source, metric, request.effort, rate),
            Access::Texel => by_texel(image, metric, request.effort, rate),
        };
        let (psnr, seconds, speed) = ours(Metric::Psnr)?;
        let (eye, ..) = ours(Metric::Perceptual)?;
        let astc = match rivals::astc(image, (side, side))? {
            Some((decoded, bits)) => judged(image, &decoded, bits)?,
            None => [f64::NAN; 3],
        };
        let jpeg = interpolated(&jpegs, rate);
        let [a, b, c] = psnr;
        let [d, e, f] = eye;
        let [g, h, i] = astc;
        all.push([a, b, c, d, e, f, g, h, i, jpeg[0], jpeg[1], seconds, speed]);
    }
    Ok(all)
}

/// A texture of that rate: its figures, CPU seconds a megatexel of encoding, megatexels a CPU second of decoding.
fn by_block(
    image: &Raster,
    source: &DctSource,
    metric: Metric,
    effort: Effort,
    rate: f64,
) -> Outcome<(Figures, f64, f64)> {
    let size = image.size();
    let megatexels = size.texels() as f64 / 1e6;
    let start = cpu_seconds();
    let params = DctSettings::default().with_goal(Goal::Bpp(rate)).with_metric(metric).with_effort(effort);
    let texture = DctEncoder::new(source, &params, CancelCheck::default())?.encode()?;
    let encoded = (cpu_seconds() - start) / megatexels;
    let start = cpu_seconds();
    let mut decoded = Vec::new();
    for _ in 0..DECODES {
        decoded = decoded_texels(&texture)?;
    }
    let speed = megatexels * f64::from(DECODES) / (cpu_seconds() - start);
    let decoded = Raster::from_u8(size.width, size.height, 3, image.info().color, &decoded)?;
    let bits = 8.0 * texture.to_bytes().len() as f64 / size.texels() as f64;
    Ok((judged(image, &decoded, bits)?, encoded, speed))
}

/// The same by texel.
fn by_texel(image: &Raster, metric: Metric, effort: Effort, rate: f64) -> Outcome<(Figures, f64, f64)> {
    let size = image.size();
    let megatexels = size.texels() as f64 / 1e6;
    let start = cpu_seconds();
    let params =
        ProgressiveParams::default().with_goal(Goal::Bpp(rate)).with_metric(metric).with_effort(effort);
    let texture = Progressive::encode(&ImageSet::single(image.clone()), &params, &mut Job::default())?;
    let encoded = (cpu_seconds() - start) / megatexels;
    let mut decoded = decode_surface(&texture, 0, 0);
    let start = cpu_seconds();
    for _ in 0..DECODES {
        decoded = decode_surface(&texture, 0, 0);
    }
    let speed = megatexels * f64::from(DECODES) / (cpu_seconds() - start);
    let decoded = decoded.ok_or("an image does not decode")?;
    let bits = texture.memory().goal as f64 / size.texels() as f64;
    Ok((judged(image, &decoded, bits)?, encoded, speed))
}

fn decoded_texels(texture: &DctTexture) -> Outcome<Vec<u8>> {
    let size = texture.form().size;
    let mut out = vec![0; size.texels() as usize * texture.form().channels()];
    let rect = Rect { surface: 0, level: 0, x: 0, y: 0, width: size.width, height: size.height };
    texture.decode(rect, &mut out)?;
    Ok(out)
}

fn judged(image: &Raster, decoded: &Raster, bits: f64) -> Outcome<Figures> {
    Ok([
        bits,
        color_error(image, decoded).psnr(),
        ssimulacra2(image, decoded).ok_or("SSIMULACRA2 needs sRGB images of at least 8 texels a side")?,
    ])
}

/// PSNR and SSIMULACRA2 at a rate, between the nearest of `points`; NaN outside of them.
fn interpolated(points: &[Figures], rate: f64) -> [f64; 2] {
    let pair = points.windows(2).find(|pair| pair[0][0] <= rate && rate <= pair[1][0]);
    pair.map_or([f64::NAN; 2], |pair| {
        let share = (rate / pair[0][0]).ln() / (pair[1][0] / pair[0][0]).ln();
        [1, 2].map(|figure| pair[0][figure] + share * (pair[1][figure] - pair[0][figure]))
    })
}

fn line(name: &str, rate: f64, figures: &[f64]) -> Vec<String> {
    let head = [name.to_owned(), rate.to_string()];
    head.into_iter().chain(figures.iter().map(|figure| format!("{figure:.2}"))).collect()
}
