//! What a GPU's passes do, on the CPU: the functions of [`super`] in the order of the compute passes.

use glam::{IVec4, UVec2};
use texfold_core::{GpuChannel, GpuDct, Rect, RegionError};
use texfold_shaders::DctPlan;

use super::{
    DctView, texfold_block_add, texfold_block_channel, texfold_block_deblock, texfold_block_has_modes,
    texfold_block_row, texfold_block_samples, texfold_block_sum, texfold_block_superblock,
};

/// Texels of a rectangle as a GPU's passes give them; `rect.level` is 0.
///
/// # Errors
/// [`RegionError`] where the rectangle is empty or leaves the image.
pub fn decode(blocks: &GpuDct<'_>, rect: Rect) -> Result<Vec<u16>, RegionError> {
    let layout = &blocks.layout;
    let DctPlan { passes, words, .. } = DctPlan::new(layout, rect)?;
    let streams = stream_words(blocks.streams);
    let mut scratch = vec![0; words as usize];
    for pass in &passes {
        let view = &mut DctView { pass, words: &blocks.words, streams: &streams, scratch: &mut scratch };
        let [columns, rows] = pass.count;
        for number in 0..columns * rows {
            texfold_block_superblock(view, UVec2::new(number % columns, number / columns));
        }
        let slots = pass.held[0] * pass.held[1] * pass.axes;
        (0..slots).for_each(|slot| texfold_block_samples(view, slot));
        if texfold_block_has_modes(view) {
            for pair in 0..columns * rows * pass.axes {
                let (number, axis) = (pair / pass.axes, pair % pass.axes);
                let place = UVec2::new(number % columns, number / columns);
                for block in 0..pass.side * pass.side {
                    let lines: Vec<_> =
                        (0..8).map(|line| texfold_block_row(view, place, axis, block, line)).collect();
                    let sum = lines.iter().map(|&line| texfold_block_sum(line)).fold(0, i32::wrapping_add);
                    lines.into_iter().for_each(|line| texfold_block_add(view, line, sum));
                }
            }
        }
        if pass.deblocking > 0 {
            (0..slots).for_each(|slot| texfold_block_deblock(view, slot, 0));
            (0..slots).for_each(|slot| texfold_block_deblock(view, slot, 1));
        }
    }
    let Some(pass) = passes.last() else { return Ok(Vec::new()) };
    let view = &DctView { pass, words: &blocks.words, streams: &streams, scratch: &mut scratch };
    let first = UVec2::from(pass.first) * pass.side * 8;
    let largest = (1i32 << layout.depth) - 1;
    let texels = (0..rect.height).flat_map(|y| (0..rect.width).map(move |x| UVec2::new(x, y)));
    let channels = texels.flat_map(|at| layout.channels.iter().map(move |channel| (at, channel)));
    let value = |(at, channel): (UVec2, &GpuChannel)| {
        let (held, weights) = (at + UVec2::new(rect.x, rect.y) - first, IVec4::from(channel.weights));
        let GpuChannel { mean, first_axis, .. } = *channel;
        texfold_block_channel(view, held, mean, first_axis, weights, layout.shift, largest) as u16
    };
    Ok(channels.map(value).collect())
}

/// Bytes as words, the lowest first, and a word of zeros behind them.
fn stream_words(bytes: &[u8]) -> Vec<u32> {
    let word = |chunk: &[u8]| chunk.iter().rev().fold(0, |word, &byte| word << 8 | u32::from(byte));
    bytes.chunks(4).map(word).chain([0, 0]).collect()
}
