//! Off-screen targets, and their pixels back in memory.

use wgpu::{BufferUsages, CommandEncoder, Texture, TextureFormat, TextureUsages};

use crate::upload::extent;
use crate::{Gpu, GpuError};

/// Rows of a buffer that a texture is copied to are multiples of this.
const ROW_ALIGNMENT: u32 = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT;

/// Most bytes that are read back in one piece: a buffer of that size is free on every device.
const BAND_BYTES: u64 = 64 << 20;

impl Gpu {
    /// A texture to draw into.
    pub(crate) fn target(&self, format: TextureFormat, (width, height): (u32, u32)) -> Texture {
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("target"),
            size: extent(width, height),
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: TextureUsages::RENDER_ATTACHMENT
                | TextureUsages::COPY_SRC
                | TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        })
    }

    /// Submits `encoder` and hands `target`'s rows to `row`, from the top: each its number and its bytes.
    pub(crate) fn read_rows(
        &self,
        mut encoder: CommandEncoder,
        target: &Texture,
        mut row: impl FnMut(u32, &[u8]),
    ) -> Result<(), GpuError> {
        let texel_bytes = target.format().block_copy_size(None).unwrap_or(4);
        let row_bytes = target.width() * texel_bytes;
        let padded = row_bytes.next_multiple_of(ROW_ALIGNMENT);
        let band = (BAND_BYTES / u64::from(padded)).clamp(1, u64::from(target.height())) as u32;
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("readback"),
            size: u64::from(padded) * u64::from(band),
            usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut top = 0;
        while top < target.height() {
            let rows = band.min(target.height() - top);
            copy_band(&mut encoder, target, &buffer, padded, top..top + rows);
            let next = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let commands = std::mem::replace(&mut encoder, next).finish();
            self.map(commands, &buffer, |bytes| {
                let lines = bytes.chunks_exact(padded as usize).take(rows as usize);
                (top..).zip(lines).for_each(|(y, line)| row(y, &line[..row_bytes as usize]));
            })?;
            top += rows;
        }
        Ok(())
    }
}

fn copy_band(
    encoder: &mut CommandEncoder,
    target: &Texture,
    buffer: &wgpu::Buffer,
    bytes_per_row: u32,
    rows: std::ops::Range<u32>,
) {
    let origin = wgpu::Origin3d { x: 0, y: rows.start, z: 0 };
    let layout =
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(bytes_per_row), rows_per_image: None };
    encoder.copy_texture_to_buffer(
        wgpu::TexelCopyTextureInfo { origin, ..target.as_image_copy() },
        wgpu::TexelCopyBufferInfo { buffer, layout },
        extent(target.width(), rows.end - rows.start),
    );
}
