//! Bases of images: colours reduced by area means, alpha by a fit to what decoders read, both stored in plain blocks.

use std::ops::Range;
use std::sync::Arc;

use glam::{IVec2, UVec2};
use texfold_bc::ContentPlanes;
use texfold_core::image::{MipFilter, Raster, mip_chain};
use texfold_core::{CancelCheck, Effort, EncodeError, ImageLayout, ImageSize, Rect, Texel};

use super::eye::forgive_hidden;
use super::fit::Enlargement;
use super::padded::PaddedRaster;
use super::residuals::decode_strips;
use crate::ResidualContent;
use crate::content::{BaseForm, BaseImage, Bases, MAX_ALPHA_GAIN_LOG2, stored_by};
use crate::decode::texfold_residual_tap;

/// Passes of the fit of alpha for each factor of its contrast.
const PASSES: usize = 8;
/// Share of alpha's squared error that a factor must fall below for it and a further one to be tried.
const GAINED: f64 = 0.9;

/// Content of bases alone. `full` is the layout of the images with the levels that are not stored; `chains` are the
/// stored levels of each. `padded` is what surrounds the finest stored level of the only image: only then may `form` be
/// padded. Colours are averaged as they are stored: what is left to the residual plane is least then. In linear light it
/// is 0.06 dB more at equal bits. Alpha, which has no residual, is fitted to what decoders read, its contrast raised where that
/// lessens the error; in bases that are isolated or padded it is averaged, so that neighbours agree.
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
    if let Some(padded) = padded.filter(|_| form.padded) {
        let known = padded.within(form.padding() << form.reduce_log2);
        let levels = mip_chain(&known.raster, layout.levels, MipFilter::Box);
        return Ok(storage.content(vec![storage.image(&known, &levels, None)?]));
    }
    if form.isolated || !layout.pixel.has_extra() {
        let image = |chain: &Vec<Raster>| storage.image(&PaddedRaster::alone(chain[0].clone()), chain, None);
        return Ok(storage.content(chains.iter().map(image).collect::<Result<_, _>>()?));
    }
    let fits = storage.alpha_fits(chains)?;
    let mut best: Option<(f64, ResidualContent)> = None;
    // Raised contrast raises errors of blocks, too: the coded bases decide.
    for (log2, smalls) in (0..).zip(&fits).filter(|&(log2, _)| log2 == 0 || log2 + 1 == fits.len()) {
        let form = BaseForm { alpha_gain_log2: log2 as u32, ..form };
        let storage = Storage { form, ..storage };
        let image = |(chain, small): (&Vec<Raster>, &Vec<Texel>)| {
            storage.image(&PaddedRaster::alone(chain[0].clone()), chain, Some(small))
        };
        let content = storage.content(chains.iter().zip(smalls).map(image).collect::<Result<_, _>>()?);
        if fits.len() == 1 {
            return Ok(content);
        }
        let error = visible_error(&content, chains, check)?;
        if best.as_ref().is_none_or(|(least, _)| error < *least) {
            best = Some((error, content));
        }
    }
    // The first factor is tried always.
    best.map(|(_, content)| content).ok_or(super::TOO_LARGE.into())
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
    /// Content of the bases of all images.
    fn content(&self, images: Vec<BaseImage>) -> ResidualContent {
        let bases = Bases::new(self.form, self.layout.pixel, images);
        ResidualContent::of_bases(self.layout.clone(), Arc::new(bases))
    }

    /// The base of one image, level by level; `first` is its finest level where alpha is fitted.
    fn image(
        &self,
        image: &PaddedRaster,
        levels: &[Raster],
        first: Option<&Vec<Texel>>,
    ) -> Result<BaseImage, EncodeError> {
        let Storage { form, layout, check, effort } = *self;
        let held = (form.levels(image.inner(), layout.levels) as usize).min(levels.len());
        let whole = image.raster.size().at_level(form.reduce_log2);
        let padding = if image.padding > 0 { form.padding() } else { 0 };
        let formats = form.content.formats(layout.pixel).0;
        let mut planes: Vec<_> = formats.into_iter().map(|format| (format, Vec::new())).collect();
        for (level, raster) in (0..).zip(&levels[..held]) {
            check.checkpoint()?;
            let size = whole.at_level(level);
            let means = || self.means(image, raster, size, f64::from(padding) / f64::from(1u32 << level));
            let texels = match first {
                None => means(),
                Some(first) if level == 0 => first.clone(),
                Some(_) => {
                    let (mut small, wanted) = (means(), alpha_of(raster));
                    for log2 in 0..=form.alpha_gain_log2 {
                        self.fit_alpha(&mut small, size, (&wanted, raster.size()), log2)?;
                    }
                    small
                }
            };
            let coded = ContentPlanes::encode_cancellable(
                form.content,
                layout.pixel,
                (size.width, size.height),
                &texels,
                effort,
                check,
            )?;
            for ((_, bytes), (_, more)) in planes.iter_mut().zip(coded.planes()) {
                bytes.extend_from_slice(more);
            }
        }
        Ok(BaseImage::new(whole, held as u32, planes))
    }

    /// The means that a level of a base holds, as [`PaddedRaster::reduced`] gives them, with visible colours beside outlines.
    fn means(&self, image: &PaddedRaster, level: &Raster, size: ImageSize, padding: f64) -> Vec<Texel> {
        let means = image.reduced(level, size, padding);
        if !self.layout.pixel.hides_colors() {
            return means;
        }
        let (width, height) = (size.width as usize, size.height as usize);
        let around = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
        let colours = |at: usize| {
            let places =
                || around(at / width, height).flat_map(|y| around(at % width, width).map(move |x| (x, y)));
            let visible = || places().map(|(x, y)| means[y * width + x]).filter(|texel| texel.w > 0.0);
            match (means[at].w > 0.0, visible().count()) {
                (true, _) | (_, 0) => means[at],
                (false, count) => (visible().sum::<Texel>() / count as f32).with_w(0.0),
            }
        };
        (0..means.len()).map(colours).collect()
    }

    /// The finest level of each image's base, alpha fitted for each factor of its contrast, 1 first: as many as lessen the error.
    fn alpha_fits(&self, chains: &[Vec<Raster>]) -> Result<Vec<Vec<Vec<Texel>>>, EncodeError> {
        let mut smalls: Vec<Vec<Texel>> = Vec::new();
        for chain in chains {
            let size = chain[0].size().at_level(self.form.reduce_log2);
            smalls.push(self.means(&PaddedRaster::alone(chain[0].clone()), &chain[0], size, 0.0));
        }
        let (mut fits, mut least) = (Vec::new(), f64::INFINITY);
        for log2 in 0..=MAX_ALPHA_GAIN_LOG2 {
            let mut error = 0.0;
            for (chain, small) in chains.iter().zip(&mut smalls) {
                let wanted = alpha_of(&chain[0]);
                let size = chain[0].size().at_level(self.form.reduce_log2);
                error += self.fit_alpha(small, size, (&wanted, chain[0].size()), log2)?;
            }
            if error >= GAINED * least {
                break;
            }
            least = error;
            fits.push(smalls.clone());
        }
        Ok(fits)
    }

    /// Fits alpha for one factor of its contrast, from the fit for half of it; the squared error that is left.
    fn fit_alpha(
        &self,
        small: &mut [Texel],
        size: ImageSize,
        (wanted, full): (&[f32], ImageSize),
        log2: u32,
    ) -> Result<f64, EncodeError> {
        let (whole, held) = (UVec2::new(full.width, full.height), UVec2::new(size.width, size.height));
        let tap = |x: u32, y: u32| texfold_residual_tap(IVec2::new(x as i32, y as i32), whole, held, 0, 0.0);
        let enlargement = Enlargement {
            small: size,
            columns: (0..full.width).map(|x| tap(x, 0)).collect(),
            rows: (0..full.height).map(|y| tap(0, y)).collect(),
            counted: [0..full.width as usize, 0..full.height as usize],
            gain: (1u32 << log2) as f32,
        };
        let mut values: Vec<f32> = small.iter().map(|texel| texel.w).collect();
        enlargement.fit(&mut values, wanted, PASSES, self.check)?;
        small.iter_mut().zip(&values).for_each(|(texel, &value)| texel.w = value);
        Ok(enlargement.squared(&values, wanted))
    }
}

/// Alpha of all texels.
fn alpha_of(raster: &Raster) -> Vec<f32> {
    raster.texels().map(|texel| texel.w).collect()
}

/// The squared error of the finest level, colours that alpha hides left out.
fn visible_error(
    content: &ResidualContent,
    chains: &[Vec<Raster>],
    check: CancelCheck<'_>,
) -> Result<f64, EncodeError> {
    let mut sum = 0.0;
    for (image, chain) in (0..).zip(chains) {
        let size = chain[0].size();
        let decode = |rows: Range<u32>, out: &mut [Texel]| {
            let (y, height) = (rows.start, rows.len() as u32);
            content.decode_base(Rect { image, level: 0, x: 0, y, width: size.width, height }, out);
        };
        let mut decoded = decode_strips(size, decode, check)?;
        forgive_hidden(&chain[0], &mut decoded);
        let error = |(wanted, &decoded): (Texel, &Texel)| f64::from((wanted - decoded).length_squared());
        sum += chain[0].texels().zip(&decoded).map(error).sum::<f64>();
    }
    Ok(sum)
}
