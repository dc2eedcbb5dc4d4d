//! What the tiles of an image come to together: the image's row in the report.

use std::path::Path;

use texfold_core::image::ImageSet;
use texfold_core::metric::{Quality, decode_rounded};
use texfold_core::target::Measured;
use texfold_core::{Access, Encoded, Image2d, ImageSize};
use texfold_progressive::PUBLIC_PART;

use super::task::BankTask;
use crate::perceptual::{Likeness, mean};
use crate::report::{PartRow, Row, Sizes, peak_bytes};
use texfold::bank::Tile;

/// What is known of the tiles of an image so far.
#[derive(Debug, Default)]
pub(super) struct Sums {
    pub(super) tiles: Vec<Tile>,
    /// Name of the tiles' codec.
    codec: &'static str,
    quality: Quality,
    ssim: f64,
    /// SSIMULACRA2 and texels of each tile.
    ssimulacra2: Vec<(Option<f64>, f64)>,
    texels: u64,
    /// Bits that goals count.
    counted: u64,
    resident: u64,
    parts: Vec<PartRow>,
    pub(super) channels: u8,
    pub(super) levels: u32,
}

impl Sums {
    /// Takes a tile in. Of the public codebook it counts `grown`, the bits that the tile added.
    pub(super) fn add(
        &mut self,
        tile: Tile,
        source: &ImageSet,
        texture: &dyn Encoded<Domain = Image2d>,
        grown: u64,
    ) {
        self.tiles.push(tile);
        self.codec = texture.codec().name;
        let texels = source.texel_count();
        let decoded = decode_rounded(texture, 0);
        let found = decoded.map(|decoded| Likeness::of(&source.images()[0], &decoded));
        self.ssimulacra2.push((found.and_then(|found| found.ssimulacra2), texels as f64));
        if let Some(found) = found {
            self.quality = self.quality.and(found.quality);
            self.ssim += found.ssim * texels as f64;
        }
        self.texels += texels;
        let memory = texture.memory();
        self.counted += memory.goal;
        self.resident += memory.resident;
        self.channels = self.channels.max(texture.layout().pixel.channels);
        self.levels = self.levels.max(texture.layout().levels);
        self.add_parts(texture, grown);
    }

    fn add_parts(&mut self, texture: &dyn Encoded<Domain = Image2d>, grown: u64) {
        for part in texture.footprint().parts {
            let is_shared = part.name == PUBLIC_PART;
            let (memory, disk) = if is_shared { (grown, grown) } else { (part.bits_memory, part.bits_disk) };
            match self.parts.iter_mut().find(|known| known.name == part.name) {
                Some(known) => {
                    known.bits_memory += memory;
                    known.bits_disk += disk;
                    known.psnr_without = None;
                }
                None => self.parts.push(PartRow {
                    name: part.name.to_owned(),
                    bits_memory: memory,
                    bits_disk: disk,
                    psnr_without: part.psnr_without,
                }),
            }
        }
    }

    /// What a goal is held against.
    pub(super) fn measured(&self) -> Measured {
        Measured {
            psnr: self.quality.color.psnr(),
            bpp: self.counted as f64 / self.texels.max(1) as f64,
            worst_block_rms: self.quality.worst_block_rms,
        }
    }

    /// The verdict of an image by texel: shares of the blocks that use codebooks.
    pub(super) fn shares(&self) -> String {
        let count = |index: usize| self.tiles.iter().map(|tile| tile.blocks[index]).sum::<u64>();
        let all = count(2).max(1) as f64;
        let rows: u32 = self.tiles.iter().map(|tile| tile.grown_rows).sum();
        format!(
            "{} tiles; {:.0}% of the blocks use public content and {:.0}% the tiles' own; the public codebooks grew by {rows} rows.",
            self.tiles.len(),
            100.0 * count(0) as f64 / all,
            100.0 * count(1) as f64 / all
        )
    }

    /// The row of an image of that size.
    pub(super) fn row(
        &self,
        task: &BankTask,
        dir: &Path,
        size: ImageSize,
        (made, seconds): (&Making, f64),
    ) -> Row {
        let texels = self.texels as f64;
        let bits = |of: fn(&PartRow) -> u64| self.parts.iter().map(of).sum::<u64>();
        let (memory, disk) = (bits(|part| part.bits_memory), bits(|part| part.bits_disk));
        Row {
            input: task.path.display().to_string(),
            output: dir.display().to_string(),
            codec: self.codec.to_owned(),
            settings: format!("{:?}", task.settings.encode.goal),
            width: size.width,
            height: size.height,
            images: 1,
            source_texels: self.texels,
            sizes: Sizes::new(memory, self.resident, disk, self.texels),
            psnr: self.quality.color.psnr(),
            psnr_alpha: self.quality.alpha.map(|error| error.psnr()),
            rms: self.quality.color.rms(),
            worst_block_rms: self.quality.worst_block_rms,
            psnr_worst_tile: Some(self.quality.psnr_worst_tile()),
            worst_relative_error: None,
            ssim: self.ssim / texels,
            ssimulacra2: mean(self.ssimulacra2.iter().copied()),
            degrees: None,
            maps: Vec::new(),
            views: None,
            psnr_merged: None,
            access: made.access.name().to_owned(),
            goal_met: made.goal_met,
            encode_seconds: seconds,
            encode_texels_per_second: texels / seconds.max(1e-9),
            peak_bytes: peak_bytes(),
            parts: self.parts.clone(),
            verdict: made.verdict.clone(),
            tried: Vec::new(),
            notes: Vec::new(),
            warnings: made.warning.iter().cloned().collect(),
        }
    }
}

/// How an image was made.
#[derive(Debug)]
pub(super) struct Making {
    pub(super) access: Access,
    /// Whether the image meets its goal, where that is of the image and not of its tiles.
    pub(super) goal_met: Option<bool>,
    pub(super) verdict: String,
    pub(super) warning: Option<String>,
}
