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
            Some(held) if end > read => held.followed(read - first, bands.next(end - read)?),
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
