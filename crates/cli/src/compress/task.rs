//! One input from file to file.

use std::path::{Path, PathBuf};
use std::time::Instant;

use texfold::encoding::Chosen;
use texfold_capture::read_uv_mesh;
use texfold_core::Stage;
use texfold_core::container::SourceNotes;
use texfold_core::mesh::UvMesh;

use super::cache::{Cache, add_file, program};
use super::encode;
use crate::error::{CliError, guarded};
use crate::input::{Found, frames, pixels, size_of};
use crate::memory;
use crate::normals;
use crate::output::write_whole;
use crate::progress::Progress;
use crate::report::{Circumstances, Row};
use crate::settings::Kind;
use crate::settings::Settings;

/// What is to be made of one input.
#[derive(Debug)]
pub(crate) struct Task {
    pub(crate) found: Found,
    pub(crate) settings: Settings,
    pub(crate) output: PathBuf,
}

/// What all tasks of a run share.
#[derive(Debug)]
pub(crate) struct Workplace<'w> {
    pub(crate) cache: &'w Cache,
    pub(crate) limit_bytes: u64,
    pub(crate) force: bool,
    /// True if the lists of folders may name files outside of these.
    pub(crate) outside: bool,
    pub(crate) progress: &'w Progress,
}

/// A task that is done.
#[derive(Debug)]
pub(crate) struct Finished {
    pub(crate) row: Row,
    /// It was up to date already.
    pub(crate) skipped: bool,
}

impl Task {
    /// About how many bytes the task needs at its peak; 0 where its headers cannot be read, which its work will say.
    pub(crate) fn cost_bytes(&self) -> u64 {
        guarded(&self.found.path, || self.texels()).unwrap_or(0).saturating_mul(self.bytes_per_texel())
    }

    fn bytes_per_texel(&self) -> u64 {
        self.settings.encode.bytes_per_texel()
    }

    fn texels(&self) -> Result<u64, CliError> {
        let all_frames = self.found.takes_all_frames();
        let is_only = self.found.files.len() == 1;
        let frames = |file: &Path| match all_frames {
            true => frames::count(file) as u64,
            false if is_only => pixels::band_images(file).into(),
            false => 1,
        };
        let texels = |file: &PathBuf| size_of(file).map(|size| size.texels().saturating_mul(frames(file)));
        self.found.files.iter().map(texels).sum()
    }

    /// Does the work. A panic in a decoder or encoder becomes an error of this input.
    pub(crate) fn run(&self, place: &Workplace<'_>) -> Result<Finished, CliError> {
        guarded(&self.found.path, || self.check_and_encode(place))
    }

    fn check_and_encode(&self, place: &Workplace<'_>) -> Result<Finished, CliError> {
        let mesh = self.settings.mesh.as_deref().map(read_uv_mesh).transpose()?;
        let key = self.key(mesh.as_ref())?;
        if let Some(row) = place.cache.up_to_date(&self.output, &key).filter(|_| !place.force) {
            return Ok(Finished { row: self.renamed(row), skipped: true });
        }
        self.check_memory(place.limit_bytes)?;
        let (bytes, row) = self.encode(place, mesh.as_ref())?;
        write_whole(&self.output, &bytes)?;
        place.cache.record(&self.output, &key, &bytes, &row);
        Ok(Finished { row, skipped: false })
    }

    fn encode(&self, place: &Workplace<'_>, mesh: Option<&UvMesh>) -> Result<(Vec<u8>, Row), CliError> {
        let path = &self.found.path;
        let share = place.progress.share(self.found.stem.to_string_lossy().into_owned());
        let Found { files, .. } = &self.found;
        let loaded = encode::load(files, self.found.takes_all_frames(), &self.settings, place.limit_bytes)?;
        if self.found.kind == Kind::Sequence {
            check_frames(&self.found, &loaded.images)?;
        }
        let mut warnings: Vec<String> = loaded.warning.map(str::to_owned).into_iter().collect();
        let (notes, left_out) = (loaded.remarks.notes(files.len()), loaded.remarks.warnings(files.len()));
        let on_source = [notes.clone(), left_out.clone()].concat();
        warnings.extend(left_out);
        let start = Instant::now();
        let goal = self.settings.encode.goal;
        let degrees = self.settings.degrees.filter(|_| loaded.images.info().channels > 2);
        if degrees.is_none() && self.settings.degrees.is_some() {
            warnings.push("angles need three channels: the goal is a PSNR instead".to_owned());
        }
        let rounds = if degrees.is_some() { normals::ROUNDS } else { 1 };
        let mut round = 0;
        let mut encode = |goal| {
            let mut settings = self.settings.clone();
            settings.encode.goal = goal;
            let done = |done: f32| (round as f32 + done) / rounds as f32;
            let chosen = encode::encode(&loaded, &settings, mesh, place.limit_bytes, &mut |stage| {
                share.report(Stage { done: done(stage.done), ..stage });
            });
            round += 1;
            chosen
        };
        let chosen = match degrees {
            Some(degrees) => normals::search(&loaded.images, degrees, encode),
            None => encode(goal),
        };
        let Chosen { mut image, attempts } = chosen.map_err(|fault| fault.of(path))?;
        if let Some(noted) = image.notes_mut() {
            let source = SourceNotes { remarks: on_source, georeference: loaded.georeference };
            noted.source = (source != SourceNotes::default()).then(|| Box::new(source));
        }
        let bytes = image.to_bytes();
        let encode_seconds = start.elapsed().as_secs_f64();
        drop(image);
        let how = Circumstances {
            input: path,
            output: &self.output,
            encode_seconds,
            goal,
            degrees,
            relative: self.settings.relative,
            attempts,
            notes,
            warnings,
        };
        let row = Row::of(&loaded.images, &bytes, how)
            .map_err(|source| CliError::Load { path: self.output.clone(), source })?;
        Ok((bytes, row))
    }

    /// A stored row under the names of this run.
    fn renamed(&self, row: Row) -> Row {
        Row { input: self.found.path.display().to_string(), output: self.output.display().to_string(), ..row }
    }

    /// An input that may not fit is refused before it is read.
    fn check_memory(&self, limit_bytes: u64) -> Result<(), CliError> {
        let needed = self.texels()?.saturating_mul(self.bytes_per_texel());
        memory::check(&self.found.path, needed, limit_bytes.max(memory::ALWAYS_ALLOWED))
    }

    /// Hash of all that the output depends on.
    fn key(&self, mesh: Option<&UvMesh>) -> Result<String, CliError> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(program().as_bytes());
        hasher.update(format!("{:?} {:?}", self.found.kind, self.settings).as_bytes());
        let maps = [&self.settings.importance_map, &self.settings.content_from];
        for file in self.found.files.iter().chain(maps.into_iter().flatten()) {
            add_file(&mut hasher, file).map_err(|source| CliError::Read { path: file.clone(), source })?;
        }
        if let Some(mesh) = mesh {
            mesh.positions
                .iter()
                .flat_map(|p| p.to_array())
                .for_each(|x| _ = hasher.update(&x.to_le_bytes()));
            mesh.uvs.iter().flat_map(|uv| uv.to_array()).for_each(|x| _ = hasher.update(&x.to_le_bytes()));
            mesh.triangles.iter().flatten().for_each(|x| _ = hasher.update(&x.to_le_bytes()));
        }
        Ok(hasher.finalize().to_hex().to_string())
    }
}

/// Frames of a sequence have one size.
fn check_frames(found: &Found, images: &texfold_core::image::ImageSet) -> Result<(), CliError> {
    let first = images.images()[0].size();
    match images.images().iter().position(|image| image.size() != first) {
        Some(index) => {
            let path = found.files.get(index).unwrap_or(&found.path).clone();
            Err(CliError::FrameSize { path, index })
        }
        None => Ok(()),
    }
}
