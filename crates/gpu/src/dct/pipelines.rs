//! Bind groups and pipelines of the decoder of blocks.

use std::sync::OnceLock;

use texfold_shaders::{DctEntry, DctTarget, OUTPUT_BYTES, PASS_BYTES};
use wgpu::{
    BindGroup, BindGroupLayout, BindingResource, BindingType, Buffer, ComputePipeline, Device, ShaderStages,
    TextureFormat, TextureView,
};

use super::{DctImage, bound};
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
    /// Those of all entries but the last, in their order.
    decode: [ComputePipeline; 5],
    passes: BindGroupLayout,
    /// For each target what writes to it, made when it is first needed.
    writers: [OnceLock<Writer>; DctTarget::ALL.len()],
}

impl Pipelines {
    pub(super) fn new(device: &Device) -> Pipelines {
        let buffers = [uniform(Some(PASS_BYTES as u64)), storage(true), storage(true), storage(false)];
        let passes = layout(device, "passes of blocks", ShaderStages::COMPUTE, &buffers);
        let module = module(device, DctTarget::Unorm8);
        let [read, transform, predict, columns, rows, _] = DctEntry::ALL;
        let decode = [read, transform, predict, columns, rows]
            .map(|entry| pipeline(device, &module, entry.name(), &[Some(&passes)]));
        Pipelines { decode, passes, writers: Default::default() }
    }

    fn writer(&self, device: &Device, target: DctTarget) -> &Writer {
        let kept = &self.writers[target as usize];
        kept.get_or_init(|| writer(device, &self.passes, &module(device, target), target))
    }

    /// That of a function; it writes to a target of that kind.
    pub(super) fn of(&self, device: &Device, entry: DctEntry, target: DctTarget) -> &ComputePipeline {
        self.decode.get(entry as usize).unwrap_or_else(|| &self.writer(device, target).pipeline)
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
            bound(params, 0, Some(PASS_BYTES)),
            bound(&image.words, 0, None),
            bound(&image.streams, 0, None),
            bound(scratch, 0, None),
        ];
        group(device, &self.passes, &resources)
    }

    /// What `write_texels` alone has bound.
    pub(super) fn output_group(
        &self,
        device: &Device,
        target: DctTarget,
        (outputs, offset): (&Buffer, u64),
        view: &TextureView,
    ) -> BindGroup {
        let resources = [bound(outputs, offset, Some(OUTPUT_BYTES)), BindingResource::TextureView(view)];
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
    let pipeline = pipeline(device, module, DctEntry::Write.name(), &[Some(passes), Some(&layout)]);
    Writer { layout, pipeline }
}
