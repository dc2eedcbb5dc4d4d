//! What each part of the epitome's model pays: memory at one quality with everything and with each part left out.
//!
//! `cargo run --release -p texfold-benches --bin ablation -- [OUT_DIR]`: the middle of photographs, or fixtures where there are
//! none. Writes ablation.csv and ablation.md.

use std::path::PathBuf;

use texfold::core::image::{ImageSet, Raster};
use texfold::core::metric::measure;
use texfold::core::target::Measured;
use texfold::{
    Access, Effort, Goal,
    epitome::{EpitomeParams, Transforms},
};
use texfold_benches::report::{Outcome, Table, cpu_seconds, middle};

/// What all are encoded for.
const PSNR: f64 = 32.0;
/// Texels a side of what is taken from an image.
const SIDE: u32 = 512;
/// Sides of leaves without a quadtree; the best counts.
const SIDES: [u32; 3] = [8, 16, 32];

/// A part by name, and everything but that part.
fn variants() -> [(&'static str, Transforms); 9] {
    const ALL: Transforms = Transforms::ALL;
    [
        ("everything", ALL),
        ("no quarters of a texel", Transforms { fractions: false, ..ALL }),
        ("no mirrors", Transforms { mirrors: false, ..ALL }),
        ("no turning, shear, stretch", Transforms { affine: false, ..ALL }),
        ("no reduced content", Transforms { scales: false, ..ALL }),
        ("no gain and offset", Transforms { gain_offsets: false, ..ALL }),
        (
            "no palettes (the three above)",
            Transforms { mirrors: false, affine: false, gain_offsets: false, ..ALL },
        ),
        ("no quadtree", Transforms { quadtree: false, ..ALL }),
        ("no content from elsewhere", Transforms { references: false, ..ALL }),
    ]
}

fn main() -> Outcome<()> {
    let out = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "target/epitome".to_owned()));
    std::fs::create_dir_all(&out)?;
    let images = images()?;
    let sets: Vec<ImageSet> = images.iter().map(|(_, raster)| ImageSet::single(raster.clone())).collect();
    let mut columns = vec!["without".to_owned()];
    columns.extend(images.iter().map(|(name, _)| name.clone()));
    columns.push("CPU s".to_owned());
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let mut table = Table::new(&columns);
    let mut whole: Vec<f64> = Vec::new();
    for (name, transforms) in variants() {
        let before = cpu_seconds();
        let found: Vec<Measured> =
            sets.iter().map(|set| least(set, transforms)).collect::<Option<_>>().ok_or("no result")?;
        let seconds = cpu_seconds() - before;
        if whole.is_empty() {
            whole = found.iter().map(|found| found.bpp).collect();
        }
        let mut row = vec![name.to_owned()];
        for (found, whole) in found.iter().zip(&whole) {
            let missed = if found.psnr < PSNR { format!(", {:.1} dB", found.psnr) } else { String::new() };
            row.push(format!("{:.3} ({:+.1} %{missed})", found.bpp, 100.0 * (found.bpp / whole - 1.0)));
        }
        row.push(format!("{seconds:.0}"));
        table.row(row);
    }
    let text = format!(
        "Bits of memory a texel at {PSNR} dB, the middle {SIDE}x{SIDE} texels of each image, effort normal; CPU seconds of all \
         images together. Without the quadtree the best of leaves of 8, 16 and 32 texels.\n\
         `cargo run --release -p texfold-benches --bin ablation`"
    );
    table.write(&out, "ablation", &text)
}

/// The smallest form without some parts.
fn least(set: &ImageSet, transforms: Transforms) -> Option<Measured> {
    let goal = Goal::Psnr(PSNR);
    let sides = if transforms.quadtree { [None].to_vec() } else { SIDES.map(Some).to_vec() };
    let mut best: Option<Measured> = None;
    for block in sides {
        let params = EpitomeParams::new(goal)
            .with_access(Access::Texel)
            .with_block(block)
            .with_transforms(transforms)
            .with_effort(Effort::Normal);
        let measured = measure(set, texfold_benches::epitome(set, &params)?.as_encoded());
        if best.as_ref().is_none_or(|best| goal.prefers(&measured, best)) {
            best = Some(measured);
        }
    }
    best
}

/// Images of structure, and one of ground.
fn images() -> Outcome<Vec<(String, Raster)>> {
    let paths = match texfold_testkit::data_dir("the ablation on photographs") {
        Some(data) => [
            "epitome/urban100_021.png",
            "epitome/urban100_014.png",
            "epitome/urban100_100.png",
            "epitome/page_boston_cooking_a.jpg",
            "remote/neon_YELL_541000_4977000.png",
        ]
        .map(|name| data.join(name))
        .to_vec(),
        None => ["facade", "cloth", "text_page", "terrain"]
            .map(|name| texfold_testkit::fixtures_dir().join(format!("images/{name}.png")))
            .to_vec(),
    };
    let image = |path: &PathBuf| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok((name, middle(&texfold_testkit::png(path), SIDE, SIDE)?))
    };
    paths.iter().map(image).collect()
}
