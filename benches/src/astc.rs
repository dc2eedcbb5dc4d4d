//! Epitomes with ASTC content beside plain ASTC of equal memory, as a table in Markdown.
//!
//! `cargo run --release -p texfold-benches --features astc --bin astc -- [CONTENT] [IMAGE …]`: content by its name,
//! such as astc8, or chosen by the goal; of images above two megatexels the middle 1024 x 1024; without images, eight
//! photographs of structure where they are. Memory is all that a GPU holds, without mips; plain ASTC is the codec `bc` with
//! the same encoder at the same effort. `benches/astc.md` is what it gave.

use std::error::Error;
use std::path::PathBuf;

use texfold::core::image::{ImageSet, Raster};
use texfold::core::metric::measure;
use texfold::core::target::Measured;
use texfold::{
    Content, Family, Goal, Job,
    bc::{Bc, BcParams},
    core::{AstcBlock, Encoder, SharedSearch},
    epitome::{Epitome, EpitomeParams, EpitomeSource},
};

/// Photographs of structure, in the folder `epitome` of the data.
const PHOTOGRAPHS: [&str; 8] = [
    "urban100_014.png",
    "urban100_021.png",
    "urban100_034.png",
    "urban100_091.png",
    "urban100_100.png",
    "aloeL.jpg",
    "page_boston_cooking_a.jpg",
    "roofs1.jpg",
];
/// Plain forms, by rising bits.
const PLAIN: [AstcBlock; 3] = [AstcBlock::B12, AstcBlock::B10, AstcBlock::B8];
/// Bits a texel beside those of 12x12 and 10x10 blocks.
const BETWEEN: f64 = 1.7;
/// Texels above which an image is cut, and the side that is left.
const LARGE: (u64, u32) = (2 << 20, 1024);

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1).peekable();
    let named = |name: &String| Content::ALL.into_iter().find(|content| content.name() == name);
    let content = arguments.peek().and_then(named);
    let given: Vec<PathBuf> = arguments.skip(usize::from(content.is_some())).map(PathBuf::from).collect();
    let images = match texfold_testkit::data_dir("epitomes beside plain ASTC") {
        Some(data) if given.is_empty() => PHOTOGRAPHS.map(|name| data.join("epitome").join(name)).to_vec(),
        _ => given,
    };
    println!(
        "| image | bits a texel | plain ASTC dB | epitome bits a texel | epitome dB | gain dB | gain with residual plane, dB |"
    );
    println!("|---|---|---|---|---|---|---|");
    let (mut gains, mut with_residual_planes) = (Vec::new(), Vec::new());
    for path in &images {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let set = ImageSet::single(middle(texfold_testkit::png(path))?);
        let plain: Vec<Measured> =
            PLAIN.into_iter().map(|block| plain(&set, block)).collect::<Result<_, _>>()?;
        let params = EpitomeParams::new(Goal::Bpp(BETWEEN)).with_content(content).with_family(Family::Astc);
        let search = Epitome::search(EpitomeSource::new(&set), &params, &mut Job::default())?;
        for bpp in [plain[0].bpp, plain[1].bpp, BETWEEN] {
            let texture = Epitome::encode_from(&search, Goal::Bpp(bpp), &mut Job::default())?;
            let ours = measure(&set, &texture);
            let theirs = between(&plain, bpp);
            let gain = ours.psnr - theirs;
            // Content that any GPU can read, once an image.
            let other = if bpp == plain[1].bpp {
                let gain = with_errors(&set, bpp)?.psnr - theirs;
                with_residual_planes.push(gain);
                format!("{gain:+.2}")
            } else {
                String::new()
            };
            println!(
                "| {name} | {bpp:.2} | {theirs:.2} | {:.2} | {:.2} | {gain:+.2} | {other} |",
                ours.bpp, ours.psnr
            );
            gains.push(gain);
        }
    }
    let mean = |gains: &[f64]| gains.iter().sum::<f64>() / gains.len().max(1) as f64;
    println!("| mean | | | | | {:+.2} | {:+.2} |", mean(&gains), mean(&with_residual_planes));
    Ok(())
}

/// An epitome with a residual plane, of at most so many bits a texel.
fn with_errors(set: &ImageSet, bpp: f64) -> Result<Measured, Box<dyn Error>> {
    let params = EpitomeParams::new(Goal::Bpp(bpp)).with_family(Family::ErrorMap);
    Ok(measure(set, &Epitome::encode(EpitomeSource::new(set), &params, &mut Job::default())?))
}

/// The middle of a large image, or all of another.
fn middle(image: Raster) -> Result<Raster, Box<dyn Error>> {
    let size = image.size();
    if size.texels() <= LARGE.0 {
        return Ok(image);
    }
    let (width, height) = (size.width.min(LARGE.1), size.height.min(LARGE.1));
    let (left, top) = ((size.width - width) / 2, (size.height - height) / 2);
    let texel = |i: u32| image.texel(left + i % width, top + i / width);
    let texels: Vec<_> = (0..width * height).map(texel).collect();
    Ok(Raster::from_texels(width, height, image.info(), &texels)?)
}

fn plain(set: &ImageSet, block: AstcBlock) -> Result<Measured, Box<dyn Error>> {
    let content = Some(Content::Astc(block));
    let params = BcParams::default().with_goal(Goal::Bpp(8.1)).with_content(content).with_reduce_log2(0);
    Ok(measure(set, &Bc::encode(set, &params, &mut Job::default())?))
}

/// PSNR at `bpp`, on the line between the two plain forms around it.
fn between(plain: &[Measured], bpp: f64) -> f64 {
    let upper = plain.iter().position(|form| form.bpp >= bpp).unwrap_or(plain.len() - 1).max(1);
    let (low, high) = (&plain[upper - 1], &plain[upper]);
    low.psnr + (high.psnr - low.psnr) * (bpp - low.bpp) / (high.bpp - low.bpp)
}
