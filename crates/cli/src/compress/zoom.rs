//! One zoom stack from folder to file.

use std::time::Instant;

use texfold::{AnyImage, Encoder, PatchStack, ZipParams, ZipTexture, Zipmap, fidelity};
use texfold_core::metric::{SquaredError, decode_surface, ssim, worst_block_rms};
use texfold_core::{Budget, Encoded, Job, Limits, LoadError};

use super::cache::{Cache, add_file, program};
use super::task::{Finished, Workplace, pixels_of, unless_up_to_date};
use crate::config::ZoomSettings;
use crate::error::CliError;
use crate::input::{Found, stack};
use crate::output::write_whole;
use crate::report::{Row, part_rows, peak_bytes};

/// Bytes for each pixel of the photographs: rasters of the folder and of the stack, what is laid, and what is solved for one.
const BYTES_PER_PIXEL: u64 = 150;

/// What is to be made of one zoom stack.
#[derive(Debug)]
pub(crate) struct ZoomTask {
    pub(crate) found: Found,
    pub(crate) settings: ZoomSettings,
    pub(crate) output: std::path::PathBuf,
}

impl ZoomTask {
    /// About how many bytes the task needs at its peak.
    pub(crate) fn cost_bytes(&self) -> u64 {
        pixels_of(&self.found).saturating_mul(BYTES_PER_PIXEL)
    }

    /// Does the work. A panic within becomes an error of this input.
    pub(crate) fn run(&self, place: &Workplace<'_>) -> Result<Finished, CliError> {
        let encode = |key: &str| self.encode(place, place.cache, key);
        unless_up_to_date((&self.found, &self.output), place, || self.key(), encode)
    }

    fn encode(&self, place: &Workplace<'_>, cache: &Cache, key: &str) -> Result<Finished, CliError> {
        let path = &self.found.path;
        let share = place.progress.share(self.found.stem.to_string_lossy().into_owned());
        let start = Instant::now();
        let limits = Limits { bytes: place.limit_bytes, ..Limits::default() };
        let mut progress = |stage| share.report(stage);
        let mut job = Job::new(limits).with_progress(&mut progress);
        let loaded = stack::read(path, &self.found.files, &self.settings, place.limit_bytes, &mut job)?;
        let params = ZipParams { merge: !loaded.rides, ..self.settings.params.clone() };
        let texture = job
            .within(0.5, 1.0, |job| Zipmap::encode(&loaded.stack, &params, job))
            .map_err(|source| CliError::Encode { path: path.clone(), source })?;
        let bytes = AnyImage::Zipmap(texture).to_bytes();
        let seconds = start.elapsed().as_secs_f64();
        let row = self
            .row(&loaded, &bytes, seconds)
            .map_err(|source| CliError::Load { path: self.output.clone(), source })?;
        if let Some(list) = &loaded.list {
            write_whole(&self.output.with_extension(stack::LIST_NAME), list.as_bytes())?;
        }
        write_whole(&self.output, &bytes)?;
        cache.record(&self.output, key, &bytes, &row);
        Ok(Finished { row, skipped: false })
    }

    /// The row of the report, of `bytes`, loaded again. Errors are against the photographs after their exposure was fitted;
    /// similarity and the worst block are those of the root's picture at its own size.
    fn row(&self, loaded: &stack::Loaded, bytes: &[u8], seconds: f64) -> Result<Row, LoadError> {
        let PatchStack { root, images, .. } = &loaded.stack;
        let texture = match texfold::open_image(bytes, &mut Budget::default())? {
            AnyImage::Zipmap(texture) => texture,
            other => return Err(LoadError::NotThisCodec { found: other.as_encoded().codec().number }),
        };
        let error = fidelity(&loaded.stack, &texture)
            .iter()
            .fold(SquaredError::default(), |sum, fidelity| sum + fidelity.error);
        let texels: u64 = images.iter().chain([root]).map(|image| image.size().texels()).sum();
        let drawn = decode_surface(&texture, 0, texture.deep_levels());
        let (similar, worst) =
            drawn.map_or((0.0, 0.0), |drawn| (ssim(root, &drawn), worst_block_rms(root, &drawn)));
        let (bits_memory, bits_disk) = (texture.gpu().bits_memory(), 8 * bytes.len() as u64);
        Ok(Row {
            input: self.found.path.display().to_string(),
            output: self.output.display().to_string(),
            codec: texture.codec().name.to_owned(),
            settings: texture.notes().settings.clone(),
            width: root.size().width,
            height: root.size().height,
            images: self.found.files.len(),
            source_texels: texels,
            bits_memory,
            bits_disk,
            bpp_memory: bits_memory as f64 / texels as f64,
            bpp_disk: bits_disk as f64 / texels as f64,
            psnr: error.psnr(),
            psnr_alpha: None,
            rms: error.rms(),
            worst_block_rms: worst,
            ssim: similar,
            encode_seconds: seconds,
            encode_texels_per_second: texels as f64 / seconds.max(1e-9),
            peak_bytes: peak_bytes(),
            parts: part_rows(&texture.footprint()),
            verdict: texture.notes().verdict.clone(),
            warnings: self.warnings(&texture, loaded),
        })
    }

    fn warnings(&self, texture: &ZipTexture, loaded: &stack::Loaded) -> Vec<String> {
        let mut warnings = loaded.left_out.clone();
        if texture.patches() == 0 {
            warnings.push("nothing but the root is left: it shows every photograph as the goal asks, and a higher goal keeps more".to_owned());
        }
        warnings
    }

    /// Hash of all that the output depends on.
    fn key(&self) -> Result<String, CliError> {
        let dir = &self.found.path;
        let mut hasher = blake3::Hasher::new();
        hasher.update(program().as_bytes());
        hasher.update(format!("{:?}", self.settings).as_bytes());
        for file in stack::list_files(dir).iter().chain(&self.found.files) {
            add_file(&mut hasher, file).map_err(|source| CliError::Read { path: file.clone(), source })?;
        }
        Ok(hasher.finalize().to_hex().to_string())
    }
}
