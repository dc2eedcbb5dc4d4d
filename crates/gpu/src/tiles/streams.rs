//! Buffers of compressed streams, each within one binding of the device.

use std::ops::Range;

use range_alloc::RangeAllocator;
use wgpu::{Buffer, BufferUsages};

use super::pipelines::STEP_BYTES;
use crate::Gpu;

/// The words that all stages share, then words of each stage, and streams; further buffers hold streams alone. Words of all buffers are
/// counted through.
#[derive(Debug)]
pub(super) struct Streams {
    parts: Vec<Part>,
}

#[derive(Debug)]
struct Part {
    buffer: Buffer,
    /// All of its words.
    words: Range<u32>,
    free: RangeAllocator<u32>,
}

impl Streams {
    /// Buffers of so many bytes, of at most `binding_bytes` each.
    pub(super) fn new(gpu: &Gpu, bytes: u64, binding_bytes: u64) -> Streams {
        let shared = texfold_shaders::DCT_TABLES;
        // A place in the streams is 32 bits of bytes.
        let all = (bytes.min(u64::from(u32::MAX)) / 4).max(u64::from(shared)) as u32;
        let most = ((binding_bytes / 4).min(u64::from(all)) as u32).max(shared);
        let part = |start: u32| {
            let words = start..all.min(start.saturating_add(most));
            let first = if start == 0 { shared } else { start };
            let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("streams of tiles"),
                size: 4 * words.len() as u64,
                usage: BufferUsages::STORAGE | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            Part { buffer, free: RangeAllocator::new(first..words.end), words }
        };
        Streams { parts: (0..all).step_by(most as usize).map(part).collect() }
    }

    pub(super) fn buffers(&self) -> impl Iterator<Item = &Buffer> {
        self.parts.iter().map(|part| &part.buffer)
    }

    /// The step that reads the streams of each buffer: its first byte, and how many it has.
    pub(super) fn steps(&self) -> impl Iterator<Item = [u32; STEP_BYTES as usize / 4]> {
        self.parts.iter().map(|part| [0, 4 * part.words.start, 4 * part.words.len() as u32])
    }

    /// Room for words of a stage, which must lie in the first buffer.
    pub(super) fn allocate_words(&mut self, count: usize) -> Option<Range<u32>> {
        self.parts.first_mut()?.free.allocate_range(u32::try_from(count).ok()?).ok()
    }

    /// Room for streams of so many words: in the last buffers, as long as there is some.
    pub(super) fn allocate_streams(&mut self, count: usize) -> Option<Range<u32>> {
        let count = u32::try_from(count).ok()?;
        self.parts.iter_mut().rev().find_map(|part| part.free.allocate_range(count).ok())
    }

    pub(super) fn free(&mut self, range: Range<u32>) {
        let holds = |part: &&mut Part| part.words.contains(&range.start);
        if let Some(part) = self.parts.iter_mut().find(holds) {
            part.free.free_range(range);
        }
    }

    /// Writes whole words from that one on, which lie in one buffer.
    pub(super) fn write(&self, gpu: &Gpu, word: u32, bytes: &[u8]) {
        if let Some(part) = self.parts.iter().find(|part| part.words.contains(&word)) {
            gpu.queue.write_buffer(&part.buffer, 4 * u64::from(word - part.words.start), bytes);
        }
    }
}
