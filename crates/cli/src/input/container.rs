//! DDS and KTX2: blocks of BC1 are taken over as they are, all else is decoded.
//!
//! Only the first image and its largest level are taken.

use std::error::Error;
use std::io::Read;
use std::path::Path;

use dds::header::{Header, ParseOptions};
use dds::{Channels, Format, ImageViewMut, Precision, Size};
use texfold_bc::{Bc1Blocks, BcTexture};
use texfold_core::image::{Alpha, ColorSpace, PixelInfo, Raster};
use texfold_core::metric::decode_image;
use texfold_core::{ImageSize, SourceError};

use super::Content;
use super::check_side;
use super::remarks::Remarks;
use crate::error::CliError;
use crate::files;
use crate::settings::Settings;

/// First bytes of a KTX2 file.
const KTX2_MAGIC: [u8; 12] = *b"\xabKTX 20\xbb\r\n\x1a\n";
/// First bytes of a DDS file.
const DDS_MAGIC: [u8; 4] = *b"DDS ";

/// A file format that holds blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Container {
    Dds,
    Ktx2,
}

impl Container {
    /// The container that a file with such first bytes is.
    pub(crate) fn of(head: &[u8]) -> Option<Container> {
        if head.starts_with(&DDS_MAGIC) {
            Some(Container::Dds)
        } else if head.starts_with(&KTX2_MAGIC) {
            Some(Container::Ktx2)
        } else {
            None
        }
    }

    fn name(self) -> &'static str {
        match self {
            Container::Dds => "DDS",
            Container::Ktx2 => "KTX2",
        }
    }

    fn wrong<E: Into<Box<dyn Error + Send + Sync>>>(self, path: &Path) -> impl FnOnce(E) -> CliError {
        move |source| CliError::Container {
            path: path.to_owned(),
            container: self.name(),
            source: source.into(),
        }
    }
}

/// Columns and rows from the header.
pub(crate) fn size(path: &Path, container: Container, head: &[u8]) -> Result<ImageSize, CliError> {
    let (width, height) = match container {
        Container::Dds => {
            let header = dds_header(path, head)?;
            (header.width(), header.height())
        }
        Container::Ktx2 => {
            let header = ktx2_header(path, head)?;
            (header.pixel_width, header.pixel_height)
        }
    };
    check_side(path, ImageSize { width, height })
}

/// The compression of a whole level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Packing {
    Plain,
    Zstd,
    Zlib,
}

/// The largest level as stored: format, alpha of BC1, bytes.
struct Level<'b> {
    format: Format,
    alpha: bool,
    bytes: &'b [u8],
    packing: Packing,
}

/// The largest level; memory for it is at most `limit_bytes`.
pub(crate) fn read(
    path: &Path,
    container: Container,
    settings: &Settings,
    limit_bytes: u64,
    remarks: &mut Remarks,
) -> Result<Content, CliError> {
    let bytes = files::read(path)?;
    let size = size(path, container, &bytes)?;
    let level = match container {
        Container::Dds => dds_level(path, &bytes)?,
        Container::Ktx2 => ktx2_level(path, &bytes)?,
    };
    let format = level.format;
    let surface = Size::new(size.width, size.height);
    let needed = dds::PixelInfo::from(format).surface_bytes(surface).unwrap_or(u64::MAX);
    let decoded = size.texels().saturating_mul(u64::from(format.color().bytes_per_pixel()));
    let held = needed.saturating_add(decoded);
    if held > limit_bytes {
        let (needed_mib, allowed_mib) = (held >> 20, limit_bytes >> 20);
        return Err(CliError::Memory { path: path.to_owned(), needed_mib, allowed_mib });
    }
    let cut = |found| CliError::CutBlocks { path: path.to_owned(), found, needed };
    let length = usize::try_from(needed).unwrap_or(usize::MAX);
    let unpacked = match level.packing {
        Packing::Zstd => zstd::bulk::decompress(level.bytes, length).map_err(container.wrong(path))?,
        Packing::Zlib => {
            let mut unpacked = Vec::new();
            let mut reader = flate2::read::ZlibDecoder::new(level.bytes).take(needed);
            reader.read_to_end(&mut unpacked).map_err(container.wrong(path))?;
            unpacked
        }
        Packing::Plain => level.bytes.get(..length).ok_or_else(|| cut(level.bytes.len()))?.to_vec(),
    };
    if unpacked.len() < length {
        return Err(cut(unpacked.len()));
    }
    if format == Format::BC1_UNORM {
        return Ok(Content::Blocks { image: Bc1Blocks { size, blocks: unpacked }, alpha: level.alpha });
    }
    let mut texels = vec![0; usize::try_from(decoded).unwrap_or(usize::MAX)];
    let view = ImageViewMut::new(&mut texels, surface, format.color());
    let view = view.ok_or(CliError::Source { path: path.to_owned(), source: SourceError::Empty })?;
    dds::decode(&mut unpacked.as_slice(), view, format, &dds::DecodeOptions::default())
        .map_err(container.wrong(path))?;
    if matches!(format, Format::BC5_UNORM | Format::BC5_SNORM) {
        fill_blue(path, &mut texels, settings.color, remarks);
    }
    raster(path, size, format, texels, settings).map(Content::Pixels)
}

/// Texels as a raster, and the alpha that was asked for.
fn raster(
    path: &Path,
    ImageSize { width, height }: ImageSize,
    format: Format,
    texels: Vec<u8>,
    settings: &Settings,
) -> Result<Raster, CliError> {
    let channels = match format.channels() {
        Channels::Grayscale | Channels::Alpha => 1,
        Channels::Rgb => 3,
        Channels::Rgba => 4,
    };
    let raster = if format.precision() == Precision::U16 {
        let values: Vec<u16> =
            texels.chunks_exact(2).map(|pair| u16::from_ne_bytes([pair[0], pair[1]])).collect();
        Raster::from_u16(width, height, channels, settings.color, &values)
    } else {
        Raster::from_u8(width, height, channels, settings.color, &texels)
    };
    let raster = raster.map_err(|source| CliError::Source { path: path.to_owned(), source })?;
    let alpha = settings.alpha.unwrap_or(raster.info().alpha);
    Ok(raster.tagged(settings.color, alpha))
}

/// BC5 has two channels: the third coordinate of a normal follows from them.
fn fill_blue(path: &Path, texels: &mut [u8], color: ColorSpace, remarks: &mut Remarks) {
    if color != ColorSpace::Normal {
        remarks.note(path, "BC5 has no blue, which is 0; `--color normal` fills it in for normals");
        return;
    }
    for texel in texels.chunks_exact_mut(3) {
        let [x, y] = [texel[0], texel[1]].map(|value| f32::from(value) / 127.5 - 1.0);
        texel[2] = ((1.0 - x * x - y * y).max(0.0).sqrt() * 127.5 + 127.5).round() as u8;
    }
}

/// The texels of the blocks.
pub(crate) fn decode(
    path: &Path,
    image: Bc1Blocks,
    alpha: bool,
    settings: &Settings,
) -> Result<Raster, CliError> {
    let fault = |source| CliError::Source { path: path.to_owned(), source };
    let size = image.size;
    let channels = if alpha { 4 } else { 3 };
    let meaning = settings.alpha.unwrap_or(Alpha::Straight);
    let pixel = PixelInfo { channels, color: settings.color, alpha: meaning, ..PixelInfo::default() };
    let texture = BcTexture::from_bc1(vec![image], pixel).map_err(fault)?;
    let decoded = decode_image(&texture, 0, 0).ok_or(fault(SourceError::Empty))?;
    let bytes = decoded.to_bytes();
    // Reading it back from bytes drops alpha that is opaque throughout.
    let raster = Raster::from_u8(size.width, size.height, channels, settings.color, &bytes).map_err(fault)?;
    Ok(raster.tagged(settings.color, meaning))
}

fn dds_header(path: &Path, bytes: &[u8]) -> Result<Header, CliError> {
    let mut rest = bytes;
    Header::read(&mut rest, &ParseOptions::new_permissive(None)).map_err(Container::Dds.wrong(path))
}

fn dds_level<'b>(path: &Path, bytes: &'b [u8]) -> Result<Level<'b>, CliError> {
    let header = dds_header(path, bytes)?;
    let format = Format::from_header(&header).map_err(Container::Dds.wrong(path))?;
    check_flat(path, header.is_cube_map(), header.is_volume(), header.array_size())?;
    check_format(path, format)?;
    let bytes = bytes.get(DDS_MAGIC.len() + header.byte_len()..).unwrap_or_default();
    Ok(Level { format, alpha: true, bytes, packing: Packing::Plain })
}

fn other(path: &Path, found: &'static str) -> CliError {
    CliError::NotFlat { path: path.to_owned(), found }
}

fn check_flat(path: &Path, is_cube: bool, is_volume: bool, layers: u32) -> Result<(), CliError> {
    match (is_cube, is_volume, layers) {
        (true, ..) => Err(other(path, "a cube map")),
        (_, true, _) => Err(other(path, "a volume")),
        (.., 2..) => Err(other(path, "an array")),
        _ => Ok(()),
    }
}

fn check_format(path: &Path, format: Format) -> Result<(), CliError> {
    match format {
        Format::BC6H_UF16 | Format::BC6H_SF16 => Err(other(path, "BC6H, whose values are above 1")),
        format if format.precision() == Precision::F32 => Err(other(path, "float samples")),
        _ => Ok(()),
    }
}

fn ktx2_header(path: &Path, bytes: &[u8]) -> Result<ktx2::Header, CliError> {
    let parsed = match bytes.first_chunk() {
        Some(head) => ktx2::Header::from_bytes(head),
        None => Err(ktx2::ParseError::UnexpectedEnd),
    };
    parsed.map_err(|error| Container::Ktx2.wrong(path)(error.to_string()))
}

/// The format under the name that DDS has for it; `None` where it is not read.
fn dds_format(format: ktx2::Format) -> Option<Format> {
    use ktx2::Format as F;
    Some(match format {
        F::BC1_RGB_UNORM_BLOCK | F::BC1_RGB_SRGB_BLOCK | F::BC1_RGBA_UNORM_BLOCK | F::BC1_RGBA_SRGB_BLOCK => {
            Format::BC1_UNORM
        }
        F::BC2_UNORM_BLOCK | F::BC2_SRGB_BLOCK => Format::BC2_UNORM,
        F::BC3_UNORM_BLOCK | F::BC3_SRGB_BLOCK => Format::BC3_UNORM,
        F::BC4_UNORM_BLOCK => Format::BC4_UNORM,
        F::BC4_SNORM_BLOCK => Format::BC4_SNORM,
        F::BC5_UNORM_BLOCK => Format::BC5_UNORM,
        F::BC5_SNORM_BLOCK => Format::BC5_SNORM,
        F::BC6H_UFLOAT_BLOCK | F::BC6H_SFLOAT_BLOCK => Format::BC6H_UF16,
        F::BC7_UNORM_BLOCK | F::BC7_SRGB_BLOCK => Format::BC7_UNORM,
        F::ASTC_4x4_UNORM_BLOCK | F::ASTC_4x4_SRGB_BLOCK => Format::ASTC_4X4_UNORM,
        F::ASTC_5x4_UNORM_BLOCK | F::ASTC_5x4_SRGB_BLOCK => Format::ASTC_5X4_UNORM,
        F::ASTC_5x5_UNORM_BLOCK | F::ASTC_5x5_SRGB_BLOCK => Format::ASTC_5X5_UNORM,
        F::ASTC_6x5_UNORM_BLOCK | F::ASTC_6x5_SRGB_BLOCK => Format::ASTC_6X5_UNORM,
        F::ASTC_6x6_UNORM_BLOCK | F::ASTC_6x6_SRGB_BLOCK => Format::ASTC_6X6_UNORM,
        F::ASTC_8x5_UNORM_BLOCK | F::ASTC_8x5_SRGB_BLOCK => Format::ASTC_8X5_UNORM,
        F::ASTC_8x6_UNORM_BLOCK | F::ASTC_8x6_SRGB_BLOCK => Format::ASTC_8X6_UNORM,
        F::ASTC_8x8_UNORM_BLOCK | F::ASTC_8x8_SRGB_BLOCK => Format::ASTC_8X8_UNORM,
        F::ASTC_10x5_UNORM_BLOCK | F::ASTC_10x5_SRGB_BLOCK => Format::ASTC_10X5_UNORM,
        F::ASTC_10x6_UNORM_BLOCK | F::ASTC_10x6_SRGB_BLOCK => Format::ASTC_10X6_UNORM,
        F::ASTC_10x8_UNORM_BLOCK | F::ASTC_10x8_SRGB_BLOCK => Format::ASTC_10X8_UNORM,
        F::ASTC_10x10_UNORM_BLOCK | F::ASTC_10x10_SRGB_BLOCK => Format::ASTC_10X10_UNORM,
        F::ASTC_12x10_UNORM_BLOCK | F::ASTC_12x10_SRGB_BLOCK => Format::ASTC_12X10_UNORM,
        F::ASTC_12x12_UNORM_BLOCK | F::ASTC_12x12_SRGB_BLOCK => Format::ASTC_12X12_UNORM,
        F::R8_UNORM | F::R8_SRGB => Format::R8_UNORM,
        F::R8G8B8_UNORM | F::R8G8B8_SRGB => Format::R8G8B8_UNORM,
        F::R8G8B8A8_UNORM | F::R8G8B8A8_SRGB => Format::R8G8B8A8_UNORM,
        F::B8G8R8A8_UNORM | F::B8G8R8A8_SRGB => Format::B8G8R8A8_UNORM,
        F::R16_UNORM => Format::R16_UNORM,
        F::R16G16B16A16_UNORM => Format::R16G16B16A16_UNORM,
        F::R16G16B16A16_SFLOAT => Format::R16G16B16A16_FLOAT,
        F::R32G32B32A32_SFLOAT => Format::R32G32B32A32_FLOAT,
        _ => return None,
    })
}

fn ktx2_level<'b>(path: &Path, bytes: &'b [u8]) -> Result<Level<'b>, CliError> {
    use ktx2::{Format as F, SupercompressionScheme as Scheme};
    let header = ktx2_header(path, bytes)?;
    let packing = match header.supercompression_scheme {
        None => Packing::Plain,
        Some(Scheme::Zstandard) => Packing::Zstd,
        Some(Scheme::ZLIB) => Packing::Zlib,
        Some(Scheme::BasisLZ) => return Err(other(path, "Basis Universal")),
        Some(_) => return Err(other(path, "levels packed by an unknown method")),
    };
    let format = header.format.ok_or_else(|| other(path, "Basis Universal"))?;
    let alpha = !matches!(format, F::BC1_RGB_UNORM_BLOCK | F::BC1_RGB_SRGB_BLOCK);
    let format = dds_format(format).ok_or_else(|| other(path, "another format of texels"))?;
    check_flat(path, header.face_count > 1, header.pixel_depth > 1, header.layer_count)?;
    check_format(path, format)?;
    // Only the place of level 0 is needed, which follows the header; the crate's reader would also ask for a data
    // format descriptor that says nothing new.
    let place = |at: usize| {
        let field = bytes.get(ktx2::Header::LENGTH + at..)?.first_chunk()?;
        usize::try_from(u64::from_le_bytes(*field)).ok()
    };
    let level =
        place(0).zip(place(8)).and_then(|(start, length)| bytes.get(start..start.checked_add(length)?));
    let cut = || {
        let size = Size::new(header.pixel_width, header.pixel_height);
        let needed = dds::PixelInfo::from(format).surface_bytes(size).unwrap_or(u64::MAX);
        CliError::CutBlocks { path: path.to_owned(), found: bytes.len(), needed }
    };
    Ok(Level { format, alpha, bytes: level.ok_or_else(cut)?, packing })
}
