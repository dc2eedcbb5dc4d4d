//! Headline results of the papers, measured here by their own criteria.
//!
//! `cargo run --release -p texfold-benches --bin papers -- --out OUT [epitome|collection|vq|sequence|zipmap …]`: all of them without
//! a name. Photographs that are not part of the repository, where they are; else fixtures. Writes a table for each.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec2, Vec4};
use texfold::core::image::{ColorSpace, ImageSet, Raster};
use texfold::core::metric::{color_error, decode_image, measure, quality};
use texfold::core::{Encoder, SharedSearch};
use texfold::{
    Content, Effort, Encoded, Goal, Job,
    dct::{Dct, DctParams},
    epitome::{Epitome, EpitomeParams, EpitomeSource, ToleranceKind},
    vq::VqParams,
    zipmap::{PatchSource, PatchStack, ZipParams, Zipmap},
};
use texfold_benches::report::{Outcome, Table, cpu_seconds, middle, reduced, rms_percent};
use texfold_benches::{FACTORED_PHOTOGRAPHS, images, over, salient_psnr, vq};

/// Relative tolerances; 0.002 to 0.004 in the figures of the paper of epitomes.
const TOLERANCES: [f64; 5] = [0.002, 0.004, 0.008, 0.016, 0.032];
/// RMS error in percent at which savings are listed: most of the paper's table have 2.5 to 3.
const RMS_PERCENT: f64 = 2.5;
/// Texels a side of an image that is factored (Figure 1).
const FACTORED: u32 = 504;
/// Views of one facade, and their size.
const VIEWS: usize = 5;
const VIEW: (u32, u32) = (432, 360);
/// PSNR of every image of a zoom stack, in dB.
const ZOOM_PSNR: f64 = 38.0;
/// Texels a side of the surface of a zoom stack, of a close-up, and how much coarser the wide photograph is.
const SURFACE: u32 = 2048;
const CLOSE_UP: u32 = 512;
const ZOOM: u32 = 4;

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (mut out, mut names) = (PathBuf::from("target/papers"), Vec::new());
    let mut words = arguments.iter();
    while let Some(word) = words.next() {
        match (word.as_str(), words.clone().next()) {
            ("--out", Some(path)) => {
                out = PathBuf::from(path);
                words.next();
            }
            (name, _) => names.push(name.to_owned()),
        }
    }
    std::fs::create_dir_all(&out)?;
    type Part = (&'static str, fn(&Path) -> Outcome<()>);
    let parts: [Part; 5] = [
        ("epitome", factored),
        ("collection", collection),
        ("vq", quantised),
        ("sequence", sequence),
        ("zipmap", zoomed),
    ];
    if let Some(name) = names.iter().find(|name| !parts.iter().any(|(part, _)| part == name)) {
        return Err(format!("{name}: is none of {}", parts.map(|(part, _)| part).join(", ")).into());
    }
    for (name, part) in parts {
        if names.is_empty() || names.iter().any(|wanted| wanted == name) {
            part(&out)?;
        }
    }
    Ok(())
}

fn relative(tolerance: f64) -> EpitomeParams {
    EpitomeParams::new(Goal::Tolerance(tolerance))
        .with_tolerance_kind(ToleranceKind::Relative)
        .with_content(Content::Raw)
}

/// RMS error in 8-bit units.
fn rms(psnr: f64) -> f64 {
    2.55 * rms_percent(psnr)
}

/// Savings by image factoring (Table 1).
fn factored(out: &Path) -> Outcome<()> {
    let mut table = Table::new(&["image", "size", "epitome", "tolerance", "savings", "RMS", "CPU s"]);
    let names = FACTORED_PHOTOGRAPHS.map(|name| format!("epitome/{name}"));
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut all = images(&names, &[]);
    let fixtures = ["facade", "tile_repeat", "cloth"];
    all.extend(fixtures.map(|name| (name.to_owned(), texfold_testkit::image(name))));
    for (name, image) in all {
        let set = ImageSet::single(middle(&image, FACTORED, FACTORED)?);
        let size = set.images()[0].size();
        let before = cpu_seconds();
        let params = relative(TOLERANCES[TOLERANCES.len() - 1]);
        let search = Epitome::search(EpitomeSource::new(&set), &params, &mut Job::default())?;
        let mut rows = Vec::new();
        for tolerance in TOLERANCES {
            let texture = Epitome::encode_from(&search, Goal::Tolerance(tolerance), &mut Job::default())?;
            let (width, height) = texture.epitomes().next().map_or((0, 0), |epitome| epitome.size());
            let found = measure(&set, &texture);
            let (savings, rms) = (f64::from(8 * set.info().channels) / found.bpp, rms_percent(found.psnr));
            rows.push((
                rms,
                vec![
                    format!("{width}×{height}"),
                    format!("{tolerance}"),
                    format!("{savings:.2}"),
                    format!("{rms:.2} %"),
                ],
            ));
        }
        let seconds = (cpu_seconds() - before) / TOLERANCES.len() as f64;
        let away = |rms: f64| (rms / RMS_PERCENT).ln().abs();
        let Some((_, row)) = rows.into_iter().min_by(|(a, _), (b, _)| away(*a).total_cmp(&away(*b))) else {
            continue;
        };
        let size = format!("{}×{}", size.width, size.height);
        table.row([vec![name, size], row, vec![format!("{seconds:.1}")]].concat());
    }
    let text = format!(
        "Raw content, blocks of 12×12 texels, Eq. 1: source bytes over bytes of memory at the relative tolerance whose RMS error comes \
         nearest to {RMS_PERCENT} %.\n`cargo run --release -p texfold-benches --bin papers -- epitome`"
    );
    table.write(out, "epitome", &text)
}

/// Epitome texels of one to five images (section 6): photographs of a street, and one facade from a moved camera.
fn collection(out: &Path) -> Outcome<()> {
    let mut table =
        Table::new(&["images of", "images", "epitome texels", "savings", "apart", "RMS", "CPU s"]);
    let street = (1..=VIEWS).map(|index| format!("epitome/collection_lund/{index:02}.jpg"));
    let street: Vec<String> = street.collect();
    let street: Vec<&str> = street.iter().map(String::as_str).collect();
    let street: Vec<Raster> = images(&street, &[])
        .iter()
        .map(|(_, image)| middle(&reduced(image, 4)?, VIEW.0, VIEW.1))
        .collect::<Outcome<_>>()?;
    let [(_, facade)] = &images(&["epitome/urban100_014.png"], &["facade"])[..] else { return Ok(()) };
    let facade = middle(&reduced(facade, 2)?, FACTORED, FACTORED)?;
    let moved: Vec<Raster> = (0..VIEWS).map(|view| moved_view(&facade, view)).collect::<Outcome<_>>()?;
    for (name, views) in [("a street", &street), ("one facade", &moved)] {
        let encode = |images: &[Raster]| -> Outcome<(u64, f64, f64)> {
            let set = ImageSet::new(images.to_vec())?;
            let texture = Epitome::encode(EpitomeSource::new(&set), &relative(0.003), &mut Job::default())?;
            let texels =
                texture.epitomes().map(|epitome| u64::from(epitome.size().0) * u64::from(epitome.size().1));
            let found = measure(&set, &texture);
            Ok((texels.sum(), found.bpp * set.texel_count() as f64, found.psnr))
        };
        let mut apart = 0.0;
        for count in 1..=views.len() {
            let before = cpu_seconds();
            let (texels, bits, psnr) = encode(&views[..count])?;
            let seconds = cpu_seconds() - before;
            apart += encode(&views[count - 1..count])?.1;
            let raw: u64 = views[..count].iter().map(|view| 24 * view.size().texels()).sum();
            table.row(vec![
                name.to_owned(),
                format!("{count}"),
                format!("{texels}"),
                format!("{:.2}", raw as f64 / bits),
                format!("{:.2}", raw as f64 / apart),
                format!("{:.2} %", rms_percent(psnr)),
                format!("{seconds:.0}"),
            ]);
        }
    }
    let text = "Sets at a relative tolerance of 0.003: source bytes over bytes of memory as a set, and of the same images apart. One facade: \
                views of one photograph, the camera moved and turned, exposure and noise of each its own.\n\
                `cargo run --release -p texfold-benches --bin papers -- collection`";
    table.write(out, "collection", text)
}

/// `surface` from a camera that is moved: another place, distance and direction for each number, exposure up to 6 % off, noise
/// of 1/255.
fn moved_view(surface: &Raster, number: usize) -> Outcome<Raster> {
    let size = surface.size();
    let of = |degrees: f64| (number as f64 * degrees).to_radians().sin();
    let place = DVec2::new(0.5 + 0.05 * of(70.0), 0.5 + 0.05 * of(130.0));
    let slanted =
        DMat3::from_cols_array(&[1.0, 0.0, 0.25 * of(95.0), 0.0, 1.0, 0.15 * of(50.0), 0.0, 0.0, 1.0]);
    let matrix = DMat3::from_translation(place)
        * slanted
        * DMat3::from_scale_angle_translation(
            DVec2::splat(0.75 + 0.1 * of(110.0)),
            0.1 * of(40.0),
            DVec2::ZERO,
        )
        * DMat3::from_translation(DVec2::splat(-0.5));
    let gain = 1.0 + 0.06 * of(160.0) as f32;
    let texel = |index: usize| {
        let (x, y) = (index as u32 % VIEW.0, index as u32 / VIEW.0);
        let at =
            DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) / DVec2::new(VIEW.0.into(), VIEW.1.into());
        let seen = matrix * at.extend(1.0);
        let uv = seen.truncate() / seen.z * DVec2::new(size.width.into(), size.height.into());
        let noise = (index as u32).wrapping_mul(0x9E37_79B9).wrapping_add(number as u32 * 77).rotate_left(15);
        let noise = (noise.wrapping_mul(0x85EB_CA6B) >> 16) as f32 / 65536.0 - 0.5;
        bilinear(surface, uv) * gain + Vec4::splat(3.4 * noise / 255.0)
    };
    let texels: Vec<Vec4> = over((VIEW.0 * VIEW.1) as usize, texel);
    let bytes = texels.iter().flat_map(|texel| texel.truncate().to_array()).map(texfold::core::image::to_u8);
    Ok(Raster::from_u8(VIEW.0, VIEW.1, 3, ColorSpace::Srgb, &bytes.collect::<Vec<_>>())?)
}

/// The colour at a place in texels, mirrored beyond the border.
fn bilinear(image: &Raster, at: DVec2) -> Vec4 {
    let size = image.size();
    let (low, weight) = ((at - 0.5).floor(), (at - 0.5 - (at - 0.5).floor()).as_vec2());
    let inside = |at: f64, side: u32| {
        let at = (at as i64).rem_euclid(2 * i64::from(side)) as u32;
        at.min(2 * side - 1 - at)
    };
    let texel = |x: f64, y: f64| image.texel(inside(low.x + x, size.width), inside(low.y + y, size.height));
    let row = |y: f64| texel(0.0, y).lerp(texel(1.0, y), weight.x);
    row(0.0).lerp(row(1.0), weight.y)
}

/// Samples beside pure VQ at 9.6:1 and 17.1:1 (section 5.1).
fn quantised(out: &Path) -> Outcome<()> {
    let columns = ["image", "ratio", "form", "RMS", "RMS, most salient quarter", "exact", "CPU s"];
    let mut table = Table::new(&columns);
    let small =
        ["vq/kodak/kodim05.png", "vq/kodak/kodim15.png", "vq/kodak/kodim23.png", "vq/kodak/kodim19.png"];
    let mut all: Vec<(String, Raster, u32)> = Vec::new();
    for (name, image) in images(&small, &["salient", "facade"]) {
        all.push((name, middle(&image, 512, 512)?, 128));
    }
    for (name, image) in images(&["remote/brighton_DJI_0022.jpg", "remote/seneca_IMG_0456.jpg"], &[]) {
        all.push((name, middle(&image, 2048, 2048)?, 256));
    }
    for (name, image, side) in all {
        let set = ImageSet::single(image.clone());
        let books = u64::from(side * side) * 24;
        for (form, samples) in [("vq alone", (0, 0)), ("a sample of half the side", (1, side / 2))] {
            let importance = if samples.0 > 0 { 1.0 } else { 0.0 };
            let params = VqParams::default()
                .with_codebook((side, side))
                .with_samples(samples)
                .with_importance(importance)
                .with_content(Content::Raw);
            let before = cpu_seconds();
            let Some(texture) = vq(&set, &params) else { continue };
            let seconds = cpu_seconds() - before;
            let Some(decoded) = decode_image(texture.as_encoded(), 0, 0) else { continue };
            let (whole, salient) = salient_psnr(&image, &decoded);
            // As the paper counts: raw codebook, two bytes a block.
            let ratio = 24.0 * image.size().texels() as f64 / (books + image.size().texels()) as f64;
            table.row(vec![
                name.clone(),
                format!("{ratio:.1}"),
                form.to_owned(),
                format!("{:.1}", rms(whole)),
                format!("{:.1}", rms(salient)),
                format!("{:.1} %", exact_share(&image, &decoded)),
                format!("{seconds:.1}"),
            ]);
        }
    }
    let text = "A raw codebook of 1/16 and 1/64 of the image, by vector quantisation alone and with one sample of a quarter of it, and importance. RMS errors \
                in 8-bit units; *exact*: share of the 4×4 blocks without error.\n\
                `cargo run --release -p texfold-benches --bin papers -- vq`";
    table.write(out, "vq", text)
}

/// Share of the 4x4 blocks that are decoded exactly, in percent.
fn exact_share(image: &Raster, decoded: &Raster) -> f64 {
    let size = image.size();
    let (columns, rows) = (size.width / 4, size.height / 4);
    let exact = |block: u32| {
        let (left, top) = (block % columns * 4, block / columns * 4);
        (0..16).all(|i| {
            let at = (left + i % 4, top + i / 4);
            (image.texel(at.0, at.1) - decoded.texel(at.0, at.1)).truncate().abs().max_element() < 0.5 / 255.0
        })
    };
    100.0 * (0..columns * rows).filter(|&block| exact(block)).count() as f64 / f64::from(columns * rows)
}

/// Sequences by one codebook that grows (section 5.2).
fn sequence(out: &Path) -> Outcome<()> {
    let mut table = Table::new(&["frames", "size", "form", "codebook", "ratio", "RMS", "CPU s"]);
    let caustics: Vec<String> =
        (0..32).map(|index| format!("vq/anim_caustics/caust{index:02}.png")).collect();
    let caustics: Vec<&str> = caustics.iter().map(String::as_str).collect();
    let frames: Vec<Raster> = images(&caustics, &[]).into_iter().map(|(_, frame)| frame).collect();
    let Some(first) = frames.first() else { return Ok(()) };
    let size = first.size();
    let set = ImageSet::new(frames.iter().map(|frame| frame.clone().with_channels(3)).collect())?;
    let forms = [("vq alone", (0, 0), 0.0), ("importance", (0, 0), 1.0), ("a sample of 64×64", (1, 64), 0.0)];
    for (form, samples, importance) in forms {
        let before = cpu_seconds();
        let params = VqParams::default()
            .with_codebook((64, 96))
            .with_samples(samples)
            .with_importance(importance)
            .with_content(Content::Raw);
        let Some(texture) = vq(&set, &params) else { return Ok(()) };
        let seconds = cpu_seconds() - before;
        let psnr = quality(&set, texture.as_encoded()).color.psnr();
        let texels = set.texel_count();
        table.row(vec![
            format!("{}", frames.len()),
            format!("{}×{}", size.width, size.height),
            form.to_owned(),
            "64×96".to_owned(),
            format!("{:.1}", 24.0 * texels as f64 / (24 * 64 * 96 + texels) as f64),
            format!("{:.1}", rms(psnr)),
            format!("{seconds:.1}"),
        ]);
    }
    let bpp = 24.0 * (64 * 96) as f64 / set.texel_count() as f64 + 1.0;
    let before = cpu_seconds();
    let texture = Dct::encode(&set, &DctParams::default().with_goal(Goal::Bpp(bpp)), &mut Job::default())?;
    table.row(vec![
        format!("{}", frames.len()),
        format!("{}×{}", size.width, size.height),
        "`dct` at the same bits".to_owned(),
        String::new(),
        format!("{:.1}", 24.0 * set.texel_count() as f64 / texture.memory().compressed as f64),
        format!("{:.1}", rms(quality(&set, &texture).color.psnr())),
        format!("{:.1}", cpu_seconds() - before),
    ]);
    let text = "Frames of caustics with one raw codebook.\n`cargo run --release -p texfold-benches --bin papers -- sequence`";
    table.write(out, "sequence", text)
}

/// Close-ups on a wide photograph beside one large texture that shows the same.
fn zoomed(out: &Path) -> Outcome<()> {
    let columns = [
        "photograph",
        "close-ups",
        "stack, kB",
        "stack, decoded, MB",
        "one texture, kB",
        "one texture, decoded, MB",
        "stack dB",
    ];
    let mut table = Table::new(&columns);
    for (name, image) in images(&["remote/brighton_DJI_0022.jpg", "remote/seneca_IMG_0456.jpg"], &[]) {
        let surface = middle(&image, SURFACE, SURFACE)?;
        let wide = reduced(&surface, ZOOM)?;
        for count in [1, 3, 6, 10] {
            zoom_row(&mut table, &name, &surface, &wide, count)?;
        }
    }
    let text = format!(
        "A photograph of {}×{} texels and close-ups of {CLOSE_UP}×{CLOSE_UP} at {ZOOM} times its resolution, every image at \
         {ZOOM_PSNR} dB, by block, beside one texture of {SURFACE}×{SURFACE} texels by `dct` that holds what the stack shows (the wide \
         photograph enlarged, close-ups where they are), every close-up at {ZOOM_PSNR} dB.\n\
         `cargo run --release -p texfold-benches --bin papers -- zipmap`",
        SURFACE / ZOOM,
        SURFACE / ZOOM
    );
    table.write(out, "zipmap", &text)
}

fn zoom_row(table: &mut Table, name: &str, surface: &Raster, wide: &Raster, count: u32) -> Outcome<()> {
    let cells = SURFACE / CLOSE_UP;
    // Close-ups spread over the surface: each cell at most once.
    let corner = |index: u32| {
        let cell = (index * 7 + 5) % (cells * cells);
        (cell % cells * CLOSE_UP, cell / cells * CLOSE_UP)
    };
    let cut = |from: &Raster, (left, top): (u32, u32)| -> Outcome<Raster> {
        let texel = |i: u32| from.texel(left + i % CLOSE_UP, top + i / CLOSE_UP);
        let texels: Vec<_> = (0..CLOSE_UP * CLOSE_UP).map(texel).collect();
        Ok(Raster::from_texels(CLOSE_UP, CLOSE_UP, from.info(), &texels)?)
    };
    let close: Vec<Raster> = (0..count).map(|index| cut(surface, corner(index))).collect::<Outcome<_>>()?;
    let mut stack = PatchStack { root: wide.clone(), images: close.clone(), patches: Vec::new() };
    for index in 0..count {
        let (left, top) = corner(index);
        let place = DVec2::new(left.into(), top.into()) / f64::from(SURFACE);
        let matrix = DMat3::from_scale(DVec2::splat(f64::from(cells))) * DMat3::from_translation(-place);
        stack.patches.push(PatchSource { image: index as usize, matrix, mask: None, parent: None });
    }
    let params = ZipParams::default().with_goal(Goal::Psnr(ZOOM_PSNR)).with_effort(Effort::Fast);
    let (texture, found) = Zipmap::encode_measured(&stack, &params, &mut Job::default())?;
    // What the stack shows, from the photographs themselves.
    let closest = |x: u32, y: u32| {
        (0..count)
            .rev()
            .map(corner)
            .find(|&(left, top)| (left..left + CLOSE_UP).contains(&x) && (top..top + CLOSE_UP).contains(&y))
    };
    let texels = over((SURFACE * SURFACE) as usize, |index| {
        let (x, y) = (index as u32 % SURFACE, index as u32 / SURFACE);
        let at = (DVec2::new(x.into(), y.into()) + 0.5) / f64::from(ZOOM);
        closest(x, y).map_or_else(|| bilinear(wide, at), |_| surface.texel(x, y))
    });
    let shown = ImageSet::single(Raster::from_texels(SURFACE, SURFACE, surface.info(), &texels)?);
    let mut one = None;
    for psnr in (0..24).map(|half| ZOOM_PSNR + 0.5 * f64::from(half)) {
        let params =
            DctParams::default().with_goal(Goal::Psnr(psnr)).with_mips(true).with_effort(Effort::Fast);
        let made = Dct::encode(&shown, &params, &mut Job::default())?;
        let Some(decoded) = decode_image(&made, 0, 0) else { continue };
        let met = (0..count)
            .map(corner)
            .zip(&close)
            .map(|(corner, close)| Ok(color_error(close, &cut(&decoded, corner)?).psnr() >= ZOOM_PSNR));
        let met = met.collect::<Outcome<Vec<bool>>>()?.into_iter().all(|met| met);
        one = Some(made);
        if met {
            break;
        }
    }
    let Some(one) = one else { return Ok(()) };
    let kilobytes = |bits: u64| format!("{:.0}", bits as f64 / 8000.0);
    let megabytes = |bits: u64| format!("{:.1}", bits as f64 / 8e6);
    table.row(vec![
        name.to_owned(),
        format!("{count}"),
        kilobytes(texture.memory().compressed),
        megabytes(texture.memory().resident),
        kilobytes(one.memory().compressed),
        megabytes(one.memory().resident),
        format!("{:.2}", found.psnr),
    ]);
    Ok(())
}
