//! The method on one screen: check, choose patch sizes, see what the photographs show, fit the maps of each vertex, put
//! them into atlases.

mod als;
mod assemble;
mod coarsen;
mod multiplicative;
mod observe;
mod quality;
mod resample;
mod ring;
mod share;
mod shared;
mod surface;

use std::borrow::Cow;

use glam::{Vec3, Vec3A};
use rayon::prelude::*;
use texfold_bc::Content;
use texfold_core::{EncodeError, Job, Notes, Params, TextureCodec};

use crate::bvh::Bvh;
use crate::decode::{TEXFOLD_LIGHTFIELD_REFLECTED, TEXFOLD_LIGHTFIELD_VIEW, TEXFOLD_LIGHTFIELD_WORLD};
use crate::encoded::LightTexture;
use crate::layout::{Layout, Sharing, Widths, halved};
use crate::params::{Directions, Factors, Fit, LightParams, Updates};
use crate::{Capture, CaptureError, Lightfield, Mesh};
use assemble::Maps;
pub(crate) use coarsen::encode_simplified;
use observe::Seen;
pub use quality::Quality;
use ring::Ring;
use share::{Books, Room};
use surface::Surface;

/// Vertices fitted at a time: between them progress is told and a job may be cancelled.
const BATCH: u32 = 64;

/// A view map, row by row.
pub(crate) type ViewMap = Vec<Vec3A>;

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
pub(crate) struct Scene {
    pub(crate) mesh: Mesh,
    pub(crate) surface: Surface,
    pub(crate) seen: Vec<Seen>,
    /// Binary logarithms of the patches' sides.
    pub(crate) sides_log2: Vec<u8>,
    /// Samples where patches are as fine as the photographs resolve them.
    pub(crate) resolved_samples: u32,
    pub(crate) normals: Vec<Vec3>,
    pub(crate) eyes: Vec<Vec3>,
    /// Whether photographs that show part of an element count.
    pub(crate) partial: bool,
    /// The shader's number of the kind of directions.
    pub(crate) directions: u32,
}

/// Maps that are found and not stored yet: the part of an encode that several ways to store them share.
#[derive(Debug)]
pub struct Fitted {
    scene: Scene,
    params: LightParams,
    maps: Maps,
}

fn fault(error: CaptureError) -> EncodeError {
    EncodeError::Codec { codec: Lightfield::ID, source: Box::new(error) }
}

pub(crate) fn encode(
    capture: &Capture,
    params: &LightParams,
    job: &mut Job<'_>,
) -> Result<(LightTexture, Quality), EncodeError> {
    fit(capture, params, job)?.store(params.content, params.codewords, job)
}

/// The first half of an encode.
pub(crate) fn fit(capture: &Capture, params: &LightParams, job: &mut Job<'_>) -> Result<Fitted, EncodeError> {
    params.check()?;
    capture.check().map_err(fault)?;
    let scene = scene(capture, params, job)?;
    let vertices = scene.mesh.positions.len() as u32;
    let mut maps = Maps::new(&scene, params);
    let shared = match params.model.fit {
        Fit::Shared => Some(shared::fit(&scene, params, job)?),
        Fit::Scattered | Fit::Resampled => None,
    };
    for first in (0..vertices).step_by(BATCH as usize) {
        job.stage("maps", 0.2 + 0.6 * first as f32 / vertices as f32)?;
        let batch = first..vertices.min(first + BATCH);
        let fit = |vertex| match (&shared, params.model.fit) {
            (Some(shared), _) => shared.maps(&scene, params, vertex),
            (None, Fit::Resampled) => resample::fit(&scene, vertex, params),
            (None, _) => als::fit(&Ring::new(&scene, vertex), params),
        };
        let found: Vec<VertexMaps> = job.install(|| batch.clone().into_par_iter().map(fit).collect());
        batch.zip(&found).for_each(|(vertex, found)| maps.put(&scene, params, vertex, found));
    }
    Ok(Fitted { scene, params: params.clone(), maps })
}

/// What the photographs show of the surface.
fn scene(capture: &Capture, params: &LightParams, job: &mut Job<'_>) -> Result<Scene, EncodeError> {
    let mesh = capture.mesh.snapped().welded().walked();
    if mesh.triangles.is_empty() {
        return Err(fault(CaptureError::NoTriangles));
    }
    job.stage("visibility", 0.0)?;
    let corners: Vec<_> = mesh.triangles.iter().map(|&triangle| mesh.corners(triangle)).collect();
    let bvh = Bvh::new(&corners);
    let resolved = job.install(|| surface::resolved(&mesh, &capture.views, &bvh));
    let sides_log2 = surface::sides_log2(&resolved, params.sampling);
    check_atlases(&sides_log2, mesh.positions.len() as u32, params).map_err(fault)?;
    let surface = Surface::new(&mesh, &sides_log2);
    let resolved_samples = Surface::new(&mesh, &surface::sides_log2(&resolved, 1.0)).samples;
    let seen = job.install(|| observe::observe(&mesh, &surface, &bvh, &capture.views));
    if seen.iter().all(|seen| seen.views.is_empty()) {
        return Err(fault(CaptureError::NoOverlap));
    }
    Ok(Scene {
        normals: mesh.normals(),
        eyes: capture.views.iter().map(|view| view.camera.eye()).collect(),
        partial: params.model.partial,
        directions: match params.model.directions {
            Directions::View => TEXFOLD_LIGHTFIELD_VIEW,
            Directions::Reflected => TEXFOLD_LIGHTFIELD_REFLECTED,
            Directions::World => TEXFOLD_LIGHTFIELD_WORLD,
        },
        mesh,
        surface,
        seen,
        sides_log2,
        resolved_samples,
    })
}

impl Fitted {
    /// The second half of an encode: the maps stored as `content`, with so large a share of their texels as [`LightParams::codewords`]
    /// says.
    ///
    /// # Errors
    /// [`EncodeError`] where these two are out of range, the atlases do not fit a texture or the job is cancelled.
    pub fn store(
        &self,
        content: Content,
        codewords: f32,
        job: &mut Job<'_>,
    ) -> Result<(LightTexture, Quality), EncodeError> {
        let params = LightParams { content, codewords, ..self.params.clone() };
        params.check()?;
        let (maps, books) = self.shared_maps(&params, job)?;
        job.stage("atlases", 0.88)?;
        let (parts, layout) = job.install(|| maps.parts(&self.scene, &params, books)).map_err(fault)?;
        let texture = LightTexture::new(parts, &layout, Notes::default());
        job.stage("quality", 0.9)?;
        let quality = job.install(|| quality::measure(&self.scene, &texture));
        Ok(settle(texture, quality, &params))
    }
}

impl Fitted {
    /// The maps, fitted anew to the codewords of view maps where there are any; what is still to become codewords, and in how much room.
    fn shared_maps(
        &self,
        params: &LightParams,
        job: &mut Job<'_>,
    ) -> Result<(Cow<'_, Maps>, (Books, Room)), EncodeError> {
        let room = Room::Share(params.codewords);
        let kept = match params.model {
            _ if params.codewords >= 1.0 => Some(Books::None),
            model if model.fit == Fit::Shared => Some(Books::Patches),
            model if model.fit == Fit::Resampled || model.updates == Updates::Multiplicative => {
                Some(Books::All)
            }
            _ => None,
        };
        if let Some(books) = kept {
            return Ok((Cow::Borrowed(&self.maps), (books, room)));
        }
        job.stage("codebooks", 0.8)?;
        let (terms, bits) = job.install(|| self.maps.codewords(&self.scene, params));
        let shared = shared::refit(&self.scene, params, terms, job)?;
        let mut maps = Maps::new(&self.scene, params);
        let vertices = 0..self.scene.mesh.positions.len() as u32;
        let found: Vec<VertexMaps> = job.install(|| {
            vertices.clone().into_par_iter().map(|vertex| shared.maps(&self.scene, params, vertex)).collect()
        });
        vertices.zip(&found).for_each(|(vertex, found)| maps.put(&self.scene, params, vertex, found));
        Ok((Cow::Owned(maps), (Books::Patches, Room::Bits(bits))))
    }
}

/// Whether the maps fit textures though every vertex should have all terms and no two maps are alike: before work begins.
fn check_atlases(sides_log2: &[u8], vertices: u32, params: &LightParams) -> Result<(), CaptureError> {
    let coarse = halved(sides_log2, params.halvings);
    let corners = || coarse.iter().flat_map(|&log2| [Some(log2); 3]);
    let mut layers = vec![Sharing::own(sides_log2.iter().map(|&log2| Some(log2)), std::iter::empty())];
    layers.extend((0..params.terms).map(|_| Sharing::own(corners(), (0..vertices).map(|_| true))));
    let widths = Widths::of(&layers, sides_log2.iter().copied().max().unwrap_or(0), params.grid);
    Layout::new([sides_log2, &coarse], &layers, widths, params.grid).map(|_| ()).ok_or(CaptureError::Atlas)
}

/// The settings in the words of the command line, with the terms that were kept.
fn settings(params: &LightParams, terms: usize) -> String {
    let directions = match params.model.directions {
        Directions::View => "view",
        Directions::Reflected => "reflected view",
        Directions::World => "reflected view in space",
    };
    let factors = match params.model.factors {
        Factors::Signed => "",
        Factors::NonNegative => " without signs",
    };
    let regions = match params.model.fit {
        Fit::Shared => format!(" of {} regions", params.regions),
        _ => String::new(),
    };
    let codewords =
        if params.codewords < 1.0 { format!(", codewords {}", params.codewords) } else { String::new() };
    format!(
        "lightfield, {terms} terms{factors}, view maps{regions} of {0}x{0} over the {directions}, sampling {1}, {2}{codewords}",
        params.grid,
        params.sampling,
        params.content.name(),
    )
}

/// As many terms as the goal needs, and what is to be said of them.
fn settle(texture: LightTexture, quality: Quality, params: &LightParams) -> (LightTexture, Quality) {
    let reaches = |goal: f64| quality.psnr_of_terms.iter().position(|&psnr| psnr >= goal);
    let most = quality.psnr_of_terms.len() - 1;
    let terms = params.psnr.and_then(reaches).unwrap_or(most);
    let texture = if terms < most { texture.truncated(terms as u32) } else { texture };
    let steps: Vec<String> = quality.psnr_of_terms.iter().map(|psnr| format!("{psnr:.2}")).collect();
    let unseen = quality.samples - quality.samples_seen;
    let verdict = format!(
        "{} samples of the surface in {} observations are shown by a mean and {terms} terms around each of {} vertices; \
         dB of the matrices by terms from 0: {}; of colours {:.2}. Resampled as finely as the \
         photographs resolve it, in 32x32 directions, that would be {} MB. {unseen} samples are seen by no photograph and take after their neighbours.",
        quality.samples,
        quality.observations,
        texture.mesh().positions.len(),
        steps.join(", "),
        quality.psnr_of_colours,
        quality.resampled_bytes / 1_000_000,
    );
    (
        texture.with_notes(Notes { settings: settings(params, terms), verdict, psnr_without: Vec::new() }),
        quality,
    )
}
