//! BC1 in DDS and KTX2: blocks that are taken over as they are.
//!
//! Only the first image and its largest level are taken. *Not done*: other BC formats (nothing is gained by
//! decoding them first; convert the original instead), supercompressed KTX2.

use std::error::Error;
use std::path::Path;

use dds::header::{Header, ParseOptions};
use texfold_bc::{Bc1Blocks, BcTexture};
use texfold_core::image::{Alpha, PixelInfo, Raster};
use texfold_core::metric::decode_image;
use texfold_core::{ImageSize, PlaneFormat, SourceError};

use super::Content;
use super::check_side;
use crate::error::CliError;
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

/// The blocks of the largest level.
pub(crate) fn read(path: &Path, container: Container) -> Result<Content, CliError> {
    let bytes = std::fs::read(path).map_err(|source| CliError::Read { path: path.to_owned(), source })?;
    let size = size(path, container, &bytes)?;
    let (blocks, alpha) = match container {
        Container::Dds => (dds_blocks(path, &bytes)?, true),
        Container::Ktx2 => ktx2_blocks(path, &bytes)?,
    };
    let needed = PlaneFormat::Bc1.bytes(size.width, size.height);
    let whole = usize::try_from(needed).ok().and_then(|needed| blocks.get(..needed));
    let blocks =
        whole.ok_or(CliError::CutBlocks { path: path.to_owned(), found: blocks.len(), needed })?.to_vec();
    Ok(Content::Blocks { image: Bc1Blocks { size, blocks }, alpha })
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

fn dds_blocks<'b>(path: &Path, bytes: &'b [u8]) -> Result<&'b [u8], CliError> {
    let header = dds_header(path, bytes)?;
    let other = |found: String| CliError::NotBc1 { path: path.to_owned(), found };
    let format = dds::Format::from_header(&header).map_err(Container::Dds.wrong(path))?;
    if format != dds::Format::BC1_UNORM {
        Err(other(format!("{format:?}")))
    } else if header.is_cube_map() {
        Err(other("a cube map".to_owned()))
    } else if header.is_volume() {
        Err(other("a volume".to_owned()))
    } else if header.array_size() > 1 {
        Err(other("an array".to_owned()))
    } else {
        Ok(bytes.get(DDS_MAGIC.len() + header.byte_len()..).unwrap_or_default())
    }
}

fn ktx2_header(path: &Path, bytes: &[u8]) -> Result<ktx2::Header, CliError> {
    let parsed = match bytes.first_chunk() {
        Some(head) => ktx2::Header::from_bytes(head),
        None => Err(ktx2::ParseError::UnexpectedEnd),
    };
    parsed.map_err(|error| Container::Ktx2.wrong(path)(error.to_string()))
}

fn ktx2_blocks<'b>(path: &Path, bytes: &'b [u8]) -> Result<(&'b [u8], bool), CliError> {
    use ktx2::Format as F;
    let header = ktx2_header(path, bytes)?;
    let other = |found: &str| Err(CliError::NotBc1 { path: path.to_owned(), found: found.to_owned() });
    let alpha = match header.format {
        Some(F::BC1_RGB_UNORM_BLOCK | F::BC1_RGB_SRGB_BLOCK) => false,
        Some(F::BC1_RGBA_UNORM_BLOCK | F::BC1_RGBA_SRGB_BLOCK) => true,
        Some(format) => return other(&format!("{format:?}")),
        None => return other("a universal format"),
    };
    if header.supercompression_scheme.is_some() {
        return other("supercompressed levels");
    } else if header.face_count > 1 {
        return other("a cube map");
    } else if header.pixel_depth > 1 {
        return other("a volume");
    } else if header.layer_count > 1 {
        return other("an array");
    }
    // Only the place of level 0 is needed, which follows the header; the crate's reader would also ask for a data
    // format descriptor that says nothing new.
    let place = |at: usize| {
        let field = bytes.get(ktx2::Header::LENGTH + at..)?.first_chunk()?;
        usize::try_from(u64::from_le_bytes(*field)).ok()
    };
    let level =
        place(0).zip(place(8)).and_then(|(start, length)| bytes.get(start..start.checked_add(length)?));
    let cut = || CliError::CutBlocks {
        path: path.to_owned(),
        found: bytes.len(),
        needed: PlaneFormat::Bc1.bytes(header.pixel_width, header.pixel_height),
    };
    Ok((level.ok_or_else(cut)?, alpha))
}
