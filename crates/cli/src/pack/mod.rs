//! `pack` and `unpack`: scenes of glTF whose images become textures beside them, and the other way.
//!
//! The scene stays what it was but for its images: each texture names a file and a map in it by the extension [`EXTENSION`], beside a
//! small image that viewers without it show.

mod materials;
mod scene;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use image::ImageEncoder;
use image::codecs::jpeg::JpegEncoder;
use serde_json::{Value, json};
use texfold::dct::{Dct, DctParams};
use texfold::{AnyImage, Choice, EncodeSettings, Guidance, encoding::choose_images};
use texfold_core::image::{Alpha, ColorSpace, ImageSet, MapKind, MipFilter, Raster, mip_chain};
use texfold_core::metric::{color_error, decode_image};
use texfold_core::{EncodeError, Goal, Job, Limits, SourceError};

use crate::config::{EffortName, Weights};
use crate::console::{say, warn};
use crate::error::{CliError, guarded};
use crate::input::{Remarks, material::is_gray, pixels};
use crate::memory::{self, MemoryArgs};
use crate::output::{make_folder, write_whole};
use crate::png;
use materials::{Material, Slot, image_of, materials};
use scene::{Scene, is_of_textures};

/// Name of the extension of textures.
const EXTENSION: &str = "TEXFOLD_texture";
/// Longest side of small images.
const SMALL_SIDE: u32 = 256;
/// Quality of small images.
const SMALL_QUALITY: u8 = 85;

/// What viewers without the extension show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub(crate) enum Fallback {
    /// Images of at most 256 texels a side.
    #[default]
    Small,
    /// The images as they were.
    Original,
    /// Nothing: such viewers refuse the scene.
    None,
}

/// Arguments of `pack`.
#[derive(Debug, clap::Args)]
pub struct PackArgs {
    /// A scene: .glb or .gltf.
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    /// Folder that the scene, as .glb, and its textures are written to.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Goal of each material: the best quality within this many bits a texel for all of its maps, mip levels included.
    #[arg(long, value_name = "B", default_value_t = 5.0, value_parser = positive, conflicts_with = "psnr")]
    bpp: f64,
    /// Goal of each material instead: the smallest file with at least this PSNR in dB over all of its maps.
    #[arg(long, value_name = "DB", value_parser = positive)]
    psnr: Option<f64>,
    /// How long to search.
    #[arg(long, value_enum, default_value_t)]
    effort: EffortName,
    /// Weights of the squared errors of maps by kind, as for compress --as material.
    #[arg(long, value_name = "KIND=W,...")]
    weights: Option<Weights>,
    /// What viewers that do not know the extension show.
    #[arg(long, value_enum, default_value_t)]
    fallback: Fallback,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// Arguments of `unpack`.
#[derive(Debug, clap::Args)]
pub struct UnpackArgs {
    /// A scene that pack has written, beside its textures.
    #[arg(value_name = "SCENE.glb")]
    scene: PathBuf,
    /// Folder that the scene is written to, with PNG images inside.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    memory: MemoryArgs,
}

fn positive(text: &str) -> Result<f64, String> {
    let found = text.parse().ok().filter(|value: &f64| value.is_finite() && *value > 0.0);
    found.ok_or_else(|| "give a finite number above 0".to_owned())
}

/// A material that is packed.
struct Packed {
    /// For each image, the name of its map.
    maps: Vec<(usize, String)>,
    /// For each image, what stands in its place for others.
    small: BTreeMap<usize, Raster>,
    bytes: Vec<u8>,
}

/// Runs `pack`.
pub(crate) fn pack(args: &PackArgs) -> Result<usize, CliError> {
    guarded(&args.scene, || {
        let mut scene = Scene::read(&args.scene, args.memory.bytes())?;
        let found = materials(&scene);
        if found.is_empty() {
            return Err(scene.fault("has no materials with images that are read"));
        }
        let stem = args.scene.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let output = output_of(&args.scene, &args.out)?;
        let mut places: BTreeMap<usize, Value> = BTreeMap::new();
        let mut small = BTreeMap::new();
        let (mut before, mut after) = (Size::default(), Size::default());
        for material in found {
            let file = format!("{stem}-{}.txf", material.name);
            let packed = encode(&scene, &material, &file, args, (&mut before, &mut after))?;
            write_whole(&args.out.join(&file), &packed.bytes)?;
            places.extend(
                packed.maps.into_iter().map(|(image, map)| (image, json!({ "uri": file, "map": map }))),
            );
            small.extend(packed.small);
        }
        name_places(&mut scene, &places, args.fallback);
        for (image, raster) in small {
            let (mime_type, bytes) = encoded_small(&args.scene, &raster)?;
            after.disk += bytes.len() as u64;
            scene.put_image(Some(image), mime_type, bytes);
        }
        if args.fallback == Fallback::Original {
            after.disk += before.disk;
        }
        scene.take_images()?;
        write_whole(&output, &scene.into_glb()?)?;
        say(&format!(
            "{}: images of {} on disk and {} of RGBA with mip levels in memory; now {} and {} compressed",
            output.display(),
            megabytes(before.disk),
            megabytes(before.memory),
            megabytes(after.disk),
            megabytes(after.memory)
        ));
        Ok(0)
    })
}

/// Bytes of images.
#[derive(Debug, Clone, Copy, Default)]
struct Size {
    disk: u64,
    memory: u64,
}

fn megabytes(bytes: u64) -> String {
    format!("{:.2} MB", bytes as f64 / 1e6)
}

/// The scene's place in the folder, which is made.
fn output_of(scene: &Path, out: &Path) -> Result<PathBuf, CliError> {
    make_folder(out)?;
    let output = out.join(scene.file_stem().unwrap_or_default()).with_extension("glb");
    let is_same =
        output.canonicalize().is_ok_and(|output| scene.canonicalize().is_ok_and(|scene| scene == output));
    if is_same { Err(CliError::Itself { path: output }) } else { Ok(output) }
}

/// Encodes the images of a material, and prints the quality of each.
fn encode(
    scene: &Scene,
    material: &Material,
    file: &str,
    args: &PackArgs,
    (before, after): (&mut Size, &mut Size),
) -> Result<Packed, CliError> {
    let path = &args.scene;
    let dir = tempfile::tempdir().map_err(|source| CliError::Write { path: path.clone(), source })?;
    let mut maps = Vec::new();
    for slot in &material.slots {
        let bytes = scene.image(slot.image)?;
        before.disk += bytes.len() as u64;
        // Images are told by what they begin with, and named in messages by what they are.
        let named = dir.path().join(format!("image-{}", slot.image));
        std::fs::write(&named, &bytes).map_err(|source| CliError::Write { path: named.clone(), source })?;
        let raster = read(&named, slot, args.memory.bytes())?;
        let texels = raster.size().texels();
        before.memory += texels * 4 * 4 / 3;
        maps.push((slot.kind, slot.name.clone(), raster));
    }
    let fault = |source: SourceError| CliError::Source { path: path.clone(), source };
    let images = ImageSet::of_maps(maps).map_err(fault)?;
    let texels: u64 = images.images().iter().map(|image| image.size().texels()).sum();
    let weights = match &args.weights {
        Some(Weights::Maps(weights)) => weights.clone(),
        Some(Weights::Importance(_)) => return Err(crate::error::UsageError::SceneWeights.into()),
        None => Vec::new(),
    };
    let settings = EncodeSettings {
        codec: Choice::of::<Dct>().with::<Dct>(DctParams::default().with_weights(weights)),
        goal: args.psnr.map_or(Goal::Bpp(args.bpp), Goal::Psnr),
        mips: true,
        effort: args.effort.effort(),
        ..EncodeSettings::default()
    };
    let limit = args.memory.bytes();
    memory::check(
        path,
        texels.saturating_mul(settings.bytes_per_texel()),
        limit.max(memory::ALWAYS_ALLOWED),
    )?;
    let limits = Limits { bytes: limit, ..Limits::default() };
    let fault = |source: EncodeError| CliError::Encode { path: path.clone(), source };
    let made =
        choose_images(&images, Guidance::default(), &settings, &mut Job::new(limits)).map_err(fault)?;
    let texture = made.image.as_encoded();
    let bytes = made.image.to_bytes();
    after.disk += bytes.len() as u64;
    after.memory += texture.memory().compressed / 8;
    let (mut names, mut small) = (Vec::new(), BTreeMap::new());
    for (number, (slot, image)) in (0..).zip(material.slots.iter().zip(images.images())) {
        let missing =
            || CliError::Internal { path: path.clone(), message: "a map was not encoded".to_owned() };
        let decoded = decode_image(texture, number, 0).ok_or_else(missing)?;
        let size = image.size();
        say(&format!(
            "{file:32} {:12} {:>11} {:7.2} dB",
            slot.name,
            format!("{}x{}", size.width, size.height),
            color_error(image, &decoded).psnr()
        ));
        names.push((slot.image, slot.name.clone()));
        if args.fallback == Fallback::Small {
            small.insert(slot.image, reduced(image));
        }
    }
    Ok(Packed { maps: names, small, bytes })
}

/// The image of a slot, with the channels that its material uses.
fn read(path: &Path, slot: &Slot, limit: u64) -> Result<Raster, CliError> {
    let mut remarks = Remarks::default();
    let raster = pixels::read(path, slot.color, Some(slot.alpha), limit, &mut remarks)?;
    for text in remarks.warnings(1) {
        warn(&format!("{}: {text}", path.display()));
    }
    let info = raster.info();
    let is_opaque = slot.alpha == Alpha::Opaque || slot.kind == MapKind::Normal;
    let raster = match info.channels {
        // What a material does not use costs nothing.
        2 | 4 if is_opaque => raster.with_channels(info.channels - 1),
        _ => raster,
    };
    Ok(if slot.color == ColorSpace::Linear && is_gray(&raster) { raster.with_channels(1) } else { raster })
}

/// The image at no more than [`SMALL_SIDE`] texels a side.
fn reduced(image: &Raster) -> Raster {
    let size = image.size();
    let level = (0..size.full_levels()).find(|&level| {
        let small = size.at_level(level);
        small.width.max(small.height) <= SMALL_SIDE
    });
    let level = level.unwrap_or(0);
    mip_chain(image, level + 1, MipFilter::Box).pop().unwrap_or_else(|| image.clone())
}

/// A small image as a file: JPEG, or PNG where there is alpha.
fn encoded_small(path: &Path, image: &Raster) -> Result<(&'static str, Vec<u8>), CliError> {
    let fault =
        |source: image::ImageError| CliError::Draw { path: path.to_owned(), source: Box::new(source) };
    if image.info().has_extra() {
        return Ok(("image/png", png::encode(image).map_err(fault)?));
    }
    let mut bytes = Vec::new();
    let size = image.size();
    JpegEncoder::new_with_quality(&mut bytes, SMALL_QUALITY)
        .write_image(&image.to_bytes(), size.width, size.height, png::color(image.info().channels))
        .map_err(fault)?;
    Ok(("image/jpeg", bytes))
}

/// Names files and maps in the textures whose images are packed.
fn name_places(scene: &mut Scene, places: &BTreeMap<usize, Value>, fallback: Fallback) {
    let images: Vec<Option<usize>> =
        (0..scene.list("textures").len()).map(|texture| image_of(scene, texture)).collect();
    let textures = scene.json["textures"].as_array_mut().into_iter().flatten();
    for (texture, image) in textures.zip(images) {
        let Some((image, place)) = image.and_then(|image| Some((image, places.get(&image)?))) else {
            continue;
        };
        let Some(texture) = texture.as_object_mut() else { continue };
        let mut extensions = match texture.remove("extensions") {
            Some(Value::Object(extensions)) => extensions,
            _ => serde_json::Map::new(),
        };
        if fallback != Fallback::Original {
            extensions.retain(|name, _| !is_of_textures(name));
        }
        extensions.insert(EXTENSION.to_owned(), place.clone());
        texture.insert("extensions".to_owned(), extensions.into());
        match fallback {
            Fallback::None => _ = texture.remove("source"),
            Fallback::Small => _ = texture.insert("source".to_owned(), image.into()),
            Fallback::Original => {}
        }
    }
    scene.forget_unused();
    scene.name_extension("extensionsUsed", EXTENSION);
    if fallback == Fallback::None {
        scene.name_extension("extensionsRequired", EXTENSION);
    }
}

/// Runs `unpack`.
pub(crate) fn unpack(args: &UnpackArgs) -> Result<usize, CliError> {
    guarded(&args.scene, || {
        let mut scene = Scene::read(&args.scene, args.memory.bytes())?;
        let output = output_of(&args.scene, &args.out)?;
        let folder = args.scene.parent().unwrap_or(Path::new(""));
        let mut files: BTreeMap<String, AnyImage> = BTreeMap::new();
        let mut images: BTreeMap<(String, String), usize> = BTreeMap::new();
        for index in 0..scene.list("textures").len() {
            let place = scene.list("textures")[index]["extensions"][EXTENSION].clone();
            if place.is_null() {
                continue;
            }
            let word = |name: &str| place[name].as_str().map(str::to_owned);
            let named = word("uri").zip(word("map")).filter(|(uri, _)| is_file_name(uri));
            let (uri, map) = named.ok_or_else(|| {
                scene.fault("has a texture whose uri is no name of a file or whose map has none")
            })?;
            if !files.contains_key(&uri) {
                files
                    .insert(uri.clone(), crate::decompress::load(&folder.join(&uri), &args.memory.limits())?);
            }
            let key = (uri, map);
            let known = images.get(&key).copied();
            let image = match (known, files.get(&key.0)) {
                (Some(image), _) => image,
                (None, Some(file)) => {
                    let encoded = file.as_encoded();
                    let number = encoded.layout().map(&key.1);
                    let decoded = number.and_then(|number| decode_image(encoded, number, 0));
                    let decoded = decoded.ok_or_else(|| scene.fault("names a map that its texture lacks"))?;
                    let draw = |source| CliError::Draw { path: args.scene.clone(), source: Box::new(source) };
                    scene.put_image(None, "image/png", png::encode(&decoded).map_err(draw)?)
                }
                (None, None) => continue,
            };
            images.insert(key, image);
            let texture = &mut scene.json["textures"][index];
            texture["source"] = image.into();
            if let Some(extensions) = texture["extensions"].as_object_mut() {
                // Its own, and those of formats of images that were left as they were.
                extensions.retain(|name, _| !is_of_textures(name));
            }
            if texture["extensions"].as_object().is_some_and(serde_json::Map::is_empty)
                && let Some(texture) = texture.as_object_mut()
            {
                texture.remove("extensions");
            }
        }
        if images.is_empty() {
            return Err(scene.fault("has no textures that pack has made"));
        }
        scene.forget_unused();
        scene.take_images()?;
        write_whole(&output, &scene.into_glb()?)?;
        say(&format!("wrote {} with {} images", output.display(), images.len()));
        Ok(0)
    })
}

/// Whether a URI is the name of a file in the scene's folder.
fn is_file_name(uri: &str) -> bool {
    let name = Path::new(uri);
    name.file_name().is_some_and(|own| own == name.as_os_str()) && !uri.contains(['/', '\\', ':'])
}
