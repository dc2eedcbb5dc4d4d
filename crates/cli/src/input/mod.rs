//! Inputs: which files a command line names, and what is in them.

pub(crate) mod bands;
pub(crate) mod bc1;
pub(crate) mod capture;
pub(crate) mod find;
pub(crate) mod mesh;
pub(crate) mod pixels;
pub(crate) mod shape;
pub(crate) mod stack;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use texfold_bc::Bc1Blocks;
use texfold_core::image::{ImageSet, Raster};
use texfold_core::{ImageSize, MAX_IMAGE_SIDE, SourceError};

use crate::error::CliError;
use crate::settings::Settings;
pub(crate) use find::{Found, find};

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
    File::open(path).map_err(failed)?.take(256).read_to_end(&mut head).map_err(failed)?;
    if head.is_empty() {
        return Err(CliError::EmptyFile { path: path.to_owned() });
    }
    Ok(head)
}

/// Columns and rows of the image in a file, from its header alone.
pub(crate) fn size_of(path: &Path) -> Result<ImageSize, CliError> {
    let head = head_of(path)?;
    match bc1::Container::of(&head) {
        Some(container) => bc1::size(path, container, &head),
        None => pixels::size(path),
    }
}

/// Reads one file; `limit_bytes` bounds what its decoder may allocate.
pub(crate) fn read(path: &Path, settings: &Settings, limit_bytes: u64) -> Result<Content, CliError> {
    match bc1::Container::of(&head_of(path)?) {
        Some(container) => bc1::read(path, container),
        None => pixels::read(path, settings.color, settings.alpha, limit_bytes).map(Content::Pixels),
    }
}

/// Reads images as one set, decoding blocks: for everything but the takeover of blocks.
pub(crate) fn read_set(
    files: &[PathBuf],
    settings: &Settings,
    limit_bytes: u64,
) -> Result<ImageSet, CliError> {
    let rasters: Result<Vec<Raster>, CliError> = files
        .iter()
        .map(|path| match read(path, settings, limit_bytes)? {
            Content::Pixels(raster) => Ok(raster),
            Content::Blocks { image, alpha } => bc1::decode(path, image, alpha, settings),
        })
        .collect();
    let first = files.first().cloned().unwrap_or_default();
    ImageSet::new(rasters?).map_err(|source| CliError::Source { path: first, source })
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
