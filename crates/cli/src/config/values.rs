//! Values of options as they are written on the command line and in configurations.

use std::str::FromStr;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use serde::{Deserialize, Serialize};
use texfold::lightfield::Factors;
use texfold::vq::GuidanceWeights;
use texfold::{CODECS, Choice, Content, Family, Registration};
use texfold_core::image::{Alpha, ColorSpace, MapKind};
use texfold_core::{Access, CodecId, Effort, Metric, TextureCodec};

/// Alpha at and above which a texel of a cut-out is drawn, where no threshold is given.
const CUTOUT_THRESHOLD: f32 = 0.5;

/// A codec by name, or the choice among all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(try_from = "String")]
pub struct CodecName(Option<CodecId>);

impl CodecName {
    /// Name of the choice among all.
    const AUTO: &'static str = "auto";

    /// Codec `C`.
    #[must_use]
    pub fn of<C: TextureCodec>() -> CodecName {
        CodecName(Some(C::ID))
    }

    /// Name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.0.map_or(CodecName::AUTO, |id| id.name)
    }

    /// Whether it is codec `C`.
    #[must_use]
    pub fn is<C: TextureCodec>(self) -> bool {
        self.0 == Some(C::ID)
    }

    /// Whether it is the choice among all.
    #[must_use]
    pub fn is_auto(self) -> bool {
        self.0.is_none()
    }

    /// The choice for images; `None` where the codec takes something else.
    #[must_use]
    pub fn choice(self) -> Option<Choice> {
        self.0.map_or(Some(Choice::auto()), |id| Choice::named(id.name))
    }

    /// What the command line takes, with a word about each.
    pub(crate) fn parser() -> impl TypedValueParser<Value = CodecName> {
        let auto = PossibleValue::new(CodecName::AUTO).help("The one that answers the goal best");
        let codecs = CODECS.iter().map(|codec| PossibleValue::new(codec.id.name).help(codec.about));
        PossibleValuesParser::new([auto].into_iter().chain(codecs)).try_map(|name| name.parse::<CodecName>())
    }
}

impl FromStr for CodecName {
    type Err = ValueError;
    fn from_str(text: &str) -> Result<Self, ValueError> {
        let error = ValueError { value: text.to_owned(), wanted: "auto or the name of a codec, such as bc" };
        if text == CodecName::AUTO {
            return Ok(CodecName(None));
        }
        Registration::by_name(text).map(|codec| CodecName(Some(codec.id))).ok_or(error)
    }
}

impl TryFrom<String> for CodecName {
    type Error = ValueError;
    fn try_from(text: String) -> Result<Self, ValueError> {
        text.parse()
    }
}

/// Formats of content planes by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ContentName {
    /// Plain bytes.
    Raw,
    /// 4 bits a texel.
    Bc1,
    /// 8 bits a texel with smooth alpha.
    Bc3,
    /// One channel, 4 bits a texel.
    Bc4,
    /// Two channels, 8 bits a texel.
    Bc5,
    /// 8 bits a texel, close to the source.
    Bc7,
    /// A small base with a residual plane, in epitomes.
    #[serde(rename = "error-map")]
    ErrorMap,
}

impl ContentName {
    pub(crate) fn content(self) -> Option<Content> {
        match self {
            ContentName::Raw => Some(Content::Raw),
            ContentName::Bc1 => Some(Content::Bc1),
            ContentName::Bc3 => Some(Content::Bc3),
            ContentName::Bc4 => Some(Content::Bc4),
            ContentName::Bc5 => Some(Content::Bc5),
            ContentName::Bc7 => Some(Content::Bc7),
            ContentName::ErrorMap => None,
        }
    }

    pub(crate) fn family(self) -> Family {
        match self {
            ContentName::ErrorMap => Family::ErrorMap,
            _ => Family::Bc,
        }
    }
}

/// How texels are reached.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum AccessName {
    /// In blocks that are decoded before they are drawn: fewest bits.
    Block,
    /// One by one, straight from the compressed form.
    Texel,
}

impl AccessName {
    pub(crate) fn access(self) -> Access {
        match self {
            AccessName::Block => Access::Block,
            AccessName::Texel => Access::Texel,
        }
    }
}

/// Signs of the factors of a light field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum FactorsName {
    /// Any: principal components.
    Signed,
    /// None below zero.
    Nonnegative,
}

impl FactorsName {
    pub(crate) fn factors(self) -> Factors {
        match self {
            FactorsName::Signed => Factors::Signed,
            FactorsName::Nonnegative => Factors::NonNegative,
        }
    }
}

/// The error that a tolerance bounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum ToleranceKindName {
    /// The RMS error of every 4x4 block, in 8-bit units.
    Absolute,
    /// The error of every block in relation to its contrast, 0.002 to 0.004 for instance.
    Relative,
}

/// Which errors count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum MetricName {
    /// All alike: the highest PSNR.
    Psnr,
    /// Those of fine detail less: what looks best.
    Perceptual,
}

impl MetricName {
    pub(crate) fn metric(self) -> Metric {
        match self {
            MetricName::Psnr => Metric::Psnr,
            MetricName::Perceptual => Metric::Perceptual,
        }
    }
}

/// How long to search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EffortName {
    /// Previews.
    Fast,
    /// The usual trade.
    #[default]
    Normal,
    /// Several times slower for a few tenths of a dB.
    High,
}

impl EffortName {
    /// Name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            EffortName::Fast => "fast",
            EffortName::Normal => "normal",
            EffortName::High => "high",
        }
    }

    pub(crate) fn effort(self) -> Effort {
        match self {
            EffortName::Fast => Effort::Fast,
            EffortName::Normal => Effort::Normal,
            EffortName::High => Effort::High,
        }
    }
}

/// What the stored values mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColorName {
    /// Colour.
    #[default]
    Srgb,
    /// Roughness, masks, heights.
    Linear,
    /// Unit vectors.
    Normal,
}

impl ColorName {
    pub(crate) fn color(self) -> ColorSpace {
        match self {
            ColorName::Srgb => ColorSpace::Srgb,
            ColorName::Linear => ColorSpace::Linear,
            ColorName::Normal => ColorSpace::Normal,
        }
    }
}

/// Meaning of the channel beside gray or RGB: `straight`, `cutout`, `cutout=THRESHOLD` or `band`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(try_from = "String")]
pub struct AlphaChoice(pub(crate) Alpha);

/// Two sides in texels: `WIDTHxHEIGHT`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct Sides(pub(crate) u32, pub(crate) u32);

/// Number of image samples and their side in texels: `COUNT` or `COUNTxSIDE`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct Samples(pub(crate) u32, pub(crate) Option<u32>);

/// Weights of the terms of importance, or of kinds of maps: `TERM=WEIGHT,...`; terms that are left out keep their own.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "String")]
pub(crate) enum Weights {
    Importance(GuidanceWeights),
    Maps(Vec<(MapKind, f64)>),
}

/// A value that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("'{value}' is not {wanted}")]
pub struct ValueError {
    value: String,
    wanted: &'static str,
}

impl FromStr for AlphaChoice {
    type Err = ValueError;
    fn from_str(text: &str) -> Result<Self, ValueError> {
        let wanted = "straight, cutout, band, or cutout=THRESHOLD with a threshold above 0 and up to 1";
        let error = || ValueError { value: text.to_owned(), wanted };
        match text.split_once('=') {
            None if text == "straight" => Ok(AlphaChoice(Alpha::Straight)),
            None if text == "band" => Ok(AlphaChoice(Alpha::Band)),
            None if text == "cutout" => Ok(AlphaChoice(Alpha::Cutout(CUTOUT_THRESHOLD))),
            Some(("cutout", threshold)) => {
                let threshold: f32 = threshold.parse().map_err(|_| error())?;
                let legal = threshold > 0.0 && threshold <= 1.0;
                legal.then_some(AlphaChoice(Alpha::Cutout(threshold))).ok_or_else(error)
            }
            _ => Err(error()),
        }
    }
}

impl FromStr for Sides {
    type Err = ValueError;
    fn from_str(text: &str) -> Result<Self, ValueError> {
        let sides =
            text.split_once(['x', 'X']).and_then(|(w, h)| Some(Sides(w.parse().ok()?, h.parse().ok()?)));
        sides.ok_or(ValueError { value: text.to_owned(), wanted: "WIDTHxHEIGHT, such as 256x128" })
    }
}

impl FromStr for Samples {
    type Err = ValueError;
    fn from_str(text: &str) -> Result<Self, ValueError> {
        let samples = match text.split_once(['x', 'X']) {
            None => text.parse().ok().map(|count| Samples(count, None)),
            Some((count, side)) => {
                count.parse().ok().zip(side.parse().ok()).map(|(count, side)| Samples(count, Some(side)))
            }
        };
        samples.ok_or(ValueError { value: text.to_owned(), wanted: "COUNT or COUNTxSIDE, such as 6x64" })
    }
}

impl FromStr for Weights {
    type Err = ValueError;
    fn from_str(text: &str) -> Result<Self, ValueError> {
        let wanted = "TERM=WEIGHT,... with weights of 0 to 1000 and the terms usability, saliency, distortion and painted, \
                      or kinds of maps such as color and normal with weights of 0.01 to 100";
        let error = || ValueError { value: text.to_owned(), wanted };
        let mut weights = GuidanceWeights::default();
        let mut of_maps = Vec::new();
        let mut are_terms = false;
        for pair in text.split(',') {
            let (term, weight) = pair.split_once('=').ok_or_else(error)?;
            let within = |range: std::ops::RangeInclusive<f64>| {
                weight.trim().parse().ok().filter(|weight| range.contains(weight)).ok_or_else(error)
            };
            if let Some(kind) = MapKind::named(term.trim()) {
                of_maps.push((kind, within(0.01..=100.0)?));
                continue;
            }
            let member = match term.trim() {
                "usability" => &mut weights.usability,
                "saliency" => &mut weights.saliency,
                "distortion" => &mut weights.distortion,
                "painted" => &mut weights.painted,
                _ => return Err(error()),
            };
            *member = within(0.0..=1000.0)? as f32;
            are_terms = true;
        }
        match (are_terms, of_maps.is_empty()) {
            (true, true) => Ok(Weights::Importance(weights)),
            (false, false) => Ok(Weights::Maps(of_maps)),
            _ => Err(error()),
        }
    }
}

impl TryFrom<String> for Weights {
    type Error = ValueError;
    fn try_from(text: String) -> Result<Self, ValueError> {
        text.parse()
    }
}

impl TryFrom<String> for AlphaChoice {
    type Error = ValueError;
    fn try_from(text: String) -> Result<Self, ValueError> {
        text.parse()
    }
}

impl TryFrom<String> for Sides {
    type Error = ValueError;
    fn try_from(text: String) -> Result<Self, ValueError> {
        text.parse()
    }
}

impl TryFrom<String> for Samples {
    type Error = ValueError;
    fn try_from(text: String) -> Result<Self, ValueError> {
        text.parse()
    }
}
