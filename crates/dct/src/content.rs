//! The images of a texture in blocks, as a codec embeds them: sections of its file, texels, lone texels, what a GPU needs.
//!
//! Mip levels 0, 3, 6 and so on are textures of their own (*stages*), and the two levels behind each are means of its texels: a
//! 64th of the texels more for a whole chain, and all levels are filtered in light.
//!
//! The file has two sections: "RBB0" (for each image and stage header, index, tables and the superblocks of its bases) and "RBD0"
//! (the superblocks of the stages themselves), which is a layer of its own: a prefix of the file without it decodes to the bases.

use std::sync::{Arc, Mutex, PoisonError};

use texfold_core::container::{ContentId, Reader, SectionWriter, Sections};
use texfold_core::image::{Depth, PixelInfo, to_rgba8};
use texfold_core::{
    BASE_PART, Budget, DCT_LEVELS, GpuDct, ImageAddress, ImageLayout, ImageSize, Layers, LoadError,
    MipAverage, RESIDUAL_PART, Rect, RegionError, String4, Texel,
};

use crate::average::{Samples, average_of};
use crate::channels::DctSample;
use crate::decode::DctTexture;
use crate::gpu::Stage;

/// Section with what comes first: headers, index, tables and bases.
const BASE: [u8; 3] = *b"RBB";
/// Section with the rest: the images' own superblocks.
const DETAIL: [u8; 3] = *b"RBD";
/// Superblocks that lone texels keep decoded.
const KEPT: usize = 4;
/// Bytes of memory that every image costs beside its streams and tables, loaded and as a GPU form.
const IMAGE_BYTES: u64 = (size_of::<DctTexture>() + size_of::<GpuDct<'_>>()
    // Lists of groups, channels, ranks and held parts: heap blocks of at most 512 bytes.
    + 4 * 512
    // Its place among the stages.
    + 2 * size_of::<u32>()) as u64;

/// Images in blocks of variable length.
#[derive(Debug)]
pub struct DctContent {
    layout: ImageLayout,
    /// The stages of each image, one image after the other.
    stages: Vec<DctTexture>,
    /// Number of each image's first stage, and behind them the number of all.
    firsts: Vec<u32>,
    kept: Mutex<Vec<Tile>>,
}

/// The texels of a superblock of a stage, or of a level that is made of it, kept for further lone texels.
#[derive(Debug, Clone)]
struct Tile {
    rect: Rect,
    texels: Arc<[Texel]>,
}

/// Sizes of the stages of an image of a layout with so many levels.
#[must_use]
pub fn stage_sizes(size: ImageSize, levels: u32) -> Vec<ImageSize> {
    let count = stage_count(size, levels) as u32;
    (0..count).map(|stage| size.at_level(DCT_LEVELS * stage)).collect()
}

fn stage_count(size: ImageSize, levels: u32) -> u64 {
    u64::from(levels.clamp(1, size.full_levels()).div_ceil(DCT_LEVELS))
}

impl Clone for DctContent {
    fn clone(&self) -> Self {
        DctContent::of(self.layout.clone(), self.stages.clone())
    }
}

impl PartialEq for DctContent {
    fn eq(&self, other: &Self) -> bool {
        self.layout == other.layout && self.stages == other.stages
    }
}

impl DctContent {
    fn of(layout: ImageLayout, stages: Vec<DctTexture>) -> Self {
        let counts = layout.images.iter().map(|&size| stage_sizes(size, layout.levels).len() as u32);
        let firsts = counts.scan(0, |next, count| {
            *next += count;
            Some(*next)
        });
        let firsts = std::iter::once(0).chain(firsts).collect();
        DctContent { layout, stages, firsts, kept: Mutex::default() }
    }

    /// Images of that layout, whose stages ([`stage_sizes`]) follow one another; `None` where one has another size, depth or
    /// number of channels.
    #[must_use]
    pub fn new(layout: ImageLayout, stages: Vec<DctTexture>) -> Option<Self> {
        let sizes = all_stages(&layout);
        let fits = |(&wanted, stage): (&(ImageSize, PixelInfo), &DctTexture)| fits(stage, wanted);
        let all = sizes.len() == stages.len() && sizes.iter().zip(&stages).all(fits);
        all.then(|| DctContent::of(layout, stages))
    }

    /// Sizes, mip levels, channels.
    #[must_use]
    pub fn layout(&self) -> &ImageLayout {
        &self.layout
    }

    /// The stages of all images, one image after the other.
    #[must_use]
    pub fn stages(&self) -> &[DctTexture] {
        &self.stages
    }

    /// The stages of all images.
    #[cfg(feature = "encode")]
    pub(crate) fn into_stages(self) -> Vec<DctTexture> {
        self.stages
    }

    /// The stages of an image; none where there is no such image.
    #[must_use]
    pub fn stages_of(&self, image: u32) -> &[DctTexture] {
        let first = |image: usize| self.firsts.get(image).map_or(usize::MAX, |&first| first as usize);
        self.stages.get(first(image as usize)..first(image as usize + 1)).unwrap_or_default()
    }

    /// Loaded of total layers: the bases, and the images' own superblocks.
    #[must_use]
    pub fn layers(&self) -> Layers {
        let is_whole = self.stages.iter().all(DctTexture::is_whole);
        let has_detail = self.stages.iter().any(DctTexture::has_detail);
        let total = if has_detail { 2 } else { 1 };
        Layers { loaded: if is_whole { total } else { 1 }, total }
    }

    /// The same as it is before its second layer is loaded.
    #[must_use]
    pub fn base_alone(&self) -> Self {
        let stages = self.stages.iter().map(DctTexture::base_alone).collect();
        DctContent::of(self.layout.clone(), stages)
    }

    /// Writes the bases, and the images' own superblocks where they are loaded.
    pub fn store(&self, id: ContentId, out: &mut SectionWriter) {
        self.store_parts([BASE_PART, RESIDUAL_PART], id, out);
    }

    /// As [`DctContent::store`], as one part of a footprint.
    pub fn store_as(&self, part: &'static str, id: ContentId, out: &mut SectionWriter) {
        self.store_parts([part; 2], id, out);
    }

    fn store_parts(&self, [base, detail]: [&'static str; 2], id: ContentId, out: &mut SectionWriter) {
        let bases: Vec<u8> = self.stages.iter().flat_map(DctTexture::base_bytes).collect();
        out.streams(base, id.section(BASE), &bases);
        let layers = self.layers();
        if layers.loaded == layers.total && layers.total > 1 {
            let bytes: Vec<u8> = self.stages.iter().flat_map(DctTexture::detail_bytes).copied().collect();
            out.streams(detail, id.section(DETAIL), &bytes);
        }
    }

    /// Ids of the two sections of content of that number.
    #[must_use]
    pub fn sections(id: ContentId) -> [[u8; 4]; 2] {
        [id.section(BASE), id.section(DETAIL)]
    }

    /// Whether a file has such content.
    #[must_use]
    pub fn is_in(id: ContentId, file: &Sections<'_>) -> bool {
        file.ids().any(|(found, _)| found == id.section(BASE))
    }

    /// Reads what [`DctContent::store`] wrote of images of that layout, the second layer where the file has brought it.
    ///
    /// # Errors
    /// [`LoadError`] where a section says what no writer says, or the budget does not allow what is loaded.
    pub fn load(
        layout: &ImageLayout,
        id: ContentId,
        file: &Sections<'_>,
        budget: &mut Budget,
    ) -> Result<Self, LoadError> {
        let raw = file.read(id.section(BASE), budget)?;
        let mut reader = Reader::new(String4(id.section(BASE)), &raw);
        let count: u64 = layout.images.iter().map(|&size| stage_count(size, layout.levels)).sum();
        budget.take(count * IMAGE_BYTES)?;
        let wanted = all_stages(layout);
        let mut read = |&wanted: &(ImageSize, PixelInfo)| {
            let image = DctTexture::read_base(&mut reader, budget)?;
            if !fits(&image, wanted) {
                return Err(reader.corrupt("an image of another size, depth or number of channels"));
            }
            Ok(image)
        };
        let stages = wanted.iter().map(&mut read).collect::<Result<Vec<_>, LoadError>>()?;
        reader.end()?;
        budget.take(stages.iter().map(working_bytes).max().unwrap_or(0))?;
        budget.release(raw.len() as u64);
        let content = DctContent::of(layout.clone(), stages);
        Ok(content.with_rest(id, file, budget)?.unwrap_or(content))
    }

    /// As [`DctContent::load`], for codecs without layers of their content: both of its layers must be there.
    ///
    /// # Errors
    /// As there, and [`LoadError::Truncated`] where the file has not brought the second layer.
    pub fn load_whole(
        layout: &ImageLayout,
        id: ContentId,
        file: &Sections<'_>,
        budget: &mut Budget,
    ) -> Result<Self, LoadError> {
        let content = DctContent::load(layout, id, file, budget)?;
        let layers = content.layers();
        if layers.loaded < layers.total {
            return Err(LoadError::Truncated { section: String4(id.section(DETAIL)) });
        }
        Ok(content)
    }

    /// The content with its second layer from a longer prefix of the file; `None` where it has that already or the file has
    /// not brought it.
    ///
    /// # Errors
    /// As [`DctContent::load`].
    pub fn with_rest(
        &self,
        id: ContentId,
        file: &Sections<'_>,
        budget: &mut Budget,
    ) -> Result<Option<Self>, LoadError> {
        let layers = self.layers();
        let named = file.ids().any(|(found, _)| found == id.section(DETAIL));
        // What a prefix has loaded is stored without.
        if named && layers.total == 1 {
            let section = String4(id.section(DETAIL));
            return Err(LoadError::Corrupt {
                section,
                offset: 0,
                what: "superblocks of an image that has none",
            });
        }
        if layers.loaded == layers.total || !file.has(id.section(DETAIL)) {
            return Ok(None);
        }
        let raw = file.read(id.section(DETAIL), budget)?;
        let mut reader = Reader::new(String4(id.section(DETAIL)), &raw);
        let mut whole = |image: &DctTexture| image.clone().with_detail(&mut reader, budget);
        let stages = self.stages.iter().map(&mut whole).collect::<Result<Vec<_>, LoadError>>()?;
        reader.end()?;
        budget.release(raw.len() as u64);
        Ok(Some(DctContent::of(self.layout.clone(), stages)))
    }

    /// The texels of a region, which lies inside of its level.
    ///
    /// # Errors
    /// [`RegionError`] where it does not, or `out` has another length.
    pub fn decode(&self, region: Rect, out: &mut [Texel]) -> Result<(), RegionError> {
        let (stage, reduce_log2) = self.stage_of(region, out.len())?;
        let rect = Rect { image: 0, level: 0, ..region };
        if reduce_log2 > 0 {
            let average = average_of(self.layout.pixel_of(region.image));
            return decode_reduced(stage, rect, reduce_log2, average, out);
        }
        if stage.form().depth > 8 {
            decode_as::<u16>(stage, rect, out)
        } else {
            decode_as::<u8>(stage, rect, out)
        }
    }

    /// The same as RGBA of 8 bits, rounded; without floats where samples of a stage have 8 bits.
    ///
    /// # Errors
    /// As there.
    pub fn decode_rgba8(&self, region: Rect, out: &mut [[u8; 4]]) -> Result<(), RegionError> {
        let (stage, reduce_log2) = self.stage_of(region, out.len())?;
        if reduce_log2 == 0 && stage.form().depth == 8 {
            return stage.decode_rgba8(Rect { image: 0, level: 0, ..region }, out);
        }
        let mut texels = vec![Texel::ZERO; out.len()];
        self.decode(region, &mut texels)?;
        to_rgba8(&texels, out);
        Ok(())
    }

    /// The stage that a region of so many texels is decoded from, and how often its sides are halved.
    fn stage_of(&self, region: Rect, length: usize) -> Result<(&DctTexture, u32), RegionError> {
        self.layout.check(region)?;
        let needed = region.width as usize * region.height as usize;
        if length != needed {
            return Err(RegionError::OutputLength { found: length, needed });
        }
        let level = level_of(self.layout.images[region.image as usize], region.level);
        let stage = &self.stages_of(region.image)[(level / DCT_LEVELS) as usize];
        Ok((stage, level % DCT_LEVELS))
    }

    /// Columns, rows and texels of the means of an image's 8x8 blocks, each averaged as it is stored; nothing where there is no
    /// such image.
    #[must_use]
    pub fn base_texels(&self, image: u32) -> Option<(ImageSize, Vec<Texel>)> {
        let stage = self.stages_of(image).first()?;
        let (size, values) = stage.base_samples();
        let largest = if stage.form().depth > 8 { f32::from(u16::MAX) } else { f32::from(u8::MAX) };
        let texels = values.chunks_exact(stage.form().channels()).map(|texel| texel_of(texel, largest));
        Some((size, texels.collect()))
    }

    /// One texel; the nearest inside where the address lies outside. The last superblocks are kept.
    #[must_use]
    pub fn texel(&self, at: ImageAddress) -> Texel {
        let image = at.image.min(self.layout.images.len().saturating_sub(1) as u32);
        let Some(&size) = self.layout.images.get(image as usize) else { return Texel::ZERO };
        let level = level_of(size, at.level.min(self.layout.levels - 1));
        let Some(stage) = self.stages_of(image).get((level / DCT_LEVELS) as usize) else {
            return Texel::ZERO;
        };
        let size = size.at_level(level);
        let (x, y) = (at.x.min(size.width - 1), at.y.min(size.height - 1));
        let side = stage.superblock_side() >> (level % DCT_LEVELS);
        let (left, top) = (x / side * side, y / side * side);
        let (width, height) = (side.min(size.width - left), side.min(size.height - top));
        let rect = Rect { image, level, x: left, y: top, width, height };
        self.tile(rect).get(((y - top) * width + x - left) as usize).copied().unwrap_or(Texel::ZERO)
    }

    /// The texels of a superblock, kept or decoded.
    fn tile(&self, rect: Rect) -> Arc<[Texel]> {
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let mut tiles = kept();
        if let Some(at) = tiles.iter().position(|tile| tile.rect == rect) {
            tiles[at..].rotate_left(1);
            return tiles.last().map_or(Arc::default(), |tile| tile.texels.clone());
        }
        drop(tiles);
        let mut texels = vec![Texel::ZERO; rect.width as usize * rect.height as usize];
        // A superblock of a level lies inside of it.
        let _ = self.decode(rect, &mut texels);
        let texels: Arc<[Texel]> = texels.into();
        let mut tiles = kept();
        if tiles.len() >= KEPT {
            tiles.remove(0);
        }
        tiles.push(Tile { rect, texels: texels.clone() });
        texels
    }

    /// Bytes that are held of all images: headers, indices, tables and superblocks that are loaded.
    #[must_use]
    pub fn held_bytes(&self) -> u64 {
        self.stages.iter().map(DctTexture::held_bytes).sum()
    }

    /// Bytes that are held of an image.
    #[must_use]
    pub fn held_bytes_of(&self, image: u32) -> u64 {
        self.stages_of(image).iter().map(DctTexture::held_bytes).sum()
    }

    /// What a GPU needs of each stage.
    pub fn gpu(&self) -> impl Iterator<Item = GpuDct<'_>> + '_ {
        (0u32..).zip(&self.layout.images).flat_map(move |(index, &size)| {
            let average = average_of(self.layout.pixel_of(index));
            let levels = self.layout.levels.min(size.full_levels());
            (0u32..).step_by(DCT_LEVELS as usize).zip(self.stages_of(index)).map(move |(level, stage)| {
                let levels = (levels - level).min(DCT_LEVELS);
                stage.gpu(Stage { image: index as usize, level, levels, average })
            })
        })
    }
}

/// The texels of a region of a level whose texels are means of squares of a stage's.
fn decode_reduced(
    stage: &DctTexture,
    region: Rect,
    reduce_log2: u32,
    average: MipAverage,
    out: &mut [Texel],
) -> Result<(), RegionError> {
    let form = stage.form();
    let cut = |first: u32, count: u32, all: u32| {
        let start = (first << reduce_log2).min(all - 1);
        (start, (((first + count) << reduce_log2).min(all) - start).max(1))
    };
    let (x, width) = cut(region.x, region.width, form.size.width);
    let (y, height) = cut(region.y, region.height, form.size.height);
    let channels = form.channels();
    let mut values = vec![0u16; width as usize * height as usize * channels];
    stage.decode(Rect { x, y, width, height, ..region }, &mut values)?;
    let largest = if form.depth > 8 { u16::MAX } else { u16::from(u8::MAX) };
    let samples = Samples { size: ImageSize { width, height }, channels, largest, values: &values };
    let size = ImageSize { width: region.width, height: region.height };
    let means = samples.reduced(reduce_log2, size, average);
    for (texel, means) in out.iter_mut().zip(means.chunks_exact(channels)) {
        *texel = texel_of(means, f32::from(largest));
    }
    Ok(())
}

/// The texels of a rectangle of a stage.
fn decode_as<S: DctSample + Into<u16>>(
    stage: &DctTexture,
    rect: Rect,
    out: &mut [Texel],
) -> Result<(), RegionError> {
    let channels = stage.form().channels();
    let largest = if stage.form().depth > 8 { f32::from(u16::MAX) } else { f32::from(u8::MAX) };
    let mut samples = vec![S::default(); out.len() * channels];
    stage.decode(rect, &mut samples)?;
    for (texel, samples) in out.iter_mut().zip(samples.chunks_exact(channels)) {
        *texel = texel_of(samples, largest);
    }
    Ok(())
}

fn texel_of<S: Copy + Into<u16>>(samples: &[S], largest: f32) -> Texel {
    let value = |sample: S| f32::from(sample.into()) / largest;
    match *samples {
        [gray] => Texel::new(value(gray), value(gray), value(gray), 1.0),
        [gray, alpha] => Texel::new(value(gray), value(gray), value(gray), value(alpha)),
        [red, green, blue] => Texel::new(value(red), value(green), value(blue), 1.0),
        [red, green, blue, alpha, ..] => Texel::new(value(red), value(green), value(blue), value(alpha)),
        [] => Texel::ZERO,
    }
}

/// Bytes that lone texels of a stage take: superblocks that are kept, and what one is decoded with.
fn working_bytes(stage: &DctTexture) -> u64 {
    let (form, side) = (stage.form(), u64::from(stage.superblock_side()));
    let texels = side.min(form.size.width.into()) * side.min(form.size.height.into());
    let channels = form.channels() as u64;
    let kept = (KEPT as u64 + 1) * texels * size_of::<Texel>() as u64;
    // Samples of axes, of channels, and what contexts look at: 129 bytes of a block's axis.
    kept + 4 * channels * side * side + 2 * channels * texels + 129 * channels * (side / 8) * (side / 8)
}

/// Sizes and pixels of the stages of all images.
fn all_stages(layout: &ImageLayout) -> Vec<(ImageSize, PixelInfo)> {
    let of_image = |(image, &size): (u32, &ImageSize)| {
        let pixel = layout.pixel_of(image);
        stage_sizes(size, layout.levels).into_iter().map(move |size| (size, pixel))
    };
    (0..).zip(&layout.images).flat_map(of_image).collect()
}

/// Level of an image of that size that stands for a level of a set: the last where it has fewer.
fn level_of(size: ImageSize, level: u32) -> u32 {
    level.min(size.full_levels() - 1)
}

fn fits(image: &DctTexture, (size, pixel): (ImageSize, PixelInfo)) -> bool {
    let form = image.form();
    let depth = if pixel.depth == Depth::Eight { 8 } else { 16 };
    form.size == size && form.depth == depth && form.channels() == usize::from(pixel.channels)
}
