//! Sections of a `progressive` file: "PRFM" (form of base and error map), "PRBA" (planes of the bases), "PREM" (error maps: for
//! each image the classes of all blocks, their scales, then their bits). "PREM" is the second layer: a prefix of the file
//! without it is the enlarged base.

use texfold_bc::{Content, ContentPlanes};
use texfold_core::container::{Notes, Reader, SectionWriter, Sections, read_layout};
use texfold_core::sample::TEXFOLD_NORMAL;
use texfold_core::{Budget, ImageLayout, LoadError, String4, SurfaceSize};

use crate::ProgressiveTexture;
use crate::encoded::{BASE_PART, ErrorMap, MAP_PART, Parts, base_levels, blocks_of};
use crate::params::MAX_REDUCE_LOG2;
use crate::rates::{CLASSES, Model, Rates};

const FORM_ID: [u8; 4] = *b"PRFM";
const BASE_ID: [u8; 4] = *b"PRBA";
const MAP_ID: [u8; 4] = *b"PREM";

/// Flag of a base that is blended within blocks alone, beside its halvings.
const APART_FLAG: u8 = 16;
/// Most bits of a block of class 1: two 16-bit halves.
const MOST_CLASS_BITS: u32 = 32;
/// Largest number of 4 bits.
const MAX_NIBBLE: u8 = 15;

pub(crate) fn store(parts: &Parts, out: &mut SectionWriter) {
    let model = &parts.model;
    let content = parts.bases[0][0].content();
    let mut form = vec![
        content.number(),
        parts.reduce_log2 as u8 | if parts.apart { APART_FLAG } else { 0 },
        (model.class_bits / 16) as u8,
    ];
    form.extend(model.weights.iter().flat_map(|weight| weight.to_le_bytes()));
    form.extend(model.classes.iter().flat_map(|rates| rates.packed().to_le_bytes()));
    out.section("container", FORM_ID, &form);
    let planes = parts.bases.iter().flatten().flat_map(ContentPlanes::planes);
    let raw: Vec<u8> = planes.flat_map(|(_, bytes)| bytes).copied().collect();
    out.section(BASE_PART, BASE_ID, &raw);
    if !parts.maps.is_empty() {
        let raw: Vec<u8> = parts.maps.iter().flat_map(map_bytes).collect();
        out.section(MAP_PART, MAP_ID, &raw);
    }
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

pub(crate) fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<ProgressiveTexture, LoadError> {
    let notes = Notes::read(file, budget)?;
    let layout = read_layout(file, budget)?;
    load_parts(layout, notes, file, budget)
}

/// The texture of images of that layout, which the file says elsewhere.
pub(crate) fn load_parts(
    layout: ImageLayout,
    notes: Notes,
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
    let reduce_log2 = u32::from(halvings & !APART_FLAG);
    if !(1..=MAX_REDUCE_LOG2).contains(&reduce_log2) {
        return Err(reader.corrupt("halvings outside 1..=3"));
    }
    let model = read_model(&mut reader)?;
    let bases = read_bases(&layout, content, reduce_log2, file, budget)?;
    let mut parts = Parts { layout, reduce_log2, apart, model, bases, maps: Vec::new() };
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
    let texture = load_parts(layout, Notes::default(), file, budget)?;
    if texture.parts.maps.is_empty() && texture.parts.layers() > 1 {
        // What is missing is named by who looks for it.
        file.read(MAP_ID, budget)?;
    }
    Ok(texture)
}

/// A map that fits no plane.
pub(crate) fn too_large() -> LoadError {
    LoadError::Corrupt { section: String4(MAP_ID), offset: 0, what: "an error map larger than a plane" }
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
    reduce_log2: u32,
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
            let SurfaceSize { width, height } = size.at_level(reduce_log2).at_level(level);
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

/// The error maps of all images; `None` where the file has not brought them.
pub(crate) fn read_maps(
    parts: &Parts,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<Option<Vec<ErrorMap>>, LoadError> {
    let named = file.ids().any(|(id, _)| id == MAP_ID);
    if parts.layers() == 1 || !named {
        let error =
            LoadError::Corrupt { section: String4(MAP_ID), offset: 0, what: "missing, or one too many" };
        return if named != (parts.layers() == 2) { Err(error) } else { Ok(None) };
    }
    if !file.has(MAP_ID) {
        return Ok(None);
    }
    let raw = file.read(MAP_ID, budget)?;
    // Laid out, a block has 10 bits more than its own and a byte each of class and scale are kept.
    budget.take(4 * raw.len() as u64)?;
    let mut reader = Reader::new(String4(MAP_ID), &raw);
    let mut maps = Vec::new();
    for size in &parts.layout.surfaces {
        maps.push(read_map(*size, parts, &mut reader)?);
    }
    reader.end()?;
    Ok(Some(maps))
}

fn read_map(size: SurfaceSize, parts: &Parts, reader: &mut Reader<'_>) -> Result<ErrorMap, LoadError> {
    let blocks: u64 = (0..parts.layout.levels)
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
