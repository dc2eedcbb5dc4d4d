//! `info`: what a `.txf` file holds.

mod light;
mod part_images;

use std::path::{Path, PathBuf};

pub(crate) use part_images::read_original;

use serde::Serialize;
use texfold::{AnyImage, dct::DctImages};
use texfold_core::ImageSize;
use texfold_core::image::{Alpha, Depth, MapInfo, PixelInfo};
use texfold_gpu::TileBytes;

use crate::console::answer;
use crate::decompress::load;
use crate::error::{CliError, guarded};
use crate::input::georeference::Georeference;
use crate::memory::MemoryArgs;
use crate::report::{PartRow, Sizes, color_name, part_rows};

/// Sizes of images that are listed before the rest is counted.
const LISTED_SIZES: usize = 8;

/// Arguments of `info`.
#[derive(Debug, clap::Args)]
pub struct InfoArgs {
    /// A .txf file.
    #[arg(value_name = "FILE.txf")]
    file: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Write images of the file's parts to this folder.
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    /// The image or folder that the file was made from: also write images of the error.
    #[arg(long, value_name = "INPUT", requires = "pictures")]
    original: Option<PathBuf>,
    /// vq: the mesh (OBJ, glTF, GLB) that the first image is drawn on: also write the map of its distortion.
    #[arg(long, value_name = "FILE", requires = "original")]
    mesh: Option<PathBuf>,
    /// Light fields: a camera file with photographs. Prints the PSNR of each view; with --pictures writes both beside
    /// each other.
    #[arg(long, value_name = "CAMERAS.json")]
    camera: Option<PathBuf>,
    #[command(flatten)]
    memory: MemoryArgs,
}

#[derive(Debug, Serialize)]
struct Summary {
    file: String,
    codec: &'static str,
    images: usize,
    sizes: Vec<[u32; 2]>,
    levels: u32,
    channels: u8,
    depth_bits: u32,
    color: &'static str,
    alpha: String,
    /// The maps of a material.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    maps: Vec<MapSummary>,
    layers_loaded: u32,
    layers_total: u32,
    source_texels: u64,
    #[serde(flatten)]
    bits: Sizes,
    /// GPU memory in a cache of tiles without its pool.
    bits_tiles: u64,
    /// The most of the pool that its tiles take; textures share one, of 64 MiB by default.
    bits_pool: u64,
    settings: String,
    verdict: String,
    /// Remarks on how the source was read.
    source: Vec<String>,
    georeference: Option<String>,
    parts: Vec<PartRow>,
}

/// A map of a material.
#[derive(Debug, Serialize)]
struct MapSummary {
    name: String,
    kind: &'static str,
    size: [u32; 2],
    channels: u8,
    color: &'static str,
    bits_memory: u64,
}

impl MapSummary {
    fn all(image: &AnyImage) -> Vec<MapSummary> {
        let layout = image.as_encoded().layout();
        let blocks = image.downcast_ref::<DctImages>();
        let summary = |(index, (map, size)): (u32, (&MapInfo, &ImageSize))| MapSummary {
            name: map.name.clone(),
            kind: map.kind.name(),
            size: [size.width, size.height],
            channels: map.pixel.channels,
            color: color_name(map.pixel.color),
            bits_memory: 8 * blocks.map_or(0, |blocks| blocks.content().held_bytes_of(index)),
        };
        (0..).zip(layout.maps.iter().zip(&layout.images)).map(summary).collect()
    }
}

/// Runs the command.
pub(crate) fn run(args: &InfoArgs) -> Result<usize, CliError> {
    guarded(&args.file, || {
        if crate::bank::is_bank(&args.file) {
            return Err(CliError::IsBank { path: args.file.clone() });
        }
        let image = match load(&args.file, &args.memory.limits()) {
            Err(CliError::NotImages { .. }) => return light::run(args),
            image => image?,
        };
        let summary = summarise(&args.file, &image);
        if args.camera.is_some() {
            let (path, codec) = (args.file.clone(), summary.codec);
            return Err(CliError::NoSuchPart { path, codec, option: "camera" });
        }
        if args.json {
            let text = serde_json::to_string_pretty(&summary);
            answer(
                &text.map_err(|source| CliError::Write { path: args.file.clone(), source: source.into() })?,
            );
        } else {
            answer(&describe(&summary));
        }
        if let Some(dir) = &args.pictures {
            let (original, mesh) = (args.original.as_deref(), args.mesh.as_deref());
            part_images::write(&args.file, &image, dir, original, mesh, args.memory.bytes())?;
        }
        Ok(0)
    })
}

fn summarise(path: &Path, image: &AnyImage) -> Summary {
    let encoded = image.as_encoded();
    let (layout, layers, footprint) = (encoded.layout(), encoded.layers(), encoded.footprint());
    let texels = layout.texels();
    let tiles = TileBytes::of(encoded);
    let PixelInfo { channels, depth, color, alpha } = layout.pixel;
    Summary {
        file: path.display().to_string(),
        codec: encoded.codec().name,
        images: layout.images.len(),
        sizes: layout.images.iter().map(|size| [size.width, size.height]).collect(),
        levels: layout.levels,
        channels,
        depth_bits: if depth == Depth::Sixteen { 16 } else { 8 },
        color: color_name(color),
        alpha: match alpha {
            Alpha::Opaque => "opaque".to_owned(),
            Alpha::Straight => "straight".to_owned(),
            Alpha::Band => "band".to_owned(),
            Alpha::Cutout(threshold) => format!("cutout={threshold}"),
        },
        maps: MapSummary::all(image),
        layers_loaded: layers.loaded,
        layers_total: layers.total,
        source_texels: texels,
        bits: Sizes::new(footprint.bits_memory(), footprint.bits_resident, footprint.bits_disk(), texels),
        bits_tiles: 8 * tiles.held,
        bits_pool: 8 * tiles.decoded,
        settings: encoded.notes().settings.clone(),
        verdict: encoded.notes().verdict.clone(),
        source: encoded.notes().source.as_ref().map_or_else(Vec::new, |source| source.remarks.clone()),
        georeference: Georeference::of_notes(encoded.notes()).and_then(|found| found.description()),
        parts: part_rows(&footprint),
    }
}

/// A line of the ledger.
fn part_line(part: &PartRow) -> String {
    let without = part.psnr_without.map_or("-".to_owned(), |psnr| format!("{psnr:.2}"));
    format!("  {:12} {:>14} {:>14} {without:>12}", part.name, part.bits_memory, part.bits_disk)
}

fn describe(summary: &Summary) -> String {
    let mut sizes: Vec<String> =
        summary.sizes.iter().take(LISTED_SIZES).map(|[width, height]| format!("{width}x{height}")).collect();
    if summary.sizes.len() > LISTED_SIZES {
        sizes.push("...".to_owned());
    }
    let mut lines = vec![
        format!("{}: codec {}", summary.file, summary.codec),
        format!("  images    {} ({})", summary.images, sizes.join(", ")),
        format!(
            "  pixels    {} channels of {} bits, {}, alpha {}; {} levels",
            summary.channels, summary.depth_bits, summary.color, summary.alpha, summary.levels
        ),
        format!("  settings  {}", summary.settings),
        format!("  verdict   {}", summary.verdict),
    ];
    lines.extend(summary.maps.iter().map(|map| {
        let [width, height] = map.size;
        let texels = (summary.source_texels as f64).max(1.0);
        format!(
            "  map       {}: {}, {width}x{height}, {} channels, {}, {:.4} bits a texel",
            map.name,
            map.kind,
            map.channels,
            map.color,
            map.bits_memory as f64 / texels
        )
    }));
    lines.extend(summary.source.iter().map(|remark| format!("  source    {remark}")));
    lines.extend(summary.georeference.iter().map(|place| format!("  place     {place}")));
    lines.push(format!("  {:12} {:>14} {:>14} {:>12}", "part", "memory bits", "disk bits", "dB without"));
    if summary.layers_total > 1 {
        lines.insert(3, format!("  layers    {} of {}", summary.layers_loaded, summary.layers_total));
    }
    lines.extend(summary.parts.iter().map(part_line));
    lines.extend(summary.bits.lines());
    lines.push(format!(
        "  in tiles     {:>14} bits of GPU memory, {:.4} a texel, and up to {} of the pool that textures share",
        summary.bits_tiles,
        summary.bits_tiles as f64 / summary.source_texels.max(1) as f64,
        summary.bits_pool
    ));
    lines.join("\n")
}
