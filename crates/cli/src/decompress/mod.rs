//! `decompress`: `.txf` files into PNG images.

mod gpu;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::Vec2;
use texfold::{AnyImage, Arriving, epitome::EpitomeTexture};
use texfold_core::container::Sections;
use texfold_core::image::Raster;
use texfold_core::metric::decode_image;
use texfold_core::{
    Budget, Encoded, Image2d, ImageSize, Layers, Limits, MAX_IMAGE_SIDE, RegionError, SourceError,
};

use crate::console::complain;
use crate::error::{CliError, explain, guarded};
use crate::output::{make_folder, remove_stale};
use crate::{bank, input, png};
pub(crate) use gpu::Device;

/// Digits of the number in the name of one image of several; more where there are more than a thousand.
const NUMBER_DIGITS: usize = 3;

/// Arguments of `decompress`.
#[derive(Debug, clap::Args)]
pub struct DecompressArgs {
    /// .txf files.
    #[arg(required = true, value_name = "FILE.txf")]
    files: Vec<PathBuf>,
    /// Folder that the PNG files are written to.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Decode on the GPU, as a shader does.
    #[arg(long)]
    gpu: bool,
    /// Filter across blocks, as a shader does. At texel centres, which is where images are decoded, this changes only
    /// epitomes with a wide seam blend.
    #[arg(long)]
    continuous: bool,
    /// Mip level: 0 is the full size.
    #[arg(long, value_name = "N", default_value_t = 0)]
    lod: u32,
    /// Load only this many layers of a layered file.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    layers: Option<u32>,
    /// Not for images: number of terms of a light field, which the command render draws.
    #[arg(long, value_name = "K")]
    terms: Option<u32>,
}

/// Runs the command; gives the number of files that failed.
pub(crate) fn run(args: &DecompressArgs) -> Result<usize, CliError> {
    make_folder(&args.out)?;
    remove_stale(&args.out);
    let device = match args.gpu.then(Device::open).transpose() {
        Ok(device) => device,
        Err(source) => return Err(CliError::NoGpu { source: Box::new(source) }),
    };
    let mut writers = HashMap::new();
    let mut failed = 0;
    if let Some(path) = args.files.iter().find(|path| bank::is_bank(path)) {
        return Err(CliError::IsBank { path: path.clone() });
    }
    for path in input::find::expand_all(&args.files) {
        let outcome =
            path.and_then(|path| guarded(&path, || decompress(&path, args, device.as_ref(), &mut writers)));
        if let Err(error) = outcome {
            complain(&explain(&error));
            failed += 1;
        }
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

/// Loads a `.txf` file.
pub(crate) fn load(path: &Path) -> Result<AnyImage, CliError> {
    let bytes = std::fs::read(path).map_err(|source| CliError::Read { path: path.to_owned(), source })?;
    let texture = texfold::open(&bytes).map_err(|source| CliError::Load { path: path.to_owned(), source })?;
    texture.into_image().map_err(|_| CliError::NotImages { path: path.to_owned() })
}

/// Loads no more of a `.txf` file than its first layers, as if the rest had not arrived yet.
fn load_layers(path: &Path, layers: u32) -> Result<AnyImage, CliError> {
    let bytes = std::fs::read(path).map_err(|source| CliError::Read { path: path.to_owned(), source })?;
    let fault = |source| CliError::Load { path: path.to_owned(), source };
    let ends: Vec<u64> = Sections::parse(&bytes, &mut Budget::default()).map_err(fault)?.ends().collect();
    let mut arriving = Arriving::new(Limits::default());
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
    arriving.into_texture().map_or_else(|| load(path), Ok)
}

fn decompress(
    path: &Path,
    args: &DecompressArgs,
    device: Option<&Device>,
    writers: &mut HashMap<PathBuf, PathBuf>,
) -> Result<(), CliError> {
    let image = args.layers.map_or_else(|| load(path), |layers| load_layers(path, layers))?;
    check_parts(path, args, image.as_encoded())?;
    warn_of_layers(path, args.layers, image.as_encoded().layers());
    let encoded = image.as_encoded();
    let uploaded = device.map(|device| device.upload(path, encoded)).transpose()?;
    let images = encoded.layout().images.len();
    for index in 0..images {
        let output = args.out.join(name(path, index, images));
        if let Some(first) = writers.insert(output.clone(), path.to_owned()) {
            writers.insert(output.clone(), first.clone());
            return Err(CliError::Collision { path: path.to_owned(), output, first });
        }
        let raster = match &uploaded {
            Some(uploaded) => uploaded.decode(path, encoded, index as u32, args.lod, args.continuous)?,
            None => on_cpu(path, &image, index as u32, args)?,
        };
        png::write(&output, &raster)?;
    }
    Ok(())
}

/// An image decoded on the CPU; epitomes between leaves as they are drawn, where that is requested.
fn on_cpu(path: &Path, image: &AnyImage, index: u32, args: &DecompressArgs) -> Result<Raster, CliError> {
    // Strips are wider than between texels at level 0 alone.
    let blended = image.downcast_ref::<EpitomeTexture>().filter(|_| args.continuous && args.lod == 0);
    let Some(epitome) = blended else {
        return decode(path, image.as_encoded(), index, args.lod);
    };
    let layout = epitome.layout();
    let ImageSize { width, height } = layout.images[index as usize];
    let texels = epitome.draw(index, Vec2::ZERO, Vec2::ONE, (width, height));
    let fault = |source: SourceError| CliError::Encode { path: path.to_owned(), source: source.into() };
    Raster::from_texels(width, height, layout.pixel, &texels).map_err(fault)
}

/// Says so where the file was cut, or has fewer layers than wanted.
fn warn_of_layers(path: &Path, wanted: Option<u32>, Layers { loaded, total }: Layers) {
    let warn = |what: &str| complain(&format!("{}: {what}", path.display()));
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
    if args.layers.is_some() && encoded.layers().total == 1 {
        Err(missing("layers"))
    } else if args.terms.is_some() {
        Err(missing("terms"))
    } else if args.lod >= encoded.layout().levels {
        let source = RegionError::NoSuchLevel { level: args.lod, levels: encoded.layout().levels };
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

/// `<stem>.png`, or `<stem>-000.png` and so on where there are several.
pub(crate) fn name(path: &Path, image: usize, images: usize) -> std::ffi::OsString {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    if images > 1 {
        let digits = NUMBER_DIGITS.max((images - 1).to_string().len());
        name.push(format!("-{image:0digits$}"));
    }
    name.push(".png");
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_sort_as_the_images_do() {
        assert_eq!(name(Path::new("a/wall.txf"), 0, 1), "wall.png");
        assert_eq!(name(Path::new("wall.txf"), 7, 8), "wall-007.png");
        assert_eq!(name(Path::new("wall.txf"), 7, 1001), "wall-0007.png");
    }
}
