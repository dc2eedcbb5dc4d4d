//! Sections of a `zipmap` file: "ZMFM" (contents, depth, size and levels of patch images, and the patches' matrices),
//! "ZMRT" (planes of the root), "ZMPA" (planes of patch images). In blocks, instead of the last two: sections of block content 0, the root,
//! and where there are patch images, of block content 1, the image of all of their levels.

use texfold_bc::{Content, ContentPlanes};
use texfold_core::container::ContentId;
use texfold_core::container::{Reader, SectionWriter, Sections, read_layout};
use texfold_core::image::PixelInfo;
use texfold_core::sample::TEXFOLD_NORMAL;
use texfold_core::{Budget, ImageLayout, ImageSize, LoadError, MAX_PLANE_SIDE, String4};
use texfold_dct::DctContent;

use crate::atlas::pack;
use crate::parts::{
    BLOCK_SIDE, ImageForm, MAX_PATCH_LEVELS, MAX_PATCHES, PATCH_PART, Parts, PatchForm, Payload, ROOT_PART,
    atlas_layout, atlas_mips, patch_pixel, root_layout, suits_patches,
};

const FORM_ID: [u8; 4] = *b"ZMFM";
const ROOT_ID: [u8; 4] = *b"ZMRT";
const PATCH_ID: [u8; 4] = *b"ZMPA";
const ROOT_BLOCKS: ContentId = ContentId::ONLY;
const PATCH_BLOCKS: ContentId = ContentId::SECOND;

/// Bytes of what is known of a patch image beside its planes: size and levels, a plane's place, and a
/// rectangle of the shared plane for each level while that is arranged.
const IMAGE_BYTES: u64 = 2048;

/// Stands for a content where texels are in blocks of variable length, and each level of patch images is stored.
const IN_BLOCKS: u8 = u8::MAX;
/// The same where two of three levels of patch images are means of the one before them.
const WITH_MEANS: u8 = IN_BLOCKS - 1;

pub(crate) fn store(parts: &Parts, out: &mut SectionWriter) {
    let numbers = match &parts.payload {
        Payload::Planes { root, images } => {
            let images = images.first().map_or(Content::Raw, |levels| levels[0].content());
            [root[0].content().number(), images.number()]
        }
        Payload::Blocks { .. } => [if parts.mips() > 1 { WITH_MEANS } else { IN_BLOCKS }; 2],
    };
    let mut form = vec![numbers[0], numbers[1], parts.deep as u8];
    form.extend((parts.images.len() as u16).to_le_bytes());
    form.extend((parts.patches.len() as u16).to_le_bytes());
    for ImageForm { size, levels } in &parts.images {
        form.extend((size.width as u16).to_le_bytes());
        form.extend((size.height as u16).to_le_bytes());
        form.push(*levels as u8);
    }
    for patch in &parts.patches {
        form.extend((patch.content as u16).to_le_bytes());
        form.extend(patch.matrix.iter().flat_map(|value| value.to_le_bytes()));
    }
    out.section("container", FORM_ID, &form);
    match &parts.payload {
        Payload::Planes { root, images } => {
            store_planes(ROOT_PART, ROOT_ID, root.iter(), out);
            if !images.is_empty() {
                store_planes(PATCH_PART, PATCH_ID, images.iter().flatten(), out);
            }
        }
        Payload::Blocks { root, atlas } => {
            root.store_as(ROOT_PART, ROOT_BLOCKS, out);
            if let Some(atlas) = atlas {
                atlas.store_as(PATCH_PART, PATCH_BLOCKS, out);
            }
        }
    }
}

fn store_planes<'a>(
    part: &'static str,
    id: [u8; 4],
    levels: impl Iterator<Item = &'a ContentPlanes>,
    out: &mut SectionWriter,
) {
    let planes = levels.flat_map(ContentPlanes::planes);
    out.section(part, id, &planes.flat_map(|(_, bytes)| bytes).copied().collect::<Vec<u8>>());
}

/// How root and patch images are stored.
enum Form {
    Planes([Content; 2]),
    Blocks { has_means: bool },
}

/// What stands before the texels.
struct Header {
    form: Form,
    layout: ImageLayout,
    deep: u32,
    images: Vec<ImageForm>,
    patches: Vec<PatchForm>,
}

pub(crate) fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<Parts, LoadError> {
    let header = read_header(file, budget)?;
    let payload = match header.form {
        Form::Planes(contents) => load_planes(&header, contents, file, budget)?,
        Form::Blocks { has_means } => load_blocks(&header, has_means, file, budget)?,
    };
    let Header { layout, deep, images, patches, .. } = header;
    Ok(Parts { layout, deep, payload, images, patches })
}

fn read_header(file: &Sections<'_>, budget: &mut Budget) -> Result<Header, LoadError> {
    let layout = read_layout(file, budget)?;
    let bytes = file.read(FORM_ID, budget)?;
    let mut reader = Reader::new(String4(FORM_ID), &bytes);
    let form = read_form(&bytes, &mut reader)?;
    let deep = u32::from(reader.u8()?);
    let [size] = layout.images[..] else { return Err(reader.corrupt("more than one image")) };
    let exact = deep < 16 && [size.width, size.height].iter().all(|side| side % (1 << deep) == 0);
    if !exact || layout.levels <= deep {
        return Err(reader.corrupt("levels that do not lead to a root"));
    }
    let root_size = size.at_level(deep);
    let wide = root_size.width.max(root_size.height) > MAX_PLANE_SIDE;
    if layout.levels - deep > root_size.full_levels() || wide {
        return Err(reader.corrupt("a root that cannot be stored so"));
    }
    let (images, patches) = read_patches(&mut reader, budget)?;
    if let Form::Planes([root, of_images]) = form {
        let normal = root.formats(layout.pixel).1.0 == TEXFOLD_NORMAL;
        if !root.fits(layout.pixel) || normal {
            return Err(reader.corrupt("a root that cannot be stored so"));
        }
        if !images.is_empty() && !suits_patches(of_images, patch_pixel(layout.pixel)) {
            return Err(reader.corrupt("content without soft alpha for patches"));
        }
    }
    Ok(Header { form, layout, deep, images, patches })
}

fn read_form(bytes: &[u8], reader: &mut Reader<'_>) -> Result<Form, LoadError> {
    for (number, has_means) in [(IN_BLOCKS, false), (WITH_MEANS, true)] {
        if bytes.starts_with(&[number; 2]) {
            reader.bytes(2)?;
            return Ok(Form::Blocks { has_means });
        }
    }
    Ok(Form::Planes([Content::read(reader)?, Content::read(reader)?]))
}

fn load_planes(
    header: &Header,
    [content, of_images]: [Content; 2],
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<Payload, LoadError> {
    let Header { layout, deep, .. } = header;
    let raw = file.read(ROOT_ID, budget)?;
    let mut planes = Reader::new(String4(ROOT_ID), &raw);
    let root = ImageForm { size: layout.images[0].at_level(*deep), levels: layout.levels - deep };
    let root = read_levels(&mut planes, budget, (content, layout.pixel), root)?;
    planes.end()?;
    let mut images = Vec::new();
    if !header.images.is_empty() {
        let raw = file.read(PATCH_ID, budget)?;
        let mut planes = Reader::new(String4(PATCH_ID), &raw);
        for &image in &header.images {
            images.push(read_levels(&mut planes, budget, (of_images, patch_pixel(layout.pixel)), image)?);
        }
        planes.end()?;
    }
    Ok(Payload::Planes { root, images })
}

fn load_blocks(
    header: &Header,
    has_means: bool,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<Payload, LoadError> {
    let Header { layout, deep, images, .. } = header;
    let size = layout.images[0].at_level(*deep);
    let root =
        load_content(&root_layout(size, layout.levels - deep, layout.pixel), ROOT_BLOCKS, file, budget)?;
    let mut atlas = None;
    if !images.is_empty() {
        let mips = if has_means { atlas_mips(images) } else { 1 };
        let (_, size) = pack(images, BLOCK_SIDE, mips).ok_or(too_large())?;
        let layout = atlas_layout(size, mips, layout.pixel);
        atlas = Some(load_content(&layout, PATCH_BLOCKS, file, budget)?);
        // The levels of patch images, which the CPU cuts from it.
        budget.take(4 * layout.texels())?;
    }
    Ok(Payload::Blocks { root, atlas: atlas.map(Box::new) })
}

/// Content of an image; all of it, as a zoom stack has no layers.
fn load_content(
    layout: &ImageLayout,
    id: ContentId,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<DctContent, LoadError> {
    let content = DctContent::load_whole(layout, id, file, budget)?;
    // The texels that the CPU reads, when they are made.
    budget.take(4 * layout.texels())?;
    Ok(content)
}

/// What is said of patches that no plane holds.
pub(crate) fn too_large() -> LoadError {
    let what = "patches that fill more than a plane";
    LoadError::Corrupt { section: String4(FORM_ID), offset: 0, what }
}

/// Sizes and levels of patch images, and the patches.
fn read_patches(
    reader: &mut Reader<'_>,
    budget: &mut Budget,
) -> Result<(Vec<ImageForm>, Vec<PatchForm>), LoadError> {
    let [image_count, count] = [usize::from(reader.u16()?), usize::from(reader.u16()?)];
    if count > MAX_PATCHES {
        return Err(reader.corrupt("more than 2048 patches"));
    }
    if image_count > count {
        return Err(reader.corrupt("more contents than patches"));
    }
    budget.take(IMAGE_BYTES * image_count as u64 + size_of::<PatchForm>() as u64 * count as u64)?;
    let mut images = Vec::new();
    for _ in 0..image_count {
        let size = ImageSize { width: u32::from(reader.u16()?), height: u32::from(reader.u16()?) };
        let levels = u32::from(reader.u8()?);
        let sides = 1..=MAX_PLANE_SIDE;
        if !sides.contains(&size.width) || !sides.contains(&size.height) {
            return Err(reader.corrupt("a patch of another size than 1 to 8192"));
        }
        if !(1..=MAX_PATCH_LEVELS.min(size.full_levels())).contains(&levels) {
            return Err(reader.corrupt("a patch with too many levels or none"));
        }
        images.push(ImageForm { size, levels });
    }
    let mut patches = Vec::new();
    for _ in 0..count {
        let content = usize::from(reader.u16()?);
        if content >= image_count {
            return Err(reader.corrupt("a patch of a content that is not there"));
        }
        let mut matrix = [0.0; 9];
        for value in &mut matrix {
            *value = reader.f32()?;
        }
        patches.push(PatchForm { matrix, content });
    }
    reader.end()?;
    Ok((images, patches))
}

fn read_levels(
    reader: &mut Reader<'_>,
    budget: &mut Budget,
    (content, pixel): (Content, PixelInfo),
    ImageForm { size, levels }: ImageForm,
) -> Result<Vec<ContentPlanes>, LoadError> {
    let (formats, _) = content.formats(pixel);
    let mut found = Vec::new();
    for level in 0..levels {
        let ImageSize { width, height } = size.at_level(level);
        let mut planes = Vec::new();
        for format in &formats {
            let length = format.bytes(width, height);
            budget.take(length)?;
            planes.push(reader.bytes(usize::try_from(length).unwrap_or(usize::MAX))?.to_vec());
        }
        // The texels that the CPU reads, when they are made.
        budget.take(4 * u64::from(width) * u64::from(height))?;
        let planes = ContentPlanes::from_planes(content, pixel, (width, height), planes);
        found.push(planes.ok_or(reader.corrupt("planes of another size"))?);
    }
    Ok(found)
}
