//! Which settings are compared.

use texfold::{
    Choice, Content, EncodeSettings, Family, Goal,
    bc::{Bc, BcParams},
    core::TextureCodec,
    dct::Dct,
    encoding::{ENCODINGS, Encoding},
    vq::{Vq, VqParams},
};
use texfold_core::image::{ColorSpace, PixelInfo};
use texfold_core::{Effort, Metric};

use super::rival::Astcenc;
use super::storage::{self, Storage};

/// Name of the external encoder's codec.
pub(crate) const RIVAL: &str = "astc";

/// A goal that any setting meets: where format and size are fixed, nothing is left to search for.
const ANY_SIZE: Goal = Goal::Bpp(1e6);

/// Sizes and formats of vq codebooks.
const CODEBOOKS: [((u32, u32), Content); 4] = [
    ((128, 128), Content::Raw),
    ((256, 128), Content::Bc7),
    ((256, 256), Content::Bc1),
    ((256, 256), Content::Bc7),
];

/// Bits a texel whose settings are drawn, of the requested ones.
const THUMBNAIL_BPP: [f64; 2] = [1.5, 2.5];

/// Goals in bits of formats for storage whose images are drawn.
const THUMBNAIL_GOALS: [f64; 2] = [0.5, 2.0];

/// Log2 downscale of width and height of plain blocks.
const HALVINGS: std::ops::RangeInclusive<u32> = 0..=2;

/// Sides of the rival's blocks, from low to high bits a texel.
const ASTC_SIDES: [u32; 4] = [12, 8, 6, 4];
/// Side of the rival's blocks whose image is drawn.
const THUMBNAIL_SIDE: u32 = 8;

/// Which codecs and settings are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub(crate) enum Suite {
    /// Every codec that suits an input, at several settings.
    #[default]
    All,
    /// What the fewest bits buy: dct for PSNR and for the eye, ASTC, and formats for storage as with --storage, at equal bits.
    Limits,
}

/// One setting of one codec.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    /// The codec's name.
    pub(crate) codec: &'static str,
    /// The settings in words.
    pub(crate) settings: String,
    /// Whether the report has an image of it.
    pub(crate) has_thumbnail: bool,
    /// How it is made.
    pub(crate) way: Way,
}

/// How a candidate is made.
#[derive(Debug, Clone)]
pub(crate) enum Way {
    /// By a codec whose settings fix format and size.
    Fixed(&'static Encoding, Box<EncodeSettings>),
    /// By a codec within a goal; neighbours of one codec and family may share a search.
    Goal(&'static Encoding, Box<EncodeSettings>),
    /// By the external encoder of ASTC, in blocks of that side.
    Rival(Astcenc, u32),
    /// By a format for storage, within a number of bits a texel.
    Storage(Storage, f64),
}

/// Settings of a suite that suit such pixels, the rival's where it is installed, and those of formats for storage.
pub(crate) fn candidates(
    suite: Suite,
    pixel: PixelInfo,
    effort: Effort,
    astcenc: Option<&Astcenc>,
    storage: &[Storage],
) -> Vec<Candidate> {
    let mut found = match suite {
        Suite::All => at_all_settings(pixel, effort),
        Suite::Limits => [Metric::Psnr, Metric::Perceptual]
            .into_iter()
            .flat_map(|metric| for_metric(metric, effort))
            .collect(),
    };
    found.extend(astcenc.into_iter().flat_map(|astcenc| ASTC_SIDES.map(|side| rival(astcenc, side))));
    found.extend(storage.iter().flat_map(|format| storage::GOALS.map(|goal| stored(format, goal))));
    found
}

/// Superblocks at the bits of formats for storage, their errors counted by that metric.
fn for_metric(metric: Metric, effort: Effort) -> Vec<Candidate> {
    let of = |encoding: &'static Encoding, bpp: f64| {
        let goal = Goal::Bpp(bpp);
        let settings = EncodeSettings { goal, metric: Some(metric), effort, ..EncodeSettings::default() };
        Candidate {
            codec: encoding.id.name,
            settings: format!("{bpp} bpp {}", metric.name()),
            has_thumbnail: THUMBNAIL_GOALS.contains(&bpp),
            way: Way::Goal(encoding, Box::new(settings)),
        }
    };
    let encoding = ENCODINGS.iter().find(|encoding| encoding.id == Dct::ID);
    encoding.into_iter().flat_map(|encoding| storage::GOALS.map(|bpp| of(encoding, bpp))).collect()
}

/// Every codec that suits such pixels.
fn at_all_settings(pixel: PixelInfo, effort: Effort) -> Vec<Candidate> {
    let blocks: &[Content] = match (pixel.channels, pixel.color) {
        (1, _) => &[Content::Bc4, Content::Bc7],
        (2, _) => &[Content::Bc5, Content::Bc7],
        (3, ColorSpace::Normal) => &[Content::Bc5, Content::Bc1, Content::Bc7],
        (3, _) => &[Content::Bc1, Content::Bc7],
        _ => &[Content::Bc3, Content::Bc7],
    };
    let plain = |content| HALVINGS.map(move |reduce_log2| plain(content, reduce_log2, effort));
    let mut found: Vec<Candidate> = blocks.iter().flat_map(|&content| plain(content)).flatten().collect();
    found.extend(CODEBOOKS.into_iter().filter_map(|(size, content)| codebook(size, content, effort)));
    found.extend(ENCODINGS.iter().flat_map(|encoding| within_goals(encoding, pixel, effort)));
    found
}

/// A format for storage.
fn stored(format: &Storage, goal: f64) -> Candidate {
    Candidate {
        codec: format.name(),
        settings: format!("{goal} bpp"),
        has_thumbnail: THUMBNAIL_GOALS.contains(&goal),
        way: Way::Storage(format.clone(), goal),
    }
}

/// Plain blocks of a fixed format, scaled down.
fn plain(content: Content, reduce_log2: u32, effort: Effort) -> Option<Candidate> {
    let name = content.name();
    let settings =
        if reduce_log2 == 0 { name.to_owned() } else { format!("{name} at 1/{}", 1 << reduce_log2) };
    let has_thumbnail = content != Content::Bc7 && reduce_log2 < 2;
    let mut own = BcParams::default();
    (own.reduce_log2,) = (Some(reduce_log2),);
    let way = fixed(Choice::of::<Bc>().with::<Bc>(own), content, effort)?;
    Some(Candidate { codec: Bc::ID.name, settings, has_thumbnail, way })
}

/// Vector quantisation with a codebook of a fixed size.
fn codebook((width, height): (u32, u32), content: Content, effort: Effort) -> Option<Candidate> {
    let settings = format!("{width}x{height} {}", content.name());
    let mut own = VqParams::default();
    (own.codebook,) = (Some((width, height)),);
    let way = fixed(Choice::of::<Vq>().with::<Vq>(own), content, effort)?;
    Some(Candidate { codec: Vq::ID.name, settings, has_thumbnail: false, way })
}

fn fixed(codec: Choice, content: Content, effort: Effort) -> Option<Way> {
    let encoding = codec.encoding()?;
    let content = Some(content);
    let settings = EncodeSettings { codec, goal: ANY_SIZE, content, effort, ..EncodeSettings::default() };
    Some(Way::Fixed(encoding, Box::new(settings)))
}

/// A codec within numbers of bits, with each family of formats that suits.
fn within_goals(encoding: &'static Encoding, pixel: PixelInfo, effort: Effort) -> Vec<Candidate> {
    let candidate = |family: Family, bpp: f64| {
        let settings = EncodeSettings { goal: Goal::Bpp(bpp), family, effort, ..EncodeSettings::default() };
        let word = match family {
            Family::Bc => "",
            Family::ErrorMap => " residual plane",
        };
        Candidate {
            codec: encoding.id.name,
            settings: format!("{bpp} bpp{word}"),
            has_thumbnail: THUMBNAIL_BPP.contains(&bpp),
            way: Way::Goal(encoding, Box::new(settings)),
        }
    };
    let of_family = |family| encoding.compared_bpp.iter().map(move |&bpp| candidate(family, bpp));
    encoding.families(pixel).into_iter().flat_map(of_family).collect()
}

/// ASTC by the external encoder.
fn rival(astcenc: &Astcenc, side: u32) -> Candidate {
    Candidate {
        codec: RIVAL,
        settings: format!("{side}x{side}"),
        has_thumbnail: side == THUMBNAIL_SIDE,
        way: Way::Rival(astcenc.clone(), side),
    }
}
