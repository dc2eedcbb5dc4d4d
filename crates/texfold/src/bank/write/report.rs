//! Figures of an image of a bank: its row in the list.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use texfold_core::image::ImageSet;
use texfold_core::metric::{Quality, SquaredError, quality};
use texfold_core::{Access, Encoded, Image2d, Part, TextureCodec};
use texfold_progressive::PUBLIC_PART;

use super::super::Image;

/// Figures of an image of a bank. Fields that other programs wrote are kept as they are.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Report {
    /// Name of the codec of its tiles.
    pub codec: String,
    /// How texels are reached: "block" or "texel".
    pub access: String,
    /// Texels.
    pub source_texels: u64,
    /// Bits of the compressed form in memory, a texel.
    pub bpp_memory: f64,
    /// Bits of GPU memory where blocks are decoded whole, a texel.
    pub bpp_resident: f64,
    /// Bits of the files, a texel.
    pub bpp_disk: f64,
    /// Bits of the compressed form in memory.
    pub bits_memory: u64,
    /// Bits of GPU memory where blocks are decoded whole.
    pub bits_resident: u64,
    /// Bits of the files.
    pub bits_disk: u64,
    /// PSNR of colours, in dB.
    pub psnr: f64,
    /// RMS error of colours, in 8-bit units.
    pub rms: f64,
    /// RMS error of the worst 4x4 block, in 8-bit units.
    pub worst_block_rms: f64,
    /// Whether the image meets its goal, where that is of the image and not of its tiles.
    pub goal_met: Option<bool>,
    /// Most channels of its tiles.
    #[serde(skip)]
    pub channels: u8,
    /// Mip levels of its tiles.
    #[serde(skip)]
    pub levels: u32,
    /// Fields of other programs.
    #[serde(flatten)]
    pub other: Map<String, Value>,
}

impl Report {
    /// Whether an image is stored by block.
    #[must_use]
    pub fn is_by_block(image: &Image<Report>) -> bool {
        image.row.access == Access::Block.name()
    }
}

/// Bits and errors of tiles of an image, added up. Processes that encode some of them each hand theirs over, and these add up.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Sums {
    /// Sum of the squared errors of colours in 8-bit units, values that went in.
    color: (f64, u64),
    worst_block_rms: f64,
    texels: u64,
    memory: u64,
    resident: u64,
    disk: u64,
    channels: u8,
    levels: u32,
}

impl Sums {
    /// Takes a tile in. Of a public codebook, which tiles share, `grown` bits count: those that this one added.
    pub fn add(&mut self, source: &ImageSet, texture: &dyn Encoded<Domain = Image2d>, grown: u64) {
        let (memory, layout, parts) = (texture.memory(), texture.layout(), texture.footprint().parts);
        let bits = |of: fn(&Part) -> u64| -> u64 {
            parts.iter().map(|part| if part.name == PUBLIC_PART { grown } else { of(part) }).sum()
        };
        let Quality { color, worst_block_rms, .. } = quality(source, texture);
        *self = self.and(Sums {
            color: (color.sum, color.count),
            worst_block_rms,
            texels: source.texel_count(),
            memory: bits(|part| part.bits_memory),
            resident: memory.resident,
            disk: bits(|part| part.bits_disk),
            channels: layout.pixel.channels,
            levels: layout.levels,
        });
    }

    /// Text for another process, which [`Sums::parse`] reads.
    #[must_use]
    pub fn to_text(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }

    /// The sums of such a text.
    #[must_use]
    pub fn parse(text: &str) -> Option<Sums> {
        serde_json::from_str(text).ok()
    }

    /// Both together.
    #[must_use]
    pub fn and(self, other: Sums) -> Sums {
        Sums {
            color: (self.color.0 + other.color.0, self.color.1 + other.color.1),
            worst_block_rms: self.worst_block_rms.max(other.worst_block_rms),
            texels: self.texels + other.texels,
            memory: self.memory + other.memory,
            resident: self.resident + other.resident,
            disk: self.disk + other.disk,
            channels: self.channels.max(other.channels),
            levels: self.levels.max(other.levels),
        }
    }

    /// The row of an image; `goal_met` is of one by block, as tiles by texel meet the goal one by one.
    #[must_use]
    pub fn report(&self, access: Access, goal_met: Option<bool>) -> Report {
        let codec = match access {
            Access::Block => texfold_dct::Dct::ID,
            Access::Texel => texfold_progressive::Progressive::ID,
        };
        let a_texel = |bits: u64| bits as f64 / self.texels.max(1) as f64;
        let color = SquaredError { sum: self.color.0, count: self.color.1 };
        Report {
            codec: codec.name.to_owned(),
            access: access.name().to_owned(),
            source_texels: self.texels,
            bpp_memory: a_texel(self.memory),
            bpp_resident: a_texel(self.resident),
            bpp_disk: a_texel(self.disk),
            bits_memory: self.memory,
            bits_resident: self.resident,
            bits_disk: self.disk,
            psnr: color.psnr(),
            rms: color.rms(),
            worst_block_rms: self.worst_block_rms,
            goal_met,
            channels: self.channels,
            levels: self.levels,
            other: Map::new(),
        }
    }
}
