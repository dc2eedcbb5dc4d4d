//! Bytes of a texture in blocks: header, index, tables, superblocks.
//!
//! | bytes | what |
//! |---|---|
//! | 1 | version: 1, 1 more with deblocking, 2 more where tables begin from the preset, 4 more where the index is lengths
//! alone, 8 more with dependent quantisers, 16 more where superblocks of the planes behind the image are 2x2 blocks, 32 more with
//! intra modes |
//! | 2, 2 | columns and rows, less one |
//! | 1, 1 | bits of a sample, binary logarithm of a superblock's side |
//! | 2, 1, 2 | step, slope, two offsets |
//! | 3 | stopping probabilities of no prediction, where there are intra modes |
//! | 1 | strength of deblocking, where there is any |
//! | 1 | groups; for each: 1 channels, then 2 for each mean, 2 for each of channels x channels weights of axes |
//! | 1, 2, 4 | bits of a length in the index, bytes of the tables, bytes of the superblocks |
//! | | index (its words, or the lengths alone), tables, superblocks: those of the coarsest base first, each plane row by row |
//!
//! So bytes that end early still hold the bases: superblocks that are missing decode to what their means predict.

use texfold_core::container::Reader;
use texfold_core::{Budget, ImageSize, LoadError};

use crate::deblock::MAX_DEBLOCKING;
use crate::decode::DctTexture;
use crate::form::{
    AXIS_BITS, BASE_LOG2, DctForm, Group, MAX_CHANNELS, MAX_GROUP, MAX_OFFSET, MAX_STEP, Quantiser,
};
use crate::gpu::words_before_index;
use crate::index::Index;
use crate::tables::{Begin, STOP_VALUES, StoredStops, Table};

/// Version of the layout without deblocking, with tables that begin alike and an index of words.
const PLAIN: u8 = 1;
/// Added to the version of a layout with deblocking.
const DEBLOCKED: u8 = 1;
/// Added where tables begin from the preset.
const PRESET: u8 = 2;
/// Added where the index holds lengths alone.
const PACKED: u8 = 4;
/// Added where quantisers are dependent.
const DEPENDENT: u8 = 8;
/// Added where superblocks of the planes behind the image are smaller than its own.
const SMALL_BASES: u8 = 16;
/// Added where blocks of the image have intra modes.
const INTRA: u8 = 32;
/// Most bits of a length in the index.
const MAX_WIDTH: u8 = 24;
/// Largest weight of an axis: an orthonormal one.
const MAX_WEIGHT: i16 = 1 << AXIS_BITS;

impl DctTexture {
    /// All bytes of the texture: those that [`DctTexture::read`] reads.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = self.base_bytes();
        out.extend(self.detail_bytes());
        out
    }

    /// Header, index, tables and the bases' superblocks: what [`DctTexture::read_base`] reads.
    #[must_use]
    pub fn base_bytes(&self) -> Vec<u8> {
        let mut out = self.header();
        if self.index.is_packed() {
            out.extend(self.index.packed(self.superblocks()));
        } else {
            out.extend(self.index.words().iter().flat_map(|word| word.to_le_bytes()));
        }
        out.extend(&self.stops.bytes);
        out.extend(&self.bytes[..self.base_length().min(self.bytes.len())]);
        out
    }

    /// The image's own superblocks: what [`DctTexture::with_detail`] takes. Nothing where they are not loaded.
    #[must_use]
    pub fn detail_bytes(&self) -> &[u8] {
        &self.bytes[self.base_length().min(self.bytes.len())..]
    }

    /// Bytes of header, index, tables and the superblocks that are loaded: the length of [`DctTexture::to_bytes`].
    #[must_use]
    pub fn held_bytes(&self) -> u64 {
        (self.bytes_before_streams() + self.bytes.len()) as u64
    }

    /// Bytes of header, index and tables.
    pub(super) fn bytes_before_streams(&self) -> usize {
        let index = if self.index.is_packed() {
            Index::packed_bytes(self.superblocks(), self.index.width())
        } else {
            4 * self.index.words().len()
        };
        self.header().len() + index + self.stops.bytes.len()
    }

    /// Superblocks of all planes.
    fn superblocks(&self) -> usize {
        self.form.planes().iter().map(|plane| plane.count()).sum()
    }

    /// Header: sizes, axes, quantiser, lengths.
    fn header(&self) -> Vec<u8> {
        let form = self.form();
        let deblocked = if form.deblocking > 0 { DEBLOCKED } else { 0 };
        let preset = if self.stops.begin == Begin::Preset { PRESET } else { 0 };
        let packed = if self.index.is_packed() { PACKED } else { 0 };
        let dependent = if form.quantiser.is_dependent { DEPENDENT } else { 0 };
        let small = if form.base_log2 < form.superblock_log2 { SMALL_BASES } else { 0 };
        let intra = if form.intra.is_some() { INTRA } else { 0 };
        let mut out = vec![PLAIN + deblocked + preset + packed + dependent + small + intra];
        out.extend(((form.size.width - 1) as u16).to_le_bytes());
        out.extend(((form.size.height - 1) as u16).to_le_bytes());
        out.extend([form.depth, form.superblock_log2]);
        out.extend(form.quantiser.step.to_le_bytes());
        out.extend([form.quantiser.slope, form.quantiser.offsets[0], form.quantiser.offsets[1]]);
        out.extend(form.intra.iter().flatten());
        out.extend((form.deblocking > 0).then_some(form.deblocking));
        out.push(form.groups.len() as u8);
        for group in &form.groups {
            let count = usize::from(group.channels);
            out.push(group.channels);
            out.extend(group.means[..count].iter().flat_map(|mean| mean.to_le_bytes()));
            let weights = group.axes[..count].iter().flat_map(|weights| &weights[..count]);
            out.extend(weights.flat_map(|weight| weight.to_le_bytes()));
        }
        out.push(self.index.width() as u8);
        out.extend((self.stops.bytes.len() as u16).to_le_bytes());
        out.extend(self.stream_bytes.to_le_bytes());
        out
    }

    /// Reads a texture. Superblocks are not looked into: any bytes decode.
    ///
    /// # Errors
    /// [`LoadError`] where the header says what no writer says, or the budget does not allow what decoding holds.
    pub fn read(reader: &mut Reader<'_>, budget: &mut Budget) -> Result<Self, LoadError> {
        Self::read_base(reader, budget)?.with_detail(reader, budget)
    }

    /// Reads a texture without the superblocks of the image: it decodes to what its bases say.
    ///
    /// # Errors
    /// As [`DctTexture::read`].
    pub fn read_base(reader: &mut Reader<'_>, budget: &mut Budget) -> Result<Self, LoadError> {
        let (form, begin, is_packed) = read_form(reader)?;
        budget.check_texels(form.size.texels())?;
        let width = reader.u8()?;
        if width > MAX_WIDTH {
            return Err(reader.corrupt("lengths of more than 24 bits"));
        }
        let table_bytes = usize::from(reader.u16()?);
        let stream_bytes = reader.u32()?;
        let planes = form.planes();
        let superblocks = planes.iter().map(|plane| plane.count()).sum();
        let words = Index::words_of(superblocks, u32::from(width));
        // The bases as they are decoded with the whole image: 4 bytes a sample.
        let bases: u64 = planes[1..].iter().map(|plane| plane.size.texels()).sum();
        budget.take(4 * bases * form.channels() as u64 + 4 * words as u64)?;
        // Tables, and the words that a GPU decodes with.
        let is_dependent = form.quantiser.is_dependent;
        budget.take((form.tables() * size_of::<Table>()) as u64)?;
        budget.take(4 * (words_before_index(planes.len(), &form) + words) as u64)?;
        let index = if is_packed {
            let lengths = reader.bytes(Index::packed_bytes(superblocks, u32::from(width)))?;
            Index::unpacked(u32::from(width), lengths, superblocks)
                .ok_or_else(|| reader.corrupt("superblocks of more than 4 GiB"))?
        } else {
            let index = reader.bytes(4 * words)?;
            let index =
                index.chunks_exact(4).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]));
            Index::new(u32::from(width), index.collect())
        };
        let stops = StoredStops { begin, is_dependent, bytes: reader.bytes(table_bytes)?.to_vec() };
        if stops.read().is_none() {
            return Err(reader.corrupt("tables of probabilities that no writer writes"));
        }
        let texture = DctTexture::new(form, stops, index, Vec::new(), stream_bytes);
        let bytes = reader.bytes(texture.base_length())?;
        budget.take((table_bytes + bytes.len()) as u64)?;
        Ok(texture.with_bytes(bytes.to_vec()))
    }

    /// The texture with the image's own superblocks.
    ///
    /// # Errors
    /// [`LoadError`] where there are too few bytes or the budget does not allow them.
    pub fn with_detail(self, reader: &mut Reader<'_>, budget: &mut Budget) -> Result<Self, LoadError> {
        let bytes = reader.bytes(self.stream_bytes as usize - self.base_length())?;
        budget.take(bytes.len() as u64)?;
        let all = [self.bytes.as_slice(), bytes].concat();
        Ok(self.with_bytes(all))
    }
}

fn read_form(reader: &mut Reader<'_>) -> Result<(DctForm, Begin, bool), LoadError> {
    let parts = reader.u8()?.wrapping_sub(PLAIN);
    if parts > DEBLOCKED + PRESET + PACKED + DEPENDENT + SMALL_BASES + INTRA {
        return Err(reader.corrupt("a layout of blocks that this reader does not know"));
    }
    let is_deblocked = parts & DEBLOCKED > 0;
    let is_packed = parts & PACKED > 0;
    let begin = if parts & PRESET > 0 { Begin::Preset } else { Begin::Alike };
    let (width, height) = (u32::from(reader.u16()?) + 1, u32::from(reader.u16()?) + 1);
    let (depth, superblock_log2) = (reader.u8()?, reader.u8()?);
    if depth != 8 && depth != 16 {
        return Err(reader.corrupt("samples of neither 8 nor 16 bits"));
    }
    if !(4..=6).contains(&superblock_log2) {
        return Err(reader.corrupt("superblocks of another side than 16, 32 or 64"));
    }
    let has_small_bases = parts & SMALL_BASES > 0;
    if has_small_bases && superblock_log2 == BASE_LOG2 {
        return Err(reader.corrupt("a layout of bases that no writer writes"));
    }
    let base_log2 = if has_small_bases { BASE_LOG2 } else { superblock_log2 };
    let (step, slope, offsets) = (reader.u16()?, reader.u8()?, [reader.u8()?, reader.u8()?]);
    if step > MAX_STEP || offsets.iter().any(|&offset| offset > MAX_OFFSET) {
        return Err(reader.corrupt("a quantiser beyond the largest"));
    }
    let quantiser = Quantiser { step, slope, offsets, is_dependent: parts & DEPENDENT > 0 };
    let intra = if parts & INTRA > 0 { Some([reader.u8()?, reader.u8()?, reader.u8()?]) } else { None };
    if intra.is_some_and(|none| !quantiser.is_dependent || none.iter().any(|&stop| stop >= STOP_VALUES as u8))
    {
        return Err(reader.corrupt("intra modes that no writer writes"));
    }
    let deblocking = if is_deblocked { reader.u8()? } else { 0 };
    if is_deblocked && !(1..=MAX_DEBLOCKING).contains(&deblocking) {
        return Err(reader.corrupt("a strength of deblocking that no writer writes"));
    }
    let mut groups = Vec::new();
    let mut channels = 0;
    for _ in 0..reader.u8()? {
        let group = read_group(reader)?;
        channels += usize::from(group.channels);
        if channels > MAX_CHANNELS {
            return Err(reader.corrupt("more than 16 channels"));
        }
        groups.push(group);
    }
    if groups.is_empty() {
        return Err(reader.corrupt("no channels"));
    }
    let size = ImageSize { width, height };
    let form = DctForm { size, depth, superblock_log2, base_log2, quantiser, intra, deblocking, groups };
    Ok((form, begin, is_packed))
}

fn read_group(reader: &mut Reader<'_>) -> Result<Group, LoadError> {
    let channels = reader.u8()?;
    if !(1..=MAX_GROUP).contains(&usize::from(channels)) {
        return Err(reader.corrupt("a group of none or more than four channels"));
    }
    let mut group = Group { channels, means: [0; MAX_GROUP], axes: [[0; MAX_GROUP]; MAX_GROUP] };
    for mean in &mut group.means[..usize::from(channels)] {
        *mean = reader.u16()?;
    }
    for weights in &mut group.axes[..usize::from(channels)] {
        for weight in &mut weights[..usize::from(channels)] {
            *weight = reader.u16()? as i16;
            if !(-MAX_WEIGHT..=MAX_WEIGHT).contains(weight) {
                return Err(reader.corrupt("an axis longer than one"));
            }
        }
    }
    Ok(group)
}
