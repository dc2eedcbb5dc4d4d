//! Images read band by band, so that memory does not grow with them.

use std::path::Path;

use texfold::bank::{LEAST_SIDE as LEAST, TILE_SIDE as TILE, around, cuts};
use texfold_core::ImageSize;
use texfold_core::image::Raster;
use texfold_progressive::APRON;

use crate::error::CliError;
use crate::input::{
    self, Remarks,
    bands::{Band, Bands},
};
use crate::settings::Settings;

/// Most rows that are held at a time.
pub(crate) const MOST_ROWS: u32 = TILE + LEAST + 2 * APRON;

/// A tile of an image.
pub(crate) struct Cut<'b> {
    /// Column and row of its first texel.
    pub(crate) place: (u32, u32),
    /// Its texels.
    pub(crate) tile: Raster,
    /// The rows of the image that hold the tile and what surrounds it, and the tile's first among them.
    band: (&'b Band, u32),
    image: ImageSize,
}

impl Cut<'_> {
    /// The tile with at most [`APRON`] texels on each side; beyond the image those of its edge. `None` of an image in one tile.
    pub(crate) fn around(&self, apron: u32) -> Result<Option<Raster>, CliError> {
        let (ImageSize { width, height }, (band, top)) = (self.tile.size(), self.band);
        if self.tile.size() == self.image {
            return Ok(None);
        }
        let columns = around((self.place.0, width), apron, self.image.width);
        let rows: Vec<u32> = (top..top + height + 2 * apron).map(|row| row.saturating_sub(apron)).collect();
        let (first, last) = (columns[0], columns[columns.len() - 1]);
        let texels = band.cut(first, last + 1 - first)?;
        let columns: Vec<u32> = columns.iter().map(|column| column - first).collect();
        Ok(Some(texels.pick(&columns, &rows)))
    }
}

/// Hands the tiles of the image at `path` to `take`, row by row.
pub(crate) fn each(
    path: &Path,
    settings: &Settings,
    limit_bytes: u64,
    remarks: &mut Remarks,
    mut take: impl FnMut(Cut<'_>) -> Result<(), CliError>,
) -> Result<ImageSize, CliError> {
    let mut bands = Bands::open(path, settings, limit_bytes, remarks, |remarks| {
        let set = input::read_set(&[path.to_owned()], false, settings, limit_bytes, remarks)?;
        Ok(set.images()[0].clone())
    })?;
    let size = bands.size();
    let mut held: Option<Band> = None;
    let mut read = 0;
    for (top, height) in cuts(size.height) {
        let (first, end) = (top.saturating_sub(APRON), (top + height + APRON).min(size.height));
        let band = match held.take() {
            Some(held) => held.followed(read - first, bands.next(end - read)?)?,
            None => bands.next(end)?,
        };
        read = end;
        for (left, width) in cuts(size.width) {
            let tile = band.cut_rows((left, width), (top - first, height))?;
            take(Cut { place: (left, top), tile, band: (&band, top - first), image: size })?;
        }
        held = Some(band);
    }
    Ok(size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{ColorName, Options};

    #[test]
    fn tiles_are_cut_with_what_surrounds_them_and_the_edge_beyond_the_image() {
        let dir = tempfile::tempdir().unwrap();
        let (width, height) = (TILE + LEAST + 70, 2 * TILE + LEAST);
        let value = |x: u32, y: u32| (x * 7 + y * 31 + x * y % 13) as u8;
        let bytes: Vec<u8> = (0..width * height).map(|i| value(i % width, i / width)).collect();
        for extension in ["png", "tif"] {
            let path = dir.path().join(format!("a.{extension}"));
            image::save_buffer(&path, &bytes, width, height, image::ExtendedColorType::L8).unwrap();
            let settings = Options::of_pixels(Some(ColorName::Srgb), None).resolve(&path).unwrap();
            let mut places = Vec::new();
            let size = each(&path, &settings, 1 << 32, &mut Remarks::default(), |cut| {
                let ((left, top), around) = (cut.place, cut.around(APRON)?.unwrap());
                places.push(cut.place);
                let source =
                    |at: u32, start: u32, count: u32| (start + at).saturating_sub(APRON).min(count - 1);
                let ImageSize { width: across, height: down } = around.size();
                let wanted =
                    |x: u32, y: u32| f32::from(value(source(x, left, width), source(y, top, height)));
                let equal = |i: u32| {
                    let (x, y) = (i % across, i / across);
                    (around.texel(x, y).x * 255.0 - wanted(x, y)).abs() < 0.01
                };
                assert!((0..across * down).all(equal), "{extension} at {left} {top}");
                let own = |i: u32| {
                    let (x, y) = (i % (across - 2 * APRON), i / (across - 2 * APRON));
                    cut.tile.texel(x, y) == around.texel(x + APRON, y + APRON)
                };
                assert!((0..cut.tile.size().texels() as u32).all(own), "{extension} at {left} {top}");
                Ok(())
            });
            assert_eq!(size.unwrap(), ImageSize { width, height });
            assert_eq!(places.len(), 4);
        }
    }
}
