//! The shipped form: for each image a base with its levels, and the blocks of its error map.

use std::borrow::Cow;

use glam::{IVec2, UVec2, Vec4};
use texfold_bc::ContentPlanes;
use texfold_core::address::{TEXFOLD_CLAMP, texfold_inside, texfold_level_size};
use texfold_core::container::{SectionWriter, Sections, write_layout};
use texfold_core::sample::texfold_bilinear;
use texfold_core::{
    Budget, CodecId, Domain, Encoded, Footprint, GpuForm, Image2d, ImageAddress, ImageLayout, Layers,
    LoadError, MAX_PLANE_SIDE, Notes, Plane, Rect, Refine, RegionError, SurfaceBinding, SurfaceSize, Texel,
    TextureCodec, WordRows, word_plane,
};

use crate::codebook::Details;
use crate::decode::{
    ProgressiveView, TEXFOLD_PROGRESSIVE_GROUP_WORDS, TexfoldProgressiveParams, add_block, margin,
    texfold_progressive_block, texfold_progressive_detail, texfold_progressive_fetch,
    texfold_progressive_load, texfold_progressive_tap, texfold_progressive_taps,
};
use crate::rates::Model;
use crate::{Progressive, wire};

/// Texels a side of a block of the error map.
pub const BLOCK_SIDE: u32 = 8;
/// Blocks of a group.
pub(crate) const GROUP: usize = 16;

/// Columns and rows of blocks that cover an image of that size.
pub(crate) fn blocks_of(size: SurfaceSize) -> (u32, u32) {
    (size.width.div_ceil(BLOCK_SIDE), size.height.div_ceil(BLOCK_SIDE))
}

/// Levels of the base of an image: no further ones than down to 1x1, which those behind it show.
pub(crate) fn base_levels(size: SurfaceSize, reduce_log2: u32, levels: u32) -> u32 {
    levels.min(size.at_level(reduce_log2).full_levels())
}

/// The blocks of the error map of one image, level after level, each row by row.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct ErrorMap {
    /// Class of each block.
    pub(crate) classes: Vec<u8>,
    /// Scale of each block, 0 to 15: 2^(scale / 2).
    pub(crate) scales: Vec<u8>,
    /// Bits of all blocks, 16 at a time.
    pub(crate) bits: Vec<u16>,
}

/// The levels of images that are stored where the first `shrink_log2` are not.
pub(crate) fn stored_layout(full: &ImageLayout, shrink_log2: u32) -> ImageLayout {
    ImageLayout {
        surfaces: full.surfaces.iter().map(|size| size.at_level(shrink_log2)).collect(),
        levels: full.levels.saturating_sub(shrink_log2).max(1),
        pixel: full.pixel,
    }
}

impl ErrorMap {
    /// The words of the map plane and the first bit of the blocks' bits; `None` where a plane cannot hold them.
    pub(crate) fn words(&self, class_bits: u32) -> Option<(Vec<u32>, u32)> {
        let mut words = Vec::new();
        let mut start = 0u32;
        for (classes, scales) in self.classes.chunks(GROUP).zip(self.scales.chunks(GROUP)) {
            let pack = |values: &[u8]| (0..).zip(values).map(|(n, &v)| u32::from(v) << (4 * n)).sum::<u32>();
            let halves = |values: &[u8]| {
                let (low, high) = values.split_at(values.len().min(8));
                [pack(low), pack(high)]
            };
            words.push(start);
            words.extend(halves(classes));
            words.extend(halves(scales));
            let sum: u32 = classes.iter().map(|&class| u32::from(class)).sum();
            start = start.checked_add(sum.checked_mul(class_bits / 16)?)?;
        }
        let first_bit = u32::try_from(words.len() as u64 * 32).ok()?;
        words.extend(
            self.bits
                .chunks(2)
                .map(|pair| u32::from(pair[0]) | u32::from(pair.get(1).copied().unwrap_or(0)) << 16),
        );
        (words.len() <= (MAX_PLANE_SIDE as usize).pow(2)).then_some((words, first_bit))
    }
}

/// Texels of level 0 of a base that goes on beyond the borders of its image: a block of it, so that the same blocks cover the same place in
/// an image and in the one beside it.
pub(crate) const MARGIN: u32 = 4;

/// What is stored of a texture.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Parts {
    /// The images.
    pub(crate) layout: ImageLayout,
    /// Halvings of width and height of the largest level that is stored.
    pub(crate) shrink_log2: u32,
    /// The levels that are stored: all else here is of these.
    pub(crate) stored: ImageLayout,
    /// Halvings of the base's width and height.
    pub(crate) reduce_log2: u32,
    /// Whether the base is blended within blocks of 8x8 texels alone, so that they may lie beside any others.
    pub(crate) apart: bool,
    /// Texels of the base beyond each border, so that neighbours show the same there: 0 or [`MARGIN`].
    pub(crate) margin: u32,
    pub(crate) model: Model,
    /// For each image the planes of its base's levels.
    pub(crate) bases: Vec<Vec<ContentPlanes>>,
    /// Codebooks and maps, where blocks show any.
    pub(crate) details: Option<Details>,
    /// For each image its error map; none where the file has not brought it yet.
    pub(crate) maps: Vec<ErrorMap>,
}

/// Images stored as a base and an error map.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgressiveTexture {
    pub(crate) parts: Parts,
    /// For each image the error map plane's words.
    words: Vec<Vec<u32>>,
    /// For each image the map plane's words; nothing where there is no map.
    entries: Vec<Vec<u32>>,
    /// For each image the texels of its base's levels.
    texels: Vec<Vec<Vec<Texel>>>,
    params: Vec<TexfoldProgressiveParams>,
    pub(crate) notes: Notes,
}

impl ProgressiveTexture {
    /// Lays the parts out for sampling; `None` where a map is too large for a plane.
    pub(crate) fn new(parts: Parts, notes: Notes) -> Option<Self> {
        let texels: Vec<Vec<Vec<Texel>>> =
            parts.bases.iter().map(|levels| levels.iter().map(ContentPlanes::decode).collect()).collect();
        ProgressiveTexture::with_texels(parts, texels, notes)
    }

    /// As [`ProgressiveTexture::new`], where the bases are decoded already.
    fn with_texels(parts: Parts, texels: Vec<Vec<Vec<Texel>>>, notes: Notes) -> Option<Self> {
        let mut words = Vec::new();
        let mut entries = Vec::new();
        let mut params = Vec::new();
        for surface in 0..parts.stored.surfaces.len() {
            let (plane, first_bit) = match parts.maps.get(surface) {
                Some(map) => map.words(parts.model.class_bits)?,
                None => (vec![0], 0),
            };
            let (plane, WordRows { row_log2, .. }) = WordRows::padded(plane);
            params.push(parts.params(surface, first_bit, row_log2));
            words.push(plane);
            let map = parts.details.as_ref().map(|details| WordRows::padded(details.words(surface)).0);
            entries.push(map.unwrap_or_default());
        }
        Some(ProgressiveTexture { parts, words, entries, texels, params, notes })
    }

    /// The same bases with an error map; `None` where it is too large for a plane.
    pub(crate) fn with_maps(&self, model: Model, maps: Vec<ErrorMap>) -> Option<Self> {
        let parts = Parts { model, maps, ..self.parts.clone() };
        ProgressiveTexture::with_texels(parts, self.texels.clone(), self.notes.clone())
    }

    /// The same bases with codebooks and maps, and no error map.
    pub(crate) fn with_details(&self, details: Details) -> Option<Self> {
        let parts =
            Parts { model: Model::default(), maps: Vec::new(), details: Some(details), ..self.parts.clone() };
        ProgressiveTexture::with_texels(parts, self.texels.clone(), self.notes.clone())
    }

    /// Bits of the public codebook, which other textures may share.
    #[must_use]
    pub fn shared_bits(&self) -> u64 {
        let public = self.parts.details.as_ref().and_then(|details| details.public.as_ref());
        public.map_or(0, |book| book.planes().planes().iter().map(|(_, bytes)| 8 * bytes.len() as u64).sum())
    }

    /// The texture without codebooks and maps: what its error map adds is the same.
    #[must_use]
    pub fn without_details(&self) -> Option<ProgressiveTexture> {
        let parts = Parts { details: None, ..self.parts.clone() };
        ProgressiveTexture::with_texels(parts, self.texels.clone(), self.notes.clone())
    }

    /// Codebooks and maps, where blocks show any.
    #[must_use]
    pub fn details(&self) -> Option<&Details> {
        self.parts.details.as_ref()
    }

    /// How the base is stored.
    #[must_use]
    pub fn base(&self) -> &ContentPlanes {
        &self.parts.bases[0][0]
    }

    /// Halvings of the base's width and height.
    #[must_use]
    pub fn reduce_log2(&self) -> u32 {
        self.parts.reduce_log2
    }

    /// What all blocks share.
    #[must_use]
    pub fn model(&self) -> &Model {
        &self.parts.model
    }

    /// The class of each block of an image, level after level, each row by row; nothing where there is no error map.
    #[must_use]
    pub fn classes(&self, surface: u32) -> &[u8] {
        self.parts.maps.get(surface as usize).map_or(&[], |map| &map.classes)
    }

    /// The texture as it is with the first `count` layers of its file, at least one.
    #[must_use]
    pub fn first_layers(&self, count: u32) -> ProgressiveTexture {
        let mut cut = self.clone();
        if count < 2 && !cut.parts.maps.is_empty() {
            cut.parts.maps.clear();
            for (surface, words) in cut.words.iter_mut().enumerate() {
                let (plane, WordRows { row_log2, .. }) = WordRows::padded(vec![0]);
                *words = plane;
                cut.params[surface] = cut.parts.params(surface, 0, row_log2);
            }
        }
        cut
    }

    /// Bits in memory of all levels but the first: of the base, and of the error map.
    #[must_use]
    pub fn mip_bits(&self) -> (u64, u64) {
        let bytes =
            |level: &ContentPlanes| level.planes().iter().map(|(_, bytes)| bytes.len() as u64).sum::<u64>();
        let base = self.parts.bases.iter().flat_map(|levels| levels.iter().skip(1)).map(bytes).sum::<u64>();
        let header = u64::from(TEXFOLD_PROGRESSIVE_GROUP_WORDS) * 32 / GROUP as u64;
        let mut map = 0;
        for (size, held) in self.parts.stored.surfaces.iter().zip(&self.parts.maps) {
            let (columns, rows) = blocks_of(*size);
            let further = held.classes.iter().skip((columns * rows) as usize);
            map += further
                .map(|&class| u64::from(class) * u64::from(self.parts.model.class_bits) + header)
                .sum::<u64>();
        }
        (8 * base, map)
    }

    /// Writes the sections of base and error map alone, as content of another codec's file.
    pub fn store_content(&self, out: &mut SectionWriter) {
        wire::store(&self.parts, out);
    }

    /// Reads what [`ProgressiveTexture::store_content`] has written of images of that layout, all of it.
    ///
    /// # Errors
    /// [`LoadError`] where a section is missing or says what no writer says.
    pub fn load_content(
        layout: ImageLayout,
        file: &Sections<'_>,
        budget: &mut Budget,
    ) -> Result<Self, LoadError> {
        wire::load_whole(layout, file, budget)
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
    pub fn view<'a>(&'a self, surface: u32) -> ProgressiveView<'a> {
        let surface = (surface as usize).min(self.params.len() - 1);
        let values =
            |book: &'a Option<std::sync::Arc<crate::Codebook>>| book.as_ref().map_or(&[][..], |b| b.values());
        let codebooks = self.parts.details.as_ref();
        ProgressiveView {
            params: self.params[surface],
            map: &self.words[surface],
            entries: &self.entries[surface],
            codebooks: codebooks.map_or([&[], &[]], |d| [values(&d.public), values(&d.private)]),
            base: &self.texels[surface],
        }
    }
}

/// Words of the map plane of `blocks` blocks that have `halves` times 16 bits.
pub(crate) fn map_words(blocks: usize, halves: u64) -> u64 {
    let headers = blocks.div_ceil(GROUP) * TEXFOLD_PROGRESSIVE_GROUP_WORDS as usize;
    WordRows::of(headers + halves.div_ceil(2) as usize).words as u64
}

impl Parts {
    /// Layers of the whole file.
    pub(crate) fn layers(&self) -> u32 {
        if self.model.class_bits == 0 { 1 } else { 2 }
    }

    fn params(&self, surface: usize, first_bit: u32, row_log2: u32) -> TexfoldProgressiveParams {
        let (size, full) = (self.stored.surfaces[surface], self.layout.surfaces[surface]);
        let base = &self.bases[surface];
        let base_size = base[0].size();
        let mut level_start = [0; 16];
        let mut start = 0;
        for (level, first) in (0..self.stored.levels).zip(&mut level_start) {
            *first = start;
            let (columns, rows) = blocks_of(size.at_level(level));
            start += columns * rows;
        }
        let details = self.details.as_ref();
        let words = details.map_or(0, |details| {
            (details.entries[surface].len() * details.form.entry_bits() as usize).div_ceil(32) + 1
        });
        TexfoldProgressiveParams {
            size: [full.width, full.height],
            levels: self.layout.levels,
            address_mode: TEXFOLD_CLAMP,
            base_size: [base_size.0, base_size.1],
            swizzle: base[0].swizzle().0,
            class_bits: if self.maps.is_empty() { 0 } else { self.model.class_bits },
            row_log2,
            first_bit,
            base_levels: base.len() as u32,
            map_form: details.map_or(0, |details| details.form.packed()),
            level_start,
            classes: self.model.classes.map(|rates| rates.packed()),
            weights: self.model.scales(),
            codebooks: details.map_or([0; 4], Details::sizes),
            gain_unit: details.map_or(0.0, Details::unit),
            entry_row_log2: WordRows::of(words).row_log2,
            base_cell: if self.apart { BLOCK_SIDE >> self.reduce_log2 } else { 0 },
            shrink_log2: self.shrink_log2,
            stored_size: [size.width, size.height],
            base_margin: self.margin,
            reserved: 0,
        }
    }
}

impl Encoded for ProgressiveTexture {
    type Domain = Image2d;

    fn codec(&self) -> CodecId {
        Progressive::ID
    }

    fn layout(&self) -> &ImageLayout {
        &self.parts.layout
    }

    fn layers(&self) -> Layers {
        let total = self.parts.layers();
        Layers { loaded: if self.parts.maps.is_empty() { 1 } else { total }, total }
    }

    fn sample(&self, at: ImageAddress) -> Texel {
        let clamp = |value: u32| i32::try_from(value).unwrap_or(i32::MAX);
        let level = at.level.min(self.parts.layout.levels - 1);
        texfold_progressive_fetch(&self.view(at.surface), IVec2::new(clamp(at.x), clamp(at.y)), level)
    }

    fn decode(&self, region: Rect, out: &mut [Texel]) -> Result<(), RegionError> {
        self.parts.layout.check(region)?;
        if out.len() != Image2d::len(region) {
            return Err(RegionError::OutputLength { found: out.len(), needed: Image2d::len(region) });
        }
        if out.is_empty() {
            return Ok(());
        }
        match region.level.checked_sub(self.parts.shrink_log2) {
            Some(level) => self.decode_stored(Rect { level, ..region }, out),
            None => self.decode_enlarged(region, out),
        }
        Ok(())
    }

    fn store(&self, out: &mut SectionWriter) {
        self.notes.write(out);
        write_layout(&self.parts.layout, out);
        wire::store(&self.parts, out);
    }

    fn footprint(&self) -> Footprint {
        Footprint::measure(self, &self.gpu())
    }

    fn gpu(&self) -> GpuForm<'_> {
        let mut form =
            GpuForm { module: "progressive", planes: Vec::new(), uniforms: Vec::new(), surfaces: Vec::new() };
        let books = self.push_codebooks(&mut form.planes);
        for (surface, words) in self.words.iter().enumerate() {
            let map = form.planes.len();
            let params = &self.params[surface];
            form.planes.push(word_plane(ERROR_PART, words, params.row_log2));
            push_base(&mut form.planes, &self.parts.bases[surface]);
            let mut planes: Vec<usize> = (map..form.planes.len()).collect();
            // The shader binds two planes of the base; where there is one it is bound twice. Of what there is none, any is bound.
            planes.resize(3, map + 1);
            let entries = &self.entries[surface];
            planes.push(if entries.is_empty() { map } else { form.planes.len() });
            if !entries.is_empty() {
                form.planes.push(word_plane(MAP_PART, entries, params.entry_row_log2));
            }
            planes.extend(books.map(|book| book.unwrap_or(map + 1)));
            let start = form.uniforms.len();
            form.uniforms.extend(bytemuck::bytes_of(&self.params[surface]));
            form.surfaces.push(SurfaceBinding { planes, uniforms: start..form.uniforms.len(), surface: 0 });
        }
        form
    }

    fn notes(&self) -> &Notes {
        &self.notes
    }
}

impl Refine for ProgressiveTexture {
    fn refine(&mut self, file: &Sections<'_>, budget: &mut Budget) -> Result<Vec<&'static str>, LoadError> {
        if !self.parts.maps.is_empty() || self.parts.layers() == 1 {
            return Ok(Vec::new());
        }
        let Some(maps) = wire::read_maps(&self.parts, file, budget)? else { return Ok(Vec::new()) };
        let parts = Parts { maps, ..self.parts.clone() };
        let refined = ProgressiveTexture::with_texels(parts, self.texels.clone(), self.notes.clone());
        *self = refined.ok_or(wire::too_large())?;
        Ok(vec![ERROR_PART, "uniforms"])
    }
}

impl ProgressiveTexture {
    /// The levels that are stored.
    pub(crate) fn stored(&self) -> &ImageLayout {
        &self.parts.stored
    }

    /// Halvings of width and height of the largest level that is stored: it is enlarged for those before it.
    #[must_use]
    pub fn shrink_log2(&self) -> u32 {
        self.parts.shrink_log2
    }

    /// The texels of a region of a stored level, which lies inside.
    pub(crate) fn decode_stored(&self, region: Rect, out: &mut [Texel]) {
        let view = self.view(region.surface);
        enlarge(&view, region, out);
        if view.params.map_form != 0 {
            add_details(&view, region, out);
        }
        if view.params.class_bits > 0 {
            add_errors(&view, region, out);
        }
    }

    /// The texels of a region of a level that is not stored, as [`crate::decode::texfold_progressive_shown`] shows them.
    fn decode_enlarged(&self, region: Rect, out: &mut [Texel]) {
        let view = self.view(region.surface);
        let full = texfold_level_size(UVec2::from(view.params.size), region.level).as_vec2();
        let size = UVec2::from(view.params.stored_size);
        let tap = |x: u32, y: u32| {
            let uv = (UVec2::new(x, y).as_vec2() + 0.5) / full;
            texfold_progressive_taps(&view, uv, size, TEXFOLD_CLAMP)
        };
        let last = (region.x + region.width - 1, region.y + region.height - 1);
        let (low, high) = (tap(region.x, region.y).low, tap(last.0, last.1).high);
        let (texels, width) = self.decode_beyond(region.surface, (low, high));
        let columns: Vec<_> = (region.x..=last.0).map(|x| tap(x, region.y)).collect();
        for (y, line) in (region.y..).zip(out.chunks_exact_mut(region.width as usize)) {
            let rows = tap(region.x, y);
            let row = |y: i32| &texels[(y - low.y) as usize * width..][..width];
            let (upper, lower) = (row(rows.low.y), row(rows.high.y));
            for (texel, tap) in line.iter_mut().zip(&columns) {
                let (left, right) = ((tap.low.x - low.x) as usize, (tap.high.x - low.x) as usize);
                let four = [upper[left], upper[right], lower[left], lower[right]];
                *texel = texfold_bilinear(four, glam::Vec2::new(tap.weight.x, rows.weight.y));
            }
        }
    }

    /// The texels from one place of the largest level that is stored to another, which lie inside or a texel beyond a border, and how many are
    /// in a row.
    fn decode_beyond(&self, surface: u32, (low, high): (IVec2, IVec2)) -> (Vec<Texel>, usize) {
        let view = self.view(surface);
        let size = UVec2::from(view.params.stored_size);
        let (first, last) = (texfold_inside(low, size), texfold_inside(high, size));
        let (width, height) = (last.x - first.x + 1, last.y - first.y + 1);
        let stored = Rect { surface, level: 0, x: first.x, y: first.y, width, height };
        let mut inside = vec![Texel::ZERO; Image2d::len(stored)];
        self.decode_stored(stored, &mut inside);
        if (first.as_ivec2(), last.as_ivec2()) == (low, high) {
            return (inside, width as usize);
        }
        let mut texels = Vec::new();
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                let at = IVec2::new(x, y);
                let place = at - first.as_ivec2();
                texels.push(if texfold_inside(at, size).as_ivec2() == at {
                    inside[(place.y * width as i32 + place.x) as usize]
                } else {
                    texfold_progressive_load(&view, at, 0)
                });
            }
        }
        (texels, (high.x - low.x + 1) as usize)
    }

    /// Adds the planes of the codebooks; which they are.
    fn push_codebooks<'a>(&'a self, planes: &mut Vec<Plane<'a>>) -> [Option<usize>; 2] {
        let Some(details) = &self.parts.details else { return [None; 2] };
        let mut push = |book: &'a Option<std::sync::Arc<crate::Codebook>>, part| {
            let book = book.as_ref()?;
            planes.extend(book.planes().gpu_planes(part));
            Some(planes.len() - 1)
        };
        [push(&details.public, PUBLIC_PART), push(&details.private, PRIVATE_PART)]
    }
}

/// Name of the error map in the footprint.
pub const ERROR_PART: &str = "error map";
/// Name of the map in the footprint.
pub(crate) const MAP_PART: &str = "map";
/// Name of a codebook that is kept elsewhere.
pub(crate) const PUBLIC_PART: &str = "public codebook";
/// Name of a texture's own codebook.
pub(crate) const PRIVATE_PART: &str = "codebook";
/// Name of the base in the footprint.
pub const BASE_PART: &str = "base";

fn push_base<'a>(planes: &mut Vec<Plane<'a>>, levels: &'a [ContentPlanes]) {
    let first = planes.len();
    planes.extend(levels[0].gpu_planes(BASE_PART));
    for (index, plane) in planes[first..].iter_mut().enumerate().filter(|_| levels.len() > 1) {
        plane.levels = levels.len() as u32;
        plane.data =
            Cow::Owned(levels.iter().flat_map(|level| level.planes()[index].1.iter().copied()).collect());
    }
}

/// Fills `out` from the base, as [`crate::decode::texfold_progressive_base`] does texel by texel.
fn enlarge(view: &ProgressiveView<'_>, region: Rect, out: &mut [Texel]) {
    let full = texfold_level_size(UVec2::from(view.params.stored_size), region.level);
    let stored = region.level.min(view.params.base_levels - 1);
    let size = texfold_level_size(UVec2::from(view.params.base_size), stored);
    let texels = &view.base[stored as usize];
    let (cell, margin) = (view.params.base_cell, margin(&view.params, stored));
    let tap = |x: u32, y: u32| texfold_progressive_tap(UVec2::new(x, y).as_ivec2(), full, size, cell, margin);
    let columns: Vec<_> = (region.x..region.x + region.width).map(|x| tap(x, region.y)).collect();
    for (y, line) in (region.y..).zip(out.chunks_exact_mut(region.width as usize)) {
        let rows = tap(region.x, y);
        let row = |y: u32| &texels[(y * size.x) as usize..][..size.x as usize];
        let (upper, lower) = (row(rows.low.y), row(rows.high.y));
        for (texel, tap) in line.iter_mut().zip(&columns) {
            let (left, right) = (tap.low.x as usize, tap.high.x as usize);
            let four = [upper[left], upper[right], lower[left], lower[right]];
            *texel = texfold_bilinear(four, glam::Vec2::new(tap.weight.x, rows.weight.y));
        }
    }
}

/// Adds what codebooks show in `region`.
fn add_details(view: &ProgressiveView<'_>, region: Rect, out: &mut [Texel]) {
    for (y, line) in (region.y..).zip(out.chunks_exact_mut(region.width as usize)) {
        for (x, texel) in (region.x..).zip(line) {
            let detail = texfold_progressive_detail(view, UVec2::new(x, y), region.level);
            *texel = (*texel + Vec4::new(detail, detail, detail, 0.0)).clamp(Vec4::ZERO, Vec4::ONE);
        }
    }
}

/// Adds the errors of all blocks that touch `region`.
fn add_errors(view: &ProgressiveView<'_>, region: Rect, out: &mut [Texel]) {
    let (right, bottom) = (region.x + region.width, region.y + region.height);
    for top in (region.y / BLOCK_SIDE * BLOCK_SIDE..bottom).step_by(BLOCK_SIDE as usize) {
        for left in (region.x / BLOCK_SIDE * BLOCK_SIDE..right).step_by(BLOCK_SIDE as usize) {
            let block = texfold_progressive_block(view, UVec2::new(left, top), region.level);
            let mut change = |x: u32, y: u32, error: Vec4| {
                let (x, y) = (left + x, top + y);
                if x >= region.x && x < right && y >= region.y && y < bottom {
                    let texel = &mut out[((y - region.y) * region.width + x - region.x) as usize];
                    *texel = (*texel + error).clamp(Vec4::ZERO, Vec4::ONE);
                }
            };
            if block.bits > 0 {
                add_block(view, block, change);
            } else {
                (0..64).for_each(|n| change(n % BLOCK_SIDE, n / BLOCK_SIDE, Vec4::ZERO));
            }
        }
    }
}
