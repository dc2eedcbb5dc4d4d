//! What a light field's file holds.

use std::path::Path;

use serde::Serialize;
use texfold::{
    Content,
    core::Photograph,
    lightfield::{Directions, LightTexture, Renderer},
};
use texfold_core::Encoded;
use texfold_core::image::{ColorSpace, Raster};

use super::{InfoArgs, part_line};
use crate::console::answer;
use crate::error::CliError;
use crate::input::capture;
use crate::output::make_folder;
use crate::png;
use crate::render::load;
use crate::report::{PartRow, part_rows};

#[derive(Debug, Serialize)]
struct Summary {
    file: String,
    codec: &'static str,
    vertices: usize,
    triangles: usize,
    terms: u32,
    terms_total: u32,
    grid: u32,
    directions: &'static str,
    content: &'static str,
    bits_memory: u64,
    bits_resident: u64,
    bits_disk: u64,
    settings: String,
    verdict: String,
    parts: Vec<PartRow>,
    /// PSNR in dB of each view of the cameras' file, over the pixels that show the object.
    views: Vec<f64>,
}

/// How much larger errors are shown than they are.
const ERROR_GAIN: u8 = 4;

/// Runs the command for a light field.
pub(super) fn run(args: &InfoArgs) -> Result<usize, CliError> {
    let texture = load(&args.file, &args.memory.limits())?;
    let mut summary = summarise(args, &texture);
    let views = match &args.camera {
        Some(cameras) => compared(&texture, cameras)?,
        None => Vec::new(),
    };
    summary.views = views.iter().map(|view| view.psnr).collect();
    if args.json {
        let text = serde_json::to_string_pretty(&summary);
        answer(&text.map_err(|source| CliError::Write { path: args.file.clone(), source: source.into() })?);
    } else {
        answer(&describe(&summary));
    }
    if args.original.is_some() {
        let (path, codec) = (args.file.clone(), summary.codec);
        return Err(CliError::NoSuchPart { path, codec, option: "original" });
    }
    if let Some(dir) = &args.pictures {
        make_folder(dir)?;
        let drawn = texture.part_images();
        let drawn = drawn.map_err(|source| CliError::Source { path: args.file.clone(), source })?;
        let stem = args.file.file_stem().unwrap_or_default().to_string_lossy();
        for (name, raster) in drawn {
            png::write(&dir.join(format!("{stem}-{name}.png")), &raster)?;
        }
        for (number, view) in views.iter().enumerate() {
            png::write(&dir.join(format!("{stem}-view-{number:03}.png")), &view.image)?;
        }
    }
    Ok(0)
}

/// A photograph beside what the light field shows in its place.
struct Compared {
    psnr: f64,
    image: Raster,
}

fn compared(texture: &LightTexture, cameras: &Path) -> Result<Vec<Compared>, CliError> {
    let renderer = Renderer::new(texture);
    let compare = |view: &Photograph| {
        let drawn = renderer.render(&view.camera);
        let (width, height) = (view.camera.width, view.camera.height);
        let (mut squares, mut count) = (0.0, 0u64);
        let mut rows = Vec::new();
        let lines = view.pixels.chunks_exact(width as usize).zip(drawn.chunks_exact(width as usize));
        for (wanted, found) in lines {
            let masked =
                |pixel: &[u8; 4]| if pixel[3] > 127 { [pixel[0], pixel[1], pixel[2]] } else { [0; 3] };
            let error = |(wanted, found): (&[u8; 4], &[u8; 4])| -> [u8; 3] {
                if wanted[3] <= 127 {
                    return [0; 3];
                }
                let apart: [u8; 3] = std::array::from_fn(|channel| wanted[channel].abs_diff(found[channel]));
                squares += apart.iter().map(|&apart| f64::from(apart).powi(2)).sum::<f64>();
                count += 3;
                apart.map(|apart| apart.saturating_mul(ERROR_GAIN))
            };
            let errors: Vec<[u8; 3]> = wanted.iter().zip(found).map(error).collect();
            rows.extend(wanted.iter().map(masked).chain(found.iter().map(masked)).chain(errors));
        }
        let psnr = 10.0 * (65025.0 * count.max(1) as f64 / f64::max(squares, 1e-9)).log10();
        let image = Raster::from_u8(3 * width, height, 3, ColorSpace::Srgb, rows.as_flattened())
            .map_err(|source| CliError::Source { path: cameras.to_owned(), source })?;
        Ok(Compared { psnr, image })
    };
    capture::read_views(cameras, None)?.iter().map(compare).collect()
}

fn summarise(args: &InfoArgs, texture: &LightTexture) -> Summary {
    let (layers, footprint) = (texture.layers(), texture.footprint());
    Summary {
        file: args.file.display().to_string(),
        codec: texture.codec().name,
        vertices: texture.mesh().positions.len(),
        triangles: texture.mesh().triangles.len(),
        terms: layers.loaded - 1,
        terms_total: layers.total - 1,
        grid: texture.grid(),
        directions: match texture.directions() {
            Directions::View => "view",
            Directions::Reflected => "reflected",
            Directions::World => "reflected, in space,",
        },
        content: texture.content().map_or("blocks of variable length", Content::name),
        bits_memory: footprint.bits_memory(),
        bits_resident: footprint.bits_resident,
        bits_disk: footprint.bits_disk(),
        settings: texture.notes().settings.clone(),
        verdict: texture.notes().verdict.clone(),
        parts: part_rows(&footprint),
        views: Vec::new(),
    }
}

fn describe(summary: &Summary) -> String {
    let mut lines = vec![
        format!("{}: codec {}", summary.file, summary.codec),
        format!("  mesh      {} vertices, {} triangles", summary.vertices, summary.triangles),
        format!(
            "  maps      {} of {} terms, view maps of {}x{} texels over the {} direction, {}",
            summary.terms,
            summary.terms_total,
            summary.grid,
            summary.grid,
            summary.directions,
            summary.content
        ),
        format!("  settings  {}", summary.settings),
        format!("  verdict   {}", summary.verdict),
        format!("  {:12} {:>14} {:>14} {:>12}", "part", "memory bits", "disk bits", "dB without"),
    ];
    lines.extend(summary.parts.iter().map(part_line));
    lines.push(format!("  {:12} {:>14} {:>14}", "all", summary.bits_memory, summary.bits_disk));
    lines.push(format!("  while drawn  {:>14} bits of GPU memory", summary.bits_resident));
    lines.extend(
        summary.views.iter().enumerate().map(|(number, psnr)| format!("  view {number:<7} {psnr:>14.2} dB")),
    );
    lines.join("\n")
}
