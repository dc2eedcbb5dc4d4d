//! Sections of an `epitome` file: "EPFM" (form of the map and the planes), "EPPL" (linear parts and tones), "EPTR" (how
//! blocks are split), "EPEN" (entries, field by field, positions as what differs from the leaf before), "EPAT" (planes of
//! the epitomes), "EPMC" (coarse mip levels).

use texfold_bc::{Content, ContentPlanes};
use texfold_core::container::{Notes, Reader, SectionWriter, Sections, read_layout};
use texfold_core::{Budget, ImageLayout, LoadError, String4};

use crate::encoded::{
    Entry, EpitomeTexture, Linear, MAX_BLOCK, MapFormat, PLANE_MIPS, Parts, Tone, blocks_of, coarse_content,
    coarse_levels, leaves_of,
};

const FORM_ID: [u8; 4] = *b"EPFM";
const PALETTE_ID: [u8; 4] = *b"EPPL";
const TREE_ID: [u8; 4] = *b"EPTR";
const ENTRY_ID: [u8; 4] = *b"EPEN";
const PLANE_ID: [u8; 4] = *b"EPAT";
const COARSE_ID: [u8; 4] = *b"EPMC";

/// Longest side of an epitome in texels: what every WebGPU device can sample.
pub(crate) const MAX_EPITOME_SIDE: u32 = 8192;
/// Most entries and most blocks: the map plane, with up to one and a half words an entry, has at most 8192 x 8192 words.
pub(crate) const MAX_ENTRIES: u64 = 1 << 25;
/// Blocks of these sides are allowed.
const BLOCK_SIDES: std::ops::RangeInclusive<u32> = 4..=MAX_BLOCK as u32;

pub(crate) fn store(parts: &Parts, out: &mut SectionWriter) {
    let format = &parts.format;
    let mips = parts.epitomes.first().is_some_and(|levels| levels.len() > 1);
    let mut form: Vec<u8> = [
        format.block,
        u32::from(format.split),
        format.x_bits,
        format.y_bits,
        format.fraction_bits,
        format.tone_bits,
        format.linear_bits,
        u32::from(mips),
        parts.epitomes.len() as u32,
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
    form.extend((parts.linears.len() as u32).to_le_bytes());
    form.extend((parts.tones.len() as u32).to_le_bytes());
    out.section("container", FORM_ID, &form);
    let linears = parts.linears.iter().flatten().flat_map(|value| value.to_le_bytes());
    let palettes: Vec<u8> = linears.chain(parts.tones.iter().flatten().copied()).collect();
    out.section("map", PALETTE_ID, &palettes);
    out.section("map", TREE_ID, &parts.trees);
    out.section("map", ENTRY_ID, &entry_bytes(&parts.entries));
    let bytes = |levels: &[ContentPlanes]| -> Vec<u8> {
        levels.iter().flat_map(|level| level.planes()).flat_map(|(_, bytes)| bytes).copied().collect()
    };
    out.section(
        "epitome",
        PLANE_ID,
        &parts.epitomes.iter().flat_map(|levels| bytes(levels)).collect::<Vec<u8>>(),
    );
    if parts.coarse.iter().any(|levels| !levels.is_empty()) {
        out.section(
            "mips",
            COARSE_ID,
            &parts.coarse.iter().flat_map(|levels| bytes(levels)).collect::<Vec<u8>>(),
        );
    }
}

/// All entries, byte plane by byte plane: equal bytes stand together, which compresses better.
fn entry_bytes(entries: &[Entry]) -> Vec<u8> {
    let mut planes: [Vec<u8>; 7] = Default::default();
    let (mut x, mut y) = (0u32, 0u32);
    for entry in entries {
        let across = (entry.x.wrapping_sub(x) as u16).to_le_bytes();
        let down = (entry.y.wrapping_sub(y) as u16).to_le_bytes();
        (x, y) = (entry.x, entry.y);
        let bytes =
            [across[0], across[1], down[0], down[1], entry.tone as u8, entry.linear as u8, entry.plane as u8];
        for (plane, byte) in planes.iter_mut().zip(bytes) {
            plane.push(byte);
        }
    }
    planes.concat()
}

pub(crate) fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<EpitomeTexture, LoadError> {
    let notes = Notes::read(file, budget)?;
    let layout = read_layout(file, budget)?;
    let raw = file.read(FORM_ID, budget)?;
    let form = read_form(&mut Reader::new(String4(FORM_ID), &raw), &layout)?;
    let raw = file.read(PALETTE_ID, budget)?;
    let (linears, tones) = read_palettes(&mut Reader::new(String4(PALETTE_ID), &raw), &form)?;
    let trees = file.read(TREE_ID, budget)?;
    let leaves = count_leaves(&trees, &form.format, &layout)?;
    let raw = file.read(ENTRY_ID, budget)?;
    let entries = read_entries(&raw, leaves, &form, budget)?;
    let raw = file.read(PLANE_ID, budget)?;
    let mut reader = Reader::new(String4(PLANE_ID), &raw);
    let mut epitomes = Vec::new();
    for &(content, width, height) in &form.epitomes {
        let count = if form.mips { 1 + PLANE_MIPS } else { 1 };
        let sizes = (0..count).map(|level| (width >> level, height >> level));
        epitomes.push(read_planes(&mut reader, content, &layout, sizes, budget)?);
    }
    reader.end()?;
    let coarse = read_coarse(file, &form, &layout, budget)?;
    budget.take(8 * (trees.len() + entries.len()) as u64)?;
    let parts = Parts { layout, format: form.format, trees, entries, linears, tones, epitomes, coarse };
    Ok(EpitomeTexture::new(parts, notes))
}

struct Form {
    format: MapFormat,
    mips: bool,
    epitomes: Vec<(Content, u32, u32)>,
    linears: u32,
    tones: u32,
}

fn read_form(reader: &mut Reader<'_>, layout: &ImageLayout) -> Result<Form, LoadError> {
    let mut field = |most: u8, what: &'static str| -> Result<u32, LoadError> {
        let value = reader.u8()?;
        if value > most { Err(reader.corrupt(what)) } else { Ok(u32::from(value)) }
    };
    let mut format = MapFormat {
        block: field(64, "a block above 64 texels")?,
        split: field(1, "a flag above 1")? == 1,
        x_bits: field(16, "a field above 16 bits")?,
        y_bits: field(16, "a field above 16 bits")?,
        fraction_bits: field(3, "a fraction above 3 bits")?,
        tone_bits: field(8, "a field above 8 bits")?,
        linear_bits: field(8, "a field above 8 bits")?,
        mixed: false,
    };
    let mips = field(1, "a flag above 1")? == 1;
    let count = field(2, "more than two epitomes")?;
    format.mixed = count == 2;
    if count == 0
        || !BLOCK_SIDES.contains(&format.block)
        || !format.block.is_multiple_of(4)
        || format.entry_bytes() > 6
    {
        return Err(reader.corrupt("a map that no writer makes"));
    }
    let mut epitomes = Vec::new();
    for _ in 0..count {
        let content = Content::read(reader)?;
        let (width, height) = (reader.u32()?, reader.u32()?);
        let step = content.cell_side() << if mips { PLANE_MIPS } else { 0 };
        let fits = |side: u32| side.is_multiple_of(step) && (step..=MAX_EPITOME_SIDE).contains(&side);
        if !fits(width) || !fits(height) || !content.fits(layout.pixel) {
            return Err(reader.corrupt("an epitome of a size or content that no writer makes"));
        }
        // Two epitomes are told apart by their texture, so each is one.
        if count == 2 && content.formats(layout.pixel).0.len() > 1 {
            return Err(reader.corrupt("two epitomes of several planes"));
        }
        epitomes.push((content, width, height));
    }
    let swizzle = |index: usize| epitomes.get(index).map(|(content, ..)| content.formats(layout.pixel).1);
    if count == 2 && swizzle(0) != swizzle(1) {
        return Err(reader.corrupt("two epitomes whose channels differ"));
    }
    let (linears, tones) = (reader.u32()?, reader.u32()?);
    let fits = |count: u32, bits: u32| (1..=1 << bits).contains(&count);
    if !fits(linears, format.linear_bits) || !fits(tones, format.tone_bits) {
        return Err(reader.corrupt("a palette longer than its numbers"));
    }
    reader.end()?;
    // The epitome's mip levels and the coarse chain are there together.
    if mips != (layout.levels > 1) {
        return Err(
            reader.corrupt("mip levels of the epitome without mip levels of the images, or the other way")
        );
    }
    Ok(Form { format, mips, epitomes, linears, tones })
}

fn read_palettes(reader: &mut Reader<'_>, form: &Form) -> Result<(Vec<Linear>, Vec<Tone>), LoadError> {
    let (mut linears, mut tones) = (Vec::new(), Vec::new());
    for _ in 0..form.linears {
        let mut linear: Linear = [0; 4];
        for value in &mut linear {
            *value = reader.u16()? as i16;
        }
        linears.push(linear);
    }
    for _ in 0..form.tones {
        tones.push(reader.array()?);
    }
    reader.end()?;
    Ok((linears, tones))
}

/// Checks the tree bytes against the layout; gives the number of leaves.
fn count_leaves(trees: &[u8], format: &MapFormat, layout: &ImageLayout) -> Result<u64, LoadError> {
    let reader = Reader::new(String4(TREE_ID), trees);
    let blocks: u64 = layout
        .surfaces
        .iter()
        .map(|&size| blocks_of(size, format.block))
        .map(|(columns, rows)| u64::from(columns) * u64::from(rows))
        .sum();
    let wanted = if format.split { blocks } else { 0 };
    if trees.len() as u64 != wanted {
        return Err(reader.corrupt("another number of blocks than the layout has"));
    }
    if trees.iter().any(|&tree| tree > 31 || (tree & 1 == 0 && tree != 0)) {
        return Err(reader.corrupt("a block split in a way that no writer makes"));
    }
    let split_needs = if format.split { 16 } else { 4 };
    if !format.block.is_multiple_of(split_needs) {
        return Err(reader.corrupt("blocks that cannot be split twice"));
    }
    let leaves =
        if format.split { trees.iter().map(|&tree| u64::from(leaves_of(tree))).sum() } else { blocks };
    if leaves > MAX_ENTRIES {
        Err(reader.corrupt("more leaves than an entry's number can tell"))
    } else {
        Ok(leaves)
    }
}

fn read_entries(raw: &[u8], leaves: u64, form: &Form, budget: &mut Budget) -> Result<Vec<Entry>, LoadError> {
    let reader = Reader::new(String4(ENTRY_ID), raw);
    if raw.len() as u64 != 7 * leaves {
        return Err(reader.corrupt("another number of leaves than the blocks have"));
    }
    budget.take(leaves * size_of::<Entry>() as u64)?;
    let count = leaves as usize;
    let byte = |plane: usize, index: usize| u32::from(raw[plane * count + index]);
    let (mut x, mut y) = (0u32, 0u32);
    let mut entries = Vec::new();
    for index in 0..count {
        x = x.wrapping_add(byte(0, index) | byte(1, index) << 8) & 0xffff;
        y = y.wrapping_add(byte(2, index) | byte(3, index) << 8) & 0xffff;
        let entry = Entry { x, y, tone: byte(4, index), linear: byte(5, index), plane: byte(6, index) };
        let format = &form.format;
        if entry.x >> format.x_bits != 0
            || entry.y >> format.y_bits != 0
            || entry.tone >= form.tones
            || entry.linear >= form.linears
            || entry.plane > u32::from(format.mixed)
        {
            return Err(reader.corrupt("an entry outside of what its fields can hold"));
        }
        entries.push(entry);
    }
    Ok(entries)
}

fn read_planes(
    reader: &mut Reader<'_>,
    content: Content,
    layout: &ImageLayout,
    sizes: impl Iterator<Item = (u32, u32)>,
    budget: &mut Budget,
) -> Result<Vec<ContentPlanes>, LoadError> {
    let mut levels = Vec::new();
    for (width, height) in sizes {
        let mut planes = Vec::new();
        for format in content.formats(layout.pixel).0 {
            planes.push(reader.bytes(format.bytes(width, height) as usize)?.to_vec());
        }
        budget.take(u64::from(width) * u64::from(height) * 16)?;
        let planes = ContentPlanes::from_planes(content, layout.pixel, (width, height), planes);
        levels.push(planes.ok_or(reader.corrupt("planes of another size"))?);
    }
    Ok(levels)
}

fn read_coarse(
    file: &Sections<'_>,
    form: &Form,
    layout: &ImageLayout,
    budget: &mut Budget,
) -> Result<Vec<Vec<ContentPlanes>>, LoadError> {
    let levels = coarse_levels(layout.levels);
    if levels.is_empty() {
        return Ok(Vec::new());
    }
    let raw = file.read(COARSE_ID, budget)?;
    let mut reader = Reader::new(String4(COARSE_ID), &raw);
    let content = form.epitomes.first().map_or(Content::Raw, |&(content, ..)| content);
    let content = coarse_content(content, layout.pixel);
    let mut coarse = Vec::new();
    for size in &layout.surfaces {
        let sizes = levels.clone().map(|level| size.at_level(level)).map(|size| (size.width, size.height));
        coarse.push(read_planes(&mut reader, content, layout, sizes, budget)?);
    }
    reader.end()?;
    Ok(coarse)
}
