//! What is wrong with a stack of patches.

/// Why a stack of patches cannot be encoded. Patches are counted from 0.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ZipError {
    /// More patches than a tile can name.
    #[error("{patches} patches are more than {max}; leave some out")]
    TooMany {
        /// Patches found.
        patches: usize,
        /// Most that can be used.
        max: usize,
    },
    /// A patch of an image that is not there.
    #[error("patch {patch} names image {image}, which is not there; name one of the stack")]
    NoImage {
        /// Which patch.
        patch: usize,
        /// The image that it names.
        image: usize,
    },
    /// A matrix without inverse, or with numbers that are not finite.
    #[error("the matrix of patch {patch} is singular; give nine numbers that lead from root uv to patch uv")]
    Singular {
        /// Which patch.
        patch: usize,
    },
    /// A patch outside of the root.
    #[error("patch {patch} lies outside of the root; its matrix must lead some of 0 to 1 into 0 to 1")]
    Outside {
        /// Which patch.
        patch: usize,
    },
    /// Parents that lead to themselves.
    #[error("the parents of patch {patch} lead in a circle; let one of them lie on the root")]
    Cycle {
        /// Which patch.
        patch: usize,
    },
    /// A parent that is not there.
    #[error("patch {patch} has parent {parent}, which is not there; name a patch of the stack")]
    NoParent {
        /// Which patch.
        patch: usize,
        /// The parent that it names.
        parent: usize,
    },
    /// A mask of another size than its image.
    #[error(
        "the mask of patch {patch} is {}x{} and its image {}x{}; scale one to the other",
        found.0, found.1, wanted.0, wanted.1
    )]
    MaskSize {
        /// Which patch.
        patch: usize,
        /// Columns and rows of the mask.
        found: (u32, u32),
        /// Those of the image.
        wanted: (u32, u32),
    },
    /// Maps of another kind than the patches' images, and not one for each.
    #[error("there are {found} maps and masks for {patches} patches; give one of each for every patch")]
    Maps {
        /// Maps that are there, or masks where these are fewer.
        found: usize,
        /// Patches of the stack.
        patches: usize,
    },
    /// An image longer than a texture may be.
    #[error("an image is {width}x{height}, longer than 8192 texels a side; scale it down")]
    TooLarge {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Patches that do not fit one plane.
    #[error("the patches fill more than a plane of 8192x8192 texels; scale them down or leave some out")]
    Full,
}
