//! Sections of a `progressive` file: "PRFM" (form of base and error map), "PRBA" (planes of the bases), "PRCB" (planes of the
//! texture's own codebook), "PRMP" (form and entries of the map), "PREM" (error maps: for
//! each image the classes of all blocks, their scales, then their bits). "PREM" is the second layer: a prefix of the file
//! without it is the enlarged base.

use std::sync::Arc;

use texfold_bc::{Content, ContentPlanes};
use texfold_core::container::{Notes, Reader, SectionWriter, Sections, read_layout};
use texfold_core::sample::TEXFOLD_NORMAL;
use texfold_core::{Budget, ImageLayout, LoadError, String4, SurfaceSize};

use crate::ProgressiveTexture;
use crate::codebook::{
    CODEBOOK_PIXEL, Codebook, Details, MAX_CODEBOOK_SIDE, MapForm, pack_entries, unpack_entries,
};
use crate::encoded::{
    BASE_PART, ERROR_PART, ErrorMap, MAP_PART, MARGIN, PRIVATE_PART, PUBLIC_PART, Parts, base_levels,
    blocks_of, stored_layout,
};
use crate::params::{MAX_REDUCE_LOG2, MAX_SHRINK_LOG2};
use crate::rates::{CLASSES, Model, Rates};

const FORM_ID: [u8; 4] = *b"PRFM";
const BASE_ID: [u8; 4] = *b"PRBA";
const CODEBOOK_ID: [u8; 4] = *b"PRCB";
const PUBLIC_ID: [u8; 4] = *b"PRPB";
const MAP_ID: [u8; 4] = *b"PRMP";
const ERROR_ID: [u8; 4] = *b"PREM";

/// Flag of a base that is blended within blocks alone, beside its halvings.
const APART_FLAG: u8 = 16;
/// The same where the base goes on beyond the borders of images.
const MARGIN_FLAG: u8 = 32;
/// Bits of halvings of the base, and behind them of the largest level.
const HALVING_BITS: u8 = 2;
/// Most bits of a block of class 1: two 16-bit halves.
const MOST_CLASS_BITS: u32 = 32;
/// Largest number of 4 bits.
const MAX_NIBBLE: u8 = 15;

pub(crate) fn store(parts: &Parts, out: &mut SectionWriter) {
    let model = &parts.model;
    let content = parts.bases[0][0].content();
    let mut form = vec![
        content.number(),
        parts.reduce_log2 as u8
            | (parts.shrink_log2 as u8) << HALVING_BITS
            | if parts.apart { APART_FLAG } else { 0 }
            | if parts.margin > 0 { MARGIN_FLAG } else { 0 },
        (model.class_bits / 16) as u8,
    ];
    form.extend(model.weights.iter().flat_map(|weight| weight.to_le_bytes()));
    form.extend(model.classes.iter().flat_map(|rates| rates.packed().to_le_bytes()));
    out.section("container", FORM_ID, &form);
    let planes = parts.bases.iter().flatten().flat_map(ContentPlanes::planes);
    let raw: Vec<u8> = planes.flat_map(|(_, bytes)| bytes).copied().collect();
    out.section(BASE_PART, BASE_ID, &raw);
    if let Some(details) = &parts.details {
        store_details(details, out);
    }
    if !parts.maps.is_empty() {
        let raw: Vec<u8> = parts.maps.iter().flat_map(map_bytes).collect();
        out.section(ERROR_PART, ERROR_ID, &raw);
    }
}

/// Rows and columns of both codebooks, the layout of entries, the least gain; the texture's own codebook; the entries of all
/// images, each as its own words. The public codebook is named by its size and checksum.
fn store_details(details: &Details, out: &mut SectionWriter) {
    if let Some(book) = &details.private {
        let mut raw = vec![book.planes().content().number()];
        raw.extend(book.planes().planes().iter().flat_map(|(_, bytes)| bytes));
        out.section(PRIVATE_PART, CODEBOOK_ID, &raw);
    }
    let mut raw: Vec<u8> = details.sizes().iter().flat_map(|size| size.to_le_bytes()).collect();
    let checksum = details.public.as_ref().map_or(0, |book| book.checksum());
    raw.extend(checksum.to_le_bytes());
    raw.extend(details.form.packed().to_le_bytes());
    raw.extend(details.gain_unit.to_le_bytes());
    for entries in &details.entries {
        let words = pack_entries(entries, details.form);
        let words = &words[..words.len() - 1];
        raw.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    }
    out.section(MAP_PART, MAP_ID, &raw);
}

fn map_bytes(map: &ErrorMap) -> Vec<u8> {
    let mut raw = pack(&map.classes);
    raw.extend(pack(&map.scales));
    raw.extend(map.bits.iter().flat_map(|half| half.to_le_bytes()));
    raw
}

/// Two numbers of 4 bits a byte, the first in the low half.
fn pack(values: &[u8]) -> Vec<u8> {
    values.chunks(2).map(|pair| pair[0] | pair.get(1).copied().unwrap_or(0) << 4).collect()
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

/// Loads a texture; `public` is the codebook that it shares with others, or one that grew from it.
pub(crate) fn load(
    file: &Sections<'_>,
    public: Option<&Codebook>,
    budget: &mut Budget,
) -> Result<ProgressiveTexture, LoadError> {
    let notes = Notes::read(file, budget)?;
    let layout = read_layout(file, budget)?;
    load_parts(layout, (notes, public), file, budget)
}

/// The texture of images of that layout, which the file says elsewhere.
fn load_parts(
    layout: ImageLayout,
    (notes, public): (Notes, Option<&Codebook>),
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<ProgressiveTexture, LoadError> {
    let form = file.read(FORM_ID, budget)?;
    let mut reader = Reader::new(String4(FORM_ID), &form);
    let content = Content::read(&mut reader)?;
    // Normals would be rebuilt behind the filter, before errors are added.
    if !content.fits(layout.pixel) || content.formats(layout.pixel).1.0 == TEXFOLD_NORMAL {
        return Err(reader.corrupt("content that cannot hold the channels"));
    }
    let halvings = reader.u8()?;
    let apart = halvings & APART_FLAG != 0;
    let margin = if halvings & MARGIN_FLAG != 0 { MARGIN } else { 0 };
    let shrink_log2 = u32::from((halvings & !APART_FLAG & !MARGIN_FLAG) >> HALVING_BITS);
    let reduce_log2 = u32::from(halvings & ((1 << HALVING_BITS) - 1));
    if !(1..=MAX_REDUCE_LOG2).contains(&reduce_log2) {
        return Err(reader.corrupt("halvings outside 1..=3"));
    }
    if margin > 0 && apart {
        return Err(reader.corrupt("a base beyond the borders where none can be"));
    }
    if shrink_log2 > MAX_SHRINK_LOG2 || apart && shrink_log2 > 0 {
        return Err(reader.corrupt("a largest level smaller than a quarter, or where none can be"));
    }
    let stored = stored_layout(&layout, shrink_log2);
    let model = read_model(&mut reader)?;
    let bases = read_bases(&stored, content, (reduce_log2, margin), file, budget)?;
    let details = read_details(&stored, public, file, budget)?;
    let mut parts = Parts {
        layout,
        shrink_log2,
        stored,
        reduce_log2,
        apart,
        margin,
        model,
        bases,
        details,
        maps: Vec::new(),
    };
    if let Some(maps) = read_maps(&parts, file, budget)? {
        parts.maps = maps;
    }
    ProgressiveTexture::new(parts, notes).ok_or(too_large())
}

/// As [`load_parts`], with the error map, where the form names one.
pub(crate) fn load_whole(
    layout: ImageLayout,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<ProgressiveTexture, LoadError> {
    let texture = load_parts(layout, (Notes::default(), None), file, budget)?;
    if texture.parts.maps.is_empty() && texture.parts.layers() > 1 {
        // What is missing is named by who looks for it.
        file.read(ERROR_ID, budget)?;
    }
    Ok(texture)
}

/// A map that fits no plane.
pub(crate) fn too_large() -> LoadError {
    LoadError::Corrupt { section: String4(ERROR_ID), offset: 0, what: "an error map larger than a plane" }
}

fn read_model(reader: &mut Reader<'_>) -> Result<Model, LoadError> {
    let class_bits = 16 * u32::from(reader.u8()?);
    if class_bits > MOST_CLASS_BITS {
        return Err(reader.corrupt("more than 32 bits for the first class"));
    }
    let mut model = Model { class_bits, ..Model::default() };
    for weight in &mut model.weights {
        *weight = reader.u16()?;
    }
    for class in 0..CLASSES {
        let rates = Rates::unpacked(reader.u32()?).ok_or(reader.corrupt("too many bits of a coefficient"))?;
        let bits = rates.bits();
        if bits != 0 && bits != class_bits * class as u32 {
            return Err(reader.corrupt("a class of another number of bits"));
        }
        model.classes[class] = rates;
    }
    reader.end()?;
    Ok(model)
}

fn read_bases(
    layout: &ImageLayout,
    content: Content,
    (reduce_log2, margin): (u32, u32),
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<Vec<Vec<ContentPlanes>>, LoadError> {
    let (formats, _) = content.formats(layout.pixel);
    let raw = file.read(BASE_ID, budget)?;
    budget.take(raw.len() as u64)?;
    let mut reader = Reader::new(String4(BASE_ID), &raw);
    let mut bases = Vec::new();
    for &size in &layout.surfaces {
        let mut levels = Vec::new();
        for level in 0..base_levels(size, reduce_log2, layout.levels) {
            let beyond = (2 * margin) << reduce_log2;
            let whole = SurfaceSize { width: size.width + beyond, height: size.height + beyond };
            let SurfaceSize { width, height } = whole.at_level(reduce_log2).at_level(level);
            let mut planes = Vec::new();
            for format in &formats {
                let length = usize::try_from(format.bytes(width, height)).unwrap_or(usize::MAX);
                planes.push(reader.bytes(length)?.to_vec());
            }
            // The texels are decoded once, when the texture is laid out.
            budget.take(u64::from(width) * u64::from(height) * size_of::<texfold_core::Texel>() as u64)?;
            let planes = ContentPlanes::from_planes(content, layout.pixel, (width, height), planes);
            levels.push(planes.ok_or(reader.corrupt("planes of another size"))?);
        }
        bases.push(levels);
    }
    reader.end()?;
    Ok(bases)
}

/// A codebook of the size that the map names.
fn read_codebook(
    (width, height): (u32, u32),
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<Codebook, LoadError> {
    let raw = file.read(CODEBOOK_ID, budget)?;
    let mut reader = Reader::new(String4(CODEBOOK_ID), &raw);
    let content = Content::read(&mut reader)?;
    read_planes(content, (width, height), &mut reader, budget)
}

/// A codebook of that size from the rest of a section.
fn read_planes(
    content: Content,
    (width, height): (u32, u32),
    reader: &mut Reader<'_>,
    budget: &mut Budget,
) -> Result<Codebook, LoadError> {
    if !content.fits(CODEBOOK_PIXEL) {
        return Err(reader.corrupt("content that cannot hold gray"));
    }
    if width > MAX_CODEBOOK_SIDE || height > MAX_CODEBOOK_SIDE {
        return Err(reader.corrupt("a codebook longer than 4096 texels"));
    }
    let texels = u64::from(width) * u64::from(height);
    budget.take(texels * (size_of::<texfold_core::Texel>() + 5) as u64)?;
    let mut planes = Vec::new();
    for format in content.formats(CODEBOOK_PIXEL).0 {
        let length = usize::try_from(format.bytes(width, height)).unwrap_or(usize::MAX);
        planes.push(reader.bytes(length)?.to_vec());
    }
    reader.end()?;
    let planes = ContentPlanes::from_planes(content, CODEBOOK_PIXEL, (width, height), planes);
    let book = planes.and_then(Codebook::from_planes);
    book.ok_or(reader.corrupt("a codebook that is not of whole cells"))
}

/// Codebooks and maps; `None` where the texture has none.
fn read_details(
    layout: &ImageLayout,
    public: Option<&Codebook>,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<Option<Details>, LoadError> {
    if !file.ids().any(|(id, _)| id == MAP_ID) {
        return Ok(None);
    }
    let raw = file.read(MAP_ID, budget)?;
    let mut reader = Reader::new(String4(MAP_ID), &raw);
    let mut sizes = [0; 4];
    for size in &mut sizes {
        *size = reader.u32()?;
        if *size > MAX_CODEBOOK_SIDE {
            return Err(reader.corrupt("a codebook longer than 4096 texels"));
        }
    }
    let checksum = reader.u64()?;
    let form = MapForm::unpacked(reader.u32()?).ok_or(reader.corrupt("an unknown layout of entries"))?;
    let gain_unit = reader.u16()?;
    let public = match (sizes[1], public) {
        (0, _) => None,
        (_, None) => return Err(reader.corrupt("a public codebook is needed; open the image by its bank")),
        (rows, Some(public)) => {
            let part = public.first_rows(rows).filter(|part| part.size().0 == sizes[0]);
            let part = part.filter(|part| part.checksum() == checksum);
            Some(Arc::new(
                part.ok_or(reader.corrupt("another public codebook than the image was made with"))?,
            ))
        }
    };
    let private = match sizes[3] {
        0 => None,
        height => Some(Arc::new(read_codebook((sizes[2], height), file, budget)?)),
    };
    let mut entries = Vec::new();
    for &size in &layout.surfaces {
        let count = form.blocks(size, layout.levels);
        let words = (count * u64::from(form.entry_bits())).div_ceil(32);
        budget.take(count.saturating_mul(size_of::<crate::Entry>() as u64 + 8))?;
        let bytes = reader.bytes(usize::try_from(4 * words).unwrap_or(usize::MAX))?;
        let words: Vec<u32> = bytes
            .chunks_exact(4)
            .map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
            .collect();
        let list = unpack_entries(&words, count as usize, form);
        if list.iter().any(|entry| entry.row >= sizes[1] + sizes[3]) {
            return Err(reader.corrupt("an entry behind the last row of the codebooks"));
        }
        entries.push(list);
    }
    reader.end()?;
    Ok(Some(Details { public, private, form, gain_unit, entries }))
}

/// The error maps of all images; `None` where the file has not brought them.
pub(crate) fn read_maps(
    parts: &Parts,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<Option<Vec<ErrorMap>>, LoadError> {
    let named = file.ids().any(|(id, _)| id == ERROR_ID);
    if parts.layers() == 1 || !named {
        let error =
            LoadError::Corrupt { section: String4(ERROR_ID), offset: 0, what: "missing, or one too many" };
        return if named != (parts.layers() == 2) { Err(error) } else { Ok(None) };
    }
    if !file.has(ERROR_ID) {
        return Ok(None);
    }
    let raw = file.read(ERROR_ID, budget)?;
    // Laid out, a block has 10 bits more than its own and a byte each of class and scale are kept.
    budget.take(4 * raw.len() as u64)?;
    let mut reader = Reader::new(String4(ERROR_ID), &raw);
    let mut maps = Vec::new();
    for size in &parts.stored.surfaces {
        maps.push(read_map(*size, parts, &mut reader)?);
    }
    reader.end()?;
    Ok(Some(maps))
}

fn read_map(size: SurfaceSize, parts: &Parts, reader: &mut Reader<'_>) -> Result<ErrorMap, LoadError> {
    let blocks: u64 = (0..parts.stored.levels)
        .map(|level| blocks_of(size.at_level(level)))
        .map(|(columns, rows)| u64::from(columns) * u64::from(rows))
        .sum();
    let blocks = usize::try_from(blocks).unwrap_or(usize::MAX);
    let classes = unpack(reader, blocks)?;
    let unknown = |class: &u8| *class > 0 && parts.model.classes[usize::from(*class)].bits() == 0;
    if classes.iter().any(unknown) {
        return Err(reader.corrupt("a block of a class that has no bits"));
    }
    let scales = unpack(reader, blocks)?;
    let halves: u64 =
        classes.iter().map(|&class| u64::from(class) * u64::from(parts.model.class_bits / 16)).sum();
    let length = usize::try_from(2 * halves).unwrap_or(usize::MAX);
    let bits =
        reader.bytes(length)?.chunks_exact(2).map(|half| u16::from_le_bytes([half[0], half[1]])).collect();
    Ok(ErrorMap { classes, scales, bits })
}

/// Writes a public codebook as a file of its own: content, width, height, planes.
pub(crate) fn store_public(book: &Codebook, out: &mut SectionWriter) {
    let (width, height) = book.size();
    let mut raw = vec![book.planes().content().number()];
    raw.extend([width, height].into_iter().flat_map(u32::to_le_bytes));
    raw.extend(book.planes().planes().iter().flat_map(|(_, bytes)| bytes));
    out.section(PUBLIC_PART, PUBLIC_ID, &raw);
}

/// Reads what [`store_public`] wrote.
pub(crate) fn load_public(file: &Sections<'_>, budget: &mut Budget) -> Result<Codebook, LoadError> {
    let raw = file.read(PUBLIC_ID, budget)?;
    let mut reader = Reader::new(String4(PUBLIC_ID), &raw);
    let content = Content::read(&mut reader)?;
    let size = (reader.u32()?, reader.u32()?);
    read_planes(content, size, &mut reader, budget)
}
