//! Choosing an adapter and opening a device.

use std::sync::OnceLock;

use texfold_core::PlaneFormat;
use wgpu::{Adapter, AdapterInfo, Device, DeviceType, Features, Limits, Queue};

use crate::layouts::Layouts;
#[cfg(feature = "offscreen")]
use crate::offscreen::Pipelines;
use crate::{DctDecoder, GpuError, ModuleInfo};

/// Features that a device has where its adapter has them: formats of content, and timestamps for [`Gpu::measure`].
const OPTIONAL: Features = Features::TEXTURE_COMPRESSION_BC
    .union(Features::TIMESTAMP_QUERY)
    .union(Features::TIMESTAMP_QUERY_INSIDE_ENCODERS);

/// Whether a GPU may be used, and whether work may be left out without one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Policy {
    /// Use one where there is one; tests and benches leave out what needs it otherwise.
    #[default]
    IfPresent,
    /// Use none.
    Off,
    /// There must be one: tests and benches fail otherwise.
    Require,
}

impl Policy {
    /// From the environment variable `TEXFOLD_GPU`: "off", "require", anything else or nothing.
    #[must_use]
    pub fn from_env() -> Policy {
        match std::env::var("TEXFOLD_GPU").as_deref() {
            Ok("off") => Policy::Off,
            Ok("require") => Policy::Require,
            _ => Policy::IfPresent,
        }
    }
}

/// A device, and what was made for it so far: bind group layouts, the decoder of textures in blocks.
#[derive(Debug)]
pub struct Gpu {
    pub(crate) device: Device,
    pub(crate) queue: Queue,
    pub(crate) layouts: Layouts,
    #[cfg(feature = "offscreen")]
    pub(crate) offscreen: Pipelines,
    /// What decodes textures in blocks, made for the first of them.
    blocks: OnceLock<DctDecoder>,
}

impl Gpu {
    /// Opens the fastest adapter there is; software rendering counts as the slowest.
    ///
    /// # Errors
    /// [`GpuError`] where the policy is [`Policy::Off`] or there is no adapter.
    pub fn new(policy: Policy) -> Result<Gpu, GpuError> {
        if policy == Policy::Off {
            return Err(GpuError::Off);
        }
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
        let adapter = adapters.into_iter().min_by_key(rank).ok_or(GpuError::NoAdapter)?;
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("texfold"),
            required_features: adapter.features() & OPTIONAL,
            required_limits: Limits {
                // For materials: a texture has up to 11 planes, and WebGPU guarantees 16 a shader.
                max_sampled_textures_per_shader_stage: adapter.limits().max_sampled_textures_per_shader_stage,
                // For caches of tiles: 8 is what WebGPU guarantees; large ones take larger buffers.
                max_storage_buffers_per_shader_stage: adapter
                    .limits()
                    .max_storage_buffers_per_shader_stage
                    .min(8),
                max_storage_buffer_binding_size: adapter.limits().max_storage_buffer_binding_size,
                max_buffer_size: adapter.limits().max_buffer_size,
                ..Limits::downlevel_defaults().using_resolution(adapter.limits())
            },
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))?;
        Ok(Gpu::from_device(device, queue))
    }

    /// Uses a renderer's own device. Give it [`Features::TEXTURE_COMPRESSION_BC`] for textures with BC content.
    #[must_use]
    pub fn from_device(device: Device, queue: Queue) -> Gpu {
        Gpu {
            layouts: Layouts::new(&device),
            #[cfg(feature = "offscreen")]
            offscreen: Pipelines::new(&device),
            blocks: OnceLock::new(),
            device,
            queue,
        }
    }

    /// The decoder of textures in blocks.
    pub(crate) fn block_decoder(&self) -> Result<&DctDecoder, GpuError> {
        if let Some(decoder) = self.blocks.get() {
            return Ok(decoder);
        }
        let made = DctDecoder::new(self)?;
        Ok(self.blocks.get_or_init(|| made))
    }

    /// The device.
    #[must_use]
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// The device's queue.
    #[must_use]
    pub fn queue(&self) -> &Queue {
        &self.queue
    }

    /// Name, driver and kind of the adapter.
    #[must_use]
    pub fn info(&self) -> AdapterInfo {
        self.device.adapter_info()
    }

    /// Whether textures with BC content can be uploaded.
    #[must_use]
    pub fn has_block_compression(&self) -> bool {
        self.device.features().contains(Features::TEXTURE_COMPRESSION_BC)
    }

    /// Whether planes of that format can be uploaded.
    pub(crate) fn can_sample(&self, format: PlaneFormat) -> bool {
        format.block_side() == 1 || self.has_block_compression()
    }

    /// The bind group layout of a module's textures, for pipeline layouts of a renderer's own.
    #[must_use]
    pub fn bind_group_layout(&self, module: &'static ModuleInfo) -> &wgpu::BindGroupLayout {
        self.layouts.of(module)
    }

    /// Most texels a side of a texture on this device.
    pub(crate) fn side_limit(&self) -> u32 {
        self.device.limits().max_texture_dimension_2d
    }

    /// A buffer that holds `bytes`.
    pub(crate) fn buffer(&self, label: &str, bytes: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.len() as u64,
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    /// Submits `commands`, which fill `buffer`, waits for them and shows its bytes to `read`.
    ///
    /// # Errors
    /// [`GpuError::Lost`].
    pub(crate) fn map<T>(
        &self,
        commands: wgpu::CommandBuffer,
        buffer: &wgpu::Buffer,
        read: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, GpuError> {
        self.queue.submit([commands]);
        if !self.wait_to_read(buffer) {
            return Err(GpuError::Lost);
        }
        let view = mapped(buffer)?;
        let found = read(&view);
        drop(view);
        buffer.unmap();
        Ok(found)
    }

    /// Maps `buffer` for reading; false where that failed. The buffers of a lost device are invalid, which mapping alone reports.
    fn wait_to_read(&self, buffer: &wgpu::Buffer) -> bool {
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let (sender, receiver) = std::sync::mpsc::channel();
        buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            // Another thread's poll may call this, after this thread's poll.
            let _ = sender.send(result);
        });
        let waited = self.device.poll(wgpu::PollType::wait_indefinitely()).is_ok();
        let faults = pollster::block_on(scope.pop());
        waited && faults.is_none() && matches!(receiver.recv(), Ok(Ok(())))
    }

    /// True for a lost device: a fresh buffer cannot be mapped.
    fn is_lost(&self) -> bool {
        let (size, usage) = (4, wgpu::BufferUsages::MAP_READ);
        let probe = wgpu::BufferDescriptor { label: Some("probe"), size, usage, mapped_at_creation: false };
        !self.wait_to_read(&self.device.create_buffer(&probe))
    }

    /// Does `work` and turns what the device reports meanwhile into an error.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::Lost`], [`GpuError::Refused`], or the error of `work`.
    pub(crate) fn guarded<T>(&self, work: impl FnOnce() -> Result<T, GpuError>) -> Result<T, GpuError> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let done = work();
        let refused = pollster::block_on(validation.pop());
        let exhausted = pollster::block_on(memory.pop());
        match (exhausted, refused) {
            (Some(error), _) => Err(GpuError::OutOfMemory(error)),
            (None, Some(_)) if self.is_lost() => Err(GpuError::Lost),
            (None, Some(error)) => Err(GpuError::Refused(error)),
            (None, None) => done,
        }
    }
}

/// Order of preference; lower is better.
fn rank(adapter: &Adapter) -> u32 {
    match adapter.get_info().device_type {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    }
}

/// The bytes of a buffer that is mapped.
///
/// # Errors
/// [`GpuError::Lost`] where it is not.
pub(crate) fn mapped(buffer: &wgpu::Buffer) -> Result<wgpu::BufferView, GpuError> {
    #[cfg(feature = "wgpu29")]
    return Ok(buffer.get_mapped_range(..));
    #[cfg(not(feature = "wgpu29"))]
    buffer.get_mapped_range(..).map_err(|_| GpuError::Lost)
}
