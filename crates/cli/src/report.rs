//! The report of `compress`: one row an output. All figures come from the bytes of the file that ships.

use std::path::Path;

use serde::{Deserialize, Serialize};
use texfold::{AnyImage, dct::DctImages, encoding::Attempt, epitome::worst_relative_error};
use texfold_core::image::{ColorSpace, ImageSet, MapInfo, Raster};
use texfold_core::metric::{Quality, SquaredError, compare, decode_rounded};
use texfold_core::target::Measured;
use texfold_core::{Footprint, Goal, LoadError, MemoryBits};

use crate::normals::{degrees_of, mean_degrees};
use crate::perceptual::{Likeness, mean, ssimulacra2};

/// A part of the ledger.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct PartRow {
    pub(crate) name: String,
    pub(crate) bits_memory: u64,
    pub(crate) bits_disk: u64,
    pub(crate) psnr_without: Option<f64>,
}

/// Sizes of an encoded texture in bits, in all and per source texel.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Sizes {
    /// Compressed form in memory: its parts add up to it.
    pub(crate) bits_memory: u64,
    /// GPU memory where blocks are decoded whole.
    pub(crate) bits_resident: u64,
    /// File.
    pub(crate) bits_disk: u64,
    pub(crate) bpp_memory: f64,
    pub(crate) bpp_resident: f64,
    pub(crate) bpp_disk: f64,
}

impl Sizes {
    /// Of a texture that takes `memory`, whose file is `bytes`, of so many source texels.
    pub(crate) fn of(memory: MemoryBits, bytes: &[u8], texels: u64) -> Sizes {
        Sizes::new(memory.compressed, memory.resident, 8 * bytes.len() as u64, texels)
    }

    pub(crate) fn new(bits_memory: u64, bits_resident: u64, bits_disk: u64, texels: u64) -> Sizes {
        let per_texel = |bits: u64| bits as f64 / texels.max(1) as f64;
        let [bpp_memory, bpp_resident, bpp_disk] = [bits_memory, bits_resident, bits_disk].map(per_texel);
        Sizes { bits_memory, bits_resident, bits_disk, bpp_memory, bpp_resident, bpp_disk }
    }

    /// Of several textures of so many source texels in all.
    pub(crate) fn sum(all: impl Iterator<Item = Sizes>, texels: u64) -> Sizes {
        let add = |sum: [u64; 3], one: Sizes| {
            let one = [one.bits_memory, one.bits_resident, one.bits_disk];
            std::array::from_fn(|figure| sum[figure].saturating_add(one[figure]))
        };
        let [memory, resident, disk] = all.fold([0; 3], add);
        Sizes::new(memory, resident, disk, texels)
    }

    /// The last three lines of a table of parts: sums, sums per texel, GPU memory.
    pub(crate) fn lines(&self) -> [String; 3] {
        let line = |name: &str, memory: String, disk: String| format!("  {name:12} {memory:>14} {disk:>14}");
        [
            line("all", self.bits_memory.to_string(), self.bits_disk.to_string()),
            line("bits a texel", format!("{:.4}", self.bpp_memory), format!("{:.4}", self.bpp_disk)),
            format!(
                "  decoded      {:>14} bits of GPU memory, {:.4} a texel, where blocks are decoded whole",
                self.bits_resident, self.bpp_resident
            ),
        ]
    }
}

/// One output. Banks that the library wrote have a part of its fields.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Row {
    pub(crate) input: String,
    pub(crate) output: String,
    pub(crate) codec: String,
    pub(crate) settings: String,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) images: usize,
    pub(crate) source_texels: u64,
    #[serde(flatten)]
    pub(crate) sizes: Sizes,
    pub(crate) psnr: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) psnr_alpha: Option<f64>,
    pub(crate) rms: f64,
    pub(crate) worst_block_rms: f64,
    /// [`Quality::psnr_worst_tile`] of the worst image; nothing of light fields and zoom stacks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) psnr_worst_tile: Option<f64>,
    /// [`worst_relative_error`], for goals of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) worst_relative_error: Option<f64>,
    pub(crate) ssim: f64,
    /// [`crate::ssimulacra2`], where it is defined.
    pub(crate) ssimulacra2: Option<f64>,
    /// Mean angle in degrees that normals are turned by, of normal maps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) degrees: Option<f64>,
    /// The maps of a material.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) maps: Vec<MapRow>,
    /// Light fields: photographs that are drawn again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) views: Option<Views>,
    /// Zoom stacks: PSNR against the merged images, which the goal is about; for goals of PSNR against the worst of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) psnr_merged: Option<f64>,
    /// How texels are reached: "block" or "texel".
    pub(crate) access: String,
    /// Whether the goal is met, where there is one.
    pub(crate) goal_met: Option<bool>,
    pub(crate) encode_seconds: f64,
    pub(crate) encode_texels_per_second: f64,
    /// Most memory that the whole process has held so far, where the system tells.
    pub(crate) peak_bytes: Option<u64>,
    pub(crate) parts: Vec<PartRow>,
    pub(crate) verdict: String,
    /// What became of each codec that a choice among all considered.
    pub(crate) tried: Vec<TriedRow>,
    /// Notes on how the files were read.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) notes: Vec<String>,
    pub(crate) warnings: Vec<String>,
}

/// A map of a material.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct MapRow {
    pub(crate) name: String,
    pub(crate) kind: String,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) channels: u8,
    pub(crate) color: String,
    /// PSNR of its colour channels and of its alpha, where it has any.
    pub(crate) psnr: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) psnr_alpha: Option<f64>,
    /// [`crate::ssimulacra2`], where it is defined.
    pub(crate) ssimulacra2: Option<f64>,
    /// Mean angle in degrees that normals are turned by.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) degrees: Option<f64>,
    /// Bits a texel of the largest map that its part of the blocks takes in memory.
    pub(crate) bpp_memory: f64,
}

impl MapRow {
    /// The rows of all maps of a material; none of other images.
    fn all(source: &ImageSet, image: &AnyImage) -> Vec<MapRow> {
        let encoded = image.as_encoded();
        let blocks = image.downcast_ref::<DctImages>();
        let row = |(index, (map, raster)): (u32, (&MapInfo, &Raster))| {
            let decoded = decode_rounded(encoded, index)?;
            let (size, quality) = (raster.size(), compare(raster, &decoded));
            let bytes = blocks.map_or(0, |blocks| blocks.content().held_bytes_of(index));
            Some(MapRow {
                name: map.name.clone(),
                kind: map.kind.name().to_owned(),
                width: size.width,
                height: size.height,
                channels: map.pixel.channels,
                color: color_name(map.pixel.color).to_owned(),
                psnr: quality.color.psnr(),
                psnr_alpha: quality.alpha.map(SquaredError::psnr),
                ssimulacra2: ssimulacra2(raster, &decoded),
                degrees: degrees_of(raster, &decoded),
                bpp_memory: 8.0 * bytes as f64 / source.texel_count() as f64,
            })
        };
        (0..).zip(source.maps().iter().zip(source.images())).filter_map(row).collect()
    }
}

/// A colour space's name, as options have it.
pub(crate) fn color_name(color: ColorSpace) -> &'static str {
    match color {
        ColorSpace::Srgb => "srgb",
        ColorSpace::Linear => "linear",
        ColorSpace::Normal => "normal",
    }
}

/// Photographs of an object that its light field draws again.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Views {
    /// PSNR of colours inside the masks, of all views together.
    pub(crate) psnr: f64,
    pub(crate) count: usize,
    /// True for photographs that the light field was not made from.
    pub(crate) are_new: bool,
}

/// A codec that a choice among all considered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct TriedRow {
    pub(crate) codec: String,
    /// PSNR of colours and bits a texel as goals count them, where it was encoded.
    pub(crate) psnr: Option<f64>,
    pub(crate) bpp: Option<f64>,
    pub(crate) outcome: String,
}

impl From<&Attempt> for TriedRow {
    fn from(attempt: &Attempt) -> TriedRow {
        TriedRow {
            codec: attempt.codec.to_owned(),
            psnr: attempt.measured.map(|measured| measured.psnr),
            bpp: attempt.measured.map(|measured| measured.bpp),
            outcome: attempt.outcome.clone(),
        }
    }
}

/// One input of the report.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub(crate) enum Entry {
    Done(Box<Row>),
    Failed {
        input: String,
        error: String,
    },
    /// Files in folders that are no images.
    NotRead {
        not_read: Vec<String>,
    },
}

/// The ledger's rows.
pub(crate) fn part_rows(footprint: &Footprint) -> Vec<PartRow> {
    let row = |part: &texfold_core::Part| PartRow {
        name: part.name.to_owned(),
        bits_memory: part.bits_memory,
        bits_disk: part.bits_disk,
        psnr_without: part.psnr_without,
    };
    footprint.parts.iter().map(row).collect()
}

/// How good and how large a file is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Figures {
    pub(crate) psnr: f64,
    pub(crate) psnr_alpha: Option<f64>,
    pub(crate) rms: f64,
    pub(crate) worst_block_rms: f64,
    pub(crate) psnr_worst_tile: f64,
    pub(crate) ssim: f64,
    pub(crate) ssimulacra2: Option<f64>,
    pub(crate) sizes: Sizes,
    /// Bits a texel that goals count.
    goal_bpp: f64,
}

impl Figures {
    /// Loads `bytes` and measures what they hold against `source`.
    pub(crate) fn of(source: &ImageSet, bytes: &[u8]) -> Result<(Figures, AnyImage), LoadError> {
        let image = texfold::open(bytes)?.into_image()?;
        let encoded = image.as_encoded();
        let mut quality = Quality::default();
        let (mut similarity, mut perceived) = (0.0, Vec::new());
        for (index, raster) in (0..).zip(source.images()) {
            let missing = || LoadError::Corrupt {
                section: texfold_core::String4(*b"head"),
                offset: 0,
                what: "an image of the source is not in the file",
            };
            let decoded = decode_rounded(encoded, index).ok_or_else(missing)?;
            let found = Likeness::of(raster, &decoded);
            quality = quality.and(found.quality);
            similarity += found.ssim;
            perceived.push((found.ssimulacra2, 1.0));
        }
        let figures = Figures {
            psnr: quality.color.psnr(),
            psnr_alpha: quality.alpha.map(|error| error.psnr()),
            rms: quality.color.rms(),
            worst_block_rms: quality.worst_block_rms,
            psnr_worst_tile: quality.psnr_worst_tile(),
            ssim: similarity / source.images().len() as f64,
            ssimulacra2: mean(perceived.into_iter()),
            sizes: Sizes::of(encoded.memory(), bytes, source.texel_count()),
            goal_bpp: encoded.memory().goal as f64 / source.texel_count() as f64,
        };
        Ok((figures, image))
    }

    /// A sentence where the goal is missed.
    fn missed(&self, goal: Goal) -> Option<String> {
        let Figures { psnr, psnr_alpha, goal_bpp: bpp, worst_block_rms, .. } = *self;
        let psnr = psnr_alpha.map_or(psnr, |alpha| alpha.min(psnr));
        missed(goal, &Measured { psnr, bpp, worst_block_rms })
    }
}

/// A sentence where what was measured misses the goal.
pub(crate) fn missed(goal: Goal, found: &Measured) -> Option<String> {
    // Texels per block do not divide every image: a size goal may be passed by rounding alone.
    const ROUNDING: f64 = 1e-9;
    let (missed, wanted, reached) = match goal {
        Goal::Psnr(psnr) => {
            (found.psnr < psnr - ROUNDING, format!("{psnr} dB"), format!("{:.2} dB", found.psnr))
        }
        Goal::Bpp(bpp) => {
            (found.bpp > bpp + ROUNDING, format!("{bpp} bits per texel"), format!("{:.3}", found.bpp))
        }
        Goal::Tolerance(rms) => (
            found.worst_block_rms > rms + ROUNDING,
            format!("a block error of {rms}"),
            format!("{:.2}", found.worst_block_rms),
        ),
    };
    // A size is missed where a codec's form takes more, however coarse it is.
    let remedy = if matches!(goal, Goal::Bpp(_)) { "; give more bits, or another codec" } else { "" };
    missed.then(|| format!("the goal of {wanted} was missed: {reached}{remedy}"))
}

/// A sentence where a light field of that PSNR misses its goal.
pub(crate) fn light_missed(goal: Goal, psnr: f64) -> Option<String> {
    let Goal::Psnr(wanted) = goal else { return None };
    (psnr < wanted).then(|| format!("the goal of {wanted} dB was missed: {psnr:.2} dB"))
}

/// What a row says beside what the file itself tells.
#[derive(Debug)]
pub(crate) struct Circumstances<'a> {
    pub(crate) input: &'a Path,
    pub(crate) output: &'a Path,
    pub(crate) encode_seconds: f64,
    pub(crate) goal: Goal,
    /// The goal instead, in degrees of normals.
    pub(crate) degrees: Option<f64>,
    /// Side of the blocks of a relative tolerance, where the goal is one.
    pub(crate) relative: Option<u32>,
    pub(crate) attempts: Vec<Attempt>,
    pub(crate) notes: Vec<String>,
    pub(crate) warnings: Vec<String>,
}

impl Row {
    /// The row of a file that holds `source`.
    pub(crate) fn of(source: &ImageSet, bytes: &[u8], how: Circumstances<'_>) -> Result<Row, LoadError> {
        let (figures, image) = Figures::of(source, bytes)?;
        let encoded = image.as_encoded();
        let footprint = encoded.footprint();
        let (size, texels) = (source.images()[0].size(), source.texel_count());
        let mut warnings = how.warnings;
        let degrees = mean_degrees(source, encoded);
        let relative = how.relative.map(|side| worst_relative_error(source, encoded, side));
        let missed = match (how.degrees, degrees, how.goal, relative) {
            (Some(wanted), Some(found), ..) => (found > wanted)
                .then(|| format!("the goal of {wanted} degrees was missed: {found:.2} in the mean")),
            (_, _, Goal::Tolerance(wanted), Some(found)) => (found > wanted)
                .then(|| format!("the goal of a relative error of {wanted} was missed: {found:.5}")),
            _ => figures.missed(how.goal),
        };
        let goal_met = Some(missed.is_none());
        warnings.extend(missed);
        Ok(Row {
            input: how.input.display().to_string(),
            output: how.output.display().to_string(),
            codec: encoded.codec().name.to_owned(),
            settings: encoded.notes().settings.clone(),
            width: size.width,
            height: size.height,
            images: source.images().len(),
            source_texels: texels,
            sizes: figures.sizes,
            psnr: figures.psnr,
            psnr_alpha: figures.psnr_alpha,
            rms: figures.rms,
            worst_block_rms: figures.worst_block_rms,
            psnr_worst_tile: Some(figures.psnr_worst_tile),
            worst_relative_error: relative,
            ssim: figures.ssim,
            ssimulacra2: figures.ssimulacra2,
            degrees,
            maps: MapRow::all(source, &image),
            views: None,
            psnr_merged: None,
            access: encoded.gpu().access().name().to_owned(),
            goal_met,
            encode_seconds: how.encode_seconds,
            encode_texels_per_second: texels as f64 / how.encode_seconds.max(1e-9),
            peak_bytes: peak_bytes(),
            parts: part_rows(&footprint),
            verdict: encoded.notes().verdict.clone(),
            tried: how.attempts.iter().map(TriedRow::from).collect(),
            notes: how.notes,
            warnings,
        })
    }
}

/// The most memory that the process has held so far; `None` where the system does not tell.
pub(crate) fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}
