//! Which settings are compared.

use texfold::{BcParams, Content, EpitomeParams, Family, Goal, ProgressiveParams, VqParams};
use texfold_core::image::{ColorSpace, PixelInfo};
use texfold_core::{AstcBlock, Effort};

/// A goal that any setting meets: where format and size are fixed, nothing is left to search for.
const ANY_SIZE: Goal = Goal::Bpp(1e6);

/// Sizes and formats of vq codebooks.
const CODEBOOKS: [((u32, u32), Content); 4] = [
    ((128, 128), Content::Raw),
    ((256, 128), Content::Bc7),
    ((256, 256), Content::Bc1),
    ((256, 256), Content::Bc7),
];

/// Bits a texel that vq is asked for.
const BPP_GOALS: [f64; 2] = [1.5, 2.5];

/// Bits a texel that epitome is asked for.
const EPITOME_BPP_GOALS: [f64; 3] = [1.0, 1.5, 2.5];

/// Bits a texel that progressive is asked for.
const PROGRESSIVE_BPP_GOALS: [f64; 4] = [1.0, 1.5, 2.5, 4.0];

/// Halvings of width and height of plain blocks.
const HALVINGS: std::ops::RangeInclusive<u32> = 0..=2;

/// Blocks of the rival ASTC, with their bits a texel from low to high.
const ASTC_BLOCKS: [AstcBlock; 4] = [AstcBlock::B12, AstcBlock::B8, AstcBlock::B6, AstcBlock::B4];

/// One setting of one codec.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Candidate {
    /// Plain blocks, scaled down by halvings.
    Bc { content: Content, reduce_log2: u32 },
    /// Vector quantisation with a codebook of that size.
    VqCodebook { size: (u32, u32), content: Content },
    /// Vector quantisation within that many bits a texel.
    VqBpp(f64),
    /// Epitome factoring within that many bits a texel, with content of that family.
    EpitomeBpp(f64, Family),
    /// Base and error map within that many bits a texel.
    ProgressiveBpp(f64),
    /// ASTC by the external encoder.
    Astc { block: AstcBlock },
}

impl Candidate {
    /// The codec's name.
    pub(crate) fn codec(&self) -> &'static str {
        match self {
            Candidate::Bc { .. } => "bc",
            Candidate::VqCodebook { .. } | Candidate::VqBpp(_) => "vq",
            Candidate::EpitomeBpp(..) => "epitome",
            Candidate::ProgressiveBpp(_) => "progressive",
            Candidate::Astc { .. } => "astc",
        }
    }

    /// The settings in words.
    pub(crate) fn settings(&self) -> String {
        match self {
            Candidate::Bc { content, reduce_log2: 0 } => content.name().to_owned(),
            Candidate::Bc { content, reduce_log2 } => {
                format!("{} at 1/{}", content.name(), 1 << reduce_log2)
            }
            Candidate::VqCodebook { size: (width, height), content } => {
                format!("{width}x{height} {}", content.name())
            }
            Candidate::VqBpp(bpp)
            | Candidate::EpitomeBpp(bpp, Family::Bc)
            | Candidate::ProgressiveBpp(bpp) => format!("{bpp} bpp"),
            Candidate::EpitomeBpp(bpp, Family::Astc) => format!("{bpp} bpp astc"),
            Candidate::EpitomeBpp(bpp, Family::ErrorMap) => format!("{bpp} bpp error map"),
            Candidate::Astc { block } => format!("{0}x{0}", block.side()),
        }
    }

    /// Whether the report shows a picture of it.
    pub(crate) fn is_pictured(&self) -> bool {
        match self {
            Candidate::Bc { content: Content::Astc(block), .. } | Candidate::Astc { block } => {
                *block == AstcBlock::B8
            }
            Candidate::Bc { content, reduce_log2 } => *content != Content::Bc7 && *reduce_log2 < 2,
            Candidate::VqCodebook { .. } => false,
            Candidate::VqBpp(_) => true,
            Candidate::EpitomeBpp(bpp, _) | Candidate::ProgressiveBpp(bpp) => BPP_GOALS.contains(bpp),
        }
    }
}

/// Parameters of plain blocks of a fixed format and size.
pub(crate) fn bc_params(content: Content, reduce_log2: u32, effort: Effort) -> BcParams {
    BcParams {
        goal: ANY_SIZE,
        content: Some(content),
        reduce_log2: Some(reduce_log2),
        effort,
        ..BcParams::default()
    }
}

/// Parameters of vq with a fixed codebook.
pub(crate) fn codebook_params(size: (u32, u32), content: Content, effort: Effort) -> VqParams {
    VqParams { goal: ANY_SIZE, codebook: Some(size), content: Some(content), effort, ..VqParams::default() }
}

/// Parameters of vq within a number of bits.
pub(crate) fn bpp_params(bpp: f64, effort: Effort) -> VqParams {
    VqParams { goal: Goal::Bpp(bpp), effort, ..VqParams::default() }
}

/// Parameters of progressive within a number of bits.
pub(crate) fn progressive_params(bpp: f64, effort: Effort) -> ProgressiveParams {
    ProgressiveParams { goal: Goal::Bpp(bpp), effort, ..ProgressiveParams::default() }
}

/// Parameters of epitome within a number of bits.
pub(crate) fn epitome_params(bpp: f64, family: Family, effort: Effort) -> EpitomeParams {
    EpitomeParams { goal: Goal::Bpp(bpp), family, effort, ..EpitomeParams::default() }
}

/// Whether this build has ASTC itself.
pub(crate) fn has_astc() -> bool {
    Content::Astc(AstcBlock::B4).is_available()
}

/// Settings that suit such pixels; ASTC where this build has it, else the rival's where that is there.
pub(crate) fn candidates(pixel: PixelInfo, rival: bool) -> Vec<Candidate> {
    let blocks: &[Content] = match (pixel.channels, pixel.color) {
        (1, _) => &[Content::Bc4, Content::Bc7],
        (2, _) => &[Content::Bc5, Content::Bc7],
        (3, ColorSpace::Normal) => &[Content::Bc5, Content::Bc1, Content::Bc7],
        (3, _) => &[Content::Bc1, Content::Bc7],
        _ => &[Content::Bc3, Content::Bc7],
    };
    let bc = blocks
        .iter()
        .flat_map(|&content| HALVINGS.map(move |reduce_log2| Candidate::Bc { content, reduce_log2 }));
    let codebooks = CODEBOOKS.into_iter().map(|(size, content)| Candidate::VqCodebook { size, content });
    let goals = BPP_GOALS.into_iter().map(Candidate::VqBpp);
    // An error map holds one or three channels of colours.
    let has_errors = matches!(pixel.channels, 1 | 3) && pixel.color != ColorSpace::Normal;
    let families: Vec<Family> =
        [(Family::Bc, true), (Family::Astc, has_astc()), (Family::ErrorMap, has_errors)]
            .into_iter()
            .filter_map(|(family, fits)| fits.then_some(family))
            .collect();
    let epitome = |family| EPITOME_BPP_GOALS.map(move |bpp| Candidate::EpitomeBpp(bpp, family));
    let epitomes = families.iter().flat_map(|&family| epitome(family));
    let astc = ASTC_BLOCKS.into_iter().filter(|_| rival || has_astc()).map(|block| match has_astc() {
        true => Candidate::Bc { content: Content::Astc(block), reduce_log2: 0 },
        false => Candidate::Astc { block },
    });
    let progressives = PROGRESSIVE_BPP_GOALS.into_iter().map(Candidate::ProgressiveBpp);
    bc.chain(codebooks).chain(goals).chain(epitomes).chain(progressives).chain(astc).collect()
}
