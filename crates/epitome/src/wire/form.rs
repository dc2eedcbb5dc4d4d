//! What all of a file is read by: the form of the map and the epitomes ("EPFM"), 2x2 matrices and gain-offset pairs
//! ("EPPL").

use texfold_bc::{Content, ContentPlanes};
use texfold_core::container::{Reader, SectionWriter, Sections, read_layout};
use texfold_core::{Budget, ImageLayout, ImageSize, LoadError, MAX_PLANE_SIDE, String4};
use texfold_residual::BLOCK_SIDE;

use crate::decode::TexfoldEpitomeParams;
use crate::format::{Entry, LEAST_SEAM_WIDTH, MAX_BLOCK, MapFormat, Matrix, Palettes};
use crate::parts::{PLANE_MIPS, Parts, TRANSFORM_SIDE, coarse_levels, epitome_size};

pub(super) const FORM_ID: [u8; 4] = *b"EPFM";
const PALETTE_ID: [u8; 4] = *b"EPPL";

/// Flag of mip levels.
const MIPS_FLAG: u32 = 1;
/// Flag of an epitome with a residual plane.
const ERRORS_FLAG: u32 = 2;
/// Flag of leaves that are blended in wider seams than between their outermost texels.
const SEAM_FLAG: u32 = 4;
/// Flag of coarse mip levels in BC7 beside an epitome in BC1.
const COARSE_FLAG: u32 = 8;
/// Flag of an epitome and coarse mip levels in blocks of variable length.
const BLOCKS_FLAG: u32 = 16;
/// Bytes that a texture holds for each image, whatever its size: its uniform block, twice where it is lent to a GPU,
/// and lists of its planes and levels.
const IMAGE_BYTES: u64 = 2 * size_of::<TexfoldEpitomeParams>() as u64 + 256;
/// Bytes of a palette's entry while it grows, and in the map plane.
const PALETTE_BYTES: u64 = 32;
/// Most bytes of an entry: with any start in a word, its bits lie in two words.
const MAX_ENTRY_BYTES: u32 = 6;
/// Blocks of these sides are allowed.
const BLOCK_SIDES: std::ops::RangeInclusive<u32> = 4..=MAX_BLOCK as u32;

pub(super) fn store_head(parts: &Parts, out: &mut SectionWriter) {
    let format = &parts.format;
    let mips = parts.layout.levels > 1;
    let is_wide = format.seam_width > LEAST_SEAM_WIDTH;
    let flags = if mips { MIPS_FLAG } else { 0 }
        | if parts.errors.is_some() { ERRORS_FLAG } else { 0 }
        | if is_wide { SEAM_FLAG } else { 0 }
        | if parts.has_finer_coarse() { COARSE_FLAG } else { 0 }
        | if parts.blocks.is_some() { BLOCKS_FLAG } else { 0 };
    let coded = usize::from(parts.errors.is_some()) + usize::from(parts.blocks.is_some());
    let mut form: Vec<u8> = [
        format.block,
        u32::from(format.split),
        format.x_bits,
        format.y_bits,
        format.fraction_bits,
        format.gain_offset_bits,
        format.matrix_bits,
        flags,
        (parts.epitomes.len() + coded) as u32,
    ]
    .map(|value| value as u8)
    .to_vec();
    for epitome in &parts.epitomes {
        let Some(base) = epitome.first() else { continue };
        let number = base.content().number();
        form.push(number);
        form.extend(base.size().0.to_le_bytes());
        form.extend(base.size().1.to_le_bytes());
    }
    if let Some(errors) = &parts.errors {
        form.push(errors.form().content.number());
        form.extend(epitome_size(errors).iter().flat_map(|side| side.to_le_bytes()));
    }
    if let Some(blocks) = &parts.blocks {
        let ImageSize { width, height } = blocks.size();
        form.push(Content::Raw.number());
        form.extend([width, height].iter().flat_map(|side| side.to_le_bytes()));
    }
    form.extend((parts.palettes.matrices.len() as u32).to_le_bytes());
    form.extend((parts.palettes.gain_offsets.len() as u32).to_le_bytes());
    form.extend(is_wide.then_some(format.seam_width as u8));
    out.section("container", FORM_ID, &form);
    let matrices = parts.palettes.matrices.iter().flatten().flat_map(|value| value.to_le_bytes());
    let palettes: Vec<u8> = matrices.chain(parts.palettes.gain_offsets.iter().flatten().copied()).collect();
    out.section("map", PALETTE_ID, &palettes);
}

impl Parts {
    /// Whether the coarse mip levels are in BC7, the epitome in BC1.
    fn has_finer_coarse(&self) -> bool {
        let coarse = self.coarse.first().and_then(|levels| levels.first());
        let base = self.epitomes.first().and_then(|levels| levels.first());
        let base = base.map(ContentPlanes::content);
        let base = base.or(self.errors.as_ref().map(|errors| errors.form().content));
        base == Some(Content::Bc1) && coarse.is_some_and(|coarse| coarse.content() == Content::Bc7)
    }
}

/// What all layers share.
pub(super) struct Head {
    pub(super) layout: ImageLayout,
    pub(super) form: Form,
    pub(super) palettes: Palettes,
}

pub(super) fn read_head(file: &Sections<'_>, budget: &mut Budget) -> Result<Head, LoadError> {
    let layout = read_layout(file, budget)?;
    budget.take(IMAGE_BYTES * layout.images.len() as u64)?;
    let raw = file.read(FORM_ID, budget)?;
    let form = read_form(&mut Reader::new(String4(FORM_ID), &raw), &layout)?;
    budget.take(PALETTE_BYTES * u64::from(form.matrices + form.gain_offsets))?;
    let raw = file.read(PALETTE_ID, budget)?;
    let palettes = read_palettes(&mut Reader::new(String4(PALETTE_ID), &raw), &form)?;
    Ok(Head { layout, form, palettes })
}

/// How an epitome is stored, and its columns and rows in texels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct EpitomeForm {
    pub(super) content: Content,
    pub(super) width: u32,
    pub(super) height: u32,
}

pub(super) struct Form {
    pub(super) format: MapFormat,
    pub(super) mips: bool,
    /// Whether the epitome has a residual plane.
    pub(super) errors: bool,
    /// Whether the epitome is in blocks of variable length.
    pub(super) in_blocks: bool,
    /// Whether the coarse mip levels are in BC7, the epitome in BC1.
    pub(super) finer: bool,
    pub(super) epitomes: Vec<EpitomeForm>,
    matrices: u32,
    gain_offsets: u32,
}

impl Form {
    /// The epitomes without a residual plane.
    pub(super) fn plain(&self) -> &[EpitomeForm] {
        &self.epitomes[..self.epitomes.len() - usize::from(self.errors || self.in_blocks)]
    }

    /// Sizes of an epitome's levels.
    pub(super) fn level_sizes(
        &self,
        &EpitomeForm { width, height, .. }: &EpitomeForm,
    ) -> impl Iterator<Item = (u32, u32)> + use<> {
        let count = if self.mips { 1 + PLANE_MIPS } else { 1 };
        (0..count).map(move |level| (width >> level, height >> level))
    }

    /// Sides of epitomes are multiples of this.
    pub(super) fn step(&self) -> u32 {
        if self.mips { 4 << PLANE_MIPS } else { 4 }
    }

    /// Whether the fields of the map can hold an entry, and the palettes have what it names.
    pub(super) fn holds(&self, entry: &Entry) -> bool {
        entry.x >> self.format.x_bits == 0
            && entry.y >> self.format.y_bits == 0
            && entry.gain_offset < self.gain_offsets
            && entry.matrix < self.matrices
            && entry.plane <= u32::from(self.format.mixed)
    }
}

fn read_form(reader: &mut Reader<'_>, layout: &ImageLayout) -> Result<Form, LoadError> {
    let mut format = read_fields(reader)?;
    let flags = u32::from(reader.u8()?);
    if flags > 31 {
        return Err(reader.corrupt("a flag above 31"));
    }
    let has = |flag: u32| flags & flag != 0;
    let (mips, errors, finer, in_blocks) =
        (has(MIPS_FLAG), has(ERRORS_FLAG), has(COARSE_FLAG), has(BLOCKS_FLAG));
    let count = reader.u8()?;
    format.mixed = count == 2;
    if !(1..=2).contains(&count) {
        return Err(reader.corrupt("not one or two epitomes"));
    }
    if in_blocks && (count == 2 || errors || finer) {
        return Err(reader.corrupt("planes beside an epitome in blocks"));
    }
    if !BLOCK_SIDES.contains(&format.block)
        || !format.block.is_multiple_of(4)
        || format.entry_bytes() > MAX_ENTRY_BYTES
    {
        return Err(reader.corrupt("a map that no writer makes"));
    }
    let mut epitomes = Vec::new();
    for index in 1..=count {
        epitomes.push(read_epitome(reader, layout, mips, (errors && index == count, in_blocks))?);
    }
    check_pair(reader, layout, &epitomes)?;
    let (matrices, gain_offsets) = (reader.u32()?, reader.u32()?);
    let fits = |count: u32, bits: u32| (1..=1 << bits).contains(&count);
    if !fits(matrices, format.matrix_bits) || !fits(gain_offsets, format.gain_offset_bits) {
        return Err(reader.corrupt("a palette longer than its numbers"));
    }
    if flags & SEAM_FLAG != 0 {
        format.seam_width = u32::from(reader.u8()?);
        // Half a leaf on each side of a border.
        if !(LEAST_SEAM_WIDTH + 1..=4 * format.cell()).contains(&format.seam_width) {
            return Err(reader.corrupt("a seam narrower than a texel or wider than a leaf"));
        }
    }
    reader.end()?;
    if finer && (coarse_levels(layout.levels).is_empty() || epitomes[0].content != Content::Bc1) {
        return Err(reader.corrupt("finer coarse levels where no writer makes them"));
    }
    // The epitome's mip levels and the coarse chain are there together.
    if mips != (layout.levels > 1) {
        return Err(
            reader.corrupt("mip levels of the epitome without mip levels of the images, or the other way")
        );
    }
    Ok(Form { format, mips, errors, in_blocks, finer, epitomes, matrices, gain_offsets })
}

/// The map's fields; whether there are two epitomes follows.
fn read_fields(reader: &mut Reader<'_>) -> Result<MapFormat, LoadError> {
    let mut field = |most: u8, what: &'static str| -> Result<u32, LoadError> {
        let value = reader.u8()?;
        if value > most { Err(reader.corrupt(what)) } else { Ok(u32::from(value)) }
    };
    Ok(MapFormat {
        block: field(64, "a block above 64 texels")?,
        split: field(1, "a flag above 1")? == 1,
        x_bits: field(16, "a field above 16 bits")?,
        y_bits: field(16, "a field above 16 bits")?,
        fraction_bits: field(3, "a fraction above 3 bits")?,
        gain_offset_bits: field(8, "a field above 8 bits")?,
        matrix_bits: field(8, "a field above 8 bits")?,
        mixed: false,
        seam_width: LEAST_SEAM_WIDTH,
    })
}

/// How one epitome is stored, the one with a residual plane where `errors` says so, or in blocks.
fn read_epitome(
    reader: &mut Reader<'_>,
    layout: &ImageLayout,
    mips: bool,
    (errors, in_blocks): (bool, bool),
) -> Result<EpitomeForm, LoadError> {
    let content = Content::read(reader)?;
    let (width, height) = (reader.u32()?, reader.u32()?);
    let side = match (errors, in_blocks) {
        (_, true) => TRANSFORM_SIDE,
        (true, _) => BLOCK_SIDE,
        _ => Content::CELL_SIDE,
    };
    if in_blocks && content != Content::Raw {
        return Err(reader.corrupt("a format of planes for an epitome in blocks"));
    }
    let step = side << if mips { PLANE_MIPS } else { 0 };
    let fits = |side: u32| side.is_multiple_of(step) && (step..=MAX_PLANE_SIDE).contains(&side);
    if !fits(width) || !fits(height) || !content.fits(layout.pixel) {
        return Err(reader.corrupt("an epitome of a size or content that no writer makes"));
    }
    Ok(EpitomeForm { content, width, height })
}

/// Whether two epitomes can be drawn as one: each is one texture, and both are read alike.
fn check_pair(reader: &Reader<'_>, layout: &ImageLayout, epitomes: &[EpitomeForm]) -> Result<(), LoadError> {
    let [first, second] = epitomes else { return Ok(()) };
    let [first, second] = [first, second].map(|epitome| epitome.content.formats(layout.pixel));
    if first.0.len() > 1 || second.0.len() > 1 {
        return Err(reader.corrupt("two epitomes of several planes"));
    }
    if first.1 != second.1 {
        return Err(reader.corrupt("two epitomes whose channels differ"));
    }
    Ok(())
}

fn read_palettes(reader: &mut Reader<'_>, form: &Form) -> Result<Palettes, LoadError> {
    let mut palettes = Palettes::default();
    for _ in 0..form.matrices {
        let mut matrix: Matrix = [0; 4];
        for value in &mut matrix {
            *value = reader.u16()? as i16;
        }
        palettes.matrices.push(matrix);
    }
    for _ in 0..form.gain_offsets {
        palettes.gain_offsets.push(reader.array()?);
    }
    reader.end()?;
    palettes.matrices.shrink_to_fit();
    palettes.gain_offsets.shrink_to_fit();
    Ok(palettes)
}
