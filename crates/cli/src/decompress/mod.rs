//! `decompress`: `.txf` files into images.

mod astc;
mod cog;
mod gpu;
mod picture;
mod texture;
mod writing;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::Vec2;
use texfold::{AnyImage, Arriving, epitome::EpitomeTexture};
use texfold_core::container::Sections;
use texfold_core::image::Raster;
use texfold_core::metric::{decode_image, decode_rect};
use texfold_core::{
    Budget, Encoded, Image2d, ImageLayout, ImageSize, Layers, Limits, MAX_IMAGE_SIDE, Rect, RegionError,
    SourceError, Stage,
};

use crate::console::{complain, say, warn};
use crate::error::{CliError, UsageError, explain, guarded};
use crate::files;
use crate::input::georeference::{Georeference, Part};
use crate::input::samples::{Bands, MOST_CHANNELS};
use crate::memory::load_fault;
use crate::output::{make_folder, remove_stale, write_whole};
use crate::progress::{Progress, Share};
use crate::{bank, input};
pub(crate) use gpu::Device;
pub(crate) use picture::Picture;
pub(crate) use writing::Writing;
use writing::bands;

/// Digits of the number in the name of one image of several; more where there are more than a thousand.
const NUMBER_DIGITS: usize = 3;

/// Arguments of `decompress`.
#[derive(Debug, clap::Args)]
pub struct DecompressArgs {
    /// .txf files, and folders of them.
    #[arg(required = true, value_name = "FILE.txf")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    writing: Writing,
    /// Only the image of that number, of several; 0 is the first.
    #[arg(long, value_name = "I")]
    image: Option<u32>,
    /// Filter across blocks, as a shader does. At texel centres, which is where images are decoded, this changes only
    /// epitomes with a wide seam blend.
    #[arg(long)]
    continuous: bool,
    /// Not for images: number of terms of a light field, which the command render draws.
    #[arg(long, value_name = "K")]
    terms: Option<u32>,
}

/// A file, and what of it is written where.
struct Planned {
    path: PathBuf,
    outputs: Vec<(Rect, PathBuf)>,
}

/// Runs the command; gives the number of files that failed.
pub(crate) fn run(args: &DecompressArgs) -> Result<usize, CliError> {
    if let Some(path) = args.files.iter().find(|path| bank::is_bank(path)) {
        return Err(CliError::IsBank { path: path.clone() });
    }
    args.writing.check_options()?;
    if args.writing.texture().is_some() && args.continuous {
        return Err(UsageError::Excluded { option: "continuous", other: "--to bc1 to rgba16" }.into());
    }
    let out = &args.writing.out;
    make_folder(out)?;
    remove_stale(out);
    let device = Device::where_wanted(args.writing.gpu)?;
    let (mut writers, mut planned, mut failed) = (HashMap::new(), Vec::new(), 0);
    let mut count = |outcome: Result<(), CliError>| {
        if let Err(error) = outcome {
            complain(&explain(&error));
            failed += 1;
        }
    };
    for path in input::find::expand_all(&args.files) {
        let plan = path.and_then(|path| guarded(&path, || plan(&path, args, &mut writers)));
        count(plan.map(|plan| planned.push(plan)));
    }
    let outputs = planned.iter().flat_map(|plan| &plan.outputs);
    args.writing.check(outputs.map(|(_, output)| output.as_path()))?;
    let progress = Progress::lines(planned.len());
    for plan in planned {
        let share = progress.share(plan.path.file_stem().unwrap_or_default().to_string_lossy().into_owned());
        count(guarded(&plan.path, || decompress(&plan, args, device.as_ref(), &share)));
    }
    Ok(failed)
}

/// Column and row of a tile.
pub(crate) fn tile(text: &str) -> Result<(u32, u32), String> {
    let parse = || {
        let (x, y) = text.split_once(',')?;
        Some((x.trim().parse().ok()?, y.trim().parse().ok()?))
    };
    // A tile further off than any image reaches is refused here.
    let inside = |&(x, y): &(u32, u32)| x < MAX_IMAGE_SIDE && y < MAX_IMAGE_SIDE;
    parse().filter(inside).ok_or_else(|| "give column and row as in 3,0".to_owned())
}

/// Loads a `.txf` file within limits.
pub(crate) fn load(path: &Path, limits: &Limits) -> Result<AnyImage, CliError> {
    let bytes = files::read(path)?;
    let texture = texfold::open_with(&bytes, limits).map_err(|source| load_fault(path, source))?;
    texture.into_image().map_err(|_| CliError::NotImages { path: path.to_owned() })
}

/// Loads no more of a `.txf` file than its first layers, as if the rest had not arrived yet.
fn load_layers(path: &Path, layers: u32, limits: &Limits) -> Result<AnyImage, CliError> {
    let bytes = files::read(path)?;
    let fault = |source| load_fault(path, source);
    let ends: Vec<u64> = Sections::parse(&bytes, &mut Budget::new(*limits)).map_err(fault)?.ends().collect();
    let mut arriving = Arriving::new(*limits);
    let mut start = 0;
    for end in ends {
        let end = usize::try_from(end).unwrap_or(bytes.len()).min(bytes.len());
        arriving.push(&bytes[start..end]).map_err(fault)?;
        start = end;
        if arriving.texture().is_some_and(|texture| texture.as_encoded().layers().loaded >= layers) {
            break;
        }
    }
    // What has no first layer yet says why when it is loaded as a whole.
    arriving.into_texture().map_or_else(|| load(path, limits), Ok)
}

/// Loads what is wanted of a file.
fn open(path: &Path, args: &DecompressArgs) -> Result<AnyImage, CliError> {
    let limits = &args.writing.memory.limits();
    args.writing.layers.map_or_else(|| load(path, limits), |layers| load_layers(path, layers, limits))
}

/// Finds what a file's images are written to, and refuses what the file does not have.
fn plan(
    path: &Path,
    args: &DecompressArgs,
    writers: &mut HashMap<PathBuf, PathBuf>,
) -> Result<Planned, CliError> {
    let image = open(path, args)?;
    let encoded = image.as_encoded();
    check_parts(path, args, encoded)?;
    let (sizes, ending) = (&encoded.layout().images, args.writing.ending());
    let joined = bands_of(encoded, args);
    let last = if joined.is_some() { 0 } else { sizes.len().saturating_sub(1) as u32 };
    let chosen = args.image.map_or(0..=last, |image| image..=image);
    let output = |image: u32| {
        let none = RegionError::NoSuchImage { image, images: sizes.len() };
        let size = sizes.get(image as usize).ok_or(none)?.at_level(args.writing.lod);
        let name = match encoded.layout().maps.get(image as usize) {
            Some(map) => map_name(path, &map.name, &ending).into(),
            None => name(path, image as usize, joined.map_or(sizes.len(), |_| 1), &ending),
        };
        Ok((args.writing.rect(image, size)?, args.writing.out.join(name)))
    };
    let outputs: Result<Vec<_>, RegionError> = chosen.map(output).collect();
    let outputs = outputs.map_err(|source| CliError::Region { path: path.to_owned(), source })?;
    if let Some((output, first)) = outputs.iter().find_map(|(_, output)| writers.get_key_value(output)) {
        let (output, first) = (output.clone(), first.clone());
        return Err(CliError::Collision { path: path.to_owned(), output, first });
    }
    writers.extend(outputs.iter().map(|(_, output)| (output.clone(), path.to_owned())));
    Ok(Planned { path: path.to_owned(), outputs })
}

fn decompress(
    Planned { path, outputs }: &Planned,
    args: &DecompressArgs,
    device: Option<&Device>,
    share: &Share<'_>,
) -> Result<(), CliError> {
    let image = open(path, args)?;
    let encoded = image.as_encoded();
    warn_of_layers(path, args.writing.layers, encoded.layers());
    let uploaded = device.map(|device| device.upload(path, encoded)).transpose()?;
    for (number, (rect, output)) in outputs.iter().enumerate() {
        let report = |done: f32| {
            let done = (number as f32 + done) / outputs.len() as f32;
            share.report(Stage { name: "decoding", done });
        };
        if let Some(formats) = args.writing.texture() {
            if georeference(encoded, *rect).is_some() {
                warn(&format!(
                    "{}: the georeference is left out; give --to tiff or cog to keep it",
                    path.display()
                ));
            }
            let file = texture::file(path, &image, *rect, formats, &args.writing.memory, &report)?;
            write_whole(output, &file)?;
            say(&format!("{}", output.display()));
            continue;
        }
        let size = ImageSize { width: rect.width, height: rect.height };
        let joined = bands_of(encoded, args);
        let picture = args.writing.picture(path, size, encoded.layout().pixel_of(rect.image), joined)?;
        let mut picture = picture.with_georeference(georeference(encoded, *rect));
        // Images of bands follow one another.
        for further in 0..joined.map_or(1, Bands::images) {
            for part in bands(Rect { image: rect.image + u32::from(further), ..*rect }) {
                let raster = match &uploaded {
                    Some(uploaded) => uploaded.decode(path, encoded, part, args.continuous)?,
                    None => on_cpu(path, &image, part, args)?,
                };
                picture.place_bands(further * MOST_CHANNELS, (0, part.y - rect.y), &raster);
                let within = (part.y - rect.y + part.height) as f32 / rect.height.max(1) as f32;
                report((f32::from(further) + within) / f32::from(joined.map_or(1, Bands::images)));
            }
        }
        picture.write(output)?;
    }
    Ok(())
}

/// The bands of all images of a texture together, where the output is to hold them: those of one source.
fn bands_of(encoded: &dyn Encoded<Domain = Image2d>, args: &DecompressArgs) -> Option<Bands> {
    let bands = Georeference::of_notes(encoded.notes())?.bands()?;
    let ImageLayout { images, pixel, .. } = encoded.layout();
    let fits = images.len() == usize::from(bands.images())
        && images.iter().all(|size| *size == images[0])
        && bands.count.min(MOST_CHANNELS) == u16::from(pixel.channels);
    (fits && args.image.is_none() && args.writing.takes_bands()).then_some(bands)
}

/// The georeference of a rectangle.
fn georeference(encoded: &dyn Encoded<Domain = Image2d>, rect: Rect) -> Option<Georeference> {
    let whole = Georeference::of_notes(encoded.notes()).filter(|_| rect.image == 0)?;
    Some(whole.of_part(Part::of(encoded.layout().images[0], rect)))
}

/// Corner and extent of a rectangle in texture coordinates.
fn coordinates(encoded: &dyn Encoded<Domain = Image2d>, rect: Rect) -> (Vec2, Vec2) {
    let ImageSize { width, height } = encoded.layout().images[rect.image as usize].at_level(rect.level);
    let of_level = |x: u32, y: u32| Vec2::new(x as f32, y as f32) / Vec2::new(width as f32, height as f32);
    (of_level(rect.x, rect.y), of_level(rect.width, rect.height))
}

/// An image decoded on the CPU; epitomes between leaves as they are drawn, where that is requested.
fn on_cpu(path: &Path, image: &AnyImage, rect: Rect, args: &DecompressArgs) -> Result<Raster, CliError> {
    // Strips are wider than between texels at level 0 alone.
    let blended = image.downcast_ref::<EpitomeTexture>().filter(|_| args.continuous && rect.level == 0);
    let Some(epitome) = blended else { return decode_part(path, image.as_encoded(), rect) };
    let (corner, extent) = coordinates(epitome, rect);
    let texels = epitome.draw(rect.image, corner, extent, (rect.width, rect.height));
    let fault = |source: SourceError| CliError::Encode { path: path.to_owned(), source: source.into() };
    Raster::from_texels(rect.width, rect.height, epitome.layout().pixel, &texels).map_err(fault)
}

/// Says so where the file was cut, or has fewer layers than wanted.
fn warn_of_layers(path: &Path, wanted: Option<u32>, Layers { loaded, total }: Layers) {
    let warn = |what: &str| warn(&format!("{}: {what}", path.display()));
    match wanted {
        Some(wanted) if wanted > total => warn(&format!("has {total} layers, not {wanted}")),
        Some(wanted) if wanted <= loaded => {}
        _ if loaded < total => {
            warn(&format!(
                "ends after {loaded} of {total} layers; the rest of the file makes the image finer"
            ));
        }
        _ => {}
    }
}

/// Refuses options that the file's codec does not have.
fn check_parts(
    path: &Path,
    args: &DecompressArgs,
    encoded: &dyn Encoded<Domain = Image2d>,
) -> Result<(), CliError> {
    let missing =
        |option| CliError::NoSuchPart { path: path.to_owned(), codec: encoded.codec().name, option };
    if args.writing.layers.is_some() && encoded.layers().total == 1 {
        Err(missing("layers"))
    } else if args.terms.is_some() {
        Err(missing("terms"))
    } else if args.writing.lod >= encoded.layout().levels {
        let source = RegionError::NoSuchLevel { level: args.writing.lod, levels: encoded.layout().levels };
        Err(CliError::Region { path: path.to_owned(), source })
    } else {
        Ok(())
    }
}

/// One image on the CPU: the reference.
pub(crate) fn decode(
    path: &Path,
    encoded: &dyn Encoded<Domain = Image2d>,
    image: u32,
    level: u32,
) -> Result<Raster, CliError> {
    let layout = encoded.layout();
    let missing = || CliError::Region {
        path: path.to_owned(),
        source: RegionError::NoSuchImage { image, images: layout.images.len() },
    };
    decode_image(encoded, image, level).ok_or_else(missing)
}

/// A rectangle of an image on the CPU.
pub(crate) fn decode_part(
    path: &Path,
    encoded: &dyn Encoded<Domain = Image2d>,
    rect: Rect,
) -> Result<Raster, CliError> {
    let outside = |source| CliError::Region { path: path.to_owned(), source };
    let layout = encoded.layout();
    layout.check(rect).map_err(outside)?;
    let ImageSize { width, height } = layout.images[rect.image as usize].at_level(rect.level);
    decode_rect(encoded, rect).ok_or_else(|| outside(RegionError::Outside { width, height }))
}

/// `<stem><ending>`, or `<stem>-000<ending>` and so on where there are several.
pub(crate) fn name(path: &Path, image: usize, images: usize, ending: &str) -> std::ffi::OsString {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    if images > 1 {
        let digits = NUMBER_DIGITS.max((images - 1).to_string().len());
        name.push(format!("-{image:0digits$}"));
    }
    name.push(ending);
    name
}

/// `<map><ending>` where the map's name begins with that of the file, as those of files do, else `<stem>-<map><ending>`.
fn map_name(path: &Path, map: &str, ending: &str) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    if map.starts_with(&*stem) { format!("{map}{ending}") } else { format!("{stem}-{map}{ending}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_of_several_materials_have_names_of_their_own() {
        assert_eq!(map_name(Path::new("out/wall.txf"), "wall_Color", ".png"), "wall_Color.png");
        assert_eq!(map_name(Path::new("chair-leather.txf"), "color", ".png"), "chair-leather-color.png");
    }

    #[test]
    fn names_sort_as_the_images_do() {
        assert_eq!(name(Path::new("a/wall.txf"), 0, 1, ".png"), "wall.png");
        assert_eq!(name(Path::new("wall.txf"), 7, 8, ".png"), "wall-007.png");
        assert_eq!(name(Path::new("wall.txf"), 7, 1001, "-1-2-3x4.tiff"), "wall-0007-1-2-3x4.tiff");
    }
}
