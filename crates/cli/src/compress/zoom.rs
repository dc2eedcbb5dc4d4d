//! One zoom stack from folder to file.

use std::path::{Path, PathBuf};
use std::time::Instant;

use texfold::{
    file_of,
    zipmap::{PatchStack, ZipTexture, Zipmap, fidelity},
};
use texfold_core::metric::{SquaredError, compare, decode_image, ssim};
use texfold_core::target::Measured;
use texfold_core::{Encoded, Job, Limits, LoadError};

use super::folder::{Folder, FolderTask, Made};
use crate::error::CliError;
use crate::input::stack;
use crate::perceptual::ssimulacra2;
use crate::progress::Share;
use crate::report::{Row, Sizes, missed, part_rows, peak_bytes};
use crate::settings::ZoomSettings;

impl Folder for ZoomSettings {
    // Rasters of the folder and of the stack, what is laid, and what is solved for one.
    const BYTES_PER_PIXEL: u64 = 150;

    fn other_files(&self, dir: &Path) -> Result<Vec<PathBuf>, CliError> {
        Ok(stack::list_files(dir))
    }

    fn folders(&self, dir: &Path) -> Vec<PathBuf> {
        stack::folders(dir)
    }

    fn encode(&self, task: &FolderTask<Self>, limit_bytes: u64, share: &Share<'_>) -> Result<Made, CliError> {
        let path = &task.found.path;
        let start = Instant::now();
        let limits = Limits { bytes: limit_bytes, ..Limits::default() };
        let mut progress = |stage| share.report(stage);
        let mut job = Job::new(limits).with_progress(&mut progress);
        let loaded = stack::read(path, &task.found.files, self, limit_bytes, &mut job)?;
        let (texture, measured) = job
            .within(0.5, 1.0, |job| Zipmap::encode_measured(&loaded.stack, &loaded.params, job))
            .map_err(|source| CliError::Encode { path: path.clone(), source })?;
        let bytes = file_of(&texture);
        let seconds = start.elapsed().as_secs_f64();
        let row = task
            .row(&loaded, measured, &bytes, seconds)
            .map_err(|source| CliError::Load { path: task.output.clone(), source })?;
        let list = loaded.list.map(|list| (task.output.with_extension(stack::LIST_NAME), list.into_bytes()));
        Ok(Made { bytes, row, beside: list })
    }
}

impl FolderTask<ZoomSettings> {
    /// The row of the report, of `bytes`, loaded again. Errors are against the photographs after their exposure was
    /// fitted; similarity, SSIMULACRA2 and the worst block are those of the root's image at its own size.
    fn row(
        &self,
        loaded: &stack::Loaded,
        measured: Measured,
        bytes: &[u8],
        seconds: f64,
    ) -> Result<Row, LoadError> {
        let PatchStack { root, images, .. } = &loaded.stack;
        let image = texfold::open(bytes)?.into_image()?;
        let found = image.codec().number;
        let texture: ZipTexture = image.downcast().ok_or(LoadError::NotThisCodec { found })?;
        let error = fidelity(&loaded.stack, &texture)
            .iter()
            .fold(SquaredError::default(), |sum, fidelity| sum + fidelity.error);
        let texels: u64 = images.iter().chain([root]).map(|image| image.size().texels()).sum();
        let missed = missed(loaded.params.goal, &measured);
        let drawn = decode_image(&texture, 0, texture.deep_levels());
        let (similar, worst) = drawn
            .as_ref()
            .map_or((0.0, 0.0), |drawn| (ssim(root, drawn), compare(root, drawn).worst_block_rms));
        Ok(Row {
            input: self.found.path.display().to_string(),
            output: self.output.display().to_string(),
            codec: texture.codec().name.to_owned(),
            settings: texture.notes().settings.clone(),
            width: root.size().width,
            height: root.size().height,
            images: self.found.files.len(),
            source_texels: texels,
            sizes: Sizes::of(texture.memory(), bytes, texels),
            psnr: error.psnr(),
            psnr_alpha: None,
            rms: error.rms(),
            worst_block_rms: worst,
            psnr_worst_tile: None,
            worst_relative_error: None,
            ssim: similar,
            ssimulacra2: drawn.and_then(|drawn| ssimulacra2(root, &drawn)),
            degrees: None,
            maps: Vec::new(),
            views: None,
            psnr_merged: Some(measured.psnr),
            access: texture.access().name().to_owned(),
            goal_met: Some(missed.is_none()),
            encode_seconds: seconds,
            encode_texels_per_second: texels as f64 / seconds.max(1e-9),
            peak_bytes: peak_bytes(),
            parts: part_rows(&texture.footprint()),
            verdict: texture.notes().verdict.clone(),
            tried: Vec::new(),
            notes: loaded.remarks.notes(self.found.files.len()),
            warnings: self.warnings(&texture, loaded).into_iter().chain(missed).collect(),
        })
    }

    fn warnings(&self, texture: &ZipTexture, loaded: &stack::Loaded) -> Vec<String> {
        let mut warnings = loaded.left_out.clone();
        warnings.extend(loaded.remarks.warnings(self.found.files.len()));
        if texture.patches() == 0 {
            warnings.push("only the root is left: it reaches the goal for every photograph; a higher goal keeps more patches".to_owned());
        }
        warnings
    }
}
