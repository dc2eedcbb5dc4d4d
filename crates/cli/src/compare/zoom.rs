//! Zoom stacks beside one plain texture of all that they show, at the resolution of the finest photograph.

use std::path::Path;

use glam::Vec2;
use texfold::zipmap::{PatchStack, ZipParams, Zipmap};
use texfold::{Content, file_of};
use texfold_core::image::{ImageSet, Raster};
use texfold_core::metric::decode_image;
use texfold_core::{Access, Encoded, Encoder, Goal, Job, Limits, Metric};

use super::measure::{Cost, Measured, external};
use super::rival::Coded;
use crate::config::Options;
use crate::error::CliError;
use crate::input::{Found, stack};
use crate::memory;

/// Name of the codec and of its series.
const CODEC: &str = "zipmap";
const SERIES: &str = "zoom stack";

/// Goals in dB of the photographs.
const GOALS: [f64; 4] = [28.0, 32.0, 36.0, 40.0];
/// The goal whose image is drawn.
const DRAWN_DB: f64 = 32.0;
/// Bits that hold any patch as it is.
const ANY_SIZE: Goal = Goal::Bpp(1e6);

/// A stack, and the plain texture that it stands for.
pub(super) struct Zoom {
    pub(super) plain: ImageSet,
    stack: PatchStack,
    params: ZipParams,
}

/// A stack within a goal.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    pub(super) settings: String,
    pub(super) has_thumbnail: bool,
    params: ZipParams,
}

impl Zoom {
    /// Reads the photographs of a folder and draws what they show; gives what is to be said of them, too.
    pub(super) fn read(
        found: &Found,
        options: &Options,
        limit_bytes: u64,
    ) -> Result<(Zoom, Vec<String>), CliError> {
        let path = &found.path;
        let settings = options.resolve_zoom(path)?;
        let mut job = Job::new(Limits { bytes: limit_bytes, ..Limits::default() });
        let loaded = stack::read(path, &found.files, &settings, limit_bytes, &mut job)?;
        let fault = |source| CliError::Encode { path: path.clone(), source };
        let raw = loaded.params.clone().with_content(Content::Raw).with_access(Access::Texel);
        let raw = raw.with_goal(ANY_SIZE).with_metric(Metric::Psnr).with_drop_rms(0.0);
        let texture = Zipmap::encode(&loaded.stack, &raw, &mut job).map_err(fault)?;
        let size = texture.layout().images[0];
        memory::check(path, size.texels().saturating_mul(super::BYTES_PER_TEXEL), limit_bytes)?;
        let whole =
            decode_image(&texture, 0, 0).ok_or_else(|| CliError::EmptyFolder { path: path.clone() })?;
        let mut said = loaded.left_out;
        said.extend(loaded.remarks.warnings(found.files.len()));
        let zoom = Zoom { plain: ImageSet::single(whole), stack: loaded.stack, params: loaded.params };
        Ok((zoom, said))
    }

    /// The stack at some qualities.
    pub(super) fn candidates(&self) -> impl Iterator<Item = Candidate> + use<> {
        let params = self.params.clone();
        GOALS.into_iter().map(move |db| Candidate {
            settings: format!("{db} dB"),
            has_thumbnail: db == DRAWN_DB,
            params: params.clone().with_goal(Goal::Psnr(db)).with_metric(Metric::Psnr),
        })
    }

    /// The stack drawn at the size of the plain texture.
    pub(super) fn measure(&self, candidate: &Candidate, path: &Path) -> Result<Measured, CliError> {
        let clock = Cost::clock();
        let fault = |source| CliError::Encode { path: path.to_owned(), source };
        let texture = Zipmap::encode(&self.stack, &candidate.params, &mut Job::default()).map_err(fault)?;
        let bytes = file_of(&texture);
        let cost = clock();
        let plain = &self.plain.images()[0];
        let size = plain.size();
        let texels = texture.draw(Vec2::ZERO, Vec2::ONE, (size.width, size.height));
        let decoded = Raster::from_texels(size.width, size.height, plain.info(), &texels)
            .map_err(|source| fault(source.into()))?;
        let coded = Coded { decoded, cost, bits: texture.memory().compressed };
        let made = external(&self.plain, [CODEC, SERIES, &candidate.settings, ""], vec![coded]);
        let per_texel = |bits: u64| bits as f64 / size.texels() as f64;
        let row = super::table::Row {
            bpp_disk: per_texel(8 * bytes.len() as u64),
            bpp_resident: per_texel(texture.memory().resident),
            ..made.row
        };
        Ok(Measured { row, ..made })
    }
}
