//! Suites: which codecs and settings a comparison has, as TOML.

use std::path::PathBuf;

use serde::Deserialize;
use texfold::encoding::ENCODINGS;
use texfold_core::Metric;

use super::storage;
use crate::error::UsageError;

/// Those that are built in.
const BUILT_IN: [(&str, &str); 5] = [
    ("all", include_str!("suites/all.toml")),
    ("rates", include_str!("suites/rates.toml")),
    ("limits", include_str!("suites/limits.toml")),
    ("peers", include_str!("suites/peers.toml")),
    ("readme", include_str!("suites/readme.toml")),
];

/// Which codecs and settings are compared.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub(crate) struct Suite {
    /// The comparison in words, for its page.
    pub(crate) title: String,
    /// Names of codecs; without, all that suit an input.
    codecs: Option<Vec<String>>,
    /// Bits a texel that codecs are asked for; without, those that suit each.
    pub(crate) bpp: Option<Vec<f64>>,
    /// What errors count, for codecs that have a choice, each a series of its own: "psnr", "perceptual". Without, the codec's own choice.
    metrics: Vec<String>,
    /// Whether plain blocks are compared, at full, half and quarter size.
    pub(crate) plain: bool,
    /// Whether vq with codebooks of fixed sizes is.
    pub(crate) codebooks: bool,
    /// Sides of ASTC blocks: 4, 5, 6, 8, 10, 12.
    pub(crate) astc: Vec<u32>,
    /// Preset of the encoder of ASTC.
    pub(crate) astc_preset: AstcPreset,
    /// Qualities of JPEG textures, 1 to 100.
    pub(crate) jpeg: Vec<u8>,
    /// Bits a texel of formats for storage, where these are compared.
    pub(crate) storage: Vec<f64>,
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
    /// The option of the program.
    pub(crate) fn option(self) -> &'static str {
        match self {
            AstcPreset::Fast => "-fast",
            AstcPreset::Medium => "-medium",
            AstcPreset::Thorough => "-thorough",
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
    let bits = suite.bpp.iter().flatten().chain(&suite.storage);
    if let Some(bpp) = bits.into_iter().find(|bpp| !(bpp.is_finite() && **bpp > 0.0)) {
        return Err(format!("{bpp} is no number of bits"));
    }
    if let Some(side) = suite.astc.iter().find(|side| ![4, 5, 6, 8, 10, 12].contains(*side)) {
        return Err(format!("there are no ASTC blocks of {side} texels a side"));
    }
    if let Some(quality) = suite.jpeg.iter().find(|quality| !(1..=100).contains(*quality)) {
        return Err(format!("qualities of JPEG are 1 to 100, not {quality}"));
    }
    let known = |name: &String| ENCODINGS.iter().any(|encoding| encoding.id.name == *name);
    if let Some(name) = suite.codecs.iter().flatten().find(|name| !known(name)) {
        let names: Vec<&str> = ENCODINGS.iter().map(|encoding| encoding.id.name).collect();
        return Err(format!("there is no codec {name}; they are {}", names.join(", ")));
    }
    suite.metrics().map_err(|error| error.to_string())?;
    Ok(suite)
}

impl Suite {
    /// Whether a codec is compared.
    pub(crate) fn has(&self, codec: &str) -> bool {
        self.codecs.as_ref().is_none_or(|codecs| codecs.iter().any(|name| name == codec))
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
            ("astc = [7]", "7"),
            ("jpeg = [0]", "100"),
            ("metrics = [\"loud\"]", "loud"),
            ("colour = 1", "colour"),
        ] {
            let reason = parse(text).unwrap_err();
            assert!(reason.contains(word), "{text}: {reason}");
        }
        assert!(find("none").unwrap_err().to_string().contains("rates"));
    }
}
