//! What a light field's file holds.

use serde::Serialize;
use texfold::{Directions, LightTexture};
use texfold_core::Encoded;

use super::{InfoArgs, part_line};
use crate::error::CliError;
use crate::output::make_folder;
use crate::png;
use crate::render::load;
use crate::report::{PartRow, part_rows};
use crate::run::say;

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
    bits_disk: u64,
    settings: String,
    verdict: String,
    parts: Vec<PartRow>,
}

/// Runs the command for a light field.
pub(super) fn run(args: &InfoArgs) -> Result<usize, CliError> {
    let texture = load(&args.file)?;
    let summary = summarise(args, &texture);
    if args.json {
        let text = serde_json::to_string_pretty(&summary);
        say(&text.map_err(|source| CliError::Write { path: args.file.clone(), source: source.into() })?);
    } else {
        say(&describe(&summary));
    }
    if args.original.is_some() {
        let (path, codec) = (args.file.clone(), summary.codec);
        return Err(CliError::NoSuchPart { path, codec, option: "original" });
    }
    if let Some(dir) = &args.pictures {
        make_folder(dir)?;
        let drawn = texture.pictures();
        let drawn = drawn.map_err(|source| CliError::Source { path: args.file.clone(), source })?;
        let stem = args.file.file_stem().unwrap_or_default().to_string_lossy();
        for (name, raster) in drawn {
            png::write(&dir.join(format!("{stem}-{name}.png")), &raster)?;
        }
    }
    Ok(0)
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
        },
        content: texture.content().name(),
        bits_memory: footprint.bits_memory(),
        bits_disk: footprint.bits_disk(),
        settings: texture.notes().settings.clone(),
        verdict: texture.notes().verdict.clone(),
        parts: part_rows(&footprint),
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
    lines.join("\n")
}
