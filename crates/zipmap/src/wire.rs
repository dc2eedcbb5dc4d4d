//! Sections of a `zipmap` file: "ZMFM" (contents, depth, size and levels of patch images, and the patches' matrices),
//! "ZMRT" (planes of the root), "ZMPA" (planes of patch images).

use texfold_bc::{Content, ContentPlanes};
use texfold_core::container::{Reader, SectionWriter, Sections, read_layout};
use texfold_core::image::PixelInfo;
use texfold_core::sample::TEXFOLD_NORMAL;
use texfold_core::{Budget, LoadError, MAX_PLANE_SIDE, String4, SurfaceSize};

use crate::parts::{
    MAX_PATCH_LEVELS, MAX_PATCHES, PATCH_PART, Parts, PatchForm, ROOT_PART, patch_pixel, suits_patches,
};

const FORM_ID: [u8; 4] = *b"ZMFM";
const ROOT_ID: [u8; 4] = *b"ZMRT";
const PATCH_ID: [u8; 4] = *b"ZMPA";

/// Bytes of what is known of a patch image beside its planes: size and levels, a plane's place, and a
/// rectangle of the shared plane for each level while that is arranged.
const IMAGE_BYTES: u64 = 2048;

pub(crate) fn store(parts: &Parts, out: &mut SectionWriter) {
    let patch_content = parts.contents.first().map_or(Content::Raw, |levels| levels[0].content());
    let mut form = vec![parts.root[0].content().number(), patch_content.number(), parts.deep as u8];
    form.extend((parts.contents.len() as u16).to_le_bytes());
    form.extend((parts.patches.len() as u16).to_le_bytes());
    for levels in &parts.contents {
        let (width, height) = levels[0].size();
        form.extend((width as u16).to_le_bytes());
        form.extend((height as u16).to_le_bytes());
        form.push(levels.len() as u8);
    }
    for patch in &parts.patches {
        form.extend((patch.content as u16).to_le_bytes());
        form.extend(patch.matrix.iter().flat_map(|value| value.to_le_bytes()));
    }
    out.section("container", FORM_ID, &form);
    let planes = parts.root.iter().flat_map(ContentPlanes::planes);
    out.section(ROOT_PART, ROOT_ID, &planes.flat_map(|(_, bytes)| bytes).copied().collect::<Vec<u8>>());
    if !parts.contents.is_empty() {
        let planes = parts.contents.iter().flatten().flat_map(ContentPlanes::planes);
        out.section(PATCH_PART, PATCH_ID, &planes.flat_map(|(_, bytes)| bytes).copied().collect::<Vec<u8>>());
    }
}

/// What stands before the planes.
struct Header {
    /// Sizes and levels of patch images.
    contents: Vec<(SurfaceSize, u32)>,
    patches: Vec<PatchForm>,
}

pub(crate) fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<Parts, LoadError> {
    let layout = read_layout(file, budget)?;
    let form = file.read(FORM_ID, budget)?;
    let mut reader = Reader::new(String4(FORM_ID), &form);
    let (root_content, patch_content) = (Content::read(&mut reader)?, Content::read(&mut reader)?);
    let deep = u32::from(reader.u8()?);
    let [size] = layout.surfaces[..] else { return Err(reader.corrupt("more than one image")) };
    let exact = deep < 16 && [size.width, size.height].iter().all(|side| side % (1 << deep) == 0);
    if !exact || layout.levels <= deep {
        return Err(reader.corrupt("levels that do not lead to a root"));
    }
    let root_size = size.at_level(deep);
    let root_levels = layout.levels - deep;
    let normal = root_content.formats(layout.pixel).1.0 == TEXFOLD_NORMAL;
    let wide = root_size.width.max(root_size.height) > MAX_PLANE_SIDE;
    if !root_content.fits(layout.pixel) || normal || root_levels > root_size.full_levels() || wide {
        return Err(reader.corrupt("a root that cannot be stored so"));
    }
    let pixel = patch_pixel(layout.pixel);
    let Header { contents: sizes, patches } = read_patches(&mut reader, budget)?;
    if !sizes.is_empty() && !suits_patches(patch_content, pixel) {
        return Err(reader.corrupt("content without soft alpha for patches"));
    }
    let raw = file.read(ROOT_ID, budget)?;
    let mut planes = Reader::new(String4(ROOT_ID), &raw);
    let root = read_levels(&mut planes, budget, (root_content, layout.pixel), root_size, root_levels)?;
    planes.end()?;
    let mut contents = Vec::new();
    if !sizes.is_empty() {
        let raw = file.read(PATCH_ID, budget)?;
        let mut planes = Reader::new(String4(PATCH_ID), &raw);
        for (size, levels) in sizes {
            contents.push(read_levels(&mut planes, budget, (patch_content, pixel), size, levels)?);
        }
        planes.end()?;
    }
    Ok(Parts { layout, deep, root, contents, patches })
}

/// What is said of patches that no plane holds.
pub(crate) fn too_large() -> LoadError {
    let what = "patches that fill more than a plane";
    LoadError::Corrupt { section: String4(PATCH_ID), offset: 0, what }
}

fn read_patches(reader: &mut Reader<'_>, budget: &mut Budget) -> Result<Header, LoadError> {
    let [images, count] = [usize::from(reader.u16()?), usize::from(reader.u16()?)];
    if count > MAX_PATCHES {
        return Err(reader.corrupt("more than 2048 patches"));
    }
    if images > count {
        return Err(reader.corrupt("more contents than patches"));
    }
    budget.take(IMAGE_BYTES * images as u64 + size_of::<PatchForm>() as u64 * count as u64)?;
    let mut contents = Vec::new();
    for _ in 0..images {
        let size = SurfaceSize { width: u32::from(reader.u16()?), height: u32::from(reader.u16()?) };
        let levels = u32::from(reader.u8()?);
        let sides = 1..=MAX_PLANE_SIDE;
        if !sides.contains(&size.width) || !sides.contains(&size.height) {
            return Err(reader.corrupt("a patch of another size than 1 to 8192"));
        }
        if !(1..=MAX_PATCH_LEVELS.min(size.full_levels())).contains(&levels) {
            return Err(reader.corrupt("a patch with too many levels or none"));
        }
        contents.push((size, levels));
    }
    let mut patches = Vec::new();
    for _ in 0..count {
        let content = usize::from(reader.u16()?);
        if content >= images {
            return Err(reader.corrupt("a patch of a content that is not there"));
        }
        let mut matrix = [0.0; 9];
        for value in &mut matrix {
            *value = reader.f32()?;
        }
        patches.push(PatchForm { matrix, content });
    }
    reader.end()?;
    Ok(Header { contents, patches })
}

fn read_levels(
    reader: &mut Reader<'_>,
    budget: &mut Budget,
    (content, pixel): (Content, PixelInfo),
    size: SurfaceSize,
    levels: u32,
) -> Result<Vec<ContentPlanes>, LoadError> {
    let (formats, _) = content.formats(pixel);
    let mut found = Vec::new();
    for level in 0..levels {
        let SurfaceSize { width, height } = size.at_level(level);
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
