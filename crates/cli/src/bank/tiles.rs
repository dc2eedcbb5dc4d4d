//! Images read band by band, so that memory does not grow with them.

use std::path::Path;

use texfold_core::SurfaceSize;
use texfold_core::image::Raster;

use crate::config::Settings;
use crate::error::CliError;
use crate::input::{self, bands::Bands};

/// Texels a side of a tile: the paper's.
pub(crate) const TILE: u32 = 1024;

/// Hands the tiles of the image at `path` to `take`, row by row: column and row of the tile's first texel, and its texels.
pub(crate) fn each(
    path: &Path,
    settings: &Settings,
    limit_bytes: u64,
    mut take: impl FnMut(u32, u32, Raster) -> Result<(), CliError>,
) -> Result<SurfaceSize, CliError> {
    let mut bands = Bands::open(path, settings, limit_bytes, || {
        let set = input::read_set(&[path.to_owned()], settings, limit_bytes)?;
        Ok(set.images()[0].clone())
    })?;
    let size = bands.size();
    for top in (0..size.height).step_by(TILE as usize) {
        let band = bands.next(TILE.min(size.height - top))?;
        for left in (0..size.width).step_by(TILE as usize) {
            take(left, top, band.cut(left, TILE.min(size.width - left))?)?;
        }
    }
    Ok(size)
}
