//! The list of a bank, with a row of the report for each image.

use std::path::Path;

use base64::prelude::{BASE64_STANDARD, Engine};
use texfold::bank::{BankError, MANIFEST};
use texfold_core::Access;

use crate::error::CliError;
use crate::input::georeference::Georeference;
use crate::report::Row;

pub(crate) type Image = texfold::bank::Image<Row>;
pub(crate) type Bank = texfold::bank::Bank<Row>;
pub(super) type Writer = texfold::bank::BankWriter<Row>;

/// Opens the bank in a folder.
pub(crate) fn open(dir: &Path) -> Result<Bank, CliError> {
    let bank = Bank::open(dir)?;
    check(&bank)?;
    Ok(bank)
}

/// Refuses georeferences that cannot be.
pub(super) fn check(bank: &Bank) -> Result<(), CliError> {
    let is_misplaced = |image: &&Image| !image.georeference.is_empty() && georeference_of(image).is_none();
    match bank.images().iter().find(is_misplaced) {
        None => Ok(()),
        Some(image) => {
            let what = format!("image {} has a georeference that cannot be", image.name);
            Err(BankError::Manifest { path: bank.dir().join(MANIFEST), what }.into())
        }
    }
}

/// Access to the texels of an image.
pub(crate) fn access_of(image: &Image) -> Access {
    if image.row.access == Access::Block.name() { Access::Block } else { Access::Texel }
}

/// The place of an image on Earth and the meaning of its bands, where they are known.
pub(crate) fn georeference_of(image: &Image) -> Option<Georeference> {
    Georeference::parse(&BASE64_STANDARD.decode(&image.georeference).ok()?)
}
