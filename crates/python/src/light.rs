//! Light fields: photographs with cameras and a mesh in, pictures out.

use std::collections::BTreeMap;
use std::path::PathBuf;

use glam::{Mat4, Vec2, Vec3};
use numpy::{PyArray1, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use texfold::Limits;
use texfold::core::{Camera, Capture, Encoded, Encoder, Mesh, Photograph};
use texfold::lightfield::{LightParams, LightTexture, Lightfield, Renderer};

use crate::encode::{named, pool_of, run};
use crate::error::load_error;

/// Columns and rows; focal lengths and centre in pixels; the matrix from camera to world, row by row.
type Eye = ((u32, u32), [f32; 2], [f32; 2], [f32; 16]);

fn camera_of(((width, height), focal, centre, to_world): Eye) -> PyResult<Camera> {
    let to_world = Mat4::from_cols_array(&to_world).transpose();
    let camera = Camera { width, height, focal: Vec2::from(focal), centre: Vec2::from(centre), to_world };
    let fault =
        "a camera without pixels, without a focal length or with a singular matrix; calibrate it again";
    if camera.is_valid() { Ok(camera) } else { Err(PyValueError::new_err(fault)) }
}

/// Options of `texfold.encode_light`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct LightOptions {
    terms: u32,
    psnr: Option<f64>,
    access: String,
    threads: Option<usize>,
}

/// The file of a light field. Photographs have four channels, the mesh three coordinates a vertex and three vertices a triangle.
#[pyfunction]
pub(crate) fn encode_light<'py>(
    py: Python<'py>,
    views: Vec<(PyReadonlyArray3<'py, u8>, Eye)>,
    mesh: (PyReadonlyArray2<'py, f32>, PyReadonlyArray2<'py, u32>),
    options: LightOptions,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyBytes>> {
    let (positions, triangles) = mesh;
    let rows = |values: &[f32]| values.as_chunks().0.iter().map(|&place| Vec3::from(place)).collect();
    let mesh = Mesh {
        positions: rows(positions.as_slice().unwrap_or_default()),
        triangles: triangles.as_slice().unwrap_or_default().as_chunks().0.to_vec(),
    };
    let view = |(image, eye): (PyReadonlyArray3<'py, u8>, Eye)| {
        let camera = camera_of(eye)?;
        if image.shape() != [camera.height as usize, camera.width as usize, 4] {
            return Err(PyValueError::new_err("a photograph of another shape than its camera's"));
        }
        Ok(Photograph { camera, pixels: image.as_slice().unwrap_or_default().as_chunks().0.to_vec() })
    };
    let capture = Capture { mesh, views: views.into_iter().map(view).collect::<PyResult<_>>()? };
    let params = LightParams::default().with_terms(options.terms).with_psnr(options.psnr);
    let params = params.with_access(named(&options.access)?);
    let pool = pool_of(options.threads)?;
    let encode = |job: &mut texfold::Job<'_>| {
        Lightfield::encode(&capture, &params, job).map(|texture| texfold::file_of(&texture))
    };
    run(py, pool.as_ref(), progress.as_ref(), encode)
}

/// Pixels of a photograph in four channels, and its camera.
type View<'py> = (Bound<'py, PyBytes>, Eye);

/// Photographs, coordinates of vertices and vertices of triangles of a capture's folder.
#[pyfunction]
pub(crate) fn read_capture(
    py: Python<'_>,
    folder: PathBuf,
    mesh: Option<PathBuf>,
    most: Option<u32>,
) -> PyResult<(Vec<View<'_>>, Vec<f32>, Vec<u32>)> {
    let read = || texfold_capture::read(&folder, mesh.as_deref(), most, texfold_capture::read_image);
    let Capture { mesh, views } = py.detach(read).map_err(|error| load_error(&error))?;
    let view = |Photograph { camera, pixels }: Photograph| {
        let Camera { width, height, focal, centre, to_world } = camera;
        let eye = ((width, height), focal.into(), centre.into(), to_world.transpose().to_cols_array());
        (PyBytes::new(py, pixels.as_flattened()), eye)
    };
    let positions = mesh.positions.iter().flat_map(|position| position.to_array()).collect();
    Ok((views.into_iter().map(view).collect(), positions, mesh.triangles.into_flattened()))
}

/// A light field, read from a `.txf` file.
#[pyclass(frozen, module = "texfold._texfold")]
pub(crate) struct LightField(LightTexture);

/// Reads the file of a light field; limits as of `open`.
#[pyfunction]
pub(crate) fn open_light(
    py: Python<'_>,
    data: Vec<u8>,
    max_texels: Option<u64>,
    max_bytes: Option<u64>,
) -> PyResult<LightField> {
    let limits = limits_of(max_texels, max_bytes);
    let open = || texfold::open_with(&data, &limits).and_then(texfold::AnyTexture::into_light);
    py.detach(open).map(LightField).map_err(|error| load_error(&error))
}

/// The usual limits but for those that are given.
pub(crate) fn limits_of(max_texels: Option<u64>, max_bytes: Option<u64>) -> Limits {
    let usual = Limits::default();
    Limits { texels: max_texels.unwrap_or(usual.texels), bytes: max_bytes.unwrap_or(usual.bytes), ..usual }
}

#[pymethods]
impl LightField {
    /// Terms beside the mean that are loaded, and those of the whole file.
    #[getter]
    fn terms(&self) -> (u32, u32) {
        let layers = self.0.layers();
        (layers.loaded.saturating_sub(1), layers.total.saturating_sub(1))
    }

    /// Settings and verdict of the encoder.
    #[getter]
    fn notes(&self) -> (String, String) {
        let notes = self.0.notes();
        (notes.settings.clone(), notes.verdict.clone())
    }

    /// Bits of each part: in memory and on disk.
    fn ledger(&self, py: Python<'_>) -> BTreeMap<&'static str, (u64, u64)> {
        let footprint = py.detach(|| self.0.footprint());
        footprint.parts.iter().map(|part| (part.name, (part.bits_memory, part.bits_disk))).collect()
    }

    /// Bits of the compressed form in memory, and of the decoded one.
    #[getter]
    fn memory(&self) -> (u64, u64) {
        let memory = self.0.memory();
        (memory.compressed, memory.resident)
    }

    /// Coordinates of vertices and vertices of triangles, one after the other.
    fn mesh<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<u32>>) {
        let mesh = self.0.mesh();
        let places = mesh.positions.iter().flat_map(|place| place.to_array()).collect();
        let triangles = mesh.triangles.as_flattened().to_vec();
        (PyArray1::from_vec(py, places), PyArray1::from_vec(py, triangles))
    }

    /// Red, green, blue and coverage as a camera sees it, row by row, with at most so many terms.
    fn render<'py>(
        &self,
        py: Python<'py>,
        eye: Eye,
        terms: Option<u32>,
    ) -> PyResult<Bound<'py, PyArray1<u8>>> {
        let camera = camera_of(eye)?;
        let pixels = py.detach(|| match terms {
            Some(terms) => Renderer::new(&self.0.clone().first_terms(terms)).render(&camera),
            None => Renderer::new(&self.0).render(&camera),
        });
        Ok(PyArray1::from_vec(py, pixels.into_flattened()))
    }

    /// The whole file.
    fn to_bytes(&self, py: Python<'_>) -> Py<PyBytes> {
        PyBytes::new(py, &py.detach(|| texfold::file_of(&self.0))).unbind()
    }
}
