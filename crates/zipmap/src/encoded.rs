//! The shipped form: a root, patches with their matrices, and what a shader needs to find them.

use std::borrow::Cow;

use glam::{DMat3, IVec2, UVec2, UVec4, Vec2};
use texfold_bc::ContentPlanes;
use texfold_core::address::TEXFOLD_CLAMP;
use texfold_core::container::{SectionWriter, Sections, write_layout};
use texfold_core::image::{PixelInfo, to_u8};
use texfold_core::parallel::{for_each_row, map};
use texfold_core::{
    Access, Budget, Cached, CodecId, Domain, Encoded, Footprint, GpuDct, GpuForm, Image2d, ImageAddress,
    ImageBinding, ImageLayout, ImageSize, LoadError, Notes, Plane, PlaneFormat, Rect, RegionError, Texel,
    TextureCodec,
};
use texfold_dct::DctContent;

use crate::decode::{
    TEXFOLD_ZIPMAP_RECORD, TexfoldZipmapParams, ZipmapView, texfold_zipmap_fetch, texfold_zipmap_sample_grad,
};
use crate::parts::{ImageForm, PATCH_PART, Parts, Payload, ROOT_PART, TABLE_PART, patch_pixel};
use crate::table::{directory, matrix_of, most_table_bytes, record, tiles_a_side};
use crate::{Zipmap, wire};

/// Texels in a row of the table, as a binary logarithm.
const ROW_LOG2: u32 = 8;
/// Rows of texels in planes that are decoded at a time.
const DECODED_ROWS: u32 = 16;
/// The same of blocks: the tallest superblock.
const BLOCK_ROWS: u32 = 64;

/// A root with patches of higher resolution.
#[derive(Debug, Clone, PartialEq)]
pub struct ZipTexture {
    pub(crate) parts: Parts,
    params: TexfoldZipmapParams,
    table: Vec<UVec4>,
    /// Where each level of the patch images lies in their plane.
    origins: Vec<Vec<(u32, u32)>>,
    atlas: (u32, u32),
    /// What the CPU reads, and a GPU does not need.
    texels: Cached<Texels>,
    pub(crate) notes: Notes,
}

/// The texels of all levels, row by row.
#[derive(Debug, Clone)]
struct Texels {
    root: Vec<Vec<[u8; 4]>>,
    contents: Vec<Vec<Vec<[u8; 4]>>>,
}

/// Where a patch lies and how large it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PatchInfo {
    /// From the root's texture coordinates to its own, 0 to 1 each.
    pub matrix: DMat3,
    /// Columns and rows of its finest level.
    pub size: ImageSize,
    /// Stored mip levels.
    pub levels: u32,
}

/// The texels of planes that hold `pixel`, 8 bits a channel, row by row. A band of rows is decoded at a time, so that
/// no more is held than the result.
pub(crate) fn bytes_of(planes: &ContentPlanes, pixel: PixelInfo) -> Vec<[u8; 4]> {
    let (width, height) = planes.size();
    let mut out = vec![[0; 4]; width as usize * height as usize];
    for_each_row(&mut out, (width * DECODED_ROWS) as usize, |band, texels| {
        let start = band as u32 * DECODED_ROWS;
        let rows = DECODED_ROWS.min(height - start);
        let part = |(format, bytes): &(PlaneFormat, Vec<u8>)| {
            let first = format.bytes(width, start) as usize;
            bytes[first..first + format.bytes(width, rows) as usize].to_vec()
        };
        let parts = planes.planes().iter().map(part).collect();
        let band = ContentPlanes::from_planes(planes.content(), pixel, (width, rows), parts);
        let decoded = band.map_or_else(Vec::new, |band| band.decode());
        texels.iter_mut().zip(decoded).for_each(|(bytes, texel)| *bytes = texel.to_array().map(to_u8));
    });
    out
}

impl ZipTexture {
    pub(crate) fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<Self, LoadError> {
        let notes = Notes::read(file, budget)?;
        let parts = wire::load(file, budget)?;
        budget.take(most_table_bytes(parts.patches.len()))?;
        let texture = ZipTexture::new(parts, notes).ok_or(wire::too_large())?;
        budget.take(texture.copied_bytes())?;
        Ok(texture)
    }

    /// Lays the parts out for sampling; `None` where the patches do not fit a plane.
    pub(crate) fn new(parts: Parts, notes: Notes) -> Option<ZipTexture> {
        let (origins, atlas) = parts.packing()?;
        let tiles = tiles_a_side(parts.patches.len());
        let mut table = directory(&parts, tiles);
        // A row holds whole records.
        table.resize(table.len().next_multiple_of(TEXFOLD_ZIPMAP_RECORD as usize), UVec4::ZERO);
        let record_start = table.len() as u32;
        for patch in &parts.patches {
            let (ImageForm { size, levels }, origins) =
                (parts.images[patch.content], &origins[patch.content]);
            let numbers = (levels as usize, patch.content);
            table.extend(record(&patch.matrix, (size.width, size.height), numbers, (origins, parts.mips())));
        }
        let columns = (table.len()).min(1 << ROW_LOG2);
        table.resize(table.len().next_multiple_of(columns), UVec4::ZERO);
        let size = parts.layout.images[0];
        let root_size = parts.root_size();
        let [root_swizzle, patch_swizzle] = parts.swizzles();
        let params = TexfoldZipmapParams {
            size: [size.width, size.height],
            levels: parts.layout.levels,
            address_mode: TEXFOLD_CLAMP,
            root_size: [root_size.width, root_size.height],
            root_levels: parts.root_levels(),
            root_swizzle,
            tiles: [tiles; 2],
            record_start,
            patch_swizzle,
            row_log2: ROW_LOG2,
            reserved: [0; 3],
        };
        let texels = Cached::default();
        Some(ZipTexture { parts, params, table, origins, atlas, texels, notes })
    }

    /// The texture as the shader sees it; its texels are decoded when first asked for.
    #[must_use]
    pub fn view(&self) -> ZipmapView<'_> {
        let Texels { root, contents } = self.texels.get_or_make(|| self.decoded());
        ZipmapView { params: self.params, table: &self.table, root, patches: contents }
    }

    fn decoded(&self) -> Texels {
        let (root_pixel, pixel) = (self.parts.layout.pixel, patch_pixel(self.parts.layout.pixel));
        match &self.parts.payload {
            Payload::Planes { root, images } => {
                let levels = |levels: &[ContentPlanes], pixel| {
                    levels.iter().map(|level| bytes_of(level, pixel)).collect()
                };
                Texels {
                    root: levels(root, root_pixel),
                    contents: map(images.len(), |image| levels(&images[image], pixel)),
                }
            }
            Payload::Blocks { root, atlas } => {
                let mips = |atlas: &DctContent| {
                    (0..atlas.layout().levels).map(|mip| level_bytes(atlas, mip)).collect::<Vec<_>>()
                };
                let atlas = atlas.as_deref().map(mips).unwrap_or_default();
                Texels {
                    root: (0..self.parts.root_levels()).map(|level| level_bytes(root, level)).collect(),
                    contents: map(self.parts.images.len(), |image| self.cut(&atlas, image)),
                }
            }
        }
    }

    /// The levels of a patch image from the mip levels of the atlas. Means have no clear border of their own.
    fn cut(&self, atlas: &[Vec<[u8; 4]>], image: usize) -> Vec<Vec<[u8; 4]>> {
        let form = self.parts.images[image];
        let level = |(level, &(x, y)): (u32, &(u32, u32))| {
            let (size, mip) = (form.size.at_level(level), level % self.parts.mips());
            let (across, width) = ((self.atlas.0 >> mip) as usize, size.width as usize);
            let rows = y as usize..(y + size.height) as usize;
            let row = |row: usize| &atlas[mip as usize][row * across + x as usize..][..width];
            let mut texels: Vec<[u8; 4]> = rows.flat_map(row).copied().collect();
            if mip > 0 {
                clear_border(&mut texels, size);
            }
            texels
        };
        (0..).zip(&self.origins[image]).map(level).collect()
    }

    /// Bytes that [`Encoded::gpu`] copies of planes: the root, whose levels become one plane, and the plane of all patches.
    pub(crate) fn copied_bytes(&self) -> u64 {
        let Payload::Planes { root, .. } = &self.parts.payload else { return 0 };
        let planes = root.iter().flat_map(ContentPlanes::planes);
        let root: u64 = planes.map(|(_, bytes)| bytes.len() as u64).sum();
        root + self.atlas_format().bytes(self.atlas.0, self.atlas.1)
    }

    /// Number of patches.
    #[must_use]
    pub fn patches(&self) -> usize {
        self.parts.patches.len()
    }

    /// Where a patch lies and how large it is; `None` where there is no such one.
    #[must_use]
    pub fn patch(&self, index: usize) -> Option<PatchInfo> {
        let patch = self.parts.patches.get(index)?;
        let ImageForm { size, levels } = self.parts.images[patch.content];
        Some(PatchInfo { matrix: matrix_of(&patch.matrix), size, levels })
    }

    /// Number of patch images: fewer than patches where one lies at several places.
    #[must_use]
    pub fn contents(&self) -> usize {
        self.parts.images.len()
    }

    /// Columns and rows of the root.
    #[must_use]
    pub fn root_size(&self) -> ImageSize {
        self.parts.root_size()
    }

    /// How many levels are finer than the root.
    #[must_use]
    pub fn deep_levels(&self) -> u32 {
        self.parts.deep
    }

    /// An image of `width` x `height` pixels of the rectangle from `corner` to `corner + extent` of the root's texture
    /// coordinates, at any zoom.
    #[must_use]
    pub fn draw(&self, corner: Vec2, extent: Vec2, (width, height): (u32, u32)) -> Vec<Texel> {
        let view = self.view();
        let step = extent / Vec2::new(width as f32, height as f32);
        let pixel = |index: usize| {
            let at = Vec2::new((index as u32 % width) as f32, (index as u32 / width) as f32) + 0.5;
            texfold_zipmap_sample_grad(
                &view,
                corner + at * step,
                Vec2::new(step.x, 0.0),
                Vec2::new(0.0, step.y),
            )
        };
        map(width as usize * height as usize, pixel)
    }

    /// How its texels are stored, and so how a GPU reaches them.
    #[must_use]
    pub fn access(&self) -> Access {
        match self.parts.payload {
            Payload::Planes { .. } => Access::Texel,
            Payload::Blocks { .. } => Access::Block,
        }
    }

    /// The same texture without its patches from `count` on: the root alone where that is 0. Blocks hold all patch images
    /// together, so that these stay as long as there is a patch; where a patch that is left out would hide others, they are smooth.
    #[must_use]
    pub fn first_patches(&self, count: usize) -> ZipTexture {
        let mut parts = self.parts.clone();
        parts.patches.truncate(count);
        let used = parts.patches.iter().map(|patch| patch.content + 1).max().unwrap_or(0);
        match &mut parts.payload {
            Payload::Planes { images, .. } => {
                images.truncate(used);
                parts.images.truncate(used);
            }
            Payload::Blocks { atlas, .. } if used == 0 => {
                *atlas = None;
                parts.images.clear();
            }
            Payload::Blocks { .. } => {}
        }
        // Fewer patches fit where all did.
        ZipTexture::new(parts, self.notes.clone()).unwrap_or_else(|| self.clone())
    }

    /// Replaces the notes.
    #[must_use]
    pub fn with_notes(mut self, notes: Notes) -> Self {
        self.notes = notes;
        self
    }

    /// The table's numbers, lowest byte first.
    fn table_bytes(&self) -> Cow<'_, [u8]> {
        if cfg!(target_endian = "little") {
            return Cow::Borrowed(bytemuck::cast_slice(&self.table));
        }
        self.table.iter().flat_map(|texel| texel.to_array()).flat_map(u32::to_le_bytes).collect()
    }

    /// The planes of each patch image; none where they are in blocks.
    fn image_planes(&self) -> &[Vec<ContentPlanes>] {
        match &self.parts.payload {
            Payload::Planes { images, .. } => images,
            Payload::Blocks { .. } => &[],
        }
    }

    /// Format of the plane of all patches.
    fn atlas_format(&self) -> PlaneFormat {
        self.image_planes().first().map_or(PlaneFormat::Rgba8Unorm, |levels| levels[0].planes()[0].0)
    }

    /// The plane of all patches.
    fn atlas_plane(&self) -> Plane<'_> {
        let (width, height) = self.atlas;
        let format = self.atlas_format();
        let mut data = vec![0; format.bytes(width, height) as usize];
        let (side, block) = (format.block_side(), format.block_bytes() as usize);
        let row_bytes = width.div_ceil(side) as usize * block;
        for (levels, origins) in self.image_planes().iter().zip(&self.origins) {
            for (level, &(x, y)) in levels.iter().zip(origins) {
                let bytes = &level.planes()[0].1;
                let run = level.size().0.div_ceil(side) as usize * block;
                for (row, from) in bytes.chunks_exact(run).enumerate() {
                    let start = ((y / side) as usize + row) * row_bytes + (x / side) as usize * block;
                    data[start..start + run].copy_from_slice(from);
                }
            }
        }
        Plane { part: PATCH_PART, format, width, height, levels: 1, data: Cow::Owned(data) }
    }

    /// Planes of the root, each with all levels, and of the patches; which of them the shader's two for the root and the one for
    /// patches are.
    fn push_planes<'a>(&'a self, root: &'a [ContentPlanes], form: &mut GpuForm<'a>) -> [usize; 3] {
        let first = form.planes.len();
        form.planes.extend(root[0].gpu_planes(ROOT_PART));
        for (index, plane) in form.planes[first..].iter_mut().enumerate() {
            plane.levels = root.len() as u32;
            plane.data =
                Cow::Owned(root.iter().flat_map(|level| level.planes()[index].1.iter().copied()).collect());
        }
        let second = form.planes.len() - 1;
        form.planes.push(self.atlas_plane());
        [first, second, form.planes.len() - 1]
    }
}

/// Blocks of the root and of the patches as a GPU needs them; which of the textures behind all planes the shader's two for the root
/// and the one for patches are.
fn push_blocks<'a>(
    root: &'a DctContent,
    atlas: Option<&'a DctContent>,
    form: &mut GpuForm<'a>,
) -> [usize; 3] {
    let first = form.planes.len();
    let contents = [(ROOT_PART, Some(root)), (PATCH_PART, atlas)];
    for (image, (part, content)) in contents.into_iter().enumerate() {
        for blocks in content.into_iter().flat_map(DctContent::gpu) {
            let bytes = blocks.held_bytes.iter().map(|(_, bytes)| bytes).sum();
            form.blocks.push(GpuDct { image, held_bytes: vec![(part, bytes)], ..blocks });
        }
    }
    // Without patches nothing is read there.
    [first, first, first + usize::from(atlas.is_some())]
}

/// Makes the outer texels of a level transparent.
fn clear_border(texels: &mut [[u8; 4]], ImageSize { width, height }: ImageSize) {
    for (at, texel) in (0u32..).zip(texels) {
        let (x, y) = (at % width, at / width);
        if x == 0 || y == 0 || x + 1 == width || y + 1 == height {
            texel[3] = 0;
        }
    }
}

/// The texels of a level of the only image, 8 bits a channel, row by row.
fn level_bytes(content: &DctContent, level: u32) -> Vec<[u8; 4]> {
    let size = content.layout().images[0].at_level(level);
    let width = size.width as usize;
    let mut out = vec![[0; 4]; width * size.height as usize];
    for_each_row(&mut out, width * BLOCK_ROWS as usize, |band, bytes| {
        let (y, height) = (band as u32 * BLOCK_ROWS, (bytes.len() / width) as u32);
        let mut texels = vec![Texel::ZERO; bytes.len()];
        // A band of a level lies inside of it.
        let _ = content.decode(Rect { image: 0, level, x: 0, y, width: size.width, height }, &mut texels);
        bytes.iter_mut().zip(texels).for_each(|(bytes, texel)| *bytes = texel.to_array().map(to_u8));
    });
    out
}

impl Encoded for ZipTexture {
    type Domain = Image2d;

    fn codec(&self) -> CodecId {
        Zipmap::ID
    }

    fn layout(&self) -> &ImageLayout {
        &self.parts.layout
    }

    fn texel(&self, at: ImageAddress) -> Texel {
        let clamp = |value: u32| i32::try_from(value).unwrap_or(i32::MAX);
        let level = at.level.min(self.parts.layout.levels - 1);
        texfold_zipmap_fetch(&self.view(), IVec2::new(clamp(at.x), clamp(at.y)), level)
    }

    fn decode(&self, region: Rect, out: &mut [Texel]) -> Result<(), RegionError> {
        self.parts.layout.check(region)?;
        if out.len() != Image2d::len(region) {
            return Err(RegionError::OutputLength { found: out.len(), needed: Image2d::len(region) });
        }
        let view = self.view();
        let width = region.width.max(1) as usize;
        for_each_row(out, width, |row, line| {
            let y = region.y + row as u32;
            for (texel, x) in line.iter_mut().zip(region.x..) {
                *texel = texfold_zipmap_fetch(&view, UVec2::new(x, y).as_ivec2(), region.level);
            }
        });
        Ok(())
    }

    fn store(&self, out: &mut SectionWriter) {
        self.notes.write(out);
        write_layout(&self.parts.layout, out);
        wire::store(&self.parts, out);
    }

    fn footprint(&self) -> Footprint {
        Footprint::measure(self, &self.gpu())
    }

    fn gpu(&self) -> GpuForm<'_> {
        let columns = self.table.len().min(1 << ROW_LOG2);
        let mut form = GpuForm::new("zipmap");
        form.planes.push(Plane {
            part: TABLE_PART,
            format: PlaneFormat::Rgba32Uint,
            width: columns as u32,
            height: (self.table.len() / columns) as u32,
            levels: 1,
            data: self.table_bytes(),
        });
        let [first, second, patches] = match &self.parts.payload {
            Payload::Planes { root, .. } => self.push_planes(root, &mut form),
            Payload::Blocks { root, atlas } => push_blocks(root, atlas.as_deref(), &mut form),
        };
        form.uniforms = bytemuck::bytes_of(&self.params).to_vec();
        let planes = vec![0, first, second, patches];
        form.images = vec![ImageBinding { planes, uniforms: 0..form.uniforms.len(), image: 0 }];
        form
    }

    fn notes(&self) -> &Notes {
        &self.notes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use texfold_core::container::Sections;
    use texfold_core::{Budget, Effort, Encoder, Job, Limits, LoadError};

    use crate::{PatchSource, PatchStack, ZipParams};

    /// A file of a root with two patches, one in the other.
    fn file() -> Vec<u8> {
        let [root, image] = ["terrain", "facade"].map(texfold_testkit::image);
        let matrix = |zoom: f64| {
            DMat3::from_scale(DVec2::splat(zoom)) * DMat3::from_translation(DVec2::splat(0.5 / zoom - 0.5))
        };
        let patch = |zoom: f64| PatchSource { image: 0, matrix: matrix(zoom), mask: None, parent: None };
        let stack = PatchStack { root, images: vec![image], patches: vec![patch(2.0), patch(5.0)] };
        let params = ZipParams::default().with_access(Access::Texel).with_effort(Effort::Fast).with_tau(0.05);
        let encoded = Zipmap::encode(&stack, &params, &mut Job::default()).unwrap();
        let mut writer = SectionWriter::new(Zipmap::ID);
        encoded.store(&mut writer);
        writer.finish().bytes
    }

    fn open(file: &[u8], budget: &mut Budget) -> Result<ZipTexture, LoadError> {
        Zipmap::load(&Sections::parse(file, budget)?, budget)
    }

    #[test]
    fn a_texture_that_is_only_uploaded_holds_little_more_than_the_gpu() {
        let file = file();
        let mut budget = Budget::default();
        let texture = open(&file, &mut budget).unwrap();
        let gpu = texture.gpu();
        let Payload::Planes { root, images } = &texture.parts.payload else {
            panic!("planes were asked for")
        };
        let levels = images.iter().chain([root]).flatten();
        let planes: usize = levels.flat_map(ContentPlanes::planes).map(|(_, bytes)| bytes.len()).sum();
        let places: usize = texture.origins.iter().map(|levels| size_of_val(levels.as_slice())).sum();
        let held = (planes + places + size_of_val(texture.table.as_slice())) as f64;
        let uploaded = gpu.memory().compressed as f64 / 8.0;
        assert!(texture.patches() > 0 && held <= 1.3 * uploaded, "{held} {uploaded}");
        assert!(!texture.texels.is_made());
        // What the CPU reads and what an upload copies is booked, too.
        let drawn = texture.draw(Vec2::ZERO, Vec2::ONE, (4, 4));
        let Texels { root, contents } = texture.texels.get_or_make(|| texture.decoded());
        let texels: usize = contents.iter().chain([root]).flatten().map(Vec::len).sum();
        let copied: usize = gpu.planes[1..].iter().map(|plane| plane.data.len()).sum();
        assert_eq!(copied as u64, texture.copied_bytes());
        assert!(budget.peak_bytes() as f64 >= held + (4 * texels + copied) as f64);
        assert_eq!(drawn.len(), 16);
        let too_little = Limits { bytes: budget.peak_bytes() - 1, ..Limits::default() };
        assert!(matches!(open(&file, &mut Budget::new(too_little)), Err(LoadError::Limit(_))));
    }

    #[test]
    fn levels_of_means_have_a_clear_border_and_are_visible_inside() {
        let [root, image] = ["terrain", "facade"].map(texfold_testkit::image);
        let matrix = DMat3::from_scale(DVec2::splat(4.0));
        let patches = vec![PatchSource { image: 0, matrix, mask: None, parent: None }];
        let stack = PatchStack { root, images: vec![image], patches };
        let params = ZipParams::default().with_effort(Effort::Fast).with_tau(0.05).with_drop_rms(0.0);
        let texture = Zipmap::encode(&stack, &params, &mut Job::default()).unwrap();
        assert_eq!((texture.access(), texture.parts.mips()), (Access::Block, 3));
        let ImageForm { size, levels } = texture.parts.images[0];
        for level in (0..levels).filter(|level| level % 3 > 0) {
            let ImageSize { width, height } = size.at_level(level);
            let texels = &texture.view().patches[0][level as usize];
            for (at, texel) in (0u32..).zip(texels) {
                let (x, y) = (at % width, at / width);
                let border = x == 0 || y == 0 || x + 1 == width || y + 1 == height;
                assert!(!border || texel[3] == 0, "level {level}, {x} {y}");
            }
            assert!(texels.iter().any(|texel| texel[3] > 128), "level {level}");
        }
    }

    #[test]
    fn bands_of_rows_decode_as_the_whole_does() {
        let pixel = texfold_testkit::image("odd_37x61").info();
        let texels: Vec<Texel> = texfold_testkit::image("odd_37x61").texels().collect();
        for content in [texfold_bc::Content::Raw, texfold_bc::Content::Bc1, texfold_bc::Content::Bc7] {
            let planes = ContentPlanes::encode(content, pixel, (37, 61), &texels, Effort::Fast);
            let whole: Vec<[u8; 4]> =
                planes.decode().into_iter().map(|texel| texel.to_array().map(to_u8)).collect();
            assert!(bytes_of(&planes, pixel) == whole, "{content:?}");
        }
    }
}
