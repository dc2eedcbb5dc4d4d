//! Decoded images as textures that engines load: KTX2 and DDS, in blocks of BC1 to BC7 or in plain texels, with mip levels.

use std::num::NonZeroU32;
use std::path::Path;

use dds::header::{Dx10Header, DxgiFormat, Header as DdsHeader};
use ktx2::dfd::{Basic, Block};
use ktx2::{Format as VkFormat, Header as Ktx2Header, Index, LevelIndex, SupercompressionScheme};
use texfold::{AnyImage, BytesError};
use texfold_bc::encode_plane;
use texfold_core::image::{Alpha, ColorSpace, Depth, PixelInfo};
use texfold_core::{Effort, PlaneFormat, Rect};

use super::astc::{self, AstcSide};
use crate::console::warn;
use crate::error::CliError;
use crate::memory::{self, MemoryArgs};

/// Rows that are decoded and encoded at a time: whole blocks of 4, 6 and 8 texels, and superblocks.
const BAND_ROWS: u32 = 192;
/// Texels of such a band, about; at least [`BAND_ROWS`] rows.
const BAND_TEXELS: u32 = 1 << 20;
/// Bytes that each of these texels takes: as decoded, as bytes, padded.
const BAND_BYTES_PER_TEXEL: u64 = 28;
/// Effort of Zstandard.
const ZSTD_LEVEL: i32 = 12;
/// Name of the writer, as KTX2 files have it.
const WRITER: &[u8] = concat!("KTXwriter\0Texfold ", env!("CARGO_PKG_VERSION"), "\0").as_bytes();

/// Formats of files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub(crate) enum Container {
    /// Khronos texture, version 2.
    #[default]
    Ktx2,
    /// DirectDraw surface with a DX10 header.
    Dds,
}

impl Container {
    /// The extension of its files.
    pub(super) fn extension(self) -> &'static str {
        match self {
            Container::Ktx2 => "ktx2",
            Container::Dds => "dds",
        }
    }
}

/// Storage of texels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Texels {
    /// Blocks or plain texels of 8 bits a channel.
    Plane(PlaneFormat),
    /// Plain texels of 16 bits a channel.
    Rgba16,
    /// Blocks of 16 bytes of so many texels a side.
    Astc(AstcSide),
}

impl Texels {
    /// Bytes of an image.
    fn bytes(self, (width, height): (u32, u32)) -> u64 {
        let (side, bytes) = match self {
            Texels::Plane(format) => (format.block_side(), format.block_bytes()),
            Texels::Rgba16 => (1, 8),
            Texels::Astc(side) => (side.texels(), 16),
        };
        u64::from(width.div_ceil(side)) * u64::from(height.div_ceil(side)) * u64::from(bytes)
    }
}

/// Formats of a texture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Formats {
    pub(crate) texels: Texels,
    pub(crate) container: Container,
    /// Whether levels are compressed with Zstandard.
    pub(crate) zstd: bool,
}

/// The format of texels in the words of Vulkan and, where it has one, of DXGI; `None` for what no engine loads.
fn names(texels: Texels, is_srgb: bool) -> Option<(VkFormat, Option<DxgiFormat>)> {
    let texels = match texels {
        Texels::Plane(format) => format,
        // 16 bits have no sRGB form.
        Texels::Rgba16 => return Some((VkFormat::R16G16B16A16_UNORM, Some(DxgiFormat::R16G16B16A16_UNORM))),
        Texels::Astc(side) => return Some((side.format(is_srgb), None)),
    };
    let [linear, srgb] = match texels {
        PlaneFormat::Bc1 => [
            (VkFormat::BC1_RGB_UNORM_BLOCK, DxgiFormat::BC1_UNORM),
            (VkFormat::BC1_RGB_SRGB_BLOCK, DxgiFormat::BC1_UNORM_SRGB),
        ],
        PlaneFormat::Bc3 => [
            (VkFormat::BC3_UNORM_BLOCK, DxgiFormat::BC3_UNORM),
            (VkFormat::BC3_SRGB_BLOCK, DxgiFormat::BC3_UNORM_SRGB),
        ],
        // These have no sRGB form.
        PlaneFormat::Bc4 => [(VkFormat::BC4_UNORM_BLOCK, DxgiFormat::BC4_UNORM); 2],
        PlaneFormat::Bc5 => [(VkFormat::BC5_UNORM_BLOCK, DxgiFormat::BC5_UNORM); 2],
        PlaneFormat::Bc7 => [
            (VkFormat::BC7_UNORM_BLOCK, DxgiFormat::BC7_UNORM),
            (VkFormat::BC7_SRGB_BLOCK, DxgiFormat::BC7_UNORM_SRGB),
        ],
        PlaneFormat::Rgba8Unorm => [
            (VkFormat::R8G8B8A8_UNORM, DxgiFormat::R8G8B8A8_UNORM),
            (VkFormat::R8G8B8A8_SRGB, DxgiFormat::R8G8B8A8_UNORM_SRGB),
        ],
        _ => return None,
    };
    let (vulkan, dxgi) = if is_srgb { srgb } else { linear };
    Some((vulkan, Some(dxgi)))
}

/// Whether the channel beside the colours is left out.
fn lacks_extra(texels: Texels, pixel: PixelInfo) -> bool {
    let is_held = match texels {
        Texels::Plane(PlaneFormat::Bc1 | PlaneFormat::Bc4) => false,
        Texels::Plane(PlaneFormat::Bc5) => pixel.channels == 2,
        _ => true,
    };
    pixel.has_extra() && !is_held
}

/// Warns of what is lost of an image of such pixels.
///
/// # Errors
/// [`CliError::Channels`] where colours would be lost.
fn check_loss(path: &Path, texels: Texels, pixel: PixelInfo) -> Result<(), CliError> {
    let held = match texels {
        Texels::Plane(PlaneFormat::Bc4) => 1,
        // Of unit normals z follows from x and y.
        Texels::Plane(PlaneFormat::Bc5) if pixel.color != ColorSpace::Normal => 2,
        _ => 3,
    };
    if pixel.color_channels() > held {
        return Err(CliError::Channels { path: path.to_owned(), found: pixel.channels, held });
    }
    let say = |what: &str| warn(&format!("{}: {what}", path.display()));
    if lacks_extra(texels, pixel) {
        let what = if pixel.alpha == Alpha::Band { "the band beside the colours" } else { "alpha" };
        say(&format!("{what} is left out; bc3, bc7, astc and rgba8 hold it, and bc5 that of gray images"));
    }
    if pixel.depth == Depth::Sixteen && texels != Texels::Rgba16 {
        say("values are rounded to 8 bits; rgba16 holds them");
    }
    Ok(())
}

/// The file of a rectangle of a level and, where the whole level is wanted, of all levels that follow it and are stored.
pub(super) fn file(
    path: &Path,
    image: &AnyImage,
    rect: Rect,
    Formats { texels, container, zstd }: Formats,
    memory: &MemoryArgs,
    report: &dyn Fn(f32),
) -> Result<Vec<u8>, CliError> {
    let layout = image.as_encoded().layout();
    let pixel = layout.pixel_of(rect.image);
    check_loss(path, texels, pixel)?;
    let fault = |what: String| CliError::Texture { path: path.to_owned(), what };
    let formats = names(texels, pixel.color == ColorSpace::Srgb);
    let (vulkan, dxgi) = formats.ok_or_else(|| fault("not a format of textures".to_owned()))?;
    let levels = layout.levels.min(layout.images[rect.image as usize].full_levels());
    let mut levels: Vec<Rect> = (rect.level..levels.max(rect.level + 1))
        .filter_map(|level| layout.whole(rect.image, level))
        .collect();
    if levels.first() != Some(&rect) {
        levels = vec![rect];
    }
    // Levels, and the file of them.
    let stored: u64 = levels.iter().map(|level| 2 * texels.bytes((level.width, level.height))).sum();
    let band = u64::from(rect.width) * u64::from(band_rows(rect).min(rect.height)) * BAND_BYTES_PER_TEXEL;
    memory::check(path, stored + band, memory.bytes())?;
    let all: u64 = levels.iter().map(|level| u64::from(level.width) * u64::from(level.height)).sum();
    let mut done = 0;
    let mut data = Vec::new();
    for level in levels {
        let mut blocks = Vec::new();
        for band in bands(level) {
            blocks.extend(encoded(path, image, band, (texels, pixel))?);
            done += u64::from(band.width) * u64::from(band.height);
            report(done as f32 / all.max(1) as f32);
        }
        data.push(blocks);
    }
    let is_cut = !rect.width.is_multiple_of(4) || !rect.height.is_multiple_of(4);
    let is_plain = matches!(texels, Texels::Rgba16 | Texels::Plane(PlaneFormat::Rgba8Unorm));
    if container == Container::Dds && is_cut && !is_plain {
        warn(&format!("{}: sides are no multiples of 4, which Direct3D asks of blocks", path.display()));
    }
    let written = match container {
        Container::Ktx2 => ktx2((rect.width, rect.height), vulkan, &data, zstd),
        Container::Dds => match dxgi {
            Some(dxgi) => dds((rect.width, rect.height), dxgi, &data),
            None => Err("DDS has no such blocks; give --container ktx2".to_owned()),
        },
    };
    written.map_err(fault)
}

/// Rows of the bands of a level.
fn band_rows(level: Rect) -> u32 {
    (BAND_TEXELS / level.width.max(1) / BAND_ROWS).max(1) * BAND_ROWS
}

/// A level in bands of whole rows of blocks.
fn bands(level: Rect) -> impl Iterator<Item = Rect> {
    let rows = band_rows(level);
    let band = move |top: u32| Rect { y: level.y + top, height: rows.min(level.height - top), ..level };
    (0..level.height).step_by(rows as usize).map(band)
}

/// A band of a level in its format.
fn encoded(
    path: &Path,
    image: &AnyImage,
    band: Rect,
    (texels, pixel): (Texels, PixelInfo),
) -> Result<Vec<u8>, CliError> {
    let (width, height) = (band.width as usize, band.height as usize);
    let failed = |source: BytesError| match source {
        BytesError::Region(source) => CliError::Region { path: path.to_owned(), source },
        other => CliError::Texture { path: path.to_owned(), what: other.to_string() },
    };
    if texels == Texels::Rgba16 {
        let mut rgba = vec![0u16; 4 * width * height];
        image.decode_rgba16(band, &mut rgba, 4 * width).map_err(failed)?;
        return Ok(rgba.into_iter().flat_map(u16::to_le_bytes).collect());
    }
    let mut rgba = vec![0; 4 * width * height];
    image.decode_rgba8(band, &mut rgba, 4 * width).map_err(failed)?;
    let (pixels, _) = rgba.as_chunks_mut::<4>();
    if texels == Texels::Plane(PlaneFormat::Bc5) && pixel.channels == 2 {
        pixels.iter_mut().for_each(|texel| texel[1] = texel[3]);
    }
    if lacks_extra(texels, pixel) {
        // BC1 would make what is clear black.
        pixels.iter_mut().for_each(|texel| texel[3] = u8::MAX);
    }
    match texels {
        Texels::Astc(side) => {
            let is_srgb = pixel.color == ColorSpace::Srgb;
            let fault = |what| CliError::Texture { path: path.to_owned(), what };
            astc::encode(side, (band.width, band.height), &mut rgba, is_srgb).map_err(fault)
        }
        Texels::Plane(format) => Ok(encode_plane(format, band.width, band.height, &rgba, Effort::Normal)),
        Texels::Rgba16 => Ok(rgba),
    }
}

/// A KTX2 file (KTX File Format Specification 2.0, section 3): levels lie from the smallest to the largest.
fn ktx2(
    (width, height): (u32, u32),
    format: VkFormat,
    levels: &[Vec<u8>],
    zstd: bool,
) -> Result<Vec<u8>, String> {
    let (basic, type_size) = Basic::from_format(format).map_err(|error| format!("{error:?}"))?;
    // The least common multiple of 4 and a block's bytes, a power of 2 in all formats here; 1 where levels are compressed.
    let alignment = if zstd { 1 } else { usize::from(basic.bytes_planes[0].max(1)).next_multiple_of(4) };
    let block = Block::Basic(basic).to_vec();
    let descriptor = [&(block.len() as u32 + 4).to_le_bytes()[..], &block].concat();
    let mut values = [&(WRITER.len() as u32).to_le_bytes()[..], WRITER].concat();
    values.resize(values.len().next_multiple_of(4), 0);
    let first = Ktx2Header::LENGTH + levels.len() * LevelIndex::LENGTH;
    let header = Ktx2Header {
        format: Some(format),
        type_size,
        pixel_width: width,
        pixel_height: height,
        pixel_depth: 0,
        layer_count: 0,
        face_count: 1,
        level_count: levels.len() as u32,
        supercompression_scheme: zstd.then_some(SupercompressionScheme::Zstandard),
        index: Index {
            dfd_byte_offset: first as u32,
            dfd_byte_length: descriptor.len() as u32,
            kvd_byte_offset: (first + descriptor.len()) as u32,
            kvd_byte_length: values.len() as u32,
            sgd_byte_offset: 0,
            sgd_byte_length: 0,
        },
    };
    let mut file = header.as_bytes().to_vec();
    file.resize(first, 0);
    file.extend(descriptor);
    file.extend(values);
    for (number, level) in levels.iter().enumerate().rev() {
        file.resize(file.len().next_multiple_of(alignment), 0);
        let packed = zstd.then(|| zstd::bulk::compress(level, ZSTD_LEVEL)).transpose();
        let packed = packed.map_err(|error| error.to_string())?;
        let stored = packed.as_ref().unwrap_or(level);
        let index = LevelIndex {
            byte_offset: file.len() as u64,
            byte_length: stored.len() as u64,
            uncompressed_byte_length: level.len() as u64,
        };
        let at = Ktx2Header::LENGTH + number * LevelIndex::LENGTH;
        file[at..at + LevelIndex::LENGTH].copy_from_slice(&index.as_bytes());
        file.extend(stored);
    }
    Ok(file)
}

/// A DDS file: levels lie from the largest to the smallest.
fn dds((width, height): (u32, u32), format: DxgiFormat, levels: &[Vec<u8>]) -> Result<Vec<u8>, String> {
    let count = u32::try_from(levels.len()).ok().and_then(NonZeroU32::new).ok_or("no level")?;
    let header = Dx10Header::new_image(width, height, format).with_mipmap_count(count);
    let mut file = Vec::new();
    DdsHeader::from(header).write(&mut file).map_err(|error| error.to_string())?;
    levels.iter().for_each(|level| file.extend(level));
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_a_level_in_whole_blocks() {
        for (width, height) in [(1, 1), (300, 20_000), (4096, 4095), (1 << 24, 500)] {
            let level = Rect { image: 0, level: 1, x: 3, y: 5, width, height };
            let bands: Vec<Rect> = bands(level).collect();
            assert_eq!(bands.iter().map(|band| band.height).sum::<u32>(), height);
            let mut next = level.y;
            for band in &bands {
                assert_eq!(*band, Rect { y: next, height: band.height, ..level });
                next += band.height;
            }
            let (_, before) = bands.split_last().unwrap();
            assert!(before.iter().all(|band| [4, 6, 8].iter().all(|side| band.height.is_multiple_of(*side))));
        }
        assert!(bands(Rect { image: 0, level: 0, x: 0, y: 0, width: 4096, height: 4096 }).count() > 10);
    }
}
