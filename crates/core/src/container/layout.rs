//! The section that every codec of flat images shares: sizes, levels and meaning of the channels.

use super::{Reader, SectionWriter, Sections};
use crate::id::String4;
use crate::image::{Alpha, ColorSpace, Depth, MapInfo, MapKind, PixelInfo};
use crate::{Budget, ImageLayout, ImageSize, LoadError, MAX_IMAGE_SIDE};

/// Id of the layout section.
pub const LAYOUT_ID: [u8; 4] = *b"LAYO";

/// Id of the section on the maps of a material.
pub const MAPS_ID: [u8; 4] = *b"MAPS";

/// Writes the layout. Equal sizes are stored once with a count. Maps are written where there are any.
pub fn write_layout(layout: &ImageLayout, out: &mut SectionWriter) {
    let mut raw = pixel_bytes(layout.pixel);
    raw.extend(layout.levels.to_le_bytes());
    let runs: Vec<&[ImageSize]> = layout.images.chunk_by(|a, b| a == b).collect();
    raw.extend((runs.len() as u32).to_le_bytes());
    for run in runs {
        raw.extend((run.len() as u32).to_le_bytes());
        raw.extend(run[0].width.to_le_bytes());
        raw.extend(run[0].height.to_le_bytes());
    }
    out.section("container", LAYOUT_ID, &raw);
    if layout.maps.is_empty() {
        return;
    }
    let mut raw = Vec::new();
    for map in &layout.maps {
        let kind = MapKind::ALL.iter().position(|&kind| kind == map.kind).unwrap_or(MapKind::ALL.len() - 1);
        raw.push(kind as u8);
        raw.extend(pixel_bytes(map.pixel));
        raw.push(map.name.len() as u8);
        raw.extend(map.name.as_bytes());
    }
    out.section("container", MAPS_ID, &raw);
}

fn pixel_bytes(pixel: PixelInfo) -> Vec<u8> {
    let color = match pixel.color {
        ColorSpace::Srgb => 0u8,
        ColorSpace::Linear => 1,
        ColorSpace::Normal => 2,
    };
    let (alpha, threshold) = match pixel.alpha {
        Alpha::Opaque => (0u8, 0.0f32),
        Alpha::Straight => (1, 0.0),
        Alpha::Cutout(threshold) => (2, threshold),
        Alpha::Band => (3, 0.0),
    };
    let depth = if pixel.depth == Depth::Sixteen { 16u8 } else { 8 };
    let mut raw = vec![pixel.channels, depth, color, alpha];
    raw.extend(threshold.to_le_bytes());
    raw
}

/// Reads and checks the layout, and checks its texels against the budget.
///
/// # Errors
/// [`LoadError`] where the section is missing or damaged or the images are too large.
pub fn read_layout(file: &Sections<'_>, budget: &mut Budget) -> Result<ImageLayout, LoadError> {
    let raw = file.read(LAYOUT_ID, budget)?;
    let mut reader = Reader::new(String4(LAYOUT_ID), &raw);
    let pixel = read_pixel(&mut reader)?;
    let levels = reader.u32()?;
    if !(1..=16).contains(&levels) {
        return Err(reader.corrupt("levels outside 1..=16"));
    }
    let runs = reader.u32()?;
    let total = check_runs(reader.clone(), runs, budget)?;
    let mut images = budget.reserved(total)?;
    for _ in 0..runs {
        let (count, width, height) = (reader.u32()?, reader.u32()?, reader.u32()?);
        images.extend(std::iter::repeat_n(ImageSize { width, height }, count as usize));
    }
    reader.end()?;
    Ok(ImageLayout::new(images, levels, pixel))
}

/// Reads the maps that the images of a layout are, of a material; none where they are of one kind.
///
/// # Errors
/// [`LoadError`] where the section is damaged or names other maps than there are images.
pub fn read_maps(
    layout: &ImageLayout,
    file: &Sections<'_>,
    budget: &mut Budget,
) -> Result<Vec<MapInfo>, LoadError> {
    if !file.has(MAPS_ID) {
        return Ok(Vec::new());
    }
    let raw = file.read(MAPS_ID, budget)?;
    // The names, beside the section that they are copied from, and the maps.
    budget.take(raw.len() as u64 + (layout.images.len() * size_of::<MapInfo>()) as u64)?;
    let mut reader = Reader::new(String4(MAPS_ID), &raw);
    let mut read = || {
        let kind = MapKind::ALL.get(usize::from(reader.u8()?)).copied();
        let kind = kind.ok_or_else(|| reader.corrupt("an unknown kind of map"))?;
        let pixel = read_pixel(&mut reader)?;
        let length = usize::from(reader.u8()?);
        let name = std::str::from_utf8(reader.bytes(length)?);
        let name = name.map_err(|_| reader.corrupt("a name that is not UTF-8"))?.to_owned();
        Ok(MapInfo { kind, name, pixel })
    };
    let maps = layout.images.iter().map(|_| read()).collect::<Result<Vec<_>, LoadError>>()?;
    reader.end()?;
    MapInfo::check(&maps).map_err(|_| reader.corrupt("more maps than 64, or names that no writer gives"))?;
    if maps.first().map(|map| map.pixel) != Some(layout.pixel) {
        return Err(reader.corrupt("a first map that is unlike the layout"));
    }
    Ok(maps)
}

/// The number of images of `runs` runs, at least 1; every one has a size that a file may name, and all together fit the
/// budget's texels.
fn check_runs(mut reader: Reader<'_>, runs: u32, budget: &Budget) -> Result<u64, LoadError> {
    let (mut total, mut texels) = (0u64, 0u64);
    for _ in 0..runs {
        let (count, width, height) = (reader.u32()?, reader.u32()?, reader.u32()?);
        if count == 0 || !(1..=MAX_IMAGE_SIDE).contains(&width) || !(1..=MAX_IMAGE_SIDE).contains(&height) {
            return Err(reader.corrupt("a side outside 1..=32768 or a run of 0 images"));
        }
        let size = ImageSize { width, height };
        texels = texels.saturating_add(size.texels().saturating_mul(u64::from(count)));
        budget.check_texels(texels)?;
        total += u64::from(count);
    }
    if total == 0 {
        return Err(reader.corrupt("no image"));
    }
    Ok(total)
}

fn read_pixel(reader: &mut Reader<'_>) -> Result<PixelInfo, LoadError> {
    let [channels, depth, color, alpha] = reader.array()?;
    let threshold = reader.f32()?;
    if !(1..=4).contains(&channels) {
        return Err(reader.corrupt("channels outside 1..=4"));
    }
    let depth = match depth {
        8 => Depth::Eight,
        16 => Depth::Sixteen,
        _ => return Err(reader.corrupt("unknown depth")),
    };
    let color = match color {
        0 => ColorSpace::Srgb,
        1 => ColorSpace::Linear,
        2 => ColorSpace::Normal,
        _ => return Err(reader.corrupt("unknown colour space")),
    };
    let alpha = match alpha {
        0 => Alpha::Opaque,
        1 => Alpha::Straight,
        2 => Alpha::Cutout(threshold),
        3 => Alpha::Band,
        _ => return Err(reader.corrupt("unknown kind of alpha")),
    };
    Ok(PixelInfo { channels, depth, color, alpha })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::container::CodecId;

    #[test]
    fn a_layout_survives() {
        let size = |width, height| ImageSize { width, height };
        for alpha in [Alpha::Cutout(0.25), Alpha::Band] {
            let pixel = PixelInfo { channels: 4, depth: Depth::Sixteen, color: ColorSpace::Linear, alpha };
            let layout = ImageLayout::new(vec![size(3, 5), size(3, 5), size(64, 1)], 3, pixel);
            let map = |name: &str, kind, channels| MapInfo {
                kind,
                name: name.to_owned(),
                pixel: PixelInfo { channels, ..pixel },
            };
            let maps = vec![
                map("a_Color", MapKind::BaseColor, 4),
                map("\u{e4}_Height", MapKind::Height, 1),
                map("c", MapKind::Other, 3),
            ];
            survives(layout.clone());
            survives(ImageLayout { maps, ..layout });
        }
    }

    #[test]
    fn maps_that_no_writer_gives_are_refused() {
        let pixel = PixelInfo { channels: 1, ..PixelInfo::default() };
        let of = |names: [&str; 2], pixels: [PixelInfo; 2]| {
            let map = |(name, pixel): (&str, PixelInfo)| MapInfo {
                kind: MapKind::Other,
                name: name.to_owned(),
                pixel,
            };
            let layout = ImageLayout::new(vec![ImageSize { width: 1, height: 1 }; 2], 1, pixel);
            let layout = ImageLayout { maps: names.into_iter().zip(pixels).map(map).collect(), ..layout };
            let mut writer = SectionWriter::new(CodecId { number: 1, name: "t" });
            write_layout(&layout, &mut writer);
            let (bytes, mut budget) = (writer.finish().bytes, Budget::default());
            let sections = Sections::parse(&bytes, &mut budget).unwrap();
            let layout = read_layout(&sections, &mut budget).unwrap();
            read_maps(&layout, &sections, &mut budget)
        };
        assert!(of(["a", "b"], [pixel; 2]).is_ok());
        for names in [["a", "a"], ["a", "../b"], ["", "b"]] {
            assert!(matches!(of(names, [pixel; 2]), Err(LoadError::Corrupt { .. })), "{names:?}");
        }
        let rgb = PixelInfo { channels: 3, ..pixel };
        assert!(matches!(of(["a", "b"], [rgb, pixel]), Err(LoadError::Corrupt { .. })));
    }

    fn survives(layout: ImageLayout) {
        let mut writer = SectionWriter::new(CodecId { number: 1, name: "t" });
        write_layout(&layout, &mut writer);
        let bytes = writer.finish().bytes;
        let mut budget = Budget::default();
        let sections = Sections::parse(&bytes, &mut budget).unwrap();
        let found = read_layout(&sections, &mut budget).unwrap();
        let maps = read_maps(&found, &sections, &mut budget).unwrap();
        assert_eq!(ImageLayout { maps, ..found }, layout);
    }

    #[test]
    fn a_layout_that_would_fill_memory_is_refused() {
        let mut raw = vec![3, 8, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0];
        raw.extend([u32::MAX, 32768, 32768].map(u32::to_le_bytes).concat());
        let mut writer = SectionWriter::new(CodecId { number: 1, name: "t" });
        writer.section("container", LAYOUT_ID, &raw);
        let bytes = writer.finish().bytes;
        let mut budget = Budget::default();
        let sections = Sections::parse(&bytes, &mut budget).unwrap();
        assert!(matches!(read_layout(&sections, &mut budget), Err(LoadError::Limit(_))));
    }
}
