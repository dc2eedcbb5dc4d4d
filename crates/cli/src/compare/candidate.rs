//! Which settings are compared.

use texfold::{
    Choice, Content, EncodeSettings, Family, Goal,
    bc::{Bc, BcParams},
    core::TextureCodec,
    encoding::{ENCODINGS, Encoding},
    vq::{Vq, VqParams},
};
use texfold_core::image::{ColorSpace, PixelInfo};
use texfold_core::{Effort, Metric};

use super::rival::Astcenc;
use super::storage::Storage;
use super::suite::Suite;

/// Name of the external encoder's codec.
pub(crate) const RIVAL: &str = "astc";
/// Name of the codec of JPEG textures.
const JPEG: &str = "jpeg";

/// A goal that any setting meets: where format and size are fixed, nothing is left to search for.
const ANY_SIZE: Goal = Goal::Bpp(1e6);

/// Sizes and formats of vq codebooks.
const CODEBOOKS: [((u32, u32), Content); 4] = [
    ((128, 128), Content::Raw),
    ((256, 128), Content::Bc7),
    ((256, 256), Content::Bc1),
    ((256, 256), Content::Bc7),
];

/// Bits a texel near which images are drawn, of each series.
const DRAWN_BPP: [f64; 2] = [0.5, 2.0];

/// Log2 downscale of width and height of plain blocks.
const HALVINGS: std::ops::RangeInclusive<u32> = 0..=2;

/// Side of the rival's blocks whose image is drawn.
const DRAWN_SIDE: u32 = 8;

/// One setting of one codec.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    /// The codec's name.
    pub(crate) codec: &'static str,
    /// The curve that it is a point of.
    pub(crate) series: String,
    /// The settings in words.
    pub(crate) settings: String,
    /// Whether the report has an image of it.
    pub(crate) has_thumbnail: bool,
    /// How it is made.
    pub(crate) way: Way,
}

impl Candidate {
    /// Codec, series and settings.
    pub(super) fn words(&self) -> (&str, &str, &str) {
        (self.codec, &self.series, &self.settings)
    }
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
    /// As a JPEG that is decoded by block.
    Jpeg(u8),
    /// By a format for storage, within a number of bits a texel.
    Storage(Storage, f64),
}

/// Settings of a suite that suit such pixels, the rival's where it is installed, and those of formats for storage.
pub(crate) fn candidates(
    suite: &Suite,
    pixel: PixelInfo,
    effort: Effort,
    astcenc: Option<&Astcenc>,
    storage: &[Storage],
) -> Vec<Candidate> {
    let mut found = Vec::new();
    if suite.plain {
        let plain = |content| HALVINGS.map(move |reduce_log2| plain(content, reduce_log2, effort));
        found.extend(plain_formats(pixel).iter().flat_map(|&content| plain(content)).flatten());
    }
    if suite.codebooks {
        found.extend(CODEBOOKS.into_iter().filter_map(|(size, content)| codebook(size, content, effort)));
    }
    let wanted = ENCODINGS.iter().filter(|encoding| suite.has(encoding.id.name));
    found.extend(wanted.flat_map(|encoding| within_goals(encoding, suite, pixel, effort)));
    found.extend(astcenc.into_iter().flat_map(|astcenc| suite.astc.iter().map(|&side| rival(astcenc, side))));
    if matches!(pixel.color_channels(), 1 | 3) && !pixel.has_extra() {
        found.extend(suite.jpeg.iter().map(|&quality| jpeg(quality)));
    }
    found.extend(storage.iter().flat_map(|format| stored(format, suite.storage())));
    found
}

/// Formats of plain blocks for such pixels.
fn plain_formats(pixel: PixelInfo) -> &'static [Content] {
    match (pixel.channels, pixel.color) {
        (1, _) => &[Content::Bc4, Content::Bc7],
        (2, _) => &[Content::Bc5, Content::Bc7],
        (3, ColorSpace::Normal) => &[Content::Bc5, Content::Bc1, Content::Bc7],
        (3, _) => &[Content::Bc1, Content::Bc7],
        _ => &[Content::Bc3, Content::Bc7],
    }
}

/// Whether an image is drawn at these bits, of all that a series has.
fn is_drawn(bpp: f64, all: &[f64]) -> bool {
    let distance =
        |near: f64| move |a: &&f64, b: &&f64| (*a / near).ln().abs().total_cmp(&(*b / near).ln().abs());
    DRAWN_BPP.iter().any(|&near| all.iter().min_by(distance(near)) == Some(&bpp))
}

/// A format for storage.
fn stored<'f>(format: &'f Storage, goals: &'f [f64]) -> impl Iterator<Item = Candidate> + 'f {
    goals.iter().map(move |&goal| Candidate {
        codec: format.name(),
        series: format.name().to_owned(),
        settings: format!("{goal} bpp"),
        has_thumbnail: is_drawn(goal, goals),
        way: Way::Storage(format.clone(), goal),
    })
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
    Some(Candidate { codec: Bc::ID.name, series: name.to_uppercase(), settings, has_thumbnail, way })
}

/// Vector quantisation with a codebook of a fixed size.
fn codebook((width, height): (u32, u32), content: Content, effort: Effort) -> Option<Candidate> {
    let settings = format!("{width}x{height} {}", content.name());
    let mut own = VqParams::default();
    (own.codebook,) = (Some((width, height)),);
    let way = fixed(Choice::of::<Vq>().with::<Vq>(own), content, effort)?;
    let series = "vq, codebooks of fixed sizes".to_owned();
    Some(Candidate { codec: Vq::ID.name, series, settings, has_thumbnail: false, way })
}

fn fixed(codec: Choice, content: Content, effort: Effort) -> Option<Way> {
    let encoding = codec.encoding()?;
    let content = Some(content);
    let settings = EncodeSettings { codec, goal: ANY_SIZE, content, effort, ..EncodeSettings::default() };
    Some(Way::Fixed(encoding, Box::new(settings)))
}

/// A codec within numbers of bits, with each family of formats that suits and for each metric.
fn within_goals(
    encoding: &'static Encoding,
    suite: &Suite,
    pixel: PixelInfo,
    effort: Effort,
) -> Vec<Candidate> {
    let bits = suite.bpp.as_deref().filter(|_| !encoding.compared_bpp.is_empty());
    let bits = bits.unwrap_or(encoding.compared_bpp);
    let metrics = suite.metrics().unwrap_or_default();
    let metrics: Vec<Option<Metric>> = if encoding.has_metric && !metrics.is_empty() {
        metrics.into_iter().map(Some).collect()
    } else {
        vec![None]
    };
    let candidate = |metric: Option<Metric>, family: Family, bpp: f64| {
        let goal = Goal::Bpp(bpp);
        let settings = EncodeSettings { goal, metric, family, effort, ..EncodeSettings::default() };
        let mut words = format!("{bpp} bpp");
        let mut series = encoding.id.name.to_owned();
        if family == Family::ErrorMap {
            words.push_str(" residual plane");
            series.push_str(" with residual plane");
        }
        if let Some(metric) = metric {
            words.push(' ');
            words.push_str(metric.name());
            series.push_str(if metric == Metric::Psnr { ", for PSNR" } else { ", for the eye" });
        }
        Candidate {
            codec: encoding.id.name,
            series,
            settings: words,
            has_thumbnail: is_drawn(bpp, bits),
            way: Way::Goal(encoding, Box::new(settings)),
        }
    };
    let of_family = |metric, family| bits.iter().map(move |&bpp| (metric, family, bpp));
    let families = encoding.families(pixel);
    let all =
        metrics.iter().flat_map(|&metric| families.iter().flat_map(move |&family| of_family(metric, family)));
    all.map(|(metric, family, bpp)| candidate(metric, family, bpp)).collect()
}

/// ASTC by the external encoder.
fn rival(astcenc: &Astcenc, side: u32) -> Candidate {
    Candidate {
        codec: RIVAL,
        series: "ASTC".to_owned(),
        settings: format!("{side}x{side}"),
        has_thumbnail: side == DRAWN_SIDE,
        way: Way::Rival(astcenc.clone(), side),
    }
}

/// A JPEG texture.
fn jpeg(quality: u8) -> Candidate {
    Candidate {
        codec: JPEG,
        series: "JPEG texture".to_owned(),
        settings: format!("q{quality}"),
        has_thumbnail: false,
        way: Way::Jpeg(quality),
    }
}
