//! The shipped form: a mesh, its mean, and for each term surface maps and view maps.

use std::borrow::Cow;

use glam::Vec3;
use texfold_bc::{Content, ContentPlanes};
use texfold_core::container::SectionWriter;
use texfold_core::image::{Alpha, ColorSpace, Depth, PixelInfo};
use texfold_core::{
    CodecId, Domain, Encoded, Footprint, GpuForm, Layers, LightAddress, LightLayout, Notes, Plane,
    PlaneFormat, RegionError, SurfaceBinding, SurfaceLight, Texel, TextureCodec,
};

use crate::decode::{
    LightfieldView, TEXFOLD_LIGHTFIELD_REFLECTED, TEXFOLD_LIGHTFIELD_ROW, TEXFOLD_LIGHTFIELD_VIEW,
    TEXFOLD_LIGHTFIELD_WORLD, TexfoldLightfieldParams, texfold_lightfield_sample, texfold_lightfield_scale,
};
use crate::layout::{Layout, Sharing, Widths, halved};
use crate::params::{Directions, Factors};
use crate::{Lightfield, Mesh, wire};

/// Pixels of all maps: red, green and blue.
pub(crate) const PIXEL: PixelInfo =
    PixelInfo { channels: 3, depth: Depth::Eight, color: ColorSpace::Srgb, alpha: Alpha::Opaque };

/// The scale that a byte stands for; 0 stands for 0.
pub(crate) fn scale_of(byte: u8) -> f32 {
    texfold_lightfield_scale(u32::from(byte))
}

/// The least scale of at least `value`; the largest where there is none, 0 for less than the least.
pub(crate) fn byte_of(value: f32) -> u8 {
    if value < scale_of(1) { 0 } else { (1..=255).find(|&byte| scale_of(byte) >= value).unwrap_or(255) }
}

/// The byte of a map that stands for 0, and bytes from there to the one that stands for 1.
pub(crate) fn zero_and_range(factors: Factors) -> (f32, f32) {
    match factors {
        Factors::Signed => (128.0, 127.0),
        Factors::NonNegative => (0.0, 255.0),
    }
}

/// What a light field is put together of.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Parts {
    pub(crate) mesh: Mesh,
    /// Binary logarithm of the side of each triangle's patch.
    pub(crate) sides_log2: Vec<u8>,
    /// How often these are halved for surface maps.
    pub(crate) halvings: u8,
    pub(crate) directions: Directions,
    pub(crate) factors: Factors,
    pub(crate) grid: u32,
    /// Terms of the whole file.
    pub(crate) total_terms: u32,
    /// Terms that are there.
    pub(crate) terms: u32,
    /// Scales of the terms that are there: term by term, vertex by vertex, red, green and blue.
    pub(crate) scales: Vec<u8>,
    /// Which maps show what: of the mean, then of the terms that are there.
    pub(crate) layers: Vec<Sharing>,
    pub(crate) widths: Widths,
    pub(crate) mean: ContentPlanes,
    pub(crate) surface: ContentPlanes,
    pub(crate) view: ContentPlanes,
}

/// An encoded surface light field.
#[derive(Debug, Clone)]
pub struct LightTexture {
    pub(crate) parts: Parts,
    layout: LightLayout,
    params: TexfoldLightfieldParams,
    words: Vec<u32>,
    mean: Vec<Texel>,
    surface: Vec<Texel>,
    view: Vec<Texel>,
    notes: Notes,
}

/// Columns and rows of the mean's atlas.
pub(crate) fn mean_size(layout: &Layout, widths: Widths) -> (u32, u32) {
    (widths.mean, layout.mean_rows().max(4))
}

/// Columns and rows of the surface maps' atlas; at least a block, as a texture has texels.
pub(crate) fn surface_size(layout: &Layout, widths: Widths, terms: u32) -> (u32, u32) {
    (widths.surface, layout.rows(terms).0.max(4))
}

/// Columns and rows of the view maps' atlas; likewise.
pub(crate) fn view_size(layout: &Layout, widths: Widths, terms: u32) -> (u32, u32) {
    (widths.view, layout.rows(terms).1.max(4))
}

impl LightTexture {
    /// From parts that fit each other: lengths and sizes as `layout` has them.
    pub(crate) fn new(parts: Parts, layout: &Layout, notes: Notes) -> LightTexture {
        let (vertices, triangles) = (parts.mesh.positions.len() as u32, parts.mesh.triangles.len() as u32);
        let directions = match parts.directions {
            Directions::View => TEXFOLD_LIGHTFIELD_VIEW,
            Directions::Reflected => TEXFOLD_LIGHTFIELD_REFLECTED,
            Directions::World => TEXFOLD_LIGHTFIELD_WORLD,
        };
        let params = TexfoldLightfieldParams {
            vertices,
            triangles,
            terms: parts.terms,
            stored_terms: parts.terms,
            directions,
            grid: parts.grid,
            mean_swizzle: parts.mean.swizzle().0,
            map_swizzle: parts.surface.swizzle().0,
            map_zero: zero_and_range(parts.factors).0,
            map_range: zero_and_range(parts.factors).1,
            halvings: u32::from(parts.halvings),
            reserved: 0,
        };
        LightTexture {
            layout: LightLayout { triangles, terms: parts.terms },
            params,
            words: words(&parts, layout),
            mean: parts.mean.decode(),
            surface: parts.surface.decode(),
            view: parts.view.decode(),
            parts,
            notes,
        }
    }

    /// The mesh that the light field lies on.
    #[must_use]
    pub fn mesh(&self) -> &Mesh {
        &self.parts.mesh
    }

    /// What view maps are laid over.
    #[must_use]
    pub fn directions(&self) -> Directions {
        self.parts.directions
    }

    /// Which signs the factors have.
    #[must_use]
    pub fn factors(&self) -> Factors {
        self.parts.factors
    }

    /// Texels a side of a view map.
    #[must_use]
    pub fn grid(&self) -> u32 {
        self.parts.grid
    }

    /// How the maps are stored.
    #[must_use]
    pub fn content(&self) -> Content {
        self.parts.surface.content()
    }

    /// How many terms each vertex has.
    #[must_use]
    pub fn terms_of_vertices(&self) -> Vec<u32> {
        let has = |vertex: usize, term: u32| {
            let first = 3 * (term as usize * self.parts.mesh.positions.len() + vertex);
            self.parts.scales[first..first + 3] != [0; 3]
        };
        let count = |vertex| (0..self.params.terms).filter(|&term| has(vertex, term)).count() as u32;
        (0..self.parts.mesh.positions.len()).map(count).collect()
    }

    /// The same light field drawn with at most `terms` terms beside the mean.
    #[must_use]
    pub fn first_terms(mut self, terms: u32) -> LightTexture {
        self.params.terms = self.params.terms.min(terms);
        self.layout.terms = self.params.terms;
        self
    }

    /// The same light field with the first `terms` terms alone, as a file of its own.
    #[must_use]
    pub fn truncated(self, terms: u32) -> LightTexture {
        if terms >= self.parts.terms {
            return self;
        }
        let Parts { grid, widths, mut scales, mut layers, surface, view, .. } = self.parts;
        layers.truncate(terms as usize + 1);
        scales.truncate(3 * (terms * self.params.vertices) as usize);
        // Where all terms fit a texture, fewer do.
        let coarse = halved(&self.parts.sides_log2, self.parts.halvings);
        let sides = [&self.parts.sides_log2[..], &coarse];
        let layout = Layout::new(sides, &layers, widths, grid).unwrap_or_default();
        let surface = first_rows(&surface, surface_size(&layout, widths, terms));
        let view = first_rows(&view, view_size(&layout, widths, terms));
        let parts = Parts { terms, total_terms: terms, scales, layers, surface, view, ..self.parts };
        LightTexture::new(parts, &layout, self.notes)
    }

    /// Replaces the notes.
    #[must_use]
    pub fn with_notes(mut self, notes: Notes) -> LightTexture {
        self.notes = notes;
        self
    }

    /// The light field as the shader sees it.
    #[must_use]
    pub fn view(&self) -> LightfieldView<'_> {
        LightfieldView {
            params: self.params,
            mesh: &self.words,
            mean: &self.mean,
            mean_width: self.parts.widths.mean,
            surface: &self.surface,
            surface_width: self.parts.widths.surface,
            view: &self.view,
            view_width: self.parts.widths.view,
        }
    }
}

/// The upper rows of planes.
fn first_rows(planes: &ContentPlanes, size: (u32, u32)) -> ContentPlanes {
    let bytes = |(format, bytes): &(PlaneFormat, Vec<u8>)| {
        let length = (format.bytes(size.0, size.1) as usize).min(bytes.len());
        bytes[..length].to_vec()
    };
    let first = planes.planes().iter().map(bytes).collect();
    ContentPlanes::from_planes(planes.content(), PIXEL, size, first).unwrap_or_else(|| planes.clone())
}

/// The mesh as the shader reads it.
fn words(parts: &Parts, layout: &Layout) -> Vec<u32> {
    let vertices = parts.mesh.positions.len();
    let mut words = Vec::new();
    for (vertex, (position, normal)) in parts.mesh.positions.iter().zip(parts.mesh.normals()).enumerate() {
        words.extend(position.to_array().map(f32::to_bits));
        words.extend(normal.to_array().map(f32::to_bits));
        for term in 0..parts.terms as usize {
            let first = 3 * (term * vertices + vertex);
            let scales = &parts.scales[first..first + 3];
            words.push(u32::from_le_bytes([scales[0], scales[1], scales[2], 0]));
            words.push(layout.views[term + 1][vertex]);
        }
    }
    for (triangle, (corners, &place)) in parts.mesh.triangles.iter().zip(&layout.patches[0]).enumerate() {
        words.extend(corners);
        words.push(place);
        for term in &layout.patches[1..] {
            words.extend(&term[3 * triangle..3 * triangle + 3]);
        }
    }
    words
}

impl Encoded for LightTexture {
    type Domain = SurfaceLight;

    fn codec(&self) -> CodecId {
        Lightfield::ID
    }

    fn layout(&self) -> &LightLayout {
        &self.layout
    }

    /// The mean is the first layer, each term a further one.
    fn layers(&self) -> Layers {
        Layers { loaded: self.params.terms + 1, total: self.parts.total_terms + 1 }
    }

    fn sample(&self, at: LightAddress) -> Texel {
        let triangle = at.triangle.min(self.layout.triangles - 1);
        let barycentric = if at.barycentric.is_finite() { at.barycentric } else { Vec3::X };
        let barycentric = barycentric.clamp(Vec3::ZERO, Vec3::ONE);
        let direction = at.direction.try_normalize().unwrap_or(Vec3::Z);
        texfold_lightfield_sample(&self.view(), triangle, barycentric, direction)
    }

    fn decode(&self, region: &[LightAddress], out: &mut [Texel]) -> Result<(), RegionError> {
        if out.len() != SurfaceLight::len(region) {
            return Err(RegionError::OutputLength { found: out.len(), needed: region.len() });
        }
        for (texel, &address) in out.iter_mut().zip(region) {
            *texel = self.sample(address);
        }
        Ok(())
    }

    fn store(&self, out: &mut SectionWriter) {
        self.notes.write(out);
        wire::store(&self.parts, out);
    }

    fn footprint(&self) -> Footprint {
        Footprint::measure(self, &self.gpu())
    }

    fn gpu(&self) -> GpuForm<'_> {
        let mut words = self.words.clone();
        words.resize(words.len().next_multiple_of(TEXFOLD_LIGHTFIELD_ROW as usize), 0);
        let mut planes = vec![Plane {
            part: "mesh",
            format: PlaneFormat::R32Uint,
            width: TEXFOLD_LIGHTFIELD_ROW,
            height: words.len() as u32 / TEXFOLD_LIGHTFIELD_ROW,
            levels: 1,
            data: Cow::Owned(words.iter().flat_map(|word| word.to_le_bytes()).collect()),
        }];
        let mut bound = vec![0];
        for (part, content) in [
            ("mean", &self.parts.mean),
            ("surface maps", &self.parts.surface),
            ("view maps", &self.parts.view),
        ] {
            let first = planes.len();
            planes.extend(content.gpu_planes(part));
            // Where there is one plane, both bindings read it.
            bound.extend([first, planes.len() - 1]);
        }
        let uniforms = bytemuck::bytes_of(&self.params).to_vec();
        let binding = SurfaceBinding { planes: bound, uniforms: 0..uniforms.len(), surface: 0 };
        GpuForm { module: "lightfield", planes, uniforms, surfaces: vec![binding] }
    }

    fn notes(&self) -> &Notes {
        &self.notes
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
