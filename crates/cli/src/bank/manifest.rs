//! The list of a bank, with a row of the report for each image.

use std::path::Path;

use base64::prelude::{BASE64_STANDARD, Engine};
use texfold::bank::{BankError, MANIFEST};
use texfold_core::Access;

use crate::error::CliError;
use crate::input::georeference::Georeference;
use crate::output::write_whole;
use crate::report::Row;

pub(crate) type Manifest = texfold::bank::Manifest<Row>;
pub(crate) type Image = texfold::bank::Image<Row>;
pub(crate) type Bank = texfold::bank::Bank<Row>;

/// Opens the bank in a folder.
pub(crate) fn open(dir: &Path) -> Result<Bank, CliError> {
    let bank = Bank::open(dir)?;
    let is_misplaced = |image: &&Image| !image.georeference.is_empty() && georeference_of(image).is_none();
    match bank.images().iter().find(is_misplaced) {
        None => Ok(bank),
        Some(image) => {
            let what = format!("image {} has a georeference that cannot be", image.name);
            Err(BankError::Manifest { path: dir.join(MANIFEST), what }.into())
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

/// Makes this the manifest of the bank in `dir`: from then on it counts.
pub(crate) fn commit(manifest: &mut Manifest, dir: &Path) -> Result<(), CliError> {
    let path = dir.join(MANIFEST);
    let has_blocks = manifest.images.iter().any(|image| access_of(image) == Access::Block);
    manifest.set_version(has_blocks);
    let text = serde_json::to_vec(manifest)
        .map_err(|source| CliError::Write { path: path.clone(), source: source.into() })?;
    write_whole(&path, &text)?;
    // The rename itself reaches the disk with the folder.
    if let Ok(folder) = std::fs::File::open(dir) {
        let _ = folder.sync_all();
    }
    Ok(())
}
