//! Opening files of any codec.

use std::io::{self, Read};

use texfold_core::container::Sections;
use texfold_core::{Budget, LimitError, Limits, LoadError};
use texfold_lightfield::LightTexture;

use crate::{AnyImage, AnyTexture, Registration};

/// Why a file cannot be opened from a reader.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// The reader failed.
    #[error("the file cannot be read; see the cause")]
    Read(#[from] io::Error),
    /// What was read is no texture that can be loaded.
    #[error(transparent)]
    Load(#[from] LoadError),
}

/// Loads a `.txf` file of any codec.
///
/// # Errors
/// [`LoadError`] names what is wrong with the file.
pub fn open(bytes: &[u8], budget: &mut Budget) -> Result<AnyTexture, LoadError> {
    let file = Sections::parse(bytes, budget)?;
    let found = file.codec();
    Registration::by_number(found).ok_or(LoadError::NotThisCodec { found })?.load(&file, budget)
}

/// As [`open`], from a file or a stream. Reads no more than `limits` allow.
///
/// # Errors
/// [`OpenError`]: the reader's own, or what is wrong with the file.
pub fn open_from(reader: impl Read, limits: Limits) -> Result<AnyTexture, OpenError> {
    let mut bytes = Vec::new();
    reader.take(limits.bytes.saturating_add(1)).read_to_end(&mut bytes)?;
    let length = bytes.len() as u64;
    if length > limits.bytes {
        let error = LimitError { what: "bytes", needed: length, allowed: limits.bytes };
        return Err(LoadError::from(error).into());
    }
    Ok(open(&bytes, &mut Budget::new(limits))?)
}

/// Loads a `.txf` file that holds images.
///
/// # Errors
/// [`LoadError`] names what is wrong with the file, or the codec where it holds a light field.
pub fn open_image(bytes: &[u8], budget: &mut Budget) -> Result<AnyImage, LoadError> {
    let texture = open(bytes, budget)?;
    let found = texture.codec().number;
    texture.into_image().ok_or(LoadError::NotThisCodec { found })
}

/// Loads a `.txf` file that holds a surface light field.
///
/// # Errors
/// [`LoadError`] names what is wrong with the file, or the codec where it holds images.
pub fn open_light(bytes: &[u8], budget: &mut Budget) -> Result<LightTexture, LoadError> {
    let texture = open(bytes, budget)?;
    let found = texture.codec().number;
    texture.into_light().ok_or(LoadError::NotThisCodec { found })
}
