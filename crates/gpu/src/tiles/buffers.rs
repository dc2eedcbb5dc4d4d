//! Buffers of a cache of tiles.

use wgpu::{Buffer, BufferUsages};

use super::rows::{FEEDBACK_BYTES, PLAN_BYTES, PLANES, StageRow, TextureRow};
use super::{TileOptions, row_bytes};
use crate::Gpu;

/// Buffers of a cache.
#[derive(Debug)]
pub(super) struct Buffers {
    pub(super) textures: Buffer,
    pub(super) pages: Buffer,
    pub(super) feedback: Buffer,
    pub(super) slots: Buffer,
    pub(super) stages: Buffer,
    pub(super) plan: Buffer,
    pub(super) workgroups: Buffer,
    pub(super) scratch: Buffer,
}

impl Buffers {
    /// Buffers for a pool of so many places.
    pub(super) fn new(gpu: &Gpu, options: &TileOptions, slots: u32) -> Buffers {
        let buffer = |label: &str, size: u64, usage: BufferUsages| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: size.max(4).next_multiple_of(4),
                usage: usage | BufferUsages::STORAGE | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let none = BufferUsages::empty();
        let pages = 4 * u64::from(options.pages);
        let dispatches = 12 * u64::from(3 + PLANES + options.textures);
        Buffers {
            textures: buffer("textures of tiles", row_bytes::<TextureRow>(options.textures), none),
            pages: buffer("pages of tiles", pages, none),
            feedback: buffer("feedback of tiles", FEEDBACK_BYTES + pages, BufferUsages::COPY_SRC),
            slots: buffer("places of tiles", 4 * u64::from(slots), none),
            stages: buffer("stages of tiles", row_bytes::<StageRow>(options.most_stages()), none),
            plan: buffer("plan of tiles", PLAN_BYTES, none),
            workgroups: buffer("workgroups of tiles", dispatches, BufferUsages::INDIRECT),
            scratch: buffer("scratch of tiles", options.scratch_bytes, none),
        }
    }

    pub(super) fn bytes(&self) -> u64 {
        let Buffers { textures, pages, feedback, slots, stages, plan, workgroups, scratch } = self;
        let all = [textures, pages, feedback, slots, stages, plan, workgroups, scratch];
        all.into_iter().map(Buffer::size).sum()
    }
}
