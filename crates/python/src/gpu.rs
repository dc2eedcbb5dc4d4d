//! Textures in blocks as a GPU decodes them.

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use texfold::Rect;
use texfold::core::DctLayout;
use texfold_shaders::{DctChannel, DctProgram, DctProgramError, DctTarget, OUTPUT_BYTES, PASS_BYTES};

use crate::error::region_error;

/// A texture in blocks of variable length.
#[pyclass(frozen, module = "texfold._texfold")]
pub(crate) struct Blocks {
    layout: DctLayout,
    place: (usize, u32, u32),
    words: Vec<u32>,
    streams: Vec<u8>,
}

/// Parameters of passes and outputs, bytes of them that are bound, bytes of scratch memory, dispatches: function, whether scratch memory is
/// cleared, bytes of parameters where bindings start, level, workgroups.
type Program<'py> = (
    Bound<'py, PyBytes>,
    Bound<'py, PyBytes>,
    (usize, usize),
    u64,
    Vec<(&'static str, bool, u32, u32, u32, [u32; 3])>,
);

impl Blocks {
    /// Those of a texture.
    pub(crate) fn of(texture: &texfold::AnyImage) -> Vec<Blocks> {
        let form = texture.as_encoded().gpu();
        let blocks = form.blocks.into_iter().map(|blocks| Blocks {
            streams: texfold_shaders::streams(&blocks),
            place: (blocks.image, blocks.level, blocks.levels),
            layout: blocks.layout,
            words: blocks.words,
        });
        blocks.collect()
    }
}

#[pymethods]
impl Blocks {
    /// Rows and columns.
    #[getter]
    fn shape(&self) -> (u32, u32) {
        (self.layout.size.height, self.layout.size.width)
    }

    /// Bits of a sample.
    #[getter]
    fn bits(&self) -> u8 {
        self.layout.depth
    }

    /// Image, first level and levels.
    #[getter]
    fn place(&self) -> (usize, u32, u32) {
        self.place
    }

    /// Words, as an array.
    #[getter]
    fn words<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, &self.words)
    }

    /// Streams.
    #[getter]
    fn streams<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.streams)
    }

    /// The WGSL of the decoder.
    #[getter]
    fn shader(&self) -> String {
        texfold_shaders::block(if self.layout.depth > 8 { DctTarget::Uint16 } else { DctTarget::Unorm8 })
    }

    /// All levels, or a level and a region of it, whose first texel goes to a place; within so many bytes of scratch memory.
    fn program<'py>(
        &self,
        py: Python<'py>,
        region: Option<(u32, [u32; 4])>,
        place: [u32; 2],
        max_scratch: u64,
    ) -> PyResult<Program<'py>> {
        let layout = &self.layout;
        let channels = DctChannel::colours(layout);
        let program = match region {
            None => DctProgram::levels(layout, channels, self.place.2, max_scratch),
            Some((level, [x, y, width, height])) => DctProgram::new(
                layout,
                Rect { image: 0, level, x, y, width, height },
                channels,
                place,
                max_scratch,
            ),
        };
        let program = program.map_err(|error: DctProgramError| region_error(&error))?;
        let dispatches = program.dispatches.iter().map(|dispatch| {
            let entry = dispatch.entry.name();
            (entry, dispatch.clears, dispatch.pass, dispatch.output, dispatch.level, dispatch.groups)
        });
        let bound = (PASS_BYTES, OUTPUT_BYTES);
        let bytes = |bytes: &[u8]| PyBytes::new(py, bytes);
        Ok((bytes(&program.passes), bytes(&program.outputs), bound, program.scratch, dispatches.collect()))
    }
}
