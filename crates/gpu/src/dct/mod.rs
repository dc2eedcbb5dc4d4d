//! Textures in blocks of variable length, decoded by compute passes into textures that the hardware samples.
//!
//! [`DctDecoder`] makes its pipelines once; [`DctDecoder::upload`] takes what an encoded texture hands out
//! ([`GpuDct`]) and [`DctDecoder::decode_into`] decodes any rectangle, or the same of two smaller mip levels, into any place of a texture, so that a
//! cache of tiles can be filled with it. An invocation a superblock reads its stream, of all planes that the rectangle needs at once. Then, for
//! each plane from the coarsest on, an invocation a block and axis makes its samples, and where the image is deblocked two more
//! filter its borders to the left and above; last, an invocation a texel makes its
//! channels. All in integers: the texels are the CPU's.
//!
//! Cost: 4.3 bytes of scratch memory a texel and axis, [`MAX_SCRATCH`] at most, kept by the decoder for all textures.
//! An H200 decodes 1.9 gigatexels/s of textures of 2048 texels a side: streams are read symbol by symbol, which takes most of the time.
//! On one core (`examples/dct.rs`, kodim08 and kodim19 at 0.9 to 2 bits) llvmpipe takes 10 to 14 times as long as the
//! CPU's decoder. More in `benches/gpu.md`.
//!
//! *Any bytes decode*: nothing is checked when a texture is uploaded. The shader looks for a stream's end before it reads, and whatever it
//! reads leads to places inside of its buffers and to loops of bounded length.

mod image;
mod pipelines;

use std::sync::{Mutex, PoisonError};

use texfold_core::{DctLayout, GpuChannel, GpuDct, ImageSize, Rect, RegionError};
use texfold_shaders::{BLOCK_STREAMS, DctPlan, DctTarget};
use wgpu::{BindingResource, Buffer, BufferBinding, BufferUsages, Texture, TextureUsages};

pub use image::{DctChannel, DctImage};
pub(crate) use image::{channels_of, colours};
use pipelines::{Pipelines, format_of};

use crate::upload::extent;
use crate::{Gpu, GpuError};

/// Most bytes of scratch memory that a decoder uses at once: half of what every WebGPU device binds. Larger rectangles are
/// decoded in parts.
pub const MAX_SCRATCH: u64 = 64 << 20;
/// Distance of the passes' parameters in their buffer: what every device allows.
const PASS_STRIDE: usize = 256;
/// Passes that are bound at once: one for each plane, of which images of 262144 texels a side have as many.
const PASSES: usize = 6;
/// Blocks and axes that a workgroup transforms.
const BLOCKS: u32 = 64;
/// Texels along the side of what a workgroup writes.
const TEXELS: u32 = 8;

/// The shader's parameters of `write_texels`: 36 words.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Output {
    size: [u32; 2],
    origin: [u32; 2],
    place: [u32; 2],
    shift: u32,
    largest: i32,
    means: [i32; 4],
    first_axes: [u32; 4],
    weights: [[i32; 4]; 4],
    last: [u32; 2],
    reduce_log2: u32,
    average: u32,
}

/// Pipelines that decode textures in blocks, and their scratch memory.
#[derive(Debug)]
pub struct DctDecoder {
    pipelines: Pipelines,
    /// Grows to what the largest rectangle needs.
    scratch: Mutex<Option<Buffer>>,
}

impl DctDecoder {
    /// Makes the pipelines.
    ///
    /// # Errors
    /// [`GpuError`] where the device has no compute shaders or refuses them.
    pub fn new(gpu: &Gpu) -> Result<DctDecoder, GpuError> {
        let pipelines = gpu.guarded(|| Ok(Pipelines::new(&gpu.device)))?;
        Ok(DctDecoder { pipelines, scratch: Mutex::new(None) })
    }

    /// Uploads a texture: its streams as they are stored, and 16 kB of tables.
    ///
    /// # Errors
    /// [`GpuError`] where the streams do not fit a buffer of the device, or the device refuses.
    pub fn upload(&self, gpu: &Gpu, blocks: &GpuDct<'_>) -> Result<DctImage, GpuError> {
        DctImage::new(gpu, blocks)
    }

    /// A rectangle as a texture of its own, `rgba8unorm` for samples of 8 bits and `rgba16uint` for more. `rect.level` is a
    /// mip level; `rect.image` is 0.
    ///
    /// # Errors
    /// [`GpuError`] where there is no such level or channel, the rectangle is empty, leaves the level or is larger than a texture
    /// of the device, or the device fails.
    pub fn decode(
        &self,
        gpu: &Gpu,
        image: &DctImage,
        rect: Rect,
        channels: [DctChannel; 4],
    ) -> Result<Texture, GpuError> {
        let (width, height, limit) = (rect.width, rect.height, gpu.side_limit());
        if width == 0 || height == 0 || width > limit || height > limit {
            return Err(GpuError::ImageSize { width, height, limit });
        }
        let texture = gpu.guarded(|| {
            Ok(gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("blocks"),
                size: extent(width, height),
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: format_of(plain(image.layout.depth)),
                usage: TextureUsages::STORAGE_BINDING
                    | TextureUsages::TEXTURE_BINDING
                    | TextureUsages::COPY_SRC,
                view_formats: &[],
            }))
        })?;
        self.decode_into(gpu, image, rect, channels, &texture, [0, 0])?;
        Ok(texture)
    }

    /// A rectangle into a texture of the format that [`DctDecoder::decode`] gives, or `rgba32float`, from `place` on. The texture allows
    /// [`TextureUsages::STORAGE_BINDING`].
    ///
    /// # Errors
    /// As [`DctDecoder::decode`], and where the texture has another format or the rectangle does not fit it.
    pub fn decode_into(
        &self,
        gpu: &Gpu,
        image: &DctImage,
        rect: Rect,
        channels: [DctChannel; 4],
        texture: &Texture,
        place: [u32; 2],
    ) -> Result<(), GpuError> {
        let fits = |place: u32, count: u32, all: u32| place.checked_add(count).is_some_and(|end| end <= all);
        let size = (texture.width(), texture.height());
        if !fits(place[0], rect.width, size.0) || !fits(place[1], rect.height, size.1) {
            return Err(RegionError::Outside { width: size.0, height: size.1 }.into());
        }
        let target = target_of(texture, image.layout.depth)?;
        let channels = channels_of(&image.layout, channels)?;
        let view = view_of(texture, 0);
        for (part, plan) in parts(&image.layout, rect)? {
            let place = [place[0] + part.x - rect.x, place[1] + part.y - rect.y];
            let output = output(&image.layout, part, plan.reduce_log2, &channels, place);
            gpu.guarded(|| self.submit(gpu, image, &plan, target, &[(output, &view)]))?;
        }
        Ok(())
    }

    /// An image and the levels that are made of it into those of a texture, from mip level `first` on; its streams are read once.
    ///
    /// # Errors
    /// As [`DctDecoder::decode_into`].
    pub fn decode_levels(
        &self,
        gpu: &Gpu,
        image: &DctImage,
        channels: [DctChannel; 4],
        texture: &Texture,
        (first, levels): (u32, u32),
    ) -> Result<(), GpuError> {
        let size = image.layout.size;
        let level_size = ImageSize { width: texture.width(), height: texture.height() }.at_level(first);
        if level_size != size || first + levels > texture.mip_level_count() {
            return Err(RegionError::Outside { width: level_size.width, height: level_size.height }.into());
        }
        let target = target_of(texture, image.layout.depth)?;
        let channels = channels_of(&image.layout, channels)?;
        let rect = Rect { image: 0, level: 0, x: 0, y: 0, width: size.width, height: size.height };
        let views: Vec<_> = (first..first + levels).map(|level| view_of(texture, level)).collect();
        for (part, plan) in parts(&image.layout, rect)? {
            let outputs = (0u32..).zip(&views).map(|(reduce_log2, view)| {
                let part = reduced(part, size, reduce_log2);
                (output(&image.layout, part, reduce_log2, &channels, [part.x, part.y]), view)
            });
            let outputs: Vec<_> = outputs.filter(|(output, _)| !output.size.contains(&0)).collect();
            gpu.guarded(|| self.submit(gpu, image, &plan, target, &outputs))?;
        }
        Ok(())
    }

    /// Does the passes of a plan and writes the outputs from what they decode.
    fn submit(
        &self,
        gpu: &Gpu,
        image: &DctImage,
        plan: &DctPlan,
        target: DctTarget,
        outputs: &[(Output, &wgpu::TextureView)],
    ) -> Result<(), GpuError> {
        let scratch = self.scratch(gpu, 4 * plan.words);
        // Behind the last one what is bound with it.
        let mut params = vec![0u8; PASS_STRIDE * (plan.passes.len() + PASSES - 1)];
        for (bytes, pass) in params.chunks_exact_mut(PASS_STRIDE).zip(&plan.passes) {
            let pass = bytemuck::bytes_of(pass);
            bytes[..pass.len()].copy_from_slice(pass);
        }
        let params = gpu.buffer("passes", &params, BufferUsages::UNIFORM);
        let passes = self.pipelines.pass_group(&gpu.device, &params, image, &scratch);
        let groups = outputs.iter().map(|(output, view)| {
            let buffer = gpu.buffer("output", bytemuck::bytes_of(output), BufferUsages::UNIFORM);
            self.pipelines.output_group(&gpu.device, target, &buffer, view)
        });
        let groups: Vec<_> = groups.collect();
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.clear_buffer(&scratch, 0, Some(4 * plan.words));
        {
            let mut compute = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            let streams = plan.passes.iter().map(|pass| pass.count[0] * pass.count[1]).max().unwrap_or(0);
            compute.set_bind_group(0, &passes, &[0]);
            compute.set_pipeline(&self.pipelines.read);
            compute.dispatch_workgroups(streams.div_ceil(BLOCK_STREAMS), plan.passes.len() as u32, 1);
            let mut offset = 0;
            for (number, pass) in plan.passes.iter().enumerate() {
                offset = (PASS_STRIDE * number) as u32;
                compute.set_bind_group(0, &passes, &[offset]);
                compute.set_pipeline(&self.pipelines.transform);
                let blocks = pass.held[0] * pass.held[1] * pass.axes;
                compute.dispatch_workgroups(blocks.div_ceil(BLOCKS), 1, 1);
                for pipeline in self.pipelines.deblock.iter().filter(|_| pass.deblocking > 0) {
                    compute.set_pipeline(pipeline);
                    compute.dispatch_workgroups(blocks.div_ceil(BLOCKS), 1, 1);
                }
            }
            compute.set_pipeline(self.pipelines.write(&gpu.device, target));
            compute.set_bind_group(0, &passes, &[offset]);
            for ((output, _), group) in outputs.iter().zip(&groups) {
                compute.set_bind_group(1, group, &[]);
                let [width, height] = output.size.map(|side| side.div_ceil(TEXELS));
                compute.dispatch_workgroups(width, height, 1);
            }
        }
        gpu.queue.submit([encoder.finish()]);
        Ok(())
    }

    /// Scratch memory of at least so many bytes.
    fn scratch(&self, gpu: &Gpu, bytes: u64) -> Buffer {
        let mut kept = self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        match &*kept {
            Some(buffer) if buffer.size() >= bytes => buffer.clone(),
            _ => {
                let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("scratch of blocks"),
                    size: bytes,
                    usage: BufferUsages::STORAGE | BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                });
                kept.insert(buffer).clone()
            }
        }
    }
}

/// What a texture takes, by its format; it must suit samples of that depth.
fn target_of(texture: &Texture, depth: u8) -> Result<DctTarget, GpuError> {
    let suits = |target: &DctTarget| {
        format_of(*target) == texture.format() && (*target == DctTarget::Float32 || *target == plain(depth))
    };
    let found = DctTarget::ALL.into_iter().find(suits);
    let found = found.filter(|_| texture.usage().contains(TextureUsages::STORAGE_BINDING));
    found.ok_or(GpuError::DctTarget { format: format_of(plain(depth)) })
}

/// The target that takes samples of that depth as they are.
fn plain(depth: u8) -> DctTarget {
    if depth > 8 { DctTarget::Uint16 } else { DctTarget::Unorm8 }
}

fn view_of(texture: &Texture, level: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        base_mip_level: level,
        mip_level_count: Some(1),
        array_layer_count: Some(1),
        dimension: Some(wgpu::TextureViewDimension::D2),
        ..Default::default()
    })
}

/// What a part of an image of that size has of a level whose texels are means of squares of its samples. Parts are cut where
/// superblocks are: at multiples of such squares.
fn reduced(part: Rect, size: ImageSize, reduce_log2: u32) -> Rect {
    let few = size.at_level(reduce_log2);
    let cut = |first: u32, count: u32, all: u32, few: u32| {
        let start = first >> reduce_log2;
        let end = if first + count >= all { few } else { (first + count) >> reduce_log2 };
        (start, end.saturating_sub(start))
    };
    let (x, width) = cut(part.x, part.width, size.width, few.width);
    let (y, height) = cut(part.y, part.height, size.height, few.height);
    Rect { x, y, width, height, ..part }
}

/// The whole of a buffer, or as much of it as a pass's parameters take.
fn bound(buffer: &Buffer, size: Option<usize>) -> BindingResource<'_> {
    let size = size.and_then(|size| std::num::NonZeroU64::new(size as u64));
    BindingResource::Buffer(BufferBinding { buffer, offset: 0, size })
}

/// Parts of a rectangle that need at most [`MAX_SCRATCH`] bytes each, cut where superblocks are.
fn parts(layout: &DctLayout, rect: Rect) -> Result<Vec<(Rect, DctPlan)>, RegionError> {
    let texels = layout.superblock_texels(DctPlan::new(layout, rect)?.reduce_log2);
    let mut open = vec![rect];
    let mut done = Vec::new();
    while let Some(rect) = open.pop() {
        let plan = DctPlan::new(layout, rect)?;
        let [columns, rows] = plan.passes.last().map_or([1, 1], |pass| pass.count);
        if 4 * plan.words <= MAX_SCRATCH || columns * rows <= 1 {
            done.push((rect, plan));
        } else if rows > 1 {
            let middle = (rect.y / texels + rows / 2) * texels - rect.y;
            open.push(Rect { y: rect.y + middle, height: rect.height - middle, ..rect });
            open.push(Rect { height: middle, ..rect });
        } else {
            let middle = (rect.x / texels + columns / 2) * texels - rect.x;
            open.push(Rect { x: rect.x + middle, width: rect.width - middle, ..rect });
            open.push(Rect { width: middle, ..rect });
        }
    }
    Ok(done)
}

fn output(
    layout: &DctLayout,
    rect: Rect,
    reduce_log2: u32,
    channels: &[GpuChannel; 4],
    place: [u32; 2],
) -> Output {
    Output {
        size: [rect.width, rect.height],
        origin: [rect.x, rect.y],
        place,
        shift: layout.shift,
        largest: (1 << layout.depth) - 1,
        means: channels.map(|channel| channel.mean),
        first_axes: channels.map(|channel| channel.first_axis),
        weights: channels.map(|channel| channel.weights),
        last: [layout.size.width - 1, layout.size.height - 1],
        reduce_log2,
        average: layout.average.bits(),
    }
}
