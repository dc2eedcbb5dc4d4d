//! Encoding: in a thread of its own, while the interpreter's thread passes on progress and looks for Ctrl-C.

use std::sync::Mutex;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use numpy::{PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use rayon::{ThreadPool, ThreadPoolBuilder};
use texfold::core::image::{Alpha, MapKind};
use texfold::core::{EncodeError, SourceError, Stage};
use texfold::{
    Access, Cancel, Choice, ColorSpace, Effort, Encode, Goal, ImageSet, Job, Limits, Metric, Raster,
};

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
        let raster = self.raster(color)?;
        // What is opaque everywhere was dropped for alpha.
        let extra = self.shape()[2].is_multiple_of(2);
        let channels = raster.info().color_channels() + u8::from(extra);
        let alpha = if extra { Alpha::Band } else { Alpha::Opaque };
        Ok(raster.with_channels(channels).tagged(color, alpha))
    }

    /// A copy: others may write to the array while it is encoded.
    pub(crate) fn raster(&self, color: ColorSpace) -> Result<Raster, SourceError> {
        let shape = self.shape();
        let side = |axis: usize| u32::try_from(shape[axis]).unwrap_or(u32::MAX);
        let (height, width) = (side(0), side(1));
        let channels = u8::try_from(shape[2]).unwrap_or(u8::MAX);
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

/// The one of `choices` that has that name.
fn named<T: Copy>(option: &str, name: &str, choices: &[(&str, T)]) -> PyResult<T> {
    let found = choices.iter().find(|(known, _)| *known == name);
    found.map(|(_, choice)| *choice).ok_or_else(|| {
        let known: Vec<&str> = choices.iter().map(|(known, _)| *known).collect();
        PyValueError::new_err(format!("{option} '{name}'; give one of {}", known.join(", ")))
    })
}

fn color_named(name: &str) -> PyResult<ColorSpace> {
    let known = [("srgb", ColorSpace::Srgb), ("linear", ColorSpace::Linear), ("normal", ColorSpace::Normal)];
    named("color", name, &known)
}

/// The images to encode: those of a set, or the maps of a material, where `names` has one for each.
fn set_of(images: &[Pixels<'_>], names: &[String], color: &str, alpha: &str) -> PyResult<ImageSet> {
    let source = |error: SourceError| encode_error(&EncodeError::from(error));
    let is_band = named("alpha", alpha, &[("straight", false), ("band", true)])?;
    let raster =
        |image: &Pixels<'_>, color| if is_band { image.with_band(color) } else { image.raster(color) };
    if names.is_empty() {
        let color = color_named(color)?;
        let rasters = images.iter().map(|image| raster(image, color)).collect::<Result<Vec<_>, _>>();
        return rasters.and_then(ImageSet::new).map_err(source);
    }
    let map = |(image, name): (&Pixels<'_>, &String)| {
        let kind = MapKind::named(name).unwrap_or(MapKind::Other);
        let color = match kind {
            MapKind::BaseColor | MapKind::Emissive => ColorSpace::Srgb,
            MapKind::Normal => ColorSpace::Normal,
            _ => ColorSpace::Linear,
        };
        Ok((kind, name.clone(), raster(image, color)?))
    };
    images
        .iter()
        .zip(names)
        .map(map)
        .collect::<Result<Vec<_>, _>>()
        .and_then(ImageSet::of_maps)
        .map_err(source)
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
    color: String,
    alpha: String,
    threads: Option<usize>,
}

impl Options {
    /// The encoder of images with these options.
    fn encoder<'s>(&self, set: &'s ImageSet) -> PyResult<Encode<'s>> {
        let Options { codec, effort, .. } = self;
        let choice = if codec == "auto" { Some(Choice::auto()) } else { Choice::named(codec) };
        let choice = choice.ok_or_else(|| {
            let known = "auto, dct, bc, vq, epitome, progressive";
            PyValueError::new_err(format!("codec '{codec}'; give one of {known}"))
        })?;
        let efforts = [("fast", Effort::Fast), ("normal", Effort::Normal), ("high", Effort::High)];
        let goal = match self.goal.as_str() {
            "psnr" => Goal::Psnr(self.value),
            "bpp" => Goal::Bpp(self.value),
            _ => Goal::Tolerance(self.value),
        };
        let encoder = Encode::new(set).goal(goal).codec(choice).mips(self.mips);
        let mut encoder = encoder.effort(named("effort", effort, &efforts)?);
        if let Some(access) = &self.access {
            let known = [("block", Access::Block), ("texel", Access::Texel)];
            encoder = encoder.access(named("access", access, &known)?);
        }
        if let Some(metric) = &self.metric {
            let known = [("psnr", Metric::Psnr), ("perceptual", Metric::Perceptual)];
            encoder = encoder.metric(named("metric", metric, &known)?);
        }
        Ok(encoder)
    }

    /// Threads of its own, where their number is given.
    fn pool(&self) -> PyResult<Option<ThreadPool>> {
        let pool = |threads| ThreadPoolBuilder::new().num_threads(threads).build();
        self.threads.map(pool).transpose().map_err(|error| PyRuntimeError::new_err(error.to_string()))
    }
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
    let (encoder, pool) = (options.encoder(&set)?, options.pool()?);
    let cancel = Cancel::default();
    let (sender, stages) = channel();
    let encoded = thread::scope(|scope| {
        let work = || {
            let mut report = move |stage| {
                // Nobody listens once the job is cancelled.
                let _ = sender.send(stage);
            };
            let mut job = Job::new(Limits::default()).with_progress(&mut report).with_cancel(&cancel);
            if let Some(pool) = &pool {
                job = job.with_pool(pool);
            }
            encoder.run_in(&mut job).map(|chosen| chosen.image.to_bytes())
        };
        let worker = scope.spawn(work);
        let interrupted = watch(py, stages, progress.as_ref()).err();
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
