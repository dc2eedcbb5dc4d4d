//! Sections of residual content in any codec's file. The last letter of their ids is a number, so that a file can hold
//! several: "RSF0" (form of base and residual plane), "RSB0" (planes of the bases), "RSP0" (residual planes: for each
//! image the rate classes of all blocks, their scales, then their bits). "RSP0" is a layer of its own: a prefix of the
//! file without it decodes to the base.

use std::sync::Arc;

use texfold_bc::Content;
use texfold_core::container::{ContentId, Reader, SectionWriter, Sections};
use texfold_core::sample::TEXFOLD_NORMAL;
use texfold_core::{
    BASE_PART, Budget, ImageBinding, ImageLayout, ImageSize, LoadError, Plane, PlaneFormat, RESIDUAL_PART,
    String4, Texel,
};

use crate::axes::Axes;
use crate::content::{
    BaseForm, BaseImage, Bases, MAX_REDUCE_LOG2, MAX_SHRINK_LOG2, ResidualContent, stored_by,
};
use crate::decode::TexfoldResidualParams;
use crate::plane::{PlaneWords, ResidualPlane, level_blocks, plane_words};
use crate::rates::{RATE_CLASSES, RateModel, Rates};

/// Flag of a block-isolated base, beside its log2 downscale.
const ISOLATED_FLAG: u8 = 16;
/// Flag of a padded base.
const PADDED_FLAG: u8 = 32;
/// Where the binary logarithm of alpha's contrast stands, in two bits.
const GAIN_SHIFT: u8 = 6;
/// Bits of the base's log2 downscale, and behind them of the number of levels that are not stored.
const LOG2_BITS: u8 = 2;
/// Most bits of a block of class 1.
const MOST_CLASS_BITS: u32 = 32;
/// Coding of residual planes along axes of their own; 0: along luma and chroma.
const TURNED: u8 = 1;
/// Largest number of 4 bits.
const MAX_NIBBLE: u8 = 15;
/// Where the number of the residual plane's coding stands beside the bits of class 1.
const CODING_SHIFT: u8 = 4;
/// Sections of the form, the bases and the residual planes.
const FORM: [u8; 3] = *b"RSF";
const BASE: [u8; 3] = *b"RSB";
const PLANES: [u8; 3] = *b"RSP";

/// Bytes of memory that every image costs beside its texel data, loaded and as a GPU form.
const IMAGE_BYTES: u64 = (size_of::<BaseImage>()
    + size_of::<PlaneWords>()
    + 2 * size_of::<TexfoldResidualParams>()
    + 3 * size_of::<Plane<'_>>()
    + size_of::<ImageBinding>()
    // Heap blocks of at least 64 bytes: bytes of both base planes and their list, words, indices of bound planes.
    + 5 * 64) as u64;

impl ResidualContent {
    /// Id of the section with the form of content of that number.
    #[must_use]
    pub fn form_section(id: ContentId) -> [u8; 4] {
        id.section(FORM)
    }

    /// Writes form and bases.
    pub fn store_base(&self, id: ContentId, out: &mut SectionWriter) {
        let (form, model) = (self.form(), self.model());
        let turned = model.axes != Axes::default();
        let mut raw = vec![
            form.content.number(),
            form.reduce_log2 as u8
                | (form.shrink_log2 as u8) << LOG2_BITS
                | if form.isolated { ISOLATED_FLAG } else { 0 }
                | if form.padded { PADDED_FLAG } else { 0 }
                | (form.alpha_gain_log2 as u8) << GAIN_SHIFT,
            (model.class_bits / 16) as u8 | if turned { TURNED << CODING_SHIFT } else { 0 },
        ];
        raw.extend(model.weights.iter().flat_map(|weight| weight.to_le_bytes()));
        raw.extend(model.classes.iter().flat_map(|rates| rates.packed().to_le_bytes()));
        if turned {
            raw.extend(model.axes.packed().to_le_bytes());
        }
        out.section("container", id.section(FORM), &raw);
        let mut raw = Vec::new();
        for image in &self.bases().images {
            for level in 0..image.levels {
                (0..image.planes.len()).for_each(|plane| raw.extend(image.level_bytes(plane, level)));
            }
        }
        out.section(BASE_PART, id.section(BASE), &raw);
    }

    /// Writes the residual planes, where they are loaded.
    pub fn store_planes(&self, id: ContentId, out: &mut SectionWriter) {
        if self.planes().is_empty() {
            return;
        }
        let mut raw = Vec::new();
        for plane in self.planes() {
            raw.extend(pack(plane.classes()));
            raw.extend(pack(plane.scales()));
            raw.extend(plane.halves(self.model().class_bits).flat_map(u16::to_le_bytes));
        }
        out.section(RESIDUAL_PART, id.section(PLANES), &raw);
    }

    /// Reads what [`ResidualContent::store_base`] and, where the file has brought it,
    /// [`ResidualContent::store_planes`] wrote of images of that layout, unstored levels among them.
    ///
    /// # Errors
    /// [`LoadError`] where form or bases are missing, or a section says what no writer says.
    pub fn load(
        full: &ImageLayout,
        id: ContentId,
        file: &Sections<'_>,
        budget: &mut Budget,
    ) -> Result<Self, LoadError> {
        let raw = file.read(id.section(FORM), budget)?;
        let mut reader = Reader::new(String4(id.section(FORM)), &raw);
        let form = read_form(full, &mut reader)?;
        let model = read_model(&mut reader)?;
        budget.release(raw.len() as u64);
        let layout = stored_by(full, &form);
        budget.take(layout.images.len() as u64 * IMAGE_BYTES)?;
        let bases = read_bases(&layout, form, id, file, budget)?;
        let content = ResidualContent::of_bases(layout, Arc::new(bases)).with_words(model, Vec::new());
        Ok(content.with_rest(id, file, budget)?.unwrap_or(content))
    }

    /// As [`ResidualContent::load`], where the residual planes must be there, too.
    ///
    /// # Errors
    /// [`LoadError`] as there, and [`LoadError::Truncated`] where they are named and missing.
    pub fn load_whole(
        full: &ImageLayout,
        id: ContentId,
        file: &Sections<'_>,
        budget: &mut Budget,
    ) -> Result<Self, LoadError> {
        let content = Self::load(full, id, file, budget)?;
        if !content.is_whole() {
            // Re-read to report the precise truncation error.
            file.read(id.section(PLANES), budget)?;
        }
        Ok(content)
    }

    /// The content with its residual planes from a longer prefix of the file; `None` where it has them already or the
    /// file has not brought them.
    ///
    /// # Errors
    /// [`LoadError`] where the section says what no writer says, or is there though the form names no residual plane.
    pub fn with_rest(
        &self,
        id: ContentId,
        file: &Sections<'_>,
        budget: &mut Budget,
    ) -> Result<Option<Self>, LoadError> {
        if !self.planes().is_empty() {
            return Ok(None);
        }
        let named = file.ids().any(|(found, _)| found == id.section(PLANES));
        // What a prefix has loaded is stored without.
        if named && !self.has_planes() {
            let section = String4(id.section(PLANES));
            return Err(LoadError::Corrupt {
                section,
                offset: 0,
                what: "a residual plane that the form does not name",
            });
        }
        if !file.has(id.section(PLANES)) {
            return Ok(None);
        }
        let raw = file.read(id.section(PLANES), budget)?;
        let mut reader = Reader::new(String4(id.section(PLANES)), &raw);
        let mut planes = Vec::new();
        for size in &self.layout().images {
            let blocks = level_blocks(*size, self.layout().levels);
            planes.push(read_plane(blocks, self.model(), &mut reader, budget)?);
        }
        reader.end()?;
        budget.release(raw.len() as u64);
        Ok(Some(self.with_words(self.model().clone(), planes)))
    }
}

fn read_form(full: &ImageLayout, reader: &mut Reader<'_>) -> Result<BaseForm, LoadError> {
    let content = Content::read(reader)?;
    // Normals would be rebuilt behind the filter, before residuals are added.
    if !content.fits(full.pixel) || content.formats(full.pixel).1.0 == TEXFOLD_NORMAL {
        return Err(reader.corrupt("content that cannot hold the channels"));
    }
    let flags = reader.u8()?;
    let (isolated, padded) = (flags & ISOLATED_FLAG != 0, flags & PADDED_FLAG != 0);
    let shrink_log2 = u32::from(flags >> LOG2_BITS & ((1 << LOG2_BITS) - 1));
    let reduce_log2 = u32::from(flags & ((1 << LOG2_BITS) - 1));
    if !(1..=MAX_REDUCE_LOG2).contains(&reduce_log2) {
        return Err(reader.corrupt("a log2 downscale of the base outside 1..=3"));
    }
    if padded && isolated {
        return Err(reader.corrupt("a base that is padded and block-isolated"));
    }
    let alpha_gain_log2 = u32::from(flags >> GAIN_SHIFT);
    if alpha_gain_log2 > 0 && !full.pixel.has_extra() {
        return Err(reader.corrupt("contrast of alpha in an image without"));
    }
    if shrink_log2 > MAX_SHRINK_LOG2 || isolated && shrink_log2 > 0 {
        return Err(reader.corrupt("more than two levels not stored, or any beside a block-isolated base"));
    }
    Ok(BaseForm { content, reduce_log2, shrink_log2, isolated, padded, alpha_gain_log2 })
}

fn read_model(reader: &mut Reader<'_>) -> Result<RateModel, LoadError> {
    let coding = reader.u8()?;
    let (coding, kind) = (coding & MAX_NIBBLE, coding >> CODING_SHIFT);
    if kind > TURNED {
        return Err(reader.corrupt("a coding of the residual plane that this reader does not know"));
    }
    let class_bits = 16 * u32::from(coding);
    if class_bits > MOST_CLASS_BITS {
        return Err(reader.corrupt("more than 32 bits for the first class"));
    }
    let mut model = RateModel { class_bits, ..RateModel::default() };
    for weight in &mut model.weights {
        *weight = reader.u16()?;
    }
    for class in 0..RATE_CLASSES {
        let rates = Rates::unpacked(reader.u32()?).ok_or(reader.corrupt("too many bits of a coefficient"))?;
        let bits = rates.bits();
        if bits != 0 && bits != class_bits * class as u32 {
            return Err(reader.corrupt("a class of another number of bits"));
        }
        model.classes[class] = rates;
    }
    if kind == TURNED {
        let axes = Axes::unpacked(reader.u32()?).ok_or(reader.corrupt("axes with bits that mean nothing"))?;
        model = model.with_axes(axes);
    }
    reader.end()?;
    Ok(model)
}

fn read_bases(
    layout: &ImageLayout,
    form: BaseForm,
    id: ContentId,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<Bases, LoadError> {
    let (formats, _) = form.content.formats(layout.pixel);
    let raw = file.read(id.section(BASE), budget)?;
    budget.take(raw.len() as u64)?;
    let mut reader = Reader::new(String4(id.section(BASE)), &raw);
    let mut images = Vec::new();
    for &size in &layout.images {
        let (base, levels) = (form.base_size(size), form.levels(size, layout.levels));
        let planes = read_base(&formats, base, levels, &mut reader)?;
        // The CPU decoder's texels, which are decoded when they are first asked for.
        let texels: u64 = (0..levels).map(|level| base.at_level(level).texels()).sum();
        budget.take(texels * size_of::<Texel>() as u64)?;
        images.push(BaseImage::new(base, levels, planes));
    }
    reader.end()?;
    budget.release(raw.len() as u64);
    Ok(Bases::new(form, layout.pixel, images))
}

/// The bytes of each plane of one image's base, level after level; a file has them level by level, plane after plane.
fn read_base(
    formats: &[PlaneFormat],
    base: ImageSize,
    levels: u32,
    reader: &mut Reader<'_>,
) -> Result<Vec<(PlaneFormat, Vec<u8>)>, LoadError> {
    let mut planes: Vec<_> = formats.iter().map(|&format| (format, Vec::new())).collect();
    for level in 0..levels {
        let ImageSize { width, height } = base.at_level(level);
        for (format, pieces) in &mut planes {
            let length = usize::try_from(format.bytes(width, height)).unwrap_or(usize::MAX);
            pieces.push(reader.bytes(length)?);
        }
    }
    // Put together at once: a vector that grows has room for up to twice its bytes, as long as the texture is held.
    Ok(planes.into_iter().map(|(format, pieces)| (format, pieces.concat())).collect())
}

/// The plane of one image of so many blocks.
fn read_plane(
    blocks: u64,
    model: &RateModel,
    reader: &mut Reader<'_>,
    budget: &mut Budget,
) -> Result<PlaneWords, LoadError> {
    // Class and scale of each block, a byte each while the words are made.
    budget.take(2 * blocks)?;
    let blocks = usize::try_from(blocks).unwrap_or(usize::MAX);
    let classes = unpack(reader, blocks)?;
    if classes.iter().any(|&class| !model.allows(class)) {
        return Err(reader.corrupt("a block of a class that has no bits"));
    }
    let scales = unpack(reader, blocks)?;
    let halves: u64 = classes.iter().map(|&class| u64::from(class) * u64::from(model.class_bits / 16)).sum();
    let words = plane_words(blocks, halves);
    budget.take(4 * words + 2 * halves)?;
    let length = usize::try_from(2 * halves).unwrap_or(usize::MAX);
    let bits =
        reader.bytes(length)?.chunks_exact(2).map(|half| u16::from_le_bytes([half[0], half[1]])).collect();
    let plane = ResidualPlane { classes, scales, bits };
    let words =
        plane.words(model.class_bits).ok_or(reader.corrupt("a residual plane larger than a plane"))?;
    budget.release(2 * blocks as u64 + 2 * halves);
    Ok(words)
}

/// Two numbers of 4 bits a byte, the first in the low half.
fn pack(values: impl Iterator<Item = u8>) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (index, value) in values.enumerate() {
        match bytes.last_mut() {
            Some(last) if index % 2 == 1 => *last |= value << 4,
            _ => bytes.push(value),
        }
    }
    bytes
}

/// `count` numbers as [`pack`] packs them.
fn unpack(reader: &mut Reader<'_>, count: usize) -> Result<Vec<u8>, LoadError> {
    let bytes = reader.bytes(count.div_ceil(2))?;
    if count % 2 == 1 && bytes.last().is_some_and(|&last| last > MAX_NIBBLE) {
        return Err(reader.corrupt("bits after the last number"));
    }
    let mut values: Vec<u8> = bytes.iter().flat_map(|byte| [byte & 15, byte >> 4]).collect();
    values.truncate(count);
    Ok(values)
}
