//! The page of images: what the settings make of each input, to zoom into.

use std::collections::BTreeMap;
use std::path::Path;

use base64::prelude::{BASE64_STANDARD, Engine};
use texfold_core::image::Raster;

use super::table::Row;
use crate::error::CliError;
use crate::output::write_whole;
use crate::png;
use crate::view::{Group, Item, Picture, page};

/// Most bytes of all files and PNGs of the page: browsers hold it whole.
const MOST_BYTES: usize = 64 << 20;

/// Files and originals of the page.
#[derive(Debug, Default)]
pub(crate) struct Pictures {
    items: Vec<Item>,
    groups: BTreeMap<String, Group>,
    bytes: usize,
    left_out: usize,
}

impl Pictures {
    /// Adds an input's first image.
    pub(crate) fn add_original(&mut self, input: &str, image: &Raster) -> Result<(), CliError> {
        if let Some(data) = self.png(input, image)? {
            self.groups.entry(input.to_owned()).or_default().originals.push(data);
        }
        Ok(())
    }

    /// Adds what a setting makes of an input: its file, or the decoded image where it has none. Gives the file's number in the page.
    pub(crate) fn add(
        &mut self,
        row: &Row,
        decoded: &Raster,
        file: Option<Vec<u8>>,
    ) -> Result<Option<usize>, CliError> {
        let Some(file) = file else {
            if let Some(data) = self.png(&row.input, decoded)? {
                let rival = Picture { name: row.title(), data };
                self.groups.entry(row.input.clone()).or_default().rivals.push(rival);
            }
            return Ok(None);
        };
        if !self.fits(file.len()) {
            return Ok(None);
        }
        let place = self.items.len();
        let input = Path::new(&row.input).file_name().unwrap_or_default().to_string_lossy();
        self.items.push(Item::of_group(format!("{input}: {}", row.title()), &file, &row.input));
        Ok(Some(place))
    }

    /// Writes the page; warns where images are left out.
    pub(crate) fn write(&self, path: &Path) -> Result<(), CliError> {
        if self.left_out > 0 {
            let most = MOST_BYTES >> 20;
            crate::console::warn(&format!(
                "{} of the images are not in {}, which holds {most} MiB; compare fewer inputs at once to see them",
                self.left_out,
                path.display()
            ));
        }
        write_whole(path, page(&self.items, &self.groups, false).as_bytes())
    }

    /// A PNG in base 64, where there is room for it.
    fn png(&mut self, input: &str, image: &Raster) -> Result<Option<String>, CliError> {
        let fault = |source| CliError::Draw { path: input.into(), source: Box::new(source) };
        let png = png::encode(image).map_err(fault)?;
        Ok(self.fits(png.len()).then(|| BASE64_STANDARD.encode(png)))
    }

    fn fits(&mut self, bytes: usize) -> bool {
        let fits = self.bytes + bytes <= MOST_BYTES;
        if fits {
            self.bytes += bytes;
        } else {
            self.left_out += 1;
        }
        fits
    }
}
