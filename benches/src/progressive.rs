//! Base and residual plane beside plain BC1 at 4 bits a texel, as a table in Markdown.
//!
//! `cargo run --release -p texfold-benches --bin progressive -- [small] [IMAGE …]`: of images larger than that the middle
//! 1024 x 1024; without images, six aerial and satellite images where they are. Memory is all that a GPU holds, without mips.
//! With `small`, half a bit a texel and fewer, beside BC1 of a quarter of the width and height.

use std::error::Error;
use std::path::PathBuf;

use texfold::core::image::{ImageSet, Raster};
use texfold::core::metric::measure;
use texfold::{
    Content, Goal, Job, Metric,
    bc::{Bc, BcParams},
    core::{Encoder, SharedSearch},
    progressive::{Progressive, ProgressiveParams},
};

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
/// Bits a texel of ASTC 12x12 at half of the size, of BC1 at a quarter, and the paper's 2% without residual plane.
const SMALL: [f64; 3] = [0.2222, 0.25, 0.5];
/// Plain blocks, and halvings of width and height.
const RIVALS: [(&str, Content, u32); 1] = [("BC1, 4", Content::Bc1, 0)];
const SMALL_RIVALS: [(&str, Content, u32); 1] = [("BC1 of 1/4, 0.25", Content::Bc1, 2)];
/// Largest side that is left.
const SIDE: u32 = 1024;

fn main() -> Result<(), Box<dyn Error>> {
    let mut given: Vec<PathBuf> = std::env::args().skip(1).map(PathBuf::from).collect();
    let small = given.first().is_some_and(|first| first.as_os_str() == "small");
    given.drain(..usize::from(small));
    let images = match texfold_testkit::data_dir("base and residual plane beside BC1") {
        Some(data) if given.is_empty() => IMAGES.map(|name| data.join("remote").join(name)).to_vec(),
        _ => given,
    };
    let (sizes, rivals) = if small { (&SMALL[..], &SMALL_RIVALS[..]) } else { (&SIZES[..], &RIVALS[..]) };
    let head: Vec<String> = rivals
        .iter()
        .map(|(name, ..)| format!(" {name} |"))
        .chain(sizes.iter().map(|size| format!(" {size} |")))
        .collect();
    println!("| image |{}", head.concat());
    println!("|---|{}", "---|".repeat(head.len()));
    let mut sums = vec![0.0; head.len()];
    for path in &images {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let set = ImageSet::single(middle(texfold_testkit::png(path).with_channels(3))?);
        let mut row = Vec::new();
        for &(_, content, reduce_log2) in rivals {
            let params = BcParams::default()
                .with_goal(Goal::Bpp(1e6))
                .with_content(content)
                .with_reduce_log2(reduce_log2);
            row.push(measure(&set, &Bc::encode(&set, &params, &mut Job::default())?).psnr);
        }
        let params = ProgressiveParams::default().with_goal(Goal::Bpp(sizes[0])).with_metric(Metric::Psnr);
        let search = Progressive::search(&set, &params, &mut Job::default())?;
        for &size in sizes {
            let texture = Progressive::encode_from(&search, Goal::Bpp(size), &mut Job::default())?;
            row.push(measure(&set, &texture).psnr);
        }
        sums.iter_mut().zip(&row).for_each(|(sum, psnr)| *sum += psnr);
        println!("| {name} |{}", row.iter().map(|psnr| format!(" {psnr:.2} |")).collect::<String>());
    }
    let mean = |sum: &f64| format!(" {:.2} |", sum / images.len().max(1) as f64);
    println!("| mean |{}", sums.iter().map(mean).collect::<String>());
    Ok(())
}

/// The middle of a large image, or all of another.
fn middle(image: Raster) -> Result<Raster, Box<dyn Error>> {
    let size = image.size();
    let (width, height) = (size.width.min(SIDE), size.height.min(SIDE));
    let (left, top) = ((size.width - width) / 2, (size.height - height) / 2);
    let texel = |i: u32| image.texel(left + i % width, top + i / width);
    let texels: Vec<_> = (0..width * height).map(texel).collect();
    Ok(Raster::from_texels(width, height, image.info(), &texels)?)
}
