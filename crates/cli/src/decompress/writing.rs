//! Options shared by `decompress` and `bank extract`: the texels to decode, and the output.

use std::path::{Path, PathBuf};

use texfold_core::image::PixelInfo;
use texfold_core::metric::BAND_ROWS;
use texfold_core::{ImageSize, PlaneFormat, Rect, RegionError};

use super::astc::AstcSide;
use super::picture::{Format, Picture};
use super::texture::{Container, Formats, Texels};
use crate::error::{CliError, UsageError};
use crate::input::samples::Bands;
use crate::memory::{self, MemoryArgs};

/// Texels that are decoded at a time.
const BAND_TEXELS: u64 = 1 << 22;
/// Bytes that each of these texels takes: as decoded, in a raster, and in samples.
const BAND_BYTES_PER_TEXEL: u64 = 48;

/// A rectangle in bands of whole rows, of about [`BAND_TEXELS`].
pub(super) fn bands(rect: Rect) -> impl Iterator<Item = Rect> {
    let rows = (BAND_TEXELS / u64::from(rect.width.max(1))).max(1) as u32;
    let rows = if rows > BAND_ROWS { rows / BAND_ROWS * BAND_ROWS } else { rows };
    let band = move |top: u32| Rect { y: rect.y + top, height: rows.min(rect.height - top), ..rect };
    (0..rect.height).step_by(rows as usize).map(band)
}

/// Formats of output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub(crate) enum To {
    /// 8 or 16 bits a channel, as the texture has.
    #[default]
    Png,
    /// 8 or 16 bits a channel, as the texture has, and its georeference; not compressed.
    Tiff,
    /// Cloud-optimised GeoTIFF: as tiff, in tiles of 512x512 compressed by Deflate, with overviews.
    Cog,
    /// 8 bits a channel, lossless.
    Webp,
    /// OpenEXR: RGB in 32-bit floats and linear light, colours times alpha.
    Exr,
    /// A texture of RGB at 4 bits a texel, with the mip levels that are stored; so are all that follow.
    Bc1,
    /// RGB and alpha at 8 bits a texel.
    Bc3,
    /// One channel at 4 bits a texel.
    Bc4,
    /// Two channels at 8 bits a texel: gray and alpha, or x and y of normals.
    Bc5,
    /// RGB and alpha at 8 bits a texel, closest to the decoded image.
    Bc7,
    /// RGB and alpha at 8 bits a texel, for phones.
    #[value(name = "astc4x4")]
    Astc4x4,
    /// The same at 3.6 bits.
    #[value(name = "astc6x6")]
    Astc6x6,
    /// The same at 2 bits.
    #[value(name = "astc8x8")]
    Astc8x8,
    /// Plain texels.
    Rgba8,
    /// Plain texels of 16 bits a channel.
    Rgba16,
}

impl To {
    /// The format of an image file; of what is written as a texture the default.
    fn picture(self) -> Format {
        match self {
            To::Tiff => Format::Tiff,
            To::Cog => Format::Cog,
            To::Webp => Format::Webp,
            To::Exr => Format::Exr,
            _ => Format::Png,
        }
    }

    /// The format of texels of a texture.
    fn texels(self) -> Option<Texels> {
        let plane = match self {
            To::Png | To::Tiff | To::Cog | To::Webp | To::Exr => return None,
            To::Astc4x4 => return Some(Texels::Astc(AstcSide::Four)),
            To::Astc6x6 => return Some(Texels::Astc(AstcSide::Six)),
            To::Astc8x8 => return Some(Texels::Astc(AstcSide::Eight)),
            To::Rgba16 => return Some(Texels::Rgba16),
            To::Bc1 => PlaneFormat::Bc1,
            To::Bc3 => PlaneFormat::Bc3,
            To::Bc4 => PlaneFormat::Bc4,
            To::Bc5 => PlaneFormat::Bc5,
            To::Bc7 => PlaneFormat::Bc7,
            To::Rgba8 => PlaneFormat::Rgba8Unorm,
        };
        Some(Texels::Plane(plane))
    }
}

/// Options that say what is decoded and written.
#[derive(Debug, clap::Args)]
pub(crate) struct Writing {
    /// Folder that the images are written to.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Format of the images: files of pictures, or textures that engines load.
    #[arg(long, value_enum, default_value_t)]
    to: To,
    /// File format of textures; ktx2 by default.
    #[arg(long, value_enum)]
    container: Option<Container>,
    /// Compress the levels of KTX2 files with Zstandard.
    #[arg(long)]
    zstd: bool,
    /// Overwrite files that are there.
    #[arg(long)]
    force: bool,
    /// Mip level: 0 is the full size.
    #[arg(long, visible_alias = "level", value_name = "N", default_value_t = 0)]
    pub(crate) lod: u32,
    /// Only the rectangle with this upper left corner and size, in texels of the level. It is part of the file's name.
    #[arg(long, value_name = "X,Y,W,H", value_parser = rectangle)]
    pub(crate) region: Option<[u32; 4]>,
    /// Load only this many layers of each file.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) layers: Option<u32>,
    /// Decode on the GPU, as a shader does.
    #[arg(long)]
    pub(crate) gpu: bool,
    #[command(flatten)]
    pub(crate) memory: MemoryArgs,
}

fn rectangle(text: &str) -> Result<[u32; 4], String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let found = numbers.and_then(|numbers| numbers.try_into().ok());
    found
        .filter(|&[.., width, height]: &[u32; 4]| width > 0 && height > 0)
        .ok_or_else(|| "give left, top, width and height as in 64,0,256,128".to_owned())
}

impl Writing {
    /// The rectangle to decode of an image whose level has that size.
    pub(crate) fn rect(
        &self,
        image: u32,
        ImageSize { width, height }: ImageSize,
    ) -> Result<Rect, RegionError> {
        let [x, y, across, down] = self.region.unwrap_or([0, 0, width, height]);
        if u64::from(x) + u64::from(across) > u64::from(width)
            || u64::from(y) + u64::from(down) > u64::from(height)
        {
            return Err(RegionError::Outside { width, height });
        }
        Ok(Rect { image, level: self.lod, x, y, width: across, height: down })
    }

    /// An image without texels, for the file at `path`; with `bands` it has all of them.
    ///
    /// # Errors
    /// [`CliError::Memory`] where the image, its file and the texels that are decoded at a time do not fit into the limit.
    pub(crate) fn picture(
        &self,
        path: &Path,
        size: ImageSize,
        info: PixelInfo,
        bands: Option<Bands>,
    ) -> Result<Picture, CliError> {
        let band = size.texels().min(BAND_TEXELS) * BAND_BYTES_PER_TEXEL;
        let format = self.to.picture();
        let needed = Picture::bytes(format, size, info, bands) + band;
        memory::check(path, needed, self.memory.bytes())?;
        Ok(Picture::new(format, size, info, bands))
    }

    /// The ending of file names: the rectangle, if one is given, and the extension.
    pub(crate) fn ending(&self) -> String {
        let region = self.region.map(|[x, y, width, height]| format!("-{x}-{y}-{width}x{height}"));
        let picture = || self.to.picture().extension();
        let extension = self.texture().map_or_else(picture, |formats| formats.container.extension());
        format!("{}.{extension}", region.unwrap_or_default())
    }

    /// Formats of texels and of the file, where a texture is wanted.
    pub(crate) fn texture(&self) -> Option<Formats> {
        let formats =
            |texels| Formats { texels, container: self.container.unwrap_or_default(), zstd: self.zstd };
        self.to.texels().map(formats)
    }

    /// Refuses options that what is written does not have.
    pub(crate) fn check_options(&self) -> Result<(), UsageError> {
        match self.texture() {
            None if self.container.is_some() || self.zstd => Err(UsageError::Container),
            Some(_) if self.gpu => Err(UsageError::Excluded { option: "gpu", other: "--to bc1 to rgba16" }),
            Some(Formats { container: Container::Dds, .. }) if self.zstd => {
                Err(UsageError::Excluded { option: "zstd", other: "--container dds" })
            }
            Some(Formats { container: Container::Dds, texels: Texels::Astc(_), .. }) => {
                Err(UsageError::Excluded { option: "container dds", other: "--to astc4x4 to astc8x8" })
            }
            _ => Ok(()),
        }
    }

    /// Whether files hold any number of bands.
    pub(crate) fn takes_bands(&self) -> bool {
        self.to.picture().is_tiff()
    }

    /// Refuses to overwrite: fails where one of these files is there, without --force.
    pub(crate) fn check<'p>(&self, outputs: impl Iterator<Item = &'p Path>) -> Result<(), CliError> {
        let mut there = outputs.filter(|output| !self.force && output.symlink_metadata().is_ok());
        let Some(first) = there.next() else { return Ok(()) };
        Err(CliError::Exists { path: first.to_owned(), more: there.count() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_the_rectangle_in_order() {
        for (width, height) in [(1, 1), (300, 200), (32768, 1000), (32768, 1024), (1 << 23, 3)] {
            let whole = Rect { image: 1, level: 2, x: 7, y: 11, width, height };
            let mut next = whole.y;
            for band in bands(whole) {
                assert_eq!(Rect { y: whole.y, height, ..band }, whole);
                assert_eq!(band.y, next);
                assert!(band.height == 1 || u64::from(width) * u64::from(band.height) <= BAND_TEXELS);
                next += band.height;
            }
            assert_eq!(next, whole.y + height);
        }
    }
}
