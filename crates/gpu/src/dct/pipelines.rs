//! Bind groups and pipelines of the decoder of blocks.

use std::sync::OnceLock;

use texfold_shaders::DctTarget;
use wgpu::{
    BindGroup, BindGroupLayout, BindingResource, BindingType, Buffer, ComputePipeline, Device, ShaderStages,
    TextureFormat, TextureView,
};

use super::{DctImage, PASS_STRIDE, PASSES, bound};
use crate::compute::{group, layout, pipeline, shader, storage, uniform};

/// Format of a target.
pub(super) fn format_of(target: DctTarget) -> TextureFormat {
    match target {
        DctTarget::Unorm8 => TextureFormat::Rgba8Unorm,
        DctTarget::Uint16 => TextureFormat::Rgba16Uint,
        DctTarget::Float32 => TextureFormat::Rgba32Float,
    }
}

/// What writes texels to one target.
#[derive(Debug)]
struct Writer {
    layout: BindGroupLayout,
    pipeline: ComputePipeline,
}

/// All pipelines.
#[derive(Debug)]
pub(super) struct Pipelines {
    /// An invocation a superblock.
    pub(super) read: ComputePipeline,
    /// An invocation a block and axis.
    pub(super) transform: ComputePipeline,
    /// An invocation a block and axis: borders between columns of blocks, then between rows.
    pub(super) deblock: [ComputePipeline; 2],
    passes: BindGroupLayout,
    /// For each target what writes to it, made when it is first needed.
    writers: [OnceLock<Writer>; DctTarget::ALL.len()],
}

impl Pipelines {
    pub(super) fn new(device: &Device) -> Pipelines {
        let buffers =
            [uniform(Some((PASSES * PASS_STRIDE) as u64)), storage(true), storage(true), storage(false)];
        let passes = layout(device, "passes of blocks", ShaderStages::COMPUTE, &buffers);
        let module = module(device, DctTarget::Unorm8);
        let pipeline = |entry: &str| pipeline(device, &module, entry, &[Some(&passes)]);
        let (read, transform) = (pipeline("read_superblocks"), pipeline("transform_blocks"));
        let deblock = [pipeline("deblock_columns"), pipeline("deblock_rows")];
        Pipelines { read, transform, deblock, passes, writers: Default::default() }
    }

    fn writer(&self, device: &Device, target: DctTarget) -> &Writer {
        let kept = &self.writers[target as usize];
        kept.get_or_init(|| writer(device, &self.passes, &module(device, target), target))
    }

    /// An invocation a texel.
    pub(super) fn write(&self, device: &Device, target: DctTarget) -> &ComputePipeline {
        &self.writer(device, target).pipeline
    }

    /// What all passes have bound; the offset of a pass's parameters is dynamic.
    pub(super) fn pass_group(
        &self,
        device: &Device,
        params: &Buffer,
        image: &DctImage,
        scratch: &Buffer,
    ) -> BindGroup {
        let resources = [
            bound(params, Some(PASSES * PASS_STRIDE)),
            bound(&image.words, None),
            bound(&image.streams, None),
            bound(scratch, None),
        ];
        group(device, &self.passes, &resources)
    }

    /// What `write_texels` alone has bound.
    pub(super) fn output_group(
        &self,
        device: &Device,
        target: DctTarget,
        output: &Buffer,
        view: &TextureView,
    ) -> BindGroup {
        let resources = [bound(output, None), BindingResource::TextureView(view)];
        group(device, &self.writer(device, target).layout, &resources)
    }
}

fn module(device: &Device, target: DctTarget) -> wgpu::ShaderModule {
    shader(device, "blocks", texfold_shaders::block(target))
}

fn writer(
    device: &Device,
    passes: &BindGroupLayout,
    module: &wgpu::ShaderModule,
    target: DctTarget,
) -> Writer {
    let texture = BindingType::StorageTexture {
        access: wgpu::StorageTextureAccess::WriteOnly,
        format: format_of(target),
        view_dimension: wgpu::TextureViewDimension::D2,
    };
    let layout = layout(device, "output of blocks", ShaderStages::COMPUTE, &[uniform(None), texture]);
    let pipeline = pipeline(device, module, "write_texels", &[Some(passes), Some(&layout)]);
    Writer { layout, pipeline }
}
