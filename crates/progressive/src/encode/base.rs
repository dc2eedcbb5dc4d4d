//! Bases, what images lack in them, and the texture that both make.

use texfold_bc::{Content, ContentPlanes};
use texfold_core::image::{ImageSet, MipFilter, PixelInfo, Raster, mip_chain};
use texfold_core::metric::SquaredError;
use texfold_core::sample::TEXFOLD_NORMAL;
use texfold_core::target::Measured;
use texfold_core::{
    Effort, EncodeError, Encoded, Goal, ImageLayout, Notes, ParamError, SourceError, SurfaceSize, Texel,
};

use super::around::Surrounded;
use super::coder::Coder;
use super::details::{Lack, Stock, find};
use super::error::{Block, blocks};
use super::frame::Frame;
use crate::encoded::{ERROR_PART, ErrorMap, MARGIN, PUBLIC_PART, Parts, base_levels, map_words};
use crate::params::MAX_REDUCE_LOG2;
use crate::rates::Model;
use crate::{ProgressiveParams, ProgressiveTexture, Shared};

/// Bits of the plane that stands for an error map where there is none.
const EMPTY_MAP_BITS: u64 = 32;

/// How a base is stored, and how small it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Kind {
    pub(crate) content: Content,
    pub(crate) reduce_log2: u32,
    /// Binary logarithm of the side of the blocks that show a codebook; `None` where none does.
    pub(crate) side_log2: Option<u32>,
    /// Whether the base is blended within blocks alone.
    pub(crate) apart: bool,
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

/// Bits of an entry for the smallest codebook: column, row, turn, gain.
const LEAST_ENTRY_BITS: f64 = 20.0;

/// PSNR in dB and bits a texel above which a base of many bits is tried.
const FINE: (f64, f64) = (42.0, 3.5);
/// The same above which BC7 of a quarter of the width and height is.
const MIDDLE: (f64, f64) = (33.0, 1.6);

/// PSNR in dB and bits a texel below which codebooks are tried: above, error maps do the same at fewer bits.
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
    params.effort != Effort::Fast && below(COARSE, params.goal)
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
        // The error map has no alpha: the base shows it, and is as small as that allows.
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
        _ if pixel.channels != 3 => true,
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
        .map(|(content, reduce_log2)| Kind { content, reduce_log2, side_log2: None, apart: false })
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

/// The bases that are tried for planes of other codecs.
pub(crate) fn plane_kinds(pixel: PixelInfo) -> Vec<Kind> {
    let usual: &[(Content, u32)] = match pixel.channels {
        1 => &[(Content::Bc4, 2), (Content::Bc4, 3)],
        3 => &[(Content::Bc1, 2), (Content::Bc1, 3), (Content::Bc7, 3), (Content::Bc7, 2)],
        _ => &[],
    };
    let kind = |&(content, reduce_log2)| Kind { content, reduce_log2, side_log2: None, apart: true };
    let kinds = usual.iter().map(kind);
    kinds.filter(|kind| kind.content.formats(pixel).1.0 != TEXFOLD_NORMAL).collect()
}

/// The levels of each image that are stored.
pub(crate) fn levels(source: &ImageSet, mips: bool) -> Vec<Vec<Raster>> {
    let count = if mips { source.full_levels().min(16) } else { 1 };
    if count == 1 {
        return source.images().iter().map(|image| vec![image.clone()]).collect();
    }
    source.images().iter().map(|image| mip_chain(image, count, MipFilter::Box)).collect()
}

/// A base as a texture, and where it is to have codebooks, what they may hold: all that no goal changes.
#[derive(Debug)]
pub(crate) struct Ground {
    plain: ProgressiveTexture,
    books: Option<Books>,
}

/// What a base lacks, and content for it.
#[derive(Debug)]
struct Books {
    side_log2: u32,
    lacks: Vec<Vec<Lack>>,
    stock: Stock,
}

impl Ground {
    /// `None` where no plane can hold it.
    pub(crate) fn new(frame: &Frame, kind: Kind, (effort, shared): (Effort, &Shared)) -> Option<Ground> {
        let layout = frame.stored();
        let chains = &frame.chains;
        let around = frame.around.as_ref().filter(|around| goes_on(around.inner(), kind));
        let margin = if around.is_some() { MARGIN } else { 0 };
        let bases = match around {
            Some(around) => {
                let around = around.within(MARGIN << kind.reduce_log2);
                let levels = mip_chain(&around.raster, layout.levels, MipFilter::Box);
                vec![reduced(&around, &levels, kind, &layout, effort)]
            }
            None => {
                let planes = |chain: &Vec<Raster>| {
                    reduced(&Surrounded::alone(chain[0].clone()), chain, kind, &layout, effort)
                };
                chains.iter().map(planes).collect()
            }
        };
        let parts = Parts {
            layout: frame.full.clone(),
            shrink_log2: frame.shrink_log2,
            stored: layout,
            reduce_log2: kind.reduce_log2,
            apart: kind.apart,
            margin,
            model: Model::default(),
            bases,
            details: None,
            maps: Vec::new(),
        };
        let plain = ProgressiveTexture::new(parts, Notes::default())?;
        let books = match kind.side_log2 {
            Some(side_log2) => Some(Books::new(&plain, chains, side_log2, shared)?),
            None => None,
        };
        Some(Ground { plain, books })
    }

    /// Cells of a codebook of its own that a goal for what is stored has room for.
    pub(crate) fn own_cells(&self, goal: Goal) -> usize {
        let Some(Books { side_log2, lacks, stock }) = &self.books else { return 0 };
        let plain = &self.plain;
        let most_bits = match goal {
            Goal::Bpp(bpp) => Some(bpp * plain.stored().texels() as f64 - plain.memory().counted as f64),
            _ => None,
        };
        stock.own_cells(lacks, 1 << side_log2, most_bits)
    }

    /// The base with what it lacks, codebooks with so many cells of its own drawn; `None` where no content is worth its bits.
    pub(crate) fn base(&self, frame: &Frame, own_cells: usize) -> Option<Base> {
        let plain = match &self.books {
            Some(Books { side_log2, lacks, stock }) => {
                let shelf = stock.shelf(1 << side_log2, own_cells)?;
                self.plain.with_details(find(lacks, *side_log2, &shelf)?)?
            }
            None => self.plain.clone(),
        };
        Base::new(&frame.chains, plain)
    }
}

impl Books {
    fn new(
        plain: &ProgressiveTexture,
        chains: &[Vec<Raster>],
        side_log2: u32,
        shared: &Shared,
    ) -> Option<Books> {
        let mut lacks = Vec::new();
        for (surface, chain) in (0..).zip(chains) {
            let mut levels = Vec::new();
            for (level, raster) in (0..).zip(chain) {
                let rect = plain.stored().whole(surface, level)?;
                let mut texels = vec![Texel::ZERO; rect.width as usize * rect.height as usize];
                plain.decode_stored(rect, &mut texels);
                levels.push(Lack::new(raster, &texels));
            }
            lacks.push(levels);
        }
        let stock = Stock::new(&lacks, 1 << side_log2, shared);
        Some(Books { side_log2, lacks, stock })
    }
}

/// A base with what it lacks.
#[derive(Debug)]
pub(crate) struct Base {
    /// The texture without an error map.
    plain: ProgressiveTexture,
    /// The errors of all blocks, image by image, level by level.
    pub(crate) blocks: Vec<Block>,
    /// Whether a block is of level 0, which goals are held against.
    pub(crate) counted: Vec<bool>,
    /// Blocks of each image.
    counts: Vec<usize>,
    /// Texels of the largest level that is stored.
    pub(crate) texels: u64,
    /// Squared error of alpha, which no error map lessens, in 8-bit units; 0 where there is none.
    pub(crate) alpha_error: f64,
    /// Bits of the planes and parameters of the bases and of what is drawn beside them, but those that are shared.
    bits: u64,
}

impl Base {
    /// Of a texture without an error map.
    fn new(chains: &[Vec<Raster>], plain: ProgressiveTexture) -> Option<Base> {
        let form = plain.gpu();
        let maps: usize = form
            .planes
            .iter()
            .filter(|plane| [ERROR_PART, PUBLIC_PART].contains(&plane.part))
            .map(|plane| plane.data.len())
            .sum();
        let mut base = Base {
            bits: form.memory().counted - 8 * maps as u64,
            texels: plain.stored().texels(),
            alpha_error: 0.0,
            blocks: Vec::new(),
            counted: Vec::new(),
            counts: Vec::new(),
            plain: plain.clone(),
        };
        for (surface, chain) in chains.iter().enumerate() {
            let before = base.blocks.len();
            for (level, raster) in chain.iter().enumerate() {
                let rect = plain.stored().whole(surface as u32, level as u32)?;
                let mut texels = vec![Texel::ZERO; rect.width as usize * rect.height as usize];
                plain.decode_stored(rect, &mut texels);
                if level == 0 && raster.info().has_alpha() {
                    let away =
                        |(wanted, shown): (Texel, &Texel)| f64::from(255.0 * (wanted.w - shown.w)).powi(2);
                    base.alpha_error += raster.texels().zip(&texels).map(away).sum::<f64>();
                }
                let found = blocks(raster, &texels);
                base.counted.resize(base.counted.len() + found.len(), level == 0);
                base.blocks.extend(found);
            }
            base.counts.push(base.blocks.len() - before);
        }
        Some(base)
    }

    /// Whether alpha is as good as a goal asks of colours: of goals of bits, the estimates judge.
    pub(crate) fn shows_alpha(&self, goal: Goal) -> bool {
        let error = SquaredError { sum: self.alpha_error, count: self.texels };
        match goal {
            Goal::Psnr(psnr) => error.psnr() >= psnr,
            Goal::Bpp(_) => true,
            Goal::Tolerance(_) => self.alpha_error == 0.0,
        }
    }

    /// Bits in memory of the texture with blocks of such classes.
    pub(crate) fn bits(&self, coder: &Coder<'_>, classes: &[u8]) -> u64 {
        if classes.iter().all(|&class| class == 0) {
            return self.bits + EMPTY_MAP_BITS * self.counts.len() as u64;
        }
        let half_words = u64::from(coder.model.class_bits / 16);
        let mut first = 0;
        let mut words = 0;
        for &count in &self.counts {
            let sum: u64 = classes[first..first + count].iter().map(|&class| u64::from(class)).sum();
            words += map_words(count, sum * half_words);
            first += count;
        }
        self.bits + 32 * words
    }

    /// The texture with blocks of such classes, which are coded.
    pub(crate) fn assemble(
        &self,
        coder: &Coder<'_>,
        classes: &[u8],
    ) -> Result<ProgressiveTexture, EncodeError> {
        // A map of nothing is left out.
        if classes.iter().all(|&class| class == 0) {
            return Ok(self.plain.clone());
        }
        let mut maps = Vec::new();
        let mut index = 0;
        for &count in &self.counts {
            let mut map = ErrorMap::default();
            for (index, &class) in (index..index + count).zip(&classes[index..index + count]) {
                let found = coder.found(index, class);
                map.classes.push(class);
                map.scales.push(found.map_or(0, |found| found.scale));
                map.bits.extend(found.iter().flat_map(|found| &found.halves));
            }
            maps.push(map);
            index += count;
        }
        let texture = self.plain.with_maps(coder.model.clone(), maps);
        texture.ok_or(SourceError::Full { what: "a plane of 8192 x 8192 words" }.into())
    }
}

/// Whether the base of a tile of that size may go on beyond its borders.
fn goes_on(tile: SurfaceSize, kind: Kind) -> bool {
    !kind.apart && tile.width.min(tile.height) >> kind.reduce_log2 > 0
}

/// The planes of the base of an image, level by level; where something is known around it, it goes on beyond its borders. Values are averaged as
/// they are stored: what is left to the error map is least then. In linear light it is 0.06 dB more at equal bits.
fn reduced(
    image: &Surrounded,
    levels: &[Raster],
    kind: Kind,
    layout: &ImageLayout,
    effort: Effort,
) -> Vec<ContentPlanes> {
    let held = base_levels(image.inner(), kind.reduce_log2, layout.levels) as usize;
    let beyond = if image.margin > 0 { MARGIN } else { 0 };
    let whole = image.raster.size().at_level(kind.reduce_log2);
    let planes = |(level, raster): (u32, &Raster)| {
        let size = whole.at_level(level);
        let margin = f64::from(beyond) / f64::from(1u32 << level);
        let texels = image.reduced(raster, size, margin);
        ContentPlanes::encode(kind.content, layout.pixel, (size.width, size.height), &texels, effort)
    };
    (0..).zip(&levels[..held.min(levels.len())]).map(planes).collect()
}
