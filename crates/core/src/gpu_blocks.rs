//! Textures in blocks of variable length, as a compute shader decodes them: no wgpu here.
//!
//! Such a texture is a pyramid of planes, each the means of the 8x8 blocks of the finer one. A superblock of 2x2, 4x4 or 8x8
//! blocks has a stream of its own and needs the means of its blocks and of those around them. [`BlockLayout::plan`] says which
//! superblocks of which planes a rectangle needs, and where the decoder holds them.

use std::ops::Range;

use crate::{Rect, RegionError, SurfaceSize};

/// Samples of a block, and words that the decoder holds for it.
pub const BLOCK_WORDS: u32 = 64;
/// Texels along a block's side.
const SIDE: u32 = 8;
/// Words that the decoder keeps of a block's axis beside its coefficients: the symbol of their number, then in two words each
/// which of them are not zero and what signs those have.
pub const BLOCK_NOTES: u32 = 5;
/// Most axes of a texture: their places in their groups take two bits each of a word.
const MAX_AXES: usize = 16;

/// A texture in blocks of variable length.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GpuBlocks<'a> {
    /// What the words say, and how the image is cut.
    pub layout: BlockLayout,
    /// Constants, tables of probabilities, steps, index: what a decoder works with, 30 kB and the index. They follow from
    /// `held_bytes` and need not be kept while nothing is decoded.
    pub words: Vec<u32>,
    /// Bytes of all superblocks.
    pub streams: &'a [u8],
    /// Number of the image that it belongs to.
    pub image: usize,
    /// Mip level of that image that it is.
    pub level: u32,
    /// Mip levels that are made of it, from that one on: 1 to [`BLOCK_LEVELS`].
    pub levels: u32,
    /// First row of the image's level that it holds. Where an image without further levels is put together of several textures of
    /// its width, one below the other, these follow one another.
    pub row: u32,
    /// What must be held to decode it: for each part of the footprint its bytes, header, index and tables among them.
    pub held_bytes: Vec<(&'static str, u64)>,
}

/// A plain texture with mip levels that the textures in blocks of one image are decoded to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DecodedImage {
    /// Columns and rows of level 0, in texels.
    pub size: SurfaceSize,
    /// Mip levels.
    pub levels: u32,
    /// Bits of a sample, 8 or 16: decoded to four channels of 8 or of 32 bits.
    pub depth: u8,
    /// Whether its only level is put together of several textures, one below the other ([`GpuBlocks::row`]).
    pub is_stacked: bool,
}

impl DecodedImage {
    /// The image that `stages`, all of one image, are decoded to; `None` where there is none.
    #[must_use]
    pub fn of(stages: &[GpuBlocks<'_>]) -> Option<DecodedImage> {
        let BlockLayout { size, depth, .. } = stages.first()?.layout;
        let last_row = stages.iter().map(|stage| stage.row.saturating_add(stage.layout.size.height)).max()?;
        let is_stacked = last_row != size.height && stages.iter().all(|stage| stage.level == 0);
        let height = if is_stacked { last_row } else { size.height };
        let levels = if is_stacked { 1 } else { stages.iter().map(|stage| stage.levels).sum() };
        Some(DecodedImage { size: SurfaceSize { height, ..size }, levels, depth, is_stacked })
    }

    /// Bits of a decoded texel: 32 (four bytes), or 128 (four floats) for samples of more than 8 bits.
    #[must_use]
    pub fn texel_bits(&self) -> u64 {
        if self.depth > 8 { 128 } else { 32 }
    }

    /// Bits of all mip levels.
    #[must_use]
    pub fn bits(&self) -> u64 {
        (0..self.levels).map(|level| self.texel_bits() * self.size.at_level(level).texels()).sum()
    }
}

/// How the planes of a texture are cut, and what its words say.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BlockLayout {
    /// Columns and rows of the image.
    pub size: SurfaceSize,
    /// Bits of a sample, 8 or 16.
    pub depth: u8,
    /// Binary logarithm of a superblock's side in texels, 4 to 6.
    pub superblock_log2: u8,
    /// Place of each axis in its group, 0 to 3; at most 16 axes.
    pub ranks: Vec<u8>,
    /// How each channel follows from axes.
    pub channels: Vec<GpuChannel>,
    /// Fractional bits of a channel's sum.
    pub shift: u32,
    /// How far magnitudes of 1 and of more are rebuilt below them, in 1/32 of a step.
    pub offsets: [u8; 2],
    /// First word of the steps of the finest plane of the words; 64 for each plane.
    pub steps: u32,
    /// First word of the index.
    pub index: u32,
    /// Bits of a length in the index.
    pub index_bits: u32,
    /// Bytes of all superblocks.
    pub stream_bytes: u32,
    /// How texels of further levels are made.
    pub average: BlockAverage,
    /// Largest jump across a border of blocks that deblocking takes away from first axes; 0 for none.
    pub deblocking: i32,
}

/// How texels of smaller mip levels are made of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BlockAverage {
    /// Whether colours are averaged as light, which the squares of sRGB values are nearly proportional to: else as they are.
    pub is_light: bool,
    /// Whether colours are weighted by the last channel, which is alpha.
    pub is_weighted: bool,
}

/// A channel: the sum of a mean and of up to four weighted axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GpuChannel {
    /// The mean and half a unit, with the sum's fractional bits.
    pub mean: i32,
    /// The first axis of its group.
    pub first_axis: u32,
    /// Weights of the group's axes; 0 for those that it does not have.
    pub weights: [i32; 4],
}

/// What the decoder does of one plane, as the shader's uniform block holds it: 28 words.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct BlockPass {
    /// Columns and rows of blocks of the whole plane.
    pub plane_blocks: [u32; 2],
    /// Column and row of the first superblock to decode.
    pub first: [u32; 2],
    /// Columns and rows of superblocks to decode.
    pub count: [u32; 2],
    /// Columns and rows of blocks to decode.
    pub held: [u32; 2],
    /// Column and row of the first sample that is held of the base.
    pub base_first: [u32; 2],
    /// Columns and rows of blocks that are held of the base.
    pub base_held: [u32; 2],
    /// Superblocks in a row of the plane.
    pub superblock_columns: u32,
    /// Number of the plane's first superblock in the index.
    pub superblock_start: u32,
    /// Blocks along a superblock's side.
    pub side: u32,
    /// Axes.
    pub axes: u32,
    /// Place of each axis in its group, two bits each.
    pub ranks: u32,
    /// 1 where finer planes build on this one, else 0.
    pub is_base: u32,
    /// 1 where means come from a base, else 0.
    pub has_base: u32,
    /// Where samples are held: first word of the first block.
    pub samples: u32,
    /// Where the notes of blocks and axes are held, [`BLOCK_NOTES`] words each.
    pub notes: u32,
    /// Where the base's samples are held.
    pub base_samples: u32,
    /// First word of the steps.
    pub steps: u32,
    /// Both reconstruction offsets, 8 bits each.
    pub offsets: u32,
    /// First word of the index.
    pub index: u32,
    /// Bits of a length in the index.
    pub index_bits: u32,
    /// Bytes of all superblocks.
    pub stream_bytes: u32,
    /// Largest jump across a border of blocks that is taken away from first axes; 0 where nothing is filtered.
    pub deblocking: i32,
}

/// What a rectangle needs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BlockPlan {
    /// What is decoded, in this order: the coarsest plane first, the rectangle's own last.
    pub passes: Vec<BlockPass>,
    /// Words of memory that the decoder needs, all 0 before the first pass.
    pub words: u64,
    /// Column and row of the rectangle in the texels of the last pass.
    pub origin: [u32; 2],
    /// Binary logarithm of the samples along a texel's side, 0 to 2: a texel is their mean.
    pub reduce_log2: u32,
}

/// Mip levels that one texture in blocks gives: its own, and two of means of its samples.
pub const BLOCK_LEVELS: u32 = 3;

/// Sizes of the planes of an image of that size: the image, the means of its 8x8 blocks, their means, to a single block.
#[must_use]
pub fn block_planes(size: SurfaceSize) -> Vec<SurfaceSize> {
    let (mut planes, mut size) = (vec![size], size);
    while size.width > SIDE || size.height > SIDE {
        size = SurfaceSize { width: size.width.div_ceil(SIDE), height: size.height.div_ceil(SIDE) };
        planes.push(size);
    }
    planes
}

/// Columns and rows of superblocks.
type Superblocks = [Range<u32>; 2];

impl BlockLayout {
    /// What a rectangle of one of the [`BLOCK_LEVELS`] levels needs; `rect.surface` is 0.
    ///
    /// # Errors
    /// [`RegionError`] where there is no such level, or the rectangle is empty or leaves it.
    pub fn plan(&self, rect: Rect) -> Result<BlockPlan, RegionError> {
        self.check(rect)?;
        let reduce_log2 = rect.level;
        let planes = block_planes(self.size);
        let texels = self.superblock_texels(reduce_log2);
        let cover = |first: u32, count: u32| first / texels..(first + count).div_ceil(texels);
        let mut superblocks = [cover(rect.x, rect.width), cover(rect.y, rect.height)];
        let origin = [rect.x - superblocks[0].start * texels, rect.y - superblocks[1].start * texels];
        let mut needed = Vec::new();
        for plane in 0..planes.len() {
            let base = planes.get(plane + 1).copied();
            let wider = base.map(|base| self.base_of(&superblocks, base));
            needed.push((plane, superblocks.clone()));
            superblocks = wider.unwrap_or(superblocks);
        }
        let (passes, words) = self.passes(&planes, &needed);
        Ok(BlockPlan { passes, words, origin, reduce_log2 })
    }

    /// Texels along a superblock's side of a level whose texels are means of so many samples.
    #[must_use]
    pub fn superblock_texels(&self, reduce_log2: u32) -> u32 {
        1 << u32::from(self.superblock_log2).saturating_sub(reduce_log2)
    }

    fn check(&self, rect: Rect) -> Result<(), RegionError> {
        if rect.surface != 0 {
            return Err(RegionError::NoSuchSurface { surface: rect.surface, surfaces: 1 });
        }
        let levels = self.size.full_levels().min(BLOCK_LEVELS);
        if rect.level >= levels {
            return Err(RegionError::NoSuchLevel { level: rect.level, levels });
        }
        let inside = |first: u32, count: u32, all: u32| {
            count > 0 && first.checked_add(count).is_some_and(|end| end <= all)
        };
        let SurfaceSize { width, height } = self.size.at_level(rect.level);
        if !inside(rect.x, rect.width, width) || !inside(rect.y, rect.height, height) {
            return Err(RegionError::Outside { width, height });
        }
        Ok(())
    }

    /// The superblocks of a base that hold the means of blocks of finer superblocks, and those a mean around them.
    fn base_of(&self, superblocks: &Superblocks, base: SurfaceSize) -> Superblocks {
        let texels = 1u32 << self.superblock_log2;
        let side = texels / SIDE;
        let cover = |range: &Range<u32>, all: u32| {
            let first = (range.start * side).saturating_sub(1);
            let last = (range.end * side + 1).min(all);
            first / texels..last.div_ceil(texels)
        };
        [cover(&superblocks[0], base.width), cover(&superblocks[1], base.height)]
    }

    /// The passes from the coarsest plane on, and the words that they need.
    fn passes(&self, planes: &[SurfaceSize], needed: &[(usize, Superblocks)]) -> (Vec<BlockPass>, u64) {
        let counts: Vec<u32> =
            planes.iter().map(|&plane| self.superblocks(plane)).map(|[c, r]| c * r).collect();
        // The first block's words stay 0: what lies beyond a border is read there.
        let mut next = u64::from(BLOCK_WORDS);
        let mut passes: Vec<BlockPass> = Vec::new();
        for (plane, superblocks) in needed.iter().rev() {
            let mut pass = self.pass(planes[*plane], superblocks);
            // The coarsest plane's superblocks come first.
            pass.superblock_start = counts[*plane + 1..].iter().sum();
            pass.is_base = u32::from(*plane > 0);
            pass.deblocking = if *plane > 0 { 0 } else { self.deblocking };
            pass.steps = self.steps + BLOCK_WORDS * *plane as u32;
            pass.samples = next as u32;
            if let Some(base) = passes.last() {
                pass.has_base = 1;
                pass.base_first = base.first.map(|first| first * base.side * SIDE);
                (pass.base_held, pass.base_samples) = (base.held, base.samples);
            }
            let blocks = u64::from(pass.held[0]) * u64::from(pass.held[1]) * u64::from(pass.axes);
            next += u64::from(BLOCK_WORDS) * blocks;
            pass.notes = next as u32;
            next += u64::from(BLOCK_NOTES) * blocks;
            passes.push(pass);
        }
        (passes, next)
    }

    /// A pass but for what depends on other planes.
    fn pass(&self, size: SurfaceSize, superblocks: &Superblocks) -> BlockPass {
        let side = (1u32 << self.superblock_log2) / SIDE;
        let plane_blocks = [size.width.div_ceil(SIDE), size.height.div_ceil(SIDE)];
        let held = |axis: usize| {
            let range = &superblocks[axis];
            (range.end * side).min(plane_blocks[axis]) - range.start * side
        };
        let ranks = self.ranks.iter().take(MAX_AXES).rev();
        BlockPass {
            plane_blocks,
            first: [superblocks[0].start, superblocks[1].start],
            count: [superblocks[0].len() as u32, superblocks[1].len() as u32],
            held: [held(0), held(1)],
            superblock_columns: self.superblocks(size)[0],
            side,
            axes: self.ranks.len().min(MAX_AXES) as u32,
            ranks: ranks.fold(0, |all, &rank| all << 2 | u32::from(rank & 3)),
            offsets: u32::from(self.offsets[0]) | u32::from(self.offsets[1]) << 8,
            index: self.index,
            index_bits: self.index_bits,
            stream_bytes: self.stream_bytes,
            ..BlockPass::default()
        }
    }

    /// Columns and rows of superblocks of a plane.
    fn superblocks(&self, size: SurfaceSize) -> [u32; 2] {
        let texels = 1u32 << self.superblock_log2;
        [size.width.div_ceil(texels), size.height.div_ceil(texels)]
    }
}
