//! The form that is read texel by texel: residual content, and where codebooks are drawn, those and a map for each image.

use std::sync::Arc;

use glam::{IVec2, UVec2, Vec2, Vec4};
use texfold_bc::Content;
use texfold_core::RESIDUAL_PART;
use texfold_core::address::{TEXFOLD_CLAMP, texfold_inside, texfold_level_size};
use texfold_core::container::{SectionWriter, Sections, read_layout, write_layout};
use texfold_core::sample::texfold_bilinear;
use texfold_core::{
    Budget, CodecId, Domain, Encoded, Footprint, GpuForm, Image2d, ImageAddress, ImageBinding, ImageLayout,
    Layers, LoadError, Notes, Plane, Rect, Refine, RegionError, Texel, TextureCodec, word_plane,
};
use texfold_residual::{RateModel, ResidualContent};

use crate::codebook::{Codebook, Details, MAP_PART, PRIVATE_PART, PUBLIC_PART};
use crate::decode::{
    ProgressiveView, TexfoldProgressiveParams, texfold_progressive_detail, texfold_progressive_fetch,
    texfold_progressive_load, texfold_progressive_taps,
};
use crate::{Progressive, wire};

/// Images stored as residual content with details, read texel by texel.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgressiveTexture {
    /// The images, levels that are not stored among them.
    layout: ImageLayout,
    pub(crate) content: ResidualContent,
    /// Codebooks and maps, where blocks use any.
    details: Option<Details>,
    params: Vec<TexfoldProgressiveParams>,
    pub(crate) notes: Notes,
}

impl ProgressiveTexture {
    /// Loads a texture; `public` is the codebook that it shares with others, or one that grew from it.
    pub(crate) fn load(
        file: &Sections<'_>,
        public: Option<&Codebook>,
        budget: &mut Budget,
    ) -> Result<Self, LoadError> {
        let notes = Notes::read(file, budget)?;
        let layout = read_layout(file, budget)?;
        let (content, details) = wire::load(&layout, file, public, budget)?;
        Ok(ProgressiveTexture::new(layout, content, details, notes))
    }

    /// Of images of that layout, whose stored levels are those of `content`.
    pub(crate) fn new(
        layout: ImageLayout,
        content: ResidualContent,
        details: Option<Details>,
        notes: Notes,
    ) -> Self {
        let params = |image: usize| params_of(&layout, &content, details.as_ref(), image);
        let params = (0..layout.images.len()).map(params).collect();
        ProgressiveTexture { layout, content, details, params, notes }
    }

    /// The same images and details with other residual content of the same layout.
    pub(crate) fn with_content(&self, content: ResidualContent) -> Self {
        ProgressiveTexture { content, ..self.clone() }
    }

    /// Base and residual plane.
    #[must_use]
    pub fn content(&self) -> &ResidualContent {
        &self.content
    }

    /// Codebooks and maps, where blocks use any.
    #[must_use]
    pub fn details(&self) -> Option<&Details> {
        self.details.as_ref()
    }

    /// How the base is stored.
    #[must_use]
    pub fn base_content(&self) -> Content {
        self.content.form().content
    }

    /// Log2 downscale of the base's width and height.
    #[must_use]
    pub fn reduce_log2(&self) -> u32 {
        self.content.form().reduce_log2
    }

    /// Number of finest mip levels not stored; they are upsampled from the finest stored one.
    #[must_use]
    pub fn shrink_log2(&self) -> u32 {
        self.content.form().shrink_log2
    }

    /// What all blocks of the residual planes share.
    #[must_use]
    pub fn model(&self) -> &RateModel {
        self.content.model()
    }

    /// Rate class of each block of an image, level after level, each row by row; nothing where no residual plane is
    /// loaded.
    #[must_use]
    pub fn classes(&self, image: u32) -> Vec<u8> {
        self.content.classes(image)
    }

    /// The levels that are stored.
    pub(crate) fn stored(&self) -> &ImageLayout {
        self.content.layout()
    }

    /// Bits of the public codebook, which other textures may share.
    #[must_use]
    pub fn shared_bits(&self) -> u64 {
        let public = self.details.as_ref().and_then(|details| details.public.as_ref());
        public.map_or(0, |book| book.bits_memory())
    }

    /// The texture without codebooks and maps: what its residual plane adds is the same.
    #[must_use]
    pub fn without_details(&self) -> ProgressiveTexture {
        ProgressiveTexture::new(self.layout.clone(), self.content.clone(), None, self.notes.clone())
    }

    /// The texture as it is with the first `count` layers of its file, at least one.
    #[must_use]
    pub fn first_layers(&self, count: u32) -> ProgressiveTexture {
        if count < 2 { self.with_content(self.content.base_alone()) } else { self.clone() }
    }

    /// The notes, for a caller that has more to say.
    #[must_use]
    pub fn notes_mut(&mut self) -> &mut Notes {
        &mut self.notes
    }

    /// Replaces the notes.
    #[must_use]
    pub fn with_notes(mut self, notes: Notes) -> Self {
        self.notes = notes;
        self
    }

    /// One image as the shader sees it; the last where there is no such image.
    #[must_use]
    #[inline]
    pub fn view(&self, image: u32) -> ProgressiveView<'_> {
        let place = (image as usize).min(self.params.len().saturating_sub(1));
        let residual = self.content.view(image);
        let params = self.params[place];
        let Some(details) = &self.details else {
            return ProgressiveView { params, residual, entries: &[], codebooks: [&[], &[]] };
        };
        ProgressiveView {
            params,
            residual,
            entries: &details.maps[place].words,
            codebooks: [values(&details.public), values(&details.private)],
        }
    }
}

fn values(book: &Option<Arc<Codebook>>) -> &[f32] {
    book.as_ref().map_or(&[][..], |book| book.values())
}

fn params_of(
    layout: &ImageLayout,
    content: &ResidualContent,
    details: Option<&Details>,
    image: usize,
) -> TexfoldProgressiveParams {
    let size = layout.images[image];
    TexfoldProgressiveParams {
        size: [size.width, size.height],
        levels: layout.levels,
        address_mode: TEXFOLD_CLAMP,
        shrink_log2: content.form().shrink_log2,
        map_form: details.map_or(0, |details| details.form.packed()),
        gain_unit: details.map_or(0.0, Details::unit),
        entry_row_log2: details.map_or(0, |details| details.maps[image].row_log2),
        codebooks: details.map_or([0; 4], Details::sizes),
    }
}

impl Encoded for ProgressiveTexture {
    type Domain = Image2d;

    fn codec(&self) -> CodecId {
        Progressive::ID
    }

    fn layout(&self) -> &ImageLayout {
        &self.layout
    }

    fn layers(&self) -> Layers {
        let total = if self.content.has_planes() { 2 } else { 1 };
        Layers { loaded: if self.content.is_whole() { total } else { 1 }, total }
    }

    fn texel(&self, at: ImageAddress) -> Texel {
        let clamp = |value: u32| i32::try_from(value).unwrap_or(i32::MAX);
        let level = at.level.min(self.layout.levels - 1);
        texfold_progressive_fetch(&self.view(at.image), IVec2::new(clamp(at.x), clamp(at.y)), level)
    }

    fn decode(&self, region: Rect, out: &mut [Texel]) -> Result<(), RegionError> {
        self.layout.check(region)?;
        if out.len() != Image2d::len(region) {
            return Err(RegionError::OutputLength { found: out.len(), needed: Image2d::len(region) });
        }
        if out.is_empty() {
            return Ok(());
        }
        match region.level.checked_sub(self.shrink_log2()) {
            Some(level) => self.decode_stored(Rect { level, ..region }, out),
            None => self.decode_upsampled(region, out),
        }
        Ok(())
    }

    fn store(&self, out: &mut SectionWriter) {
        self.notes.write(out);
        write_layout(&self.layout, out);
        wire::store(&self.content, self.details(), out);
    }

    fn footprint(&self) -> Footprint {
        Footprint::measure(self, &self.gpu())
    }

    fn gpu(&self) -> GpuForm<'_> {
        let mut form = GpuForm::new("progressive");
        let books = self.push_codebooks(&mut form.planes);
        for (image, params) in self.params.iter().enumerate() {
            let residual = self.content.push_planes(image, &mut form.planes);
            // Of what there is none, any is bound.
            let mut map = residual[0];
            if let Some(details) = &self.details {
                let entries = &details.maps[image];
                map = form.planes.len();
                form.planes.push(word_plane(MAP_PART, &entries.words, entries.row_log2));
            }
            let [public, private] = books.map(|book| book.unwrap_or(residual[1]));
            let planes = [&[map, public, private], residual.as_slice()].concat();
            let start = form.uniforms.len();
            form.uniforms.extend(bytemuck::bytes_of(params));
            form.uniforms.extend(self.content.uniforms(image));
            form.images.push(ImageBinding { planes, uniforms: start..form.uniforms.len(), image: 0 });
        }
        form
    }

    fn notes(&self) -> &Notes {
        &self.notes
    }
}

impl Refine for ProgressiveTexture {
    fn refine(&mut self, file: &Sections<'_>, budget: &mut Budget) -> Result<Vec<&'static str>, LoadError> {
        let Some(content) = self.content.with_rest(wire::CONTENT, file, budget)? else {
            return Ok(Vec::new());
        };
        self.content = content;
        Ok(vec![RESIDUAL_PART, "uniforms"])
    }
}

impl ProgressiveTexture {
    /// The texels of a region of a stored level, which lies inside.
    pub(crate) fn decode_stored(&self, region: Rect, out: &mut [Texel]) {
        self.content.decode_base(region, out);
        if self.details.is_some() {
            add_details(&self.view(region.image), region, out);
        }
        self.content.add_residual(region, out);
    }

    /// The texels of a region of a level that is not stored, equal to
    /// [`crate::decode::texfold_progressive_texel`] texel by texel.
    fn decode_upsampled(&self, region: Rect, out: &mut [Texel]) {
        let view = self.view(region.image);
        let full = texfold_level_size(UVec2::from(view.params.size), region.level).as_vec2();
        let size = UVec2::from(view.residual.params.size);
        let tap = |x: u32, y: u32| {
            let uv = (UVec2::new(x, y).as_vec2() + 0.5) / full;
            texfold_progressive_taps(&view, uv, size, TEXFOLD_CLAMP)
        };
        let last = (region.x + region.width - 1, region.y + region.height - 1);
        let (low, high) = (tap(region.x, region.y).low, tap(last.0, last.1).high);
        let texels = self.decode_padded(region.image, low, high);
        let width = (high.x - low.x + 1) as usize;
        let columns: Vec<_> = (region.x..=last.0).map(|x| tap(x, region.y)).collect();
        for (y, line) in (region.y..).zip(out.chunks_exact_mut(region.width as usize)) {
            let rows = tap(region.x, y);
            let row = |y: i32| &texels[(y - low.y) as usize * width..][..width];
            let (upper, lower) = (row(rows.low.y), row(rows.high.y));
            for (texel, tap) in line.iter_mut().zip(&columns) {
                let (left, right) = ((tap.low.x - low.x) as usize, (tap.high.x - low.x) as usize);
                let four = [upper[left], upper[right], lower[left], lower[right]];
                *texel = texfold_bilinear(four, Vec2::new(tap.weight.x, rows.weight.y));
            }
        }
    }

    /// The texels from `low` to `high` of the finest stored level, row by row. Both lie inside or a texel beyond a border.
    fn decode_padded(&self, image: u32, low: IVec2, high: IVec2) -> Vec<Texel> {
        let view = self.view(image);
        let size = UVec2::from(view.residual.params.size);
        let (first, last) = (texfold_inside(low, size), texfold_inside(high, size));
        let (width, height) = (last.x - first.x + 1, last.y - first.y + 1);
        let stored = Rect { image, level: 0, x: first.x, y: first.y, width, height };
        let mut inside = vec![Texel::ZERO; Image2d::len(stored)];
        self.decode_stored(stored, &mut inside);
        if first.as_ivec2() == low && last.as_ivec2() == high {
            return inside;
        }
        let texel = |at: IVec2| {
            let place = at - first.as_ivec2();
            match texfold_inside(at, size).as_ivec2() == at {
                true => inside[(place.y * width as i32 + place.x) as usize],
                false => texfold_progressive_load(&view, at, 0),
            }
        };
        let row = |y: i32| (low.x..=high.x).map(move |x| IVec2::new(x, y));
        (low.y..=high.y).flat_map(row).map(texel).collect()
    }

    /// Adds the planes of the codebooks; which they are.
    fn push_codebooks<'a>(&'a self, planes: &mut Vec<Plane<'a>>) -> [Option<usize>; 2] {
        let Some(details) = &self.details else { return [None; 2] };
        let mut push = |book: &'a Option<Arc<Codebook>>, part| {
            planes.extend(book.as_ref()?.planes().gpu_planes(part));
            Some(planes.len() - 1)
        };
        [push(&details.public, PUBLIC_PART), push(&details.private, PRIVATE_PART)]
    }
}

/// Adds what codebooks contribute in `region`.
fn add_details(view: &ProgressiveView<'_>, region: Rect, out: &mut [Texel]) {
    for (y, line) in (region.y..).zip(out.chunks_exact_mut(region.width as usize)) {
        for (x, texel) in (region.x..).zip(line) {
            let detail = texfold_progressive_detail(view, UVec2::new(x, y), region.level);
            *texel = (*texel + Vec4::new(detail, detail, detail, 0.0)).clamp(Vec4::ZERO, Vec4::ONE);
        }
    }
}
