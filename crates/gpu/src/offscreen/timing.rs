//! Time of drawing, beside that of the same loads alone and of a plain texture.

use std::time::{Duration, Instant};

use texfold_core::ImageSize;
use texfold_shaders::Entry;
use wgpu::{BindGroup, Features, RenderPipeline, TextureFormat};

use super::pipeline::{PipelineKey, Shader};
use super::view::{check, cover};
use crate::{Filter, Gpu, GpuError, GpuTexture, Lookup, View};

/// Which shader is timed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Probe {
    /// The view's own lookup.
    Lookup,
    /// The same number of loads as the lookup, with the same dependences between them, and only the arithmetic that these need.
    LoadsOnly,
    /// Level 0 of the image as plain RGBA8, through the hardware's bilinear sampler.
    Plain,
}

/// One shader, ready to draw.
struct Run {
    pipeline: RenderPipeline,
    textures: BindGroup,
    job: BindGroup,
}

/// Bytes of two timestamps.
const TIMESTAMPS: u64 = 2 * wgpu::QUERY_SIZE as u64;

impl Gpu {
    /// Time that the device takes for the commands that `record` records: by timestamps where [`Gpu::has_timestamps`], else
    /// by the wall clock from their submission to the device's answer.
    ///
    /// # Errors
    /// [`GpuError::Lost`], [`GpuError::OutOfMemory`], or [`GpuError::Refused`] for commands that are not valid.
    pub fn measure(&self, record: impl FnOnce(&mut wgpu::CommandEncoder)) -> Result<Duration, GpuError> {
        self.guarded(|| {
            let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            if !self.has_timestamps() {
                record(&mut encoder);
                let start = Instant::now();
                self.queue.submit([encoder.finish()]);
                self.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|_| GpuError::Lost)?;
                return Ok(start.elapsed());
            }
            let queries = self.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count: 2,
            });
            let buffer = |usage| {
                let descriptor = wgpu::BufferDescriptor {
                    label: Some("timestamps"),
                    size: TIMESTAMPS,
                    usage,
                    mapped_at_creation: false,
                };
                self.device.create_buffer(&descriptor)
            };
            let resolved = buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC);
            let readable = buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ);
            encoder.write_timestamp(&queries, 0);
            record(&mut encoder);
            encoder.write_timestamp(&queries, 1);
            encoder.resolve_query_set(&queries, 0..2, &resolved, 0);
            encoder.copy_buffer_to_buffer(&resolved, 0, &readable, 0, TIMESTAMPS);
            let ticks = self.map(encoder.finish(), &readable, |bytes| {
                let mut ticks = [0u64; 2];
                bytemuck::bytes_of_mut(&mut ticks).copy_from_slice(bytes);
                ticks[1].saturating_sub(ticks[0])
            })?;
            let nanoseconds = ticks as f64 * f64::from(self.queue.get_timestamp_period());
            Ok(Duration::from_secs_f64(nanoseconds / 1e9))
        })
    }

    /// True where [`Gpu::measure`] reads timestamps: on GPUs that have them, not in software.
    #[must_use]
    pub fn has_timestamps(&self) -> bool {
        let needed = Features::TIMESTAMP_QUERY | Features::TIMESTAMP_QUERY_INSIDE_ENCODERS;
        self.device.features().contains(needed) && self.info().device_type != wgpu::DeviceType::Cpu
    }

    /// Seconds that one drawing of `view` takes, the mean of `repeats` in one submission after one to warm up, by
    /// [`Gpu::measure`].
    ///
    /// # Errors
    /// [`GpuError`] as in drawing; views may have as many pixels a side as a texture of the device.
    pub fn time(
        &self,
        texture: &GpuTexture,
        view: &View,
        probe: Probe,
        repeats: u32,
    ) -> Result<f64, GpuError> {
        check(texture, view)?;
        let ((width, height), limit) = (view.size, self.side_limit());
        if width > limit || height > limit {
            return Err(GpuError::ImageSize { width, height, limit });
        }
        let run = self.prepare(texture, view, probe)?;
        self.guarded(|| {
            let target = self.target(TextureFormat::Rgba8Unorm, view.size);
            let target = target.create_view(&wgpu::TextureViewDescriptor::default());
            let timed = |repeats: u32| {
                self.measure(|encoder| {
                    for _ in 0..repeats {
                        cover(encoder, &target, &run.pipeline, [&run.textures, &run.job]);
                    }
                })
            };
            timed(1)?;
            Ok(timed(repeats.max(1))?.as_secs_f64() / f64::from(repeats.max(1)))
        })
    }

    fn prepare(&self, texture: &GpuTexture, view: &View, probe: Probe) -> Result<Run, GpuError> {
        let (textures, place) = texture.bind_group(view.image)?;
        let params = view.params(place, (0, 0));
        let (shader, textures) = match probe {
            Probe::Lookup => (view.lookup.shader_of(texture), textures.clone()),
            Probe::LoadsOnly => {
                let loads = match view.lookup {
                    // The source's texels are blended from those of a smaller plane.
                    Lookup::Bilinear { .. } => 4,
                    Lookup::Fetch { .. } | Lookup::Nearest { .. } | Lookup::NearestLinear { .. } => {
                        if texture.reduced() { 4 } else { 1 }
                    }
                    Lookup::Level { .. } | Lookup::Derivative => 8,
                };
                let (module, entry) = (texture.module(), Entry::LoadsOnly);
                (
                    Shader::View { module, entry, lookup: loads, switches: texture.switches() },
                    textures.clone(),
                )
            }
            Probe::Plain => (Shader::Plain, self.plain_group(texture, view.image)?),
        };
        let pipeline = self.pipeline(PipelineKey { shader, target: TextureFormat::Rgba8Unorm })?;
        Ok(Run { pipeline, textures, job: self.job_group(bytemuck::bytes_of(&params)) })
    }

    /// Level 0 of the image as a plain texture with a sampler.
    fn plain_group(&self, texture: &GpuTexture, image: u32) -> Result<BindGroup, GpuError> {
        let ImageSize { width, height } = texture.size(image)?;
        let pixels = self.decode_rgba8(texture, image, 0, (width, height), Filter::Nearest)?;
        self.guarded(|| {
            let plain = self.plain_texture((width, height), pixels.as_flattened());
            let sampler = self.device.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            });
            let view = plain.create_view(&wgpu::TextureViewDescriptor::default());
            Ok(self.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("plain"),
                layout: &self.offscreen.plain,
                entries: &[
                    wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) },
                    wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&sampler) },
                ],
            }))
        })
    }

    fn plain_texture(&self, (width, height): (u32, u32), rgba: &[u8]) -> wgpu::Texture {
        let size = crate::upload::extent(width, height);
        let texture = self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("plain"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * width), rows_per_image: None };
        self.queue.write_texture(texture.as_image_copy(), rgba, layout, size);
        texture
    }
}
