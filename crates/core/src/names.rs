//! Names of settings, as commands and other languages write them.

use std::str::FromStr;

use crate::image::ColorSpace;
use crate::{Access, Effort, Goal, Metric};

/// A name that no value of a setting has.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{setting} '{found}'; give one of {known}")]
pub struct NameError {
    /// The setting.
    pub setting: &'static str,
    /// The name.
    pub found: String,
    /// Names that values have.
    pub known: String,
}

/// The value of that name.
fn named<T: Copy>(setting: &'static str, found: &str, values: &[(&str, T)]) -> Result<T, NameError> {
    let value = values.iter().find(|(name, _)| *name == found);
    value.map(|(_, value)| *value).ok_or_else(|| NameError {
        setting,
        found: found.to_owned(),
        known: values.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", "),
    })
}

impl FromStr for Effort {
    type Err = NameError;
    fn from_str(name: &str) -> Result<Self, NameError> {
        named("effort", name, &[("fast", Effort::Fast), ("normal", Effort::Normal), ("high", Effort::High)])
    }
}

impl FromStr for Metric {
    type Err = NameError;
    fn from_str(name: &str) -> Result<Self, NameError> {
        named("metric", name, &[("psnr", Metric::Psnr), ("perceptual", Metric::Perceptual)])
    }
}

impl FromStr for Access {
    type Err = NameError;
    fn from_str(name: &str) -> Result<Self, NameError> {
        named("access", name, &[("block", Access::Block), ("texel", Access::Texel)])
    }
}

impl FromStr for ColorSpace {
    type Err = NameError;
    fn from_str(name: &str) -> Result<Self, NameError> {
        let values =
            [("srgb", ColorSpace::Srgb), ("linear", ColorSpace::Linear), ("normal", ColorSpace::Normal)];
        named("color", name, &values)
    }
}

impl Goal {
    /// The goal of that name: "psnr" in dB, "bpp" in bits a texel or "tolerance" in 8-bit units of RMS error.
    ///
    /// # Errors
    /// [`NameError`].
    pub fn named(name: &str, value: f64) -> Result<Goal, NameError> {
        let values =
            [("psnr", Goal::Psnr(value)), ("bpp", Goal::Bpp(value)), ("tolerance", Goal::Tolerance(value))];
        named("goal", name, &values)
    }
}
