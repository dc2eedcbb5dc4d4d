//! Sections of a `bc` file: "BCFM" (content, reduction) and "BLKS" (all planes of all levels of all images).

use texfold_core::container::{Reader, SectionWriter, Sections, read_layout};
use texfold_core::{Budget, ImageBinding, LoadError, Plane, PlaneFormat, String4};

use crate::decode::TexfoldBcParams;
use crate::parts::Parts;
use crate::{Content, ContentPlanes};

const FORM_ID: [u8; 4] = *b"BCFM";
const BLOCKS_ID: [u8; 4] = *b"BLKS";

/// Largest log2 downscale of width and height.
pub(crate) const MAX_REDUCE_LOG2: u32 = 3;

pub(crate) fn store(parts: &Parts, out: &mut SectionWriter) {
    out.section("container", FORM_ID, &[parts.content.number(), parts.reduce_log2 as u8]);
    let planes = parts.images.iter().flatten().flat_map(ContentPlanes::planes);
    let raw: Vec<u8> = planes.flat_map(|(_, bytes)| bytes).copied().collect();
    out.section("blocks", BLOCKS_ID, &raw);
}

pub(crate) fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<Parts, LoadError> {
    let layout = read_layout(file, budget)?;
    let form = file.read(FORM_ID, budget)?;
    let mut reader = Reader::new(String4(FORM_ID), &form);
    let content = Content::read(&mut reader)?;
    let reduce_log2 = u32::from(reader.u8()?);
    if reduce_log2 > MAX_REDUCE_LOG2 {
        return Err(reader.corrupt("a log2 downscale above 3"));
    }
    reader.end()?;
    let (formats, _) = content.formats(layout.pixel);
    let raw = file.read(BLOCKS_ID, budget)?;
    // The planes, and a copy of those with several levels in the form for GPUs.
    budget.take((raw.len() as u64).saturating_mul(if layout.levels > 1 { 2 } else { 1 }))?;
    let images = layout.images.len() as u64;
    let described = 4 * formats.len() * size_of::<(PlaneFormat, Vec<u8>)>();
    budget.take(images.saturating_mul(u64::from(layout.levels)).saturating_mul(described as u64))?;
    budget.take(images.saturating_mul(gpu_bytes(formats.len())))?;
    let mut blocks = Reader::new(String4(BLOCKS_ID), &raw);
    let mut images = budget.reserved(images)?;
    for size in &layout.images {
        let mut levels = budget.reserved(layout.levels.into())?;
        for level in 0..layout.levels {
            let size = size.at_level(reduce_log2 + level);
            let plane = |format: &PlaneFormat| {
                let length = usize::try_from(format.bytes(size.width, size.height));
                blocks.bytes(length.unwrap_or(usize::MAX)).map(<[u8]>::to_vec)
            };
            let planes = formats.iter().map(plane).collect::<Result<Vec<_>, _>>()?;
            let planes = ContentPlanes::from_planes(content, layout.pixel, (size.width, size.height), planes);
            levels.push(planes.ok_or(blocks.corrupt("planes of another size"))?);
        }
        images.push(levels);
    }
    blocks.end()?;
    Ok(Parts { layout, content, reduce_log2, images })
}

/// Bytes that [`texfold_core::Encoded::gpu`] takes for each image of `planes` planes, beside the texels: descriptions of planes and of what to
/// bind, and parameters. Vectors that grow hold up to three times their values for a moment.
fn gpu_bytes(planes: usize) -> u64 {
    let bound = size_of::<ImageBinding>() + 2 * planes.max(2) * size_of::<usize>();
    3 * (2 * planes * size_of::<Plane<'_>>() + bound + size_of::<TexfoldBcParams>()) as u64
}
