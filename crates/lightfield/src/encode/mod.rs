//! The method on one screen: check, choose patch sizes, see what the photographs show, fit the maps of each vertex, put
//! them into atlases.

mod als;
mod assemble;
mod atlases;
mod blocks;
mod coarsen;
mod few_views;
mod level;
mod maps;
mod multiplicative;
mod observe;
mod order;
mod pattern;
mod principal;
mod quality;
mod resample;
mod ring;
mod scene;
mod share;
mod shared;
mod simplify;
mod squares;
mod surface;
mod system;
mod taps;

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;
use texfold_bc::Content;
use texfold_core::{Access, CancelCheck, EncodeError, Encoder, Job, Notes, Params};

use crate::capture::check;
use crate::encoded::LightTexture;
use crate::kinds::{Directions, Factors};
use crate::params::{FitMethod, LightParams, MapStorage, Updates};
use crate::parts::{MAPS_PART, SURFACE_PART, VIEW_PART};
use crate::{Capture, Lightfield};
use assemble::Maps;
use blocks::Store;
use maps::VertexMaps;
pub use quality::LightQuality;
use ring::Ring;
use scene::{Scene, fault};
use share::{Books, Codebooks, Room};
use shared::Shared;
pub use simplify::simplify_mesh;

/// Vertices fitted in parallel before progress is told.
const BATCH: u32 = 64;

impl Encoder for Lightfield {
    type Source<'s> = &'s Capture;
    type Params = LightParams;

    fn encode(
        source: &Capture,
        params: &LightParams,
        job: &mut Job<'_>,
    ) -> Result<LightTexture, EncodeError> {
        encode(source, params, job).map(|(texture, _)| texture)
    }
}

impl Lightfield {
    /// As [`Encoder::encode`], and how close the result comes to the photographs.
    ///
    /// # Errors
    /// As [`Encoder::encode`].
    pub fn encode_measured(
        source: &Capture,
        params: &LightParams,
        job: &mut Job<'_>,
    ) -> Result<(LightTexture, LightQuality), EncodeError> {
        encode(source, params, job)
    }

    /// The first half of an encode, for several ways to store what it finds. What it holds stays booked in the job's budget.
    ///
    /// # Errors
    /// As [`Encoder::encode`].
    pub fn fit(source: &Capture, params: &LightParams, job: &mut Job<'_>) -> Result<FittedMaps, EncodeError> {
        fit(source, params, job)
    }
}

/// Maps that are found and not stored yet: the part of an encode that several ways to store them share.
#[derive(Debug)]
pub struct FittedMaps {
    scene: Scene,
    params: LightParams,
    maps: Maps,
}

fn encode(
    capture: &Capture,
    params: &LightParams,
    job: &mut Job<'_>,
) -> Result<(LightTexture, LightQuality), EncodeError> {
    let fitted = fit(capture, params, job)?;
    let stored = fitted.store(params.storage, job);
    job.budget.release(fitted.bytes());
    stored
}

/// The first half of an encode.
fn fit(capture: &Capture, params: &LightParams, job: &mut Job<'_>) -> Result<FittedMaps, EncodeError> {
    params.check()?;
    check(capture).map_err(fault)?;
    let scene = Scene::new(capture, params, job)?;
    fit_scene(scene, params, job)
}

/// The maps of all vertices of a scene.
fn fit_scene(scene: Scene, params: &LightParams, job: &mut Job<'_>) -> Result<FittedMaps, EncodeError> {
    let shared = match params.model.fit {
        FitMethod::Shared { regions } => Some(shared::fit(&scene, params, regions, job)?),
        FitMethod::Scattered | FitMethod::Resampled => None,
    };
    let cancel = job.cancel_check();
    let fit = |vertex| fit_vertex(&scene, shared.as_ref(), params, vertex, cancel);
    let maps = fit_all(&scene, params, job, 0.2..0.8, fit)?;
    Ok(FittedMaps { scene, params: params.clone(), maps })
}

/// The maps of all vertices by `fit`, a batch after the other; `span` is the share of the job that this is.
fn fit_all(
    scene: &Scene,
    params: &LightParams,
    job: &mut Job<'_>,
    span: Range<f32>,
    fit: impl Fn(u32) -> VertexMaps + Sync,
) -> Result<Maps, EncodeError> {
    let vertices = scene.mesh.positions.len() as u32;
    job.budget.take(Maps::bytes(scene, params))?;
    let mut maps = Maps::new(scene, params);
    for first in (0..vertices).step_by(BATCH as usize) {
        job.stage("maps", span.start + (span.end - span.start) * first as f32 / vertices as f32)?;
        let batch = first..vertices.min(first + BATCH);
        let found: Vec<VertexMaps> = job.install(|| batch.clone().into_par_iter().map(&fit).collect());
        job.checkpoint()?;
        batch.zip(&found).for_each(|(vertex, found)| maps.put(scene, params, vertex, found));
    }
    Ok(maps)
}

/// The maps of one vertex, by the method that the parameters name; of no use once the job is cancelled.
fn fit_vertex(
    scene: &Scene,
    shared: Option<&Shared>,
    params: &LightParams,
    vertex: u32,
    cancel: CancelCheck<'_>,
) -> VertexMaps {
    if let Some(shared) = shared {
        return shared.maps(scene, params, vertex, cancel);
    }
    if params.model.fit == FitMethod::Resampled {
        return resample::fit(scene, vertex, params, cancel);
    }
    let ring = Ring::new(scene, vertex, cancel);
    let terms = if params.model.chosen { als::choose(&ring, params, cancel) } else { params.terms };
    match params.model.updates {
        Updates::Alternating => als::fit(&ring, params, terms, cancel),
        Updates::Multiplicative => multiplicative::fit(&ring, params, terms, cancel),
    }
}

impl FittedMaps {
    /// The second half of an encode: the maps stored as `storage` says.
    ///
    /// # Errors
    /// [`EncodeError`] where its fields are out of range, the atlases do not fit a texture or the job is cancelled.
    pub fn store(
        &self,
        storage: MapStorage,
        job: &mut Job<'_>,
    ) -> Result<(LightTexture, LightQuality), EncodeError> {
        storage.check()?;
        let params = LightParams { storage, ..self.params.clone() };
        let (maps, books) = self.shared_maps(&params, job)?;
        job.stage("atlases", 0.88)?;
        let cancel = job.cancel_check();
        let store = Store { scene: &self.scene, params: &params, maps: &maps, books, cancel };
        let ((texture, quality), remark) = match storage.content {
            None if storage.access == Access::Block => store.choose(job)?,
            content => {
                let texture = job.install(|| store.planes(content.unwrap_or(Content::Raw)))?;
                job.stage("quality", 0.9)?;
                let quality = job.install(|| quality::measure(&self.scene, &texture, cancel));
                job.checkpoint()?;
                ((texture, quality), String::new())
            }
        };
        if let Cow::Owned(_) = maps {
            job.budget.release(Maps::bytes(&self.scene, &params));
        }
        Ok(settle(texture, quality, &remark, &params))
    }

    /// Bytes that are booked in the job's budget while this is held.
    fn bytes(&self) -> u64 {
        self.scene.bytes() + Maps::bytes(&self.scene, &self.params)
    }

    /// The maps, fitted anew to the codewords of view maps where there are any; and what is still to become codewords.
    fn shared_maps(
        &self,
        params: &LightParams,
        job: &mut Job<'_>,
    ) -> Result<(Cow<'_, Maps>, Codebooks), EncodeError> {
        let LightParams { model, storage, .. } = params;
        let room = Room::Share(storage.codewords);
        let kept = match model.fit {
            _ if storage.codewords >= 1.0 => Some(Books::None),
            FitMethod::Shared { .. } => Some(Books::Patches),
            FitMethod::Resampled => Some(Books::All),
            FitMethod::Scattered if model.updates == Updates::Multiplicative => Some(Books::All),
            FitMethod::Scattered => None,
        };
        if let Some(of) = kept {
            return Ok((Cow::Borrowed(&self.maps), Codebooks { of, room }));
        }
        job.stage("codebooks", 0.8)?;
        let cancel = job.cancel_check();
        let (terms, bits) = job.install(|| self.maps.codewords(&self.scene, params, cancel));
        job.checkpoint()?;
        let shared = shared::refit(&self.scene, params, terms, job)?;
        let fit = |vertex| shared.maps(&self.scene, params, vertex, cancel);
        let maps = fit_all(&self.scene, params, job, 0.86..0.88, fit)?;
        Ok((Cow::Owned(maps), Codebooks { of: Books::Patches, room: Room::Bits(bits) }))
    }
}

/// The settings in the words of the command line, with the terms that were kept; then what it has no words for.
fn settings(texture: &LightTexture, params: &LightParams, terms: usize) -> String {
    let stored =
        texture.content().map_or("access block".to_owned(), |content| format!("content {}", content.name()));
    let mut words = format!("--codec lightfield --terms {terms} --{stored}");
    if let Some(psnr) = params.psnr {
        words += &format!(" --psnr {psnr}");
    }
    if let FitMethod::Shared { regions } = params.model.fit {
        words += &format!(" --regions {regions}");
    }
    if params.storage.codewords < 1.0 {
        words += &format!(" --codewords {}", params.storage.codewords);
    }
    let directions = match params.model.directions {
        Directions::View => "view",
        Directions::Reflected => "reflected view",
        Directions::World => "reflected view in space",
    };
    let factors = match params.model.factors {
        Factors::Signed => "factors of any sign",
        Factors::NonNegative => "factors without signs",
    };
    let (grid, sampling) = (params.maps.grid, params.maps.sampling);
    format!("{words} ({factors}, view maps of {grid}x{grid} over the {directions}, sampling {sampling})")
}

/// The parts that hold terms, and the PSNR without them: that of the mean alone.
fn ledger(texture: &LightTexture, quality: &LightQuality, terms: usize) -> Vec<(String, f32)> {
    let parts: &[&str] = match texture.access() {
        _ if terms == 0 => &[],
        Access::Block => &[MAPS_PART],
        Access::Texel => &[SURFACE_PART, VIEW_PART],
    };
    let of_mean = quality.psnr_of_terms.first().copied().unwrap_or(quality.psnr);
    parts.iter().map(|&part| (part.to_owned(), of_mean as f32)).collect()
}

/// As many terms as the goal needs, and what is to be said of them.
fn settle(
    texture: LightTexture,
    quality: LightQuality,
    remark: &str,
    params: &LightParams,
) -> (LightTexture, LightQuality) {
    let reaches = |goal: f64| quality.psnr_of_terms.iter().position(|&psnr| psnr >= goal);
    let most = quality.psnr_of_terms.len() - 1;
    let terms = params.psnr.and_then(reaches).unwrap_or(most);
    let texture = if terms < most { texture.truncated(terms as u32) } else { texture };
    let steps: Vec<String> = quality.psnr_of_terms.iter().map(|psnr| format!("{psnr:.2}")).collect();
    let unseen = quality.samples - quality.samples_seen;
    let verdict = format!(
        "{} samples of the surface in {} observations are reconstructed from a mean and {terms} terms around each of {} vertices; \
         dB of the matrices by terms from 0: {}; of colours {:.2}. Resampled as finely as the \
         photographs resolve it, in 32x32 directions, that would be {} MB. {unseen} samples are seen by no photograph and take after their neighbours.",
        quality.samples,
        quality.observations,
        texture.mesh().positions.len(),
        steps.join(", "),
        quality.psnr_of_colours,
        quality.resampled_bytes / 1_000_000,
    );
    let verdict = [verdict.as_str(), remark].join(" ").trim_end().to_owned();
    let settings = settings(&texture, params, terms);
    let psnr_without = ledger(&texture, &quality, terms);
    (texture.with_notes(Notes { settings, verdict, psnr_without, ..Notes::default() }), quality)
}
