//! Bind groups and pipelines of the decoder of blocks.

use texfold_core::BlockPass;
use texfold_shaders::BlockTarget;
use wgpu::{
    BindGroup, BindGroupEntry, BindGroupLayout, BindGroupLayoutEntry, BindingResource, BindingType, Buffer,
    BufferBindingType, ComputePipeline, Device, ShaderStages, TextureFormat, TextureView,
};

use super::{BlockImage, bound};

/// What texels are written to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Target {
    Unorm8,
    Uint16,
}

impl Target {
    /// The target of samples of so many bits.
    pub(super) fn of_depth(depth: u8) -> Target {
        if depth > 8 { Target::Uint16 } else { Target::Unorm8 }
    }

    /// Its format.
    pub(super) fn format(self) -> TextureFormat {
        match self {
            Target::Unorm8 => TextureFormat::Rgba8Unorm,
            Target::Uint16 => TextureFormat::Rgba16Uint,
        }
    }

    fn source(self) -> String {
        texfold_shaders::block(match self {
            Target::Unorm8 => BlockTarget::Unorm8,
            Target::Uint16 => BlockTarget::Uint16,
        })
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
    passes: BindGroupLayout,
    unorm: Writer,
    uint: Writer,
}

impl Pipelines {
    pub(super) fn new(device: &Device) -> Pipelines {
        let buffers = [uniform(true), storage(true), storage(true), storage(false)];
        let passes = layout(device, "passes of blocks", &buffers);
        let module = shader(device, Target::Unorm8);
        let pipeline = |entry: &str| pipeline(device, &module, entry, &[Some(&passes)]);
        let (read, transform) = (pipeline("read_superblocks"), pipeline("transform_blocks"));
        let unorm = writer(device, &passes, &module, Target::Unorm8);
        let uint = writer(device, &passes, &shader(device, Target::Uint16), Target::Uint16);
        Pipelines { read, transform, passes, unorm, uint }
    }

    fn writer(&self, target: Target) -> &Writer {
        match target {
            Target::Unorm8 => &self.unorm,
            Target::Uint16 => &self.uint,
        }
    }

    /// An invocation a texel.
    pub(super) fn write(&self, target: Target) -> &ComputePipeline {
        &self.writer(target).pipeline
    }

    /// What all passes have bound; the offset of a pass's parameters is dynamic.
    pub(super) fn pass_group(
        &self,
        device: &Device,
        params: &Buffer,
        image: &BlockImage,
        scratch: &Buffer,
    ) -> BindGroup {
        let resources = [
            bound(params, Some(size_of::<BlockPass>())),
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
        target: Target,
        output: &Buffer,
        view: &TextureView,
    ) -> BindGroup {
        let resources = [bound(output, None), BindingResource::TextureView(view)];
        group(device, &self.writer(target).layout, resources)
    }
}

fn shader(device: &Device, target: Target) -> wgpu::ShaderModule {
    device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("blocks"),
        source: wgpu::ShaderSource::Wgsl(target.source().into()),
    })
}

fn writer(device: &Device, passes: &BindGroupLayout, module: &wgpu::ShaderModule, target: Target) -> Writer {
    let texture = BindingType::StorageTexture {
        access: wgpu::StorageTextureAccess::WriteOnly,
        format: target.format(),
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
