//! Our codecs beside the texture formats that engines ship: PSNR and SSIMULACRA2 against bits a texel.
//!
//! `cargo run --release -p texfold-benches --bin peers -- OUT [FOLDER_OR_IMAGE …]`; without images, the Kodak photographs of the data folder.
//! Bits are what a GPU holds, everything counted, without mips. ASTC is encoded by the program `astcenc` (`-thorough`), where it
//! is installed. JPEG stands for textures that are decoded by block on the GPU: 4:2:0, with 0.17 bits a texel for the index that
//! such a texture needs. `… -- OUT sheet` draws parts of fixtures instead: the source, ours and ASTC at equal bits. A curve is the mean over the images of PSNR (or SSIMULACRA2) at each setting, at the mean of its bits.

use std::path::{Path, PathBuf};

use texfold::core::image::{ColorSpace, ImageSet, Raster};
use texfold::core::metric::{color_error, decode_image, measure};
use texfold::{
    Content, Effort, Encoded, Family, Goal, Job, Metric,
    bc::{Bc, BcParams},
    core::{Encoder, Image2d, SharedSearch},
    dct::{Dct, DctParams},
    epitome::{Epitome, EpitomeParams, EpitomeSource},
    progressive::{Progressive, ProgressiveParams},
};
use texfold_benches::report::{Line, Outcome, Table, chart, images_of};
use texfold_chart::Scale;
use texfold_cli::{astc_by_astcenc, ssimulacra2};

/// Goals of our codecs in bits per texel: those of ASTC in blocks of 12x12, 10x10, 8x8 and 6x6, and half a bit.
const GOALS: [f64; 5] = [0.5, 0.89, 1.28, 2.0, 3.56];
/// Sides of ASTC blocks.
const ASTC: [u32; 4] = [12, 10, 8, 6];
/// Qualities of JPEG.
const JPEG: [u8; 7] = [15, 25, 40, 60, 75, 85, 92];
/// Bits a texel of the index of a JPEG texture (Kristmann, Wimmer and Schuetz 2026).
const JPEG_INDEX: f64 = 0.17;

/// What one setting of one form reaches on one image.
#[derive(Debug, Clone)]
struct Point {
    form: &'static str,
    setting: String,
    bpp: f64,
    psnr: f64,
    ssimulacra2: f64,
}

fn main() -> Outcome<()> {
    let mut arguments = std::env::args().skip(1).map(PathBuf::from);
    let out = arguments.next().ok_or("name the folder to write to")?;
    std::fs::create_dir_all(&out)?;
    let mut given: Vec<PathBuf> = arguments.collect();
    if given == [Path::new("sheet")] {
        return sheet(&out);
    }
    if given.is_empty() {
        given.extend(texfold_testkit::data_dir("peers").map(|data| data.join("vq/kodak")));
    }
    let images = given.iter().map(|path| images_of(path)).collect::<Outcome<Vec<_>>>()?.concat();
    let mut points = Vec::new();
    for path in &images {
        eprintln!("{}", path.display());
        let image = texfold_testkit::png(path).with_channels(3);
        points.extend([ours(&image)?, plain(&image)?, jpeg(&image)?, astc(&image)?].concat());
    }
    write(&out, &points, images.len())
}

/// Metrics of `dct`.
const BLOCKS: [(&str, Metric); 2] =
    [("dct, for the eye", Metric::Perceptual), ("dct, for PSNR", Metric::Psnr)];
/// And of `progressive`.
const TEXELS: [(&str, Metric); 2] =
    [("progressive, for the eye", Metric::Perceptual), ("progressive, for PSNR", Metric::Psnr)];

/// Our codecs at [`GOALS`].
fn ours(image: &Raster) -> Outcome<Vec<Point>> {
    let set = ImageSet::single(image.clone());
    let first = Goal::Bpp(GOALS[0]);
    let epitome = EpitomeParams::new(first).with_family(Family::ErrorMap);
    let epitome = Epitome::search(EpitomeSource::new(&set), &epitome, &mut Job::default())?;
    let mut points = Vec::new();
    for (form, metric) in TEXELS {
        let params = ProgressiveParams::default().with_goal(first).with_metric(metric);
        let search = Progressive::search(&set, &params, &mut Job::default())?;
        for goal in GOALS {
            let texture = Progressive::encode_from(&search, Goal::Bpp(goal), &mut Job::default())?;
            points.push(judge(form, format!("{goal}"), image, &texture)?);
        }
    }
    for goal in GOALS {
        let setting = format!("{goal}");
        for (form, metric) in BLOCKS {
            let params = DctParams::default().with_goal(Goal::Bpp(goal)).with_metric(metric);
            let texture = Dct::encode(&set, &params, &mut Job::default())?;
            points.push(judge(form, setting.clone(), image, &texture)?);
        }
        let texture = Epitome::encode_from(&epitome, Goal::Bpp(goal), &mut Job::default())?;
        points.push(judge("epitome", setting, image, &texture)?);
    }
    Ok(points)
}

/// BC1 and BC7 at full and half size.
fn plain(image: &Raster) -> Outcome<Vec<Point>> {
    let set = ImageSet::single(image.clone());
    let forms = [
        ("BC1", Content::Bc1, 1),
        ("BC1", Content::Bc1, 0),
        ("BC7", Content::Bc7, 1),
        ("BC7", Content::Bc7, 0),
    ];
    let encode = |(form, content, reduce_log2): (&'static str, Content, u32)| {
        let params = BcParams::default()
            .with_goal(Goal::Bpp(f64::MAX))
            .with_content(content)
            .with_reduce_log2(reduce_log2)
            .with_effort(Effort::Normal);
        let texture = Bc::encode(&set, &params, &mut Job::default())?;
        judge(form, format!("1/{}", 1 << reduce_log2), image, &texture)
    };
    forms.into_iter().map(encode).collect()
}

/// Baseline JPEG, 4:2:0, with the bits of an index.
fn jpeg(image: &Raster) -> Outcome<Vec<Point>> {
    use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
    let size = image.size();
    let coded = |quality: u8, optimised: bool| {
        let mut file = Vec::new();
        let mut encoder = Encoder::new(&mut file, quality);
        encoder.set_sampling_factor(SamplingFactor::F_2_2);
        encoder.set_optimized_huffman_tables(optimised);
        encoder.encode(&image.to_bytes(), size.width as u16, size.height as u16, ColorType::Rgb)?;
        Outcome::Ok(file)
    };
    let encode = |quality: u8| {
        // The same coefficients. Optimised tables are shorter, but with 4:2:0 zune-jpeg does not read what jpeg-encoder 0.7 writes.
        let (read, counted) = (coded(quality, false)?, coded(quality, true)?);
        let decoded = image::load_from_memory(&read)?.to_rgb8();
        let decoded = Raster::from_u8(size.width, size.height, 3, ColorSpace::Srgb, decoded.as_raw())?;
        let bpp = 8.0 * counted.len() as f64 / size.texels() as f64 + JPEG_INDEX;
        compare("JPEG texture", format!("q{quality}"), image, &decoded, bpp)
    };
    JPEG.into_iter().map(encode).collect()
}

/// ASTC by `astcenc`; nothing where it is not installed.
fn astc(image: &Raster) -> Outcome<Vec<Point>> {
    let mut points = Vec::new();
    for side in ASTC {
        let coded = astc_by_astcenc(image, side, "-thorough").map_err(|error| error.to_string())?;
        let Some((decoded, bits)) = coded else {
            eprintln!("astcenc is not installed: no ASTC in the chart");
            return Ok(Vec::new());
        };
        let bpp = bits as f64 / image.size().texels() as f64;
        points.push(compare("ASTC", format!("{side}x{side}"), image, &decoded, bpp)?);
    }
    Ok(points)
}

/// Parts of fixtures in the sheet, with their upper left corners.
const SHEET: [(&str, (u32, u32)); 3] = [("salient", (60, 60)), ("floor", (80, 80)), ("tile_repeat", (0, 0))];
/// Texels of a part along a side, and pixels that each is drawn with.
const PART: (u32, u32) = (96, 3);
/// Pixels between parts.
const GAP: u32 = 8;

/// Parts of fixtures side by side; below each what the default settings make of it, and ASTC, at the bits of blocks of 12x12.
fn sheet(out: &Path) -> Outcome<()> {
    let (side, zoom) = PART;
    let step = side * zoom + GAP;
    let mut page =
        image::RgbImage::from_pixel(SHEET.len() as u32 * step - GAP, 3 * step - GAP, [255; 3].into());
    for (column, (name, (left, top))) in (0..).zip(SHEET) {
        let source = texfold_testkit::image(name).with_channels(3);
        let coded = astc_by_astcenc(&source, ASTC[0], "-thorough").map_err(|error| error.to_string())?;
        let (astc, bits) = coded.ok_or("install astcenc")?;
        let set = ImageSet::single(source.clone());
        let goal = Goal::Bpp(bits as f64 / source.size().texels() as f64);
        let ours = texfold::Encode::new(&set).goal(goal).run()?;
        let ours = decode_image(ours.as_encoded(), 0, 0).ok_or("an encoded image has no level 0")?;
        let db = [&ours, &astc].map(|decoded| color_error(&source, decoded).psnr());
        println!("{name}: {:.1} dB, ASTC {:.1} dB, {goal:?}", db[0], db[1]);
        for (row, raster) in (0..).zip([&source, &ours, &astc]) {
            for (y, x) in (0..side * zoom).flat_map(|y| (0..side * zoom).map(move |x| (y, x))) {
                let texel = raster.texel(left + x / zoom, top + y / zoom).truncate();
                let pixel = texel.to_array().map(texfold::core::image::to_u8);
                page.put_pixel(column * step + x, row * step + y, pixel.into());
            }
        }
    }
    Ok(page.save(out.join("sheet.png"))?)
}

fn judge(
    form: &'static str,
    setting: String,
    image: &Raster,
    texture: &dyn Encoded<Domain = Image2d>,
) -> Outcome<Point> {
    let bpp = measure(&ImageSet::single(image.clone()), texture).bpp;
    let decoded = decode_image(texture, 0, 0).ok_or("an encoded image has no level 0")?;
    compare(form, setting, image, &decoded, bpp)
}

fn compare(
    form: &'static str,
    setting: String,
    image: &Raster,
    decoded: &Raster,
    bpp: f64,
) -> Outcome<Point> {
    let ssimulacra2 =
        ssimulacra2(image, decoded).ok_or("SSIMULACRA2 needs sRGB images of at least 8 texels a side")?;
    Ok(Point { form, setting, bpp, psnr: color_error(image, decoded).psnr(), ssimulacra2 })
}

/// Means over the images of each form and setting, as a table and two charts.
fn write(out: &Path, points: &[Point], images: usize) -> Outcome<()> {
    let mut table = Table::new(&["form", "setting", "bits a texel", "PSNR dB", "SSIMULACRA2"]);
    let (mut psnr, mut eye): (Vec<Line>, Vec<Line>) = (Vec::new(), Vec::new());
    let mut done: Vec<(&str, &str)> = Vec::new();
    for point in points {
        let key = (point.form, point.setting.as_str());
        if done.contains(&key) {
            continue;
        }
        done.push(key);
        let same: Vec<&Point> =
            points.iter().filter(|other| (other.form, other.setting.as_str()) == key).collect();
        let mean =
            |of: fn(&Point) -> f64| same.iter().map(|point| of(point)).sum::<f64>() / same.len() as f64;
        let (bpp, db, score) = (mean(|p| p.bpp), mean(|p| p.psnr), mean(|p| p.ssimulacra2));
        table.row(vec![
            point.form.to_owned(),
            point.setting.clone(),
            format!("{bpp:.2}"),
            format!("{db:.2}"),
            format!("{score:.1}"),
        ]);
        for (lines, value) in [(&mut psnr, db), (&mut eye, score)] {
            match lines.iter_mut().find(|(form, _)| *form == point.form) {
                Some((_, line)) => line.push((bpp, value)),
                None => lines.push((point.form.to_owned(), vec![(bpp, value)])),
            }
        }
    }
    let text = format!("Means over {images} images; bits a texel are what a GPU holds, without mips.");
    table.write(out, "peers", &text)?;
    let charts = [
        ("PSNR against bits a texel", "dB", &mut psnr, "peers-psnr.svg"),
        ("SSIMULACRA2 against bits a texel", "points", &mut eye, "peers-ssimulacra2.svg"),
    ];
    for (title, up, lines, name) in charts {
        lines.iter_mut().for_each(|(_, line)| line.sort_by(|a, b| a.0.total_cmp(&b.0)));
        lines.iter_mut().for_each(|(_, line)| line.retain(|point| point.0 <= 4.5));
        let axes = [("bits a texel, compressed", Scale::Linear), (up, Scale::Linear)];
        chart(&out.join(name), title, axes, lines)?;
    }
    Ok(())
}
