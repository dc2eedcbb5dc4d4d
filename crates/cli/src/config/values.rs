//! Values of options as they are written on the command line and in configurations.

use std::str::FromStr;

use serde::Deserialize;
use texfold::{CodecChoice, Content, Family};
use texfold_core::image::{Alpha, ColorSpace};
use texfold_core::{AstcBlock, Effort};

/// Alpha at and above which a texel of a cut-out is drawn, where no threshold is given.
const CUTOUT_THRESHOLD: f32 = 0.5;

/// Codecs by name, also those of other versions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CodecName {
    /// The one that answers the goal best.
    #[default]
    Auto,
    /// Plain block compression.
    Bc,
    /// Importance-driven vector quantisation.
    Vq,
    /// Epitome factoring.
    Epitome,
    /// A small base and an error map.
    Progressive,
    /// Surface light-field maps, for captures.
    Lightfield,
    /// A root and patches of higher resolution, for folders of photographs.
    Zipmap,
}

impl CodecName {
    /// Name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            CodecName::Auto => "auto",
            CodecName::Bc => "bc",
            CodecName::Vq => "vq",
            CodecName::Epitome => "epitome",
            CodecName::Progressive => "progressive",
            CodecName::Lightfield => "lightfield",
            CodecName::Zipmap => "zipmap",
        }
    }

    /// The codec, where this version has it.
    #[must_use]
    pub fn choice(self) -> Option<CodecChoice> {
        match self {
            CodecName::Auto => Some(CodecChoice::Auto),
            CodecName::Bc => Some(CodecChoice::Bc),
            CodecName::Vq => Some(CodecChoice::Vq),
            CodecName::Epitome => Some(CodecChoice::Epitome),
            CodecName::Progressive => Some(CodecChoice::Progressive),
            _ => None,
        }
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
    /// The ASTC formats that suit the goal; ASTC needs a build with the feature `astc`.
    Astc,
    /// A small base with an error map, in epitomes.
    #[serde(rename = "error-map")]
    ErrorMap,
    /// 8 bits a texel.
    Astc4,
    /// 5.12 bits a texel.
    Astc5,
    /// 3.56 bits a texel.
    Astc6,
    /// 2 bits a texel.
    Astc8,
    /// 1.28 bits a texel.
    Astc10,
    /// 0.89 bits a texel.
    Astc12,
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
            ContentName::Astc | ContentName::ErrorMap => None,
            ContentName::Astc4 => Some(Content::Astc(AstcBlock::B4)),
            ContentName::Astc5 => Some(Content::Astc(AstcBlock::B5)),
            ContentName::Astc6 => Some(Content::Astc(AstcBlock::B6)),
            ContentName::Astc8 => Some(Content::Astc(AstcBlock::B8)),
            ContentName::Astc10 => Some(Content::Astc(AstcBlock::B10)),
            ContentName::Astc12 => Some(Content::Astc(AstcBlock::B12)),
        }
    }

    pub(crate) fn family(self) -> Family {
        match self {
            ContentName::Astc => Family::Astc,
            ContentName::ErrorMap => Family::ErrorMap,
            _ => Family::Bc,
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

/// How alpha is read: `straight`, `cutout` or `cutout=THRESHOLD`.
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
        let wanted = "straight, cutout, or cutout=THRESHOLD with a threshold above 0 and up to 1";
        let error = || ValueError { value: text.to_owned(), wanted };
        match text.split_once('=') {
            None if text == "straight" => Ok(AlphaChoice(Alpha::Straight)),
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
