//! Who uses which bits: the one definition of memory and file size.

use crate::container::{Notes, SectionWriter, Written};
use crate::{Encoded, GpuForm};

/// Part of content that is drawn alone, and coarser, until the rest of a file is there.
pub const BASE_PART: &str = "base";
/// Part of content that refines the base.
pub const RESIDUAL_PART: &str = "residual plane";

/// One named part of an encoded texture.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Name from the codec's vocabulary: "index", "codebook", "blocks", ...
    pub name: &'static str,
    /// Bits of the compressed form in GPU memory.
    pub bits_memory: u64,
    /// Bits of the file.
    pub bits_disk: u64,
    /// PSNR in dB of the whole texture with this part left out, where the maker measured it.
    pub psnr_without: Option<f64>,
}

/// All parts of an encoded texture.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Footprint {
    /// The parts; their sums are the totals.
    pub parts: Vec<Part>,
    /// Bits allocated while it is drawn, decoded whole ([`crate::MemoryBits::resident`]).
    pub bits_resident: u64,
}

impl Footprint {
    /// Counts the planes, blocks and uniforms of `gpu` and the sections that `encoded` stores, each under its
    /// part's name. The container's own bytes are the part "container".
    pub fn measure<E: Encoded + ?Sized>(encoded: &E, gpu: &GpuForm<'_>) -> Footprint {
        let mut writer = SectionWriter::new(encoded.codec());
        encoded.store(&mut writer);
        Footprint::of(gpu, &writer.finish()).with_notes(encoded.notes())
    }

    /// Adds what the maker noted each part bought.
    #[must_use]
    pub fn with_notes(mut self, notes: &Notes) -> Footprint {
        for (name, psnr) in &notes.psnr_without {
            if let Some(part) = self.parts.iter_mut().find(|part| part.name == name) {
                part.psnr_without = Some(f64::from(*psnr));
            }
        }
        self
    }

    /// As [`Footprint::measure`], for a file that is already written.
    #[must_use]
    pub fn of(gpu: &GpuForm<'_>, file: &Written) -> Footprint {
        let mut footprint = Footprint { parts: Vec::new(), bits_resident: gpu.memory().resident };
        for plane in &gpu.planes {
            footprint.part(plane.part).bits_memory += 8 * plane.data.len() as u64;
        }
        for (part, bytes) in gpu.block_bytes() {
            footprint.part(part).bits_memory += 8 * bytes;
        }
        if !gpu.uniforms.is_empty() {
            footprint.part("uniforms").bits_memory += 8 * gpu.uniforms.len() as u64;
        }
        for &(part, bytes) in &file.parts {
            footprint.part(part).bits_disk += 8 * bytes;
        }
        footprint
    }

    /// The part of that name, added at the end where there is none.
    pub fn part(&mut self, name: &'static str) -> &mut Part {
        let index = match self.parts.iter().position(|part| part.name == name) {
            Some(index) => index,
            None => {
                self.parts.push(Part { name, bits_memory: 0, bits_disk: 0, psnr_without: None });
                self.parts.len() - 1
            }
        };
        &mut self.parts[index]
    }

    /// Bits of the compressed form in GPU memory ([`crate::MemoryBits::compressed`]).
    #[must_use]
    pub fn bits_memory(&self) -> u64 {
        self.parts.iter().map(|part| part.bits_memory).sum()
    }

    /// Bits of the file.
    #[must_use]
    pub fn bits_disk(&self) -> u64 {
        self.parts.iter().map(|part| part.bits_disk).sum()
    }
}
