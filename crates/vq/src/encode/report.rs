//! What an encode says of itself: settings, verdict, ledger, images of the parts.

use texfold_core::image::{ColorSpace, PartImages, PixelInfo, Raster};
use texfold_core::metric::{SquaredError, color_error, decode_image};
use texfold_core::{EncodeError, Encoded, Goal, ImageSize, Texel};

use super::assemble::{assign, corners_of, windows_at};
use super::single::Prepared;
use crate::classes::blocks_of;
use crate::grid::Grid;
use crate::{GuidanceWeights, VqParams, VqTexture};

/// The settings in the words of the command line.
pub(crate) fn settings(params: &VqParams) -> String {
    let mut words = vec!["--codec vq".to_owned()];
    words.push(match (params.codebook, params.goal) {
        (Some((width, height)), _) => format!("--codebook {width}x{height}"),
        (None, Goal::Psnr(psnr)) => format!("--psnr {psnr}"),
        (None, Goal::Bpp(bpp)) => format!("--bpp {bpp}"),
        (None, Goal::Tolerance(tolerance)) => format!("--tolerance {tolerance}"),
    });
    if let Some((count, side)) = params.samples {
        words.push(format!("--samples {count}x{side}"));
    }
    if params.importance != VqParams::default().importance {
        words.push(format!("--importance {}", params.importance));
    }
    let GuidanceWeights { usability, saliency, distortion, painted } = params.weights;
    if params.weights != GuidanceWeights::default() {
        words.push(format!(
            "--weights usability={usability},saliency={saliency},distortion={distortion},painted={painted}"
        ));
    }
    if let Some(content) = params.content {
        words.push(format!("--content {}", content.name()));
    }
    if params.mips {
        words.push("--mips".to_owned());
    }
    words.join(" ")
}

/// What was modelled and what was left out, in a sentence.
pub(crate) fn verdict(texture: &VqTexture, met: bool) -> String {
    let (width, height) = texture.codebook_size();
    let cells = Grid::of_texels((width, height)).free_cells(texture.samples()).len()
        - texture.parts.free_cells as usize;
    let content = texture.content().name().to_uppercase();
    let samples = match texture.samples() {
        [] => "no sample (none lowered the weighted error)".to_owned(),
        [one] => format!("one sample of {0}x{0} texels", one.side),
        many => format!("{} samples of {1}x{1} texels", many.len(), many[0].side),
    };
    let missed = if met { "" } else { "; the goal is out of reach of the largest codebook" };
    let gray = if texture.layout().pixel.channels < 3 { " of gray" } else { "" };
    format!("{samples} and {cells} codewords{gray} in a {width}x{height} {content} codebook{missed}.")
}

/// PSNR with the samples left out, and with the codewords left out: blocks then take the best of what remains.
pub(crate) fn ledger(
    prepared: &Prepared<'_>,
    texture: &VqTexture,
) -> Result<Vec<(String, f32)>, EncodeError> {
    let (samples, codewords) = corners_of(texture);
    let mut ledger = Vec::new();
    if !samples.is_empty() {
        for (part, left) in [("samples", &codewords), ("codewords", &samples)] {
            if !left.is_empty() {
                ledger.push((part.to_owned(), psnr_with(prepared, texture, left)?));
            }
        }
    }
    Ok(ledger)
}

fn psnr_with(prepared: &Prepared<'_>, texture: &VqTexture, corners: &[[u8; 2]]) -> Result<f32, EncodeError> {
    let windows =
        windows_at(texture.codebook_texels(), texture.codebook_size().0, corners, prepared.blocks.channels);
    let rows: Vec<usize> =
        (0..prepared.images().len()).flat_map(|which| prepared.blocks.of_level0(which)).collect();
    let matches = assign(&prepared.blocks, &rows, windows.view(), prepared.cancel)?;
    let mut other = texture.clone();
    let mut next = matches.iter();
    for place in &texture.parts.places {
        let class = &mut other.parts.classes[place.class];
        let size = ImageSize { width: class.params.size[0], height: class.params.size[1] };
        for block in 0..blocks_of(size, 1) {
            let position = class.position(place.number, block);
            class.index[position] = next.next().map_or([0; 2], |found| corners[found.index as usize]);
        }
    }
    let error = prepared.reference.images().iter().enumerate().filter_map(|(which, image)| {
        decode_image(&other, which as u32, 0).map(|decoded| color_error(image, &decoded))
    });
    Ok(error.fold(SquaredError::default(), |sum, error| sum + error).psnr() as f32)
}

/// Draws the parts of `texture`; `None` only where an image cannot be made at all.
///
/// - "codebook": with samples framed in red and unused cells black.
/// - "index": for each image the place that every block points at: red is the column, green the row, blue a sample.
/// - "usage": for each image how often what a block points at is used: white once, darker more often.
#[must_use]
pub fn part_images(texture: &VqTexture) -> Option<Vec<PartImages>> {
    let images = 0..texture.layout().images.len() as u32;
    let counts = use_counts(texture);
    let index = images
        .clone()
        .filter_map(|image| draw_blocks(texture, image, &|at| place_color(texture, at)))
        .collect();
    let shade = |[x, y]: [u8; 2]| {
        let count = counts[usize::from(y) * 256 + usize::from(x)];
        Texel::splat(1.0 / (1.0 + (count.max(1) as f32).log2())).truncate().extend(1.0)
    };
    let usage = images.filter_map(|image| draw_blocks(texture, image, &shade)).collect();
    Some(vec![
        PartImages { name: "codebook", images: vec![draw_codebook(texture)?] },
        PartImages { name: "index", images: index },
        PartImages { name: "usage", images: usage },
    ])
}

fn rgb(width: u32, height: u32, texels: &[Texel]) -> Option<Raster> {
    let info = PixelInfo { channels: 3, color: ColorSpace::Srgb, ..PixelInfo::default() };
    Raster::from_texels(width, height, info, texels).ok()
}

fn draw_codebook(texture: &VqTexture) -> Option<Raster> {
    let (width, height) = texture.codebook_size();
    let mut texels = texture.codebook_texels().to_vec();
    let frame = Texel::new(1.0, 0.1, 0.1, 1.0);
    for part in texture.samples() {
        for step in 0..part.side {
            let ends = [(step, 0), (step, part.side - 1), (0, step), (part.side - 1, step)];
            for (x, y) in ends {
                texels[((part.y + y) * width + part.x + x) as usize] = frame;
            }
        }
    }
    rgb(width, height, &texels)
}

fn place_color(texture: &VqTexture, [x, y]: [u8; 2]) -> Texel {
    let (column, row) = (u32::from(x), u32::from(y));
    let inside = |at: u32, start: u32, side: u32| at >= start && at < start + side;
    let sample = texture
        .samples()
        .iter()
        .any(|part| inside(column, part.x, part.side) && inside(row, part.y, part.side));
    Texel::new(f32::from(x) / 255.0, f32::from(y) / 255.0, if sample { 1.0 } else { 0.0 }, 1.0)
}

fn use_counts(texture: &VqTexture) -> Vec<u32> {
    let mut counts = vec![0u32; 256 * 256];
    for place in &texture.parts.places {
        let class = &texture.parts.classes[place.class];
        for block in 0..class.blocks() {
            let [x, y] = class.index[class.position(place.number, block)];
            counts[usize::from(y) * 256 + usize::from(x)] += 1;
        }
    }
    counts
}

/// One texel a block of level 0.
fn draw_blocks(texture: &VqTexture, image: u32, color: &dyn Fn([u8; 2]) -> Texel) -> Option<Raster> {
    let place = texture.parts.places.get(image as usize)?;
    let class = &texture.parts.classes[place.class];
    let (columns, rows) = texture.layout().images[image as usize].blocks();
    let texels: Vec<Texel> =
        (0..columns * rows).map(|block| color(class.index[class.position(place.number, block)])).collect();
    rgb(columns, rows, &texels)
}
