//! Images read band by band, so that memory does not grow with them.

use std::path::Path;

use texfold_core::image::Raster;
use texfold_core::{SurfaceSize, Texel};
use texfold_progressive::AROUND;

use crate::config::Settings;
use crate::error::CliError;
use crate::input::{
    self,
    bands::{Band, Bands},
};

/// Texels a side of a tile: the paper's.
pub(crate) const TILE: u32 = 1024;

/// A tile of an image.
pub(crate) struct Cut<'b> {
    /// Column and row of its first texel.
    pub(crate) place: (u32, u32),
    /// Its texels.
    pub(crate) tile: Raster,
    /// The rows of the image that hold the tile and what surrounds it, and the tile's first among them.
    band: (&'b Band, u32),
    image: SurfaceSize,
}

impl Cut<'_> {
    /// The tile with [`AROUND`] texels on each side; beyond the image those of its edge. `None` of an image in one tile.
    pub(crate) fn around(&self) -> Result<Option<Raster>, CliError> {
        let (size, (band, top)) = (self.tile.size(), self.band);
        if size == self.image {
            return Ok(None);
        }
        let first = self.place.0.saturating_sub(AROUND);
        let end = (self.place.0 + size.width + AROUND).min(self.image.width);
        let texels = band.cut(first, end - first)?;
        let (width, height) = (size.width + 2 * AROUND, size.height + 2 * AROUND);
        let clamped = |at: u32, start: u32, count: u32| (at + start).saturating_sub(AROUND).min(count - 1);
        let texel = |i: u32| {
            let x = clamped(i % width, self.place.0 - first, end - first);
            texels.texel(x, clamped(i / width, top, band.rows()))
        };
        let all: Vec<Texel> = (0..width * height).map(texel).collect();
        let around = Raster::from_texels(width, height, texels.info(), &all);
        around.map(Some).map_err(|source| CliError::Source { path: band.path().to_owned(), source })
    }
}

/// Hands the tiles of the image at `path` to `take`, row by row.
pub(crate) fn each(
    path: &Path,
    settings: &Settings,
    limit_bytes: u64,
    mut take: impl FnMut(Cut<'_>) -> Result<(), CliError>,
) -> Result<SurfaceSize, CliError> {
    let mut bands = Bands::open(path, settings, limit_bytes, || {
        let set = input::read_set(&[path.to_owned()], settings, limit_bytes)?;
        Ok(set.images()[0].clone())
    })?;
    let size = bands.size();
    let mut held: Option<Band> = None;
    let mut read = 0;
    for top in (0..size.height).step_by(TILE as usize) {
        let height = TILE.min(size.height - top);
        let (first, end) = (top.saturating_sub(AROUND), (top + height + AROUND).min(size.height));
        let band = match held.take() {
            Some(held) if end > read => held.followed(read - first, bands.next(end - read)?)?,
            Some(held) => held.last(read - first),
            None => bands.next(end)?,
        };
        read = end;
        for left in (0..size.width).step_by(TILE as usize) {
            let tile = band.cut_rows((left, TILE.min(size.width - left)), (top - first, height))?;
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
        // The last row of tiles is lower than what surrounds the one before.
        let (width, height) = (TILE + 70, 2 * TILE + 9);
        let value = |x: u32, y: u32| (x * 7 + y * 31 + x * y % 13) as u8;
        let bytes: Vec<u8> = (0..width * height).map(|i| value(i % width, i / width)).collect();
        for extension in ["png", "tif"] {
            let path = dir.path().join(format!("a.{extension}"));
            image::save_buffer(&path, &bytes, width, height, image::ExtendedColorType::L8).unwrap();
            let settings = Options::of_pixels(ColorName::Srgb, None).resolve(&path).unwrap();
            let mut places = Vec::new();
            let size = each(&path, &settings, 1 << 32, |cut| {
                let ((left, top), around) = (cut.place, cut.around()?.unwrap());
                places.push(cut.place);
                let source =
                    |at: u32, start: u32, count: u32| (start + at).saturating_sub(AROUND).min(count - 1);
                let SurfaceSize { width: across, height: down } = around.size();
                let wanted =
                    |x: u32, y: u32| f32::from(value(source(x, left, width), source(y, top, height)));
                let equal = |i: u32| {
                    let (x, y) = (i % across, i / across);
                    (around.texel(x, y).x * 255.0 - wanted(x, y)).abs() < 0.01
                };
                assert!((0..across * down).all(equal), "{extension} at {left} {top}");
                let own = |i: u32| {
                    let (x, y) = (i % (across - 2 * AROUND), i / (across - 2 * AROUND));
                    cut.tile.texel(x, y) == around.texel(x + AROUND, y + AROUND)
                };
                assert!((0..cut.tile.size().texels() as u32).all(own), "{extension} at {left} {top}");
                Ok(())
            });
            assert_eq!(size.unwrap(), SurfaceSize { width, height });
            assert_eq!(places.len(), 6);
        }
    }
}
