//! The shipped form of a texture.

use crate::container::{CodecId, Notes, SectionWriter};
use crate::image::to_rgba8;
use crate::{Domain, Footprint, GpuForm, MemoryBits, RegionError, Texel};

/// An encoded texture: what is stored, loaded, sampled, counted and drawn.
///
/// Nothing here can fail after a successful load but a request for a region that does not exist.
pub trait Encoded: Send + Sync {
    /// What it is addressed by.
    type Domain: Domain;
    /// Which codec made it.
    fn codec(&self) -> CodecId;
    /// Which addresses exist.
    fn layout(&self) -> &<Self::Domain as Domain>::Layout;
    /// Loaded of total layers: a truncated progressive file has fewer than it was made with.
    fn layers(&self) -> Layers {
        Layers { loaded: 1, total: 1 }
    }
    /// One texel. Total, as in a shader: an address outside is clamped to the nearest inside.
    fn texel(&self, at: <Self::Domain as Domain>::Address) -> Texel;
    /// All texels of `region` into `out`, in the region's order; equal to [`Encoded::texel`] texel by texel.
    ///
    /// # Errors
    /// [`RegionError`] where `region` leaves the texture or `out` has another length.
    fn decode(
        &self,
        region: <Self::Domain as Domain>::Region<'_>,
        out: &mut [Texel],
    ) -> Result<(), RegionError>;
    /// As [`Encoded::decode`], to RGBA of 8 bits: values between 0 and 1 times 255, halves rounded up. Codecs that store 8-bit samples
    /// decode to them without passing through floats.
    ///
    /// # Errors
    /// As there.
    fn decode_rgba8(
        &self,
        region: <Self::Domain as Domain>::Region<'_>,
        out: &mut [[u8; 4]],
    ) -> Result<(), RegionError> {
        let mut texels = vec![Texel::ZERO; out.len()];
        self.decode(region, &mut texels)?;
        to_rgba8(&texels, out);
        Ok(())
    }
    /// Writes the sections of a file, coarse layers first.
    fn store(&self, out: &mut SectionWriter);
    /// Bits by named part: those of the file add up to its length, those in memory to [`MemoryBits::compressed`].
    fn footprint(&self) -> Footprint;
    /// What a GPU needs to draw it.
    fn gpu(&self) -> GpuForm<'_>;
    /// Memory on a GPU, compressed and as drawn. Codecs whose [`Encoded::gpu`] is slow compute it without that.
    fn memory(&self) -> MemoryBits {
        self.gpu().memory()
    }
    /// How it was made: settings, a verdict in a sentence, what each part bought.
    fn notes(&self) -> &Notes;
}

/// How much of a progressive file is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layers {
    /// Layers that can be drawn.
    pub loaded: u32,
    /// Layers that the whole file has.
    pub total: u32,
}

/// An encoded form that can take a further layer as it arrives.
pub trait Refine: Encoded {
    /// Takes the next layer from a longer prefix of the same file; returns the names of the planes to upload again.
    ///
    /// # Errors
    /// [`crate::LoadError`] as in loading; the texture stays as it was.
    fn refine(
        &mut self,
        file: &crate::container::Sections<'_>,
        budget: &mut crate::Budget,
    ) -> Result<Vec<&'static str>, crate::LoadError>;
}
