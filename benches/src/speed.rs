//! What an encoder's time buys: CPU seconds a megatexel against PSNR and SSIMULACRA2 at one bit a texel, for every codec of images at
//! three efforts and for its peers; and the time of every codec on images that are hard for one of them.
//!
//! `cargo run --release -p texfold-benches --bin speed -- --out OUT [--only FORM|hard] [IMAGE …]`; without images, every third Kodak photograph of the data
//! folder. Writes `speed.csv`, `hard.csv`, each with a table in Markdown, `speed-psnr.svg` and `speed-ssimulacra2.svg`. ASTC is encoded by
//! the program `astcenc`, AVIF by `avifenc`, each where it is installed.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use texfold::core::image::{ColorSpace, ImageSet, Raster};
use texfold::core::metric::{color_error, decode_image};
use texfold::core::rng::XorShift;
use texfold::encoding::ENCODINGS;
use texfold::{
    AnyImage, Choice, Content, Effort, EncodeSettings, Goal, Guidance, Job, Metric, bc::Bc, bc::BcParams,
    core::Encoder, encode_images,
};
use texfold_benches::report::{Line, Outcome, Table, chart, cpu_seconds, images_of};
use texfold_chart::Scale;
use texfold_cli::{astc_by_astcenc, ssimulacra2};

/// Bits a texel of all that can be asked for them.
const BITS: f64 = 1.0;
const EFFORTS: [Effort; 3] = [Effort::Fast, Effort::Normal, Effort::High];
/// Bits of `vq`, whose index alone takes one.
const VQ_BITS: f64 = 1.5;
/// Side of ASTC blocks: 0.89 bits a texel.
const ASTC_SIDE: u32 = 12;
const ASTC: [&str; 3] = ["-fast", "-medium", "-thorough"];
/// Speeds of `avifenc`.
const AVIF: [u32; 3] = [9, 6, 3];
/// Coarsest quantiser of `avifenc`.
const AVIF_COARSEST: u32 = 63;
/// Times that an image is encoded by what takes less than CPU time is counted in.
const REPEATED: u32 = 10;
/// Texels a side of hard images.
const HARD: u32 = 512;

/// Means of what a form reaches on all images.
struct Point {
    form: String,
    setting: String,
    seconds: f64,
    bpp: f64,
    psnr: f64,
    ssimulacra2: f64,
}

fn main() -> Outcome<()> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut option = |name: &str| {
        let named = arguments.iter().position(|argument| argument == name)?;
        arguments.drain(named..(named + 2).min(arguments.len())).nth(1)
    };
    let out = PathBuf::from(option("--out").ok_or("name the folder: --out OUT")?);
    let only = option("--only");
    std::fs::create_dir_all(&out)?;
    if only.as_deref() == Some("hard") {
        return hard(&out);
    }
    let images = photographs(&arguments)?;
    let mut points = Vec::new();
    let is_wanted = |form: &String| only.as_ref().is_none_or(|only| only == form);
    for (form, of_form) in forms().into_iter().filter(|(form, _)| is_wanted(form)) {
        for (setting, encode) in of_form {
            if let Some(point) = measured(&form, &setting, &images, &encode)? {
                println!(
                    "{form} {setting}: {:.2} s, {:.2} bits, {:.2} dB",
                    point.seconds, point.bpp, point.psnr
                );
                points.push(point);
            }
        }
    }
    write(&out, &points, images.len())?;
    if only.is_none() { hard(&out) } else { Ok(()) }
}

/// Photographs that the caller names, or every third one of Kodak's.
fn photographs(given: &[String]) -> Outcome<Vec<Raster>> {
    let mut paths: Vec<PathBuf> = given.iter().map(PathBuf::from).collect();
    if paths.is_empty() {
        let data = texfold_testkit::data_dir("the time of encoders").ok_or("name images")?;
        paths = images_of(&data.join("vq/kodak"))?.into_iter().step_by(3).collect();
    }
    Ok(paths.iter().map(|path| texfold_testkit::png(path).with_channels(3)).collect())
}

/// What encoding an image gives.
struct Coded {
    decoded: Raster,
    bits: u64,
    /// CPU seconds of encoding.
    seconds: f64,
}

/// Nothing where a program is not installed.
type Made = Option<Coded>;
type Encode = Box<dyn Fn(&Raster) -> Outcome<Made>>;

/// Forms, each with its settings from fast to slow.
fn forms() -> Vec<(String, Vec<(String, Encode)>)> {
    let mut forms: Vec<(String, Vec<(String, Encode)>)> = Vec::new();
    let codecs = ENCODINGS.iter().map(|encoding| encoding.id.name).filter(|name| *name != "bc");
    for name in codecs.chain(["auto"]) {
        let of_effort = |effort: Effort| -> (String, Encode) {
            (name_of(effort), Box::new(move |image| ours(name, effort, Metric::Psnr, image)))
        };
        let form = if name == "vq" { format!("vq, {VQ_BITS} bits") } else { name.to_owned() };
        forms.push((form, EFFORTS.map(of_effort).into()));
    }
    let for_the_eye = EFFORTS.map(|effort| -> (String, Encode) {
        (name_of(effort), Box::new(move |image| ours("dct", effort, Metric::Perceptual, image)))
    });
    forms.push(("dct, for the eye".to_owned(), for_the_eye.into()));
    let blocks = |content: Content| {
        EFFORTS[..2].iter().map(move |&effort| -> (String, Encode) {
            (name_of(effort), Box::new(move |image| plain(content, effort, image)))
        })
    };
    forms.push(("BC1".to_owned(), blocks(Content::Bc1).collect()));
    forms.push(("BC7".to_owned(), blocks(Content::Bc7).collect()));
    let astc = ASTC.map(|preset| -> (String, Encode) {
        (preset.trim_start_matches('-').to_owned(), Box::new(move |image| astc(image, preset)))
    });
    forms.push((format!("ASTC {ASTC_SIDE}x{ASTC_SIDE}, 0.9 bits"), astc.into()));
    let avif = AVIF.map(|speed| -> (String, Encode) {
        (format!("speed {speed}"), Box::new(move |image| avif(image, speed)))
    });
    forms.push(("AVIF".to_owned(), avif.into()));
    forms.push(("JPEG".to_owned(), vec![("4:2:0".to_owned(), Box::new(jpeg))]));
    forms
}

fn name_of(effort: Effort) -> String {
    format!("{effort:?}").to_lowercase()
}

fn ours(codec: &str, effort: Effort, metric: Metric, image: &Raster) -> Outcome<Made> {
    let set = ImageSet::single(image.clone());
    let has_metric = ENCODINGS.iter().all(|encoding| encoding.id.name != codec || encoding.has_metric);
    let bits = if codec == "vq" { VQ_BITS } else { BITS };
    // No codec is named "auto".
    let codec = Choice::named(codec).unwrap_or_else(Choice::auto);
    let settings = EncodeSettings {
        codec,
        effort,
        goal: Goal::Bpp(bits),
        metric: has_metric.then_some(metric),
        keeps_codec: true,
        ..EncodeSettings::default()
    };
    let before = cpu_seconds();
    let image = encode_images(&set, Guidance::default(), &settings, &mut Job::default())?;
    made(&image, cpu_seconds() - before)
}

fn plain(content: Content, effort: Effort, image: &Raster) -> Outcome<Made> {
    let params = BcParams::default().with_goal(Goal::Bpp(f64::MAX)).with_content(content).with_effort(effort);
    let set = ImageSet::single(image.clone());
    let before = cpu_seconds();
    let texture = Bc::encode(&set, &params, &mut Job::default())?;
    let seconds = cpu_seconds() - before;
    made(&AnyImage::new(texture), seconds)
}

fn made(image: &AnyImage, seconds: f64) -> Outcome<Made> {
    let encoded = image.as_encoded();
    let decoded = decode_image(encoded, 0, 0).ok_or("an encoded image has no level 0")?;
    Ok(Some(Coded { decoded, bits: encoded.memory().goal, seconds }))
}

/// With the time of reading and writing PNG and of decoding.
fn astc(image: &Raster, preset: &str) -> Outcome<Made> {
    let before = cpu_seconds();
    let coded = astc_by_astcenc(image, ASTC_SIDE, preset).map_err(|error| error.to_string())?;
    Ok(coded.map(|(decoded, bits)| Coded { decoded, bits, seconds: cpu_seconds() - before }))
}

/// The largest quality with which a file of JPEG, 4:2:0, has at most the bits.
fn jpeg(image: &Raster) -> Outcome<Made> {
    let (size, bytes) = (image.size(), image.to_bytes());
    let file = |quality: u8| {
        let mut file = Vec::new();
        let encoder = jpeg_encoder::Encoder::new(&mut file, quality);
        encoder.encode(&bytes, size.width as u16, size.height as u16, jpeg_encoder::ColorType::Rgb)?;
        Outcome::Ok(file)
    };
    let fits = |file: &Vec<u8>| 8.0 * file.len() as f64 <= BITS * size.texels() as f64;
    let mut quality = 1;
    while quality < 100 && fits(&file(quality + 1)?) {
        quality += 1;
    }
    let before = cpu_seconds();
    let mut coded = Vec::new();
    for _ in 0..REPEATED {
        coded = file(quality)?;
    }
    let seconds = (cpu_seconds() - before) / f64::from(REPEATED);
    let decoded = image::load_from_memory(&coded)?.to_rgb8();
    let decoded = Raster::from_u8(size.width, size.height, 3, ColorSpace::Srgb, decoded.as_raw())?;
    Ok(Some(Coded { decoded, bits: 8 * coded.len() as u64, seconds }))
}

/// The finest quantiser with which a file of AVIF, 4:4:4, has at most the bits; with the time of reading PNG.
fn avif(image: &Raster, speed: u32) -> Outcome<Made> {
    let dir = tempfile::tempdir()?;
    let [source, file, decoded] = ["in.png", "out.avif", "out.png"].map(|name| dir.path().join(name));
    let size = image.size();
    image::save_buffer(&source, &image.to_bytes(), size.width, size.height, image::ColorType::Rgb8)?;
    let encode = |level: u32| -> Outcome<Option<(u64, f64)>> {
        let options = format!("-s {speed} -j 1 -y 444 --min 0 --max 63 -a end-usage=q -a cq-level={level}");
        let before = cpu_seconds();
        let mut program = Command::new("avifenc");
        program.args(options.split_whitespace()).args([&source, &file]).stdout(Stdio::null());
        match program.stderr(Stdio::null()).status() {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Ok(status) if status.success() => {}
            failed => return Err(format!("avifenc failed: {failed:?}").into()),
        }
        Ok(Some((8 * std::fs::metadata(&file)?.len(), cpu_seconds() - before)))
    };
    let (mut finer, mut level) = (0, AVIF_COARSEST);
    while finer < level {
        let middle = (finer + level) / 2;
        let Some((bits, _)) = encode(middle)? else { return Ok(None) };
        let fits = bits as f64 <= BITS * size.texels() as f64;
        (finer, level) = if fits { (finer, middle) } else { (middle + 1, level) };
    }
    let Some((bits, seconds)) = encode(level)? else { return Ok(None) };
    let status = Command::new("avifdec").args([&file, &decoded]).stdout(Stdio::null()).status()?;
    if !status.success() {
        return Err("avifdec failed".into());
    }
    Ok(Some(Coded { decoded: texfold_testkit::png(&decoded).with_channels(3), bits, seconds }))
}

/// Means over all images; nothing where the form has no program.
fn measured(form: &str, setting: &str, images: &[Raster], encode: &Encode) -> Outcome<Option<Point>> {
    let mut point = Point {
        form: form.to_owned(),
        setting: setting.to_owned(),
        seconds: 0.0,
        bpp: 0.0,
        psnr: 0.0,
        ssimulacra2: 0.0,
    };
    let texels: u64 = images.iter().map(|image| image.size().texels()).sum();
    for image in images {
        let Some(coded) = encode(image)? else {
            eprintln!("{form} {setting}: its program is not installed");
            return Ok(None);
        };
        let share = 1.0 / images.len() as f64;
        point.seconds += 1e6 * coded.seconds / texels as f64;
        point.bpp += coded.bits as f64 / texels as f64;
        point.psnr += share * color_error(image, &coded.decoded).psnr();
        point.ssimulacra2 += share * ssimulacra2(image, &coded.decoded).ok_or("images are too small")?;
    }
    Ok(Some(point))
}

fn write(out: &Path, points: &[Point], images: usize) -> Outcome<()> {
    let columns = [
        "form",
        "setting",
        "CPU s a megatexel",
        "bits a texel",
        "PSNR dB",
        "SSIMULACRA2",
        "megatexels an hour",
    ];
    let mut table = Table::new(&columns);
    let (mut psnr, mut eye): (Vec<Line>, Vec<Line>) = (Vec::new(), Vec::new());
    for point in points {
        table.row(vec![
            point.form.clone(),
            point.setting.clone(),
            format!("{:.2}", point.seconds),
            format!("{:.2}", point.bpp),
            format!("{:.2}", point.psnr),
            format!("{:.1}", point.ssimulacra2),
            format!("{:.0}", 3600.0 / point.seconds.max(1e-3)),
        ]);
        for (lines, value) in [(&mut psnr, point.psnr), (&mut eye, point.ssimulacra2)] {
            match lines.iter_mut().find(|(form, _)| *form == point.form) {
                Some((_, line)) => line.push((point.seconds, value)),
                None => lines.push((point.form.clone(), vec![(point.seconds, value)])),
            }
        }
    }
    let text = format!(
        "Means over {images} images; {BITS} bit a texel where the format has a choice, else what it takes. CPU seconds of all threads and \
         programs; those of ASTC and AVIF include reading PNG."
    );
    table.write(out, "speed", &text)?;
    // Those of another number of bits would seem the best.
    let is_near = |(form, _): &Line| !form.starts_with("BC");
    for (up, mut lines, name) in [("PSNR dB", psnr, "psnr"), ("SSIMULACRA2", eye, "ssimulacra2")] {
        lines.retain(is_near);
        let axes = [("CPU seconds a megatexel", Scale::Doublings(1.0)), (up, Scale::Linear)];
        let title = format!("What encoding time buys at {BITS} bit a texel");
        chart(&out.join(format!("speed-{name}.svg")), &title, axes, &lines)?;
    }
    Ok(())
}

/// Images of [`HARD`] texels a side: noise, lines of small marks, squares of 3 texels, a ramp, one colour.
fn hard_images() -> Outcome<Vec<(&'static str, ImageSet)>> {
    let mut random = XorShift::new(1);
    let noise: Vec<u8> = (0..3 * HARD * HARD).map(|_| (random.unit() * 256.0) as u8).collect();
    let page = texfold_testkit::image("text_page");
    let size = page.size();
    let from = |of: &mut dyn FnMut(u32, u32) -> [u8; 3]| -> Vec<u8> {
        (0..HARD * HARD).flat_map(|i| of(i % HARD, i / HARD)).collect()
    };
    let text = from(&mut |x, y| {
        // Every copy is moved, so that its blocks differ from those of the others.
        let copy = 3 * (x / size.width) + 7 * (y / size.height);
        let texel = page.texel((x + copy) % size.width, (y + 5 * copy) % size.height);
        texel.to_array().map(|value| (value * 255.0) as u8)[..3].try_into().unwrap_or_default()
    });
    let squares = from(&mut |x, y| [255 * ((x / 3 + y / 3) % 2) as u8; 3]);
    let ramp = from(&mut |x, y| [x, y, (x + y) / 2].map(|value| (value * 255 / (HARD - 1)) as u8));
    let one = from(&mut |_, _| [70, 110, 160]);
    let images =
        [("noise", noise), ("text", text), ("squares", squares), ("ramp", ramp), ("one colour", one)];
    let set = |bytes: &[u8]| Raster::from_u8(HARD, HARD, 3, ColorSpace::Srgb, bytes).map(ImageSet::single);
    images.iter().map(|(name, bytes)| Ok((*name, set(bytes)?))).collect()
}

/// CPU time of every codec on images that are hard for one of them.
fn hard(out: &Path) -> Outcome<()> {
    let images = hard_images()?;
    let mut header = vec!["codec", "effort"];
    header.extend(images.iter().map(|(name, _)| *name));
    let mut table = Table::new(&header);
    let named = |name| Choice::named(name).map(|codec| (name, codec));
    let codecs = ENCODINGS.iter().filter_map(|encoding| named(encoding.id.name));
    for ((name, codec), effort) in
        codecs.flat_map(|codec| [Effort::Fast, Effort::Normal].map(|effort| (codec.clone(), effort)))
    {
        let mut row = vec![name.to_owned(), name_of(effort)];
        for (_, set) in &images {
            let settings =
                EncodeSettings { codec: codec.clone(), effort, keeps_codec: true, ..Default::default() };
            let before = cpu_seconds();
            encode_images(set, Guidance::default(), &settings, &mut Job::default())?;
            row.push(format!("{:.1}", (cpu_seconds() - before) / set.texel_count() as f64 * 1e6));
        }
        table.row(row);
    }
    let text = format!(
        "CPU seconds a megatexel, all threads together, of images of {HARD}x{HARD} texels at the default goal."
    );
    table.write(out, "hard", &text)
}
