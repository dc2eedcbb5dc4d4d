//! One capture from folder to file.

use std::path::{Path, PathBuf};
use std::time::Instant;

use texfold::{
    core::{Camera, Capture, Photograph},
    file_of,
    lightfield::{LightQuality, LightTexture, Lightfield, Renderer},
};
use texfold_core::image::{ColorSpace, Raster};
use texfold_core::metric::{SquaredError, color_error, ssim};
use texfold_core::{Encoded, Goal, Job, Limits, LoadError};

use super::folder::{Folder, FolderTask, Made};
use crate::error::{CliError, explain};
use crate::input::capture;
use crate::perceptual::{mean, ssimulacra2};
use crate::progress::Share;
use crate::report::{Row, Sizes, Views, light_missed, part_rows, peak_bytes};
use crate::settings::LightSettings;

/// Photographs that are drawn again to measure their similarity.
const SIMILAR_VIEWS: usize = 4;

impl Folder for LightSettings {
    // The pixels, what is seen of the samples, and the raster of those being read.
    const BYTES_PER_PIXEL: u64 = 40;

    fn other_files(&self, dir: &Path) -> Result<Vec<PathBuf>, CliError> {
        let mut files = capture::camera_files(dir);
        files.extend(capture::test_cameras(dir));
        files.push(capture::mesh_file(dir, self.mesh.as_deref())?);
        Ok(files)
    }

    fn encode(&self, task: &FolderTask<Self>, limit_bytes: u64, share: &Share<'_>) -> Result<Made, CliError> {
        let path = &task.found.path;
        let LightSettings { params, mesh, triangles } = self;
        let start = Instant::now();
        let source = capture::read(path, mesh.as_deref(), *triangles, limit_bytes)?;
        let limits = Limits { bytes: limit_bytes, ..Limits::default() };
        let mut progress = |stage| share.report(stage);
        let mut job = Job::new(limits).with_progress(&mut progress);
        let encode = match triangles {
            Some(_) => Lightfield::encode_measured,
            None => Lightfield::encode_simplified,
        };
        let (texture, quality) = encode(&source, params, &mut job)
            .map_err(|source| CliError::Encode { path: path.clone(), source })?;
        let bytes = file_of(&texture);
        let seconds = start.elapsed().as_secs_f64();
        drop(texture);
        let row = task
            .row(&source, &quality, &bytes, seconds)
            .map_err(|source| CliError::Load { path: task.output.clone(), source })?;
        Ok(Made { bytes, row, beside: None })
    }
}

impl FolderTask<LightSettings> {
    /// The row of the report; sizes and similarity are of `bytes`, loaded again.
    fn row(
        &self,
        source: &Capture,
        quality: &LightQuality,
        bytes: &[u8],
        seconds: f64,
    ) -> Result<Row, LoadError> {
        let texture = texfold::open(bytes)?.into_light()?;
        let inside = source.views.iter().flat_map(|view| &view.pixels).filter(|pixel| pixel[3] > 127).count();
        let texels = inside.max(1) as f64;
        let terms = texture.layout().terms as usize;
        let psnr = quality.psnr_of_terms.get(terms).copied().unwrap_or(quality.psnr);
        let goal = self.settings.params.psnr.map(Goal::Psnr);
        let camera = source.views[0].camera;
        let renderer = Renderer::new(&texture);
        let Similarity { ssim, ssimulacra2, views } =
            similarity(&source.views, SIMILAR_VIEWS, |camera| renderer.render(camera));
        let (new, warning) = self.new_views(&texture);
        let missed = goal.and_then(|goal| light_missed(goal, psnr));
        Ok(Row {
            input: self.found.path.display().to_string(),
            output: self.output.display().to_string(),
            codec: texture.codec().name.to_owned(),
            settings: texture.notes().settings.clone(),
            width: camera.width,
            height: camera.height,
            images: source.views.len(),
            source_texels: inside as u64,
            sizes: Sizes::of(texture.memory(), bytes, inside as u64),
            psnr,
            psnr_alpha: None,
            rms: 255.0 * 10f64.powf(-psnr / 20.0),
            worst_block_rms: quality.worst_patch_rms,
            psnr_worst_tile: None,
            worst_relative_error: None,
            ssim,
            ssimulacra2,
            degrees: None,
            maps: Vec::new(),
            views: Some(new.unwrap_or(views)),
            psnr_merged: None,
            access: texture.gpu().access().name().to_owned(),
            goal_met: goal.map(|_| missed.is_none()),
            encode_seconds: seconds,
            encode_texels_per_second: texels / seconds.max(1e-9),
            peak_bytes: peak_bytes(),
            parts: part_rows(&texture.footprint()),
            verdict: texture.notes().verdict.clone(),
            tried: Vec::new(),
            notes: Vec::new(),
            warnings: missed.into_iter().chain(warning).collect(),
        })
    }

    /// Some photographs that the capture keeps for tests, drawn by the light field; a warning where they cannot be read.
    fn new_views(&self, texture: &LightTexture) -> (Option<Views>, Option<String>) {
        let Some(cameras) = capture::test_cameras(&self.found.path) else { return (None, None) };
        match capture::read_views(&cameras, Some(SIMILAR_VIEWS)) {
            Ok(photographs) => {
                let renderer = Renderer::new(texture);
                let views = similarity(&photographs, SIMILAR_VIEWS, |camera| renderer.render(camera)).views;
                (Some(Views { are_new: true, ..views }), None)
            }
            Err(error) => (None, Some(format!("its views for tests are not compared: {}", explain(&error)))),
        }
    }
}

/// Photographs beside the same views drawn again; what the mask leaves out is black in both.
pub(crate) struct Similarity {
    /// Mean structural similarity.
    pub(crate) ssim: f64,
    /// Mean SSIMULACRA2, where it is defined.
    pub(crate) ssimulacra2: Option<f64>,
    pub(crate) views: Views,
}

/// RGB where a photograph shows the object, black around it.
pub(crate) fn masked(pixels: &[[u8; 4]], view: &Photograph) -> Vec<u8> {
    let keep = |(pixel, mask): (&[u8; 4], &[u8; 4])| {
        if mask[3] > 127 { [pixel[0], pixel[1], pixel[2]] } else { [0; 3] }
    };
    pixels.iter().zip(&view.pixels).flat_map(keep).collect()
}

/// Compares at most so many photographs, spread over all, with what `draw` gives for their cameras.
pub(crate) fn similarity(
    photographs: &[Photograph],
    count: usize,
    draw: impl Fn(&Camera) -> Vec<[u8; 4]>,
) -> Similarity {
    let step = photographs.len().div_ceil(count).max(1);
    let (mut sum, mut perceived, mut error) = ((0.0, 0), Vec::new(), SquaredError::default());
    for view in photographs.iter().step_by(step) {
        let raster = |pixels: &[[u8; 4]]| {
            let (width, height) = (view.camera.width, view.camera.height);
            Raster::from_u8(width, height, 3, ColorSpace::Srgb, &masked(pixels, view))
        };
        if let (Ok(wanted), Ok(found)) = (raster(&view.pixels), raster(&draw(&view.camera))) {
            sum = (sum.0 + ssim(&wanted, &found), sum.1 + 1);
            perceived.push((ssimulacra2(&wanted, &found), 1.0));
            let inside = view.pixels.iter().filter(|pixel| pixel[3] > 127).count() as u64;
            error = error + SquaredError { count: 3 * inside, ..color_error(&wanted, &found) };
        }
    }
    Similarity {
        ssim: sum.0 / f64::from(sum.1.max(1)),
        ssimulacra2: mean(perceived.into_iter()),
        views: Views { psnr: error.psnr(), count: sum.1 as usize, are_new: false },
    }
}
