//! Pictures of what a file holds, for a person to look at.

use std::path::{Path, PathBuf};

use texfold::AnyImage;
use texfold_core::image::Raster;

use crate::config::Options;
use crate::decompress::{decode, name};
use crate::error::CliError;
use crate::input::{find, read_set};
use crate::output::make_folder;
use crate::run::say;
use crate::{compress, picture, png};

/// Writes `<stem>-<part>.png` for each part to `dir`, and says what was written.
pub(crate) fn write(
    path: &Path,
    image: &AnyImage,
    dir: &Path,
    original: Option<&Path>,
) -> Result<(), CliError> {
    make_folder(dir)?;
    let save = |part: &str, surface: usize, surfaces: usize, raster: &Raster| -> Result<(), CliError> {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let output = dir.join(name(Path::new(&format!("{stem}-{part}.txf")), surface, surfaces));
        png::write(&output, raster)?;
        say(&format!("wrote {}", output.display()));
        Ok(())
    };
    let encoded = image.as_encoded();
    let surfaces = encoded.layout().surfaces.len();
    for (part, rasters) in parts(image) {
        for (number, raster) in rasters.iter().enumerate() {
            save(part, number, rasters.len(), raster)?;
        }
    }
    let originals = original.map(|original| read_original(original, surfaces)).transpose()?;
    for surface in 0..surfaces {
        let decoded = decode(path, encoded, surface as u32, 0)?;
        save("decoded", surface, surfaces, &decoded)?;
        if let Some(source) = originals.as_ref().and_then(|images| images.get(surface)) {
            save("error", surface, surfaces, &picture::error(source, &decoded))?;
        }
    }
    if originals.is_some() {
        say(&format!("errors are shown {} times as large, 0 as middle gray", picture::ERROR_GAIN));
    }
    Ok(())
}

/// Pictures of the codec's own parts, by name: one for each image, or one for each plane that all share.
fn parts(image: &AnyImage) -> Vec<(&'static str, Vec<Raster>)> {
    match image {
        AnyImage::Vq(texture) => texfold_vq::pictures(texture).map_or(Vec::new(), |parts| {
            vec![("codebook", vec![parts.codebook]), ("index", parts.index), ("usage", parts.usage)]
        }),
        AnyImage::Epitome(texture) => texfold_epitome::pictures(texture).map_or(Vec::new(), |parts| {
            vec![
                ("epitome", parts.epitomes),
                ("position", parts.positions),
                ("offset", parts.offsets),
                ("side", parts.sides),
                ("scale", parts.scales),
                ("charts", parts.charts),
                ("usage", parts.usage),
            ]
        }),
        AnyImage::Progressive(texture) => {
            texfold_progressive::pictures(texture).map_or(Vec::new(), |parts| {
                vec![
                    ("base", parts.bases),
                    ("bits", parts.bits),
                    ("source", parts.sources),
                    ("codebook", parts.codebooks),
                    ("usage", parts.usage),
                ]
            })
        }
        AnyImage::Bc(_) | AnyImage::Zipmap(_) => Vec::new(),
    }
}

/// The images of a file or folder, as `compress` reads them.
fn read_original(original: &Path, surfaces: usize) -> Result<Vec<Raster>, CliError> {
    let settings = Options::default().resolve(original)?;
    let mut files: Vec<PathBuf> = Vec::new();
    for found in find(&[original.to_owned()], |_| None) {
        files.extend(found.map_err(|unusable| *unusable.error)?.files);
    }
    files.truncate(surfaces);
    Ok(read_set(&files, &settings, compress::usual_limit())?.images().to_vec())
}
