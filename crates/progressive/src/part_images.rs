//! Images of the parts of a texture, for a person to look at.

use glam::{Vec2, Vec3};
use texfold_core::image::{ColorSpace, PartImages, PixelInfo, Raster};
use texfold_core::{ImageSize, Texel};

use texfold_residual::{BLOCK_SIDE, blocks_of};

use crate::ProgressiveTexture;
use crate::codebook::{Codebook, Details, Entry, MOST_GAIN};
use crate::decode::texfold_progressive_rotation;

/// Gray of what is read once; black is not read at all.
const DARKEST: f32 = 0.2;
/// Gain below which a block's colour says no more, as a share of the largest.
const LEAST_SHOWN: f32 = 0.3;
/// Colours of blocks that use public content, and the texture's own.
const PUBLIC: Vec3 = Vec3::new(0.3, 0.7, 1.0);
const OWN: Vec3 = Vec3::new(1.0, 0.6, 0.2);

/// Draws the parts of `texture`, of the largest level that is stored; `None` only where an image cannot be made at all.
///
/// - "base": the base of each image.
/// - "bits": for each image the bits of each block of its residual plane: black none, through red and yellow to white, the most of the
///   texture; no image where there is no residual plane.
/// - "source": for each image what each block reads of codebooks: black nothing, blue public content, orange its own, the brighter the
///   larger the gain; no image where there are no codebooks.
/// - "codebook": the public and the own codebook, as far as there are any.
/// - "usage": for each codebook how many texels are read from each of its texels: black none, the most white, by the logarithm.
#[must_use]
pub fn part_images(texture: &ProgressiveTexture) -> Option<Vec<PartImages>> {
    let [mut bases, mut bits, mut sources, mut codebooks, mut usage] = [(); 5].map(|()| Vec::new());
    let images = &texture.stored().images;
    for (image, &size) in images.iter().enumerate() {
        let view = texture.view(image as u32);
        let [width, height] = view.residual.params.base_size;
        bases.push(Raster::from_texels(width, height, texture.stored().pixel, &view.residual.base[0]).ok()?);
        if !texture.classes(image as u32).is_empty() {
            bits.push(draw_bits(texture, image as u32, size)?);
        }
    }
    if let Some(details) = texture.details() {
        let entries: Vec<Vec<Entry>> =
            details.maps.iter().map(|map| map.entries(details.form).collect()).collect();
        for (&size, entries) in images.iter().zip(&entries) {
            sources.push(draw_sources(details, entries, size)?);
        }
        for (private, book) in [(false, &details.public), (true, &details.private)] {
            let Some(book) = book else { continue };
            codebooks.push(draw_codebook(book)?);
            let sizes = images.iter().copied().zip(&entries);
            let counts = count_reads(details, private, book.size(), sizes);
            usage.push(draw_usage(book.size(), &counts)?);
        }
    }
    let named = ["base", "bits", "source", "codebook", "usage"].into_iter();
    let parts = named.zip([bases, bits, sources, codebooks, usage]);
    Some(parts.map(|(name, images)| PartImages { name, images }).collect())
}

/// An image of such colours.
fn draw(size: ImageSize, color: impl Fn(u32, u32) -> Vec3) -> Option<Raster> {
    let info = PixelInfo { channels: 3, color: ColorSpace::Srgb, ..PixelInfo::default() };
    let texels: Vec<Texel> = (0..size.height)
        .flat_map(|y| (0..size.width).map(move |x| (x, y)))
        .map(|(x, y)| color(x, y).extend(1.0))
        .collect();
    Raster::from_texels(size.width, size.height, info, &texels).ok()
}

fn draw_bits(texture: &ProgressiveTexture, image: u32, size: ImageSize) -> Option<Raster> {
    let (columns, rows) = blocks_of(size);
    let classes = texture.classes(image);
    let classes = classes.get(..(columns * rows) as usize)?;
    let most = classes.iter().copied().max().unwrap_or(0).max(1);
    let class = |x: u32, y: u32| classes[(y / BLOCK_SIDE * columns + x / BLOCK_SIDE) as usize];
    Raster::heat_map(size, |x, y| f32::from(class(x, y)) / f32::from(most)).ok()
}

fn draw_sources(details: &Details, entries: &[Entry], size: ImageSize) -> Option<Raster> {
    let side = 1u32 << details.form.side_log2;
    let columns = size.width.div_ceil(side);
    let public_rows = details.public.as_ref().map_or(0, |book| book.size().1);
    draw(size, |x, y| {
        let entry = entries[(y / side * columns + x / side) as usize];
        let gain = (entry.gain & MOST_GAIN) as f32 / MOST_GAIN as f32;
        let color = if entry.row >= public_rows { OWN } else { PUBLIC };
        if gain > 0.0 { color * (LEAST_SHOWN + (1.0 - LEAST_SHOWN) * gain) } else { Vec3::ZERO }
    })
}

fn draw_codebook(book: &Codebook) -> Option<Raster> {
    let (width, height) = book.size();
    let values = book.values();
    draw(ImageSize { width, height }, |x, y| {
        Vec3::splat(0.5 + 0.5 * values[y as usize * width as usize + x as usize])
    })
}

/// How many texels of level 0 are read from each texel of one of the codebooks.
fn count_reads<'e>(
    details: &Details,
    private: bool,
    (width, height): (u32, u32),
    images: impl Iterator<Item = (ImageSize, &'e Vec<Entry>)>,
) -> Vec<u32> {
    let (form, side) = (details.form, 1u32 << details.form.side_log2);
    let public_rows = details.public.as_ref().map_or(0, |book| book.size().1);
    let first = if private { public_rows } else { 0 };
    let last = Vec2::new(width as f32 - 1.0, height as f32 - 1.0);
    let mut counts = vec![0u32; width as usize * height as usize];
    for (size, entries) in images {
        let blocks = size.width.div_ceil(side) as usize * size.height.div_ceil(side) as usize;
        let drawn = |entry: &&Entry| entry.gain & MOST_GAIN > 0 && (entry.row >= public_rows) == private;
        for entry in entries.iter().take(blocks).filter(drawn) {
            let rotation = texfold_progressive_rotation(entry.rotation, form.rotation_bits);
            let centre = Vec2::new(entry.column as f32, (entry.row - first) as f32);
            for (x, y) in (0..side * side).map(|i| (i % side, i / side)) {
                let away = Vec2::new(x as f32, y as f32) + Vec2::splat(0.5 - 0.5 * side as f32);
                let moved = Vec2::new(
                    rotation.x * away.x + rotation.y * away.y,
                    rotation.z * away.x + rotation.w * away.y,
                );
                let at = (centre + moved).floor().clamp(Vec2::ZERO, last);
                counts[at.y as usize * width as usize + at.x as usize] += 1;
            }
        }
    }
    counts
}

fn draw_usage((width, height): (u32, u32), counts: &[u32]) -> Option<Raster> {
    let most = counts.iter().copied().max().unwrap_or(0).max(2) as f32;
    draw(ImageSize { width, height }, |x, y| match counts[y as usize * width as usize + x as usize] {
        0 => Vec3::ZERO,
        count => Vec3::splat(DARKEST + (1.0 - DARKEST) * (count as f32).log2() / most.log2()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Progressive, ProgressiveParams};
    use texfold_core::image::ImageSet;
    use texfold_core::{Encoder, Goal, Job};

    fn texture(bpp: f64) -> ProgressiveTexture {
        let set = ImageSet::single(texfold_testkit::image("terrain"));
        let params = ProgressiveParams::default().with_goal(Goal::Bpp(bpp));
        Progressive::encode(&set, &params, &mut Job::default()).unwrap()
    }

    fn sizes(rasters: &[Raster]) -> Vec<(u32, u32)> {
        rasters.iter().map(|raster| (raster.size().width, raster.size().height)).collect()
    }

    #[test]
    fn blocks_are_as_bright_as_they_have_bits() {
        let texture = texture(2.0);
        let parts = part_images(&texture).unwrap();
        let of = |name: &str| PartImages::of(&parts, name);
        assert_eq!(sizes(of("bits")), [(256, 256)]);
        let side = 256 >> texture.reduce_log2();
        assert_eq!(sizes(of("base")), [(side, side)]);
        let classes = texture.classes(0);
        let most = classes.iter().copied().max().unwrap();
        for (block, class) in (0..).zip(classes.clone()) {
            let texel = of("bits")[0].texel(block % 32 * 8 + 5, block / 32 * 8 + 2);
            let heat = texel.x + texel.y + texel.z;
            assert!((heat - 3.0 * f32::from(class) / f32::from(most)).abs() < 1e-5, "{block}");
        }
        assert!(of("codebook").is_empty() && of("source").is_empty());
    }

    #[test]
    fn as_many_texels_are_read_as_blocks_show() {
        let book = |rows: usize, seed: usize| {
            let value = |n: usize, i: usize| ((i * 7 + n * 13 + seed) % 200) as f32 / 100.0 - 1.0;
            let cells: Vec<Vec<f32>> =
                (0..2 * rows).map(|n| (0..1024).map(|i| value(n, i)).collect()).collect();
            Codebook::of_cells(texfold_bc::Content::Raw, 64, &cells).unwrap()
        };
        let form = crate::MapForm { side_log2: 3, column_bits: 6, row_bits: 7, rotation_bits: 5 };
        let entry = |i: u32| Entry { column: 8 + i, row: 8 + 16 * i, rotation: 5 * i, gain: i % 3 };
        let entries: Vec<Entry> = (0..6).map(entry).collect();
        let details = Details {
            public: Some(std::sync::Arc::new(book(1, 0))),
            private: Some(std::sync::Arc::new(book(2, 5))),
            form,
            gain_unit: 9,
            maps: vec![crate::codebook::EntryMap::new(&entries, form)],
        };
        let size = ImageSize { width: 24, height: 16 };
        let reads = |private, (width, height)| {
            count_reads(&details, private, (width, height), [(size, &entries)].into_iter())
        };
        // Entries 0 and 3 add nothing; 1 lies in the 32 public rows, 2, 4 and 5 behind them.
        assert_eq!(reads(false, (64, 32)).iter().sum::<u32>(), 64);
        let own = reads(true, (64, 64));
        assert_eq!(own.iter().sum::<u32>(), 3 * 64);
        // Entry 2 rotates about column 10 and row 8 of the own rows by half a quarter turn.
        assert!(own[8 * 64 + 10] > 0 && own[0] == 0);
        let sources = draw_sources(&details, &entries, size).unwrap();
        let blue = sources.texel(9, 3);
        assert!(blue.z > blue.x && sources.texel(17, 3).x > sources.texel(17, 3).z);
        assert_eq!(sources.texel(0, 0).truncate(), Vec3::ZERO);
    }
}
