//! As few view maps as a scene needs: one for all vertices of a region, and codewords of patches, where these reach the PSNR goal in less memory
//! than view maps of each vertex.

use texfold_bc::Content;
use texfold_core::{Access, EncodeError, Encoded, Job};

use super::assemble::Maps;
use super::blocks::Store;
use super::quality::{self, LightQuality};
use super::scene::Scene;
use super::{FittedMaps, fit_scene};
use crate::kinds::Directions;
use crate::params::{FitMethod, LightParams, MapSizes, MapStorage, Updates};
use crate::{Capture, LightTexture};

/// Regions of the first fit, of a fit where its maps do not reach the goal, and of one where they do.
const REGIONS: u32 = 24;
const MORE_REGIONS: u32 = 4 * REGIONS;
const FEWER_REGIONS: u32 = REGIONS / 4;
/// What the larger number may gain over the first, in dB: beyond that it is not tried.
const MORE_GAIN: f64 = 2.0;
/// Shares of the bits of maps that are kept, in the order in which they are tried: larger ones are not always closer, as codewords lie sorted in
/// the atlas, which BC1 profits from.
const SHARES: [f32; 8] = [0.1, 0.14, 0.2, 0.28, 0.4, 0.6, 0.8, 1.0];
/// Texels a side of a shared view map, which is laid over the whole sphere: as fine as those of 16 over a hemisphere.
const GRID: u32 = 32;
/// Log2 by which the sides of surface maps are downscaled.
const REDUCE_LOG2: u8 = 2;

/// A light field and how close it comes to the photographs.
type Measurement = (LightTexture, LightQuality);

/// The light field with shared view maps of the smallest size that reaches the PSNR of `params`, and its number of regions: that one where it is
/// `known`. None where no tried number reaches it, where no PSNR is asked for, or where parameters other than the usual ones name a model.
pub(super) fn encode(
    capture: &Capture,
    params: &LightParams,
    known: Option<u32>,
    job: &mut Job<'_>,
) -> Result<Option<(u32, Measurement)>, EncodeError> {
    let (model, maps) = (params.model, params.maps);
    let is_usual = model == model.with_fit(FitMethod::default()).with_directions(Directions::default())
        && maps == MapSizes { sampling: maps.sampling, ..MapSizes::default() }
        && params.storage == MapStorage::default().with_loss(params.storage.loss)
        && model.updates == Updates::default()
        && params.terms > 0;
    let Some(goal) = params.psnr.filter(|_| is_usual) else { return Ok(None) };
    let storage = MapStorage::default().with_access(Access::Texel).with_content(Content::Bc1);
    let params = params.clone().with_terms(1).with_grid(GRID).with_surface_reduce_log2(REDUCE_LOG2);
    let params = params.with_storage(storage);
    let of_regions = |regions| {
        let model = model.with_fit(FitMethod::Shared { regions }).with_directions(Directions::World);
        params.clone().with_model(model)
    };
    let regions = known.unwrap_or(REGIONS);
    let scene = match Scene::new(capture, &of_regions(regions), job) {
        // Atlases of larger view maps may not fit where those of each vertex do.
        Err(EncodeError::Codec { .. }) => return Ok(None),
        scene => scene?,
    };
    let (scene, first) = job.within(0.0, 0.5, |job| smallest(scene, goal, of_regions(regions), job))?;
    let other = match first {
        _ if known.is_some() => None,
        Ok(_) => Some(FEWER_REGIONS),
        Err(missing) => (missing <= MORE_GAIN).then_some(MORE_REGIONS),
    };
    let mut found = vec![(regions, first)];
    let mut scene = scene;
    if let Some(regions) = other {
        let second;
        (scene, second) = job.within(0.5, 1.0, |job| smallest(scene, goal, of_regions(regions), job))?;
        found.push((regions, second));
    }
    job.budget.release(scene.bytes());
    let found = found.into_iter().filter_map(|(regions, found)| Some((regions, found.ok()?)));
    Ok(found.min_by_key(|(_, (texture, _))| texture.memory().compressed))
}

/// The scene again, and the smallest share of the bits of maps that reaches the goal; the missing dB where the largest does not.
fn smallest(
    scene: Scene,
    goal: f64,
    params: LightParams,
    job: &mut Job<'_>,
) -> Result<(Scene, Result<Measurement, f64>), EncodeError> {
    let fitted = fit_scene(scene, &params, job)?;
    let cancel = job.cancel_check();
    let (mut found, mut most) = (None, f64::NEG_INFINITY);
    for share in SHARES {
        let storage = params.storage.with_codewords(share);
        let texture = fitted.in_planes(storage, job)?;
        let sampled = job.install(|| quality::sampled(&fitted.scene, &texture, cancel));
        job.checkpoint()?;
        most = most.max(sampled);
        // A part of the samples may be easier than all.
        if sampled >= goal {
            let stored = fitted.store(storage, job)?;
            if stored.1.psnr >= goal {
                found = Some(stored);
                break;
            }
        }
    }
    let found = found.ok_or(goal - most);
    job.budget.release(Maps::bytes(&fitted.scene, &params));
    Ok((fitted.scene, found))
}

impl FittedMaps {
    /// The maps in planes of BC1, with the share of their bits that `storage` names.
    fn in_planes(&self, storage: MapStorage, job: &mut Job<'_>) -> Result<LightTexture, EncodeError> {
        let params = LightParams { storage, ..self.params.clone() };
        let (maps, books) = self.shared_maps(&params, job)?;
        let cancel = job.cancel_check();
        let store = Store { scene: &self.scene, params: &params, maps: &maps, books, cancel };
        job.install(|| store.planes(Content::Bc1))
    }
}
