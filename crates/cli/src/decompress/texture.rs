//! Decoded images as textures that engines load: KTX2 and DDS, in blocks of BC1 to BC7 or in plain texels, with mip levels.

use std::num::NonZeroU32;
use std::path::Path;

use dds::header::{Dx10Header, DxgiFormat, Header as DdsHeader};
use ktx2::dfd::{Basic, Block};
use ktx2::{Format as VkFormat, Header as Ktx2Header, Index, LevelIndex};
use texfold::AnyImage;
use texfold_bc::encode_plane;
use texfold_core::image::{Alpha, ColorSpace, Depth, PixelInfo};
use texfold_core::{Effort, PlaneFormat, Rect};

use crate::console::warn;
use crate::error::CliError;
use crate::memory::{self, MemoryArgs};

/// Bytes that a texel of a level takes while it is encoded: RGBA, padded RGBA, blocks, and the file.
const BYTES_PER_TEXEL: u64 = 12;
/// What wrote the file, as KTX2 files name it.
const WRITER: &[u8] = concat!("KTXwriter\0Texfold ", env!("CARGO_PKG_VERSION"), "\0").as_bytes();

/// Formats of texels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Texels {
    Bc1,
    Bc3,
    Bc4,
    Bc5,
    Bc7,
    Rgba8,
}

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

impl Texels {
    fn plane(self) -> PlaneFormat {
        match self {
            Texels::Bc1 => PlaneFormat::Bc1,
            Texels::Bc3 => PlaneFormat::Bc3,
            Texels::Bc4 => PlaneFormat::Bc4,
            Texels::Bc5 => PlaneFormat::Bc5,
            Texels::Bc7 => PlaneFormat::Bc7,
            Texels::Rgba8 => PlaneFormat::Rgba8Unorm,
        }
    }

    fn vulkan(self, is_srgb: bool) -> VkFormat {
        match (self, is_srgb) {
            (Texels::Bc1, true) => VkFormat::BC1_RGB_SRGB_BLOCK,
            (Texels::Bc1, false) => VkFormat::BC1_RGB_UNORM_BLOCK,
            (Texels::Bc3, true) => VkFormat::BC3_SRGB_BLOCK,
            (Texels::Bc3, false) => VkFormat::BC3_UNORM_BLOCK,
            (Texels::Bc4, _) => VkFormat::BC4_UNORM_BLOCK,
            (Texels::Bc5, _) => VkFormat::BC5_UNORM_BLOCK,
            (Texels::Bc7, true) => VkFormat::BC7_SRGB_BLOCK,
            (Texels::Bc7, false) => VkFormat::BC7_UNORM_BLOCK,
            (Texels::Rgba8, true) => VkFormat::R8G8B8A8_SRGB,
            (Texels::Rgba8, false) => VkFormat::R8G8B8A8_UNORM,
        }
    }

    fn dxgi(self, is_srgb: bool) -> DxgiFormat {
        match (self, is_srgb) {
            (Texels::Bc1, true) => DxgiFormat::BC1_UNORM_SRGB,
            (Texels::Bc1, false) => DxgiFormat::BC1_UNORM,
            (Texels::Bc3, true) => DxgiFormat::BC3_UNORM_SRGB,
            (Texels::Bc3, false) => DxgiFormat::BC3_UNORM,
            (Texels::Bc4, _) => DxgiFormat::BC4_UNORM,
            (Texels::Bc5, _) => DxgiFormat::BC5_UNORM,
            (Texels::Bc7, true) => DxgiFormat::BC7_UNORM_SRGB,
            (Texels::Bc7, false) => DxgiFormat::BC7_UNORM,
            (Texels::Rgba8, true) => DxgiFormat::R8G8B8A8_UNORM_SRGB,
            (Texels::Rgba8, false) => DxgiFormat::R8G8B8A8_UNORM,
        }
    }

    /// What is lost of an image of such pixels, as a sentence; nothing where all is kept.
    ///
    /// # Errors
    /// [`CliError::Channels`] where colours would be lost.
    fn loss(self, path: &Path, pixel: PixelInfo) -> Result<Option<&'static str>, CliError> {
        let is_normal = pixel.color == ColorSpace::Normal;
        let held = match self {
            Texels::Bc4 => 1,
            Texels::Bc5 => 2,
            Texels::Bc1 => 3,
            _ => 4,
        };
        if pixel.color_channels() > held && !(is_normal && self == Texels::Bc5) {
            return Err(CliError::Channels { path: path.to_owned(), found: pixel.channels, held });
        }
        let alpha = pixel.has_extra() && matches!(self, Texels::Bc1 | Texels::Bc4);
        Ok(match (alpha, pixel.depth) {
            (true, _) if pixel.alpha == Alpha::Band => Some("the band beside the colours is left out"),
            (true, _) => Some("alpha is left out; bc3 and bc7 hold it, bc5 that of gray images"),
            (false, Depth::Sixteen) => Some("values are rounded to 8 bits"),
            _ => None,
        })
    }
}

/// The file of a rectangle of a level and, where the whole level is wanted, of all levels that follow it and are stored.
pub(super) fn file(
    path: &Path,
    image: &AnyImage,
    rect: Rect,
    (texels, container): (Texels, Container),
    memory: &MemoryArgs,
) -> Result<Vec<u8>, CliError> {
    let layout = image.as_encoded().layout();
    let pixel = layout.pixel_of(rect.image);
    if let Some(loss) = texels.loss(path, pixel)? {
        warn(&format!("{}: {loss}", path.display()));
    }
    memory::check(path, u64::from(rect.width) * u64::from(rect.height) * BYTES_PER_TEXEL, memory.bytes())?;
    let levels = layout.levels.min(layout.images[rect.image as usize].full_levels());
    let mut levels: Vec<Rect> = (rect.level..levels.max(rect.level + 1))
        .filter_map(|level| layout.whole(rect.image, level))
        .collect();
    if levels.first() != Some(&rect) {
        levels = vec![rect];
    }
    let encode = |level: &Rect| encoded(path, image, *level, (texels, pixel));
    let data = levels.iter().map(encode).collect::<Result<Vec<_>, _>>()?;
    let is_srgb = pixel.color == ColorSpace::Srgb;
    let is_cut = !rect.width.is_multiple_of(4) || !rect.height.is_multiple_of(4);
    if container == Container::Dds && is_cut && texels != Texels::Rgba8 {
        warn(&format!("{}: sides are no multiples of 4, which Direct3D asks of blocks", path.display()));
    }
    let written = match container {
        Container::Ktx2 => ktx2((rect.width, rect.height), texels.vulkan(is_srgb), &data),
        Container::Dds => dds((rect.width, rect.height), texels.dxgi(is_srgb), &data),
    };
    written.map_err(|what| CliError::Texture { path: path.to_owned(), what })
}

/// A level in its format.
fn encoded(
    path: &Path,
    image: &AnyImage,
    level: Rect,
    (texels, pixel): (Texels, PixelInfo),
) -> Result<Vec<u8>, CliError> {
    let (width, height) = (level.width as usize, level.height as usize);
    let mut rgba = vec![[0; 4]; width * height];
    let decoded = image.as_encoded().decode_rgba8(level, &mut rgba);
    decoded.map_err(|source| CliError::Region { path: path.to_owned(), source })?;
    if texels == Texels::Bc5 && pixel.channels == 2 {
        rgba.iter_mut().for_each(|texel| texel[1] = texel[3]);
    }
    Ok(encode_plane(texels.plane(), level.width, level.height, rgba.as_flattened(), Effort::Normal))
}

/// A KTX2 file (KTX File Format Specification 2.0, section 3): levels lie from the smallest to the largest.
fn ktx2((width, height): (u32, u32), format: VkFormat, levels: &[Vec<u8>]) -> Result<Vec<u8>, String> {
    let (basic, type_size) = Basic::from_format(format).map_err(|error| format!("{error:?}"))?;
    let alignment = usize::from(basic.bytes_planes[0].max(1)).next_multiple_of(4);
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
        supercompression_scheme: None,
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
        let bytes = level.len() as u64;
        let index = LevelIndex {
            byte_offset: file.len() as u64,
            byte_length: bytes,
            uncompressed_byte_length: bytes,
        };
        let at = Ktx2Header::LENGTH + number * LevelIndex::LENGTH;
        file[at..at + LevelIndex::LENGTH].copy_from_slice(&index.as_bytes());
        file.extend(level);
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
