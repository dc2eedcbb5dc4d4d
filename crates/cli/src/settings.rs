//! How inputs are to be encoded: what options come to, and what tasks work with.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use texfold::{EncodeSettings, lightfield::LightParams, zipmap::ZipParams};
use texfold_core::image::{Alpha, ColorSpace};

use crate::input::Remarks;

/// What an input is taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Each file by itself, also those of a folder.
    Image,
    /// All images of a folder in one file.
    Set,
    /// The frames of a folder, in sorted order, in one file.
    Sequence,
    /// A mesh with photographs of it.
    Lightfield,
    /// Photographs of one surface at several scales, in one file.
    Zoom,
    /// The maps of a material, by the ends of file names (_Color, _Normal, _ORM, _Height and the like), in one file; a folder may hold
    /// those of several.
    Material,
}

/// How one input is to be encoded.
#[derive(Debug, Clone)]
pub(crate) struct Settings {
    pub(crate) encode: EncodeSettings,
    pub(crate) color: ColorSpace,
    pub(crate) alpha: Option<Alpha>,
    pub(crate) content_from: Option<PathBuf>,
    pub(crate) importance_map: Option<PathBuf>,
    pub(crate) mesh: Option<PathBuf>,
    /// Whether files are the maps of a material.
    pub(crate) is_material: bool,
    /// Goal for normal maps, instead of that of `encode`: mean angle in degrees.
    pub(crate) degrees: Option<f64>,
    /// Side of the blocks of a relative tolerance, where the goal of `encode` is one.
    pub(crate) relative: Option<u32>,
    /// Notes on colour handling by file names.
    pub(crate) remarks: Remarks,
}

/// How one capture is to be encoded.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LightSettings {
    pub(crate) params: LightParams,
    pub(crate) mesh: Option<PathBuf>,
    pub(crate) triangles: Option<u32>,
}

/// How one zoom stack is to be encoded.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ZoomSettings {
    pub(crate) params: ZipParams,
    pub(crate) color: ColorSpace,
    pub(crate) alpha: Option<Alpha>,
}
