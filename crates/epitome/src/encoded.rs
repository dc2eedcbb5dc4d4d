//! The shipped form: epitomes, a map, and mip levels of both kinds.

use std::borrow::Cow;

use glam::{IVec2, UVec2, Vec2, Vec4};
use texfold_bc::{Content, ContentPlanes};
use texfold_core::address::{TEXFOLD_CLAMP, TexfoldTap, texfold_level_size};
use texfold_core::container::{SectionWriter, Sections, write_layout};
use texfold_core::image::PixelInfo;
use texfold_core::sample::{TEXFOLD_NORMAL, texfold_bilinear};
use texfold_core::{
    Budget, CodecId, Domain, Encoded, Footprint, GpuForm, Image2d, ImageAddress, ImageLayout, Layers,
    LoadError, Notes, Plane, Rect, Refine, RegionError, SurfaceBinding, SurfaceSize, Texel, TextureCodec,
    WordRows, word_plane,
};

use texfold_residual::{BASE_PART, RESIDUAL_PART, ResidualContent};

use crate::decode::{
    EpitomeView, TEXFOLD_EPITOME_FINE_LEVELS, TexfoldEpitomeLeaf, TexfoldEpitomeParams, TexfoldEpitomeSource,
    plane_of, tap_at, texfold_epitome_fetch, texfold_epitome_leaf, texfold_epitome_place,
    texfold_epitome_plane_level, texfold_epitome_read, texfold_epitome_source,
};
use crate::layers::Layering;
use crate::{Epitome, wire};

/// Mip levels that an epitome has beside its full size, where there are any: one less than the image has that are read
/// from it, as blending four texels halves once more.
pub(crate) const PLANE_MIPS: u32 = 1;

/// Most texels a side of a block.
pub(crate) const MAX_BLOCK: usize = 64;

/// How the map is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MapFormat {
    /// Texels a side of a block.
    pub block: u32,
    /// Whether blocks are split into leaves of a half and a quarter of their side.
    pub split: bool,
    /// Bits of a position's column.
    pub x_bits: u32,
    /// Bits of a position's row.
    pub y_bits: u32,
    /// How many of them are a fraction of a texel.
    pub fraction_bits: u32,
    /// Bits of a tone's number.
    pub tone_bits: u32,
    /// Bits of a linear part's number.
    pub linear_bits: u32,
    /// Whether there are two epitomes.
    pub mixed: bool,
    /// Half the width of the strip along borders of leaves in which both are blended, in eighths of a texel; at least
    /// 4.
    pub strip: u32,
}

/// Half a texel, in eighths: leaves are blended between their outermost texels' centres.
pub(crate) const LEAST_STRIP: u32 = 4;

impl MapFormat {
    /// Texels a side of the smallest leaf.
    #[must_use]
    pub fn cell(&self) -> u32 {
        if self.split { self.block / 4 } else { self.block }
    }

    /// Bytes of an entry.
    #[must_use]
    pub fn entry_bytes(&self) -> u32 {
        let bits = self.x_bits + self.y_bits + self.tone_bits + self.linear_bits + u32::from(self.mixed);
        bits.div_ceil(8).max(2)
    }
}

/// One leaf's entry of the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Entry {
    /// Column of the leaf's centre in the epitome, in fractions of a texel as the format says.
    pub x: u32,
    /// Row of the leaf's centre.
    pub y: u32,
    /// Number of its tone.
    pub tone: u32,
    /// Number of its linear part.
    pub linear: u32,
    /// Which epitome.
    pub plane: u32,
}

/// Rows of a linear part in units of 1/8192.
pub type Linear = [i16; 4];
/// Gain in units of 1/128 and offset plus 128 in units of 1/255, for red, green and blue each.
pub type Tone = [u8; 6];

/// The linear part that changes nothing.
pub const IDENTITY: Linear = [8192, 0, 0, 8192];
/// The tone that changes nothing.
pub const NEUTRAL: Tone = [128; 6];

/// All that a file holds, before it is laid out for sampling.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Parts {
    pub(crate) layout: ImageLayout,
    pub(crate) format: MapFormat,
    /// For each block of all images, row by row: bit 0 whether it is split, bits 1 to 4 which of its quarters are.
    pub(crate) trees: Vec<u8>,
    pub(crate) entries: Vec<Entry>,
    pub(crate) linears: Vec<Linear>,
    pub(crate) tones: Vec<Tone>,
    /// Epitomes without an error map, each with its mip levels; one or two with that of `errors`.
    pub(crate) epitomes: Vec<Vec<ContentPlanes>>,
    /// The last epitome where it has an error map: the second, or the only one.
    pub(crate) errors: Option<Box<ResidualContent>>,
    /// For each image the levels that are not read from the epitome.
    pub(crate) coarse: Vec<Vec<ContentPlanes>>,
    /// Where the file has several layers: what the map above and the epitomes are made of.
    pub(crate) layering: Option<Box<Layering>>,
}

/// Images stored as a map into an epitome.
#[derive(Debug, Clone, PartialEq)]
pub struct EpitomeTexture {
    pub(crate) parts: Parts,
    /// The epitomes as they are drawn, where that is not all of them.
    cut: Option<Vec<Vec<ContentPlanes>>>,
    map: Vec<u32>,
    params: Vec<TexfoldEpitomeParams>,
    /// Texels of each epitome's levels.
    texels: Vec<Vec<Vec<Texel>>>,
    coarse: Vec<Vec<Vec<Texel>>>,
    pub(crate) notes: Notes,
}

/// Columns and rows of blocks that cover an image.
pub(crate) fn blocks_of(size: SurfaceSize, block: u32) -> (u32, u32) {
    (size.width.div_ceil(block), size.height.div_ceil(block))
}

/// How levels that are not read from the epitome are stored: one plane, whatever the epitome has. BC1 shows reduced
/// pictures worse than full ones, so that they may be `finer` than the epitome.
pub(crate) fn coarse_content(content: Content, pixel: PixelInfo, finer: bool) -> Content {
    match (content, pixel.channels) {
        (Content::Bc1, _) if finer => Content::Bc7,
        (Content::Raw, 1) => Content::Bc4,
        (Content::Raw, 2) => Content::Bc5,
        (Content::Raw, _) => Content::Bc7,
        (other, _) => other,
    }
}

/// Squares of a block: itself, its four quarters, and theirs.
pub(crate) const NODES: usize = 21;

/// Squares of a block of that tree byte that are leaves, in the order of their entries.
pub(crate) fn nodes_of(tree: u8) -> impl Iterator<Item = usize> {
    let quarter = move |quarter: usize| {
        let split = tree >> (1 + quarter) & 1 == 1;
        let (first, count) = if split { (5 + 4 * quarter, 4) } else { (1 + quarter, 1) };
        first..first + count
    };
    let quarters = if tree & 1 == 0 { 0 } else { 4 };
    let whole = if tree & 1 == 0 { 0..1 } else { 0..0 };
    whole.chain((0..quarters).flat_map(quarter))
}

/// Leaves of a block of that tree byte.
pub(crate) fn leaves_of(tree: u8) -> u32 {
    if tree & 1 == 0 { 1 } else { 4 + 3 * (tree >> 1 & 15).count_ones() }
}

impl Parts {
    /// The map plane's words and each image's parameters.
    fn assemble(&self, epitomes: &[Vec<ContentPlanes>]) -> (Vec<u32>, Vec<TexfoldEpitomeParams>) {
        let mut map = Vec::new();
        let mut first = 0u32;
        if self.format.split {
            for &tree in &self.trees {
                map.push(u32::from(tree) | first << 5);
                first += leaves_of(tree);
            }
        }
        let linear_start = map.len() as u32;
        for linear in &self.linears {
            let half = |value: i16| u32::from(value as u16);
            map.push(half(linear[0]) | half(linear[1]) << 16);
            map.push(half(linear[2]) | half(linear[3]) << 16);
        }
        let tone_start = map.len() as u32;
        for tone in &self.tones {
            map.push(u32::from_le_bytes([tone[0], tone[1], tone[2], 0]));
            map.push(u32::from_le_bytes([tone[3], tone[4], tone[5], 0]));
        }
        let entry_start = map.len() as u32;
        map.extend(self.entry_words());
        let (map, WordRows { row_log2, .. }) = WordRows::padded(map);
        let params = self.params(epitomes, [linear_start, tone_start, entry_start, row_log2]);
        (map, params)
    }

    /// The entries, packed, with a word behind the last.
    fn entry_words(&self) -> Vec<u32> {
        let format = &self.format;
        let bytes = format.entry_bytes() as usize;
        let mut packed = Vec::new();
        for entry in &self.entries {
            let fields = [
                (entry.x, format.x_bits),
                (entry.y, format.y_bits),
                (entry.tone, format.tone_bits),
                (entry.linear, format.linear_bits),
                (entry.plane, u32::from(format.mixed)),
            ];
            let (mut value, mut start) = (0u64, 0);
            for (field, bits) in fields {
                value |= u64::from(field) << start;
                start += bits;
            }
            packed.extend(&value.to_le_bytes()[..bytes]);
        }
        packed.resize(packed.len().next_multiple_of(4) + 4, 0);
        packed.chunks_exact(4).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]])).collect()
    }

    fn params(
        &self,
        epitomes: &[Vec<ContentPlanes>],
        [linear_start, tone_start, entry_start, row_log2]: [u32; 4],
    ) -> Vec<TexfoldEpitomeParams> {
        let format = &self.format;
        let plane_size = |index: usize| {
            let plain = |levels: &Vec<ContentPlanes>| levels.first().map(|plane| plane.size().into());
            let errors = self.errors.iter().map(|errors| Some(epitome_size(errors)));
            let sizes: Vec<Option<[u32; 2]>> = epitomes.iter().map(plain).chain(errors).collect();
            sizes.get(index).or(sizes.first()).copied().flatten().unwrap_or([4, 4])
        };
        let plane_levels = self.errors.as_ref().map(|errors| errors.layout().levels);
        let plane_levels = plane_levels.or_else(|| self.epitomes.first().map(|levels| levels.len() as u32));
        let swizzle =
            self.epitomes.first().and_then(|levels| levels.first()).map_or(0, |plane| plane.swizzle().0);
        let mut tree_start = 0;
        let image = |(index, &size): (usize, &SurfaceSize)| {
            let (columns, rows) = blocks_of(size, format.block);
            let params = TexfoldEpitomeParams {
                size: [size.width, size.height],
                levels: self.layout.levels,
                address_mode: TEXFOLD_CLAMP,
                swizzle,
                mixed: u32::from(format.mixed),
                block: format.block,
                split: u32::from(format.split),
                columns,
                tree_start,
                entry_start,
                entry_bytes: format.entry_bytes(),
                x_bits: format.x_bits,
                y_bits: format.y_bits,
                fraction_bits: format.fraction_bits,
                tone_bits: format.tone_bits,
                linear_bits: format.linear_bits,
                linear_start,
                tone_start,
                row_log2,
                plane_a: plane_size(0),
                plane_b: plane_size(1),
                plane_levels: plane_levels.unwrap_or(1),
                coarse_swizzle: self.coarse.get(index).and_then(|c| c.first()).map_or(0, |c| c.swizzle().0),
                cell: format.cell(),
                strip: format.strip,
            };
            tree_start += columns * rows;
            params
        };
        self.layout.surfaces.iter().enumerate().map(image).collect()
    }
}

impl EpitomeTexture {
    /// Lays the parts out for sampling.
    pub(crate) fn new(parts: Parts, notes: Notes) -> Self {
        let cut = parts.drawn();
        let drawn = cut.as_ref().unwrap_or(&parts.epitomes);
        let (map, params) = parts.assemble(drawn);
        let decode = |levels: &Vec<ContentPlanes>| levels.iter().map(ContentPlanes::decode).collect();
        let errors = parts.errors.iter().map(|errors| decode_levels(errors));
        let texels = drawn.iter().map(decode).chain(errors).collect();
        let coarse = parts.coarse.iter().map(decode).collect();
        EpitomeTexture { parts, cut, map, params, texels, coarse, notes }
    }

    /// The same with leaves blended in strips of that half width, in eighths of a texel.
    pub(crate) fn with_strip(mut self, strip: u32) -> Self {
        self.parts.format.strip = strip;
        self.params.iter_mut().for_each(|params| params.strip = strip);
        self
    }

    /// How the map is stored.
    #[must_use]
    pub fn map_format(&self) -> MapFormat {
        self.parts.format
    }

    /// The epitome that has an error map, where there is one: the last.
    #[must_use]
    pub fn errors(&self) -> Option<&ResidualContent> {
        self.parts.errors.as_deref()
    }

    /// The epitomes without an error map at full size: one, or one of each content format.
    pub fn epitomes(&self) -> impl Iterator<Item = &ContentPlanes> {
        self.drawn().iter().filter_map(|levels| levels.first())
    }

    /// The epitomes as they are drawn.
    fn drawn(&self) -> &[Vec<ContentPlanes>] {
        self.cut.as_ref().unwrap_or(&self.parts.epitomes)
    }

    /// The linear parts that entries point at.
    #[must_use]
    pub fn linears(&self) -> &[Linear] {
        &self.parts.linears
    }

    /// The tones that entries point at.
    #[must_use]
    pub fn tones(&self) -> &[Tone] {
        &self.parts.tones
    }

    /// The texture as it is with the first `count` layers of its file, at least one; all that are there where they are fewer.
    #[must_use]
    pub fn first_layers(&self, count: u32) -> EpitomeTexture {
        match self.parts.first_layers(count) {
            Some(parts) => EpitomeTexture::new(parts, self.notes.clone()),
            None => self.clone(),
        }
    }

    /// The entries of the map, in the order of the leaves.
    #[must_use]
    pub fn entries(&self) -> &[Entry] {
        &self.parts.entries
    }

    /// Replaces the notes.
    #[must_use]
    pub fn with_notes(mut self, notes: Notes) -> Self {
        self.notes = notes;
        self
    }

    /// An image as the shader sees it; the last one where there is no such image.
    #[must_use]
    #[inline]
    pub fn view(&self, surface: u32) -> EpitomeView<'_> {
        let surface = (surface as usize).min(self.params.len() - 1);
        EpitomeView {
            params: self.params[surface],
            map: &self.map,
            plane_a: &self.texels[0],
            plane_b: self.texels.get(1).map(Vec::as_slice).unwrap_or_default(),
            coarse: self.coarse.get(surface).map(Vec::as_slice).unwrap_or_default(),
        }
    }

    /// All leaves of an image that touch `rect` of its level 0.
    pub(crate) fn leaves(&self, surface: u32, rect: Rect) -> Vec<TexfoldEpitomeLeaf> {
        let view = self.view(surface);
        let block = view.params.block;
        let mut leaves = Vec::new();
        for y in (rect.y / block * block..rect.y + rect.height).step_by(block as usize) {
            for x in (rect.x / block * block..rect.x + rect.width).step_by(block as usize) {
                collect_leaves(&view, UVec2::new(x, y), block, &mut leaves);
            }
        }
        leaves.retain(|leaf| {
            leaf.corner.x + leaf.side > rect.x
                && leaf.corner.y + leaf.side > rect.y
                && leaf.corner.x < rect.x + rect.width
                && leaf.corner.y < rect.y + rect.height
        });
        leaves
    }
}

/// Columns and rows of an epitome with an error map.
pub(crate) fn epitome_size(errors: &ResidualContent) -> [u32; 2] {
    let size = errors.size();
    [size.width, size.height]
}

/// All levels of an epitome with an error map.
fn decode_levels(errors: &ResidualContent) -> Vec<Vec<Texel>> {
    let decode = |level: u32| {
        let rect = errors.layout().whole(0, level)?;
        let mut texels = vec![Texel::ZERO; Image2d::len(rect)];
        errors.decode(rect, &mut texels);
        Some(texels)
    };
    (0..errors.layout().levels).filter_map(decode).collect()
}

/// The leaves of the square at `corner`.
fn collect_leaves(view: &EpitomeView<'_>, corner: UVec2, side: u32, leaves: &mut Vec<TexfoldEpitomeLeaf>) {
    let size = UVec2::from(view.params.size);
    if corner.x >= size.x || corner.y >= size.y {
        return;
    }
    let leaf = texfold_epitome_leaf(view, corner);
    if leaf.side == side {
        leaves.push(leaf);
        return;
    }
    let half = side / 2;
    for quarter in 0..4 {
        collect_leaves(view, corner + UVec2::new(quarter % 2, quarter / 2) * half, half, leaves);
    }
}

impl Encoded for EpitomeTexture {
    type Domain = Image2d;

    fn codec(&self) -> CodecId {
        Epitome::ID
    }

    fn layout(&self) -> &ImageLayout {
        &self.parts.layout
    }

    fn layers(&self) -> Layers {
        let of = |layering: &Layering| Layers { loaded: layering.loaded(), total: layering.total };
        self.parts.layering.as_deref().map_or(Layers { loaded: 1, total: 1 }, of)
    }

    fn sample(&self, at: ImageAddress) -> Texel {
        let clamp = |value: u32| i32::try_from(value).unwrap_or(i32::MAX);
        let level = at.level.min(self.parts.layout.levels - 1);
        texfold_epitome_fetch(&self.view(at.surface), IVec2::new(clamp(at.x), clamp(at.y)), level)
    }

    fn decode(&self, region: Rect, out: &mut [Texel]) -> Result<(), RegionError> {
        self.parts.layout.check(region)?;
        if out.len() != Image2d::len(region) {
            return Err(RegionError::OutputLength { found: out.len(), needed: Image2d::len(region) });
        }
        let view = self.view(region.surface);
        if region.level == 0 {
            for leaf in self.leaves(region.surface, region) {
                decode_leaf(&view, leaf, region, out);
            }
            return Ok(());
        }
        for (index, texel) in out.iter_mut().enumerate() {
            let at = Image2d::address(region, index);
            *texel = texfold_epitome_fetch(&view, IVec2::new(at.x as i32, at.y as i32), region.level);
        }
        Ok(())
    }

    fn store(&self, out: &mut SectionWriter) {
        self.notes.write(out);
        write_layout(&self.parts.layout, out);
        wire::store(&self.parts, out);
    }

    /// As measured, with the mip levels of the epitomes as a part of their own.
    fn footprint(&self) -> Footprint {
        let mut footprint = Footprint::measure(self, &self.gpu());
        for (name, levels) in PLANE_NAMES.into_iter().zip(self.drawn()) {
            let bytes =
                |plane: &ContentPlanes| plane.planes().iter().map(|(_, b)| b.len() as u64).sum::<u64>();
            let mips: u64 = levels.iter().skip(1).map(bytes).sum();
            footprint.part(name).bits_memory -= 8 * mips;
            if mips > 0 {
                footprint.part("mips").bits_memory += 8 * mips;
            }
        }
        if let Some((base, map)) = self.parts.errors.as_ref().map(|errors| errors.mip_bits())
            && base + map > 0
        {
            footprint.part(BASE_PART).bits_memory -= base;
            footprint.part(RESIDUAL_PART).bits_memory -= map;
            footprint.part("mips").bits_memory += base + map;
        }
        footprint.with_notes(&self.notes)
    }

    fn gpu(&self) -> GpuForm<'_> {
        let mut form =
            GpuForm { module: "epitome", planes: Vec::new(), uniforms: Vec::new(), surfaces: Vec::new() };
        let row_log2 = self.params.first().map_or(0, |params| params.row_log2);
        form.planes.push(word_plane("map", &self.map, row_log2));
        for (name, levels) in PLANE_NAMES.into_iter().zip(self.drawn()) {
            push_chain(&mut form.planes, name, levels);
        }
        let plain = form.planes.len();
        let (mut content, mut errors, mut uniforms) = ([1, plain - 1], Vec::new(), Vec::new());
        if let Some(of_errors) = &self.parts.errors {
            // Its planes stand behind the others in the order of a file of their own.
            errors = of_errors.push_planes(0, &mut form.planes).to_vec();
            content = if plain > 1 { content } else { [errors[1], errors[1]] };
            form.module = "epitome-errors";
            uniforms = of_errors.uniforms(0).to_vec();
        }
        for (surface, params) in self.params.iter().enumerate() {
            let start = form.uniforms.len();
            form.uniforms.extend(bytemuck::bytes_of(params));
            form.uniforms.extend(&uniforms);
            let coarse = match self.parts.coarse.get(surface) {
                Some(levels) if !levels.is_empty() => {
                    push_chain(&mut form.planes, "mips", levels);
                    form.planes.len() - 1
                }
                _ => content[0],
            };
            let planes = [&[0], content.as_slice(), &[coarse], errors.as_slice()].concat();
            form.surfaces.push(SurfaceBinding { planes, uniforms: start..form.uniforms.len(), surface: 0 });
        }
        form
    }

    fn notes(&self) -> &Notes {
        &self.notes
    }
}

impl Refine for EpitomeTexture {
    /// The map is uploaded again, each epitome that has new cells, and the uniforms where they say another thing than before.
    fn refine(&mut self, file: &Sections<'_>, budget: &mut Budget) -> Result<Vec<&'static str>, LoadError> {
        let Some(parts) = wire::next_layer(&self.parts, file, budget)? else { return Ok(Vec::new()) };
        let refined = EpitomeTexture::new(parts, self.notes.clone());
        let mut changed = vec!["map"];
        for ((name, old), new) in PLANE_NAMES.into_iter().zip(self.drawn()).zip(refined.drawn()) {
            if old != new {
                changed.push(name);
            }
        }
        if self.params != refined.params {
            changed.push("uniforms");
        }
        *self = refined;
        Ok(changed)
    }
}

/// Parts that the planes of the epitomes count for.
const PLANE_NAMES: [&str; 2] = ["epitome", "fine epitome"];

/// The planes of a mip chain, without the levels that repeat the one of 1 x 1.
fn push_chain<'a>(planes: &mut Vec<Plane<'a>>, part: &'static str, levels: &'a [ContentPlanes]) {
    let Some(base) = levels.first() else { return };
    let (width, height) = base.size();
    let levels = &levels[..levels.len().min(SurfaceSize { width, height }.full_levels() as usize)];
    for (index, (format, bytes)) in base.planes().iter().enumerate() {
        let data = if levels.len() == 1 {
            Cow::Borrowed(bytes.as_slice())
        } else {
            let of = |level: &ContentPlanes| level.planes().get(index).map(|(_, bytes)| bytes.clone());
            Cow::Owned(levels.iter().filter_map(of).flatten().collect())
        };
        planes.push(Plane { part, format: *format, width, height, levels: levels.len() as u32, data });
    }
}

/// The texels of a leaf that `region` of level 0 asks for, as [`texfold_epitome_fetch`] finds them one by one.
fn decode_leaf(view: &EpitomeView<'_>, leaf: TexfoldEpitomeLeaf, region: Rect, out: &mut [Texel]) {
    let source = texfold_epitome_source(view, leaf.entry);
    let (left, right) =
        (leaf.corner.x.max(region.x), (leaf.corner.x + leaf.side).min(region.x + region.width));
    let (top, bottom) =
        (leaf.corner.y.max(region.y), (leaf.corner.y + leaf.side).min(region.y + region.height));
    let part = Rect { x: left, y: top, width: right - left, height: bottom - top, ..region };
    let upright = source.linear.y == 0.0 && source.linear.z == 0.0;
    if upright && view.params.swizzle != TEXFOLD_NORMAL {
        return decode_upright(view, &source, leaf, (part, region), out);
    }
    let plane_level = texfold_epitome_plane_level(view, source.linear, 0);
    for y in top..bottom {
        for (x, texel) in (left..right).zip(line_of(out, part, region, y)) {
            let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let place = texfold_epitome_place(&source, leaf, at, plane_level);
            let content = texfold_epitome_read(view, source.plane, place, plane_level);
            *texel = (content * source.gain + source.offset).clamp(Vec4::ZERO, Vec4::ONE);
        }
    }
}

/// Row `y` of `part` in the texels of `region`.
fn line_of(out: &mut [Texel], part: Rect, region: Rect, y: u32) -> &mut [Texel] {
    let start = (y - region.y) as usize * region.width as usize + (part.x - region.x) as usize;
    &mut out[start..start + part.width as usize]
}

/// As [`decode_leaf`] where columns of the leaf are columns of the epitome: places along one axis do not depend on the
/// other, and are found once.
fn decode_upright(
    view: &EpitomeView<'_>,
    source: &TexfoldEpitomeSource,
    leaf: TexfoldEpitomeLeaf,
    (part, region): (Rect, Rect),
    out: &mut [Texel],
) {
    let level = texfold_epitome_plane_level(view, source.linear, 0);
    let (size, planes) = plane_of(view, source.plane);
    let size = texfold_level_size(size, level);
    let texels = &planes[level as usize];
    let tap = |x: u32, y: u32| {
        let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        tap_at(texfold_epitome_place(source, leaf, at, level), size, level)
    };
    let mut columns = [(0usize, 0usize, 0.0f32); MAX_BLOCK];
    let columns = &mut columns[..part.width as usize];
    for (x, column) in (part.x..).zip(columns.iter_mut()) {
        let tap = tap(x, part.y);
        *column = (tap.low.x as usize, tap.high.x as usize, tap.weight.x);
    }
    let whole = columns.iter().all(|&(_, _, weight)| weight == 0.0);
    let tone = |content: Vec4| (content * source.gain + source.offset).clamp(Vec4::ZERO, Vec4::ONE);
    for y in part.y..part.y + part.height {
        let TexfoldTap { low, high, weight } = tap(part.x, y);
        let row = |y: u32| &texels[(y * size.x) as usize..((y + 1) * size.x) as usize];
        let (upper, lower) = (row(low.y), row(high.y));
        let line = line_of(out, part, region, y);
        if whole && weight.y == 0.0 {
            // Blending by 0 leaves a texel as it is.
            for (texel, &(low, ..)) in line.iter_mut().zip(columns.iter()) {
                *texel = tone(upper[low]);
            }
            continue;
        }
        for (texel, &(low, high, across)) in line.iter_mut().zip(columns.iter()) {
            let around = [upper[low], upper[high], lower[low], lower[high]];
            *texel = tone(texfold_bilinear(around, Vec2::new(across, weight.y)));
        }
    }
}

/// Mip levels that come from the coarse chain, for an image of `levels` levels.
pub(crate) fn coarse_levels(levels: u32) -> std::ops::Range<u32> {
    TEXFOLD_EPITOME_FINE_LEVELS.min(levels)..levels
}
