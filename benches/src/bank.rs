//! Banks: an image of any size to add to one, and how codebook and cost grow with the tiles that are there.
//!
//! `cargo run --release -p texfold-benches --bin bank -- land FILE.tif [SIDE]` writes drawn land of 16384 x 16384 texels.
//! `… -- mosaic FILE.tif SIDE IMAGE...` writes SIDE x SIDE texels (BigTIFF) of windows of images, each in one of eight orientations.
//! `… -- growth OUT` adds tiles of 512 x 512 texels one after another, each to the codebook that those before it have left, at half a bit
//! a texel: of drawn land, of a forest (brighton), and of one place on two dates (naip). It says what each brings, and CPU seconds.
//! Bases are an eighth of the width and height: where a smaller image may be enlarged instead, that is better and codebooks are left out.

use std::error::Error;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use texfold::core::image::{ColorSpace, ImageSet, Raster};
use texfold::core::metric::quality;
use texfold::{
    Encoded, Goal, Job, Metric,
    progressive::{Progressive, ProgressiveParams, Shared},
};
use texfold_benches::over;
use texfold_benches::report::{Line, Outcome, Table, chart, cpu_seconds};
use texfold_chart::Scale;
use texfold_testkit::fixtures::land::land;
use tiff::encoder::{TiffEncoder, colortype::RGB8};

/// Texels a side of the land.
const SIDE: u32 = 16_384;
/// Rows that are drawn and written at a time.
const ROWS: u32 = 64;
/// Texels a side of a tile.
const TILE: u32 = 512;
/// Tiles of the land.
const TILES: u32 = 42;
/// Bits a texel, those of the public codebook not among them.
const BPP: f64 = 0.5;
/// Texels a side of a window of a mosaic; no multiple of a tile, so that tiles meet borders of windows.
const WINDOW: u32 = 1200;
/// Rows of the public codebook at most, as in banks.
const MOST_ROWS: u32 = 512;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments.as_slice() {
        ["land", path] => draw(path, SIDE),
        ["land", path, side] => draw(path, side.parse()?),
        ["mosaic", path, side, images @ ..] if !images.is_empty() => mosaic(path, side.parse()?, images),
        ["growth", out] => growth(Path::new(out)),
        _ => Err("usage: land FILE.tif [SIDE] | mosaic FILE.tif SIDE IMAGE... | growth OUT".into()),
    }
}

fn growth(out: &Path) -> Outcome<()> {
    std::fs::create_dir_all(out)?;
    let columns = [
        "tiles of",
        "tile",
        "public cells",
        "added",
        "own cells",
        "PSNR dB",
        "dB alone",
        "bits a texel",
        "CPU s",
    ];
    let mut table = Table::new(&columns);
    let mut lines = Vec::new();
    let of_land = |n: u32| {
        Ok(Raster::from_u8(
            TILE,
            TILE,
            3,
            ColorSpace::Srgb,
            &land((n % 7 * TILE, n / 7 * TILE), (TILE, TILE)),
        )?)
    };
    lines.push(add("land", (0..TILES).map(of_land).collect::<Outcome<Vec<_>>>()?, &mut table)?);
    if let Some(data) = texfold_testkit::data_dir("aerial images added to a codebook") {
        let read = |name: &str| texfold_testkit::png(&data.join("remote").join(name)).with_channels(3);
        lines.push(add("forest", tiles(&read("brighton_DJI_0022.jpg"))?, &mut table)?);
        let mut dates = tiles(&read("naip_m_4709963_20090818.tif"))?;
        dates.extend(tiles(&read("naip_m_4709963_20200831.tif"))?);
        lines.push(add("two dates", dates, &mut table)?);
    }
    let text = "Tiles of 512 x 512 texels, each added to the public codebook that those before it have left.";
    table.write(out, "growth", text)?;
    let axes = [("tiles", Scale::Linear), ("cells", Scale::Linear)];
    chart(&out.join("growth.svg"), "Cells of the public codebook", axes, &lines)
}

/// The whole tiles of an image.
fn tiles(image: &Raster) -> Outcome<Vec<Raster>> {
    let size = image.size();
    let (columns, rows) = (size.width / TILE, size.height / TILE);
    let tile = |n: u32| {
        let (left, top) = (n % columns * TILE, n / columns * TILE);
        let texel = |i: u32| image.texel(left + i % TILE, top + i / TILE);
        let texels: Vec<_> = (0..TILE * TILE).map(texel).collect();
        Ok(Raster::from_texels(TILE, TILE, image.info(), &texels)?)
    };
    (0..columns * rows).map(tile).collect()
}

/// Adds tiles; cells of the codebook after each.
fn add(name: &str, tiles: Vec<Raster>, table: &mut Table) -> Outcome<Line> {
    let params =
        ProgressiveParams::default().with_goal(Goal::Bpp(BPP)).with_metric(Metric::Psnr).with_reduce_log2(3);
    let mut shared = Shared { public: None, most_rows: MOST_ROWS, apron: None };
    let (mut line, mut before) = (Vec::new(), 0);
    for (number, tile) in (1..).zip(tiles) {
        let set = ImageSet::single(tile);
        let start = cpu_seconds();
        let texture = Progressive::encode_shared(&set, &params, &shared, &mut Job::default())?;
        let seconds = cpu_seconds() - start;
        let alone = Progressive::encode_shared(&set, &params, &Shared::default(), &mut Job::default())?;
        let psnr = |texture| quality(&set, texture).color.psnr();
        let details = texture.details();
        if let Some(public) = details.and_then(|details| details.public.clone()) {
            shared.public = Some(public);
        }
        let cells = |book: &texfold_progressive::Codebook| book.size().0 * book.size().1 / 1024;
        let public = shared.public.as_ref().map_or(0, |book| cells(book));
        let own = details.and_then(|details| details.private.as_ref()).map_or(0, |book| cells(book));
        let bits = texture.memory().compressed - texture.shared_bits();
        table.row(vec![
            name.to_owned(),
            format!("{number}"),
            format!("{public}"),
            format!("{}", public - before),
            format!("{own}"),
            format!("{:.2}", psnr(&texture)),
            format!("{:.2}", psnr(&alone)),
            format!("{:.3}", bits as f64 / set.texel_count() as f64),
            format!("{seconds:.2}"),
        ]);
        before = public;
        line.push((f64::from(number), f64::from(public)));
    }
    Ok((name.to_owned(), line))
}

/// Writes land as a TIFF file in strips.
fn draw(path: &str, side: u32) -> Outcome<()> {
    let mut encoder = TiffEncoder::new(BufWriter::new(File::create(path)?))?;
    let mut image = encoder.new_image::<RGB8>(side, side)?;
    image.rows_per_strip(ROWS)?;
    for top in (0..side).step_by(ROWS as usize) {
        let rows = ROWS.min(side - top);
        let strip = over(rows as usize, |row| land((0, top + row as u32), (side, 1))).concat();
        image.write_strip(&strip)?;
    }
    image.finish()?;
    Ok(())
}

/// Writes a mosaic of windows of images as a BigTIFF file in strips: each window at a place of its own in one of eight orientations.
fn mosaic(path: &str, side: u32, images: &[&str]) -> Outcome<()> {
    let open = |path: &&str| Ok(image::open(path)?.to_rgb8());
    let images = images.iter().map(open).collect::<Outcome<Vec<_>>>()?;
    if let Some(small) = images.iter().position(|image| image.width().min(image.height()) < WINDOW) {
        return Err(format!("image {small}: is smaller than {WINDOW} texels a side").into());
    }
    let mut encoder = TiffEncoder::new_big(BufWriter::new(File::create(path)?))?;
    let mut written = encoder.new_image::<RGB8>(side, side)?;
    written.rows_per_strip(ROWS)?;
    let window = |row: u32, column: u32| {
        let random = |n: u32| hash(&[row, column, n]);
        let image = &images[random(0) as usize % images.len()];
        let corner = |n, length: u32| random(n) % (length - WINDOW + 1);
        let (left, top) = (corner(1, image.width()), corner(2, image.height()));
        let [flip_x, flip_y, swap] = [1, 2, 4].map(|bit| random(3) & bit != 0);
        move |x: u32, y: u32| {
            let (x, y) = if swap { (y, x) } else { (x, y) };
            let flipped = |flip, at: u32| if flip { WINDOW - 1 - at } else { at };
            image.get_pixel(left + flipped(flip_x, x), top + flipped(flip_y, y)).0
        }
    };
    for top in (0..side).step_by(ROWS as usize) {
        let strip = over(ROWS.min(side - top) as usize, |row| {
            let y = top + row as u32;
            let texels = (0..side.div_ceil(WINDOW)).flat_map(|column| {
                let texel = window(y / WINDOW, column);
                (column * WINDOW..side.min((column + 1) * WINDOW))
                    .flat_map(move |x| texel(x % WINDOW, y % WINDOW))
            });
            texels.collect::<Vec<u8>>()
        });
        written.write_strip(&strip.concat())?;
    }
    written.finish()?;
    Ok(())
}

/// A number that looks random (FNV-1a, mixed).
fn hash(of: &[u32]) -> u32 {
    let mixed =
        of.iter().fold(0x811C_9DC5_u32, |hash, &n| (hash ^ n).wrapping_mul(0x0100_0193).rotate_left(13));
    (mixed ^ mixed >> 15).wrapping_mul(0x2C1B_3C6D) ^ mixed >> 12
}
