//! Sections of a `progressive` file: those of its residual content, whose base is the first layer and whose residual
//! planes are the second; between them "PRCB" (planes of the texture's own codebook) and "PRMP" (form and entries of the
//! map), where blocks use codebooks. A public codebook is a file of its own with "PRPB" (size and planes).

use std::sync::Arc;

use texfold_bc::{Content, ContentPlanes};
use texfold_core::container::ContentId;
use texfold_core::container::{Reader, SectionWriter, Sections};
use texfold_core::{Budget, ImageBinding, ImageLayout, LoadError, Plane, String4, Texel, WordRows};
use texfold_residual::ResidualContent;

use crate::codebook::{
    CODEBOOK_PIXEL, Codebook, Details, EntryMap, MAP_PART, MAX_CODEBOOK_SIDE, MapForm, PRIVATE_PART,
    PUBLIC_PART,
};
use crate::decode::TexfoldProgressiveParams;

/// The residual content of a file.
pub(crate) const CONTENT: ContentId = ContentId::ONLY;
const CODEBOOK_ID: [u8; 4] = *b"PRCB";
const PUBLIC_ID: [u8; 4] = *b"PRPB";
const MAP_ID: [u8; 4] = *b"PRMP";

/// Bytes of memory that every image costs beside its residual content and its entries, loaded and as a GPU form.
const IMAGE_BYTES: u64 = (2 * size_of::<TexfoldProgressiveParams>()
    + size_of::<EntryMap>()
    + size_of::<Plane<'_>>()
    + size_of::<ImageBinding>()
    // Heap blocks of at least 64 bytes: words, indices of bound planes.
    + 2 * 64) as u64;

pub(crate) fn store(content: &ResidualContent, details: Option<&Details>, out: &mut SectionWriter) {
    content.store_base(CONTENT, out);
    if let Some(details) = details {
        store_details(details, out);
    }
    content.store_planes(CONTENT, out);
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
    for map in &details.maps {
        let words = (map.blocks * details.form.entry_bits() as usize).div_ceil(32);
        raw.extend(map.words[..words].iter().flat_map(|word| word.to_le_bytes()));
    }
    out.section(MAP_PART, MAP_ID, &raw);
}

/// Loads what a texture of images of that layout is made of; `public` is the codebook that it shares with others, or one that
/// grew from it.
pub(crate) fn load(
    layout: &ImageLayout,
    file: &Sections<'_>,
    public: Option<&Codebook>,
    budget: &mut Budget,
) -> Result<(ResidualContent, Option<Details>), LoadError> {
    budget.take(layout.images.len() as u64 * IMAGE_BYTES)?;
    let content = ResidualContent::load(layout, CONTENT, file, budget)?;
    let details = read_details(content.layout(), public, file, budget)?;
    Ok((content, details))
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
    // The planes; the values of the CPU decoder, which are made when they are first asked for; and the texels they are
    // made from.
    let texels = u64::from(width) * u64::from(height);
    budget.take(texels * (size_of::<Texel>() + size_of::<f32>() + 1) as u64)?;
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
            if rows != public.size().1 {
                budget.take(public.bits_memory() / 8)?;
            }
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
    let mut maps = Vec::new();
    for &size in &layout.images {
        let blocks = form.blocks(size, layout.levels);
        let map = read_map(blocks, form, &mut reader, budget)?;
        if map.entries(form).any(|entry| entry.row >= sizes[1] + sizes[3]) {
            return Err(reader.corrupt("an entry behind the last row of the codebooks"));
        }
        maps.push(map);
    }
    reader.end()?;
    budget.release(raw.len() as u64);
    Ok(Some(Details { public, private, form, gain_unit, maps }))
}

/// The entries of an image of so many blocks.
fn read_map(
    blocks: u64,
    form: MapForm,
    reader: &mut Reader<'_>,
    budget: &mut Budget,
) -> Result<EntryMap, LoadError> {
    let words = usize::try_from((blocks * u64::from(form.entry_bits())).div_ceil(32)).unwrap_or(usize::MAX);
    let bytes = reader.bytes(words.saturating_mul(4))?;
    budget.take(4 * WordRows::of(words + 1).words as u64)?;
    let word = |bytes: &[u8]| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let mut map = Vec::new();
    map.reserve_exact(WordRows::of(words + 1).words);
    map.extend(bytes.chunks_exact(4).map(word));
    map.push(0);
    Ok(EntryMap::of_words(map, blocks as usize))
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
