//! Causes for which a bank cannot be written to.

use std::error::Error;
use std::io;
use std::path::PathBuf;

use texfold_core::EncodeError;

use super::super::BankError;

/// Causes for which an image cannot be added to a bank. The bank is as it was before the image.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// A bank that cannot be read.
    #[error(transparent)]
    Bank(#[from] BankError),
    /// A file or folder cannot be written.
    #[error("{}: cannot be written; check that the folder exists and that there is space", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// Another process adds images.
    #[error("{}: another process adds images to this bank; wait for its end", path.display())]
    Locked {
        /// The bank's folder.
        path: PathBuf,
    },
    /// The name of an image or category cannot be that of a file on every system.
    #[error(
        "{name:?} cannot be the name of an image or a category; take one without control characters, folders and names of devices"
    )]
    Name {
        /// The name.
        name: String,
    },
    /// An image of that name is there, with other texels or settings.
    #[error(
        "an image {name:?} is in the bank already, with another key; give it another name, or replace it"
    )]
    Known {
        /// The name.
        name: String,
    },
    /// An image whose entry no reader of banks takes: larger than banks hold, or with a georeference that is too long.
    #[error(
        "the image cannot be in a bank ({what}); cut it into smaller ones, or leave out what is too long"
    )]
    Entry {
        /// The fault.
        what: String,
    },
    /// There are too many named categories.
    #[error("a bank has at most {most} named categories; take one of these, or none")]
    Categories {
        /// How many there may be.
        most: usize,
    },
    /// A source gave other tiles than before.
    #[error("the image changed while it was read; add it again")]
    Changed,
    /// A tile cannot be encoded.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// A source that cannot be read.
    #[error(transparent)]
    Source(Box<dyn Error + Send + Sync>),
}
