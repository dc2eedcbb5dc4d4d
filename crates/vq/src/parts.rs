//! What a file holds.

use texfold_bc::ContentPlanes;
use texfold_core::ImageLayout;

use crate::classes::{Place, SizeClass};
use crate::grid::CodebookPart;

/// One codebook, and an index plane for each size of image.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Parts {
    pub(crate) layout: ImageLayout,
    pub(crate) codebook: ContentPlanes,
    pub(crate) classes: Vec<SizeClass>,
    /// For each image its class and its number in it.
    pub(crate) places: Vec<Place>,
    pub(crate) samples: Vec<CodebookPart>,
    /// Free 4x4 cells at the end of the codebook, for further images.
    pub(crate) free_cells: u32,
    /// RMS error in 8-bit units within which blocks of further images join what is there.
    pub(crate) join_rms: f32,
}
