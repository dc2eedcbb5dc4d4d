//! The method on one screen: check, choose patch sizes, see what the photographs show, fit the maps of each vertex, put
//! them into atlases.

mod als;
mod assemble;
mod observe;
mod quality;
mod resample;
mod ring;
mod surface;

use glam::Vec3;
use rayon::prelude::*;
use texfold_core::{EncodeError, Job, Notes, Params, TextureCodec};

use crate::bvh::Bvh;
use crate::decode::{TEXFOLD_LIGHTFIELD_REFLECTED, TEXFOLD_LIGHTFIELD_VIEW};
use crate::encoded::LightTexture;
use crate::layout::Layout;
use crate::params::{Directions, Factors, Fit, LightParams};
use crate::{Capture, CaptureError, Lightfield, Mesh};
use assemble::Atlases;
use observe::Seen;
pub use quality::Quality;
use ring::Ring;
use surface::Surface;

/// Vertices fitted at a time: between them progress is told and a job may be cancelled.
const BATCH: u32 = 64;

/// One term around a vertex.
#[derive(Debug, Clone)]
pub(crate) struct Term {
    /// For each row the surface map, the hat function included.
    pub(crate) surface: Vec<Vec3>,
    /// The view map, row by row.
    pub(crate) view: Vec<Vec3>,
}

/// All maps of a vertex.
#[derive(Debug, Clone)]
pub(crate) struct VertexMaps {
    /// Samples, ascending.
    pub(crate) rows: Vec<u32>,
    /// Their mean, the hat function included.
    pub(crate) mean: Vec<Vec3>,
    pub(crate) terms: Vec<Term>,
}

/// All that the fits read.
#[derive(Debug)]
pub(crate) struct Scene<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) surface: &'a Surface,
    pub(crate) seen: &'a [Seen],
    pub(crate) normals: Vec<Vec3>,
    pub(crate) eyes: Vec<Vec3>,
    /// Whether photographs that show part of an element count.
    pub(crate) partial: bool,
    /// The shader's number of the kind of directions.
    pub(crate) directions: u32,
}

fn fault(error: CaptureError) -> EncodeError {
    EncodeError::Codec { codec: Lightfield::ID, source: Box::new(error) }
}

pub(crate) fn encode(
    capture: &Capture,
    params: &LightParams,
    job: &mut Job<'_>,
) -> Result<(LightTexture, Quality), EncodeError> {
    params.check()?;
    capture.check().map_err(fault)?;
    let mesh = capture.mesh.welded();
    if mesh.triangles.is_empty() {
        return Err(fault(CaptureError::NoTriangles));
    }
    job.stage("visibility", 0.0)?;
    let corners: Vec<_> = mesh.triangles.iter().map(|&triangle| mesh.corners(triangle)).collect();
    let bvh = Bvh::new(&corners);
    let sides = job.install(|| surface::sides_log2(&mesh, &capture.views, &bvh, params.sampling));
    let vertices = mesh.positions.len() as u32;
    let layout =
        Layout::new(&sides, vertices, params.grid, params.terms).ok_or(fault(CaptureError::Atlas))?;
    let surface = Surface::new(&mesh, &sides);
    let seen = job.install(|| observe::observe(&mesh, &surface, &bvh, &capture.views));
    if seen.iter().all(|seen| seen.views.is_empty()) {
        return Err(fault(CaptureError::NoOverlap));
    }
    let scene = Scene {
        normals: mesh.normals(),
        eyes: capture.views.iter().map(|view| view.camera.eye()).collect(),
        partial: params.model.partial,
        directions: match params.model.directions {
            Directions::View => TEXFOLD_LIGHTFIELD_VIEW,
            Directions::Reflected => TEXFOLD_LIGHTFIELD_REFLECTED,
        },
        mesh: &mesh,
        surface: &surface,
        seen: &seen,
    };
    let mut atlases = Atlases::new(&scene, params, &layout);
    for first in (0..vertices).step_by(BATCH as usize) {
        job.stage("maps", 0.2 + 0.7 * first as f32 / vertices as f32)?;
        let batch = first..vertices.min(first + BATCH);
        let fit = |vertex| match params.model.fit {
            Fit::Scattered => als::fit(&Ring::new(&scene, vertex), params),
            Fit::Resampled => resample::fit(&scene, vertex, params),
        };
        let maps: Vec<VertexMaps> = job.install(|| batch.clone().into_par_iter().map(fit).collect());
        batch.zip(&maps).for_each(|(vertex, maps)| atlases.put(vertex, maps));
    }
    job.stage("atlases", 0.9)?;
    let parts = job.install(|| atlases.parts(&sides));
    let texture = LightTexture::new(parts, &layout, Notes::default());
    let quality = job.install(|| quality::measure(&scene, &texture));
    Ok(settle(texture, quality, params))
}

/// As many terms as the goal needs, and what is to be said of them.
fn settle(texture: LightTexture, quality: Quality, params: &LightParams) -> (LightTexture, Quality) {
    let reaches = |goal: f64| quality.psnr_of_terms.iter().position(|&psnr| psnr >= goal);
    let most = quality.psnr_of_terms.len() - 1;
    let terms = params.psnr.and_then(reaches).unwrap_or(most);
    let texture = if terms < most { texture.truncated(terms as u32) } else { texture };
    let directions = match params.model.directions {
        Directions::View => "view",
        Directions::Reflected => "reflected view",
    };
    let factors = match params.model.factors {
        Factors::Signed => "",
        Factors::NonNegative => " without signs",
    };
    let settings = format!(
        "lightfield, {terms} terms{factors}, view maps of {0}x{0} over the {directions}, sampling {1}, {2}",
        params.grid,
        params.sampling,
        params.content.name(),
    );
    let steps: Vec<String> = quality.psnr_of_terms.iter().map(|psnr| format!("{psnr:.2}")).collect();
    let unseen = quality.samples - quality.samples_seen;
    let verdict = format!(
        "{} samples of the surface in {} observations are shown by a mean and {terms} terms around each of {} vertices; \
         dB by terms from 0: {}. {unseen} samples are seen by no photograph and take after their neighbours.",
        quality.samples,
        quality.observations,
        texture.mesh().positions.len(),
        steps.join(", "),
    );
    (texture.with_notes(Notes { settings, verdict, psnr_without: Vec::new() }), quality)
}
