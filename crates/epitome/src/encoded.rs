//! The shipped form: epitomes, a map, and mip levels of both kinds.

use std::borrow::Cow;

use glam::IVec2;
use texfold_bc::ContentPlanes;
use texfold_core::container::{SectionWriter, Sections, write_layout};
use texfold_core::{
    Budget, Cached, CodecId, Domain, Encoded, Footprint, GpuDct, GpuForm, Image2d, ImageAddress,
    ImageBinding, ImageLayout, ImageSize, Layers, LoadError, Notes, Plane, Rect, Refine, RegionError, Texel,
    TextureCodec, parallel,
};

use texfold_core::{BASE_PART, RESIDUAL_PART};
use texfold_dct::DctContent;
use texfold_residual::ResidualContent;

use crate::decode::{EpitomeView, TexfoldEpitomeParams, texfold_epitome_fetch};
use crate::fast::{decode_leaf, leaves};
use crate::format::{Entry, GainOffset, MapFormat, Matrix};
use crate::layers::Layering;
use crate::parts::{BlockParts, DrawnLevel, Parts};
use crate::{Epitome, wire};

/// Images stored as a map into an epitome.
///
/// It holds what a GPU draws, once: texels for the CPU are decoded when they are first requested.
#[derive(Debug, Clone, PartialEq)]
pub struct EpitomeTexture {
    pub(crate) parts: Parts,
    /// For each image.
    pub(crate) params: Vec<TexfoldEpitomeParams>,
    texels: Cached<Texels>,
    pub(crate) notes: Notes,
}

/// Decoded texels, level by level.
#[derive(Debug, Clone)]
struct Texels {
    epitomes: Vec<Vec<Vec<Texel>>>,
    /// For each image the levels that are not read from the epitome.
    coarse: Vec<Vec<Vec<Texel>>>,
}

impl Texels {
    fn of(parts: &Parts) -> Self {
        if let Some(blocks) = &parts.blocks {
            let images = |content: &DctContent| {
                (0..content.layout().images.len() as u32).map(|image| block_levels(content, image)).collect()
            };
            return Texels {
                epitomes: images(&blocks.epitome),
                coarse: blocks.coarse.as_ref().map(images).unwrap_or_default(),
            };
        }
        let decode = |epitome: usize| parts.drawn(epitome).map(DrawnLevel::decode).collect();
        let errors = parts.errors.iter().map(|errors| decode_levels(errors));
        let levels = |levels: usize| parts.coarse[levels].iter().map(ContentPlanes::decode).collect();
        Texels {
            epitomes: parallel::map(parts.epitomes.len(), decode).into_iter().chain(errors).collect(),
            coarse: parallel::map(parts.coarse.len(), levels),
        }
    }
}

impl EpitomeTexture {
    /// Lays the parts out for drawing.
    pub(crate) fn new(parts: Parts, notes: Notes) -> Self {
        EpitomeTexture { params: parts.uniforms(), parts, texels: Cached::default(), notes }
    }

    /// How the map is stored.
    #[must_use]
    pub fn map_format(&self) -> MapFormat {
        self.parts.format
    }

    /// The epitome that has a residual plane, where there is one: the last.
    #[must_use]
    pub fn errors(&self) -> Option<&ResidualContent> {
        self.parts.errors.as_deref()
    }

    /// The epitome and its mip level where they are in blocks of variable length: the only one then.
    #[must_use]
    pub fn blocks(&self) -> Option<&DctContent> {
        self.parts.blocks.as_ref().map(|blocks| &blocks.epitome)
    }

    /// The epitomes without a residual plane at full size: one, or one of each content format. Where all layers are
    /// there, a GPU gets no more of their rows than the finest reads.
    pub fn epitomes(&self) -> impl Iterator<Item = &ContentPlanes> {
        self.parts.epitomes.iter().filter_map(|levels| levels.first())
    }

    /// The 2x2 matrices that entries point at.
    #[must_use]
    pub fn matrices(&self) -> &[Matrix] {
        &self.parts.palettes.matrices
    }

    /// The gain-offset pairs that entries point at.
    #[must_use]
    pub fn gain_offsets(&self) -> &[GainOffset] {
        &self.parts.palettes.gain_offsets
    }

    /// The texture as it is with the first `count` layers of its file, at least one; all that are there where they
    /// are fewer.
    #[must_use]
    pub fn first_layers(&self, count: u32) -> EpitomeTexture {
        match self.parts.first_layers(count) {
            Some(parts) => EpitomeTexture::new(parts, self.notes.clone()),
            None => self.clone(),
        }
    }

    /// The entries of the map, in the order of the leaves.
    #[must_use]
    pub fn entries(&self) -> Vec<Entry> {
        self.parts.map.unpacked(&self.parts.format).entries
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

    /// An image as the shader sees it; the last one where there is no such image.
    #[must_use]
    #[inline]
    pub fn view(&self, image: u32) -> EpitomeView<'_> {
        let image = (image as usize).min(self.params.len() - 1);
        let Texels { epitomes, coarse } = self.texels.get_or_make(|| Texels::of(&self.parts));
        EpitomeView {
            params: self.params[image],
            map: self.parts.map.words(),
            plane_a: &epitomes[0],
            plane_b: epitomes.get(1).map(Vec::as_slice).unwrap_or_default(),
            coarse: coarse.get(image).map(Vec::as_slice).unwrap_or_default(),
        }
    }
}

impl EpitomeTexture {
    /// The form with the epitome and coarse mip levels in blocks, which are decoded before drawing.
    fn with_blocks<'a>(&'a self, blocks: &'a BlockParts, mut form: GpuForm<'a>) -> GpuForm<'a> {
        let epitome = form.planes.len();
        let contents = [(EPITOME_PART, 0, Some(&blocks.epitome)), (MIPS_PART, 1, blocks.coarse.as_ref())];
        for (part, first, content) in contents {
            for stage in content.into_iter().flat_map(DctContent::gpu) {
                let bytes = stage.held_bytes.iter().map(|(_, bytes)| bytes).sum();
                let image = first + stage.image;
                form.blocks.push(GpuDct { image, held_bytes: vec![(part, bytes)], ..stage });
            }
        }
        for (index, params) in self.params.iter().enumerate() {
            let start = form.uniforms.len();
            form.uniforms.extend(bytemuck::bytes_of(params));
            // Without coarse levels nothing is read there.
            let coarse = if blocks.coarse.is_some() { epitome + 1 + index } else { epitome };
            let planes = vec![0, epitome, epitome, coarse];
            form.images.push(ImageBinding { planes, uniforms: start..form.uniforms.len(), image: 0 });
        }
        form
    }
}

/// All levels of an epitome with a residual plane.
fn decode_levels(errors: &ResidualContent) -> Vec<Vec<Texel>> {
    let decode = |level: u32| {
        let rect = errors.layout().whole(0, level)?;
        let mut texels = vec![Texel::ZERO; Image2d::len(rect)];
        errors.decode(rect, &mut texels);
        Some(texels)
    };
    (0..errors.layout().levels).filter_map(decode).collect()
}

/// All levels of an image in blocks of variable length.
fn block_levels(content: &DctContent, image: u32) -> Vec<Vec<Texel>> {
    let layout = content.layout();
    let level = |level: u32| {
        let rect = layout.whole(image, level)?;
        let mut texels = vec![Texel::ZERO; Image2d::len(rect)];
        let width = rect.width.max(1) as usize;
        parallel::for_each_row(&mut texels, width * BAND as usize, |band, out| {
            let (y, height) = (band as u32 * BAND, (out.len() / width) as u32);
            // A band of a level lies inside of it.
            let _ = content.decode(Rect { y, height, ..rect }, out);
        });
        Some(texels)
    };
    (0..layout.levels).filter_map(level).collect()
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

    fn texel(&self, at: ImageAddress) -> Texel {
        let clamp = |value: u32| i32::try_from(value).unwrap_or(i32::MAX);
        let level = at.level.min(self.parts.layout.levels - 1);
        texfold_epitome_fetch(&self.view(at.image), IVec2::new(clamp(at.x), clamp(at.y)), level)
    }

    fn decode(&self, region: Rect, out: &mut [Texel]) -> Result<(), RegionError> {
        self.parts.layout.check(region)?;
        if out.len() != Image2d::len(region) {
            return Err(RegionError::OutputLength { found: out.len(), needed: Image2d::len(region) });
        }
        let view = self.view(region.image);
        if region.level == 0 {
            for leaf in leaves(&view, region) {
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
        for (epitome, name) in PLANE_NAMES.into_iter().enumerate() {
            let bytes =
                |level: DrawnLevel<'_>| level.planes().map(|(_, bytes)| bytes.len() as u64).sum::<u64>();
            let mips: u64 = self.parts.drawn(epitome).skip(1).map(bytes).sum();
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
        let mut form = GpuForm::new("epitome");
        form.planes.push(self.parts.map.plane());
        if let Some(blocks) = &self.parts.blocks {
            return self.with_blocks(blocks, form);
        }
        for (epitome, name) in PLANE_NAMES.into_iter().enumerate() {
            push_chain(&mut form.planes, name, self.parts.drawn(epitome).collect());
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
        for (image, params) in self.params.iter().enumerate() {
            let start = form.uniforms.len();
            form.uniforms.extend(bytemuck::bytes_of(params));
            form.uniforms.extend(&uniforms);
            let coarse = match self.parts.coarse.get(image) {
                Some(levels) if !levels.is_empty() => {
                    push_chain(&mut form.planes, "mips", levels.iter().map(DrawnLevel::whole).collect());
                    form.planes.len() - 1
                }
                _ => content[0],
            };
            let planes = [&[0], content.as_slice(), &[coarse], errors.as_slice()].concat();
            form.images.push(ImageBinding { planes, uniforms: start..form.uniforms.len(), image: 0 });
        }
        form
    }

    fn notes(&self) -> &Notes {
        &self.notes
    }
}

impl Refine for EpitomeTexture {
    /// The map is uploaded again, each epitome that has new cells, and the uniforms where they say another thing than
    /// before.
    fn refine(&mut self, file: &Sections<'_>, budget: &mut Budget) -> Result<Vec<&'static str>, LoadError> {
        let Some(parts) = wire::next_layer(&self.parts, file, budget)? else { return Ok(Vec::new()) };
        let refined = EpitomeTexture::new(parts, self.notes.clone());
        let mut changed = vec!["map"];
        for (epitome, name) in PLANE_NAMES.into_iter().enumerate() {
            let (mut old, mut new) = (self.parts.drawn(epitome), refined.parts.drawn(epitome));
            if !old.by_ref().zip(new.by_ref()).all(|(old, new)| old.is_drawn_as(new)) {
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
const PLANE_NAMES: [&str; 2] = [EPITOME_PART, "fine epitome"];
const EPITOME_PART: &str = "epitome";
const MIPS_PART: &str = "mips";
/// Rows of texels that are decoded at a time: whole superblocks.
const BAND: u32 = 64;

/// The planes of a mip chain, without the levels that repeat the one of 1 x 1.
fn push_chain<'a>(planes: &mut Vec<Plane<'a>>, part: &'static str, mut levels: Vec<DrawnLevel<'a>>) {
    let Some(&base) = levels.first() else { return };
    let (width, height) = base.size;
    levels.truncate(ImageSize { width, height }.full_levels() as usize);
    for (index, (format, bytes)) in base.planes().enumerate() {
        let data = if levels.len() == 1 {
            Cow::Borrowed(bytes)
        } else {
            let of = |level: &DrawnLevel<'a>| level.planes().nth(index).map(|(_, bytes)| bytes);
            Cow::Owned(levels.iter().filter_map(of).collect::<Vec<&[u8]>>().concat())
        };
        planes.push(Plane { part, format, width, height, levels: levels.len() as u32, data });
    }
}
