//! The list of a bank, with a row of the report for each image.

use std::path::Path;

use base64::prelude::{BASE64_STANDARD, Engine};
use texfold_core::Access;

use crate::console::warn;
use crate::error::CliError;
use crate::input::georeference::Georeference;
use crate::report::Row;

pub(crate) type Image = texfold::bank::Image<Row>;
pub(crate) type Bank = texfold::bank::Bank<Row>;
pub(super) type Writer = texfold::bank::BankWriter<Row>;

/// Opens the bank in a folder.
pub(crate) fn open(dir: &Path) -> Result<Bank, CliError> {
    let bank = Bank::open(dir)?;
    warn_of_georeferences(&bank);
    Ok(bank)
}

/// Warns of damaged georeferences, without which the images can be read.
pub(super) fn warn_of_georeferences(bank: &Bank) {
    let is_damaged = |image: &&Image| !image.georeference.is_empty() && georeference_of(image).is_none();
    for image in bank.images().iter().filter(is_damaged) {
        let (dir, name) = (bank.dir().display(), &image.name);
        warn(&format!("{dir}: the georeference of {name} is damaged and left out; add the image again"));
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
