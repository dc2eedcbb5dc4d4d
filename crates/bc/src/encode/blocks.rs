//! Encoding of planes: BC1 by texpresso (cluster fit), the other block formats by the `dds` crate, bands of blocks in parallel.

use dds::{ColorFormat, CompressionQuality, EncodeOptions, ErrorMetric, ImageView, Size};
use rayon::prelude::*;
use texfold_core::{CancelCheck, Effort, PlaneFormat};

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
pub(super) fn encode_cancellable(
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode_block;

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
