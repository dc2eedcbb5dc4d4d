//! A texture in blocks on the GPU.

use texfold_core::{DctLayout, GpuChannel, GpuDct};
use wgpu::{Buffer, BufferUsages};

use crate::{Gpu, GpuError};

/// What a channel of a decoded texture holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DctChannel {
    /// The channel of that number.
    Channel(u8),
    /// Nothing.
    Zero,
    /// The largest sample.
    One,
}

/// A texture in blocks on the GPU: its streams as they are stored.
#[derive(Debug)]
pub struct DctImage {
    pub(super) layout: DctLayout,
    /// Constants, tables, steps, index.
    pub(super) words: Buffer,
    pub(super) streams: Buffer,
}

impl DctImage {
    pub(super) fn new(gpu: &Gpu, blocks: &GpuDct<'_>) -> Result<DctImage, GpuError> {
        // The shader reads bytes as parts of two words.
        let padded = blocks.streams.len().next_multiple_of(4) + 8;
        let words: &[u8] = bytemuck::cast_slice(&blocks.words);
        let limit = gpu.device.limits().max_storage_buffer_binding_size;
        for bytes in [padded as u64, words.len() as u64] {
            if bytes > limit {
                return Err(GpuError::StorageTooLarge { bytes, limit });
            }
        }
        gpu.guarded(|| {
            let words = gpu.buffer("words of blocks", words, BufferUsages::STORAGE);
            let streams = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("streams of blocks"),
                size: padded as u64,
                usage: BufferUsages::STORAGE | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            let (whole, rest) = blocks.streams.split_at(blocks.streams.len() / 4 * 4);
            let mut last = [0; 4];
            last[..rest.len()].copy_from_slice(rest);
            gpu.queue.write_buffer(&streams, 0, whole);
            gpu.queue.write_buffer(&streams, whole.len() as u64, &last);
            Ok(DctImage { layout: blocks.layout.clone(), words, streams })
        })
    }

    /// How its planes are cut.
    #[must_use]
    pub fn layout(&self) -> &DctLayout {
        &self.layout
    }

    /// Bytes that it takes on the GPU.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.words.size() + self.streams.size()
    }

    /// The channels as an image shows them: gray or colours, and alpha where there are two or four.
    #[must_use]
    pub fn colours(&self) -> [DctChannel; 4] {
        colours(&self.layout)
    }
}

/// The channels of a texture as an image shows them.
pub(crate) fn colours(layout: &DctLayout) -> [DctChannel; 4] {
    use DctChannel::{Channel, One};
    match layout.channels.len() {
        1 => [Channel(0), Channel(0), Channel(0), One],
        2 => [Channel(0), Channel(0), Channel(0), Channel(1)],
        3 => [Channel(0), Channel(1), Channel(2), One],
        _ => [Channel(0), Channel(1), Channel(2), Channel(3)],
    }
}

/// The shader's parameters of those channels.
pub(crate) fn channels_of(
    layout: &DctLayout,
    channels: [DctChannel; 4],
) -> Result<[GpuChannel; 4], GpuError> {
    let constant = |value: i32| GpuChannel { mean: value << layout.shift, first_axis: 0, weights: [0; 4] };
    let mut found = [constant(0); 4];
    for (found, channel) in found.iter_mut().zip(channels) {
        *found = match channel {
            DctChannel::Zero => constant(0),
            DctChannel::One => constant((1 << layout.depth) - 1),
            DctChannel::Channel(channel) => {
                let channels = layout.channels.len();
                let known = layout.channels.get(usize::from(channel)).copied();
                known.ok_or(GpuError::NoSuchChannel { channel, channels })?
            }
        };
    }
    Ok(found)
}
