//! One capture from folder to file.

use std::time::Instant;

use texfold::{Capture, LightQuality, LightTexture, Lightfield, Renderer};
use texfold_core::container::SectionWriter;
use texfold_core::image::{ColorSpace, Raster};
use texfold_core::metric::ssim;
use texfold_core::{Budget, Encoded, Goal, Job, Limits, LoadError};

use super::cache::{Cache, add_file, program};
use super::task::{Finished, Workplace, pixels_of, unless_up_to_date};
use crate::config::LightSettings;
use crate::error::CliError;
use crate::input::{Found, capture};
use crate::output::write_whole;
use crate::report::{Row, missed, part_rows, peak_bytes};

/// Bytes for each pixel of the photographs: the pixels, what is seen of the samples, and the raster of those being read.
const BYTES_PER_PIXEL: u64 = 40;
/// Photographs that are drawn again to measure their similarity.
const SIMILAR_VIEWS: usize = 4;

/// What is to be made of one capture.
#[derive(Debug)]
pub(crate) struct LightTask {
    pub(crate) found: Found,
    pub(crate) settings: LightSettings,
    pub(crate) output: std::path::PathBuf,
}

impl LightTask {
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
        let LightSettings { params, mesh, triangles } = &self.settings;
        let share = place.progress.share(self.found.stem.to_string_lossy().into_owned());
        let start = Instant::now();
        let source = capture::read(path, mesh.as_deref(), *triangles, place.limit_bytes)?;
        let limits = Limits { bytes: place.limit_bytes, ..Limits::default() };
        let mut progress = |stage| share.report(stage);
        let mut job = Job::new(limits).with_progress(&mut progress);
        let encode = match triangles {
            Some(_) => Lightfield::encode_measured,
            None => Lightfield::encode_simplified,
        };
        let (texture, quality) = encode(&source, params, &mut job)
            .map_err(|source| CliError::Encode { path: path.clone(), source })?;
        let mut writer = SectionWriter::new(texture.codec());
        texture.store(&mut writer);
        let bytes = writer.finish().bytes;
        let seconds = start.elapsed().as_secs_f64();
        drop(texture);
        let row = self
            .row(&source, &quality, &bytes, seconds)
            .map_err(|source| CliError::Load { path: self.output.clone(), source })?;
        write_whole(&self.output, &bytes)?;
        cache.record(&self.output, key, &bytes, &row);
        Ok(Finished { row, skipped: false })
    }

    /// The row of the report; sizes and similarity are of `bytes`, loaded again.
    fn row(
        &self,
        source: &Capture,
        quality: &LightQuality,
        bytes: &[u8],
        seconds: f64,
    ) -> Result<Row, LoadError> {
        let texture = texfold::open_light(bytes, &mut Budget::default())?;
        let shown = source.views.iter().flat_map(|view| &view.pixels).filter(|pixel| pixel[3] > 127).count();
        let texels = shown.max(1) as f64;
        let terms = texture.layout().terms as usize;
        let psnr = quality.psnr_of_terms.get(terms).copied().unwrap_or(quality.psnr);
        let bits_memory = texture.gpu().bits_memory();
        let bits_disk = 8 * bytes.len() as u64;
        let goal = self.settings.params.psnr.map(Goal::Psnr);
        let camera = source.views[0].camera;
        Ok(Row {
            input: self.found.path.display().to_string(),
            output: self.output.display().to_string(),
            codec: texture.codec().name.to_owned(),
            settings: texture.notes().settings.clone(),
            width: camera.width,
            height: camera.height,
            images: source.views.len(),
            source_texels: shown as u64,
            bits_memory,
            bits_disk,
            bpp_memory: bits_memory as f64 / texels,
            bpp_disk: bits_disk as f64 / texels,
            psnr,
            psnr_alpha: None,
            rms: 255.0 * 10f64.powf(-psnr / 20.0),
            worst_block_rms: quality.worst_patch_rms,
            ssim: similarity(source, &texture),
            encode_seconds: seconds,
            encode_texels_per_second: texels / seconds.max(1e-9),
            peak_bytes: peak_bytes(),
            parts: part_rows(&texture.footprint()),
            verdict: texture.notes().verdict.clone(),
            warnings: goal.and_then(|goal| missed(goal, psnr)).into_iter().collect(),
        })
    }

    /// Hash of all that the output depends on.
    fn key(&self) -> Result<String, CliError> {
        let dir = &self.found.path;
        let mut hasher = blake3::Hasher::new();
        hasher.update(program().as_bytes());
        hasher.update(format!("{:?}", self.settings).as_bytes());
        let mesh = capture::mesh_file(dir, self.settings.mesh.as_deref())?;
        for file in [dir.join(capture::CAMERAS_NAME), mesh].iter().chain(&self.found.files) {
            add_file(&mut hasher, file).map_err(|source| CliError::Read { path: file.clone(), source })?;
        }
        Ok(hasher.finalize().to_hex().to_string())
    }
}

/// Mean structural similarity of some photographs, spread over the capture, with the same views drawn again; what the mask
/// leaves out is black in both.
fn similarity(source: &Capture, texture: &LightTexture) -> f64 {
    let renderer = Renderer::new(texture);
    let step = source.views.len().div_ceil(SIMILAR_VIEWS).max(1);
    let mut sum = (0.0, 0);
    for view in source.views.iter().step_by(step) {
        let masked = |pixels: &[[u8; 4]]| -> Vec<u8> {
            let keep = |(pixel, mask): (&[u8; 4], &[u8; 4])| {
                if mask[3] > 127 { [pixel[0], pixel[1], pixel[2]] } else { [0; 3] }
            };
            pixels.iter().zip(&view.pixels).flat_map(keep).collect()
        };
        let drawn = renderer.render(&view.camera);
        let raster = |pixels: &[[u8; 4]]| {
            let (width, height) = (view.camera.width, view.camera.height);
            Raster::from_u8(width, height, 3, ColorSpace::Srgb, &masked(pixels))
        };
        if let (Ok(wanted), Ok(found)) = (raster(&view.pixels), raster(&drawn)) {
            sum = (sum.0 + ssim(&wanted, &found), sum.1 + 1);
        }
    }
    sum.0 / f64::from(sum.1.max(1))
}
