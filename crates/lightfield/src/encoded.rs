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
    TexfoldLightfieldParams, texfold_lightfield_sample,
};
use crate::layout::Layout;
use crate::params::{Directions, Factors};
use crate::{Lightfield, Mesh, wire};

/// Pixels of all maps: red, green and blue.
pub(crate) const PIXEL: PixelInfo =
    PixelInfo { channels: 3, depth: Depth::Eight, color: ColorSpace::Srgb, alpha: Alpha::Opaque };

/// Steps of scales to an octave: the step of 2^(1/8) costs at most 0.13 bits of a map's 8.
const STEPS: [f32; 8] = [
    1.0,
    1.090_507_7,
    1.189_207_1,
    1.296_839_6,
    std::f32::consts::SQRT_2,
    1.542_210_8,
    1.681_792_9,
    1.834_008,
];
/// Binary logarithm of the least scale: smaller terms change no byte of a colour.
const LEAST_LOG2: i32 = -26;

/// The scale that a byte stands for; 0 stands for 0.
pub(crate) fn scale_of(byte: u8) -> f32 {
    match byte.checked_sub(1) {
        None => 0.0,
        Some(step) => {
            STEPS[usize::from(step % 8)]
                * f32::from_bits(((127 + LEAST_LOG2 + i32::from(step / 8)) as u32) << 23)
        }
    }
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
    pub(crate) directions: Directions,
    pub(crate) factors: Factors,
    pub(crate) grid: u32,
    /// Terms of the whole file.
    pub(crate) total_terms: u32,
    /// Terms that are there.
    pub(crate) terms: u32,
    /// Scales of the terms that are there: term by term, vertex by vertex, red, green and blue.
    pub(crate) scales: Vec<u8>,
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
pub(crate) fn mean_size(layout: &Layout) -> (u32, u32) {
    (layout.surface_width, layout.surface_height)
}

/// Columns and rows of the surface maps' atlas; of a block without terms, as a texture has texels.
pub(crate) fn surface_size(layout: &Layout, terms: u32) -> (u32, u32) {
    if terms == 0 { (4, 4) } else { (3 * layout.surface_width, terms * layout.surface_height) }
}

/// Columns and rows of the view maps' atlas.
pub(crate) fn view_size(layout: &Layout, grid: u32, terms: u32) -> (u32, u32) {
    if terms == 0 { (4, 4) } else { (layout.view_columns * grid, terms * layout.view_height) }
}

impl LightTexture {
    /// From parts that fit each other: lengths and sizes as `layout` has them.
    pub(crate) fn new(parts: Parts, layout: &Layout, notes: Notes) -> LightTexture {
        let (vertices, triangles) = (parts.mesh.positions.len() as u32, parts.mesh.triangles.len() as u32);
        let directions = match parts.directions {
            Directions::View => TEXFOLD_LIGHTFIELD_VIEW,
            Directions::Reflected => TEXFOLD_LIGHTFIELD_REFLECTED,
        };
        let params = TexfoldLightfieldParams {
            vertices,
            triangles,
            terms: parts.terms,
            stored_terms: parts.terms,
            directions,
            grid: parts.grid,
            view_columns: layout.view_columns,
            view_height: layout.view_height,
            surface_width: layout.surface_width,
            surface_height: layout.surface_height,
            mean_swizzle: parts.mean.swizzle().0,
            map_swizzle: parts.surface.swizzle().0,
            map_zero: zero_and_range(parts.factors).0,
            map_range: zero_and_range(parts.factors).1,
            reserved: [0; 2],
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

    /// The same light field drawn with at most `terms` terms beside the mean.
    #[must_use]
    pub fn first_terms(mut self, terms: u32) -> LightTexture {
        self.params.terms = self.params.terms.min(terms);
        self.layout.terms = self.params.terms;
        self
    }

    /// The same light field with the first `terms` terms alone, as a file of its own.
    #[must_use]
    pub(crate) fn truncated(self, terms: u32) -> LightTexture {
        let Parts { grid, mut scales, surface, view, .. } = self.parts;
        let layout = Layout::new(&self.parts.sides_log2, self.params.vertices, grid, terms);
        let Some(layout) = layout.filter(|_| terms < self.parts.terms) else {
            return LightTexture { parts: Parts { scales, surface, view, ..self.parts }, ..self };
        };
        scales.truncate(3 * (terms * self.params.vertices) as usize);
        let surface = first_rows(&surface, surface_size(&layout, terms));
        let view = first_rows(&view, view_size(&layout, grid, terms));
        let parts = Parts { terms, total_terms: terms, scales, surface, view, ..self.parts };
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
            surface: &self.surface,
            view: &self.view,
        }
    }
}

/// The upper left part of planes that is as wide as they are, or of one block.
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
            words.extend(parts.scales[first..first + 3].iter().map(|&byte| scale_of(byte).to_bits()));
        }
    }
    for (triangle, &place) in parts.mesh.triangles.iter().zip(&layout.places) {
        words.extend(triangle);
        words.push(place);
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
