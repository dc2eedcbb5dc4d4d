//! Textures: what a file holds, texels, regions.

use std::collections::BTreeMap;

use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use texfold::core::image::{Depth, PixelInfo, Raster};
use texfold::core::metric;
use texfold::{AnyImage, ColorSpace, ImageAddress, Rect};

use crate::encode::Pixels;
use crate::error::{encode_error, load_error, region_error};
use crate::gpu::Blocks;
use crate::light::limits_of;

/// A texture of one image, a set, or the maps of a material, read from a `.txf` file.
#[pyclass(frozen, module = "texfold._texfold")]
pub(crate) struct Texture(AnyImage);

/// Reads a file. `max_texels` and `max_bytes` limit what it may take.
#[pyfunction]
pub(crate) fn open(
    py: Python<'_>,
    data: Vec<u8>,
    max_texels: Option<u64>,
    max_bytes: Option<u64>,
) -> PyResult<Texture> {
    let limits = limits_of(max_texels, max_bytes);
    let open = || texfold::open_with(&data, &limits).and_then(texfold::AnyTexture::into_image);
    py.detach(open).map(Texture).map_err(|error| load_error(&error))
}

impl Texture {
    fn pixel(&self, image: u32) -> PixelInfo {
        self.0.as_encoded().layout().pixel_of(image)
    }

    /// The rectangle of a level that is asked for: all of it by default.
    fn rect(&self, image: u32, level: u32, region: Option<[u32; 4]>) -> PyResult<Rect> {
        let layout = self.0.as_encoded().layout();
        let rect = match (layout.whole(image, level), region) {
            (Some(_), Some([x, y, width, height])) => Rect { image, level, x, y, width, height },
            (Some(whole), None) => whole,
            (None, _) => Rect { image, level, x: 0, y: 0, width: 0, height: 0 },
        };
        layout.check(rect).map(|()| rect).map_err(|error| region_error(&error))
    }
}

#[pymethods]
impl Texture {
    /// Name of the codec.
    #[getter]
    fn codec(&self) -> &'static str {
        self.0.codec().name
    }

    /// Height, width, channels and bits a channel of each image at level 0.
    #[getter]
    fn images(&self) -> Vec<(u32, u32, u8, u8)> {
        let layout = self.0.as_encoded().layout();
        let image = |(index, size): (u32, &texfold::core::ImageSize)| {
            let pixel = self.pixel(index);
            let bits = if pixel.depth == Depth::Eight { 8 } else { 16 };
            (size.height, size.width, pixel.channels, bits)
        };
        (0..).zip(&layout.images).map(image).collect()
    }

    /// Name and kind of each map of a material.
    #[getter]
    fn maps(&self) -> Vec<(String, &'static str)> {
        let maps = &self.0.as_encoded().layout().maps;
        maps.iter().map(|map| (map.name.clone(), map.kind.name())).collect()
    }

    /// Mip levels that are stored.
    #[getter]
    fn levels(&self) -> u32 {
        self.0.as_encoded().layout().levels
    }

    /// Loaded and all layers.
    #[getter]
    fn layers(&self) -> (u32, u32) {
        let layers = self.0.as_encoded().layers();
        (layers.loaded, layers.total)
    }

    /// Settings and verdict of the encoder.
    #[getter]
    fn notes(&self) -> (String, String) {
        let notes = self.0.as_encoded().notes();
        (notes.settings.clone(), notes.verdict.clone())
    }

    /// Bits of each part: in memory and on disk.
    fn ledger(&self, py: Python<'_>) -> BTreeMap<&'static str, (u64, u64)> {
        let footprint = py.detach(|| self.0.as_encoded().footprint());
        footprint.parts.iter().map(|part| (part.name, (part.bits_memory, part.bits_disk))).collect()
    }

    /// Bits of the compressed form in memory, and of the decoded one.
    #[getter]
    fn memory(&self) -> (u64, u64) {
        let memory = self.0.as_encoded().memory();
        (memory.compressed, memory.resident)
    }

    /// Red, green, blue and alpha of a texel, 0 to 1 as stored; the nearest inside for an address outside.
    fn texel(&self, image: u32, level: u32, x: u32, y: u32) -> [f32; 4] {
        self.0.as_encoded().texel(ImageAddress { image, level, x, y }).to_array()
    }

    /// Values of a region row by row, the channels of a texel side by side, and its rows, columns and channels.
    fn decode<'py>(
        &self,
        py: Python<'py>,
        image: u32,
        level: u32,
        region: Option<[u32; 4]>,
    ) -> PyResult<(Bound<'py, PyAny>, (u32, u32, u8))> {
        let rect = self.rect(image, level, region)?;
        let values = py.detach(|| Values::of(&self.0, rect))?;
        Ok((values.into_array(py), (rect.height, rect.width, self.pixel(image).channels)))
    }

    /// Its textures in blocks of variable length.
    fn blocks(&self, py: Python<'_>) -> Vec<Blocks> {
        py.detach(|| Blocks::of(&self.0))
    }

    /// The whole file.
    fn to_bytes(&self, py: Python<'_>) -> Py<pyo3::types::PyBytes> {
        pyo3::types::PyBytes::new(py, &py.detach(|| self.0.to_bytes())).unbind()
    }
}

/// Values of a rectangle row by row, the channels of a texel side by side.
pub(crate) enum Values {
    Eight(Vec<u8>),
    Sixteen(Vec<u16>),
}

impl Values {
    /// Those of a rectangle of a texture.
    pub(crate) fn of(texture: &AnyImage, rect: Rect) -> PyResult<Values> {
        let pixel = texture.as_encoded().layout().pixel_of(rect.image);
        let (width, height) = (rect.width as usize, rect.height as usize);
        let stride = 4 * width;
        if pixel.depth == Depth::Sixteen {
            let mut rgba = vec![0; stride * height];
            texture.decode_rgba16(rect, &mut rgba, stride).map_err(|error| region_error(&error))?;
            return Ok(Values::Sixteen(channels(rgba, pixel.channels)));
        }
        let mut rgba = vec![0; stride * height];
        texture.decode_rgba8(rect, &mut rgba, stride).map_err(|error| region_error(&error))?;
        Ok(Values::Eight(channels(rgba, pixel.channels)))
    }

    /// An array of one axis.
    pub(crate) fn into_array(self, py: Python<'_>) -> Bound<'_, PyAny> {
        match self {
            Values::Eight(values) => PyArray1::from_vec(py, values).into_any(),
            Values::Sixteen(values) => PyArray1::from_vec(py, values).into_any(),
        }
    }
}

/// The channels that an image has, of those of RGBA.
fn channels<T: Copy>(rgba: Vec<T>, channels: u8) -> Vec<T> {
    let (texels, _) = rgba.as_chunks::<4>();
    match channels {
        1 => texels.iter().map(|&[gray, ..]| gray).collect(),
        2 => texels.iter().flat_map(|&[gray, _, _, alpha]| [gray, alpha]).collect(),
        3 => texels.iter().flat_map(|&[red, green, blue, _]| [red, green, blue]).collect(),
        _ => rgba,
    }
}

/// Two images of the same shape.
fn pair(one: &Pixels<'_>, other: &Pixels<'_>) -> PyResult<(Raster, Raster)> {
    let raster = |pixels: &Pixels<'_>| {
        pixels
            .raster(ColorSpace::Srgb)
            .map_err(|error| encode_error(&texfold::core::EncodeError::from(error)))
    };
    let (one, other) = (raster(one)?, raster(other)?);
    if one.size() != other.size() {
        return Err(PyValueError::new_err("images of two sizes; give two of the same shape"));
    }
    Ok((one, other))
}

/// PSNR in dB of the colours of two images, where alpha of the first is not 0.
#[pyfunction]
pub(crate) fn psnr(py: Python<'_>, one: Pixels<'_>, other: Pixels<'_>) -> PyResult<f64> {
    let (one, other) = pair(&one, &other)?;
    Ok(py.detach(|| metric::color_error(&one, &other).psnr()))
}

/// SSIM of the colours of two images.
#[pyfunction]
pub(crate) fn ssim(py: Python<'_>, one: Pixels<'_>, other: Pixels<'_>) -> PyResult<f64> {
    let (one, other) = pair(&one, &other)?;
    Ok(py.detach(|| metric::ssim(&one, &other)))
}
