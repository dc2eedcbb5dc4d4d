//! Single images as content of other codecs: coded at a lambda, each block with a weight, block-isolated, as the blocks
//! beside one are not those that it has in an image.

use std::ops::Range;

use texfold_bc::Content;
use texfold_core::image::{PixelInfo, Raster};
use texfold_core::sample::TEXFOLD_NORMAL;
use texfold_core::{CancelCheck, Effort, EncodeError, ImageLayout, Metric, Rect, SourceError, Texel};

use super::base::bases;
use super::model::{Reach, train};
use super::residuals::{CLASS_BITS, CROWDED, Residuals, share_of_largest};
use crate::plane::GROUP_BLOCKS;
use crate::rates::RateModel;
use crate::{BLOCK_SIDE, BaseForm, ResidualContent};

/// A base and a rate model that suit an image at some lambda.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneForm {
    base: BaseForm,
    model: RateModel,
    metric: Metric,
}

impl PlaneForm {
    /// What stores `image` with the least error + `lambda` x bits, where errors are squared ones in 8-bit units over all
    /// channels, as `metric` counts them; `None` where its pixels have alpha or are normals.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`].
    pub fn suited(
        image: &Raster,
        lambda: f32,
        metric: Metric,
        effort: Effort,
        check: CancelCheck<'_>,
    ) -> Result<Option<PlaneForm>, EncodeError> {
        let mut best: Option<(f64, PlaneForm)> = None;
        for base in base_forms(image.info()) {
            let (content, mut residuals) = against(std::slice::from_ref(image), base, effort, check)?;
            residuals.turn(residuals.suited_axes());
            let lambda = lambda * residuals.judge_by(metric);
            for class_bits in CLASS_BITS {
                check.checkpoint()?;
                let model =
                    train(&residuals.blocks, class_bits, lambda, Reach::Far).with_axes(residuals.axes);
                let coder = residuals.coder(model, Effort::Fast);
                let classes = coder.choose(lambda);
                let bits = content.base_bits() + residuals.plane_bits(class_bits, &classes);
                let cost = coder.error_of(&classes, &residuals.counted) + f64::from(lambda) * bits as f64;
                if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                    best = Some((cost, PlaneForm { base, model: coder.model, metric }));
                }
                if share_of_largest(&classes) <= CROWDED {
                    break;
                }
            }
        }
        Ok(best.map(|(_, form)| form))
    }

    /// How the base is stored.
    #[must_use]
    pub fn content(&self) -> Content {
        self.base.content
    }

    /// What errors count.
    #[must_use]
    pub fn metric(&self) -> Metric {
        self.metric
    }

    /// Bits in memory that a block of 8x8 texels of that class takes, with its share of the base.
    #[must_use]
    pub fn block_bits(&self, image: &Raster, class: u8) -> f32 {
        let texels = (BLOCK_SIDE * BLOCK_SIDE) as f32;
        let base = self.base.content.bits_per_texel(image.info()) as f32 * texels;
        let header = 32.0 * crate::decode::TEXFOLD_RESIDUAL_GROUP_WORDS as f32 / GROUP_BLOCKS as f32;
        base / (1u32 << (2 * self.base.reduce_log2)) as f32
            + header
            + (self.model.class_bits * u32::from(class)) as f32
    }

    /// `levels`, an image and its mip levels, at least one, stored where a bit is worth `lambda`; the errors of the
    /// blocks of level 0, row by row, count by `weights`, all by 1 where there are none.
    ///
    /// # Errors
    /// [`EncodeError::Cancelled`], and [`SourceError`] where there is no level or no plane can hold it.
    pub fn encode(
        &self,
        levels: &[Raster],
        lambda: f32,
        weights: &[f32],
        effort: Effort,
        check: CancelCheck<'_>,
    ) -> Result<ResidualContent, EncodeError> {
        let (content, mut residuals) = against(levels, self.base, effort, check)?;
        residuals.turn(self.model.axes);
        let lambda = lambda * residuals.judge_by(self.metric);
        let mut coder = residuals.coder(self.model.clone(), effort);
        let mut all = weights.to_vec();
        all.resize(residuals.blocks.len(), 1.0);
        let classes = coder.choose_weighted(lambda, &all);
        coder.code(&classes, check)?;
        // What coding has shown moves bits among the blocks.
        let classes = coder.choose_weighted(lambda, &all);
        coder.code(&classes, check)?;
        let Some(planes) = residuals.planes(&coder, &classes) else { return Ok(content) };
        Ok(content.with_planes(residuals.stored_model(&coder.model), &planes).ok_or(TOO_LARGE)?)
    }
}

/// Why a residual plane cannot be laid out.
pub const TOO_LARGE: SourceError = SourceError::Full {
    what: "a plane of 8192 x 8192 words is full; ask for fewer bits, or split the images",
};

/// The base of an image and its mip levels, and their residuals.
fn against(
    levels: &[Raster],
    form: BaseForm,
    effort: Effort,
    check: CancelCheck<'_>,
) -> Result<(ResidualContent, Residuals), EncodeError> {
    let first = levels.first().ok_or(SourceError::Empty)?;
    let layout = ImageLayout::new(vec![first.size()], levels.len() as u32, first.info());
    let content = bases(&layout, form, &[levels.to_vec()], None, effort, check)?;
    let mut residuals = Residuals::default();
    residuals.begin_image();
    for (level, raster) in (0..).zip(levels) {
        let width = raster.size().width;
        let decode = |rows: Range<u32>, out: &mut [Texel]| {
            content
                .decode(Rect { image: 0, level, x: 0, y: rows.start, width, height: rows.len() as u32 }, out);
        };
        residuals.push_level(raster, decode, level == 0, check)?;
    }
    Ok((content, residuals))
}

/// The bases that are tried for such pixels.
fn base_forms(pixel: PixelInfo) -> Vec<BaseForm> {
    let usual: &[(Content, u32)] = match pixel.channels {
        1 => &[(Content::Bc4, 2), (Content::Bc4, 3)],
        3 => &[(Content::Bc1, 2), (Content::Bc1, 3), (Content::Bc7, 3), (Content::Bc7, 2)],
        _ => &[],
    };
    let form = |&(content, reduce_log2)| BaseForm { isolated: true, ..BaseForm::new(content, reduce_log2) };
    let forms = usual.iter().map(form);
    forms.filter(|form| form.content.formats(pixel).1.0 != TEXFOLD_NORMAL).collect()
}
