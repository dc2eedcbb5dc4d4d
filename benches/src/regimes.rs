//! The epitome codec in several regimes: sets of photographs of one place, images without repetition, time against texels,
//! drawing between texels and at mip levels.
//!
//! `cargo run --release -p texfold-benches --bin regimes -- [OUT_DIR] [sets|unlike|time|drawing]`: photographs where they
//! are, else fixtures. Writes sets.csv, unlike.csv, time.csv, drawing.csv, each with a table in Markdown, and time.svg.

use std::path::{Path, PathBuf};

use glam::Vec2;
use texfold::core::image::{ImageSet, MipFilter, Raster, mip_chain};
use texfold::core::metric::{color_error, decode_image, measure};
use texfold::{
    Access, Choice, EncodeSettings, Goal, Guidance, Job, Texel,
    core::Encoder,
    encode_images,
    epitome::{Epitome, EpitomeParams, EpitomeSource},
};
use texfold_benches::images;
use texfold_benches::report::{Outcome, Table, chart, cpu_seconds, middle, reduced};
use texfold_chart::Scale;
use texfold_epitome::EpitomeTexture;
use texfold_epitome::decode::{texfold_epitome_bilinear, texfold_epitome_nearest};

/// Quality at which sets, time and drawing are measured, in dB.
const PSNR: f64 = 32.0;
/// Within what sets are measured, too: RMS error of the worst 4x4 block, 8-bit units.
const TOLERANCE: f64 = 24.0;
/// Photographs of the largest set.
const SET: usize = 8;
/// By what photographs of a set are reduced.
const SET_FACTOR: u32 = 2;
/// Texels a side at most of images without repetition.
const UNLIKE_SIDE: u32 = 512;
/// Sides of the images whose encoding is timed.
const TIMED: [u32; 5] = [256, 384, 512, 768, 1024];
/// Texels a side of the images that are drawn.
const DRAWN_SIDE: u32 = 512;
/// Pixels a texel when an image is magnified, and texels a side of the smallest leaf.
const MAGNIFIED: u32 = 3;
const LEAF: u32 = 8;

fn main() -> Outcome<()> {
    let mut arguments = std::env::args().skip(1);
    let out = PathBuf::from(arguments.next().unwrap_or_else(|| "target/epitome".to_owned()));
    let only = arguments.next();
    std::fs::create_dir_all(&out)?;
    let wanted = |name: &str| only.as_deref().is_none_or(|only| only == name);
    if wanted("drawing") {
        drawing(&out)?;
    }
    if wanted("unlike") {
        unlike(&out)?;
    }
    if wanted("time") {
        time(&out)?;
    }
    if wanted("sets") {
        sets(&out)?;
    }
    Ok(())
}

fn encode(set: &ImageSet, mips: bool) -> Outcome<EpitomeTexture> {
    let params = EpitomeParams::new(Goal::Psnr(PSNR)).with_access(Access::Texel).with_mips(mips);
    Ok(Epitome::encode(EpitomeSource::new(set), &params, &mut Job::default())?)
}

/// Memory of sets of one, two, four and eight photographs against that of their images one by one (paper section 6).
fn sets(out: &Path) -> Outcome<()> {
    let names: Vec<String> =
        (1..=SET).map(|index| format!("epitome/collection_lund/{index:02}.jpg")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let photographs = images(&names, &["facade", "facade", "floor", "floor"]);
    let mut table = Table::new(&[
        "goal",
        "photographs",
        "as a set, KiB",
        "one by one, KiB",
        "set against one by one",
        "bits a texel",
    ]);
    for (goal, factor) in [(Goal::Psnr(PSNR), SET_FACTOR), (Goal::Tolerance(TOLERANCE), 2 * SET_FACTOR)] {
        let photographs: Vec<Raster> =
            photographs.iter().map(|(_, raster)| reduced(raster, factor)).collect::<Outcome<_>>()?;
        set_rows(&mut table, &photographs, goal)?;
    }
    let text = format!(
        "Memory of the first photographs of one street as one set and one by one: at {PSNR} dB and 1/{SET_FACTOR} of their size, and \
         in the paper's regime (raw content, blocks of 12 texels within a tolerance of {TOLERANCE}) at 1/{} of it.\n\
         `cargo run --release -p texfold-benches --bin regimes -- target/epitome sets`",
        2 * SET_FACTOR
    );
    table.write(out, "sets", &text)
}

fn set_rows(table: &mut Table, photographs: &[Raster], goal: Goal) -> Outcome<()> {
    let bits = |images: &[Raster]| -> Outcome<f64> {
        let set = ImageSet::new(images.to_vec())?;
        let params = EpitomeParams::new(goal).with_access(Access::Texel);
        let texture = Epitome::encode(EpitomeSource::new(&set), &params, &mut Job::default())?;
        Ok(measure(&set, &texture).bpp * set.texel_count() as f64)
    };
    let alone: Vec<f64> =
        photographs.iter().map(|image| bits(std::slice::from_ref(image))).collect::<Outcome<_>>()?;
    let texels = photographs.first().map_or(1, |image| image.size().texels()) as f64;
    for count in [1, 2, 4, SET] {
        let Some(images) = photographs.get(..count) else { break };
        let before = cpu_seconds();
        let (together, apart) = (bits(images)?, alone[..count].iter().sum::<f64>());
        eprintln!("{count} photographs: {:.0} CPU s", cpu_seconds() - before);
        table.row(vec![
            match goal {
                Goal::Psnr(psnr) => format!("{psnr} dB"),
                Goal::Tolerance(tolerance) => format!("tolerance {tolerance}"),
                Goal::Bpp(bpp) => format!("{bpp} bits"),
            },
            format!("{count}"),
            format!("{:.1}", together / 8192.0),
            format!("{:.1}", apart / 8192.0),
            format!("{:+.1} %", 100.0 * (together / apart - 1.0)),
            format!("{:.3}", together / (texels * count as f64)),
        ]);
    }
    Ok(())
}

/// What plain blocks of 4 bits a texel reach, asked of codec epitome as users ask it.
fn unlike(out: &Path) -> Outcome<()> {
    let photographs = [
        "epitome/skimage_grass.png",
        "epitome/zebras_bsds_253027.jpg",
        "epitome/GreenMeadow.jpg",
        "epitome/urban100_073.png",
    ];
    let mut all = images(&photographs, &["zebra", "terrain"]);
    all.push(("noise".to_owned(), texfold_testkit::image("noise")));
    let mut table = Table::new(&["image", "plain dB", "plain bits", "dB", "bits", "what it is"]);
    for (name, image) in all {
        let set = ImageSet::single(middle(&image, UNLIKE_SIDE, UNLIKE_SIDE)?);
        let plain = texfold::bc::BcParams::default().with_goal(Goal::Bpp(4.0)).with_reduce_log2(0);
        let plain = measure(&set, &texfold::bc::Bc::encode(&set, &plain, &mut Job::default())?);
        let settings = EncodeSettings {
            codec: Choice::of::<Epitome>(),
            goal: Goal::Psnr(plain.psnr),
            ..EncodeSettings::default()
        };
        let made = encode_images(&set, Guidance::default(), &settings, &mut Job::default())?;
        let found = measure(&set, made.as_encoded());
        let what = if made.downcast_ref::<EpitomeTexture>().is_some() {
            "epitome".to_owned()
        } else {
            let verdict = &made.as_encoded().notes().verdict;
            let why = verdict.rsplit(": ").next().unwrap_or_default().trim_end_matches('.');
            format!("plain blocks, since by epitome {why}")
        };
        table.row(vec![
            name,
            format!("{:.2}", plain.psnr),
            format!("{:.2}", plain.bpp),
            format!("{:.2}", found.psnr),
            format!("{:.3}", found.bpp),
            what,
        ]);
    }
    let text = format!(
        "Images that hardly repeat, the middle {UNLIKE_SIDE}×{UNLIKE_SIDE} texels at most: codec epitome asked for the PSNR of plain \
         blocks of 4 bits a texel.\n`cargo run --release -p texfold-benches --bin regimes -- target/epitome unlike`"
    );
    table.write(out, "unlike", &text)
}

/// CPU seconds of an encode against texels, with the exponent that fits best.
fn time(out: &Path) -> Outcome<()> {
    let mut table = Table::new(&["image", "side", "CPU s", "CPU s a megatexel"]);
    let mut lines = Vec::new();
    for (name, image) in images(&["epitome/urban100_100.png", "epitome/aloeL.jpg"], &["facade"]) {
        let mut line = Vec::new();
        for side in TIMED {
            let set = ImageSet::single(middle(&image, side, side)?);
            let before = cpu_seconds();
            encode(&set, false)?;
            let (seconds, texels) = (cpu_seconds() - before, set.texel_count() as f64);
            table.row(vec![
                name.clone(),
                format!("{side}"),
                format!("{seconds:.2}"),
                format!("{:.1}", seconds / texels * 1e6),
            ]);
            line.push((texels / 1e6, seconds));
        }
        let exponent = exponent(&line);
        table.row(vec![name.clone(), "exponent".to_owned(), format!("{exponent:.2}"), String::new()]);
        lines.push((format!("{name}: exponent {exponent:.2}"), line));
    }
    let text = format!(
        "CPU seconds, all threads together, of an encode at {PSNR} dB of the middle of photographs.\n\
         `cargo run --release -p texfold-benches --bin regimes -- target/epitome time`"
    );
    table.write(out, "time", &text)?;
    let axes = [("megatexels", Scale::Doublings(1.0)), ("CPU seconds", Scale::Doublings(1.0))];
    chart(&out.join("time.svg"), "Time against texels", axes, &lines)
}

/// Slope of the line of least squares through logarithms.
fn exponent(line: &[(f64, f64)]) -> f64 {
    let logs: Vec<(f64, f64)> = line.iter().map(|&(x, y)| (x.ln(), y.max(1e-3).ln())).collect();
    let count = logs.len().max(1) as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / count;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let sums = logs.iter().map(|p| ((p.0 - x) * (p.1 - y), (p.0 - x).powi(2)));
    let (both, own) = sums.fold((0.0, 0.0), |sum, term| (sum.0 + term.0, sum.1 + term.1));
    both / own
}

/// Traces of blocks in magnified images, and mip levels against those of the decoded image.
fn drawing(out: &Path) -> Outcome<()> {
    let photographs = [
        "epitome/urban100_021.png",
        "epitome/urban100_014.png",
        "epitome/urban100_100.png",
        "epitome/aloeL.jpg",
        "epitome/page_boston_cooking_a.jpg",
        "remote/neon_YELL_541000_4977000.png",
    ];
    let mut table = Table::new(&[
        "image",
        "bits",
        "dB",
        "seam",
        "blocks, original",
        "blocks, linear",
        "blocks, nearest",
        "level 1 dB",
        "level 2 dB",
        "level 3 dB",
    ]);
    for (name, fixture) in images(&photographs, &["facade", "terrain", "text_page"]) {
        let image = middle(&fixture, DRAWN_SIDE, DRAWN_SIDE)?;
        let set = ImageSet::single(image.clone());
        let texture = encode(&set, true)?;
        let measured = measure(&set, &texture);
        let view = texture.view(0);
        let size = Vec2::new(image.size().width as f32, image.size().height as f32);
        let uv = |x: u32, y: u32| (Vec2::new(x as f32, y as f32) + 0.5) / MAGNIFIED as f32 / size;
        let linear = blockiness(&image, |x, y| texfold_epitome_bilinear(&view, uv(x, y), 0));
        let nearest = blockiness(&image, |x, y| texfold_epitome_nearest(&view, uv(x, y), 0));
        let original = blockiness(&image, |x, y| magnified(&image, x, y));
        let mut row = vec![name, format!("{:.3}", measured.bpp), format!("{:.2}", measured.psnr)];
        row.push(format!("{:.2}", texture.map_format().seam_width as f32 / 4.0));
        row.extend([original, linear, nearest].map(|ratio| format!("{ratio:.3}")));
        let decoded = decode_image(&texture, 0, 0).ok_or("no index")?;
        let chain = mip_chain(&decoded, 4, MipFilter::Box);
        for (level, wanted) in (0u32..).zip(&chain).skip(1) {
            let found = decode_image(&texture, 0, level).ok_or("no level")?;
            row.push(format!("{:.2}", color_error(wanted, &found).psnr()));
        }
        table.row(row);
    }
    let text = format!(
        "With mip levels, at {PSNR} dB, the middle {DRAWN_SIDE}×{DRAWN_SIDE} texels. Blocks: mean step between neighbouring pixels across \
         borders of {LEAF}×{LEAF} texels over the mean step elsewhere, {MAGNIFIED} pixels a texel; 1 shows no block. Strip: texels across in which leaves are blended. Levels: PSNR against the \
         mip levels of the decoded fixture.\n\
         `cargo run --release -p texfold-benches --bin regimes -- target/epitome drawing`"
    );
    table.write(out, "drawing", &text)
}

/// An image magnified by linear interpolation.
fn magnified(image: &Raster, x: u32, y: u32) -> Texel {
    let place = |at: u32, end: u32| {
        let at = ((at as f32 + 0.5) / MAGNIFIED as f32 - 0.5).clamp(0.0, (end - 1) as f32);
        (at as u32, (at as u32 + 1).min(end - 1), at.fract())
    };
    let (left, right, across) = place(x, image.size().width);
    let (top, bottom, down) = place(y, image.size().height);
    let row = |y: u32| image.texel(left, y).lerp(image.texel(right, y), across);
    row(top).lerp(row(bottom), down)
}

/// Mean step between neighbours across borders of leaves, over the mean step elsewhere.
fn blockiness(image: &Raster, at: impl Fn(u32, u32) -> Texel) -> f32 {
    let (width, height) = (image.size().width * MAGNIFIED, image.size().height * MAGNIFIED);
    let (mut border, mut inner) = ((0.0f64, 0u32), (0.0f64, 0u32));
    for y in 0..height {
        let row: Vec<Texel> = (0..width).map(|x| at(x, y)).collect();
        for (x, pair) in (1..width).zip(row.windows(2)) {
            let step = f64::from((pair[1] - pair[0]).truncate().length());
            let sum = if x % (LEAF * MAGNIFIED) == 0 { &mut border } else { &mut inner };
            *sum = (sum.0 + step, sum.1 + 1);
        }
    }
    ((border.0 / f64::from(border.1)) / (inner.0 / f64::from(inner.1))) as f32
}
