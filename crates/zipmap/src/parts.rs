//! What a file holds: a root, patch images, and where patches lie.

use texfold_bc::{Content, ContentPlanes};
use texfold_core::ImageLayout;
use texfold_core::image::{Alpha, PixelInfo};

/// Most patches of a texture.
pub(crate) const MAX_PATCHES: usize = crate::decode::TEXFOLD_ZIPMAP_MOST as usize;
/// Most mip levels of a patch: down to where all of its texels are its border.
pub(crate) const MAX_PATCH_LEVELS: u32 = 12;

/// Names of the parts in the footprint.
pub(crate) const ROOT_PART: &str = "root";
/// As above.
pub(crate) const PATCH_PART: &str = "patches";
/// As above.
pub(crate) const TABLE_PART: &str = "tiles";

/// One patch.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PatchForm {
    /// From the root's texture coordinates to its own, row by row.
    pub(crate) matrix: [f32; 9],
    /// Number of its patch image; several patches may have the same.
    pub(crate) content: usize,
}

/// What is stored of a texture.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Parts {
    /// One image, as fine as the finest patch.
    pub(crate) layout: ImageLayout,
    /// How many of its levels are finer than the root.
    pub(crate) deep: u32,
    /// The planes of the root's levels.
    pub(crate) root: Vec<ContentPlanes>,
    /// Patch images: the planes of each one's mip levels, at least one, each half of the sides of the one before.
    pub(crate) contents: Vec<Vec<ContentPlanes>>,
    /// In the order in which they lie over each other.
    pub(crate) patches: Vec<PatchForm>,
}

/// Pixels of patches: those of the root, with alpha.
pub(crate) fn patch_pixel(root: PixelInfo) -> PixelInfo {
    PixelInfo { channels: if root.channels < 3 { 2 } else { 4 }, alpha: Alpha::Straight, ..root }
}

/// Whether patches can be stored so: one plane, with alpha.
pub(crate) fn suits_patches(content: Content, pixel: PixelInfo) -> bool {
    let soft = matches!(content, Content::Raw | Content::Bc3 | Content::Bc5 | Content::Bc7);
    // BC3 and BC7 of gray and alpha take more bits than BC5.
    soft && content.fits(pixel) && (pixel.channels == 4 || matches!(content, Content::Raw | Content::Bc5))
}
