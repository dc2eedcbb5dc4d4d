//! How textures of several codecs are held against one another.

use texfold_core::image::ImageSet;
use texfold_core::metric::{SquaredError, quality_cancellable};
use texfold_core::target::Measured;
use texfold_core::{EncodeError, Encoded, Goal, Image2d, Job, Metric};
use texfold_residual::encode::counted_error_of;

use super::EncodeSettings;

/// What a texture comes to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Judged {
    /// As it answers the goal.
    pub(super) by_goal: Measured,
    /// The same with PSNR of colours, errors counting as squares.
    pub(super) squares: Measured,
}

/// How a texture answers the goal: for goals of bits by all errors together, those of colours as the metric counts them and alpha's; for
/// a quality by the worse of colours and alpha.
///
/// # Errors
/// [`EncodeError::Cancelled`].
pub(super) fn judged(
    images: &ImageSet,
    texture: &dyn Encoded<Domain = Image2d>,
    settings: &EncodeSettings,
    job: &Job<'_>,
) -> Result<Judged, EncodeError> {
    let check = job.cancel_check();
    let metric = settings.metric.unwrap_or(Metric::for_goal(settings.goal, images.info().color));
    job.install(|| {
        let quality = quality_cancellable(images, texture, check)?;
        let bpp = texture.memory().goal as f64 / images.texel_count() as f64;
        let squares = Measured { psnr: quality.color.psnr(), bpp, worst_block_rms: quality.worst_block_rms };
        let psnr = match settings.goal {
            Goal::Bpp(_) => {
                let counted = match metric {
                    Metric::Psnr => quality.color.sum,
                    Metric::Perceptual => counted_error_of(images, texture, metric, check)?,
                };
                let sum = counted + quality.alpha.map_or(0.0, |alpha| alpha.sum);
                SquaredError { sum, count: quality.color.count }.psnr()
            }
            _ => quality.psnr(),
        };
        Ok(Judged { by_goal: Measured { psnr, ..squares }, squares })
    })
}
