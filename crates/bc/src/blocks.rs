//! Encoding of planes and decoding of single blocks, format by format.
//!
//! Decoding follows the Direct3D definitions without intermediate rounding: BC1 and BC3 colours are 565 values
//! scaled to [0, 1] and interpolated, BC4 and BC5 interpolate in [0, 1]. Hardware decoders round differently by up
//! to 2/255; BC7 is exact by definition. ASTC is in `astc.rs`.

use std::ops::Deref;

use dds::{ColorFormat, CompressionQuality, EncodeOptions, ErrorMetric, ImageView, ImageViewMut, Size};
use glam::Vec4;
use rayon::prelude::*;
use texfold_core::{CancelCheck, Effort, PlaneFormat};

use crate::astc;

/// Rows of blocks that one task encodes: small enough to share out, large enough to be worth a task.
const BAND_ROWS: usize = 4;
/// Most blocks that one task encodes, if it has more than one row: at 50 us a block of BC7 at high effort 0.1 s, after which a
/// cancelled job stops.
const BAND_BLOCKS: usize = 2048;

/// Stores RGBA bytes (`width` x `height`, row by row) as `format`. Channels that the format lacks are dropped;
/// blocks that hang over the edge repeat it.
#[must_use]
pub fn encode_plane(format: PlaneFormat, width: u32, height: u32, rgba: &[u8], effort: Effort) -> Vec<u8> {
    encode_cancellable(format, width, height, rgba, effort, CancelCheck::default())
}

/// As [`encode_plane`]; blocks that are not begun when the job is cancelled are missing.
pub(crate) fn encode_cancellable(
    format: PlaneFormat,
    width: u32,
    height: u32,
    rgba: &[u8],
    effort: Effort,
    cancel: CancelCheck<'_>,
) -> Vec<u8> {
    let keep = |channels: usize| rgba.chunks_exact(4).flat_map(|texel| &texel[..channels]).copied().collect();
    match format {
        PlaneFormat::R8Unorm => keep(1),
        PlaneFormat::Rg8Unorm | PlaneFormat::Rg8Uint => keep(2),
        PlaneFormat::R32Uint | PlaneFormat::Rgba32Uint | PlaneFormat::Rgba8Unorm => rgba.to_vec(),
        PlaneFormat::Astc(block) => astc::encode(block, width, height, rgba, effort),
        _ => encode_blocks(format, (width as usize, height as usize), rgba, effort, cancel),
    }
}

fn encode_blocks(
    format: PlaneFormat,
    (width, height): (usize, usize),
    rgba: &[u8],
    effort: Effort,
    cancel: CancelCheck<'_>,
) -> Vec<u8> {
    let padded = pad_to_blocks(width, height, rgba);
    let padded_width = width.next_multiple_of(4);
    let band_rows = (BAND_BLOCKS / (padded_width / 4).max(1)).clamp(1, BAND_ROWS);
    let bands: Vec<Vec<u8>> = padded
        .par_chunks(padded_width * 4 * 4 * band_rows)
        .map(|band| {
            if cancel.is_cancelled() {
                Vec::new()
            } else if format == PlaneFormat::Bc1 && effort != Effort::Fast {
                encode_bc1_band(padded_width, band, effort)
            } else {
                encode_dds_band(format, padded_width, band, effort)
            }
        })
        .collect();
    bands.concat()
}

/// Extends the image to whole blocks by repeating its last column and row.
fn pad_to_blocks(width: usize, height: usize, rgba: &[u8]) -> Vec<u8> {
    let (columns, rows) = (width.next_multiple_of(4), height.next_multiple_of(4));
    (0..rows)
        .flat_map(|y| (0..columns).map(move |x| (y.min(height - 1) * width + x.min(width - 1)) * 4))
        .flat_map(|start| &rgba[start..start + 4])
        .copied()
        .collect()
}

fn encode_bc1_band(width: usize, band: &[u8], effort: Effort) -> Vec<u8> {
    let algorithm = match effort {
        Effort::High => texpresso::Algorithm::IterativeClusterFit,
        _ => texpresso::Algorithm::ClusterFit,
    };
    let weights = texpresso::COLOUR_WEIGHTS_UNIFORM;
    let params = texpresso::Params { algorithm, weights, weigh_colour_by_alpha: false };
    let height = band.len() / (4 * width);
    let mut blocks = vec![0; texpresso::Format::Bc1.compressed_size(width, height)];
    texpresso::Format::Bc1.compress(band, width, height, params, &mut blocks);
    blocks
}

fn encode_dds_band(format: PlaneFormat, width: usize, band: &[u8], effort: Effort) -> Vec<u8> {
    let size = Size::new(width as u32, (band.len() / (4 * width)) as u32);
    let mut options = EncodeOptions::default();
    options.parallel = false;
    options.error_metric = ErrorMetric::Uniform;
    options.quality = match effort {
        Effort::Fast => CompressionQuality::Fast,
        // One or two channels are cheap to search.
        Effort::Normal if format != PlaneFormat::Bc7 => CompressionQuality::High,
        Effort::Normal => CompressionQuality::Normal,
        Effort::High => CompressionQuality::High,
    };
    let mut blocks = Vec::new();
    // A band is never empty and its length fits its size, and writing to memory cannot fail: the block count
    // below is what decoders rely on, whatever happened here.
    if let Some(view) = ImageView::new(band, size, ColorFormat::RGBA_U8) {
        let done = dds::encode(&mut blocks, view, dds_format(format), None, &options);
        debug_assert!(done.is_ok(), "encoding to memory failed: {done:?}");
    }
    blocks.resize(format.bytes(size.width, size.height) as usize, 0);
    blocks
}

fn dds_format(format: PlaneFormat) -> dds::Format {
    match format {
        PlaneFormat::Bc1 => dds::Format::BC1_UNORM,
        PlaneFormat::Bc3 => dds::Format::BC3_UNORM,
        PlaneFormat::Bc4 => dds::Format::BC4_UNORM,
        PlaneFormat::Bc5 => dds::Format::BC5_UNORM,
        _ => dds::Format::BC7_UNORM,
    }
}

/// The texels of one block, row by row.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "BC blocks decode without an allocation")]
pub enum BlockTexels {
    /// Of a BC block, or a single texel repeated.
    Sixteen([Vec4; 16]),
    /// Of a block of another side.
    Other(Vec<Vec4>),
}

impl Deref for BlockTexels {
    type Target = [Vec4];

    #[inline]
    fn deref(&self) -> &[Vec4] {
        match self {
            BlockTexels::Sixteen(texels) => texels,
            BlockTexels::Other(texels) => texels,
        }
    }
}

/// The texels of one stored block, row by row: as many as its format's side squared, and at least 16. Missing channels are
/// 0, missing alpha is 1. Bytes missing from `block` count as 0.
#[must_use]
pub fn decode_block(format: PlaneFormat, block: &[u8]) -> BlockTexels {
    match format {
        PlaneFormat::Astc(side) => BlockTexels::Other(astc::decode(side, block)),
        _ => BlockTexels::Sixteen(decode_sixteen(format, block)),
    }
}

fn decode_sixteen(format: PlaneFormat, block: &[u8]) -> [Vec4; 16] {
    let byte = |index: usize| f32::from(block.get(index).copied().unwrap_or(0));
    match format {
        PlaneFormat::R8Unorm => [Vec4::new(byte(0) / 255.0, 0.0, 0.0, 1.0); 16],
        PlaneFormat::Rg8Unorm => [Vec4::new(byte(0) / 255.0, byte(1) / 255.0, 0.0, 1.0); 16],
        PlaneFormat::Rg8Uint => [Vec4::new(byte(0), byte(1), 0.0, 1.0); 16],
        PlaneFormat::R32Uint | PlaneFormat::Rgba32Uint | PlaneFormat::Rgba8Unorm => {
            [Vec4::new(byte(0), byte(1), byte(2), byte(3)) / 255.0; 16]
        }
        PlaneFormat::Bc1 => decode_bc1(first_eight(block, 0), false),
        PlaneFormat::Bc3 => {
            let (alpha, mut texels) =
                (decode_bc4(first_eight(block, 0)), decode_bc1(first_eight(block, 8), true));
            texels.iter_mut().zip(alpha).for_each(|(texel, alpha)| texel.w = alpha);
            texels
        }
        PlaneFormat::Bc4 => decode_bc4(first_eight(block, 0)).map(|red| Vec4::new(red, 0.0, 0.0, 1.0)),
        PlaneFormat::Bc5 => {
            let (red, green) = (decode_bc4(first_eight(block, 0)), decode_bc4(first_eight(block, 8)));
            std::array::from_fn(|i| Vec4::new(red[i], green[i], 0.0, 1.0))
        }
        _ => decode_bc7(block),
    }
}

fn first_eight(block: &[u8], start: usize) -> [u8; 8] {
    std::array::from_fn(|i| block.get(start + i).copied().unwrap_or(0))
}

fn decode_bc1(block: [u8; 8], always_four: bool) -> [Vec4; 16] {
    let (low, high) = (u16::from_le_bytes([block[0], block[1]]), u16::from_le_bytes([block[2], block[3]]));
    let (a, b) = (unpack_565(low), unpack_565(high));
    let palette = if always_four || low > high {
        [a, b, (a * 2.0 + b) / 3.0, (a + b * 2.0) / 3.0]
    } else {
        [a, b, (a + b) * 0.5, Vec4::ZERO]
    };
    let selectors = u32::from_le_bytes([block[4], block[5], block[6], block[7]]);
    std::array::from_fn(|i| palette[(selectors >> (2 * i) & 3) as usize])
}

fn unpack_565(value: u16) -> Vec4 {
    let field =
        |shift: u32, bits: u32| f32::from(value >> shift & ((1 << bits) - 1)) / ((1 << bits) - 1) as f32;
    Vec4::new(field(11, 5), field(5, 6), field(0, 5), 1.0)
}

fn decode_bc4(block: [u8; 8]) -> [f32; 16] {
    let (a, b) = (f32::from(block[0]) / 255.0, f32::from(block[1]) / 255.0);
    let level = |code: u64| match (code, block[0] > block[1]) {
        (0, _) => a,
        (1, _) => b,
        (code, true) => (a * (8 - code) as f32 + b * (code - 1) as f32) / 7.0,
        (6, false) => 0.0,
        (7, false) => 1.0,
        (code, false) => (a * (6 - code) as f32 + b * (code - 1) as f32) / 5.0,
    };
    let codes = u64::from_le_bytes(block) >> 16;
    std::array::from_fn(|i| level(codes >> (3 * i) & 7))
}

fn decode_bc7(block: &[u8]) -> [Vec4; 16] {
    let mut rgba = [0u8; 64];
    let bytes: [u8; 16] = std::array::from_fn(|i| block.get(i).copied().unwrap_or(0));
    if let Some(view) = ImageViewMut::new(&mut rgba, Size::new(4, 4), ColorFormat::RGBA_U8) {
        let done =
            dds::decode(&mut bytes.as_slice(), view, dds::Format::BC7_UNORM, &dds::DecodeOptions::default());
        debug_assert!(done.is_ok(), "any 16 bytes are a BC7 block: {done:?}");
    }
    std::array::from_fn(|i| {
        let texel = &rgba[4 * i..4 * i + 4];
        Vec4::from_array(std::array::from_fn(|channel| f32::from(texel[channel]) / 255.0))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Decoders may round BC1 to BC5 differently by this much (Direct3D 11.3 specification, 19.5).
    const ROUNDING: f32 = 2.0 / 255.0;

    fn largest_difference(texels: &[Vec4], other: &[u8], channels: &[usize]) -> f32 {
        let stride = other.len() / 16;
        let difference = |i: usize, channel: usize, plane: usize| {
            (texels[i][channel] - f32::from(other[i * stride + plane]) / 255.0).abs()
        };
        (0..16)
            .flat_map(|i| {
                channels.iter().enumerate().map(move |(plane, &channel)| difference(i, channel, plane))
            })
            .fold(0.0, f32::max)
    }

    proptest! {
        #[test]
        fn any_bytes_decode_as_an_independent_decoder_says(bytes in proptest::array::uniform16(any::<u8>())) {
            let mut rgba = [0u8; 64];
            bcdec_rs::bc1(&bytes[..8], &mut rgba, 16);
            prop_assert!(largest_difference(&decode_block(PlaneFormat::Bc1, &bytes), &rgba, &[0, 1, 2, 3]) <= ROUNDING);
            bcdec_rs::bc3(&bytes, &mut rgba, 16);
            prop_assert!(largest_difference(&decode_block(PlaneFormat::Bc3, &bytes), &rgba, &[0, 1, 2, 3]) <= ROUNDING);
            let mut red = [0u8; 16];
            bcdec_rs::bc4(&bytes[..8], &mut red, 4, false);
            prop_assert!(largest_difference(&decode_block(PlaneFormat::Bc4, &bytes), &red, &[0]) <= ROUNDING);
            let mut two = [0u8; 32];
            bcdec_rs::bc5(&bytes, &mut two, 8, false);
            prop_assert!(largest_difference(&decode_block(PlaneFormat::Bc5, &bytes), &two, &[0, 1]) <= ROUNDING);
            bcdec_rs::bc7(&bytes, &mut rgba, 16);
            prop_assert!(largest_difference(&decode_block(PlaneFormat::Bc7, &bytes), &rgba, &[0, 1, 2, 3]) < 1e-6);
        }
    }

    #[test]
    fn every_format_reproduces_a_flat_block() {
        let rgba = [90u8, 160, 30, 255].repeat(25);
        for format in
            [PlaneFormat::Bc1, PlaneFormat::Bc3, PlaneFormat::Bc4, PlaneFormat::Bc5, PlaneFormat::Bc7]
        {
            for effort in [Effort::Fast, Effort::Normal] {
                let blocks = encode_plane(format, 5, 5, &rgba, effort);
                assert_eq!(blocks.len() as u64, format.bytes(5, 5));
                let texel = decode_block(format, &blocks)[5];
                assert!((texel.x - 90.0 / 255.0).abs() < 4.5 / 255.0, "{format:?} {effort:?}: {texel}");
            }
        }
    }
}
