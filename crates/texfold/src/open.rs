//! Opening files of any codec.

use std::io::{self, Read};

use texfold_core::container::Sections;
use texfold_core::{Budget, LimitError, Limits, LoadError};

use crate::{AnyTexture, Registration};

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

/// Loads a `.txf` file of any codec, within the usual [`Limits`].
///
/// # Errors
/// [`LoadError`] names what is wrong with the file.
pub fn open(bytes: &[u8]) -> Result<AnyTexture, LoadError> {
    open_with(bytes, &Limits::default())
}

/// As [`open`], within limits of the caller's.
///
/// # Errors
/// [`LoadError`] names what is wrong with the file, or the limit.
pub fn open_with(bytes: &[u8], limits: &Limits) -> Result<AnyTexture, LoadError> {
    let mut budget = Budget::new(*limits);
    let file = Sections::parse(bytes, &mut budget)?;
    let found = file.codec();
    Registration::by_number(found).ok_or(LoadError::NotThisCodec { found })?.load(&file, &mut budget)
}

/// As [`open_with`], from a file or a stream. Reads no more than `limits` allow.
///
/// # Errors
/// [`OpenError`]: the reader's own, or what is wrong with the file.
pub fn open_from(reader: impl Read, limits: &Limits) -> Result<AnyTexture, OpenError> {
    let mut bytes = Vec::new();
    reader.take(limits.bytes.saturating_add(1)).read_to_end(&mut bytes)?;
    let length = bytes.len() as u64;
    if length > limits.bytes {
        let error = LimitError { what: "bytes", needed: length, allowed: limits.bytes };
        return Err(LoadError::from(error).into());
    }
    Ok(open_with(&bytes, limits)?)
}
