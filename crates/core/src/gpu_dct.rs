//! Textures in DCT superblocks, as a compute shader decodes them: no wgpu here.
//!
//! Such a texture is a pyramid of planes, each the means of the 8x8 blocks of the finer one. A superblock of 2x2, 4x4 or 8x8
//! blocks has a stream of its own and needs the means of its blocks and of those around them.

use crate::ImageSize;

/// Texels along a block's side.
const SIDE: u32 = 8;

/// A texture in blocks of variable length.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GpuDct<'a> {
    /// What the words say, and how the image is cut.
    pub layout: DctLayout,
    /// Constants, tables of probabilities, steps, index: what a decoder works with, 16 kB and the index. They follow from
    /// `held_bytes` and need not be kept while nothing is decoded.
    pub words: Vec<u32>,
    /// Bytes of all superblocks.
    pub streams: &'a [u8],
    /// Number of the image that it belongs to.
    pub image: usize,
    /// Mip level of that image that it is.
    pub level: u32,
    /// Mip levels that are made of it, from that one on: 1 to [`DCT_LEVELS`].
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
    pub size: ImageSize,
    /// Mip levels.
    pub levels: u32,
    /// Bits of a sample, 8 or 16: decoded to four channels of 8 or of 32 bits.
    pub depth: u8,
    /// Whether its only level is put together of several textures, one below the other ([`GpuDct::row`]).
    pub is_stacked: bool,
}

impl DecodedImage {
    /// The image that `stages`, all of one image, are decoded to; `None` where there is none.
    #[must_use]
    pub fn of(stages: &[GpuDct<'_>]) -> Option<DecodedImage> {
        let DctLayout { size, depth, .. } = stages.first()?.layout;
        let last_row = stages.iter().map(|stage| stage.row.saturating_add(stage.layout.size.height)).max()?;
        let is_stacked = last_row != size.height && stages.iter().all(|stage| stage.level == 0);
        let height = if is_stacked { last_row } else { size.height };
        let levels = if is_stacked { 1 } else { stages.iter().map(|stage| stage.levels).sum() };
        Some(DecodedImage { size: ImageSize { height, ..size }, levels, depth, is_stacked })
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
pub struct DctLayout {
    /// Columns and rows of the image.
    pub size: ImageSize,
    /// Bits of a sample, 8 or 16.
    pub depth: u8,
    /// Binary logarithm of a superblock's side in texels, 4 to 6.
    pub superblock_log2: u8,
    /// The same of the planes behind the image.
    pub base_log2: u8,
    /// Place of each axis in its group, 0 to 3; at most 16 axes.
    pub ranks: Vec<u8>,
    /// How each channel follows from axes.
    pub channels: Vec<GpuChannel>,
    /// Fractional bits of a channel's sum.
    pub shift: u32,
    /// How far magnitudes of 1 and of more are rebuilt below them, in 1/32 of a step.
    pub offsets: [u8; 2],
    /// Whether quantisers are dependent; then the words have tables of the odd one, too.
    pub is_dependent: bool,
    /// Whether blocks of the image have intra modes; then the words have their tables behind all others.
    pub has_modes: bool,
    /// First word of the steps of the finest plane of the words; 64 for each plane.
    pub steps: u32,
    /// First word of the index.
    pub index: u32,
    /// Bits of a length in the index.
    pub index_bits: u32,
    /// Bytes of all superblocks.
    pub stream_bytes: u32,
    /// How texels of further levels are made.
    pub average: MipAverage,
    /// Largest jump across a border of blocks that deblocking takes away from first axes; 0 for none.
    pub deblocking: i32,
}

/// How texels of smaller mip levels are made of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MipAverage {
    /// Whether colours are averaged as light, which the squares of sRGB values are nearly proportional to: else as they are.
    pub is_light: bool,
    /// Whether colours are weighted by the last channel, which is alpha.
    pub is_weighted: bool,
}

impl MipAverage {
    /// As the shader reads it: bit 0 for light, bit 1 for weights.
    #[must_use]
    pub fn bits(self) -> u32 {
        u32::from(self.is_light) | u32::from(self.is_weighted) << 1
    }
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

/// Mip levels that one texture in blocks gives: its own, and two of means of its samples.
pub const DCT_LEVELS: u32 = 3;

/// Sizes of the planes of an image of that size: the image, the means of its 8x8 blocks, their means, to a single block.
#[must_use]
pub fn dct_planes(size: ImageSize) -> Vec<ImageSize> {
    let (mut planes, mut size) = (vec![size], size);
    while size.width > SIDE || size.height > SIDE {
        size = ImageSize { width: size.width.div_ceil(SIDE), height: size.height.div_ceil(SIDE) };
        planes.push(size);
    }
    planes
}

impl DctLayout {
    /// Places of the first 16 axes in their groups as the shader reads them: two bits each, the first axis lowest.
    #[must_use]
    pub fn packed_ranks(&self) -> u32 {
        self.ranks.iter().take(16).rev().fold(0, |all, &rank| all << 2 | u32::from(rank & 3))
    }

    /// Both reconstruction offsets as the shader reads them, 8 bits each; bit 16 where quantisers are dependent.
    #[must_use]
    pub fn packed_offsets(&self) -> u32 {
        let [one, more] = self.offsets.map(u32::from);
        one | more << 8 | u32::from(self.is_dependent) << 16 | u32::from(self.has_modes) << 17
    }

    /// Binary logarithm of a superblock's side in that plane, the image being plane 0.
    #[must_use]
    pub fn plane_log2(&self, plane: usize) -> u8 {
        if plane > 0 { self.base_log2 } else { self.superblock_log2 }
    }

    /// Texels along a superblock's side of a level whose texels are means of 2^`reduce_log2` samples a side.
    #[must_use]
    pub fn superblock_texels(&self, reduce_log2: u32) -> u32 {
        1 << u32::from(self.superblock_log2).saturating_sub(reduce_log2)
    }
}
