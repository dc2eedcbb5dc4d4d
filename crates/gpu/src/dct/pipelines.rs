//! Bind groups and pipelines of the decoder of blocks.

use std::sync::OnceLock;

use texfold_shaders::DctPass;
use texfold_shaders::DctTarget;
use wgpu::{
    BindGroup, BindGroupEntry, BindGroupLayout, BindGroupLayoutEntry, BindingResource, BindingType, Buffer,
    BufferBindingType, ComputePipeline, Device, ShaderStages, TextureFormat, TextureView,
};

use super::{DctImage, bound};

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
        let buffers = [uniform(true), storage(true), storage(true), storage(false)];
        let passes = layout(device, "passes of blocks", &buffers);
        let module = shader(device, DctTarget::Unorm8);
        let pipeline = |entry: &str| pipeline(device, &module, entry, &[Some(&passes)]);
        let (read, transform) = (pipeline("read_superblocks"), pipeline("transform_blocks"));
        let deblock = [pipeline("deblock_columns"), pipeline("deblock_rows")];
        Pipelines { read, transform, deblock, passes, writers: Default::default() }
    }

    fn writer(&self, device: &Device, target: DctTarget) -> &Writer {
        let kept = &self.writers[target as usize];
        kept.get_or_init(|| writer(device, &self.passes, &shader(device, target), target))
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
            bound(params, Some(size_of::<DctPass>())),
            bound(&image.words, None),
            bound(&image.streams, None),
            bound(scratch, None),
        ];
        group(device, &self.passes, resources)
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
        group(device, &self.writer(device, target).layout, resources)
    }
}

fn shader(device: &Device, target: DctTarget) -> wgpu::ShaderModule {
    device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("blocks"),
        source: wgpu::ShaderSource::Wgsl(texfold_shaders::block(target).into()),
    })
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
    let layout = layout(device, "output of blocks", &[uniform(false), texture]);
    let pipeline = pipeline(device, module, "write_texels", &[Some(passes), Some(&layout)]);
    Writer { layout, pipeline }
}

fn pipeline(
    device: &Device,
    module: &wgpu::ShaderModule,
    entry: &str,
    layouts: &[Option<&BindGroupLayout>],
) -> ComputePipeline {
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(entry),
        bind_group_layouts: layouts,
        immediate_size: 0,
    });
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry),
        layout: Some(&layout),
        module,
        entry_point: Some(entry),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    })
}

fn layout(device: &Device, label: &str, types: &[BindingType]) -> BindGroupLayout {
    let entry = |(binding, &ty): (u32, &BindingType)| BindGroupLayoutEntry {
        binding,
        visibility: ShaderStages::COMPUTE,
        ty,
        count: None,
    };
    let entries: Vec<_> = (0..).zip(types).map(entry).collect();
    device
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

fn group<const N: usize>(
    device: &Device,
    layout: &BindGroupLayout,
    resources: [BindingResource<'_>; N],
) -> BindGroup {
    let entries: Vec<_> =
        (0..).zip(resources).map(|(binding, resource)| BindGroupEntry { binding, resource }).collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some("blocks"), layout, entries: &entries })
}

fn uniform(has_dynamic_offset: bool) -> BindingType {
    BindingType::Buffer { ty: BufferBindingType::Uniform, has_dynamic_offset, min_binding_size: None }
}

fn storage(read_only: bool) -> BindingType {
    BindingType::Buffer {
        ty: BufferBindingType::Storage { read_only },
        has_dynamic_offset: false,
        min_binding_size: None,
    }
}
