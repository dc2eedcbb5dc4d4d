//! How well descriptors foresee what affine matching accepts, and how long a search takes.
//!
//! `cargo run --release -p texfold-benches --bin gsr`: the accuracy factor IR of "Progressive compression of large-scale
//! remote sensing images with GSR descriptors", 2012, section 6.1.2: of the patches that affine refinement, gain and offset bring
//! within an RMS of 0.7 of a block's contrast, the share among the block's 500 nearest by descriptor. Six aerial images,
//! middle 512 x 512, blocks of 16 x 16 every 8 texels; blocks that nothing or more than 500 patches match are left out. Against it
//! stand histograms of colour and of orientation, 16 buckets each, the latter turned by the main direction. Then the search of 1024 x 1024
//! texels for 250 neighbours of each of 4096 blocks among patches every 4 and every 8 texels.

use std::error::Error;
use std::time::Instant;

use texfold::core::CancelCheck;
use texfold::core::image::Raster;
use texfold_benches::report::cpu_seconds;
use texfold_match::{Freedom, GrayPlane, GsrIndex, GsrInput, Refiner, Transform};

/// Images in the folder `remote` of the data.
const IMAGES: [&str; 6] = [
    "naip_m_4709963_20090818.tif",
    "brighton_DJI_0022.jpg",
    "caliterra_IMG_9366.jpg",
    "neon_YELL_541000_4977000.png",
    "seneca_IMG_0456.jpg",
    "bluemarble_5400x2700.jpg",
];
/// Texels a side of a block.
const SIDE: usize = 16;
/// Share of a block's contrast that a match may leave.
const ACCEPTED: f32 = 0.7;
/// Neighbours by descriptor.
const NEAREST: usize = 500;
/// Blocks of an image that are searched for.
const ASKED: usize = 48;
/// Buckets of a histogram.
const BUCKETS: usize = 16;

fn main() -> Result<(), Box<dyn Error>> {
    let Some(data) = texfold_testkit::data_dir("accuracy of descriptors") else { return Ok(()) };
    let mut rows = Vec::new();
    println!("| image | blocks | matches a block | GSR, gray | GSR, shape | histograms | by chance |");
    println!("|---|---|---|---|---|---|---|");
    for name in IMAGES {
        let original = texfold_testkit::png(&data.join("remote").join(name)).with_channels(3);
        let row = study(&middle(&original, 512)?);
        let [gray, shape, histograms, chance] = row.ratios;
        println!(
            "| {name} | {} | {:.0} | {gray:.3} | {shape:.3} | {histograms:.3} | {chance:.3} |",
            row.blocks, row.matches
        );
        rows.push((name, row));
    }
    let mean = |index: usize| rows.iter().map(|(_, row)| row.ratios[index]).sum::<f64>() / rows.len() as f64;
    println!("| mean | | | {:.3} | {:.3} | {:.3} | {:.3} |", mean(0), mean(1), mean(2), mean(3));
    let original = texfold_testkit::png(&data.join("remote").join(IMAGES[4])).with_channels(3);
    for stride in [4, 8] {
        time(&middle(&original, 1024)?, stride);
    }
    Ok(())
}

/// What was found in one image: IR of gray values, of shapes, of histograms, and of a choice by chance.
struct Row {
    blocks: usize,
    matches: f64,
    ratios: [f64; 4],
}

fn luma(image: &Raster) -> Vec<f32> {
    image.texels().map(|texel| (texel.x + texel.y + texel.z) * 85.0).collect()
}

fn study(image: &Raster) -> Row {
    let width = image.size().width as usize;
    let luma = luma(image);
    let plane = GrayPlane::new(width, &luma, 1.6, CancelCheck::default());
    let places: Vec<glam::Vec2> = (1..width / 8 - 2)
        .flat_map(|y| (1..width / 8 - 2).map(move |x| glam::Vec2::new(x as f32, y as f32) * 8.0 + 8.0))
        .collect();
    let patches: Vec<_> = places.iter().map(|&place| (0, place, SIDE as f32)).collect();
    let gray = GsrIndex::new(&[&plane], &patches, 4, GsrInput::Gray, 0.0, CancelCheck::default());
    let shape = GsrIndex::new(&[&plane], &patches, 4, GsrInput::Shape, 0.0, CancelCheck::default());
    let histograms: Vec<_> = places.iter().map(|&place| histogram(image, &luma, place)).collect();
    let step = places.len() / ASKED;
    let mut row = Row { blocks: 0, matches: 0.0, ratios: [0.0; 4] };
    for wanted in (step / 2..places.len()).step_by(step) {
        let accepted = accepted(&luma, width, &places, places[wanted], &plane);
        if accepted.is_empty() || accepted.len() > NEAREST {
            continue;
        }
        row.blocks += 1;
        row.matches += accepted.len() as f64;
        let found = |index: &GsrIndex| {
            let mut found: Vec<glam::Vec2> = Vec::new();
            for near in index.nearest(&plane, (places[wanted], SIDE as f32), 100.0, NEAREST + 1) {
                if near.patch.centre != places[wanted] && !found.contains(&near.patch.centre) {
                    found.push(near.patch.centre);
                }
            }
            found.truncate(NEAREST);
            accepted.iter().filter(|&&place| found.contains(&places[place])).count()
        };
        let mut by_histogram: Vec<usize> = (0..places.len()).filter(|&place| place != wanted).collect();
        let away = |place: usize| -> f32 {
            histograms[wanted].iter().zip(&histograms[place]).map(|(a, b)| (a - b) * (a - b)).sum()
        };
        by_histogram.sort_by(|&a, &b| away(a).total_cmp(&away(b)));
        let near = &by_histogram[..NEAREST];
        let counts =
            [found(&gray), found(&shape), accepted.iter().filter(|place| near.contains(place)).count()];
        for (ratio, count) in row.ratios.iter_mut().zip(counts) {
            *ratio += count as f64 / accepted.len() as f64;
        }
        row.ratios[3] += NEAREST as f64 / places.len() as f64;
    }
    let blocks = row.blocks.max(1) as f64;
    Row { matches: row.matches / blocks, ratios: row.ratios.map(|ratio| ratio / blocks), ..row }
}

/// The patches that affine refinement brings near enough to the block at `wanted`.
fn accepted(
    luma: &[f32],
    width: usize,
    places: &[glam::Vec2],
    wanted: glam::Vec2,
    plane: &GrayPlane,
) -> Vec<usize> {
    let half = SIDE as f32 / 2.0;
    let (left, top) = ((wanted.x - half) as usize, (wanted.y - half) as usize);
    let target: Vec<f32> =
        (0..SIDE * SIDE).map(|i| luma[(top + i / SIDE) * width + left + i % SIDE]).collect();
    let refiner = Refiner::new(&target, (SIDE, SIDE));
    let own = plane.direction(wanted, SIDE as f32);
    let mean = target.iter().sum::<f32>() / target.len() as f32;
    let squares: f32 = target.iter().map(|value| (value - mean) * (value - mean)).sum();
    let matches = |&(_, &place): &(usize, &glam::Vec2)| {
        if (place - wanted).abs().max_element() < SIDE as f32 {
            return false;
        }
        let matrix = glam::Mat2::from_angle(plane.direction(place, SIDE as f32) - own);
        let seed = Transform { position: place, matrix };
        let found = refiner.refine(luma, (width, luma.len() / width), seed, Freedom::Affine);
        found.error <= ACCEPTED * ACCEPTED * squares && found.transform.position.distance(place) < half
    };
    places.iter().enumerate().filter(matches).map(|(index, _)| index).collect()
}

/// Shares of colours, and of the gradients' directions from the main one.
fn histogram(image: &Raster, luma: &[f32], place: glam::Vec2) -> [f32; 2 * BUCKETS] {
    let width = image.size().width as usize;
    let half = SIDE / 2;
    let (left, top) = (place.x as usize - half, place.y as usize - half);
    let (mut colours, mut directions) = ([0.0f32; BUCKETS], [0.0f32; BUCKETS]);
    for i in 0..SIDE * SIDE {
        let (x, y) = (left + i % SIDE, top + i / SIDE);
        let texel = image.texel(x as u32, y as u32);
        // Four ranges of brightness, and which of red and green, of green and blue is the larger.
        let brightness = (luma[y * width + x] / 64.0).min(3.0) as usize;
        let hue = usize::from(texel.x > texel.y) + 2 * usize::from(texel.y > texel.z);
        colours[4 * brightness + hue] += 1.0 / (SIDE * SIDE) as f32;
        let across = luma[y * width + (x + 1).min(width - 1)] - luma[y * width + x - 1];
        let down = luma[(y + 1).min(width - 1) * width + x] - luma[(y - 1) * width + x];
        let angle = down.atan2(across).rem_euclid(std::f32::consts::TAU) / std::f32::consts::TAU;
        directions[(angle * BUCKETS as f32) as usize % BUCKETS] += across.hypot(down);
    }
    let sum: f32 = directions.iter().sum::<f32>().max(1e-6);
    let main = (0..BUCKETS).max_by(|&a, &b| directions[a].total_cmp(&directions[b])).unwrap_or(0);
    std::array::from_fn(|index| match index.checked_sub(BUCKETS) {
        None => colours[index],
        Some(index) => directions[(index + main) % BUCKETS] / sum,
    })
}

/// The search of a whole image.
fn time(image: &Raster, stride: usize) {
    let width = image.size().width as usize;
    let luma = luma(image);
    let start = Instant::now();
    let plane = GrayPlane::new(width, &luma, 1.6, CancelCheck::default());
    let count = (width - SIDE) / stride;
    let place = move |i: usize| glam::Vec2::new((i % count) as f32, (i / count) as f32) * stride as f32;
    let patches: Vec<_> = (0..count * count).map(|i| (0, place(i) + SIDE as f32 / 2.0, 16.0)).collect();
    let index = GsrIndex::new(&[&plane], &patches, 4, GsrInput::Gray, 0.0, CancelCheck::default());
    let described = start.elapsed().as_secs_f64();
    let blocks = width / SIDE;
    let cpu = cpu_seconds();
    let found: usize = texfold_benches::over(blocks * blocks, |block| {
        let place = glam::Vec2::new((block % blocks) as f32 + 0.5, (block / blocks) as f32 + 0.5);
        // Half of the neighbours as they are, half reflected.
        index.nearest(&plane, (place * SIDE as f32, SIDE as f32), 100.0, 125).len()
    })
    .into_iter()
    .sum();
    println!(
        "\n{} patches described in {described:.2} s; {} blocks searched in {:.2} s, {:.2} CPU s, {} neighbours each",
        index.len(),
        blocks * blocks,
        start.elapsed().as_secs_f64() - described,
        cpu_seconds() - cpu,
        found / (blocks * blocks)
    );
}

/// The middle of a large image, or all of another.
fn middle(image: &Raster, side: u32) -> Result<Raster, Box<dyn Error>> {
    let size = image.size();
    let side = side.min(size.width).min(size.height) / 16 * 16;
    let (left, top) = ((size.width - side) / 2, (size.height - side) / 2);
    let texels: Vec<_> = (0..side * side).map(|i| image.texel(left + i % side, top + i / side)).collect();
    Ok(Raster::from_texels(side, side, image.info(), &texels)?)
}
