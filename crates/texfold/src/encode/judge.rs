//! How textures of several codecs are held against one another.

use texfold_core::image::ImageSet;
use texfold_core::metric::{SquaredError, quality_cancellable};
use texfold_core::target::Measured;
use texfold_core::{EncodeError, Encoded, Goal, Image2d, Job, Metric};
use texfold_residual::encode::counted_error_of;

use super::EncodeSettings;

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
) -> Result<Measured, EncodeError> {
    let check = job.cancel_check();
    let metric = settings.metric.unwrap_or(Metric::for_goal(settings.goal, images.info().color));
    job.install(|| {
        let quality = quality_cancellable(images, texture, check)?;
        let bpp = texture.memory().counted as f64 / images.texel_count() as f64;
        let worst_block_rms = quality.worst_block_rms;
        let Goal::Bpp(_) = settings.goal else {
            let alpha = quality.alpha.map_or(f64::INFINITY, |alpha| alpha.psnr());
            return Ok(Measured { psnr: quality.color.psnr().min(alpha), bpp, worst_block_rms });
        };
        let counted = match metric {
            Metric::Psnr => quality.color.sum,
            Metric::Perceptual => counted_error_of(images, texture, metric, check)?,
        };
        let sum = counted + quality.alpha.map_or(0.0, |alpha| alpha.sum);
        let psnr = SquaredError { sum, count: quality.color.count }.psnr();
        Ok(Measured { psnr, bpp, worst_block_rms })
    })
}
