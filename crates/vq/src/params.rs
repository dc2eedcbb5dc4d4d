//! Parameters and source of the vq codec.

use texfold_bc::Content;
use texfold_core::image::{ImageSet, Raster};
use texfold_core::mesh::UvMesh;
use texfold_core::{Effort, Goal, ParamError, Params};

use crate::grid::{MAX_CODEBOOK_SIDE, MAX_SAMPLES};

/// What is compressed, and what is known of its importance.
#[derive(Debug, Clone, Copy)]
pub struct VqSource<'s> {
    /// One image, a set, or the frames of a sequence.
    pub images: &'s ImageSet,
    /// Painted importance for the first image: bright where it matters.
    pub painted: Option<&'s Raster>,
    /// The mesh that the first image is drawn on: stretched parts matter more.
    pub mesh: Option<&'s UvMesh>,
}

impl<'s> VqSource<'s> {
    /// Images alone: importance comes from saliency.
    #[must_use]
    pub fn new(images: &'s ImageSet) -> Self {
        VqSource { images, painted: None, mesh: None }
    }
}

/// Largest weight of a guidance term.
const MAX_WEIGHT: f32 = 1000.0;

/// Weights of the guidance terms (paper section 3.4), 0 to 1000; only their ratios count. A term that is not given, such as
/// distortion without a mesh, counts as 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GuidanceWeights {
    /// How many blocks a sample could stand for.
    pub usability: f32,
    /// What the eye is drawn to.
    pub saliency: f32,
    /// Where the parameterisation stretches the texture.
    pub distortion: f32,
    /// What was painted as important.
    pub painted: f32,
}

impl Default for GuidanceWeights {
    fn default() -> Self {
        GuidanceWeights { usability: 1.0, saliency: 1.0, distortion: 1.0, painted: 2.0 }
    }
}

/// How vector quantisation is done.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct VqParams {
    /// What to reach, by the size of the codebook.
    pub goal: Goal,
    /// Width and height of the codebook in texels, multiples of 4 up to 256, instead of the goal.
    pub codebook: Option<(u32, u32)>,
    /// Number and side of the image samples; `None` tries none and a few and keeps what lowers the weighted error.
    /// Sides are multiples of 4 up to 256; samples take at most 75% of the codebook.
    pub samples: Option<(u32, u32)>,
    /// How strongly importance weighs an error: 0 counts all texels alike, 1 is the default. Frames of a sequence count
    /// alike unless something was painted or a mesh is given.
    pub importance: f32,
    /// Weights of the terms that importance is made of.
    pub weights: GuidanceWeights,
    /// How the codebook is stored: raw, BC1 or BC7; `None` lets the goal decide.
    pub content: Option<Content>,
    /// Whether every mip level has an index map of its own.
    pub mips: bool,
    /// How long to search.
    pub effort: Effort,
}

impl Default for VqParams {
    fn default() -> Self {
        VqParams {
            goal: Goal::default(),
            codebook: None,
            samples: None,
            importance: 1.0,
            weights: GuidanceWeights::default(),
            content: None,
            mips: false,
            effort: Effort::Normal,
        }
    }
}

impl VqParams {
    /// With this goal.
    #[must_use]
    pub fn with_goal(self, goal: Goal) -> Self {
        VqParams { goal, ..self }
    }

    /// With a codebook of this width and height in texels, or, for `None`, of the size that the goal needs.
    #[must_use]
    pub fn with_codebook(self, codebook: impl Into<Option<(u32, u32)>>) -> Self {
        VqParams { codebook: codebook.into(), ..self }
    }

    /// With image samples of this number and side in texels, or, for `None`, as many as lower the weighted error.
    #[must_use]
    pub fn with_samples(self, samples: impl Into<Option<(u32, u32)>>) -> Self {
        VqParams { samples: samples.into(), ..self }
    }

    /// With errors weighted so strongly by importance.
    #[must_use]
    pub fn with_importance(self, importance: f32) -> Self {
        VqParams { importance, ..self }
    }

    /// With importance made of terms with these weights.
    #[must_use]
    pub fn with_weights(self, weights: GuidanceWeights) -> Self {
        VqParams { weights, ..self }
    }

    /// With a codebook stored so, or, for `None`, as the goal decides.
    #[must_use]
    pub fn with_content(self, content: impl Into<Option<Content>>) -> Self {
        VqParams { content: content.into(), ..self }
    }

    /// With an index map for every mip level, or for the finest alone.
    #[must_use]
    pub fn with_mips(self, mips: bool) -> Self {
        VqParams { mips, ..self }
    }

    /// With a search of this length.
    #[must_use]
    pub fn with_effort(self, effort: Effort) -> Self {
        VqParams { effort, ..self }
    }
}

impl Params for VqParams {
    fn check(&self) -> Result<(), ParamError> {
        let error = |field, value, range| Err(ParamError { field, value, range });
        let fits = |side: u32| side.is_multiple_of(4) && (4..=MAX_CODEBOOK_SIDE).contains(&side);
        self.goal.check()?;
        if let Some((width, height)) = self.codebook {
            let range = "multiples of 4 in 4..=256, as the index map has one byte a coordinate";
            for side in [width, height] {
                if !fits(side) {
                    return error("codebook", side.into(), range);
                }
            }
        }
        if let Some((count, side)) = self.samples {
            if count > MAX_SAMPLES {
                return error("samples", count.into(), "0..=64 samples");
            }
            if count > 0 && !fits(side) {
                return error("samples", side.into(), "sides that are multiples of 4 in 4..=256");
            }
        }
        if !(0.0..=4.0).contains(&self.importance) {
            return error("importance", self.importance.into(), "0..=4");
        }
        let GuidanceWeights { usability, saliency, distortion, painted } = self.weights;
        for weight in [usability, saliency, distortion, painted] {
            if !(0.0..=MAX_WEIGHT).contains(&weight) {
                return error("weights", weight.into(), "0..=1000 each");
            }
        }
        match self.content {
            None | Some(Content::Raw | Content::Bc1 | Content::Bc7) => Ok(()),
            Some(content @ (Content::Bc3 | Content::Bc4 | Content::Bc5)) => {
                error("content", content.name().into(), "raw, bc1 and bc7 for a vq codebook")
            }
        }
    }
}
