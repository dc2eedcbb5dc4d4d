//! Inputs: which files a command line names, and what is in them.

pub(crate) mod bands;
pub(crate) mod capture;
pub(crate) mod container;
mod exr_gray;
pub(crate) mod find;
pub(crate) mod foreign;
pub(crate) mod formats;
pub(crate) mod frames;
pub(crate) mod georeference;
mod jpeg;
pub(crate) mod material;
pub(crate) mod pixels;
mod profile;
pub(crate) mod remarks;
pub(crate) mod samples;
pub(crate) mod stack;

use std::io::Read;
use std::path::{Path, PathBuf};

use texfold_bc::Bc1Blocks;
use texfold_core::image::{ImageSet, Raster};
use texfold_core::{ImageSize, MAX_IMAGE_SIDE, SourceError};

use crate::error::CliError;
use crate::files;
use crate::settings::Settings;
pub(crate) use find::{Found, find};
pub(crate) use remarks::Remarks;

/// An image as its file holds it.
#[derive(Debug)]
pub(crate) enum Content {
    /// Decoded texels.
    Pixels(Raster),
    /// Blocks that need no encoding; whether the format knows alpha.
    Blocks { image: Bc1Blocks, alpha: bool },
}

/// Bytes that tell what a file is.
pub(crate) fn head_of(path: &Path) -> Result<Vec<u8>, CliError> {
    let failed = |source| CliError::Read { path: path.to_owned(), source };
    let mut head = Vec::new();
    files::open(path).map_err(failed)?.take(256).read_to_end(&mut head).map_err(failed)?;
    if head.is_empty() {
        return Err(CliError::EmptyFile { path: path.to_owned() });
    }
    Ok(head)
}

/// Columns and rows of the image in a file, from its header alone.
pub(crate) fn size_of(path: &Path) -> Result<ImageSize, CliError> {
    let head = head_of(path)?;
    match container::Container::of(&head) {
        Some(container) => container::size(path, container, &head),
        None => pixels::size(path),
    }
}

/// Reads one file; `limit_bytes` bounds what its decoder may allocate.
pub(crate) fn read(
    path: &Path,
    settings: &Settings,
    limit_bytes: u64,
    remarks: &mut Remarks,
) -> Result<Content, CliError> {
    match container::Container::of(&head_of(path)?) {
        Some(container) => container::read(path, container, settings, limit_bytes, remarks),
        None => pixels::read(path, settings.color, settings.alpha, limit_bytes, remarks).map(Content::Pixels),
    }
}

/// Reads the images of files, or with `all_frames` all frames or pages of each. The only file may be several images for its bands.
pub(crate) fn read_files(
    files: &[PathBuf],
    all_frames: bool,
    settings: &Settings,
    limit_bytes: u64,
    remarks: &mut Remarks,
) -> Result<Vec<Content>, CliError> {
    let mut contents = Vec::new();
    for path in files {
        if all_frames && frames::count(path) > 1 {
            let all = pixels::read_all(path, settings.color, settings.alpha, limit_bytes, remarks)?;
            contents.extend(all.into_iter().map(Content::Pixels));
        } else if files.len() == 1 && pixels::band_images(path) > 1 {
            let all = pixels::read_bands(path, settings.color, limit_bytes, remarks)?;
            contents.extend(all.into_iter().map(Content::Pixels));
        } else {
            contents.push(read(path, settings, limit_bytes, remarks)?);
        }
    }
    Ok(contents)
}

/// Reads images as one set, decoding blocks: for everything but the takeover of blocks.
pub(crate) fn read_set(
    files: &[PathBuf],
    all_frames: bool,
    settings: &Settings,
    limit_bytes: u64,
    remarks: &mut Remarks,
) -> Result<ImageSet, CliError> {
    let first = files.first().cloned().unwrap_or_default();
    let rasters: Result<Vec<Raster>, CliError> =
        read_files(files, all_frames, settings, limit_bytes, remarks)?
            .into_iter()
            .map(|content| match content {
                Content::Pixels(raster) => Ok(raster),
                Content::Blocks { image, alpha } => container::decode(&first, image, alpha, settings),
            })
            .collect();
    ImageSet::new(rasters?).map_err(|source| CliError::Source { path: first, source })
}

/// Notes that errors are measured against fewer bits than a source has, where that is so.
pub(crate) fn note_of_peak(path: &Path, peak: f32, remarks: &mut Remarks) {
    if peak > 0.0 && peak < 1.0 {
        let bits = (peak * f32::from(u16::MAX)).log2().ceil();
        remarks.note(path, format!("values use {bits} of 16 bits: errors are measured against these"));
    }
}

/// Refuses images without texels, and sides that no codec takes.
pub(crate) fn check_side(path: &Path, size: ImageSize) -> Result<ImageSize, CliError> {
    let ImageSize { width, height } = size;
    let source = if width == 0 || height == 0 {
        SourceError::ZeroSize { index: 0, width, height }
    } else if width > MAX_IMAGE_SIDE || height > MAX_IMAGE_SIDE {
        SourceError::TooLarge { index: 0, width, height, max: MAX_IMAGE_SIDE }
    } else {
        return Ok(size);
    };
    Err(CliError::Source { path: path.to_owned(), source })
}
