//! From maps of samples to atlases of bytes.
//!
//! Both factors of a term are scaled to the same largest magnitude, 1, and quantised to 8 bits with 0 exact; the scales
//! are kept a vertex, term and channel (paper section 2.2 splits the singular value likewise, for all vertices alike). Vertices without a
//! term have no maps of it.

use std::collections::BTreeMap;

use glam::{Vec3, Vec3A};
use texfold_bc::Content;
use texfold_core::{CancelCheck, EncodeError};

use super::atlases::{Canvas, Drawn};

use super::maps::{Term, VertexMaps};
use super::scene::{Scene, fault};
use super::share::{Books, Codebooks, LayerMaps, Map, Rgb, Room, Stored, share};
use super::shared::Codewords;
use super::surface::{Blend, Lattice};
use crate::CaptureError;
use crate::decode::texfold_lightfield_scale;
use crate::kinds::Factors;
use crate::layout::{Layout, NONE, Sharing, Widths, lattice, reduced};
use crate::params::LightParams;
use crate::parts::{PIXEL, mean_size, surface_size, view_size, zero_and_range};

/// The scale that a byte stands for; 0 stands for 0.
fn scale_of(byte: u8) -> f32 {
    texfold_lightfield_scale(u32::from(byte))
}

/// The least scale of at least `value`; the largest where there is none, 0 for less than the least.
fn byte_of(value: f32) -> u8 {
    if value < scale_of(1) { 0 } else { (1..=255).find(|&byte| scale_of(byte) >= value).unwrap_or(255) }
}

/// A map's value as a stored one.
fn stored(value: Vec3, factors: Factors) -> Rgb {
    let (zero, range) = zero_and_range(factors);
    byte(((value * range).round() + zero) / 255.0)
}

/// 0 to 1 as bytes.
fn byte(value: Vec3) -> Rgb {
    (value * 255.0).round().clamp(Vec3::ZERO, Vec3::splat(255.0)).to_array().map(|value| value as u8)
}

/// Bits of a texel of maps that are stored as `content`.
fn texel_bits(content: Content) -> f64 {
    let block_bits: u32 = content.formats(PIXEL).0.iter().map(|format| 8 * format.block_bytes()).sum();
    let texels = if content == Content::Raw { 1.0 } else { 16.0 };
    f64::from(block_bits) / texels
}

/// One term of one vertex, scaled.
struct Scaled {
    bytes: [u8; 3],
    surface: Vec<Vec3>,
    view: Vec<Vec3>,
}

fn largest(values: &[Vec3]) -> Vec3 {
    values.iter().fold(Vec3::ZERO, |most, value| most.max(value.abs()))
}

fn mean_square(values: &[Vec3]) -> Vec3 {
    values.iter().map(|&value| value * value).sum::<Vec3>() / values.len().max(1) as f32
}

/// Scales a term to magnitudes of at most 1; view maps are positive in the mean, so that alike ones have one sign.
fn scale(term: &Term) -> Scaled {
    let (surface, view) = (largest(&term.surface), largest(&term.view));
    let bytes = (surface * view).to_array().map(byte_of);
    // The scale is rounded up; the surface map makes up for it.
    let scales = Vec3::from(bytes.map(scale_of));
    let inverse = |value: Vec3| Vec3::select(value.cmpgt(Vec3::ZERO), value.recip(), Vec3::ZERO);
    let sum: Vec3 = term.view.iter().sum();
    let sign = Vec3::select(sum.cmplt(Vec3::ZERO), Vec3::NEG_ONE, Vec3::ONE);
    let (per_image, per_view) = (sign * view * inverse(scales), sign * inverse(view));
    Scaled {
        bytes,
        surface: term.surface.iter().map(|&value| value * per_image).collect(),
        view: term.view.iter().map(|&value| value * per_view).collect(),
    }
}

/// The surface map of one term of one vertex.
struct SurfaceMap {
    vertex: u32,
    term: usize,
    /// Its values by sample, at most 1 in magnitude.
    values: BTreeMap<u32, Vec3>,
    /// How much an error of one step in all of its texels counts, channel by channel and in all.
    gains: Vec3,
    weight: f32,
}

/// How much an error of one step in all texels of the mean counts, in each of three channels.
pub(super) const MEAN_GAIN: f32 = 1.0 / 3.0;

/// The maps of all vertices as they come.
#[derive(Debug, Clone)]
pub(crate) struct Maps {
    pub(super) mean: Vec<Vec3>,
    pub(super) scales: Vec<u8>,
    pub(super) terms: Vec<LayerMaps>,
}

impl Maps {
    /// Bytes of all maps where every vertex has all terms.
    pub(super) fn bytes(scene: &Scene, params: &LightParams) -> u64 {
        let texels = |log2: &u8| {
            let side = 1u64 << log2.saturating_sub(params.maps.surface_reduce_log2);
            (side + 1) * (side + 2) / 2
        };
        let patches = 3 * scene.sides_log2.len() as u64;
        let vertices = scene.mesh.positions.len() as u64;
        let views = vertices * u64::from(params.maps.grid) * u64::from(params.maps.grid);
        let texels = 3 * scene.sides_log2.iter().map(texels).sum::<u64>() + views;
        let of_term = texels * size_of::<Rgb>() as u64 + (patches + vertices) * size_of::<Map>() as u64;
        u64::from(scene.surface.samples) * size_of::<Vec3>() as u64 + u64::from(params.terms) * of_term
    }

    pub(crate) fn new(scene: &Scene, params: &LightParams) -> Self {
        let empty = LayerMaps {
            patches: vec![Map::default(); 3 * scene.mesh.triangles.len()],
            views: vec![Map::default(); scene.mesh.positions.len()],
        };
        Maps {
            mean: vec![Vec3::ZERO; scene.surface.samples as usize],
            scales: vec![0; 3 * params.terms as usize * scene.mesh.positions.len()],
            terms: vec![empty; params.terms as usize],
        }
    }

    /// Writes the maps of one vertex.
    pub(crate) fn put(&mut self, scene: &Scene, params: &LightParams, vertex: u32, maps: &VertexMaps) {
        for (&sample, &mean) in maps.rows.iter().zip(&maps.mean) {
            self.mean[sample as usize] += mean;
        }
        let factors = params.model.factors;
        for (number, term) in maps.terms.iter().enumerate() {
            let scaled = scale(term);
            let first = 3 * (number * scene.mesh.positions.len() + vertex as usize);
            self.scales[first..first + 3].copy_from_slice(&scaled.bytes);
            if scaled.bytes == [0; 3] {
                continue;
            }
            // What an error of a step in one factor makes of the colour, in steps of 255: summed over samples, in the mean of
            // directions and channels.
            let step = 255.0 / zero_and_range(factors).1;
            let squares = Vec3::from(scaled.bytes.map(scale_of)).powf(2.0) * (step * step / 3.0);
            let texels = scaled.view.len().max(1) as f32;
            let of_view =
                (squares * mean_square(&scaled.surface)).element_sum() * scaled.surface.len() as f32 / texels;
            self.terms[number].views[vertex as usize] = Map {
                texels: scaled.view.iter().map(|&value| stored(value, factors)).collect(),
                gains: squares * mean_square(&scaled.surface) * (scaled.surface.len() as f32 / texels),
                weight: of_view.max(f32::MIN_POSITIVE),
            };
            // A texel of a coarser map stands for several samples.
            let samples = (1u32 << (2 * params.maps.surface_reduce_log2)) as f32;
            let gains = squares * mean_square(&scaled.view);
            let of_image = (gains.element_sum() * samples).max(f32::MIN_POSITIVE);
            let values: BTreeMap<u32, Vec3> = maps.rows.iter().copied().zip(scaled.surface).collect();
            let gains = gains * samples;
            let surface = SurfaceMap { vertex, term: number, values, gains, weight: of_image };
            self.put_surface(scene, params, &surface);
        }
    }

    fn put_surface(&mut self, scene: &Scene, params: &LightParams, map: &SurfaceMap) {
        let value = |sample: u32| map.values.get(&sample).copied().unwrap_or(Vec3::ZERO);
        for &triangle in &scene.surface.elements[map.vertex as usize].triangles {
            let corners = scene.mesh.triangles[triangle as usize];
            let mut texels = Vec::new();
            scene.each_texel(triangle, params.maps.surface_reduce_log2, |Blend { samples, part }| {
                let value = value(samples[0]).lerp(value(samples[1]), part);
                texels.push(stored(value, params.model.factors));
            });
            for corner in (0..3).filter(|&corner| corners[corner] == map.vertex) {
                let patch = Map { texels: texels.clone(), gains: map.gains, weight: map.weight };
                self.terms[map.term].patches[3 * triangle as usize + corner] = patch;
            }
        }
    }

    /// The mean as maps.
    fn mean_maps(&self, scene: &Scene) -> LayerMaps {
        let value = |sample: u32| self.mean[sample as usize].clamp(Vec3::ZERO, Vec3::ONE);
        let patch = |triangle: u32| {
            let mut texels = Vec::new();
            scene.each_texel(triangle, 0, |Blend { samples, part }| {
                texels.push(byte(value(samples[0]).lerp(value(samples[1]), part)));
            });
            Map { texels, gains: Vec3::splat(MEAN_GAIN), weight: 1.0 }
        };
        let patches = (0..scene.mesh.triangles.len() as u32).map(patch).collect();
        LayerMaps { patches, views: Vec::new() }
    }

    /// The mean and the terms as they are stored.
    fn stored(
        &self,
        scene: &Scene,
        params: &LightParams,
        books: Codebooks,
        cancel: CancelCheck<'_>,
    ) -> (Vec<Stored>, f64) {
        let mean = self.mean_maps(scene);
        let maps: Vec<&LayerMaps> = std::iter::once(&mean).chain(&self.terms).collect();
        let sides = [&scene.sides_log2[..], &reduced(&scene.sides_log2, params.maps.surface_reduce_log2)];
        share(&maps, sides, books, texel_bits(params.storage.content.unwrap_or(Content::Raw)), cancel)
    }

    /// The view maps of each term that codebooks keep and which of them each vertex uses; and the bits that there is room for.
    pub(super) fn codewords(
        &self,
        scene: &Scene,
        params: &LightParams,
        cancel: CancelCheck<'_>,
    ) -> (Vec<Codewords>, f64) {
        let (zero, range) = zero_and_range(params.model.factors);
        let value = |&texel: &Rgb| (Vec3A::from(texel.map(f32::from)) - zero) / range;
        let view = |view: &Vec<Rgb>| view.iter().map(value).collect();
        let number = |&number: &u32| (number != NONE).then_some(number as usize);
        let term = |layer: &Stored| Codewords {
            views: layer.views.iter().map(view).collect(),
            of: layer.sharing.view_of.iter().map(number).collect(),
        };
        let books = Codebooks { of: Books::All, room: Room::Share(params.storage.codewords) };
        let (layers, bits) = self.stored(scene, params, books, cancel);
        (layers.iter().skip(1).map(term).collect(), bits)
    }

    /// All maps in their atlases.
    pub(crate) fn drawn(
        &self,
        scene: &Scene,
        params: &LightParams,
        books: Codebooks,
        cancel: CancelCheck<'_>,
    ) -> Result<Drawn, EncodeError> {
        let sides_log2 = &scene.sides_log2;
        let coarse = reduced(sides_log2, params.maps.surface_reduce_log2);
        let layers = self.stored(scene, params, books, cancel).0;
        cancel.checkpoint()?;
        let sharing: Vec<Sharing> = layers.iter().map(|layer| layer.sharing.clone()).collect();
        let widest = sides_log2.iter().copied().max().unwrap_or(0);
        let widths = Widths::of(&sharing, widest, params.maps.grid);
        let sides = [&sides_log2[..], &coarse];
        let layout = Layout::new(sides, &sharing, widths, params.maps.grid)
            .ok_or_else(|| fault(CaptureError::Atlas))?;
        let zero = stored(Vec3::ZERO, params.model.factors);
        let mut drawn = Drawn {
            mean: Canvas::new(mean_size(&layout, widths), [0; 3]),
            surface: Canvas::new(surface_size(&layout, widths, params.terms), zero),
            view: Canvas::new(view_size(&layout, widths, params.terms), zero),
            layers: sharing,
            widths,
            scales: self.scales.clone(),
            weights: self.weights(),
            layout,
        };
        let places = &drawn.layout;
        for (number, layer) in layers.iter().enumerate() {
            let (atlas, sides) =
                if number == 0 { (&mut drawn.mean, sides_log2) } else { (&mut drawn.surface, &coarse) };
            atlas.put_patches(sides, layer, &places.patches[number]);
            drawn.view.put_views(params.maps.grid, params.model.directions, layer, &places.views[number]);
        }
        Ok(drawn)
    }
}

impl Scene {
    /// Gives what every texel of a triangle's patch is blended from to `see`; the patch's side is downscaled by `reduce_log2`.
    fn each_texel(&self, triangle: u32, reduce_log2: u8, mut see: impl FnMut(Blend)) {
        let log2 = self.sides_log2[triangle as usize];
        let steps = 1u32 << log2.saturating_sub(reduce_log2);
        let places = Lattice { stride: (1 << log2) / steps, steps };
        lattice(steps).for_each(|at| see(self.surface.texel(&self.mesh, triangle, places, at)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_rise_by_an_eighth_of_an_octave_and_hold_what_they_are_asked_for() {
        assert_eq!((scale_of(0), scale_of(1), scale_of(209)), (0.0, 2f32.powi(-26), 1.0));
        for byte in 1..=254 {
            let ratio = scale_of(byte + 1) / scale_of(byte);
            assert!((ratio - 2f32.powf(0.125)).abs() < 1e-5, "{byte}: {ratio}");
            assert_eq!(byte_of(scale_of(byte)), byte);
            assert_eq!(byte_of(scale_of(byte) * 1.01), byte + 1);
        }
        assert_eq!((byte_of(0.0), byte_of(f32::MAX)), (0, 255));
    }
}
