//! Banks that images are added to, in the steps that several processes can share: `texfold/_writing.py` puts them together.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use texfold::bank::{
    BankWriter as Writer, NewImage, Seen, SourceTile, StepErrors, Sums, TileSource, WriteError, block_source,
    block_tile_entry, check_size, search_tiles, step_errors, tile_file, tile_rects,
};
use texfold::core::metric::SquaredError;
use texfold::core::{Access, EncodeError, ImageSize, Rect};
use texfold::dct::{Dct, DctParams};
use texfold::progressive::Progressive;
use texfold::{Depth, EncodeSettings, ImageSet, Job, Raster};

use crate::encode::{Options, Pixels, named, raster_of};
use crate::error::{encode_error, load_error, write_error};

/// A bank that images are added to; it is locked until it is closed.
#[pyclass(frozen, module = "texfold._texfold")]
pub(crate) struct BankWriter(Mutex<Option<Writer>>);

/// Name, key, category, georeference in base64, and whether one of its name is replaced.
type New = (String, String, Option<String>, String, bool);

/// First column and row, columns, rows and category of a tile.
type Place = (u32, u32, u32, u32, usize);

fn new_image((name, key, category, georeference, replaces): &New) -> NewImage<'_> {
    NewImage { name, key, category: category.as_deref(), georeference, replaces: *replaces }
}

impl BankWriter {
    fn with<T>(&self, work: impl FnOnce(&mut Writer) -> Result<T, WriteError>) -> PyResult<T> {
        work(self.held().as_mut().ok_or_else(closed)?).map_err(|error| raised(&error))
    }

    fn held(&self) -> MutexGuard<'_, Option<Writer>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn closed() -> PyErr {
    PyValueError::new_err(
        "the bank is closed, or another thread adds an image; open it again, or wait for its end",
    )
}

/// An image whose tiles a callback gives.
struct Tiles {
    size: ImageSize,
    tile: Py<PyAny>,
    options: Options,
}

impl Tiles {
    fn read(&self, Rect { x, y, width, height, .. }: Rect, apron: u32) -> PyResult<Raster> {
        Python::attach(|py| {
            py.check_signals()?;
            let found = self.tile.call1(py, (x, y, width, height, apron))?;
            raster_of(&found.extract(py)?, named(&self.options.color)?, &self.options.alpha)
        })
    }
}

impl TileSource for Tiles {
    type Error = Fault;

    fn each_tile(
        &self,
        apron: u32,
        take: &mut dyn FnMut(SourceTile) -> Result<(), Fault>,
    ) -> Result<ImageSize, Fault> {
        for rect in tile_rects(self.size) {
            let (place, Rect { width, height, .. }) = ((rect.x, rect.y), rect);
            let is_whole = (ImageSize { width, height }) == self.size;
            let tile = if apron == 0 || is_whole {
                SourceTile { place, texels: self.read(rect, 0)?, around: None }
            } else {
                let around = self.read(rect, apron)?;
                let texels = around.crop(Rect { x: apron, y: apron, ..rect });
                SourceTile { place, texels, around: Some(around) }
            };
            take(tile)?;
        }
        Ok(self.size)
    }
}

fn raised(error: &WriteError) -> PyErr {
    match error {
        WriteError::Bank(error) => load_error(error),
        WriteError::Encode(error) => encode_error(error),
        error => write_error(error),
    }
}

#[pymethods]
impl BankWriter {
    #[new]
    fn open(py: Python<'_>, folder: PathBuf) -> PyResult<BankWriter> {
        let writer = py.detach(|| Writer::open(&folder)).map_err(|error| raised(&error))?;
        Ok(BankWriter(Mutex::new(Some(writer))))
    }

    /// Gives the lock back.
    fn close(&self) {
        self.held().take();
    }

    /// Whether an image is not there yet.
    fn is_new(&self, image: New) -> PyResult<bool> {
        self.with(|writer| writer.is_new(&new_image(&image)))
    }

    /// The number of an image's first file, and the categories that its tiles of such colours join.
    fn categories(&self, image: New, colours: Vec<Vec<f32>>) -> PyResult<(u32, Vec<usize>)> {
        let seen = Seen { colours, ..Seen::default() };
        self.with(|writer| {
            Ok((writer.bank().manifest().next, writer.categories_for(&new_image(&image), &seen)?))
        })
    }

    /// Adds an image of that width and height by texel. `tile` gives the texels of a rectangle: of a column, a row, a width and a height, and
    /// so many texels more on each side, beyond the image those of its edge.
    fn add_texels(
        &self,
        py: Python<'_>,
        image: New,
        size: (u32, u32),
        tile: Py<PyAny>,
        options: Options,
    ) -> PyResult<()> {
        let params = options.settings()?.params::<Progressive>();
        let source = Tiles { size: ImageSize { width: size.0, height: size.1 }, tile, options };
        // Taken out, so that no thread waits for it while this one waits for the interpreter.
        let mut writer = self.held().take().ok_or_else(closed)?;
        let added = py
            .detach(|| writer.add_texels(&new_image(&image), &source, &params, &mut Job::default()))
            .map_err(|Fault(error)| error);
        *self.held() = Some(writer);
        added.map(drop)
    }

    /// Lists an image of that width and height whose tiles are written under the names of [`tile_name`] from `first` on.
    fn list(
        &self,
        image: New,
        size: (u32, u32),
        first: u32,
        tiles: Vec<(Place, TileSums)>,
        met: bool,
    ) -> PyResult<()> {
        let sums = tiles.iter().fold(Sums::default(), |all, (_, sums)| all.and(sums.0));
        let end = first + 2 * tiles.len() as u32;
        let tile = |(number, ((x, y, width, height, category), _)): (u32, &(Place, TileSums))| {
            block_tile_entry(
                tile_file(number),
                (*x, *y),
                ImageSize { width: *width, height: *height },
                *category,
            )
        };
        let tiles = (first..).zip(&tiles).map(tile).collect();
        let size = ImageSize { width: size.0, height: size.1 };
        self.with(|writer| {
            writer.list_blocks(&new_image(&image), (size, tiles), &sums.report(Access::Block, Some(met)), end)
        })
    }
}

/// Bits and errors of an encoded tile. They can be pickled, as they travel between processes.
#[pyclass(frozen, from_py_object, module = "texfold._texfold")]
#[derive(Clone)]
pub(crate) struct TileSums(Sums);

#[pymethods]
impl TileSums {
    #[new]
    fn parsed(text: &str) -> PyResult<TileSums> {
        let sums = Sums::parse(text).ok_or_else(|| PyValueError::new_err("no sums of a tile"))?;
        Ok(TileSums(sums))
    }

    /// Text form, as the constructor takes it.
    fn text(&self) -> String {
        self.0.to_text()
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> (Bound<'py, PyAny>, (String,)) {
        (py.get_type::<TileSums>().into_any(), (self.0.to_text(),))
    }
}

/// First and number of the columns of the tiles that cover so many, or of rows.
#[pyfunction]
pub(crate) fn tile_cuts(length: u32) -> PyResult<Vec<(u32, u32)>> {
    check_size(ImageSize { width: length, height: 1 }).map_err(|error| raised(&error))?;
    Ok(texfold::bank::cuts(length).collect())
}

/// Name of the file of a tile by its number.
#[pyfunction]
pub(crate) fn tile_name(number: u32) -> String {
    tile_file(number)
}

/// Shares of colours of a tile, and its own peak.
#[pyfunction]
pub(crate) fn tile_seen(
    py: Python<'_>,
    tile: Pixels<'_>,
    color: &str,
    alpha: &str,
) -> PyResult<(Vec<f32>, f32)> {
    let raster = raster_of(&tile, named(color)?, alpha)?;
    let seen = py.detach(|| {
        let mut seen = Seen::default();
        seen.add(&raster);
        seen
    });
    Ok((seen.colours.into_iter().next().unwrap_or_default(), seen.peak))
}

/// A tile as it is encoded, and the parameters.
fn source(tile: &Pixels<'_>, options: &Options, peak: f32) -> PyResult<(ImageSet, DctParams)> {
    let raster = raster_of(tile, named(&options.color)?, &options.alpha)?;
    Ok((block_source(raster, peak), params(options)?))
}

fn params(options: &Options) -> PyResult<DctParams> {
    let settings: EncodeSettings = options.settings()?;
    Ok(settings.params::<Dct>())
}

/// Bits, texels, sum of squared errors, values in it, and the RMS error of the worst block: of a tile at a step.
type Errors = (u64, u64, f64, u64, f64);

/// A fault of a search, that of a callback among them.
struct Fault(PyErr);

impl From<WriteError> for Fault {
    fn from(error: WriteError) -> Fault {
        Fault(raised(&error))
    }
}

impl From<PyErr> for Fault {
    fn from(error: PyErr) -> Fault {
        Fault(error)
    }
}

/// The step at which tiles with such errors together just meet the goal, and whether they do. `errors` gives those of all tiles at a step,
/// `samples` are parts of some.
#[pyfunction]
pub(crate) fn tile_step(
    py: Python<'_>,
    samples: Vec<Pixels<'_>>,
    options: Options,
    peak: f32,
    errors: Py<PyAny>,
) -> PyResult<(u16, bool)> {
    let color = named(&options.color)?;
    let samples: Vec<_> =
        samples.iter().map(|sample| raster_of(sample, color, &options.alpha)).collect::<PyResult<_>>()?;
    let depth = samples.first().map_or(Depth::default(), |sample| sample.info().depth);
    let seen = Seen { depth, peak, samples, ..Seen::default() };
    let params = params(&options)?;
    let all_at = |step: u16| {
        let all = Python::attach(|py| errors.call1(py, (step,))?.extract::<Vec<Errors>>(py))?;
        let all = all.into_iter().map(|(bits, texels, sum, count, worst_block_rms)| StepErrors {
            bits,
            texels,
            color: SquaredError { sum, count },
            worst_block_rms,
        });
        Ok(((), all.sum()))
    };
    let found = py.detach(|| search_tiles(&params, &seen, all_at));
    found.map(|(step, met, ())| (step, met)).map_err(|Fault(error)| error)
}

/// Of so many tiles one in how many is sampled.
#[pyfunction]
pub(crate) fn tile_stride(tiles: usize) -> usize {
    texfold::bank::sample_stride(tiles)
}

/// The columns that stand for so many columns of a tile, or the rows.
#[pyfunction]
pub(crate) fn tile_sampled(length: u32) -> Vec<u32> {
    texfold::bank::sampled(length)
}

/// The file of a tile at a step, with which its image meets the goal or not; its sums; and its errors, for [`tile_step`].
#[pyfunction]
pub(crate) fn tile_bytes<'py>(
    py: Python<'py>,
    tile: Pixels<'_>,
    options: Options,
    peak: f32,
    found: (u16, bool),
) -> PyResult<(Bound<'py, PyBytes>, TileSums, Errors)> {
    let ((set, params), (step, met)) = (source(&tile, &options, peak)?, found);
    let made = py.detach(|| {
        let (images, errors) = step_errors(&set, &params, step)?;
        let images = images.described(&set, &params, met, &Job::default())?;
        let mut sums = Sums::default();
        sums.add(&set, &images, 0);
        Ok::<_, EncodeError>((texfold::file_of(&images), sums, errors))
    });
    let (bytes, sums, errors) = made.map_err(|error| encode_error(&error))?;
    let StepErrors { bits, texels, color, worst_block_rms } = errors;
    let errors = (bits, texels, color.sum, color.count, worst_block_rms);
    Ok((PyBytes::new(py, &bytes), TileSums(sums), errors))
}
