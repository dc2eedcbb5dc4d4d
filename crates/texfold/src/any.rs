//! Textures of any codec.

use std::any::Any;
use std::io::{self, Write};

use texfold_core::container::SectionWriter;
use texfold_core::{CodecId, Encoded, Image2d, LoadError, Rect, RegionError, Texel};
use texfold_lightfield::LightTexture;

use crate::Registration;

/// Texels that are decoded at a time on their way to bytes.
const BAND_TEXELS: usize = 1 << 18;
/// Rows that bands are multiples of: those of every codec's blocks.
const BAND_ROWS: usize = 64;

/// A texture of images that can be asked for its own type.
trait ImageTexture: Encoded<Domain = Image2d> + Any {}
impl<T: Encoded<Domain = Image2d> + Any> ImageTexture for T {}

/// An encoded texture of images, of any codec.
pub struct AnyImage(Box<dyn ImageTexture>);

impl std::fmt::Debug for AnyImage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "AnyImage({})", self.codec().name)
    }
}

/// Why texels cannot be written as bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BytesError {
    /// The region does not exist.
    #[error(transparent)]
    Region(#[from] RegionError),
    /// Rows that overlap.
    #[error("rows of {width} RGBA texels every {stride} bytes; give a stride of at least 4 bytes a texel")]
    Stride {
        /// Texels of a row.
        width: u32,
        /// Bytes from the start of a row to that of the next.
        stride: usize,
    },
    /// Too little room.
    #[error("room for {found} bytes where {needed} are needed; give stride x (rows - 1) + 4 x columns bytes")]
    Length {
        /// Bytes of the output.
        found: usize,
        /// Bytes needed.
        needed: usize,
    },
}

impl AnyImage {
    /// Takes a texture of a certain codec.
    #[must_use]
    pub fn new(texture: impl Encoded<Domain = Image2d> + 'static) -> AnyImage {
        AnyImage(Box::new(texture))
    }

    /// The texture behind its trait.
    #[must_use]
    pub fn as_encoded(&self) -> &dyn Encoded<Domain = Image2d> {
        &*self.0
    }

    /// The texture behind its trait, boxed.
    #[must_use]
    pub fn into_encoded(self) -> Box<dyn Encoded<Domain = Image2d>> {
        self.0
    }

    /// The texture in its own type, such as `EpitomeTexture`; `None` where it is of another.
    #[must_use]
    pub fn downcast_ref<T: Encoded<Domain = Image2d> + 'static>(&self) -> Option<&T> {
        let any: &dyn Any = &*self.0;
        any.downcast_ref()
    }

    /// As [`AnyImage::downcast_ref`], to be changed.
    #[must_use]
    pub fn downcast_mut<T: Encoded<Domain = Image2d> + 'static>(&mut self) -> Option<&mut T> {
        let any: &mut dyn Any = &mut *self.0;
        any.downcast_mut()
    }

    /// As [`AnyImage::downcast_ref`], for good.
    #[must_use]
    pub fn downcast<T: Encoded<Domain = Image2d> + 'static>(self) -> Option<T> {
        let any: Box<dyn Any> = self.0;
        any.downcast().ok().map(|texture| *texture)
    }

    /// Which codec made it.
    #[must_use]
    pub fn codec(&self) -> CodecId {
        self.0.codec()
    }

    /// The codec's row of [`crate::CODECS`]; `None` only where the codec is not one of Texfold's.
    #[must_use]
    pub fn registration(&self) -> Option<&'static Registration> {
        Registration::by_number(self.codec().number)
    }

    /// The whole `.txf` file.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        file_of(self.as_encoded())
    }

    /// Writes the whole `.txf` file; gives its length in bytes.
    ///
    /// # Errors
    /// Whatever `out` reports.
    pub fn write_to(&self, mut out: impl Write) -> io::Result<u64> {
        let bytes = self.to_bytes();
        out.write_all(&bytes)?;
        Ok(bytes.len() as u64)
    }

    /// Decodes a region to 8-bit RGBA, row by row from the top, each row `stride` bytes after the one before. Gray is
    /// copied to red, green and blue; alpha that is not there is 255. Values are as stored: an sRGB image gives sRGB
    /// bytes.
    ///
    /// # Errors
    /// [`BytesError`] where `region` leaves the texture, or `out` or `stride` are too small for it. Bytes between rows are
    /// left as they are.
    pub fn decode_rgba8(&self, region: Rect, out: &mut [u8], stride: usize) -> Result<(), BytesError> {
        self.decode_rows(region, out, stride, |band, texels| self.as_encoded().decode_rgba8(band, texels))
    }

    /// As [`AnyImage::decode_rgba8`] to 16 bits a channel, 65535 for 1; `stride` counts values, four a texel.
    ///
    /// # Errors
    /// As there, in values for bytes.
    pub fn decode_rgba16(&self, region: Rect, out: &mut [u16], stride: usize) -> Result<(), BytesError> {
        let mut values = Vec::new();
        self.decode_rows(region, out, stride, |band, texels| {
            values.resize(texels.len(), Texel::ZERO);
            self.as_encoded().decode(band, &mut values)?;
            for (texel, value) in texels.iter_mut().zip(&values) {
                let value = value.clamp(Texel::ZERO, Texel::ONE) * f32::from(u16::MAX) + 0.5;
                *texel = value.to_array().map(|value| value as u16);
            }
            Ok(())
        })
    }

    /// Decodes bands of a region to rows of four values a texel, `stride` values apart.
    fn decode_rows<T: Copy + Default>(
        &self,
        region: Rect,
        out: &mut [T],
        stride: usize,
        mut decode: impl FnMut(Rect, &mut [[T; 4]]) -> Result<(), RegionError>,
    ) -> Result<(), BytesError> {
        self.as_encoded().layout().check(region)?;
        let (width, height) = (region.width as usize, region.height as usize);
        if stride / 4 < width {
            return Err(BytesError::Stride { width: region.width, stride });
        }
        let before_last = stride.saturating_mul(height.saturating_sub(1));
        let needed = if height == 0 { 0 } else { before_last.saturating_add(4 * width) };
        if out.len() < needed {
            return Err(BytesError::Length { found: out.len(), needed });
        }
        if width == 0 || height == 0 {
            return Ok(());
        }
        // Bands end where blocks do, so that none is decoded twice.
        let rows = (BAND_TEXELS / width).next_multiple_of(BAND_ROWS);
        let mut texels =
            if stride == 4 * width { Vec::new() } else { vec![[T::default(); 4]; rows.min(height) * width] };
        let mut top = 0;
        while top < height {
            let rows = (rows - (region.y as usize + top) % rows).min(height - top);
            let band = Rect { y: region.y + top as u32, height: rows as u32, ..region };
            if texels.is_empty() {
                let (out, _) = out[top * stride..][..rows * stride].as_chunks_mut::<4>();
                decode(band, out)?;
            } else {
                decode(band, &mut texels[..rows * width])?;
                for (row, line) in texels[..rows * width].chunks_exact(width).enumerate() {
                    out[(top + row) * stride..][..4 * width].copy_from_slice(line.as_flattened());
                }
            }
            top += rows;
        }
        Ok(())
    }
}

/// A loaded texture, by what it is addressed by.
#[derive(Debug)]
pub enum AnyTexture {
    /// One image, a set or a sequence.
    Image(AnyImage),
    /// A surface light field.
    Light(Box<LightTexture>),
}

impl AnyTexture {
    /// Which codec made it.
    #[must_use]
    pub fn codec(&self) -> CodecId {
        match self {
            AnyTexture::Image(image) => image.codec(),
            AnyTexture::Light(light) => light.codec(),
        }
    }

    /// The images.
    ///
    /// # Errors
    /// [`LoadError::NotThisCodec`] where it is a light field.
    pub fn into_image(self) -> Result<AnyImage, LoadError> {
        match self {
            AnyTexture::Image(image) => Ok(image),
            AnyTexture::Light(light) => Err(LoadError::NotThisCodec { found: light.codec().number }),
        }
    }

    /// The light field.
    ///
    /// # Errors
    /// [`LoadError::NotThisCodec`] where it is of images.
    pub fn into_light(self) -> Result<LightTexture, LoadError> {
        match self {
            AnyTexture::Image(image) => Err(LoadError::NotThisCodec { found: image.codec().number }),
            AnyTexture::Light(light) => Ok(*light),
        }
    }

    /// The whole `.txf` file.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        match self {
            AnyTexture::Image(image) => image.to_bytes(),
            AnyTexture::Light(light) => file_of(&**light),
        }
    }
}

/// The whole `.txf` file of a texture.
#[must_use]
pub fn file_of<D: texfold_core::Domain>(encoded: &(impl Encoded<Domain = D> + ?Sized)) -> Vec<u8> {
    let mut writer = SectionWriter::new(encoded.codec());
    encoded.store(&mut writer);
    writer.finish().bytes
}
