//! A zoom into a flat texture: frames from the whole to a texel a pixel, and a strip of them.

use std::path::Path;

use glam::{Affine2, Mat2, Vec2};
use texfold::{AnyImage, zipmap::ZipTexture};
use texfold_core::image::{Alpha, MipFilter, PixelInfo, Raster, mip_chain};
use texfold_core::{ImageSize, Texel};
use texfold_gpu::{Gpu, GpuError, Lookup, Policy, View};

use super::RenderArgs;
use crate::config::Sides;
use crate::decompress;
use crate::error::CliError;
use crate::output::{make_folder, remove_stale};
use crate::png;

/// Frames where their number is not said.
const STEPS: u32 = 8;
/// Pixels of a frame where they are not said.
const SIZE: (u32, u32) = (512, 512);
/// Frames side by side in the strip.
const COLUMNS: usize = 4;
/// Name of the strip.
const STRIP_NAME: &str = "strip.png";
/// Zoom into images that are no larger than a frame.
const LEAST_ZOOM: f32 = 8.0;
/// Digits of a frame's number; more where there are more than a thousand.
const NUMBER_DIGITS: usize = 3;

/// The rectangle that a frame shows: its upper left corner and its extent in texture coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Shot {
    corner: Vec2,
    extent: Vec2,
}

/// Draws the frames and the strip.
pub(super) fn run(args: &RenderArgs, target: Vec2) -> Result<usize, CliError> {
    let image = decompress::load(&args.file, &args.memory.limits())?;
    let encoded = image.as_encoded();
    let size = args.size.map_or(SIZE, |Sides(width, height)| (width.clamp(1, 8192), height.clamp(1, 8192)));
    let shots = shots(encoded.layout().images[0], size, target, args.steps.unwrap_or(STEPS));
    make_folder(&args.out)?;
    remove_stale(&args.out);
    let draw = artist(args, &image, size)?;
    let digits = NUMBER_DIGITS.max((shots.len() - 1).to_string().len());
    let mut frames = Vec::new();
    for (number, shot) in shots.iter().enumerate() {
        let frame = draw(shot)?;
        png::write(&args.out.join(format!("{number:0digits$}.png")), &frame)?;
        frames.push(frame);
    }
    png::write(&args.out.join(STRIP_NAME), &strip(&args.file, &frames)?)?;
    Ok(0)
}

/// Rectangles of the frames' shape, the first as large as the texture holds, each smaller than the one before by the
/// same factor.
fn shots(texture: ImageSize, size: (u32, u32), target: Vec2, steps: u32) -> Vec<Shot> {
    let whole = Vec2::new(texture.width as f32, texture.height as f32);
    let frame = Vec2::new(size.0 as f32, size.1 as f32);
    // Texels a pixel.
    let first = (whole / frame).min_element();
    let last = if first > 1.0 { 1.0 } else { first / LEAST_ZOOM };
    let shot = |step: u32| {
        let part = step as f32 / (steps.max(2) - 1) as f32;
        let scale = first * (last / first).powf(part);
        let half = 0.5 * scale * frame / whole;
        let centre = target.clamp(half.min(Vec2::splat(0.5)), (1.0 - half).max(Vec2::splat(0.5)));
        Shot { corner: centre - half, extent: 2.0 * half }
    };
    (0..steps.max(1)).map(shot).collect()
}

type Artist<'t> = Box<dyn Fn(&Shot) -> Result<Raster, CliError> + 't>;

/// What draws: the reference, which only a zipmap has at any zoom, or a GPU.
fn artist<'t>(args: &'t RenderArgs, image: &'t AnyImage, size: (u32, u32)) -> Result<Artist<'t>, CliError> {
    let encoded = image.as_encoded();
    let info = encoded.layout().pixel;
    if args.cpu {
        let Some(texture) = image.downcast_ref::<ZipTexture>() else {
            let codec = encoded.codec().name;
            return Err(CliError::NoSuchPart { path: args.file.clone(), codec, option: "cpu" });
        };
        return Ok(Box::new(move |shot| {
            raster(args, info, size, &texture.draw(shot.corner, shot.extent, size))
        }));
    }
    let device =
        Gpu::new(Policy::from_env()).map_err(|source| CliError::NoDrawing { source: Box::new(source) })?;
    let failed =
        |source: GpuError| CliError::GpuDrawing { path: args.file.clone(), source: Box::new(source) };
    let texture = device.upload(&encoded.gpu()).map_err(failed)?;
    let texture = texture.with_address_mode(texfold_gpu::AddressMode::Clamp);
    Ok(Box::new(move |shot| {
        let uv = Affine2 { matrix2: Mat2::from_diagonal(shot.extent), translation: shot.corner };
        let view = View { image: 0, size, uv, lookup: Lookup::Derivative };
        let pixels = device.read_view(&texture, &view).map_err(failed)?;
        let texels: Vec<Texel> = pixels.into_iter().map(Texel::from_array).collect();
        raster(args, info, size, &texels)
    }))
}

fn raster(
    args: &RenderArgs,
    info: PixelInfo,
    size: (u32, u32),
    texels: &[Texel],
) -> Result<Raster, CliError> {
    Raster::from_texels(size.0, size.1, info, texels)
        .map_err(|source| CliError::Source { path: args.file.clone(), source })
}

/// The frames at half of their size, row by row.
fn strip(path: &Path, frames: &[Raster]) -> Result<Raster, CliError> {
    let small: Vec<Raster> =
        frames.iter().filter_map(|frame| mip_chain(frame, 2, MipFilter::Box).pop()).collect();
    let size = small.first().map_or(ImageSize { width: 1, height: 1 }, Raster::size);
    let columns = small.len().clamp(1, COLUMNS);
    let rows = small.len().div_ceil(columns).max(1);
    let (width, height) = (size.width as usize * columns, size.height as usize * rows);
    let mut texels = vec![Texel::W; width * height];
    for (index, frame) in small.iter().enumerate() {
        let (left, top) = (index % columns * size.width as usize, index / columns * size.height as usize);
        for (at, texel) in frame.texels().enumerate() {
            let (x, y) = (at % size.width as usize, at / size.width as usize);
            texels[(top + y) * width + left + x] = texel;
        }
    }
    let info = PixelInfo {
        channels: 3,
        alpha: Alpha::Opaque,
        ..small.first().map(Raster::info).unwrap_or_default()
    };
    Raster::from_texels(width as u32, height as u32, info, &texels)
        .map_err(|source| CliError::Source { path: path.to_owned(), source })
}

/// Reads `u,v`.
pub(super) fn target(text: &str) -> Result<Vec2, String> {
    let wanted = || format!("'{text}' is not U,V with numbers from 0 to 1, such as 0.5,0.5");
    let (u, v) = text.split_once(',').ok_or_else(wanted)?;
    let number = |text: &str| text.trim().parse::<f32>().ok().filter(|value| (0.0..=1.0).contains(value));
    Ok(Vec2::new(number(u).ok_or_else(wanted)?, number(v).ok_or_else(wanted)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_stay_inside_and_end_at_a_texel_a_pixel() {
        let texture = ImageSize { width: 4096, height: 2048 };
        let found = shots(texture, (512, 256), Vec2::new(0.0, 0.9), 5);
        assert_eq!(found[0], Shot { corner: Vec2::ZERO, extent: Vec2::ONE });
        let last = found[4].extent * Vec2::new(4096.0, 2048.0);
        assert!((last - Vec2::new(512.0, 256.0)).length() < 0.1, "{last}");
        for shot in found {
            assert!(
                shot.corner.min_element() > -1e-6 && (shot.corner + shot.extent).max_element() < 1.0 + 1e-6
            );
        }
        assert_eq!(shots(texture, (10, 10), Vec2::ZERO, 1).len(), 1);
    }

    #[test]
    fn targets_are_read() {
        assert_eq!(target("0.25, 1"), Ok(Vec2::new(0.25, 1.0)));
        for wrong in ["", "0.5", "2,0", "a,b", "0.5,nan"] {
            assert!(target(wrong).is_err(), "{wrong}");
        }
    }
}
