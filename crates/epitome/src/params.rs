//! Parameters and source of the epitome codec.

use texfold_bc::{Bc1Blocks, Content};
use texfold_core::image::{ImageSet, Raster};
use texfold_core::{Effort, Goal, ParamError, Params};

/// What is factored.
#[derive(Debug, Clone, Copy)]
pub struct EpitomeSource<'s> {
    /// One image or a set.
    pub images: &'s ImageSet,
    /// Where content may come from, in the first image: texels above one half. Everything else is made of it.
    pub content_from: Option<&'s Raster>,
    /// The blocks of images that are BC1 already, image by image: where content is stored as BC1 they are taken over as
    /// they are.
    pub blocks: Option<&'s [Bc1Blocks]>,
}

impl<'s> EpitomeSource<'s> {
    /// Images whose content may come from anywhere in them.
    #[must_use]
    pub fn new(images: &'s ImageSet) -> Self {
        EpitomeSource { images, content_from: None, blocks: None }
    }
}

/// How epitome factoring is done.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EpitomeParams {
    /// What to reach. Quality and size goals are met by rate and distortion, tolerances by covering every block.
    pub goal: Goal,
    /// How the epitome is stored; `None` lets the goal decide, which may take BC1 and BC7 side by side.
    pub content: Option<Content>,
    /// Side of a block in texels for tolerance goals, a multiple of 4 in 8..=32; `None` is 12.
    pub block: Option<u32>,
    /// Whether mip levels are stored.
    pub mips: bool,
    /// How long to search.
    pub effort: Effort,
}

impl Params for EpitomeParams {
    fn check(&self) -> Result<(), ParamError> {
        self.goal.check()?;
        match self.block {
            Some(block) if !(8..=32).contains(&block) || block % 4 != 0 => {
                Err(ParamError { field: "block", value: f64::from(block), range: "multiples of 4 in 8..=32" })
            }
            _ => Ok(()),
        }
    }
}
