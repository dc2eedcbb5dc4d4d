//! Encoding: in a thread of its own, while the interpreter's thread passes on progress and looks for Ctrl-C.

use std::str::FromStr;
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use numpy::{PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use rayon::{ThreadPool, ThreadPoolBuilder};
use texfold::core::image::MapKind;
use texfold::core::{EncodeError, NameError, SourceError, Stage};
use texfold::{Cancel, Choice, ColorSpace, Encode, EncodeSettings, Goal, ImageSet, Job, Limits, Raster};

use crate::error::encode_error;

/// Time between two looks for Ctrl-C.
const PATIENCE: Duration = Duration::from_millis(50);

/// An image of rows, columns and channels.
#[derive(FromPyObject)]
pub(crate) enum Pixels<'py> {
    Eight(PyReadonlyArray3<'py, u8>),
    Sixteen(PyReadonlyArray3<'py, u16>),
}

impl Pixels<'_> {
    /// Rows, columns and channels.
    fn shape(&self) -> &[usize] {
        match self {
            Pixels::Eight(array) => array.shape(),
            Pixels::Sixteen(array) => array.shape(),
        }
    }

    /// As [`Pixels::raster`]; a channel beside gray or RGB counts as colours do.
    fn with_band(&self, color: ColorSpace) -> Result<Raster, SourceError> {
        Ok(self.raster(color)?.with_band(self.channels()))
    }

    fn channels(&self) -> u8 {
        u8::try_from(self.shape()[2]).unwrap_or(u8::MAX)
    }

    /// A copy: others may write to the array while it is encoded.
    pub(crate) fn raster(&self, color: ColorSpace) -> Result<Raster, SourceError> {
        let shape = self.shape();
        let side = |axis: usize| u32::try_from(shape[axis]).unwrap_or(u32::MAX);
        let (height, width) = (side(0), side(1));
        let channels = self.channels();
        match self {
            Pixels::Eight(array) => {
                Raster::from_u8(width, height, channels, color, array.as_slice().unwrap_or_default())
            }
            Pixels::Sixteen(array) => {
                Raster::from_u16(width, height, channels, color, array.as_slice().unwrap_or_default())
            }
        }
    }
}

/// The value of that name.
pub(crate) fn named<T: FromStr<Err = NameError>>(name: &str) -> PyResult<T> {
    name.parse().map_err(|error: NameError| PyValueError::new_err(error.to_string()))
}

/// An image; `alpha` is `straight`, or `band` for a channel beside gray or RGB that counts as colours do.
pub(crate) fn raster_of(image: &Pixels<'_>, color: ColorSpace, alpha: &str) -> PyResult<Raster> {
    let made = if is_band(alpha)? { image.with_band(color) } else { image.raster(color) };
    made.map_err(|error| encode_error(&EncodeError::from(error)))
}

fn is_band(alpha: &str) -> PyResult<bool> {
    match alpha {
        "straight" => Ok(false),
        "band" => Ok(true),
        _ => Err(PyValueError::new_err(format!("alpha '{alpha}'; give one of straight, band"))),
    }
}

/// The images to encode: those of a set, or the maps of a material, where `names` has one for each.
fn set_of(images: &[Pixels<'_>], names: &[String], color: &str, alpha: &str) -> PyResult<ImageSet> {
    let source = |error: SourceError| encode_error(&EncodeError::from(error));
    if names.is_empty() {
        let color = named(color)?;
        let rasters =
            images.iter().map(|image| raster_of(image, color, alpha)).collect::<PyResult<Vec<_>>>()?;
        return ImageSet::new(rasters).map_err(source);
    }
    let map = |(image, name): (&Pixels<'_>, &String)| {
        let kind = MapKind::named(name).unwrap_or(MapKind::Other);
        Ok((kind, name.clone(), raster_of(image, kind.color_space(), alpha)?))
    };
    let maps = images.iter().zip(names).map(map).collect::<PyResult<Vec<_>>>()?;
    ImageSet::of_maps(maps).map_err(source)
}

/// Options of `texfold.encode`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Options {
    codec: String,
    goal: String,
    value: f64,
    effort: String,
    access: Option<String>,
    metric: Option<String>,
    mips: bool,
    pub(crate) color: String,
    pub(crate) alpha: String,
    threads: Option<usize>,
}

impl Options {
    /// Settings of an encoder of a codec that is known; it has one access.
    pub(crate) fn settings(&self) -> PyResult<EncodeSettings> {
        let goal = Goal::named(&self.goal, self.value);
        let goal = goal.map_err(|error| PyValueError::new_err(error.to_string()))?;
        let mut settings = EncodeSettings {
            goal,
            effort: named(&self.effort)?,
            mips: self.mips,
            ..EncodeSettings::default()
        };
        if let Some(metric) = &self.metric {
            settings.metric = Some(named(metric)?);
        }
        Ok(settings)
    }

    /// The encoder of images with these options.
    fn encoder<'s>(&self, set: &'s ImageSet) -> PyResult<Encode<'s>> {
        let Options { codec, effort, .. } = self;
        let choice: Choice = named(codec)?;
        let goal = Goal::named(&self.goal, self.value);
        let goal = goal.map_err(|error| PyValueError::new_err(error.to_string()))?;
        let encoder = Encode::new(set).goal(goal).codec(choice).mips(self.mips);
        let mut encoder = encoder.effort(named(effort)?);
        if let Some(access) = &self.access {
            encoder = encoder.access(named(access)?);
        }
        if let Some(metric) = &self.metric {
            encoder = encoder.metric(named(metric)?);
        }
        Ok(encoder)
    }
}

/// Threads of its own, where their number is given.
pub(crate) fn pool_of(threads: Option<usize>) -> PyResult<Option<ThreadPool>> {
    let pool = |threads| ThreadPoolBuilder::new().num_threads(threads).build();
    threads.map(pool).transpose().map_err(|error| PyRuntimeError::new_err(error.to_string()))
}

/// The file of a texture of images of three axes. `names` has the name of each map of a material, or none.
#[pyfunction]
pub(crate) fn encode<'py>(
    py: Python<'py>,
    images: Vec<Pixels<'py>>,
    names: Vec<String>,
    options: Options,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyBytes>> {
    let set = set_of(&images, &names, &options.color, &options.alpha)?;
    let (encoder, pool) = (options.encoder(&set)?, pool_of(options.threads)?);
    let encode = |job: &mut Job<'_>| encoder.run_in(job).map(|chosen| chosen.image.to_bytes());
    run(py, pool.as_ref(), progress.as_ref(), encode)
}

/// The bytes that `encode` makes in a thread of its own, while this one passes on progress and looks for Ctrl-C.
pub(crate) fn run<'py>(
    py: Python<'py>,
    pool: Option<&ThreadPool>,
    progress: Option<&Py<PyAny>>,
    encode: impl FnOnce(&mut Job<'_>) -> Result<Vec<u8>, EncodeError> + Send,
) -> PyResult<Bound<'py, PyBytes>> {
    let cancel = Cancel::default();
    let (sender, stages) = channel();
    let encoded = thread::scope(|scope| {
        let work = || {
            let mut report = move |stage| {
                // Nobody listens once the job is cancelled.
                let _ = sender.send(stage);
            };
            let mut job = Job::new(Limits::default()).with_progress(&mut report).with_cancel(&cancel);
            if let Some(pool) = pool {
                job = job.with_pool(pool);
            }
            encode(&mut job)
        };
        let worker = scope.spawn(work);
        let interrupted = watch(py, stages, progress).err();
        if interrupted.is_some() {
            cancel.cancel();
        }
        match (interrupted, py.detach(|| worker.join())) {
            (Some(error), _) => Err(error),
            (None, Ok(file)) => file.map_err(|error| encode_error(&error)),
            (None, Err(_)) => {
                Err(PyRuntimeError::new_err("a fault inside of the encoder; report the images"))
            }
        }
    });
    Ok(PyBytes::new(py, &encoded?))
}

/// Passes on the stages of a job until it ends, or until the callback raises or the interpreter is interrupted.
fn watch(py: Python<'_>, stages: Receiver<Stage>, progress: Option<&Py<PyAny>>) -> PyResult<()> {
    // The lock is for the compiler: no other thread waits for stages.
    let stages = Mutex::new(stages);
    let wait = || {
        let stages = stages.lock().map_err(|_| RecvTimeoutError::Disconnected)?;
        stages.recv_timeout(PATIENCE)
    };
    loop {
        match (py.detach(wait), progress) {
            (Ok(stage), Some(progress)) => {
                progress.call1(py, (stage.name, stage.done))?;
            }
            (Ok(_) | Err(RecvTimeoutError::Timeout), _) => {}
            (Err(RecvTimeoutError::Disconnected), _) => return Ok(()),
        }
        py.check_signals()?;
    }
}
