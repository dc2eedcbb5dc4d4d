//! Planes of the epitomes and of the coarse mip levels ("EPMC").

use texfold_bc::{Content, ContentPlanes};
use texfold_core::container::{Reader, SectionWriter, Sections};
use texfold_core::{Budget, ImageLayout, LoadError, PlaneFormat, String4, Texel};

use super::form::{FORM_ID, Form};
use crate::parts::{Parts, coarse_content, coarse_levels};

const COARSE_ID: [u8; 4] = *b"EPMC";

pub(super) fn plane_bytes<'a>(levels: impl Iterator<Item = &'a ContentPlanes>) -> Vec<u8> {
    levels.flat_map(|level| level.planes()).flat_map(|(_, bytes)| bytes).copied().collect()
}

pub(super) fn store_coarse(parts: &Parts, out: &mut SectionWriter) {
    if parts.coarse.iter().any(|levels| !levels.is_empty()) {
        out.section("mips", COARSE_ID, &plane_bytes(parts.coarse.iter().flatten()));
    }
}

/// Books what a level takes: its planes, once more where a GPU is lent all levels in one piece, its texels as they
/// are decoded, and the lists that hold them.
fn book(formats: &[PlaneFormat], (width, height): (u32, u32), budget: &mut Budget) -> Result<(), LoadError> {
    let bytes: u64 = formats.iter().map(|format| format.bytes(width, height)).sum();
    budget.take(2 * bytes + LIST_BYTES * (1 + formats.len() as u64))?;
    Ok(budget.take(DECODED_BYTES * u64::from(width) * u64::from(height))?)
}

/// Bytes of a decoded texel, and of what decoding it takes meanwhile.
const DECODED_BYTES: u64 = 2 * size_of::<Texel>() as u64;
/// Bytes of a level's or a plane's place in the lists.
const LIST_BYTES: u64 = 96;

/// Planes of that content and those sizes.
pub(super) fn read_planes(
    reader: &mut Reader<'_>,
    content: Content,
    layout: &ImageLayout,
    sizes: impl Iterator<Item = (u32, u32)>,
    budget: &mut Budget,
) -> Result<Vec<ContentPlanes>, LoadError> {
    let formats = content.formats(layout.pixel).0;
    let mut levels = Vec::new();
    for size in sizes {
        book(&formats, size, budget)?;
        let mut planes = Vec::new();
        for format in &formats {
            planes.push(reader.bytes(format.bytes(size.0, size.1) as usize)?.to_vec());
        }
        let planes = ContentPlanes::from_planes(content, layout.pixel, size, planes);
        levels.push(planes.ok_or(reader.corrupt("planes of another size"))?);
    }
    Ok(levels)
}

/// Planes of that content and those sizes with nothing in them.
pub(super) fn blank_planes(
    content: Content,
    layout: &ImageLayout,
    sizes: impl Iterator<Item = (u32, u32)>,
    budget: &mut Budget,
) -> Result<Vec<ContentPlanes>, LoadError> {
    let corrupt = LoadError::Corrupt { section: String4(FORM_ID), offset: 0, what: "planes of another size" };
    let formats = content.formats(layout.pixel).0;
    let mut levels = Vec::new();
    for size in sizes {
        book(&formats, size, budget)?;
        let mut planes = Vec::new();
        for format in &formats {
            planes.push(budget.zeroed(format.bytes(size.0, size.1))?);
        }
        let planes = ContentPlanes::from_planes(content, layout.pixel, size, planes);
        levels.push(planes.ok_or(corrupt.clone())?);
    }
    Ok(levels)
}

pub(super) fn read_coarse(
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
    let content = form.epitomes.first().map_or(Content::Raw, |epitome| epitome.content);
    let content = coarse_content(content, layout.pixel, form.finer);
    let mut coarse = Vec::new();
    for size in &layout.images {
        let sizes = levels.clone().map(|level| size.at_level(level)).map(|size| (size.width, size.height));
        coarse.push(read_planes(&mut reader, content, layout, sizes, budget)?);
    }
    reader.end()?;
    Ok(coarse)
}
