//! Banks: folders of large images in tiles.

use std::path::PathBuf;

use pyo3::prelude::*;
use texfold::Rect;
use texfold::bank::{Bank as Tiles, BankError};

use crate::error::{load_error, region_error};
use crate::texture::Values;

/// A bank that is read.
#[pyclass(frozen, module = "texfold._texfold")]
pub(crate) struct Bank(Tiles);

/// First column and row of a part of a region, its rows, columns and channels, and its values.
type Part<'py> = ((u32, u32), (u32, u32, u8), Bound<'py, PyAny>);

fn raised(error: &BankError) -> PyErr {
    match error {
        BankError::Region(error) => region_error(error),
        _ => load_error(error),
    }
}

#[pymethods]
impl Bank {
    /// The bank in a folder.
    #[new]
    fn open(py: Python<'_>, folder: PathBuf) -> PyResult<Bank> {
        py.detach(|| Tiles::open(&folder)).map(Bank).map_err(|error| raised(&error))
    }

    /// Name, rows, columns, channels and mip levels of each image.
    #[getter]
    fn images(&self) -> Vec<(String, u32, u32, u8, u32)> {
        let image = |image: &texfold::bank::Image| {
            (image.name.clone(), image.height, image.width, image.channels, image.levels)
        };
        self.0.images().iter().map(image).collect()
    }

    /// The TIFF of one texel with the GeoTIFF tags of an image in Base64; empty where there are none.
    fn georeference(&self, image: usize) -> &str {
        self.0.images().get(image).map_or("", |image| &image.georeference)
    }

    /// Values of a region of a level, tile by tile.
    fn parts<'py>(
        &self,
        py: Python<'py>,
        image: u32,
        level: u32,
        region: [u32; 4],
    ) -> PyResult<Vec<Part<'py>>> {
        let [x, y, width, height] = region;
        let parts = self.0.parts(Rect { image, level, x, y, width, height });
        let parts = parts.map_err(|error| region_error(&error))?;
        let decode = |part: texfold::bank::Part<'_>| {
            let (channels, values) = py.detach(|| {
                let texture = self.0.tile(part.tile).map_err(|error| raised(&error))?;
                let channels = texture.as_encoded().layout().pixel_of(0).channels;
                Values::of(&texture, part.rect).map(|values| (channels, values))
            })?;
            py.check_signals()?;
            Ok((part.corner, (part.rect.height, part.rect.width, channels), values.into_array(py)))
        };
        parts.map(decode).collect()
    }
}
