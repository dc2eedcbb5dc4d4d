//! Images that are to be in a bank.

use std::path::PathBuf;

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
