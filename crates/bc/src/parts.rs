//! What a file holds.

use texfold_core::ImageLayout;

use crate::{Content, ContentPlanes};

/// Images as planes of blocks.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Parts {
    pub(crate) layout: ImageLayout,
    pub(crate) content: Content,
    /// Log2 downscale of width and height before compression.
    pub(crate) reduce_log2: u32,
    /// For each image the planes of its levels.
    pub(crate) images: Vec<Vec<ContentPlanes>>,
}
