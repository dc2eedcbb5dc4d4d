//! How wide neighbouring leaves are blended where a texture is drawn between texels.
//!
//! A leaf shows its outermost texels up to its border, and content at a quarter of its width has texels four times as
//! wide: there the eye sees a step. Blended in a seam about as wide as such a texel the step is gone, and the image
//! comes nearer to its source; content at full size would be blurred by the same seam. So each texture has the widest
//! one that takes nothing from its quality. *Not done*: normals, and seams of further mip levels, whose leaves are
//! narrower.

use rayon::prelude::*;
use texfold_core::image::{ColorSpace, ImageSet, Raster};
use texfold_core::{CancelCheck, EncodeError};

use glam::Vec2;

use crate::EpitomeTexture;
use crate::decode::{EpitomeView, TexfoldEpitomeParams, texfold_epitome_bilinear};

/// Half widths that are tried, in eighths of a texel.
const SEAM_WIDTHS: [u32; 7] = [5, 6, 8, 10, 12, 14, 16];
/// Texels that are compared at most, about: all but those of very large images. A quarter of an image's rows
/// misjudged it by 0.02 dB.
const COMPARED: u64 = 1 << 22;

/// The texture with the widest seam with which it is drawn, at the texels' centres, as near to `images` as without.
///
/// # Errors
/// [`EncodeError::Cancelled`] where the job was cancelled.
pub(crate) fn with_widest_seam(
    images: &ImageSet,
    made: EpitomeTexture,
    cancel: CancelCheck<'_>,
) -> Result<EpitomeTexture, EncodeError> {
    if images.info().color == ColorSpace::Normal {
        return Ok(made);
    }
    let format = made.map_format();
    let plain = error(images, &made, format.seam_width, cancel);
    let fitting = SEAM_WIDTHS.into_iter().filter(|&seam_width| seam_width <= 4 * format.cell());
    let widest = fitting.take_while(|&seam_width| error(images, &made, seam_width, cancel) <= plain).last();
    cancel.checkpoint()?;
    Ok(made.with_seam_width(widest.unwrap_or(format.seam_width)))
}

/// Squared error of some rows of all images, drawn with seams of that width.
fn error(images: &ImageSet, made: &EpitomeTexture, seam_width: u32, cancel: CancelCheck<'_>) -> f64 {
    // An odd number of rows apart, so that all places in a leaf count alike.
    let step = images.texel_count().div_ceil(COMPARED) as u32 | 1;
    let of_image = |(index, image): (u32, &Raster)| -> f64 {
        let view = made.view(index);
        let view = EpitomeView { params: TexfoldEpitomeParams { seam_width, ..view.params }, ..view };
        let (width, height) = (image.size().width, image.size().height);
        let size = Vec2::new(width as f32, height as f32);
        let rows: Vec<u32> = (0..height).step_by(step as usize).collect();
        let of_row = |&y: &u32| -> f64 {
            if cancel.is_cancelled() {
                return 0.0;
            }
            let difference = |x: u32| {
                let uv = (Vec2::new(x as f32, y as f32) + 0.5) / size;
                f64::from((texfold_epitome_bilinear(&view, uv, 0) - image.texel(x, y)).length_squared())
            };
            (0..width).map(difference).sum()
        };
        // Summed in the order of the rows, whatever the number of threads.
        rows.par_iter().map(of_row).collect::<Vec<f64>>().into_iter().sum()
    };
    (0..).zip(images.images()).map(of_image).sum()
}

impl EpitomeTexture {
    /// The same with leaves blended in seams of that half width, in eighths of a texel.
    fn with_seam_width(mut self, seam_width: u32) -> Self {
        self.parts.format.seam_width = seam_width;
        self.params.iter_mut().for_each(|params| params.seam_width = seam_width);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Epitome, EpitomeParams, EpitomeSource};
    use texfold_core::{Effort, Encoder, Goal, Job};

    fn encoded(set: &ImageSet, psnr: f64) -> EpitomeTexture {
        let params =
            EpitomeParams { goal: Goal::Psnr(psnr), effort: Effort::Fast, ..EpitomeParams::default() };
        Epitome::encode(EpitomeSource::new(set), &params, &mut Job::default()).unwrap()
    }

    /// Mean step across the borders of leaves of 8 texels, over the mean step elsewhere, four pixels a texel.
    fn trace(made: &EpitomeTexture, seam_width: u32) -> f32 {
        let view = made.view(0);
        let view = EpitomeView { params: TexfoldEpitomeParams { seam_width, ..view.params }, ..view };
        let size = Vec2::from(view.params.size.map(|side| side as f32));
        let (mut border, mut inner) = ((0.0, 0), (0.0, 0));
        for y in (2..size.y as u32).step_by(5) {
            let at = |x: u32| {
                texfold_epitome_bilinear(&view, Vec2::new(x as f32 / 4.0 + 0.125, y as f32 + 0.5) / size, 0)
            };
            for x in 1..4 * size.x as u32 {
                let sum = if x % 32 == 0 { &mut border } else { &mut inner };
                *sum = (sum.0 + (at(x) - at(x - 1)).length(), sum.1 + 1);
            }
        }
        border.0 / border.1 as f32 / (inner.0 / inner.1 as f32)
    }

    #[test]
    fn smooth_content_is_blended_wider_and_loses_its_blocks() {
        let set = ImageSet::single(texfold_testkit::image("terrain"));
        let made = encoded(&set, 28.0);
        let seam_width = made.map_format().seam_width;
        let (before, after) = (trace(&made, 4), trace(&made, seam_width));
        assert!(seam_width > 4 && after < before, "{seam_width}: {before} to {after}");
        let error = |seam_width: u32| error(&set, &made, seam_width, CancelCheck::default());
        assert!(error(seam_width) <= error(4));
    }

    #[test]
    fn content_at_full_size_is_not_blurred() {
        let set = ImageSet::single(texfold_testkit::image("noise"));
        let made = encoded(&set, 40.0);
        assert_eq!(made.map_format().seam_width, 4);
    }
}
