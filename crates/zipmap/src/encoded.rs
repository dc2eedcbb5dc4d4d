//! The shipped form: a root, patches with their matrices, and what a shader needs to find them.

use std::borrow::Cow;

use glam::{DMat3, IVec2, UVec2, UVec4, Vec2};
use texfold_bc::ContentPlanes;
use texfold_core::address::TEXFOLD_CLAMP;
use texfold_core::container::{SectionWriter, Sections, write_layout};
use texfold_core::image::{PixelInfo, to_u8};
use texfold_core::parallel::{for_each_row, map};
use texfold_core::{
    Budget, Cached, CodecId, Domain, Encoded, Footprint, GpuForm, Image2d, ImageAddress, ImageLayout,
    LoadError, Notes, Plane, PlaneFormat, Rect, RegionError, SurfaceBinding, SurfaceSize, Texel,
    TextureCodec,
};

use crate::atlas::pack;
use crate::decode::{
    TEXFOLD_ZIPMAP_RECORD, TexfoldZipmapParams, ZipmapView, texfold_zipmap_fetch, texfold_zipmap_sample_grad,
};
use crate::parts::{PATCH_PART, Parts, PatchForm, ROOT_PART, TABLE_PART, patch_pixel};
use crate::table::{directory, matrix_of, most_table_bytes, record, tiles_a_side};
use crate::{Zipmap, wire};

/// Texels in a row of the table, as a binary logarithm.
const ROW_LOG2: u32 = 8;
/// Rows of texels that are decoded at a time.
const DECODED_ROWS: u32 = 16;

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
    pub size: SurfaceSize,
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
        let (origins, atlas) = pack(&parts.contents)?;
        let tiles = tiles_a_side(parts.patches.len());
        let mut table = directory(&parts, tiles);
        // A row holds whole records.
        table.resize(table.len().next_multiple_of(TEXFOLD_ZIPMAP_RECORD as usize), UVec4::ZERO);
        let record_start = table.len() as u32;
        for patch in &parts.patches {
            let (levels, origins) = (&parts.contents[patch.content], &origins[patch.content]);
            let numbers = (levels.len(), patch.content);
            table.extend(record(&patch.matrix, levels[0].size(), numbers, origins));
        }
        let columns = (table.len()).min(1 << ROW_LOG2);
        table.resize(table.len().next_multiple_of(columns), UVec4::ZERO);
        let size = parts.layout.surfaces[0];
        let root_size = parts.root[0].size();
        let params = TexfoldZipmapParams {
            size: [size.width, size.height],
            levels: parts.layout.levels,
            address_mode: TEXFOLD_CLAMP,
            root_size: [root_size.0, root_size.1],
            root_levels: parts.root.len() as u32,
            root_swizzle: parts.root[0].swizzle().0,
            tiles: [tiles; 2],
            record_start,
            patch_swizzle: parts.contents.first().map_or(0, |levels| levels[0].swizzle().0),
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
        let (root, patch) = (self.parts.layout.pixel, patch_pixel(self.parts.layout.pixel));
        let levels =
            |levels: &[ContentPlanes], pixel| levels.iter().map(|level| bytes_of(level, pixel)).collect();
        Texels {
            root: levels(&self.parts.root, root),
            contents: map(self.parts.contents.len(), |content| levels(&self.parts.contents[content], patch)),
        }
    }

    /// Bytes that [`Encoded::gpu`] copies: the root, whose levels become one plane, and the plane of all patches.
    pub(crate) fn copied_bytes(&self) -> u64 {
        let planes = self.parts.root.iter().flat_map(ContentPlanes::planes);
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
        let levels = &self.parts.contents[patch.content];
        let (width, height) = levels[0].size();
        let size = SurfaceSize { width, height };
        Some(PatchInfo { matrix: matrix_of(&patch.matrix), size, levels: levels.len() as u32 })
    }

    /// Number of patch images: fewer than patches where one lies at several places.
    #[must_use]
    pub fn contents(&self) -> usize {
        self.parts.contents.len()
    }

    /// Columns and rows of the root.
    #[must_use]
    pub fn root_size(&self) -> SurfaceSize {
        let (width, height) = self.parts.root[0].size();
        SurfaceSize { width, height }
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

    /// The same texture without its patches from `count` on: the root alone where that is 0.
    #[must_use]
    pub fn first_patches(&self, count: usize) -> ZipTexture {
        let patches: Vec<PatchForm> = self.parts.patches.iter().take(count).cloned().collect();
        let contents = patches.iter().map(|patch| patch.content + 1).max().unwrap_or(0);
        let contents = self.parts.contents[..contents].to_vec();
        let Parts { layout, deep, root, .. } = &self.parts;
        let parts = Parts { layout: layout.clone(), deep: *deep, root: root.clone(), contents, patches };
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

    /// Format of the plane of all patches.
    fn atlas_format(&self) -> PlaneFormat {
        self.parts.contents.first().map_or(PlaneFormat::Rgba8Unorm, |levels| levels[0].planes()[0].0)
    }

    /// The plane of all patches.
    fn atlas_plane(&self) -> Plane<'_> {
        let (width, height) = self.atlas;
        let format = self.atlas_format();
        let mut data = vec![0; format.bytes(width, height) as usize];
        let (side, block) = (format.block_side(), format.block_bytes() as usize);
        let row_bytes = width.div_ceil(side) as usize * block;
        for (levels, origins) in self.parts.contents.iter().zip(&self.origins) {
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
}

impl Encoded for ZipTexture {
    type Domain = Image2d;

    fn codec(&self) -> CodecId {
        Zipmap::ID
    }

    fn layout(&self) -> &ImageLayout {
        &self.parts.layout
    }

    fn sample(&self, at: ImageAddress) -> Texel {
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
        let table = Plane {
            part: TABLE_PART,
            format: PlaneFormat::Rgba32Uint,
            width: columns as u32,
            height: (self.table.len() / columns) as u32,
            levels: 1,
            data: self.table_bytes(),
        };
        let mut planes = vec![table];
        let levels = &self.parts.root;
        planes.extend(levels[0].gpu_planes(ROOT_PART));
        for (index, plane) in planes[1..].iter_mut().enumerate() {
            plane.levels = levels.len() as u32;
            plane.data =
                Cow::Owned(levels.iter().flat_map(|level| level.planes()[index].1.iter().copied()).collect());
        }
        let root_b = planes.len() - 1;
        planes.push(self.atlas_plane());
        let atlas = planes.len() - 1;
        let uniforms = bytemuck::bytes_of(&self.params).to_vec();
        let surface =
            SurfaceBinding { planes: vec![0, 1, root_b, atlas], uniforms: 0..uniforms.len(), surface: 0 };
        GpuForm { planes, uniforms, surfaces: vec![surface], ..GpuForm::new("zipmap") }
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
        let params = ZipParams::default().with_effort(Effort::Fast).with_tau(0.05);
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
        let levels = texture.parts.contents.iter().chain([&texture.parts.root]).flatten();
        let planes: usize = levels.flat_map(ContentPlanes::planes).map(|(_, bytes)| bytes.len()).sum();
        let places: usize = texture.origins.iter().map(|levels| size_of_val(levels.as_slice())).sum();
        let held = (planes + places + size_of_val(texture.table.as_slice())) as f64;
        let uploaded = gpu.bits_memory() as f64 / 8.0;
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
