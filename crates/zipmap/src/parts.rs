//! What a file holds: a root, patch images, and where patches lie.

use texfold_bc::{Content, ContentPlanes};
use texfold_core::image::{Alpha, PixelInfo};
use texfold_core::sample::TEXFOLD_RGBA;
use texfold_core::{DCT_LEVELS, ImageLayout, ImageSize};
use texfold_dct::DctContent;

use crate::atlas::{Packing, pack};

/// Most patches of a texture.
pub(crate) const MAX_PATCHES: usize = crate::decode::TEXFOLD_ZIPMAP_MOST as usize;
/// Most mip levels of a patch: down to where all of its texels are its border.
pub(crate) const MAX_PATCH_LEVELS: u32 = 12;

/// Texels along a side of what is transformed at a time.
pub(crate) const BLOCK_SIDE: u32 = 8;

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

/// A patch image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ImageForm {
    /// Columns and rows of its finest level.
    pub(crate) size: ImageSize,
    /// Mip levels that are stored, at least one, each half of the sides of the one before.
    pub(crate) levels: u32,
}

impl ImageForm {
    /// Texels of all levels.
    #[cfg(feature = "encode")]
    pub(crate) fn texels(&self) -> u64 {
        (0..self.levels).map(|level| self.size.at_level(level).texels()).sum()
    }
}

/// The texels of the root and of the patch images.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Payload {
    /// In planes that shaders read: the root's levels, and those of each patch image.
    Planes { root: Vec<ContentPlanes>, images: Vec<Vec<ContentPlanes>> },
    /// In blocks of variable length, which are decoded before they are drawn: the root, and where there are patch images,
    /// one image that holds all of their levels (see [`crate::atlas::pack`]): its mip levels are means of the first.
    Blocks { root: DctContent, atlas: Option<Box<DctContent>> },
}

/// What is stored of a texture.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Parts {
    /// One image, as fine as the finest patch.
    pub(crate) layout: ImageLayout,
    /// How many of its levels are finer than the root.
    pub(crate) deep: u32,
    pub(crate) payload: Payload,
    pub(crate) images: Vec<ImageForm>,
    /// In the order in which they lie over each other.
    pub(crate) patches: Vec<PatchForm>,
}

impl Parts {
    /// Columns and rows of the root.
    pub(crate) fn root_size(&self) -> ImageSize {
        self.layout.images[0].at_level(self.deep)
    }

    /// Levels of the root.
    pub(crate) fn root_levels(&self) -> u32 {
        self.layout.levels - self.deep
    }

    /// How the texels of the root and of patch images are read.
    pub(crate) fn swizzles(&self) -> [u32; 2] {
        match &self.payload {
            Payload::Planes { root, images } => {
                let images = images.first().map_or(0, |levels| levels[0].swizzle().0);
                [root[0].swizzle().0, images]
            }
            // Blocks are decoded to four channels.
            Payload::Blocks { .. } => [TEXFOLD_RGBA; 2],
        }
    }

    /// Places of the levels of patch images in their plane; `None` where they do not fit it.
    pub(crate) fn packing(&self) -> Option<Packing> {
        match &self.payload {
            Payload::Planes { .. } => pack(&self.images, 4, 1),
            Payload::Blocks { .. } => pack(&self.images, BLOCK_SIDE, self.mips()),
        }
    }

    /// Mip levels of the plane of all patch images.
    pub(crate) fn mips(&self) -> u32 {
        match &self.payload {
            Payload::Blocks { atlas: Some(atlas), .. } => atlas.layout().levels,
            _ => 1,
        }
    }
}

/// Mip levels of the plane that holds patch images in blocks: as many as these have, up to those that blocks give.
pub(crate) fn atlas_mips(images: &[ImageForm]) -> u32 {
    images.iter().map(|image| image.levels).max().unwrap_or(1).min(DCT_LEVELS)
}

/// Layout of the image that holds all levels of patch images.
pub(crate) fn atlas_layout((width, height): (u32, u32), mips: u32, root: PixelInfo) -> ImageLayout {
    ImageLayout::new(vec![ImageSize { width, height }], mips, patch_pixel(root))
}

/// Layout of a root of so many levels.
pub(crate) fn root_layout(size: ImageSize, levels: u32, pixel: PixelInfo) -> ImageLayout {
    ImageLayout::new(vec![size], levels, pixel)
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
