//! From maps of samples to atlases of bytes.
//!
//! Both factors of a term are scaled to the same largest magnitude, 1, and quantised to 8 bits with 0 exact; the scales
//! are kept a vertex, term and channel (paper section 2.2 splits the singular value likewise, for all vertices alike).

use glam::{UVec2, Vec3};
use texfold_bc::{Content, ContentPlanes};
use texfold_core::{Effort, Texel};

use super::{Scene, VertexMaps};
use crate::decode::texfold_lightfield_patch;
use crate::encoded::{PIXEL, Parts, byte_of, mean_size, scale_of, surface_size, view_size, zero_and_range};
use crate::layout::Layout;
use crate::params::{Factors, LightParams};

/// A map's value as a stored one.
fn stored(value: Vec3, factors: Factors) -> Texel {
    let (zero, range) = zero_and_range(factors);
    ((value * range).round() + zero).clamp(Vec3::ZERO, Vec3::splat(255.0)).extend(255.0) / 255.0
}

/// One term of one vertex, scaled.
pub(crate) struct Scaled {
    pub(crate) bytes: [u8; 3],
    surface: Vec<Texel>,
    view: Vec<Texel>,
}

fn largest(values: &[Vec3]) -> Vec3 {
    values.iter().fold(Vec3::ZERO, |most, value| most.max(value.abs()))
}

/// Scales a term to 8 bits a value.
fn scale(term: &super::Term, factors: Factors) -> Scaled {
    let (surface, view) = (largest(&term.surface), largest(&term.view));
    let bytes = (surface * view).to_array().map(byte_of);
    // The scale is rounded up; the surface map makes up for it.
    let scales = Vec3::from(bytes.map(scale_of));
    let inverse = |value: Vec3| Vec3::select(value.cmpgt(Vec3::ZERO), value.recip(), Vec3::ZERO);
    let (per_surface, per_view) = (view * inverse(scales), inverse(view));
    Scaled {
        bytes,
        surface: term.surface.iter().map(|&value| stored(value * per_surface, factors)).collect(),
        view: term.view.iter().map(|&value| stored(value * per_view, factors)).collect(),
    }
}

/// The maps of all vertices as they come.
pub(crate) struct Atlases<'s> {
    scene: &'s Scene<'s>,
    params: &'s LightParams,
    layout: &'s Layout,
    pub(crate) mean: Vec<Vec3>,
    scales: Vec<u8>,
    surface: Vec<Texel>,
    view: Vec<Texel>,
}

impl<'s> Atlases<'s> {
    pub(crate) fn new(scene: &'s Scene<'s>, params: &'s LightParams, layout: &'s Layout) -> Self {
        let nothing = stored(Vec3::ZERO, params.model.factors);
        let texels = |(width, height): (u32, u32)| vec![nothing; width as usize * height as usize];
        Atlases {
            scene,
            params,
            layout,
            mean: vec![Vec3::ZERO; scene.surface.samples as usize],
            scales: vec![0; 3 * params.terms as usize * scene.mesh.positions.len()],
            surface: texels(surface_size(layout, params.terms)),
            view: texels(view_size(layout, params.grid, params.terms)),
        }
    }

    /// Writes the maps of one vertex.
    pub(crate) fn put(&mut self, vertex: u32, maps: &VertexMaps) {
        for (&sample, &mean) in maps.rows.iter().zip(&maps.mean) {
            self.mean[sample as usize] += mean;
        }
        for (number, term) in (0..).zip(&maps.terms) {
            let scaled = scale(term, self.params.model.factors);
            let first = 3 * (number as usize * self.scene.mesh.positions.len() + vertex as usize);
            self.scales[first..first + 3].copy_from_slice(&scaled.bytes);
            self.put_view(vertex, number, &scaled.view);
            self.put_surface(vertex, number, &maps.rows, &scaled.surface);
        }
    }

    fn put_view(&mut self, vertex: u32, term: u32, texels: &[Texel]) {
        let (grid, columns) = (self.params.grid, self.layout.view_columns);
        let (x, y) = (vertex % columns * grid, vertex / columns * grid + term * self.layout.view_height);
        for (row, line) in (y..).zip(texels.chunks_exact(grid as usize)) {
            let start = (row * columns * grid + x) as usize;
            self.view[start..start + grid as usize].copy_from_slice(line);
        }
    }

    fn put_surface(&mut self, vertex: u32, term: u32, rows: &[u32], texels: &[Texel]) {
        let nothing = stored(Vec3::ZERO, self.params.model.factors);
        let value = |sample: u32| rows.binary_search(&sample).map_or(nothing, |row| texels[row]);
        let width = 3 * self.layout.surface_width;
        let elements = &self.scene.surface.elements;
        for &triangle in &elements[vertex as usize].triangles {
            let corners = self.scene.mesh.triangles[triangle as usize];
            for corner in (0..3u32).filter(|&corner| corners[corner as usize] == vertex) {
                let origin =
                    UVec2::new(corner * self.layout.surface_width, term * self.layout.surface_height);
                self.scene.each_texel(self.layout, triangle, |at, [low, high], part| {
                    let place = origin + at;
                    let blended = value(low).lerp(value(high), part);
                    self.surface[(place.y * width + place.x) as usize] = blended;
                });
            }
        }
    }

    /// The mean as texels.
    fn mean_texels(&self) -> Vec<Texel> {
        let (width, height) = mean_size(self.layout);
        let mut texels = vec![Texel::ZERO; width as usize * height as usize];
        let value = |sample: u32| self.mean[sample as usize].clamp(Vec3::ZERO, Vec3::ONE).extend(1.0);
        for triangle in 0..self.scene.mesh.triangles.len() as u32 {
            self.scene.each_texel(self.layout, triangle, |at, [low, high], part| {
                texels[(at.y * width + at.x) as usize] = value(low).lerp(value(high), part);
            });
        }
        texels
    }

    /// All parts of the shipped form.
    pub(crate) fn parts(&self, sides_log2: &[u8]) -> Parts {
        let params = self.params;
        let planes = |content: Content, size, texels: &[Texel]| {
            ContentPlanes::encode(content, PIXEL, size, texels, Effort::Normal)
        };
        Parts {
            mesh: self.scene.mesh.clone(),
            sides_log2: sides_log2.to_vec(),
            directions: params.model.directions,
            factors: params.model.factors,
            grid: params.grid,
            total_terms: params.terms,
            terms: params.terms,
            scales: self.scales.clone(),
            mean: planes(params.content, mean_size(self.layout), &self.mean_texels()),
            surface: planes(params.content, surface_size(self.layout, params.terms), &self.surface),
            view: planes(params.content, view_size(self.layout, params.grid, params.terms), &self.view),
        }
    }
}

impl Scene<'_> {
    /// Shows every texel of a triangle's patch: its place in the atlas and the samples it is blended from.
    pub(crate) fn each_texel(
        &self,
        layout: &Layout,
        triangle: u32,
        mut see: impl FnMut(UVec2, [u32; 2], f32),
    ) {
        let place = layout.places[triangle as usize];
        let n = 1u32 << ((place >> 28) & 7);
        for (i, j) in (0..=n).flat_map(|i| (0..=n - i).map(move |j| (i, j))) {
            let (u, v) = (i as f32 / n as f32, j as f32 / n as f32);
            let read = texfold_lightfield_patch(place, Vec3::new(1.0 - u - v, u, v));
            let at = [read.a, read.b, read.c][read.weights.max_position()];
            let (samples, part) = self.surface.texel(self.mesh, triangle, n, (i, j));
            see(at, samples, part);
        }
    }
}
