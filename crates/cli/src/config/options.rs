//! Options for an input and for a run, and the settings that follow from them.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use texfold::{
    Choice, Content, EncodeSettings, Family,
    dct::{Dct, DctParams},
    epitome::{Epitome, EpitomeParams, ToleranceKind},
    lightfield::{Directions, FitMethod, LightParams, Lightfield},
    progressive::Progressive,
    vq::{Vq, VqParams},
    zipmap::{ZipParams, Zipmap},
};
use texfold_core::image::ColorSpace;
use texfold_core::{Goal, Params};

use super::names;
use super::values::{
    AccessName, AlphaChoice, CodecName, ColorName, ContentName, EffortName, FactorsName, MetricName, Samples,
    Sides, ToleranceKindName, Weights,
};
use crate::error::{CliError, UsageError};
use crate::input::Remarks;
use crate::normals::{USUAL_DEGREES, psnr_of};
use crate::settings::{Kind, LightSettings, Settings, ZoomSettings};

/// Most terms that a goal for a light field chooses from by default: each further term costs as many bits and gains
/// little (`benches`, `lightfield`).
const MOST_TERMS_FOR_GOAL: u32 = 4;
/// Texels a side of view maps over the whole sphere, where regions share them: as fine as those of 16 over a
/// hemisphere.
const SHARED_GRID: u32 = 32;
/// Log2 downscale of surface maps where maps are codewords: another one costs 0.1 dB of raw maps (`benches`,
/// `lightfield`).
const SMALL_REDUCE_LOG2: u8 = 2;
/// Goal of materials where none is given: at it, normals are turned by 1.4 degrees in the mean.
const MATERIAL_GOAL: Goal = Goal::Psnr(40.0);
/// Share of the codebook that samples take where only their number is given: the paper's half.
const SAMPLE_SHARE: f64 = 0.5;

/// Options for one input, on the command line or in a rule.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct Options {
    /// Which codec; by default the one that answers the goal best.
    #[arg(long, value_parser = CodecName::parser(), help_heading = "Codec")]
    pub(super) codec: Option<CodecName>,
    /// Plain blocks instead of the named codec where they answer the goal better.
    #[arg(long, num_args = 0..=1, require_equals = true, default_missing_value = "true", value_name = "BOOL", help_heading = "Codec")]
    pub(super) or_plain: Option<bool>,
    /// Goal: the smallest file with at least this PSNR in dB (default goal: 34).
    #[arg(long, value_name = "DB", group = "goal", help_heading = "Goal", allow_negative_numbers = true)]
    pub(super) psnr: Option<f64>,
    /// Goal: the best quality within this many bits per texel, compressed; what blocks are decoded to while drawn does not count.
    #[arg(long, value_name = "B", group = "goal", help_heading = "Goal", allow_negative_numbers = true)]
    pub(super) bpp: Option<f64>,
    /// Goal: the smallest file whose 4x4 blocks each have at most this RMS error in 8-bit units.
    #[arg(long, value_name = "E", group = "goal", help_heading = "Goal", allow_negative_numbers = true)]
    pub(super) tolerance: Option<f64>,
    /// Goal: the smallest file of a normal map whose normals are turned by at most this many degrees in the mean (default goal of normal
    /// maps: 1).
    #[arg(long, value_name = "D", group = "goal", help_heading = "Goal", allow_negative_numbers = true)]
    pub(super) degrees: Option<f64>,
    /// Format of the texel data; by default the goal decides.
    #[arg(long, value_enum, help_heading = "Codec")]
    pub(super) content: Option<ContentName>,
    /// epitome, zipmap, lightfield, auto: access to texels. By block takes fewer bits and is decoded before it is drawn (default);
    /// by texel is drawn straight from the compressed form. Of the other codecs, dct is by block, bc, vq and progressive by texel.
    #[arg(long, value_enum, help_heading = "Codec")]
    pub(super) access: Option<AccessName>,
    /// dct; progressive; epitome by block and with --content error-map; zipmap by block: which errors count. By default those that the
    /// eye sees for colours and goals of bits, else all alike.
    #[arg(long, value_enum, help_heading = "Goal")]
    pub(super) metric: Option<MetricName>,
    /// epitome: a mask of the first image's size; content is taken from where it is bright.
    #[arg(long, value_name = "MASK", help_heading = "Epitomes")]
    pub(super) content_from: Option<PathBuf>,
    /// Banks: category of the images. Images of one category share a codebook; without this option each
    /// tile joins the category with the nearest colours.
    #[arg(long, value_name = "NAME", help_heading = "Banks")]
    pub(super) category: Option<String>,
    /// epitome: number of layers in the file (1 to 8). Each has about half the bits of the next; a prefix of the file
    /// decodes to a coarser image.
    #[arg(long, value_name = "N", help_heading = "Epitomes")]
    pub(super) layers: Option<u32>,
    /// epitome: all blocks have this side in texels, a multiple of 4 in 8 to 64. Without it, goals of PSNR and bits choose from three sides
    /// and tolerances have blocks of 12.
    #[arg(long, value_name = "TEXELS", help_heading = "Epitomes")]
    pub(super) block: Option<u32>,
    /// epitome: the error that --tolerance bounds (absolute by default).
    #[arg(long, value_name = "KIND", help_heading = "Epitomes")]
    pub(super) tolerance_kind: Option<ToleranceKindName>,
    /// lightfield: simplify the mesh to this many triangles; by default to as few as the photographs need.
    #[arg(long, value_name = "N", help_heading = "Light fields")]
    pub(super) triangles: Option<u32>,
    /// lightfield: fraction of raw map size to keep (0-1]. Below 1, places share maps from a codebook, and surface maps
    /// have a lower resolution.
    #[arg(long, value_name = "FRACTION", help_heading = "Light fields")]
    pub(super) codewords: Option<f32>,
    /// lightfield: divide the mesh into this many regions whose vertices share view maps; by default each vertex has
    /// its own, or with a goal whichever takes less.
    #[arg(long, value_name = "N", help_heading = "Light fields")]
    pub(super) regions: Option<u32>,
    /// lightfield: signs of the factors; signed by default.
    #[arg(long, value_enum, help_heading = "Light fields")]
    pub(super) factors: Option<FactorsName>,
    /// lightfield: texels a side of a view map, a multiple of 4 from 4 to 64; by default 16, with --regions 32.
    #[arg(long, value_name = "N", help_heading = "Light fields")]
    pub(super) grid: Option<u32>,
    /// lightfield: number of terms beside the mean, 0 to 8; by default 1, or up to 4 with a goal.
    #[arg(long, value_name = "K", help_heading = "Light fields")]
    pub(super) terms: Option<u32>,
    /// What an input is; by default a file is an image and a folder is a set. As a set or sequence, a file is all its frames or pages.
    #[arg(long = "as", value_enum, help_heading = "Input")]
    #[serde(rename = "as")]
    pub(super) kind: Option<Kind>,
    /// Store a full mip chain.
    #[arg(long, num_args = 0..=1, require_equals = true, default_missing_value = "true", value_name = "BOOL", help_heading = "Codec")]
    pub(super) mips: Option<bool>,
    /// How long to search.
    #[arg(long, value_enum, help_heading = "Goal")]
    pub(super) effort: Option<EffortName>,
    /// vq: width and height of the codebook in texels, instead of a goal.
    #[arg(long, value_name = "WxH", help_heading = "Vector quantisation")]
    pub(super) codebook: Option<Sides>,
    /// vq: number of image samples and their side in texels.
    #[arg(long, value_name = "N[xSIDE]", help_heading = "Vector quantisation")]
    pub(super) samples: Option<Samples>,
    /// vq: weight of importance, 0 to 4; 0 ignores it, 1 is the default.
    #[arg(long, value_name = "X", help_heading = "Vector quantisation")]
    pub(super) importance: Option<f32>,
    /// vq: weights of the terms of importance, such as saliency=2,distortion=0 (usual: usability=1,saliency=1,distortion=1,painted=2).
    /// Materials: weights of the squared errors of maps by kind, 0.01 to 100, such as normal=2,height=0.5 (usual: 1, and 0.25 for roughness,
    /// metalness, occlusion and orm where errors count as seen); kinds are color,
    /// normal, roughness, metalness, occlusion, orm, height, emissive, opacity, other.
    #[arg(long, value_name = "TERM=W,...", help_heading = "Goal")]
    pub(super) weights: Option<Weights>,
    /// vq: a painted importance image, bright where it matters.
    #[arg(long, value_name = "FILE", help_heading = "Vector quantisation")]
    pub(super) importance_map: Option<PathBuf>,
    /// vq: a mesh (OBJ, glTF, GLB) that the texture is drawn on. lightfield: a mesh (OBJ, PLY, glTF, GLB) that replaces
    /// the capture's own.
    #[arg(long, value_name = "FILE", help_heading = "Vector quantisation")]
    pub(super) mesh: Option<PathBuf>,
    /// Meaning of the images' values. By default file names that end in _Normal, _Roughness, _AO, _Height and the like are
    /// normal or linear, and all else is srgb; a folder of unlike maps in one file is srgb: give --as material or --as image.
    #[arg(long, value_enum, help_heading = "Input")]
    pub(super) color: Option<ColorName>,
    /// Meaning of the channel beside gray or RGB: straight, cutout, cutout=THRESHOLD, band.
    #[arg(long, value_name = "ALPHA", help_heading = "Input")]
    pub(super) alpha: Option<AlphaChoice>,
}

/// Options for the whole run.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct RunOptions {
    /// Inputs that are encoded in parallel; by default the number of cores.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(crate) jobs: Option<u32>,
    /// Memory limit in GiB for all inputs that are encoded in parallel; by default three quarters of the machine's.
    #[arg(long, value_name = "GIB")]
    pub(crate) memory: Option<f64>,
    /// Write a JSON report of all inputs to this file.
    #[arg(long, value_name = "FILE")]
    pub(crate) report: Option<PathBuf>,
    /// Encode again what is up to date. In a bank, replace images of the same names.
    #[arg(long, num_args = 0..=1, require_equals = true, default_missing_value = "true", value_name = "BOOL")]
    pub(crate) force: Option<bool>,
    /// Exit with 1 where anything is warned of, such as a goal that is missed.
    #[arg(long, num_args = 0..=1, require_equals = true, default_missing_value = "true", value_name = "BOOL")]
    pub(crate) strict: Option<bool>,
    /// Read files that transforms.json, images.txt or zipmap.toml name outside of their folder.
    #[arg(long, num_args = 0..=1, require_equals = true, default_missing_value = "true", value_name = "BOOL")]
    pub(crate) outside: Option<bool>,
}

impl RunOptions {
    /// Values of `other` where this one has none.
    pub(crate) fn or(self, other: RunOptions) -> RunOptions {
        RunOptions {
            jobs: self.jobs.or(other.jobs),
            memory: self.memory.or(other.memory),
            report: self.report.or(other.report),
            force: self.force.or(other.force),
            strict: self.strict.or(other.strict),
            outside: self.outside.or(other.outside),
        }
    }

    /// Checks what clap has not.
    pub(crate) fn check(&self) -> Result<(), UsageError> {
        let jobs = self.jobs.map(f64::from);
        in_range("jobs", jobs, |jobs| (1.0..=1024.0).contains(&jobs), "1..=1024")?;
        let range = "finite numbers of GiB above 0";
        in_range("memory", self.memory, |gib| gib.is_finite() && gib > 0.0, range)
    }
}

fn in_range(
    option: &'static str,
    value: Option<f64>,
    legal: impl Fn(f64) -> bool,
    range: &'static str,
) -> Result<(), UsageError> {
    match value {
        Some(value) if !legal(value) => Err(UsageError::Range { option, value: value.to_string(), range }),
        _ => Ok(()),
    }
}

impl Options {
    /// Values of `other` where these have none; the goals count as one value.
    pub(crate) fn or(&self, other: &Options) -> Options {
        let goals = if self.has_goal() { self } else { other };
        Options {
            codec: self.codec.or(other.codec),
            or_plain: self.or_plain.or(other.or_plain),
            psnr: goals.psnr,
            bpp: goals.bpp,
            tolerance: goals.tolerance,
            degrees: goals.degrees,
            content: self.content.or(other.content),
            access: self.access.or(other.access),
            metric: self.metric.or(other.metric),
            content_from: self.content_from.clone().or_else(|| other.content_from.clone()),
            category: self.category.clone().or_else(|| other.category.clone()),
            layers: self.layers.or(other.layers),
            block: self.block.or(other.block),
            tolerance_kind: self.tolerance_kind.or(other.tolerance_kind),
            triangles: self.triangles.or(other.triangles),
            codewords: self.codewords.or(other.codewords),
            regions: self.regions.or(other.regions),
            factors: self.factors.or(other.factors),
            grid: self.grid.or(other.grid),
            terms: self.terms.or(other.terms),
            kind: self.kind.or(other.kind),
            mips: self.mips.or(other.mips),
            effort: self.effort.or(other.effort),
            codebook: self.codebook.or(other.codebook),
            samples: self.samples.or(other.samples),
            importance: self.importance.or(other.importance),
            weights: self.weights.clone().or_else(|| other.weights.clone()),
            importance_map: self.importance_map.clone().or_else(|| other.importance_map.clone()),
            mesh: self.mesh.clone().or_else(|| other.mesh.clone()),
            color: self.color.or(other.color),
            alpha: self.alpha.or(other.alpha),
        }
    }

    /// Options that say only what pixels mean.
    pub(crate) fn of_pixels(color: Option<ColorName>, alpha: Option<AlphaChoice>) -> Options {
        Options { color, alpha, ..Options::default() }
    }

    /// Checks that only options about pixels are given: the file settles all others when images are added to it.
    pub(crate) fn check_of_pixels(&self) -> Result<(), UsageError> {
        let given = [
            ("codec", self.codec.is_some()),
            ("psnr, --bpp, --tolerance and --degrees", self.has_goal()),
            ("content", self.content.is_some()),
            ("access", self.access.is_some()),
            ("metric", self.metric.is_some()),
            ("mips", self.mips.is_some()),
            ("color", self.color.is_some()),
            ("codebook", self.codebook.is_some()),
            ("samples", self.samples.is_some()),
            ("effort", self.effort.is_some()),
            ("importance", self.importance.is_some()),
            ("weights", self.weights.is_some()),
            ("mesh", self.mesh.is_some()),
            ("category", self.category.is_some()),
        ];
        match given.into_iter().find(|(_, is_given)| *is_given) {
            Some((option, _)) => Err(UsageError::Excluded { option, other: "--add-to" }),
            None => Ok(()),
        }
    }

    fn has_goal(&self) -> bool {
        [self.psnr, self.bpp, self.tolerance, self.degrees].iter().any(Option::is_some)
    }

    /// What the input is, where it is said.
    pub(crate) fn kind(&self) -> Option<Kind> {
        self.kind
    }

    /// The category that an image of a bank is of, where it is said.
    pub(crate) fn category(&self) -> Option<&str> {
        self.category.as_deref()
    }

    /// The options for an image of a bank: codec dct where none is named.
    ///
    /// # Errors
    /// [`UsageError::BankCodec`] for codecs other than dct and progressive.
    pub(crate) fn of_bank(&self) -> Result<Options, UsageError> {
        if self.degrees.is_some() {
            return Err(UsageError::Excluded { option: "degrees", other: "banks" });
        }
        match self.codec {
            Some(codec) if codec.is::<Dct>() || codec.is::<Progressive>() => Ok(self.clone()),
            Some(codec) if !codec.is_auto() => Err(UsageError::BankCodec { codec: codec.name() }),
            _ => Ok(Options { codec: Some(CodecName::of::<Dct>()), ..self.clone() }),
        }
    }

    /// Checks what can be checked without an input.
    pub(crate) fn check(&self) -> Result<(), UsageError> {
        let positive = |value: f64| value.is_finite() && value > 0.0;
        in_range("psnr", self.psnr, positive, "finite numbers above 0")?;
        in_range("bpp", self.bpp, positive, "finite numbers above 0")?;
        in_range("tolerance", self.tolerance, positive, "finite numbers above 0")?;
        in_range("degrees", self.degrees, |degrees| (0.01..=45.0).contains(&degrees), "0.01..=45")?;
        in_range("importance", self.importance.map(f64::from), |x| (0.0..=4.0).contains(&x), "0..=4")?;
        let most = f64::from(texfold::epitome::MAX_LAYERS);
        in_range("layers", self.layers.map(f64::from), |layers| (1.0..=most).contains(&layers), "1..=8")?;
        if self.tolerance.is_some() {
            in_range("layers", self.layers.map(f64::from), |layers| layers == 1.0, "1, for a tolerance")?;
        }
        let is_block = |side: f64| (8.0..=64.0).contains(&side) && side % 4.0 == 0.0;
        in_range("block", self.block.map(f64::from), is_block, "multiples of 4 in 8..=64")?;
        let side = |value: f64| (4.0..=256.0).contains(&value) && value % 4.0 == 0.0;
        for value in self.codebook.iter().flat_map(|sides| [sides.0, sides.1]) {
            in_range("codebook", Some(f64::from(value)), side, "sides that are multiples of 4 in 4..=256")?;
        }
        if let Some(Samples(count, sample_side)) = self.samples {
            in_range("samples", Some(f64::from(count)), |count| count <= 64.0, "0..=64 samples")?;
            let range = "sides that are multiples of 4 in 4..=256";
            in_range("samples", sample_side.filter(|_| count > 0).map(f64::from), side, range)?;
        }
        if self.content.is_some() && self.access == Some(AccessName::Block) {
            return Err(UsageError::Excluded { option: "content", other: "--access block" });
        }
        if let Some(choice) = self.codec.unwrap_or_default().choice() {
            let (content, family) = self.content();
            let asked = EncodeSettings {
                codec: self.with_own(choice),
                goal: self.goal(),
                content,
                family,
                access: self.access.map(AccessName::access),
                metric: self.metric.map(MetricName::metric),
                ..EncodeSettings::default()
            };
            asked.check().map_err(|source| UsageError::Setting { source })?;
        }
        self.check_codec()
    }

    /// Options that only some codecs have: what is given, and the names of these codecs.
    fn check_codec(&self) -> Result<(), UsageError> {
        const CHOSEN_VQ: &[&str] = &["vq", "auto"];
        let error_map = self.content == Some(ContentName::ErrorMap);
        let owned: [(&str, bool, &[&'static str]); 19] = [
            ("content-from", self.content_from.is_some(), &["epitome"]),
            ("layers", self.layers.is_some(), &["epitome"]),
            ("block", self.block.is_some(), &["epitome"]),
            ("tolerance-kind", self.tolerance_kind.is_some(), &["epitome"]),
            ("content error-map", error_map, &["epitome"]),
            ("metric", self.metric.is_some(), &["dct", "progressive", "epitome", "zipmap", "auto"]),
            ("triangles", self.triangles.is_some(), &["lightfield"]),
            ("terms", self.terms.is_some(), &["lightfield"]),
            ("factors", self.factors.is_some(), &["lightfield"]),
            ("grid", self.grid.is_some(), &["lightfield"]),
            ("codewords", self.codewords.is_some(), &["lightfield"]),
            ("regions", self.regions.is_some(), &["lightfield"]),
            ("codebook", self.codebook.is_some(), CHOSEN_VQ),
            ("samples", self.samples.is_some(), CHOSEN_VQ),
            ("importance", self.importance.is_some(), CHOSEN_VQ),
            ("weights", matches!(self.weights, Some(Weights::Importance(_))), CHOSEN_VQ),
            ("weights of maps", matches!(self.weights, Some(Weights::Maps(_))), &["dct", "auto"]),
            ("importance-map", self.importance_map.is_some(), CHOSEN_VQ),
            ("mesh", self.mesh.is_some(), &["vq", "auto", "lightfield"]),
        ];
        let codec = self.codec.unwrap_or_default().name();
        match owned.into_iter().find(|(_, given, codecs)| *given && !codecs.contains(&codec)) {
            Some((option, _, codecs)) => Err(UsageError::NotForCodec { option, wanted: codecs[0], codec }),
            None => Ok(()),
        }
    }

    /// The settings for the input at `path`.
    pub(crate) fn resolve(&self, path: &Path) -> Result<Settings, CliError> {
        let codec = self.codec.unwrap_or_default();
        let path = || path.to_owned();
        if codec.is::<Lightfield>() {
            return Err(CliError::NotCapture { path: path() });
        }
        let Some(choice) = codec.choice() else {
            return Err(CliError::NotStack { path: path() });
        };
        let (content, family) = self.content();
        let encode = EncodeSettings {
            codec: self.with_own(choice),
            goal: self.goal(),
            content,
            family,
            mips: self.mips.unwrap_or(false),
            effort: self.effort.unwrap_or_default().effort(),
            access: self.access.map(AccessName::access),
            metric: self.metric.map(MetricName::metric),
            keeps_codec: !self.or_plain.unwrap_or(false),
        };
        Ok(Settings {
            encode,
            color: self.color.unwrap_or_default().color(),
            alpha: self.alpha.map(|AlphaChoice(alpha)| alpha),
            content_from: self.content_from.clone(),
            importance_map: self.importance_map.clone(),
            mesh: self.mesh.clone(),
            is_material: false,
            degrees: None,
            relative: self
                .is_relative()
                .then(|| EpitomeParams::default().with_block(self.block).tolerance_block()),
            remarks: Remarks::default(),
        })
    }

    /// The settings for the material at `path`.
    pub(crate) fn resolve_material(&self, path: &Path) -> Result<Settings, CliError> {
        let given = [
            ("color", self.color.is_some()),
            ("degrees", self.degrees.is_some()),
            ("importance-map", self.importance_map.is_some()),
            ("mesh", self.mesh.is_some()),
            ("content-from", self.content_from.is_some()),
            ("codebook", self.codebook.is_some()),
            ("samples", self.samples.is_some()),
            ("importance", self.importance.is_some()),
            ("weights of importance", matches!(self.weights, Some(Weights::Importance(_)))),
            ("or-plain", self.or_plain == Some(true)),
        ];
        if let Some((option, _)) = given.into_iter().find(|(_, is_given)| *is_given) {
            return Err(UsageError::Excluded { option, other: "--as material" }.into());
        }
        let mut settings = self.resolve(path)?;
        settings.is_material = true;
        if !self.has_goal() {
            settings.encode.goal = MATERIAL_GOAL;
        }
        Ok(settings)
    }

    /// The settings for the input at `path` of such files, whose names tell maps unless `--color` is given.
    pub(crate) fn resolve_files(&self, path: &Path, files: &[PathBuf]) -> Result<Settings, CliError> {
        if matches!(self.weights, Some(Weights::Maps(_))) {
            return Err(UsageError::MapWeights.into());
        }
        let mut settings = self.resolve(path)?;
        if self.color.is_none() {
            names::settle(files, &mut settings);
        }
        let are_normals = settings.color == ColorSpace::Normal;
        settings.degrees = self.degrees.or((are_normals && !self.has_goal()).then_some(USUAL_DEGREES));
        match settings.degrees {
            Some(_) if !are_normals => return Err(CliError::NoNormals { path: path.to_owned() }),
            Some(degrees) => settings.encode.goal = Goal::Psnr(psnr_of(degrees)),
            None => {}
        }
        Ok(settings)
    }

    /// Format of content planes, and the family that the goal chooses from without one.
    fn content(&self) -> (Option<Content>, Family) {
        let family = self.content.map(ContentName::family).unwrap_or_default();
        (self.content.and_then(ContentName::content), family)
    }

    /// The choice with the options that only its codec has.
    fn with_own(&self, choice: Choice) -> Choice {
        if self.layers.is_some() || self.block.is_some() || self.is_relative() {
            let mut own = EpitomeParams::default();
            own.layers = self.layers.unwrap_or(own.layers);
            own.block = self.block;
            own.transforms.quadtree = self.block.is_none();
            if self.is_relative() {
                own.tolerance_kind = ToleranceKind::Relative;
            }
            return choice.with::<Epitome>(own);
        }
        if let Some(Weights::Maps(weights)) = &self.weights {
            return choice.with::<Dct>(DctParams::default().with_weights(weights.clone()));
        }
        let has_importance = self.importance.is_some() || self.weights.is_some();
        if self.codebook.is_some() || self.samples.is_some() || has_importance {
            let mut own = VqParams::default();
            (own.codebook, own.samples) =
                (self.codebook.map(|Sides(width, height)| (width, height)), self.samples());
            own.importance = self.importance.unwrap_or(own.importance);
            if let Some(Weights::Importance(weights)) = self.weights {
                own.weights = weights;
            }
            return choice.with::<Vq>(own);
        }
        choice
    }

    /// The settings for the capture at `path`.
    pub(crate) fn resolve_light(&self, path: &Path) -> Result<LightSettings, CliError> {
        let codec = self.codec.unwrap_or_default();
        if !codec.is_auto() && !codec.is::<Lightfield>() {
            return Err(CliError::OnlyImages { path: path.to_owned(), codec: codec.name() });
        }
        if self.degrees.is_some() {
            return Err(CliError::NoNormals { path: path.to_owned() });
        }
        let others = [("bpp", self.bpp.is_some()), ("tolerance", self.tolerance.is_some())];
        if let Some((option, _)) = others.into_iter().find(|(_, is_given)| *is_given) {
            return Err(CliError::LightGoal { path: path.to_owned(), option });
        }
        let usual = LightParams::default();
        // A goal counts what the file models; terms that only new views would do without serve it too.
        let model = usual.model.with_chosen(self.psnr.is_none());
        let (model, grid) = match self.regions {
            Some(regions) => {
                let fit = FitMethod::Shared { regions };
                (model.with_fit(fit).with_directions(Directions::World), SHARED_GRID)
            }
            None => (model, usual.maps.grid),
        };
        let reduce_log2 = self.codewords.map_or(usual.maps.surface_reduce_log2, |_| SMALL_REDUCE_LOG2);
        let terms = if self.psnr.is_some() { MOST_TERMS_FOR_GOAL } else { usual.terms };
        let codewords = usual.storage.codewords;
        let params = usual
            .with_terms(self.terms.unwrap_or(terms))
            .with_psnr(self.psnr)
            .with_model(self.factors.map_or(model, |factors| model.with_factors(factors.factors())))
            .with_grid(self.grid.unwrap_or(grid))
            .with_surface_reduce_log2(reduce_log2)
            .with_access(self.access.map(AccessName::access).unwrap_or_default())
            .with_content(self.content.and_then(ContentName::content))
            .with_codewords(self.codewords.unwrap_or(codewords));
        let fault = |source: texfold_core::ParamError| CliError::Encode {
            path: path.to_owned(),
            source: source.into(),
        };
        params.check().map_err(fault)?;
        Ok(LightSettings { params, mesh: self.mesh.clone(), triangles: self.triangles })
    }

    /// The settings for the zoom stack at `path`.
    pub(crate) fn resolve_zoom(&self, path: &Path) -> Result<ZoomSettings, CliError> {
        let codec = self.codec.unwrap_or_default();
        if !codec.is_auto() && !codec.is::<Zipmap>() {
            return Err(CliError::StackOnly { path: path.to_owned(), codec: codec.name() });
        }
        if self.degrees.is_some() {
            return Err(CliError::NoNormals { path: path.to_owned() });
        }
        let params = ZipParams::default()
            .with_goal(self.goal())
            .with_access(self.access.map(AccessName::access).unwrap_or_default())
            .with_metric(self.metric.map(MetricName::metric))
            .with_content(self.content.and_then(ContentName::content))
            .with_effort(self.effort.unwrap_or_default().effort());
        let fault = |source: texfold_core::ParamError| CliError::Encode {
            path: path.to_owned(),
            source: source.into(),
        };
        params.check().map_err(fault)?;
        let color = self.color.unwrap_or_default().color();
        Ok(ZoomSettings { params, color, alpha: self.alpha.map(|AlphaChoice(alpha)| alpha) })
    }

    fn is_relative(&self) -> bool {
        self.tolerance_kind == Some(ToleranceKindName::Relative)
    }

    fn goal(&self) -> Goal {
        let bpp = self.bpp.map(Goal::Bpp);
        let tolerance = self.tolerance.map(Goal::Tolerance);
        self.psnr.map(Goal::Psnr).or(bpp).or(tolerance).unwrap_or_default()
    }

    /// Number and side of samples; a side that is not given is the largest with which they take half the codebook.
    pub(super) fn samples(&self) -> Option<(u32, u32)> {
        let Samples(count, side) = self.samples?;
        let Sides(width, height) = self.codebook.unwrap_or(Sides(256, 256));
        let area = SAMPLE_SHARE * f64::from(width) * f64::from(height);
        let usual = (area / f64::from(count.max(1))).sqrt() as u32 / 4 * 4;
        Some((count, side.unwrap_or(usual.clamp(4, width.min(height).max(4)))))
    }
}
