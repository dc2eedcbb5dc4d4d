//! Textures that draws look at, by which a program loads files and lets go of them.

use std::ops::Range;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use wgpu::{Buffer, BufferAsyncError, BufferUsages, MapMode};

use super::rows::FEEDBACK_BYTES;
use super::{TileCache, TileTexture};
use crate::adapter::mapped;
use crate::{Gpu, GpuError};

/// Bytes of the feedback that are copied before the marks: the number of the frame, padded.
const HEAD: u64 = 16;
/// Frames within which every pixel marks what it reads, where one of 8 x 8 does in each.
const CYCLE: u32 = 64;

/// A texture whose tiles draws have looked at. The smallest levels, which are always there, don't count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileUse {
    /// The texture.
    pub texture: TileTexture,
    /// The finest level that was looked at, in the 64 frames up to the last one in which any was.
    pub level: u32,
    /// Frames since then: 0 where the last draws looked at it.
    pub frames: u32,
}

/// Marks of all frames up to some frame, on their way from the GPU.
#[derive(Debug)]
pub struct TileWatch {
    copy: Buffer,
    mapped: Receiver<Result<(), BufferAsyncError>>,
    /// Textures, with the pages of each level.
    held: Vec<(TileTexture, Vec<Range<u32>>)>,
}

impl TileCache {
    /// Begins to read which textures were looked at, those included that [`TileCache::add_coarse`] added. Copies 4 bytes a page; once in some frames is
    /// enough.
    ///
    /// # Errors
    /// [`GpuError::Lost`], [`GpuError`] where the device refuses.
    pub fn watch(&self, gpu: &Gpu) -> Result<TileWatch, GpuError> {
        let pages = 4 * u64::from(self.options.pages);
        let of = |(number, held): (u32, &Option<super::Held>)| {
            held.as_ref().map(|held| (TileTexture(number), held.levels()))
        };
        gpu.guarded(|| {
            let copy = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("marks of tiles"),
                size: HEAD + pages,
                usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
                mapped_at_creation: false,
            });
            let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let feedback = &self.buffers.feedback;
            encoder.copy_buffer_to_buffer(feedback, 0, &copy, 0, Some(HEAD));
            encoder.copy_buffer_to_buffer(feedback, FEEDBACK_BYTES, &copy, HEAD, Some(pages));
            gpu.queue.submit([encoder.finish()]);
            let (sender, mapped) = channel();
            copy.map_async(MapMode::Read, .., move |done| {
                // Nobody may wait for it any more.
                let _ = sender.send(done);
            });
            Ok(TileWatch { copy, mapped, held: (0..).zip(&self.held).filter_map(of).collect() })
        })
    }
}

impl TileWatch {
    /// The textures that were looked at; `None` while the GPU has not come to the copy. Does not wait. A watch answers once.
    ///
    /// # Errors
    /// [`GpuError::Lost`], also where it has answered already.
    pub fn poll(&self, gpu: &Gpu) -> Result<Option<Vec<TileUse>>, GpuError> {
        gpu.device.poll(wgpu::PollType::Poll).map_err(|_| GpuError::Lost)?;
        match self.mapped.try_recv() {
            Err(TryRecvError::Empty) => return Ok(None),
            Ok(Ok(())) => {}
            Ok(Err(_)) | Err(TryRecvError::Disconnected) => return Err(GpuError::Lost),
        }
        let view = mapped(&self.copy)?;
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(&view);
        drop(view);
        self.copy.unmap();
        let (head, marks) = words.split_at(HEAD as usize / 4);
        // The number is that of the next frame where an update has followed the draws.
        let next = head[0];
        let uses = self.held.iter().filter_map(|(texture, levels)| used(*texture, levels, marks, next));
        Ok(Some(uses.collect()))
    }
}

/// A texture's use, by the frames in which its pages were marked: 0 for never.
fn used(texture: TileTexture, levels: &[Range<u32>], marks: &[u32], next: u32) -> Option<TileUse> {
    let last = |pages: &Range<u32>| {
        marks[pages.start as usize..pages.end as usize].iter().copied().max().unwrap_or_default()
    };
    let latest = levels.iter().map(last).max().filter(|&latest| latest > 0)?;
    let level = levels.iter().map(last).position(|marked| marked > 0 && latest - marked < CYCLE)? as u32;
    Some(TileUse { texture, level, frames: next.saturating_sub(latest + 1) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_finest_level_of_the_last_frames_counts() {
        let levels = [0..4, 4..5];
        let of = |marks: [u32; 5]| used(TileTexture(3), &levels, &marks, 201);
        assert_eq!(of([0; 5]), None);
        let found = |level, frames| Some(TileUse { texture: TileTexture(3), level, frames });
        assert_eq!(of([0, 0, 190, 0, 200]), found(0, 0));
        assert_eq!(of([0, 0, 136, 0, 200]), found(1, 0));
        assert_eq!(of([0, 0, 137, 0, 200]), found(0, 0));
        assert_eq!(of([0, 0, 0, 0, 150]), found(1, 50));
        assert_eq!(of([0, 0, 0, 0, 9]), found(1, 191));
    }
}
