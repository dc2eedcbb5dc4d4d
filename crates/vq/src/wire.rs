//! Sections of a `vq` file: "VQFM" (codebook size, content, samples), "CODE" (codebook planes), "INDX" (all index maps,
//! image by image: columns first, then rows, each as the difference to the block before, which compresses better).

use texfold_bc::{Content, ContentPlanes};
use texfold_core::container::{Reader, SectionWriter, Sections, read_layout};
use texfold_core::{Budget, ImageLayout, LoadError, MAX_PLANE_SIDE, String4, Texel};

use crate::classes::{Groups, Place, SizeClass, blocks_of, rows_of};
use crate::grid::{CodebookPart, Grid, MAX_CODEBOOK_SIDE, MAX_SAMPLES};
use crate::parts::Parts;

const FORM_ID: [u8; 4] = *b"VQFM";
const CODE_ID: [u8; 4] = *b"CODE";
const INDEX_ID: [u8; 4] = *b"INDX";

/// Bytes that an image takes beside its index: its place, its part of the table of sizes while that is made, and what
/// [`texfold_core::GpuForm`] binds for it.
const IMAGE_BYTES: u64 = 256;
/// Bytes that a size takes beside its index plane: its class, parameters, plane and binding.
const CLASS_BYTES: u64 = 1024;

pub(crate) fn store(parts: &Parts, out: &mut SectionWriter) {
    let (width, height) = parts.codebook.size();
    let number = parts.codebook.content().number();
    let mut form = vec![number];
    form.extend([width, height, parts.free_cells, parts.samples.len() as u32].map(u32::to_le_bytes).concat());
    form.extend(parts.join_rms.to_le_bytes());
    for part in &parts.samples {
        let fields = [part.x, part.y, part.side, part.image, part.source_x, part.source_y];
        form.extend(fields.map(u32::to_le_bytes).concat());
    }
    out.section("container", FORM_ID, &form);
    let planes: Vec<u8> = parts.codebook.planes().iter().flat_map(|(_, bytes)| bytes).copied().collect();
    out.section("codebook", CODE_ID, &planes);
    let mut index = Vec::new();
    for place in &parts.places {
        let class = &parts.classes[place.class];
        for axis in 0..2 {
            let mut before = 0u8;
            index.extend((0..class.blocks()).map(|block| {
                let value = class.index[class.position(place.number, block)][axis];
                let difference = value.wrapping_sub(before);
                before = value;
                difference
            }));
        }
    }
    out.section("index", INDEX_ID, &index);
}

pub(crate) fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<Parts, LoadError> {
    let layout = read_layout(file, budget)?;
    let form = file.read(FORM_ID, budget)?;
    let form = read_form(&mut Reader::new(String4(FORM_ID), &form), &layout, budget)?;
    let raw = file.read(CODE_ID, budget)?;
    // The planes are copies of the section.
    budget.take(raw.len() as u64)?;
    let mut code = Reader::new(String4(CODE_ID), &raw);
    let (formats, _) = form.content.formats(layout.pixel);
    let mut planes = Vec::new();
    for format in formats {
        planes.push(code.bytes(format.bytes(form.width, form.height) as usize)?.to_vec());
    }
    code.end()?;
    let codebook = ContentPlanes::from_planes(form.content, layout.pixel, (form.width, form.height), planes);
    let codebook = codebook.ok_or(code.corrupt("planes of another size"))?;
    // The CPU's table of texels, when it is made: up to two planes are expanded, and put together.
    budget.take(u64::from(form.width) * u64::from(form.height) * 3 * size_of::<Texel>() as u64)?;
    let index = file.read(INDEX_ID, budget)?;
    let (classes, places) = read_index(&index, &layout, &codebook, budget)?;
    Ok(Parts {
        layout,
        codebook,
        classes,
        places,
        samples: form.samples,
        free_cells: form.free_cells,
        join_rms: form.join_rms,
    })
}

struct Form {
    content: Content,
    width: u32,
    height: u32,
    free_cells: u32,
    join_rms: f32,
    samples: Vec<CodebookPart>,
}

fn read_form(reader: &mut Reader<'_>, layout: &ImageLayout, budget: &mut Budget) -> Result<Form, LoadError> {
    let content = Content::read(reader)?;
    if !content.fits(layout.pixel) {
        return Err(reader.corrupt("content that cannot hold the channels"));
    }
    let (width, height, free_cells) = (reader.u32()?, reader.u32()?, reader.u32()?);
    let fits = |side: u32| side.is_multiple_of(4) && (4..=MAX_CODEBOOK_SIDE).contains(&side);
    if !fits(width) || !fits(height) {
        return Err(reader.corrupt("a codebook side that is no multiple of 4 in 4..=256"));
    }
    let count = reader.u32()?;
    if count > MAX_SAMPLES {
        return Err(reader.corrupt("more than 64 samples"));
    }
    budget.take(u64::from(count) * size_of::<CodebookPart>() as u64)?;
    let join_rms = reader.f32()?;
    let mut samples = Vec::new();
    for _ in 0..count {
        let [x, y, side] = [reader.u32()?, reader.u32()?, reader.u32()?];
        let [image, source_x, source_y] = [reader.u32()?, reader.u32()?, reader.u32()?];
        let inside = |at: u32, end: u32| u64::from(at) + u64::from(side) <= u64::from(end);
        if side < 4 || !inside(x, width) || !inside(y, height) {
            return Err(reader.corrupt("a sample outside the codebook or smaller than a block"));
        }
        samples.push(CodebookPart { x, y, side, image, source_x, source_y });
    }
    reader.end()?;
    let cells = Grid::of_texels((width, height)).free_cells(&samples).len();
    if free_cells as usize > cells {
        return Err(reader.corrupt("more free cells than cells"));
    }
    Ok(Form { content, width, height, free_cells, join_rms, samples })
}

/// The index planes, and the place of each image in them.
fn read_index(
    raw: &[u8],
    layout: &ImageLayout,
    codebook: &ContentPlanes,
    budget: &mut Budget,
) -> Result<(Vec<SizeClass>, Vec<Place>), LoadError> {
    let reader = Reader::new(String4(INDEX_ID), raw);
    let blocks: u64 = layout.images.iter().map(|&size| u64::from(blocks_of(size, layout.levels))).sum();
    if raw.len() as u64 != 2 * blocks {
        return Err(reader.corrupt("another number of blocks than the layout has"));
    }
    if layout.images.iter().any(|&size| rows_of(size, layout.levels) > MAX_PLANE_SIDE) {
        return Err(reader.corrupt("an image whose index fills more than 8192 rows"));
    }
    budget.take(IMAGE_BYTES * layout.images.len() as u64)?;
    let groups = Groups::of(layout);
    for plane in groups.planes() {
        budget.take(CLASS_BYTES + plane.bytes())?;
    }
    let mut classes = groups.classes(codebook.swizzle().0);
    let (width, height) = codebook.size();
    let limits = [width - 4, height - 4];
    let mut values = raw.iter();
    for place in &groups.places {
        let class = &mut classes[place.class];
        for (axis, &limit) in limits.iter().enumerate() {
            let mut value = 0u8;
            for block in 0..class.blocks() {
                value = value.wrapping_add(values.next().copied().unwrap_or(0));
                if u32::from(value) > limit {
                    return Err(reader.corrupt("an index outside the codebook"));
                }
                let position = class.position(place.number, block);
                class.index[position][axis] = value;
            }
        }
    }
    Ok((classes, groups.places))
}
