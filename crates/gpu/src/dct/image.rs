//! A texture in blocks on the GPU.

use texfold_core::{DctLayout, GpuDct};
use texfold_shaders::DctChannel;
use wgpu::{Buffer, BufferUsages};

use crate::{Gpu, GpuError};

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
        let streams = texfold_shaders::streams(blocks);
        let words: &[u8] = bytemuck::cast_slice(&blocks.words);
        let limit = gpu.device.limits().max_storage_buffer_binding_size;
        for bytes in [streams.len() as u64, words.len() as u64] {
            if bytes > limit {
                return Err(GpuError::StorageTooLarge { bytes, limit });
            }
        }
        gpu.guarded(|| {
            let words = gpu.buffer("words of blocks", words, BufferUsages::STORAGE);
            let streams = gpu.buffer("streams of blocks", &streams, BufferUsages::STORAGE);
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
        DctChannel::colours(&self.layout)
    }
}
