//! What a GPU needs to draw an encoded texture, without naming a GPU library.

use std::borrow::Cow;
use std::ops::Range;

use crate::{DecodedImage, GpuDct};

/// How the texels of a plane are stored; names as in WebGPU.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PlaneFormat {
    /// Two unsigned bytes a texel, read as integers.
    Rg8Uint,
    /// Four bytes a texel, little-endian, read as one integer.
    R32Uint,
    /// Sixteen bytes a texel, read as four little-endian integers.
    Rgba32Uint,
    /// One byte a texel, read as [0, 1].
    R8Unorm,
    /// Two bytes a texel, read as [0, 1].
    Rg8Unorm,
    /// Four bytes a texel, read as [0, 1].
    Rgba8Unorm,
    /// 4x4 blocks of 8 bytes: RGB and one bit of alpha.
    Bc1,
    /// 4x4 blocks of 16 bytes: RGB and alpha.
    Bc3,
    /// 4x4 blocks of 8 bytes: one channel.
    Bc4,
    /// 4x4 blocks of 16 bytes: two channels.
    Bc5,
    /// 4x4 blocks of 16 bytes: RGB and alpha.
    Bc7,
}

impl PlaneFormat {
    /// Its name in WebGPU: "rgba8unorm", "bc7-rgba-unorm", ...
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            PlaneFormat::Rg8Uint => "rg8uint",
            PlaneFormat::R32Uint => "r32uint",
            PlaneFormat::Rgba32Uint => "rgba32uint",
            PlaneFormat::R8Unorm => "r8unorm",
            PlaneFormat::Rg8Unorm => "rg8unorm",
            PlaneFormat::Rgba8Unorm => "rgba8unorm",
            PlaneFormat::Bc1 => "bc1-rgba-unorm",
            PlaneFormat::Bc3 => "bc3-rgba-unorm",
            PlaneFormat::Bc4 => "bc4-r-unorm",
            PlaneFormat::Bc5 => "bc5-rg-unorm",
            PlaneFormat::Bc7 => "bc7-rgba-unorm",
        }
    }

    /// Texels a side of one stored block: 4 for the BC formats, 1 for plain texels.
    #[must_use]
    pub fn block_side(self) -> u32 {
        match self {
            PlaneFormat::Rg8Uint
            | PlaneFormat::R32Uint
            | PlaneFormat::Rgba32Uint
            | PlaneFormat::R8Unorm
            | PlaneFormat::Rg8Unorm
            | PlaneFormat::Rgba8Unorm => 1,
            _ => 4,
        }
    }

    /// Bytes of one stored block.
    #[must_use]
    pub fn block_bytes(self) -> u32 {
        match self {
            PlaneFormat::R8Unorm => 1,
            PlaneFormat::Rg8Uint | PlaneFormat::Rg8Unorm => 2,
            PlaneFormat::R32Uint | PlaneFormat::Rgba8Unorm => 4,
            PlaneFormat::Bc1 | PlaneFormat::Bc4 => 8,
            PlaneFormat::Rgba32Uint | PlaneFormat::Bc3 | PlaneFormat::Bc5 | PlaneFormat::Bc7 => 16,
        }
    }

    /// Bytes of `width` x `height` texels, whole blocks.
    #[must_use]
    pub fn bytes(self, width: u32, height: u32) -> u64 {
        let blocks = |side: u32| u64::from(side.div_ceil(self.block_side()));
        blocks(width) * blocks(height) * u64::from(self.block_bytes())
    }
}

/// One texture.
#[derive(Debug, Clone)]
pub struct Plane<'a> {
    /// Which part of the footprint it belongs to.
    pub part: &'static str,
    /// Format of its texels.
    pub format: PlaneFormat,
    /// Columns of level 0 in texels.
    pub width: u32,
    /// Rows of level 0 in texels.
    pub height: u32,
    /// Mip levels in `data`.
    pub levels: u32,
    /// The levels one after the other, largest first, rows without padding.
    pub data: Cow<'a, [u8]>,
}

impl Plane<'_> {
    /// Width, height and bytes of each level, in the order of `data`.
    pub fn level_sizes(&self) -> impl Iterator<Item = (u32, u32, u64)> + '_ {
        (0..self.levels).map(|level| {
            let (width, height) = ((self.width >> level).max(1), (self.height >> level).max(1));
            (width, height, self.format.bytes(width, height))
        })
    }

    /// Bits of the texels of all levels, without the padding of blocks that hang over an edge.
    fn texel_bits(&self) -> u64 {
        let block = u64::from(self.format.block_side()).pow(2);
        let bits = |(width, height, _)| {
            u64::from(width) * u64::from(height) * u64::from(8 * self.format.block_bytes()) / block
        };
        self.level_sizes().map(bits).sum()
    }
}

/// What to bind to draw one image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ImageBinding {
    /// Numbers of textures, in the order of the shader's texture bindings: [`GpuForm::planes`], then what [`GpuForm::blocks`] decode
    /// to.
    pub planes: Vec<usize>,
    /// Bytes of [`GpuForm::uniforms`] that hold the shader's parameters for this image.
    pub uniforms: Range<usize>,
    /// The `image` argument of the shader's functions for this image.
    pub image: u32,
}

/// How the texels of a form are reached.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Access {
    /// In blocks, which a compute pass decodes into plain textures before they are drawn: fewest bits.
    #[default]
    Block,
    /// One by one, straight from the compressed form: for scattered reads.
    Texel,
}

impl Access {
    /// Its name: "block", "texel".
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Access::Block => "block",
            Access::Texel => "texel",
        }
    }
}

/// Planes and parameters of an encoded texture, and the shader module that reads them.
#[derive(Debug, Clone)]
pub struct GpuForm<'a> {
    /// Name of the WGSL module: "bc", "vq", ... Where the form is read by block: of the one that reads what is decoded.
    pub module: &'static str,
    /// All textures.
    pub planes: Vec<Plane<'a>>,
    /// Parameters of all images, each range a multiple of 16 bytes.
    pub uniforms: Vec<u8>,
    /// What to bind for each image of the layout. Numbers from that of `planes` on are the plain textures that `blocks` decode to:
    /// number of planes + [`GpuDct::image`].
    pub images: Vec<ImageBinding>,
    /// Textures in blocks, where texels are read so.
    pub blocks: Vec<GpuDct<'a>>,
}

/// Memory that a texture takes on a GPU, in bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MemoryBits {
    /// Compressed form: all planes, textures in blocks and parameters.
    pub compressed: u64,
    /// Allocation while it is drawn without a cache of tiles: planes, parameters, and in place of textures in blocks the plain texels of all mip levels that
    /// they are decoded to ([`DecodedImage`]). Without textures in blocks it equals `compressed`.
    pub resident: u64,
    /// Part of `compressed` that goals count: texels of all planes and levels, and blocks. Two things are left out, as they would
    /// make a goal of 4 bits a texel miss BC1: the padding of 4x4 blocks beyond the edge of an image, and up to [`HEADER_BYTES`] of
    /// parameters for each image.
    pub goal: u64,
}

/// Parameters of an image that goals do not count, in bytes: those of plain blocks. What a codec needs beyond them counts.
pub const HEADER_BYTES: u64 = 32;

/// Bits of `bytes` of parameters of `images` images that goals count: what exceeds [`HEADER_BYTES`] an image.
#[must_use]
pub fn parameter_bits(bytes: u64, images: u64) -> u64 {
    8 * bytes.saturating_sub(HEADER_BYTES * images)
}

impl GpuForm<'_> {
    /// A form of that module without anything.
    #[must_use]
    pub fn new(module: &'static str) -> Self {
        GpuForm { module, planes: Vec::new(), uniforms: Vec::new(), images: Vec::new(), blocks: Vec::new() }
    }

    /// How its texels are reached.
    #[must_use]
    pub fn access(&self) -> Access {
        if self.blocks.is_empty() { Access::Texel } else { Access::Block }
    }

    /// Memory of all planes, blocks and parameters.
    #[must_use]
    pub fn memory(&self) -> MemoryBits {
        let beyond = parameter_bits(self.uniforms.len() as u64, self.images.len() as u64);
        let texels: u64 =
            self.planes.iter().map(|plane| plane.texel_bits().min(8 * plane.data.len() as u64)).sum();
        let blocks = 8 * self.block_bytes().map(|(_, bytes)| bytes).sum::<u64>();
        let planes: u64 = self.planes.iter().map(|plane| plane.data.len() as u64).sum();
        let drawn = 8 * (planes + self.uniforms.len() as u64);
        let decoded: u64 = self.decoded_images().map(|image| image.bits()).sum();
        MemoryBits { compressed: drawn + blocks, resident: drawn + decoded, goal: texels + blocks + beyond }
    }

    /// Plain textures that the textures in blocks are decoded to, one for each image that has any, in the order of
    /// [`GpuDct::image`].
    pub fn decoded_images(&self) -> impl Iterator<Item = DecodedImage> + '_ {
        self.blocks.chunk_by(|one, other| one.image == other.image).filter_map(DecodedImage::of)
    }

    /// Bytes of each part of all textures in blocks.
    pub fn block_bytes(&self) -> impl Iterator<Item = (&'static str, u64)> + '_ {
        self.blocks.iter().flat_map(|blocks| blocks.held_bytes.iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goals_count_texels_and_reports_count_all() {
        let plane = |format: PlaneFormat, width, height| Plane {
            part: "blocks",
            format,
            width,
            height,
            levels: 1,
            data: Cow::Owned(vec![0; format.bytes(width, height) as usize]),
        };
        let image = ImageBinding { planes: vec![0], uniforms: 0..0, image: 0 };
        let form = |plane, headers: usize| GpuForm {
            module: "bc",
            planes: vec![plane],
            uniforms: vec![0; headers],
            images: vec![image.clone()],
            blocks: Vec::new(),
        };
        let memory = |all, goal| MemoryBits { compressed: all, resident: all, goal };
        let odd = form(plane(PlaneFormat::Bc1, 37, 61), 32).memory();
        assert_eq!(odd, memory(10 * 16 * 64 + 32 * 8, 37 * 61 * 4));
        let words = form(plane(PlaneFormat::R32Uint, 8, 8), 32 + 16).memory();
        assert_eq!(words, memory(64 * 32 + 48 * 8, 64 * 32 + 16 * 8));
    }
}
