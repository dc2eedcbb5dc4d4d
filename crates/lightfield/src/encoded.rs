//! The shipped form: a mesh, its mean, and for each term surface maps and view maps.
//!
//! What is held after loading is what files and GPUs hold; the tables that the CPU decoder reads, several times as large, are made when the first
//! texel is sampled.

use std::borrow::Cow;
use std::sync::OnceLock;

use glam::Vec3;
use texfold_bc::{Content, ContentPlanes};
use texfold_core::container::SectionWriter;
use texfold_core::{
    Access, CodecId, Domain, Encoded, Footprint, GpuDct, GpuForm, ImageBinding, Layers, LightAddress,
    LightLayout, Notes, Plane, PlaneFormat, RegionError, SurfaceLight, Texel, TextureCodec,
};
use texfold_dct::DctContent;

use crate::decode::{
    LightfieldView, TEXFOLD_LIGHTFIELD_ROW, TexfoldLightfieldParams, texfold_lightfield_sample,
};
use crate::kinds::{Directions, Factors};
use crate::parts::{
    Atlas, MAPS_PART, MEAN_PART, PIXEL, Parts, Payload, SURFACE_PART, VIEW_PART, zero_and_range,
};
use crate::{Lightfield, Mesh, wire};

/// An encoded surface light field.
#[derive(Debug, Clone)]
pub struct LightTexture {
    pub(crate) parts: Parts,
    layout: LightLayout,
    params: TexfoldLightfieldParams,
    tables: OnceLock<Tables>,
    notes: Notes,
}

/// What the CPU decoder reads.
#[derive(Debug, Clone)]
struct Tables {
    /// The mesh as the shader reads it.
    words: Vec<u32>,
    mean: Vec<Texel>,
    surface: Vec<Texel>,
    view: Vec<Texel>,
}

impl LightTexture {
    /// From parts that fit each other: lengths and sizes as [`Parts::layout`] has them.
    pub(crate) fn new(parts: Parts, notes: Notes) -> LightTexture {
        let (vertices, triangles) = (parts.mesh.positions.len() as u32, parts.mesh.triangles.len() as u32);
        let [mean_swizzle, map_swizzle] = parts.swizzles();
        let params = TexfoldLightfieldParams {
            vertices,
            triangles,
            terms: parts.terms,
            stored_terms: parts.terms,
            directions: parts.directions.number(),
            grid: parts.grid,
            mean_swizzle,
            map_swizzle,
            map_zero: zero_and_range(parts.factors).0,
            map_range: zero_and_range(parts.factors).1,
            reduce_log2: u32::from(parts.surface_reduce_log2),
            reserved: 0,
        };
        LightTexture {
            layout: LightLayout { triangles, terms: parts.terms },
            params,
            tables: OnceLock::new(),
            parts,
            notes,
        }
    }

    fn tables(&self) -> &Tables {
        self.tables.get_or_init(|| Tables {
            words: words(&self.parts),
            mean: self.parts.texels(Atlas::Mean),
            surface: self.parts.texels(Atlas::Surface),
            view: self.parts.texels(Atlas::View),
        })
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

    /// How the maps are stored in planes; `None` where they are in blocks of variable length.
    #[must_use]
    pub fn content(&self) -> Option<Content> {
        match &self.parts.payload {
            Payload::Planes { surface, .. } => Some(surface.content()),
            Payload::Blocks { .. } => None,
        }
    }

    /// How the maps are stored, and so how a GPU reaches their texels.
    #[must_use]
    pub fn access(&self) -> Access {
        if self.content().is_some() { Access::Texel } else { Access::Block }
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
        let mut parts = self.parts;
        parts.layers.truncate(terms as usize + 1);
        parts.scales.truncate(3 * (terms * self.params.vertices) as usize);
        (parts.terms, parts.total_terms) = (terms, terms);
        let layout = parts.layout();
        let sizes = [Atlas::Surface, Atlas::View].map(|atlas| parts.size_of(&layout, atlas));
        match &mut parts.payload {
            Payload::Planes { surface, view, .. } => {
                *surface = first_rows(surface, sizes[0]);
                *view = first_rows(view, sizes[1]);
            }
            Payload::Blocks { terms: contents, .. } => contents.truncate(terms as usize),
        }
        LightTexture::new(parts, self.notes)
    }

    /// Replaces the notes.
    #[must_use]
    pub fn with_notes(mut self, notes: Notes) -> LightTexture {
        self.notes = notes;
        self
    }

    /// The light field as the shader sees it. The first call decodes all maps to texels.
    #[must_use]
    pub fn view(&self) -> LightfieldView<'_> {
        let Tables { words, mean, surface, view } = self.tables();
        LightfieldView {
            params: self.params,
            mesh: words,
            mean,
            mean_width: self.parts.widths.mean,
            surface,
            surface_width: self.parts.widths.surface,
            view,
            view_width: self.parts.widths.view,
        }
    }

    /// Blocks of all atlases as a GPU needs them; which of the decoded textures the shader's six are.
    fn push_blocks<'a>(
        &'a self,
        contents: (&'a DctContent, &'a [Option<DctContent>]),
        blocks: &mut Vec<GpuDct<'a>>,
    ) -> [usize; 6] {
        let layout = self.parts.layout();
        let atlases = [(Atlas::Mean, MEAN_PART), (Atlas::Surface, MAPS_PART), (Atlas::View, MAPS_PART)];
        let mut next = 0;
        let images = atlases.map(|(atlas, part)| {
            let bands = self.parts.bands(&layout, contents, atlas);
            // Without maps nothing is read there.
            let image = if bands.is_empty() { 0 } else { next };
            next += usize::from(!bands.is_empty());
            for (row, content, surface) in bands {
                let of_band = content.gpu().filter(|blocks| blocks.image == surface as usize);
                blocks.extend(of_band.map(|blocks| {
                    let bytes = blocks.held_bytes.iter().map(|(_, bytes)| bytes).sum();
                    GpuDct { image, row, held_bytes: vec![(part, bytes)], ..blocks }
                }));
            }
            image
        });
        [images[0], images[0], images[1], images[1], images[2], images[2]]
    }

    /// As [`LightTexture::view`], with at most `terms` terms beside the mean.
    #[cfg(feature = "encode")]
    pub(crate) fn view_of_terms(&self, terms: u32) -> LightfieldView<'_> {
        let whole = self.view();
        let params = TexfoldLightfieldParams { terms: self.params.terms.min(terms), ..self.params };
        LightfieldView { params, ..whole }
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

/// The mesh as the shader reads it, in whole rows of the texture that holds it.
fn words(parts: &Parts) -> Vec<u32> {
    let layout = parts.layout();
    let vertices = parts.mesh.positions.len();
    let mut words = Vec::new();
    words.reserve_exact(parts.words() as usize);
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
    words.resize(words.len().next_multiple_of(TEXFOLD_LIGHTFIELD_ROW as usize), 0);
    words
}

/// Words as the bytes of a plane, the lowest first: borrowed where the machine keeps them so.
fn bytes_of(words: Cow<'_, [u32]>) -> Cow<'_, [u8]> {
    match words {
        Cow::Borrowed(words) if cfg!(target_endian = "little") => Cow::Borrowed(bytemuck::cast_slice(words)),
        words => Cow::Owned(words.iter().flat_map(|word| word.to_le_bytes()).collect()),
    }
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

    fn texel(&self, at: LightAddress) -> Texel {
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
            *texel = self.texel(address);
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
        let words = match self.tables.get() {
            Some(tables) => Cow::Borrowed(&tables.words[..]),
            None => Cow::Owned(words(&self.parts)),
        };
        let mut planes = vec![Plane {
            part: "mesh",
            format: PlaneFormat::R32Uint,
            width: TEXFOLD_LIGHTFIELD_ROW,
            height: words.len() as u32 / TEXFOLD_LIGHTFIELD_ROW,
            levels: 1,
            data: bytes_of(words),
        }];
        let mut bound = vec![0];
        let mut blocks = Vec::new();
        match &self.parts.payload {
            Payload::Planes { mean, surface, view } => {
                for (part, content) in [(MEAN_PART, mean), (SURFACE_PART, surface), (VIEW_PART, view)] {
                    let first = planes.len();
                    planes.extend(content.gpu_planes(part));
                    // Where there is one plane, both bindings read it.
                    bound.extend([first, planes.len() - 1]);
                }
            }
            Payload::Blocks { mean, terms } => {
                bound.extend(self.push_blocks((mean, terms), &mut blocks).map(|image| planes.len() + image));
            }
        }
        let uniforms = bytemuck::bytes_of(&self.params).to_vec();
        let binding = ImageBinding { planes: bound, uniforms: 0..uniforms.len(), image: 0 };
        GpuForm { planes, uniforms, images: vec![binding], blocks, ..GpuForm::new("lightfield") }
    }

    fn notes(&self) -> &Notes {
        &self.notes
    }
}
