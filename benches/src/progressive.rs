//! Base and error map beside plain BC1 at 4 bits a texel, as a table in Markdown.
//!
//! `cargo run --release -p texfold-benches --bin progressive -- [PICTURE …]`: of pictures larger than that the middle
//! 1024 x 1024; without pictures, six aerial and satellite images where they are. Memory is all that a GPU holds, without mips.

use std::error::Error;
use std::path::PathBuf;

use texfold::image::{ImageSet, Raster};
use texfold::metric::measure;
use texfold::{Bc, BcParams, Content, Goal, Job, Progressive, ProgressiveParams, SharedSearch, TextureCodec};

/// Images in the folder `remote` of the data.
const IMAGES: [&str; 6] = [
    "naip_m_4709963_20090818.tif",
    "brighton_DJI_0022.jpg",
    "caliterra_IMG_9366.jpg",
    "neon_YELL_541000_4977000.png",
    "seneca_IMG_0456.jpg",
    "bluemarble_5400x2700.jpg",
];
/// Bits a texel: those of ASTC in blocks of 12x12, 10x10, 8x8 and 6x6, and two thirds of BC1's.
const SIZES: [f64; 5] = [0.89, 1.28, 2.0, 2.7, 3.56];
/// Largest side that is left.
const SIDE: u32 = 1024;

fn main() -> Result<(), Box<dyn Error>> {
    let given: Vec<PathBuf> = std::env::args().skip(1).map(PathBuf::from).collect();
    let pictures = match texfold_testkit::data_dir("base and error map beside BC1") {
        Some(data) if given.is_empty() => IMAGES.map(|name| data.join("remote").join(name)).to_vec(),
        _ => given,
    };
    let head = SIZES.map(|size| format!(" {size} |")).concat();
    println!("| picture | BC1, 4 |{head}");
    println!("|---|---|{}", "---|".repeat(SIZES.len()));
    let mut sums = [0.0; SIZES.len() + 1];
    for path in &pictures {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let set = ImageSet::single(middle(texfold_testkit::png(path).with_channels(3))?);
        let params = BcParams {
            goal: Goal::Bpp(5.0),
            content: Some(Content::Bc1),
            reduce_log2: Some(0),
            ..BcParams::default()
        };
        let mut row = vec![measure(&set, &Bc::encode(&set, &params, &mut Job::default())?).psnr];
        let params = ProgressiveParams { goal: Goal::Bpp(SIZES[0]), ..ProgressiveParams::default() };
        let search = Progressive::search(&set, &params, &mut Job::default())?;
        for size in SIZES {
            let texture = Progressive::encode_from(&search, Goal::Bpp(size), &mut Job::default())?;
            row.push(measure(&set, &texture).psnr);
        }
        sums.iter_mut().zip(&row).for_each(|(sum, psnr)| *sum += psnr);
        println!("| {name} |{}", row.iter().map(|psnr| format!(" {psnr:.2} |")).collect::<String>());
    }
    let mean = sums.map(|sum| format!(" {:.2} |", sum / pictures.len().max(1) as f64)).concat();
    println!("| mean |{mean}");
    Ok(())
}

/// The middle of a large picture, or all of another.
fn middle(picture: Raster) -> Result<Raster, Box<dyn Error>> {
    let size = picture.size();
    let (width, height) = (size.width.min(SIDE), size.height.min(SIDE));
    let (left, top) = ((size.width - width) / 2, (size.height - height) / 2);
    let texel = |i: u32| picture.texel(left + i % width, top + i / width);
    let texels: Vec<_> = (0..width * height).map(texel).collect();
    Ok(Raster::from_texels(width, height, picture.info(), &texels)?)
}
