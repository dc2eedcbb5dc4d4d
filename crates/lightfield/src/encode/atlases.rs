//! Maps in their atlases, before these are stored.

use glam::{UVec2, Vec2, Vec3};
use texfold_bc::{Content, ContentPlanes};
use texfold_core::{CancelCheck, Effort, EncodeError, Texel};

use super::scene::Scene;
use super::share::{Rgb, Stored};
use crate::decode::texfold_lightfield_texel;
use crate::kinds::Directions;
use crate::layout::{Layout, NONE, Sharing, Widths, lattice};
use crate::params::LightParams;
use crate::parts::{PIXEL, Parts, Payload};

/// All maps in their atlases, and what stands beside them.
#[derive(Debug)]
pub(super) struct Drawn {
    pub(super) mean: Canvas,
    pub(super) surface: Canvas,
    pub(super) view: Canvas,
    pub(super) layers: Vec<Sharing>,
    pub(super) widths: Widths,
    pub(super) layout: Layout,
    pub(super) scales: Vec<u8>,
    /// For each term, how much an error of one step in a texel of its surface maps and of its view maps counts, in the mean.
    pub(super) weights: Vec<[f64; 2]>,
}

impl Drawn {
    /// The parts of the shipped form with the first `terms` terms, whose texels `payload` has.
    pub(super) fn parts(&self, scene: &Scene, params: &LightParams, terms: u32, payload: Payload) -> Parts {
        let scales = 3 * terms as usize * scene.mesh.positions.len();
        Parts {
            mesh: scene.mesh.clone(),
            sides_log2: scene.sides_log2.clone(),
            surface_reduce_log2: params.maps.surface_reduce_log2,
            directions: params.model.directions,
            factors: params.model.factors,
            grid: params.maps.grid,
            total_terms: terms,
            terms,
            scales: self.scales[..scales].to_vec(),
            layers: self.layers[..=terms as usize].to_vec(),
            widths: self.widths,
            payload,
        }
    }

    /// All atlases in planes.
    pub(super) fn planes(&self, content: Content, cancel: CancelCheck<'_>) -> Result<Payload, EncodeError> {
        let planes = |canvas: &Canvas| {
            let texels: Vec<Texel> = canvas.texels.iter().copied().map(texel).collect();
            ContentPlanes::encode_cancellable(content, PIXEL, canvas.size, &texels, Effort::Normal, cancel)
        };
        Ok(Payload::Planes {
            mean: planes(&self.mean)?,
            surface: planes(&self.surface)?,
            view: planes(&self.view)?,
        })
    }
}

/// An atlas as it is drawn.
#[derive(Debug)]
pub(super) struct Canvas {
    pub(super) size: (u32, u32),
    pub(super) texels: Vec<Rgb>,
    /// Whether a texel is read: part of a map.
    pub(super) is_read: Vec<bool>,
}

impl Canvas {
    pub(super) fn new(size: (u32, u32), nothing: Rgb) -> Canvas {
        let texels = size.0 as usize * size.1 as usize;
        Canvas { size, texels: vec![nothing; texels], is_read: vec![false; texels] }
    }

    pub(super) fn put_patches(&mut self, sides_log2: &[u8], layer: &Stored, places: &[u32]) {
        let corners = places.len() / sides_log2.len().max(1);
        for (at, (&place, &number)) in places.iter().zip(&layer.sharing.patch_of).enumerate() {
            if number == NONE {
                continue;
            }
            let log2 = sides_log2[at / corners];
            let texels = &layer.patches[usize::from(log2)][number as usize];
            for ((i, j), &value) in lattice(1 << log2).zip(texels) {
                let at = texfold_lightfield_texel(place, 1 << log2, UVec2::new(i, j));
                self.put(at, value, true);
            }
        }
    }

    pub(super) fn put_views(&mut self, grid: u32, directions: Directions, layer: &Stored, places: &[u32]) {
        let read: Vec<bool> = (0..grid * grid).map(|at| reaches(grid, directions, at)).collect();
        for (&place, &number) in
            places.iter().zip(&layer.sharing.view_of).filter(|&(_, &number)| number != NONE)
        {
            let corner = UVec2::new(place & 0x3fff, place >> 14);
            for (index, (&value, &is_read)) in (0..).zip(layer.views[number as usize].iter().zip(&read)) {
                self.put(corner + UVec2::new(index % grid, index / grid), value, is_read);
            }
        }
    }

    fn put(&mut self, at: UVec2, value: Rgb, is_read: bool) {
        let index = (at.y * self.size.0 + at.x) as usize;
        self.texels[index] = value;
        self.is_read[index] |= is_read;
    }
}

/// Whether a texel of a view map is read towards any direction: the square around the disc has corners that no direction reaches.
fn reaches(grid: u32, directions: Directions, texel: u32) -> bool {
    if directions == Directions::World {
        return true;
    }
    let centre = Vec2::splat(0.5 * (grid - 1) as f32);
    let away = (Vec2::new((texel % grid) as f32, (texel / grid) as f32) - centre).abs();
    // A texel is read between it and its neighbours; the bound's rounding is on the safe side.
    (away - 1.0).max(Vec2::ZERO).length() < centre.x + 1e-3
}

fn texel(value: Rgb) -> Texel {
    Vec3::from(value.map(f32::from)).extend(255.0) / 255.0
}
