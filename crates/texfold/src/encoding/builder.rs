//! Encoding in a chain of settings.

use texfold_core::image::ImageSet;
use texfold_core::{Access, Effort, EncodeError, Goal, Job, Metric};

use super::{Choice, Chosen, EncodeSettings, Guidance, choose_images};
use crate::AnyImage;

/// An encode of a set of images: what is not set is as in [`EncodeSettings::default`].
///
/// ```
/// use texfold::{Encode, Goal, ImageSet, Raster, ColorSpace};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let images = ImageSet::single(Raster::from_u8(16, 16, 3, ColorSpace::Srgb, &[128; 3 * 16 * 16])?);
/// let texture = Encode::new(&images).goal(Goal::Psnr(36.0)).mips(true).run()?;
/// assert_eq!(texture.as_encoded().layout().levels, 5);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
#[must_use]
pub struct Encode<'s> {
    images: &'s ImageSet,
    guidance: Guidance<'s>,
    settings: EncodeSettings,
}

impl<'s> Encode<'s> {
    /// Of these images, with the codec that answers 34 dB best.
    pub fn new(images: &'s ImageSet) -> Self {
        Encode { images, guidance: Guidance::default(), settings: EncodeSettings::default() }
    }

    /// The goal; 34 dB by default.
    pub fn goal(mut self, goal: Goal) -> Self {
        self.settings.goal = goal;
        self
    }

    /// The codec; by default the one that answers the goal best.
    pub fn codec(mut self, codec: Choice) -> Self {
        self.settings.codec = codec;
        self
    }

    /// A full mip chain, or level 0 alone (default).
    pub fn mips(mut self, mips: bool) -> Self {
        self.settings.mips = mips;
        self
    }

    /// The search effort.
    pub fn effort(mut self, effort: Effort) -> Self {
        self.settings.effort = effort;
        self
    }

    /// Access to texels: by block (fewest bits, decoded before it is drawn) or by texel.
    pub fn access(mut self, access: Access) -> Self {
        self.settings.access = Some(access);
        self
    }

    /// The distortion measure that the encoder minimises.
    pub fn metric(mut self, metric: Metric) -> Self {
        self.settings.metric = Some(metric);
        self
    }

    /// Maps of what matters.
    pub fn guidance(mut self, guidance: Guidance<'s>) -> Self {
        self.guidance = guidance;
        self
    }

    /// Encodes on all processors.
    ///
    /// # Errors
    /// [`EncodeError`]: settings that the codec does not follow, unsuitable images, or a limit reached.
    pub fn run(&self) -> Result<AnyImage, EncodeError> {
        self.run_in(&mut Job::default()).map(|chosen| chosen.image)
    }

    /// Encodes in a job of the caller's, with progress, cancellation, threads and limits; the result tells what each codec came to.
    ///
    /// # Errors
    /// As [`Encode::run`], and [`EncodeError::Cancelled`].
    pub fn run_in(&self, job: &mut Job<'_>) -> Result<Chosen, EncodeError> {
        choose_images(self.images, self.guidance, &self.settings, job)
    }
}
