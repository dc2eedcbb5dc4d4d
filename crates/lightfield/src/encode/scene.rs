//! What the photographs show of the surface: all that the fits read.

use glam::Vec3;
use texfold_core::{EncodeError, Job, TextureCodec};

use super::observe::{self, Seen};
use super::order::{snapped, walked};
use super::surface::{self, Surface};
use crate::bvh::Bvh;
use crate::layout::{Layout, Sharing, Widths, reduced};
use crate::params::LightParams;
use crate::{Capture, CaptureError, Lightfield, Mesh};

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

/// A capture's fault as an encoder's.
pub(super) fn fault(error: CaptureError) -> EncodeError {
    EncodeError::Codec { codec: Lightfield::ID, source: Box::new(error) }
}

impl Scene {
    /// Bytes that the photographs' colours of samples take.
    pub(super) fn bytes(&self) -> u64 {
        self.seen.iter().map(Seen::bytes).sum()
    }

    /// Chooses the sides of patches and looks for every sample in every photograph.
    pub(super) fn new(
        capture: &Capture,
        params: &LightParams,
        job: &mut Job<'_>,
    ) -> Result<Scene, EncodeError> {
        let mesh = walked(&snapped(&capture.mesh).welded());
        job.checkpoint()?;
        if mesh.triangles.is_empty() {
            return Err(fault(CaptureError::NoTriangles));
        }
        job.stage("visibility", 0.0)?;
        let corners: Vec<_> = mesh.triangles.iter().map(|&triangle| mesh.corners(triangle)).collect();
        let bvh = Bvh::new(&corners);
        let cancel = job.cancel_check();
        let resolved = job.install(|| surface::resolved(&mesh, &capture.views, &bvh, cancel));
        job.checkpoint()?;
        let sides_log2 = surface::sides_log2(&resolved, params.maps.sampling);
        check_atlases(&sides_log2, mesh.positions.len() as u32, params).map_err(fault)?;
        let resolved_samples = Surface::new(&mesh, &surface::sides_log2(&resolved, 1.0)).samples;
        job.checkpoint()?;
        let surface = Surface::new(&mesh, &sides_log2);
        let seen = observe::observe(&mesh, &surface, &bvh, &capture.views, job)?;
        if seen.iter().all(|seen| seen.views.is_empty()) {
            job.budget.release(seen.iter().map(Seen::bytes).sum());
            return Err(fault(CaptureError::NoOverlap));
        }
        Ok(Scene {
            normals: mesh.normals(),
            eyes: capture.views.iter().map(|view| view.camera.eye()).collect(),
            partial: params.model.partial,
            directions: params.model.directions.number(),
            mesh,
            surface,
            seen,
            sides_log2,
            resolved_samples,
        })
    }
}

/// Whether the maps fit textures though every vertex should have all terms and no two maps are alike: before work begins.
fn check_atlases(sides_log2: &[u8], vertices: u32, params: &LightParams) -> Result<(), CaptureError> {
    let coarse = reduced(sides_log2, params.maps.surface_reduce_log2);
    let corners = || coarse.iter().flat_map(|&log2| [Some(log2); 3]);
    let mut layers = vec![Sharing::own(sides_log2.iter().map(|&log2| Some(log2)), std::iter::empty())];
    layers.extend((0..params.terms).map(|_| Sharing::own(corners(), (0..vertices).map(|_| true))));
    let widths = Widths::of(&layers, sides_log2.iter().copied().max().unwrap_or(0), params.maps.grid);
    Layout::new([sides_log2, &coarse], &layers, widths, params.maps.grid)
        .map(|_| ())
        .ok_or(CaptureError::Atlas)
}
