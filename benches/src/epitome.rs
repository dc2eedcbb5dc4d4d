//! The paper's regime: raw content, blocks of one side, a tolerance. What it saves on each image (Table 1 of the paper), and
//! memory against the side of blocks and against the tolerance (Figures 21 and 22).
//!
//! `cargo run --release -p texfold-benches --bin epitome -- [OUT_DIR] [IMAGE.png …]`: the middle of each image, 504 x 504
//! texels at most; without images, photographs where they are, and fixtures. Writes epitome.csv, epitome.md, block.csv,
//! block.svg, tolerance.csv and tolerance.svg.

use std::path::PathBuf;

use texfold::core::image::ImageSet;
use texfold::core::metric::measure;
use texfold::{
    Content, Encoded, Goal, Job,
    core::SharedSearch,
    epitome::{Epitome, EpitomeParams, EpitomeSource},
};
use texfold_benches::FACTORED_PHOTOGRAPHS;
use texfold_benches::report::{Line, Outcome, Table, chart, cpu_seconds, middle, rms_percent};
use texfold_chart::Scale;

/// Sides of blocks that are charted.
const BLOCKS: [u32; 7] = [8, 12, 16, 20, 24, 28, 32];
/// Tolerances that are charted: RMS error of the worst 4x4 block, 8-bit units.
const TOLERANCES: [f64; 8] = [4.0, 6.0, 10.0, 16.0, 24.0, 32.0, 44.0, 64.0];
/// Side of blocks where tolerances are charted (the paper's).
const BLOCK: u32 = 12;
/// RMS error in percent at which savings are listed, and at which sides of blocks are compared (the paper's examples have
/// 1.4 to 5.4, most of them about 2.5).
const RMS_PERCENT: f64 = 2.5;
/// Texels a side of what is taken from an image.
const SIDE: u32 = 504;
/// Images that are charted.
const CHARTED: [&str; 4] = ["facade", "skimage_brick", "urban100_021", "urban100_100"];
/// What an encode came to.
#[derive(Debug, Clone, Copy)]
struct Point {
    block: u32,
    tolerance: f64,
    /// Memory of all, of the epitome and of the map, as shares of the source's bytes.
    share: f64,
    epitome: f64,
    map: f64,
    rms: f64,
    size: (u32, u32),
}

fn main() -> Outcome<()> {
    let mut arguments = std::env::args().skip(1);
    let out = PathBuf::from(arguments.next().unwrap_or_else(|| "target/epitome".to_owned()));
    let given: Vec<PathBuf> = arguments.map(PathBuf::from).collect();
    std::fs::create_dir_all(&out)?;
    let paths = if given.is_empty() { usual_images() } else { given.clone() };
    let columns = ["image", "size", "epitome", "tolerance", "savings", "RMS", "CPU s"];
    let mut savings = Table::new(&columns);
    let columns = ["image", "side", "tolerance", "share of raw", "of it epitome", "of it map", "RMS"];
    let (mut blocks, mut tolerances) = (Table::new(&columns), Table::new(&columns));
    let (mut by_block, mut by_tolerance): (Vec<Line>, Vec<Line>) = Default::default();
    for path in &paths {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let set = ImageSet::single(middle(&texfold_testkit::png(path), SIDE, SIDE)?);
        let before = cpu_seconds();
        let points = points(&set, BLOCK, &TOLERANCES)?;
        let seconds = (cpu_seconds() - before) / TOLERANCES.len() as f64;
        let away = |point: &Point| (point.rms / RMS_PERCENT).ln().abs();
        let Some(nearest) = points.iter().min_by(|a, b| away(a).total_cmp(&away(b))) else { continue };
        let size = set.images()[0].size();
        savings.row(vec![
            name.clone(),
            format!("{}×{}", size.width, size.height),
            format!("{}×{}", nearest.size.0, nearest.size.1),
            format!("{}", nearest.tolerance),
            format!("{:.2}", 1.0 / nearest.share),
            format!("{:.2} %", nearest.rms),
            format!("{seconds:.1}"),
        ]);
        points.iter().for_each(|point| tolerances.row(point.row(&name)));
        if given.is_empty() && !CHARTED.contains(&name.as_str()) {
            continue;
        }
        let line = points.iter().map(|point| (point.tolerance, point.share)).collect();
        by_tolerance.push((name.clone(), line));
        let mut line = Vec::new();
        for block in BLOCKS {
            for point in self::points(&set, block, &[nearest.tolerance])? {
                blocks.row(point.row(&name));
                line.push(point);
            }
        }
        by_block.extend(lines_of(&name, &line, by_block.is_empty()));
    }
    let text = format!(
        "Raw content, blocks of {BLOCK} texels, the middle {SIDE}×{SIDE} texels at most of each image: source bytes over bytes of \
         memory, at the tolerance (RMS error of the worst 4×4 block, 8-bit units) whose RMS error comes nearest to {RMS_PERCENT} % \
         of the full range.\n`cargo run --release -p texfold-benches --bin epitome`"
    );
    savings.write(&out, "epitome", &text)?;
    blocks.write(&out, "block", "Memory against the side of blocks, at the tolerances of epitome.md.")?;
    tolerances.write(&out, "tolerance", "Memory against the tolerance, blocks of 12 texels.")?;
    let up = ("share of raw memory", Scale::Linear);
    let axes = [("texels a side", Scale::Linear), up];
    chart(&out.join("block.svg"), "Memory against the side of blocks", axes, &by_block)?;
    let across = "RMS error of the worst 4x4 block, 8-bit units";
    chart(
        &out.join("tolerance.svg"),
        "Memory against tolerance",
        [(across, Scale::Linear), up],
        &by_tolerance,
    )
}

/// Total memory by side of blocks, and what of it is map and epitome where `parts` are wanted.
fn lines_of(name: &str, points: &[Point], parts: bool) -> Vec<Line> {
    let line =
        |of: fn(&Point) -> f64| points.iter().map(|point| (f64::from(point.block), of(point))).collect();
    let mut lines = vec![(name.to_owned(), line(|point| point.share))];
    if parts {
        lines.push((format!("{name}: epitome"), line(|point| point.epitome)));
        lines.push((format!("{name}: map"), line(|point| point.map)));
    }
    lines
}

fn usual_images() -> Vec<PathBuf> {
    let fixture = |name: &str| texfold_testkit::fixtures_dir().join(format!("images/{name}.png"));
    let mut paths = ["facade", "tile_repeat", "cloth"].map(fixture).to_vec();
    if let Some(data) = texfold_testkit::data_dir("the charts on photographs") {
        paths.extend(FACTORED_PHOTOGRAPHS.map(|name| data.join("epitome").join(name)));
    }
    paths
}

/// One search for all tolerances, the loosest of them in mind (paper section 4.1).
fn points(set: &ImageSet, block: u32, tolerances: &[f64]) -> Outcome<Vec<Point>> {
    let loosest = tolerances.iter().copied().fold(0.0, f64::max);
    let params = EpitomeParams::new(Goal::Tolerance(loosest)).with_content(Content::Raw).with_block(block);
    let search = Epitome::search(EpitomeSource::new(set), &params, &mut Job::default())?;
    let raw = f64::from(8 * set.info().channels) * set.texel_count() as f64;
    let point = |&tolerance: &f64| {
        let texture = Epitome::encode_from(&search, Goal::Tolerance(tolerance), &mut Job::default())?;
        let measured = measure(set, &texture);
        // What a footprint counts of the file would be compressed for nothing.
        let form = texture.gpu();
        let part = |name: &str| {
            let planes = form.planes.iter().filter(|plane| plane.part == name);
            planes.map(|plane| 8.0 * plane.data.len() as f64 / raw).sum()
        };
        Ok(Point {
            block,
            tolerance,
            share: form.memory().compressed as f64 / raw,
            epitome: part("epitome"),
            map: part("map"),
            rms: rms_percent(measured.psnr),
            size: texture.epitomes().next().map_or((0, 0), |epitome| epitome.size()),
        })
    };
    tolerances.iter().map(point).collect()
}

impl Point {
    fn row(&self, name: &str) -> Vec<String> {
        vec![
            name.to_owned(),
            format!("{}", self.block),
            format!("{}", self.tolerance),
            format!("{:.4}", self.share),
            format!("{:.4}", self.epitome),
            format!("{:.4}", self.map),
            format!("{:.2} %", self.rms),
        ]
    }
}
