//! Which settings are compared.

use texfold::{
    Choice, Content, EncodeSettings, Family, Goal,
    bc::{Bc, BcParams},
    core::TextureCodec,
    encoding::{ENCODINGS, Encoding},
    vq::{Vq, VqParams},
};
use texfold_core::Metric;
use texfold_core::image::{ColorSpace, PixelInfo};

use super::rival::Astcenc;
use super::storage::Storage;
use super::suite::{AUTO, AstcPreset, Suite};
use crate::config::EffortName;

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

/// One setting of one codec.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    /// The codec's name.
    pub(crate) codec: &'static str,
    /// The curve that it is a point of.
    pub(crate) series: String,
    /// The settings in words.
    pub(crate) settings: String,
    /// Effort of its encoder, in the words of that encoder; empty where it has no choice.
    pub(crate) effort: String,
    /// Whether the report has an image of it.
    pub(crate) has_thumbnail: bool,
    /// How it is made.
    pub(crate) way: Way,
}

impl Candidate {
    /// With its effort in its settings, which others have with another one.
    fn named(mut self) -> Candidate {
        if !self.effort.is_empty() {
            self.settings = format!("{}, {}", self.settings, self.effort);
        }
        self
    }

    /// Codec, series, settings and effort.
    pub(super) fn words(&self) -> [&str; 4] {
        [self.codec, &self.series, &self.settings, &self.effort]
    }
}

/// How a candidate is made.
#[derive(Debug, Clone)]
pub(crate) enum Way {
    /// By a codec whose settings fix format and size.
    Fixed(&'static Encoding, Box<EncodeSettings>),
    /// By a codec within a goal; neighbours of one codec and family may share a search.
    Goal(&'static Encoding, Box<EncodeSettings>),
    /// By the codec that is best within a goal.
    Auto(Box<EncodeSettings>),
    /// By the external encoder of ASTC, in blocks of that side.
    Rival(Astcenc, u32, AstcPreset),
    /// As a JPEG that is decoded by block.
    Jpeg(u8),
    /// By a format for storage, within a number of bits a texel.
    Storage(Storage, f64),
}

/// Settings of a suite that suit such pixels, at `effort` where the suite has none, the rival's where it is installed, and those of formats
/// for storage.
pub(crate) fn candidates(
    suite: &Suite,
    pixel: PixelInfo,
    effort: EffortName,
    astcenc: Option<&Astcenc>,
    storage: &[Storage],
) -> Vec<Candidate> {
    let efforts = suite.efforts(effort);
    let mut found: Vec<Candidate> = efforts
        .iter()
        .flat_map(|&effort| ours(suite, pixel, effort))
        .map(named_if(efforts.len() > 1))
        .collect();
    let presets = suite.astc_presets();
    let of_rival = astcenc.into_iter().flat_map(|astcenc| {
        presets.iter().flat_map(move |&preset| {
            suite.astc.iter().map(move |&side| rival(astcenc, side, &suite.astc, preset))
        })
    });
    found.extend(of_rival.map(named_if(presets.len() > 1)));
    if matches!(pixel.color_channels(), 1 | 3) && !pixel.has_extra() {
        found.extend(suite.jpeg.iter().map(|&quality| jpeg(quality)));
    }
    for format in storage {
        let speeds = format.speeds(suite.avif_speeds());
        let of_format = speeds.iter().flat_map(|format| stored(format, suite.storage()));
        found.extend(of_format.map(named_if(speeds.len() > 1)));
    }
    found
}

/// Candidates with their effort in their settings, if several efforts are compared.
fn named_if(is_one_of_several: bool) -> impl Fn(Candidate) -> Candidate {
    move |candidate| if is_one_of_several { candidate.named() } else { candidate }
}

/// Those of plain blocks and of our codecs.
fn ours(suite: &Suite, pixel: PixelInfo, effort: EffortName) -> Vec<Candidate> {
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
    if suite.has_auto() {
        let goals = suite.goals(&DRAWN_BPP);
        let goals = &goals;
        let of_metric = |metric| goals.iter().map(move |&goal| auto(goal, goals, metric, effort));
        found.extend(metrics(suite, true).into_iter().flat_map(of_metric));
    }
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

/// The codec that answers a goal best.
fn auto(goal: Goal, all: &[Goal], metric: Option<Metric>, effort: EffortName) -> Candidate {
    let encode = EncodeSettings { goal, metric, effort: effort.effort(), ..EncodeSettings::default() };
    let (mut settings, mut series) = (words(goal), AUTO.to_owned());
    name_metric(metric, &mut settings, &mut series);
    let (effort, has_thumbnail) = (effort.name().to_owned(), is_goal_drawn(goal, all));
    Candidate { codec: AUTO, series, settings, effort, has_thumbnail, way: Way::Auto(Box::new(encode)) }
}

/// A goal, for readers.
pub(super) fn words(goal: Goal) -> String {
    match goal {
        Goal::Bpp(bpp) => format!("{bpp} bpp"),
        Goal::Psnr(psnr) => format!("{psnr} dB"),
        Goal::Tolerance(tolerance) => format!("tolerance {tolerance}"),
    }
}

/// Whether an image is drawn for a goal, of all that a series has: at some bits, and for each quality.
fn is_goal_drawn(goal: Goal, all: &[Goal]) -> bool {
    let bits = |goal: &Goal| if let Goal::Bpp(bpp) = goal { Some(*bpp) } else { None };
    let all: Vec<f64> = all.iter().filter_map(bits).collect();
    bits(&goal).is_none_or(|bpp| is_drawn(bpp, &all))
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
        effort: format.effort(),
        has_thumbnail: is_drawn(goal, goals),
        way: Way::Storage(format.clone(), goal),
    })
}

/// Plain blocks of a fixed format, scaled down.
fn plain(content: Content, reduce_log2: u32, effort: EffortName) -> Option<Candidate> {
    let name = content.name();
    let settings =
        if reduce_log2 == 0 { name.to_owned() } else { format!("{name} at 1/{}", 1 << reduce_log2) };
    let has_thumbnail = content != Content::Bc7 && reduce_log2 < 2;
    let mut own = BcParams::default();
    (own.reduce_log2,) = (Some(reduce_log2),);
    let way = fixed(Choice::of::<Bc>().with::<Bc>(own), content, effort)?;
    let (series, effort) = (name.to_uppercase(), effort.name().to_owned());
    Some(Candidate { codec: Bc::ID.name, series, settings, effort, has_thumbnail, way })
}

/// Vector quantisation with a codebook of a fixed size.
fn codebook((width, height): (u32, u32), content: Content, effort: EffortName) -> Option<Candidate> {
    let settings = format!("{width}x{height} {}", content.name());
    let mut own = VqParams::default();
    (own.codebook,) = (Some((width, height)),);
    let way = fixed(Choice::of::<Vq>().with::<Vq>(own), content, effort)?;
    let (series, effort) = ("vq, codebooks of fixed sizes".to_owned(), effort.name().to_owned());
    Some(Candidate { codec: Vq::ID.name, series, settings, effort, has_thumbnail: false, way })
}

fn fixed(codec: Choice, content: Content, effort: EffortName) -> Option<Way> {
    let encoding = codec.encoding()?;
    let (content, effort) = (Some(content), effort.effort());
    let settings = EncodeSettings { codec, goal: ANY_SIZE, content, effort, ..EncodeSettings::default() };
    Some(Way::Fixed(encoding, Box::new(settings)))
}

/// Metrics of a codec, `None` for its own choice.
fn metrics(suite: &Suite, has_metric: bool) -> Vec<Option<Metric>> {
    let metrics = suite.metrics().unwrap_or_default();
    if metrics.is_empty() || !has_metric { vec![None] } else { metrics.into_iter().map(Some).collect() }
}

/// Adds a metric to settings and series.
fn name_metric(metric: Option<Metric>, settings: &mut String, series: &mut String) {
    let Some(metric) = metric else { return };
    settings.push(' ');
    settings.push_str(metric.name());
    series.push_str(if metric == Metric::Psnr { ", for PSNR" } else { ", for the eye" });
}

/// A codec for each goal, with each family of formats that suits and for each metric.
fn within_goals(
    encoding: &'static Encoding,
    suite: &Suite,
    pixel: PixelInfo,
    effort: EffortName,
) -> Vec<Candidate> {
    let mut goals = suite.goals(encoding.compared_bpp);
    goals.retain(|goal| matches!(goal, Goal::Psnr(_)) || !encoding.compared_bpp.is_empty());
    let metrics = metrics(suite, encoding.has_metric);
    let candidate = |metric: Option<Metric>, family: Family, goal: Goal| {
        let effort_of = effort.effort();
        let settings =
            EncodeSettings { goal, metric, family, effort: effort_of, ..EncodeSettings::default() };
        let mut words = words(goal);
        let mut series = encoding.id.name.to_owned();
        if family == Family::ErrorMap {
            words.push_str(" residual plane");
            series.push_str(" with residual plane");
        }
        name_metric(metric, &mut words, &mut series);
        Candidate {
            codec: encoding.id.name,
            series,
            settings: words,
            effort: effort.name().to_owned(),
            has_thumbnail: is_goal_drawn(goal, &goals),
            way: Way::Goal(encoding, Box::new(settings)),
        }
    };
    let goals = &goals;
    let of_family = |metric, family| goals.iter().map(move |&goal| (metric, family, goal));
    let families = encoding.families(pixel);
    let all =
        metrics.iter().flat_map(|&metric| families.iter().flat_map(move |&family| of_family(metric, family)));
    all.map(|(metric, family, goal)| candidate(metric, family, goal)).collect()
}

/// ASTC by the external encoder.
fn rival(astcenc: &Astcenc, side: u32, all: &[u32], preset: AstcPreset) -> Candidate {
    let bits = |side: u32| 128.0 / f64::from(side * side);
    let all: Vec<f64> = all.iter().map(|&side| bits(side)).collect();
    Candidate {
        codec: RIVAL,
        series: "ASTC".to_owned(),
        settings: format!("{side}x{side}"),
        effort: preset.name().to_owned(),
        has_thumbnail: is_drawn(bits(side), &all),
        way: Way::Rival(astcenc.clone(), side, preset),
    }
}

/// A JPEG texture.
fn jpeg(quality: u8) -> Candidate {
    Candidate {
        codec: JPEG,
        series: "JPEG texture".to_owned(),
        settings: format!("q{quality}"),
        effort: String::new(),
        has_thumbnail: false,
        way: Way::Jpeg(quality),
    }
}
