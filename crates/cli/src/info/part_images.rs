//! Images of what a file holds, for a person to look at.

use std::path::{Path, PathBuf};

use texfold::AnyImage;
use texfold::encoding::parts_of;
use texfold::vq::{Map, Vq, distortion_map, saliency_map};
use texfold_capture::read_uv_mesh;
use texfold_core::image::{ColorSpace, PartImages, Raster, to_u8};
use texfold_core::{ImageSize, SourceError, TextureCodec};

use crate::config::Options;
use crate::console::say;
use crate::decompress::{decode, name};
use crate::error::CliError;
use crate::input::{Remarks, find, read_set};
use crate::output::make_folder;
use crate::{memory, png, thumbnail};

/// Bytes of a texel of a part's image, of what it is decoded from and of its file.
const BYTES_PER_TEXEL: u64 = 48;

/// Writes `<stem>-<part>.png` for each part to `dir`, and says what was written.
pub(crate) fn write(
    path: &Path,
    image: &AnyImage,
    dir: &Path,
    original: Option<&Path>,
    mesh: Option<&Path>,
    limit_bytes: u64,
) -> Result<(), CliError> {
    let texels: u64 = image.as_encoded().layout().images.iter().map(|size| size.texels()).sum();
    memory::check(path, texels.saturating_mul(BYTES_PER_TEXEL), limit_bytes)?;
    make_folder(dir)?;
    let save = |part: &str, index: usize, images: usize, raster: &Raster| -> Result<(), CliError> {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let output = dir.join(name(Path::new(&format!("{stem}-{part}.txf")), index, images, ".png"));
        png::write(&output, raster)?;
        say(&format!("wrote {}", output.display()));
        Ok(())
    };
    let encoded = image.as_encoded();
    let images = encoded.layout().images.len();
    for PartImages { name, images } in parts_of(image) {
        for (number, raster) in images.iter().enumerate() {
            save(name, number, images.len(), raster)?;
        }
    }
    let originals = original.map(|original| read_original(original, images, limit_bytes)).transpose()?;
    for index in 0..images {
        let decoded = decode(path, encoded, index as u32, 0)?;
        save("decoded", index, images, &decoded)?;
        if let Some(source) = originals.as_ref().and_then(|images| images.get(index)) {
            save("error", index, images, &thumbnail::error(source, &decoded))?;
            if encoded.codec() == Vq::ID {
                let map = gray(&saliency_map(source));
                let map = map.map_err(|source| CliError::Source { path: path.to_owned(), source })?;
                save("saliency", index, images, &map)?;
            }
        }
    }
    if let Some(mesh) = mesh {
        if encoded.codec() != Vq::ID {
            let codec = encoded.codec().name;
            return Err(CliError::NoSuchPart { path: path.to_owned(), codec, option: "mesh" });
        }
        let ImageSize { width, height } = encoded.layout().images[0];
        let map = distortion_map(&read_uv_mesh(mesh)?, width, height).and_then(|map| gray(&map));
        save("distortion", 0, 1, &map.map_err(|source| CliError::Source { path: mesh.to_owned(), source })?)?;
    }
    if originals.is_some() {
        say(&format!("error images: errors are scaled by {}, and 0 is middle gray", thumbnail::ERROR_GAIN));
    }
    Ok(())
}

/// A map of importance, 0 black and 1 white.
fn gray(map: &Map) -> Result<Raster, SourceError> {
    let (height, width) = map.dim();
    let texels: Vec<u8> = map.iter().map(|&value| to_u8(value)).collect();
    Raster::from_u8(width as u32, height as u32, 1, ColorSpace::Linear, &texels)
}

/// The images of a file or folder, as `compress` reads them.
pub(crate) fn read_original(
    original: &Path,
    images: usize,
    limit_bytes: u64,
) -> Result<Vec<Raster>, CliError> {
    let mut files: Vec<PathBuf> = Vec::new();
    for found in find(&[original.to_owned()], |_| None).found {
        files.extend(found.map_err(|unusable| *unusable.error)?.files);
    }
    files.truncate(images);
    let settings = Options::default().resolve_files(original, &files)?;
    let all_frames = images > files.len();
    Ok(read_set(&files, all_frames, &settings, limit_bytes, &mut Remarks::default())?.images().to_vec())
}
