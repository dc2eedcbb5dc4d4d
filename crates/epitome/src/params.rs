//! Parameters and source of the epitome codec.

use texfold_bc::{Bc1Blocks, Content, Family};
use texfold_core::image::{ImageSet, Raster};
use texfold_core::{Access, Effort, Goal, Metric, ParamError, Params};

use crate::format::MAX_BLOCK;
use crate::layers::MAX_LAYERS;

/// Side of a block for tolerances where none is given (paper section 7).
const TOLERANCE_BLOCK: u32 = 12;

/// What is factored.
#[derive(Debug, Clone, Copy)]
pub struct EpitomeSource<'s> {
    /// One image or a set.
    pub images: &'s ImageSet,
    /// Where content may come from, in the first image: texels above one half. Everything else is made of it.
    pub content_from: Option<&'s Raster>,
    /// The blocks of images that are BC1 already, image by image: where content is stored as BC1 they are taken over
    /// as they are.
    pub blocks: Option<&'s [Bc1Blocks]>,
}

impl<'s> EpitomeSource<'s> {
    /// Images whose content may come from anywhere in them.
    #[must_use]
    pub fn new(images: &'s ImageSet) -> Self {
        EpitomeSource { images, content_from: None, blocks: None }
    }
}

/// The error that a goal of tolerance bounds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum ToleranceKind {
    /// The RMS error of every 4x4 block, in 8-bit units, as for all codecs.
    #[default]
    Absolute,
    /// The error of every block of the side `block` in relation to its contrast ([`crate::worst_relative_error`]; paper section 4,
    /// Eq. 1): 0.002 to 0.004 in the paper.
    Relative,
}

/// What leaves may do with content, so that a model is no more than a scene needs. Everything by default, each part
/// being used only where it lowers error at equal bits; what is left out is neither searched for nor stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transforms {
    /// Content from other places than the leaf's own. Without it only `scales` and `quadtree` count.
    pub references: bool,
    /// Positions in quarters of a texel; without them, whole texels, whose content is read unfiltered at full size.
    pub fractions: bool,
    /// Mirrored content.
    pub mirrors: bool,
    /// Rotated, sheared and stretched content.
    pub affine: bool,
    /// Content at a half and a quarter of its width or height.
    pub scales: bool,
    /// Gain and offset.
    pub gain_offsets: bool,
    /// Leaves of 32, 16 and 8 texels, chosen by quality and size goals; without it all leaves have the side `block`.
    pub quadtree: bool,
}

impl Transforms {
    /// Everything.
    pub const ALL: Transforms = Transforms {
        references: true,
        fractions: true,
        mirrors: true,
        affine: true,
        scales: true,
        gain_offsets: true,
        quadtree: true,
    };

    /// Names of the parts that are left out.
    pub(crate) fn missing(&self) -> impl Iterator<Item = &'static str> {
        [
            (self.references, "references"),
            (self.fractions, "fractions"),
            (self.mirrors, "mirrors"),
            (self.affine, "affine"),
            (self.scales, "scales"),
            (self.gain_offsets, "gains and offsets"),
            (self.quadtree, "quadtree"),
        ]
        .into_iter()
        .filter_map(|(used, name)| (!used).then_some(name))
    }
}

impl Default for Transforms {
    fn default() -> Self {
        Transforms::ALL
    }
}

/// How epitome factoring is done.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct EpitomeParams {
    /// What to reach. Quality and size goals are met by rate and distortion, tolerances by covering every block.
    pub goal: Goal,
    /// How the epitome is stored; `None` lets the goal decide, which may take two side by side.
    pub content: Option<Content>,
    /// Formats that the goal may decide among.
    pub family: Family,
    /// How texels are to be reached. By block, which is for goals of quality and size, content is stored in blocks of variable
    /// length, at a fraction of the bits; at high effort in planes where these are smaller. Planes for reading by texel where a
    /// content or a family is named, for tolerances, several layers, and blocks that are taken over.
    pub access: Access,
    /// What errors count by block and in residual planes; `None` lets goal and colours decide.
    pub metric: Option<Metric>,
    /// The error that a goal of tolerance bounds.
    pub tolerance_kind: ToleranceKind,
    /// Side of a block in texels for tolerance goals and where there is no quadtree, a multiple of 4 in 8..=64;
    /// `None` is 12 and 16.
    pub block: Option<u32>,
    /// Whether mip levels are stored.
    pub mips: bool,
    /// Layers of the file, 1 to [`MAX_LAYERS`]: a prefix of it with some of them decodes to a coarser image. More
    /// than one only for goals of quality and size.
    pub layers: u32,
    /// How long to search.
    pub effort: Effort,
    /// What leaves may do with content.
    pub transforms: Transforms,
}

impl Default for EpitomeParams {
    fn default() -> Self {
        EpitomeParams {
            goal: Goal::default(),
            content: None,
            family: Family::default(),
            access: Access::default(),
            metric: None,
            tolerance_kind: ToleranceKind::default(),
            block: None,
            mips: false,
            layers: 1,
            effort: Effort::default(),
            transforms: Transforms::ALL,
        }
    }
}

impl EpitomeParams {
    /// What is usual, for a goal.
    #[must_use]
    pub fn new(goal: Goal) -> Self {
        EpitomeParams { goal, ..EpitomeParams::default() }
    }

    /// With another goal.
    #[must_use]
    pub fn with_goal(self, goal: Goal) -> Self {
        EpitomeParams { goal, ..self }
    }

    /// With one format for all content; `None` lets the goal decide.
    #[must_use]
    pub fn with_content(self, content: impl Into<Option<Content>>) -> Self {
        EpitomeParams { content: content.into(), ..self }
    }

    /// With other formats that the goal may decide among.
    #[must_use]
    pub fn with_family(self, family: Family) -> Self {
        EpitomeParams { family, ..self }
    }

    /// With texels reached so.
    #[must_use]
    pub fn with_access(self, access: Access) -> Self {
        EpitomeParams { access, ..self }
    }

    /// Judged by that metric; `None` lets goal and colours decide.
    #[must_use]
    pub fn with_metric(self, metric: impl Into<Option<Metric>>) -> Self {
        EpitomeParams { metric: metric.into(), ..self }
    }

    /// With tolerances of that kind.
    #[must_use]
    pub fn with_tolerance_kind(self, tolerance_kind: ToleranceKind) -> Self {
        EpitomeParams { tolerance_kind, ..self }
    }

    /// With blocks of that side, where there is no quadtree; `None` is what is usual.
    #[must_use]
    pub fn with_block(self, block: impl Into<Option<u32>>) -> Self {
        EpitomeParams { block: block.into(), ..self }
    }

    /// With or without mip levels.
    #[must_use]
    pub fn with_mips(self, mips: bool) -> Self {
        EpitomeParams { mips, ..self }
    }

    /// With that many layers.
    #[must_use]
    pub fn with_layers(self, layers: u32) -> Self {
        EpitomeParams { layers, ..self }
    }

    /// With another effort.
    #[must_use]
    pub fn with_effort(self, effort: Effort) -> Self {
        EpitomeParams { effort, ..self }
    }

    /// With fewer ways to use content.
    #[must_use]
    pub fn with_transforms(self, transforms: Transforms) -> Self {
        EpitomeParams { transforms, ..self }
    }

    /// Side of a block for tolerances, in texels.
    #[must_use]
    pub fn tolerance_block(&self) -> u32 {
        self.block.unwrap_or(TOLERANCE_BLOCK)
    }

    /// Whether content is stored in blocks of variable length.
    pub(crate) fn is_by_block(&self) -> bool {
        let is_plain = self.content.is_none() && self.family == Family::Bc && self.layers == 1;
        self.access == Access::Block && is_plain && !matches!(self.goal, Goal::Tolerance(_))
    }
}

impl Params for EpitomeParams {
    fn check(&self) -> Result<(), ParamError> {
        self.goal.check()?;
        let layers = |range| Err(ParamError::new("layers", self.layers, range));
        match self.goal {
            Goal::Psnr(_) | Goal::Bpp(_) if self.tolerance_kind == ToleranceKind::Relative => {
                return Err(ParamError::new("tolerance_kind", "relative", "absolute, without a tolerance"));
            }
            _ if !(1..=MAX_LAYERS).contains(&self.layers) => return layers("1..=8"),
            Goal::Tolerance(_) if self.layers > 1 => return layers("1, for a tolerance"),
            Goal::Tolerance(value) if self.family == Family::ErrorMap && self.content.is_none() => {
                return Err(ParamError::new("tolerance", value, "none, with a residual plane"));
            }
            // Layers are told apart by cells of 4x4 texels.
            _ if self.layers > 1 && self.family == Family::ErrorMap && self.content.is_none() => {
                return layers("1, for residual planes");
            }
            _ => {}
        }
        match self.block {
            Some(block) if !(8..=MAX_BLOCK as u32).contains(&block) || block % 4 != 0 => {
                Err(ParamError::new("block", block, "multiples of 4 in 8..=64"))
            }
            _ => Ok(()),
        }
    }
}
