//! Images on their way into a bank: what is to be added, where it goes, and what it leaves behind.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use texfold_progressive::Codebook;

use crate::compress::add_file;
use crate::error::CliError;
use crate::settings::Settings;

/// An image that is to be in a bank.
#[derive(Debug)]
pub(crate) struct BankTask {
    pub(crate) path: PathBuf,
    pub(crate) name: String,
    /// The category that it is of, where that is said.
    pub(crate) category: Option<String>,
    pub(crate) settings: Settings,
}

/// Where an image comes to lie in a bank.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place<'p> {
    /// The bank's folder.
    pub(super) dir: &'p Path,
    /// Number of its first file.
    pub(super) first: u32,
    /// Categories of its tiles, row by row.
    pub(super) categories: &'p [usize],
    pub(super) limit_bytes: u64,
    /// Reference value of errors: [`texfold_core::image::Raster::peak`].
    pub(super) peak: f32,
}

/// A category with the codebook that an image leaves it with.
#[derive(Debug)]
pub(super) struct Grown {
    pub(super) number: usize,
    pub(super) tiles: u32,
    pub(super) book: Option<Arc<Codebook>>,
    /// File and rows, where it has grown.
    pub(super) file: Option<(String, u32)>,
}

/// Public codebooks by category.
pub(crate) type Books = HashMap<usize, Option<Arc<Codebook>>>;

impl BankTask {
    /// Hash of all that the stored form depends on, but the bank's codebooks.
    pub(super) fn key(&self) -> Result<String, CliError> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(format!("{:?}", self.settings).as_bytes());
        add_file(&mut hasher, &self.path)
            .map_err(|source| CliError::Read { path: self.path.clone(), source })?;
        Ok(hasher.finalize().to_hex().to_string())
    }
}
