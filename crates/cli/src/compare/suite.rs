//! Suites: which codecs and settings a comparison has, as TOML.

use std::path::PathBuf;

use serde::Deserialize;
use texfold::encoding::ENCODINGS;
use texfold_core::{Goal, Metric};

use super::storage;
use crate::config::EffortName;
use crate::error::UsageError;

/// Name of the choice among codecs.
pub(super) const AUTO: &str = "auto";

/// Those that are built in.
const BUILT_IN: [(&str, &str); 9] = [
    ("all", include_str!("suites/all.toml")),
    ("rates", include_str!("suites/rates.toml")),
    ("limits", include_str!("suites/limits.toml")),
    ("peers", include_str!("suites/peers.toml")),
    ("readme", include_str!("suites/readme.toml")),
    ("speed", include_str!("suites/speed.toml")),
    ("sheet", include_str!("suites/sheet.toml")),
    ("choices", include_str!("suites/choices.toml")),
    ("materials", include_str!("suites/materials.toml")),
];

/// Which codecs and settings are compared.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub(crate) struct Suite {
    /// The comparison in words, for its page.
    pub(crate) title: String,
    /// Names of codecs, also "auto"; without, all that suit an input.
    codecs: Option<Vec<String>>,
    /// Efforts of codecs, the fastest first; without, that of the command.
    efforts: Vec<EffortName>,
    /// Bits a texel that codecs are asked for; without, and without PSNRs, those that suit each.
    bpp: Option<Vec<f64>>,
    /// PSNRs in dB that codecs are asked for.
    psnr: Vec<f64>,
    /// Bits a texel at which charts compare speeds; without, 2.
    equal_bpp: Option<f64>,
    /// What errors count, for codecs that have a choice, each a series of its own: "psnr", "perceptual". Without, the codec's own choice.
    metrics: Vec<String>,
    /// Whether plain blocks are compared, at full, half and quarter size.
    pub(crate) plain: bool,
    /// Whether vq with codebooks of fixed sizes is.
    pub(crate) codebooks: bool,
    /// Sides of ASTC blocks: 4, 5, 6, 8, 10, 12.
    pub(crate) astc: Vec<u32>,
    /// Presets of the encoder of ASTC, the fastest first; without, medium.
    astc_presets: Vec<AstcPreset>,
    /// Qualities of JPEG textures, 1 to 100.
    pub(crate) jpeg: Vec<u8>,
    /// Bits a texel of formats for storage, where these are compared.
    pub(crate) storage: Vec<f64>,
    /// Speeds of the encoder of AVIF, 0 to 10, the fastest first; without, 6.
    avif_speeds: Vec<u8>,
}

/// A preset of `astcenc`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum AstcPreset {
    Fast,
    #[default]
    Medium,
    Thorough,
}

impl AstcPreset {
    /// The name of the program's option.
    pub(crate) fn name(self) -> &'static str {
        match self {
            AstcPreset::Fast => "fast",
            AstcPreset::Medium => "medium",
            AstcPreset::Thorough => "thorough",
        }
    }
}

/// The suite that a command names: one that is built in, or a file.
///
/// # Errors
/// [`UsageError::Suite`].
pub(super) fn find(name: &str) -> Result<Suite, UsageError> {
    let fault = |reason: String| UsageError::Suite { name: name.to_owned(), reason };
    if let Some((_, text)) = BUILT_IN.iter().find(|(known, _)| *known == name) {
        return parse(text).map_err(fault);
    }
    let path = PathBuf::from(name);
    if path.extension().is_none_or(|extension| extension != "toml") {
        let names = BUILT_IN.map(|(name, _)| name).join(", ");
        return Err(fault(format!("there is no such suite; name one of {names}, or a file NAME.toml")));
    }
    let text = std::fs::read_to_string(&path).map_err(|error| fault(error.to_string()))?;
    parse(&text).map_err(fault)
}

fn parse(text: &str) -> Result<Suite, String> {
    let suite: Suite = toml::from_str(text).map_err(|error| error.to_string())?;
    let bits = suite.bpp.iter().flatten().chain(&suite.storage).chain(&suite.equal_bpp);
    if let Some(bpp) = bits.into_iter().find(|bpp| !(bpp.is_finite() && **bpp > 0.0)) {
        return Err(format!("{bpp} is no number of bits"));
    }
    if let Some(psnr) = suite.psnr.iter().find(|psnr| !(psnr.is_finite() && **psnr > 0.0)) {
        return Err(format!("{psnr} dB is no PSNR"));
    }
    if let Some(side) = suite.astc.iter().find(|side| ![4, 5, 6, 8, 10, 12].contains(*side)) {
        return Err(format!("there are no ASTC blocks of {side} texels a side"));
    }
    if let Some(quality) = suite.jpeg.iter().find(|quality| !(1..=100).contains(*quality)) {
        return Err(format!("qualities of JPEG are 1 to 100, not {quality}"));
    }
    if let Some(speed) = suite.avif_speeds.iter().find(|speed| **speed > 10) {
        return Err(format!("speeds of AVIF are 0 to 10, not {speed}"));
    }
    let known = |name: &String| name == AUTO || ENCODINGS.iter().any(|encoding| encoding.id.name == *name);
    if let Some(name) = suite.codecs.iter().flatten().find(|name| !known(name)) {
        let names: Vec<&str> = ENCODINGS.iter().map(|encoding| encoding.id.name).collect();
        return Err(format!("there is no codec {name}; they are {}, and {AUTO}", names.join(", ")));
    }
    suite.metrics().map_err(|error| error.to_string())?;
    Ok(suite)
}

impl Suite {
    /// Whether a codec is compared.
    pub(crate) fn has(&self, codec: &str) -> bool {
        self.codecs.as_ref().is_none_or(|codecs| codecs.iter().any(|name| name == codec))
    }

    /// Whether the choice among codecs is compared.
    pub(crate) fn has_auto(&self) -> bool {
        self.codecs.iter().flatten().any(|name| name == AUTO)
    }

    /// What codecs are asked for: bits, or where the suite has no goals those that are `usual`; then PSNRs.
    pub(crate) fn goals(&self, usual: &[f64]) -> Vec<Goal> {
        let usual = if self.psnr.is_empty() { usual } else { &[] };
        let bits = self.bpp.as_deref().unwrap_or(usual);
        let bits = bits.iter().map(|&bpp| Goal::Bpp(bpp));
        bits.chain(self.psnr.iter().map(|&psnr| Goal::Psnr(psnr))).collect()
    }

    /// Efforts of codecs, where that of the command is `usual`.
    pub(crate) fn efforts(&self, usual: EffortName) -> Vec<EffortName> {
        if self.efforts.is_empty() { vec![usual] } else { self.efforts.clone() }
    }

    /// Bits a texel at which charts compare speeds.
    pub(crate) fn equal_bpp(&self) -> f64 {
        self.equal_bpp.unwrap_or(2.0)
    }

    /// Presets of the encoder of ASTC.
    pub(crate) fn astc_presets(&self) -> &[AstcPreset] {
        if self.astc_presets.is_empty() { &[AstcPreset::Medium] } else { &self.astc_presets }
    }

    /// Speeds of the encoder of AVIF.
    pub(crate) fn avif_speeds(&self) -> &[u8] {
        if self.avif_speeds.is_empty() { &[6] } else { &self.avif_speeds }
    }

    /// What errors count.
    pub(crate) fn metrics(&self) -> Result<Vec<Metric>, texfold_core::NameError> {
        self.metrics.iter().map(|name| name.parse()).collect()
    }

    /// Bits of formats for storage.
    pub(crate) fn storage(&self) -> &[f64] {
        if self.storage.is_empty() { &storage::GOALS } else { &self.storage }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn suites_that_are_built_in_are_read_and_faults_are_named() {
        for (name, _) in BUILT_IN {
            assert!(!find(name).unwrap().title.is_empty(), "{name}");
        }
        for (text, word) in [
            ("codecs = [\"dtc\"]", "dtc"),
            ("bpp = [0.0]", "bits"),
            ("psnr = [-3.0]", "dB"),
            ("astc = [7]", "7"),
            ("jpeg = [0]", "100"),
            ("metrics = [\"loud\"]", "loud"),
            ("efforts = [\"slow\"]", "slow"),
            ("avif-speeds = [11]", "10"),
            ("equal-bpp = -1.0", "bits"),
            ("colour = 1", "colour"),
        ] {
            let reason = parse(text).unwrap_err();
            assert!(reason.contains(word), "{text}: {reason}");
        }
        assert!(find("none").unwrap_err().to_string().contains("rates"));
    }
}
