//! Bases of images: reduced by area means, and stored in plain blocks.

use std::sync::Arc;

use texfold_bc::ContentPlanes;
use texfold_core::image::{MipFilter, Raster, mip_chain};
use texfold_core::{CancelCheck, Effort, EncodeError, ImageLayout};

use super::padded::PaddedRaster;
use crate::ResidualContent;
use crate::content::{BaseForm, BaseImage, Bases, stored_by};

/// Content of bases alone. `full` is the layout of the images with the levels that are not stored; `chains` are the
/// stored levels of each. `padded` is what surrounds the finest stored level of the only image: only then may `form` be
/// padded. Values are averaged as they are stored: what is left to the residual plane is least then. In linear light it
/// is 0.06 dB more at equal bits.
///
/// # Errors
/// [`EncodeError::Cancelled`] within 0.2 s of the caller's wish.
pub fn bases(
    full: &ImageLayout,
    form: BaseForm,
    chains: &[Vec<Raster>],
    padded: Option<&PaddedRaster>,
    effort: Effort,
    check: CancelCheck<'_>,
) -> Result<ResidualContent, EncodeError> {
    let layout = stored_by(full, &form);
    let storage = Storage { form, layout: &layout, effort, check };
    let images = match padded.filter(|_| form.padded) {
        Some(padded) => {
            let known = padded.within(form.padding() << form.reduce_log2);
            let levels = mip_chain(&known.raster, layout.levels, MipFilter::Box);
            vec![storage.image(&known, &levels)?]
        }
        None => {
            let image = |chain: &Vec<Raster>| storage.image(&PaddedRaster::alone(chain[0].clone()), chain);
            chains.iter().map(image).collect::<Result<_, _>>()?
        }
    };
    let bases = Arc::new(Bases::new(form, layout.pixel, images));
    Ok(ResidualContent::of_bases(layout, bases))
}

/// How bases are stored.
#[derive(Clone, Copy)]
struct Storage<'a> {
    form: BaseForm,
    layout: &'a ImageLayout,
    effort: Effort,
    check: CancelCheck<'a>,
}

impl Storage<'_> {
    /// The base of one image, level by level.
    fn image(&self, image: &PaddedRaster, levels: &[Raster]) -> Result<BaseImage, EncodeError> {
        let Storage { form, layout, .. } = self;
        let held = (form.levels(image.inner(), layout.levels) as usize).min(levels.len());
        let whole = image.raster.size().at_level(form.reduce_log2);
        let padding = if image.padding > 0 { form.padding() } else { 0 };
        let formats = form.content.formats(layout.pixel).0;
        let mut planes: Vec<_> = formats.into_iter().map(|format| (format, Vec::new())).collect();
        for (level, raster) in (0..).zip(&levels[..held]) {
            self.check.checkpoint()?;
            let size = whole.at_level(level);
            let texels = image.reduced(raster, size, f64::from(padding) / f64::from(1u32 << level));
            let dimensions = (size.width, size.height);
            let (pixel, effort) = (layout.pixel, self.effort);
            let coded = ContentPlanes::encode_cancellable(
                form.content,
                pixel,
                dimensions,
                &texels,
                effort,
                self.check,
            )?;
            for ((_, bytes), (_, more)) in planes.iter_mut().zip(coded.planes()) {
                bytes.extend_from_slice(more);
            }
        }
        Ok(BaseImage::new(whole, held as u32, planes))
    }
}
