//! Bases, the residuals of images beside them, and the texture that both make.

use std::ops::Range;

use texfold_bc::Content;
use texfold_core::image::{PixelInfo, Raster};
use texfold_core::metric::SquaredError;
use texfold_core::sample::TEXFOLD_NORMAL;
use texfold_core::target::Measured;
use texfold_core::{
    CancelCheck, Effort, EncodeError, Encoded, Goal, ImageSize, Metric, Notes, ParamError, Rect, Texel,
};
use texfold_residual::encode::{Coder, Residuals, TOO_LARGE, bases, decode_strips};
use texfold_residual::{BaseForm, MAX_REDUCE_LOG2};

use super::details::{Candidates, LumaResidual, find};
use super::frame::Frame;
use crate::{ProgressiveParams, ProgressiveTexture, Shared};

/// How a base is stored, and how small it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Kind {
    pub(crate) content: Content,
    pub(crate) reduce_log2: u32,
    /// Binary logarithm of the side of the blocks that use a codebook; `None` where none does.
    pub(crate) side_log2: Option<u32>,
}

impl Kind {
    /// Bits a texel of the image that its base takes.
    pub(crate) fn base_bits(&self, pixel: PixelInfo) -> f64 {
        self.content.bits_per_texel(pixel) / f64::from(1u32 << (2 * self.reduce_log2))
    }

    /// Whether its base and entries of codebooks alone take as many bits a texel as what answers a goal of quality already.
    pub(crate) fn is_outdone(&self, pixel: PixelInfo, goal: Goal, known: &Measured) -> bool {
        let Some(side_log2) = self.side_log2 else { return false };
        let base = self.base_bits(pixel);
        let entries = LEAST_ENTRY_BITS / f64::from(1u32 << (2 * side_log2));
        matches!(goal, Goal::Psnr(_)) && goal.is_met(known) && known.bpp <= base + entries
    }
}

/// Bits of an entry for the smallest codebook: column, row, rotation, gain.
const LEAST_ENTRY_BITS: f64 = 20.0;

/// PSNR in dB and bits a texel above which a base of many bits is tried at normal effort; at high effort all are.
const FINE: (f64, f64) = (42.0, 3.5);
/// The same above which, at normal effort, BC7 of a quarter of the width and height is.
const MIDDLE: (f64, f64) = (33.0, 1.6);

/// PSNR in dB and bits a texel below which codebooks are tried at normal effort: above, residual planes do the same at fewer bits. At
/// high effort they are tried at any.
const COARSE: (f64, f64) = (33.0, 0.7);

/// Bits a texel that a base of an eighth with entries for blocks of 8x8 takes at least.
const SMALL_BLOCKS: f64 = 0.44;

/// Binary logarithms of the sides of blocks that are tried.
fn sides(goal: Goal) -> &'static [u32] {
    match goal {
        Goal::Bpp(bpp) if bpp < SMALL_BLOCKS => &[4],
        Goal::Bpp(_) => &[3],
        _ => &[3, 4],
    }
}

/// Whether codebooks are tried for images of any kind of pixel.
pub(crate) fn tries_codebooks(params: &ProgressiveParams) -> bool {
    match params.effort {
        Effort::Fast => false,
        Effort::Normal => below(COARSE, params.goal),
        Effort::High => !matches!(params.goal, Goal::Tolerance(_)),
    }
}

/// Whether a goal is coarser than such.
fn below((psnr, bpp): (f64, f64), goal: Goal) -> bool {
    match goal {
        Goal::Psnr(goal) => goal < psnr,
        Goal::Bpp(goal) => goal < bpp,
        Goal::Tolerance(_) => false,
    }
}

/// The bases that are tried, as the goal and the pixels need.
pub(crate) fn kinds(pixel: PixelInfo, params: &ProgressiveParams) -> Result<Vec<Kind>, ParamError> {
    let above = |(psnr, bpp): (f64, f64)| match params.goal {
        Goal::Psnr(goal) => goal >= psnr,
        Goal::Bpp(goal) => goal >= bpp,
        Goal::Tolerance(_) => true,
    };
    let usual: &[(Content, u32)] = match pixel.channels {
        1 => &[(Content::Bc4, 2), (Content::Bc4, 3), (Content::Bc4, 1)],
        // The residual plane has no alpha: the base holds it, and is as small as that allows.
        2 => &[(Content::Bc5, 1), (Content::Bc5, 2), (Content::Bc5, 3)],
        4 => &[(Content::Bc7, 1), (Content::Bc7, 2), (Content::Bc7, 3)],
        _ => &[
            (Content::Bc1, 2),
            (Content::Bc1, 3),
            (Content::Bc7, 3),
            (Content::Bc7, 2),
            (Content::Bc1, 1),
            (Content::Bc7, 1),
        ],
    };
    let tried = |&(content, reduce_log2): &(Content, u32)| match (content, reduce_log2) {
        _ if pixel.channels != 3 || params.effort == Effort::High => true,
        (Content::Bc1, 2) => true,
        (Content::Bc7, 1) => above(FINE),
        (Content::Bc7, 2) => above(MIDDLE) && (params.effort != Effort::Fast || above(FINE)),
        // On aerial photographs it is 0.4 dB below the quarter at 2.7 bits a texel, and further below at fewer.
        (Content::Bc1, 1) => false,
        _ => params.effort != Effort::Fast,
    };
    let least = 1..=MAX_REDUCE_LOG2;
    let list: Vec<(Content, u32)> = match params.content {
        Some(content) => least.map(|reduce_log2| (content, reduce_log2)).collect(),
        None if params.reduce_log2.is_some() => usual.to_vec(),
        None => usual.iter().copied().filter(tried).collect(),
    };
    let wanted = |reduce_log2: u32| params.reduce_log2.is_none_or(|wanted| wanted == reduce_log2);
    let mut list: Vec<Kind> = list
        .into_iter()
        // Normals in two channels are rebuilt behind the filter: errors in them would be of another kind.
        .filter(|&(content, _)| content.fits(pixel) && content.formats(pixel).1.0 != TEXFOLD_NORMAL)
        .filter(|&(_, reduce_log2)| wanted(reduce_log2))
        .map(|(content, reduce_log2)| Kind { content, reduce_log2, side_log2: None })
        .collect();
    let with_codebooks: Vec<Kind> = list
        .iter()
        .filter(|kind| pixel.channels != 2 && kind.reduce_log2 == MAX_REDUCE_LOG2)
        .filter(|_| tries_codebooks(params))
        .flat_map(|kind| {
            sides(params.goal).iter().map(|&side_log2| Kind { side_log2: Some(side_log2), ..*kind })
        })
        .filter(|kind| kind.content != Content::Bc7 || params.content.is_some())
        .collect();
    list.extend(with_codebooks);
    if list.is_empty() {
        let range = "what the content and the base's size can hold";
        return Err(ParamError::new("channels", pixel.channels, range));
    }
    Ok(list)
}

/// A base as a texture, and where it is to have codebooks, what they may hold: all that no goal changes.
#[derive(Debug)]
pub(crate) struct BaseTexture {
    plain: ProgressiveTexture,
    books: Option<Books>,
}

/// The residuals of a base, and content for them.
#[derive(Debug)]
struct Books {
    side_log2: u32,
    residuals: Vec<Vec<LumaResidual>>,
    candidates: Candidates,
}

impl BaseTexture {
    pub(crate) fn new(
        frame: &Frame,
        kind: Kind,
        effort: Effort,
        shared: &Shared,
        check: CancelCheck<'_>,
    ) -> Result<BaseTexture, EncodeError> {
        let padded = frame.around.as_ref().filter(|around| may_be_padded(around.inner(), kind));
        let form = BaseForm {
            shrink_log2: frame.shrink_log2,
            padded: padded.is_some(),
            ..BaseForm::new(kind.content, kind.reduce_log2)
        };
        let content = bases(&frame.full, form, &frame.chains, padded, effort, check)?;
        let plain = ProgressiveTexture::new(frame.full.clone(), content, None, Notes::default());
        let books = match kind.side_log2 {
            Some(side_log2) => Some(Books::new(&plain, &frame.chains, side_log2, shared, check)?),
            None => None,
        };
        Ok(BaseTexture { plain, books })
    }

    /// Cells of a codebook of its own that a goal for what is stored has room for.
    pub(crate) fn own_cells(&self, goal: Goal) -> usize {
        let Some(Books { side_log2, residuals, candidates }) = &self.books else { return 0 };
        let plain = &self.plain;
        let most_bits = match goal {
            Goal::Bpp(bpp) => Some(bpp * plain.stored().texels() as f64 - plain.memory().goal as f64),
            _ => None,
        };
        candidates.own_cells(residuals, 1 << side_log2, most_bits)
    }

    /// The base and its residuals, codebooks with so many cells of its own drawn; `None` where no content is worth its
    /// bits.
    pub(crate) fn base(
        &self,
        frame: &Frame,
        own_cells: usize,
        metric: Metric,
        check: CancelCheck<'_>,
    ) -> Result<Option<Base>, EncodeError> {
        let Some(Books { side_log2, residuals, candidates }) = &self.books else {
            return Base::new(&frame.chains, self.plain.clone(), metric, check).map(Some);
        };
        let Some(library) = candidates.library(1 << side_log2, own_cells, check) else { return Ok(None) };
        check.checkpoint()?;
        let Some(details) = find(residuals, *side_log2, &library, check)? else { return Ok(None) };
        let (content, notes) = (self.plain.content.clone(), Notes::default());
        let plain = ProgressiveTexture::new(frame.full.clone(), content, Some(details), notes);
        Base::new(&frame.chains, plain, metric, check).map(Some)
    }
}

impl Books {
    fn new(
        plain: &ProgressiveTexture,
        chains: &[Vec<Raster>],
        side_log2: u32,
        shared: &Shared,
        check: CancelCheck<'_>,
    ) -> Result<Books, EncodeError> {
        let mut residuals = Vec::new();
        for (image, chain) in (0..).zip(chains) {
            let mut levels = Vec::new();
            for (level, raster) in (0..).zip(chain) {
                let decode = rows_of(plain, image, level, raster.size().width);
                levels.push(LumaResidual::new(raster, &decode_strips(raster.size(), decode, check)?));
            }
            residuals.push(levels);
        }
        let candidates = Candidates::new(&residuals, 1 << side_log2, shared, check)?;
        Ok(Books { side_log2, residuals, candidates })
    }
}

/// What decodes rows of a stored level.
fn rows_of(
    texture: &ProgressiveTexture,
    image: u32,
    level: u32,
    width: u32,
) -> impl FnMut(Range<u32>, &mut [Texel]) + '_ {
    move |rows, out| {
        let height = rows.len() as u32;
        texture.decode_stored(Rect { image, level, x: 0, y: rows.start, width, height }, out);
    }
}

/// A base and its residuals.
#[derive(Debug)]
pub(crate) struct Base {
    /// The texture without a residual plane.
    plain: ProgressiveTexture,
    /// The residuals of all blocks, image by image, level by level.
    pub(crate) residuals: Residuals,
    /// Texels of the finest stored level.
    pub(crate) texels: u64,
    /// Squared error of alpha, which no residual plane lessens, in 8-bit units; 0 where there is none.
    pub(crate) alpha_error: f64,
    /// Bits of the planes and parameters of the bases and of what is drawn beside them, but those that are shared.
    bits: u64,
}

impl Base {
    /// Of a texture without a residual plane.
    fn new(
        chains: &[Vec<Raster>],
        plain: ProgressiveTexture,
        metric: Metric,
        check: CancelCheck<'_>,
    ) -> Result<Base, EncodeError> {
        let mut residuals = Residuals::default();
        let mut alpha_error = 0.0;
        for (image, chain) in (0..).zip(chains) {
            residuals.begin_image();
            for (level, raster) in (0..).zip(chain) {
                let decode = rows_of(&plain, image, level, raster.size().width);
                let texels = residuals.push_level(raster, decode, level == 0, check)?;
                if level == 0 && raster.info().has_extra() {
                    let away = |(wanted, decoded): (Texel, &Texel)| {
                        f64::from(255.0 * (wanted.w - decoded.w)).powi(2)
                    };
                    alpha_error += raster.texels().zip(&texels).map(away).sum::<f64>();
                }
            }
        }
        residuals.turn(residuals.suited_axes());
        residuals.judge_by(metric);
        let bits = plain.memory().goal - plain.shared_bits() - plain.content.plane_bits();
        let texels = plain.stored().texels();
        Ok(Base { plain, residuals, texels, alpha_error, bits })
    }

    /// Whether alpha is as good as a goal asks of colours: of goals of bits, the estimates judge.
    pub(crate) fn holds_alpha(&self, goal: Goal) -> bool {
        let error = SquaredError { sum: self.alpha_error, count: self.texels };
        match goal {
            Goal::Psnr(psnr) => error.psnr() >= psnr,
            Goal::Bpp(_) => true,
            Goal::Tolerance(_) => self.alpha_error == 0.0,
        }
    }

    /// Bits in memory of the texture with blocks of such classes.
    pub(crate) fn bits(&self, coder: &Coder<'_>, classes: &[u8]) -> u64 {
        self.bits + self.residuals.plane_bits(coder.model.class_bits, classes)
    }

    /// The texture with blocks of such classes, which are coded.
    pub(crate) fn assemble(
        &self,
        coder: &Coder<'_>,
        classes: &[u8],
    ) -> Result<ProgressiveTexture, EncodeError> {
        let Some(planes) = self.residuals.planes(coder, classes) else { return Ok(self.plain.clone()) };
        let content = self.plain.content.with_planes(self.residuals.stored_model(&coder.model), &planes);
        Ok(self.plain.with_content(content.ok_or(TOO_LARGE)?))
    }
}

/// Whether the base of a tile of that size may be padded.
fn may_be_padded(tile: ImageSize, kind: Kind) -> bool {
    tile.width.min(tile.height) >> kind.reduce_log2 > 0
}
