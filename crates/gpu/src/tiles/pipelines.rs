//! Pipelines and bind groups of an update, and what drawing binds.

use wgpu::{
    BindGroup, BindGroupLayout, BindingResource, BindingType, Buffer, ComputePipeline, Device, Sampler,
    ShaderStages, TextureView, TextureViewDimension,
};

use std::sync::Arc;

use super::rows::PLANES;
use super::streams::Streams;
use crate::GpuTexture;
use crate::compute::{group, layout, pipeline, shader, storage, uniform};

/// Distance of steps in their buffer: what every device allows for dynamic offsets.
pub(super) const STEP_STRIDE: u64 = 256;
/// Bytes of a step: a plane; the first byte of a buffer of streams, and its bytes.
pub(super) const STEP_BYTES: u64 = 12;

/// Buffers and views of a cache.
pub(super) struct Resources<'r> {
    pub(super) textures: &'r Buffer,
    pub(super) pages: &'r Buffer,
    pub(super) feedback: &'r Buffer,
    pub(super) slots: &'r Buffer,
    pub(super) stages: &'r Buffer,
    pub(super) plan: &'r Buffer,
    pub(super) workgroups: &'r Buffer,
    pub(super) options: &'r Buffer,
    pub(super) steps: &'r Buffer,
    pub(super) streams: &'r Streams,
    pub(super) scratch: &'r Buffer,
    pub(super) stored: &'r TextureView,
    pub(super) plain: &'r TextureView,
    pub(super) srgb: &'r TextureView,
    pub(super) sampler: &'r Sampler,
}

impl Resources<'_> {
    /// The pass that chooses tiles.
    fn plan(&self, device: &Device) -> (ComputePipeline, BindGroup) {
        let buffers = [
            (self.textures, storage(true)),
            (self.pages, storage(false)),
            (self.feedback, storage(false)),
            (self.slots, storage(false)),
            (self.stages, storage(true)),
            (self.plan, storage(false)),
            (self.workgroups, storage(false)),
            (self.options, uniform(None)),
        ];
        let layout = layout(device, "plan of tiles", ShaderStages::COMPUTE, &buffers.map(|(_, ty)| ty));
        let group = group(device, &layout, &buffers.map(|(buffer, _)| buffer.as_entire_binding()));
        let module = shader(device, "plan of tiles", texfold_shaders::tile_plan());
        (pipeline(device, &module, "plan_tiles", &[Some(&layout)]), group)
    }

    /// Bindings of the passes that decode tiles, for each buffer of streams; the offset of a step is dynamic.
    fn passes(&self, device: &Device) -> (BindGroupLayout, Vec<BindGroup>) {
        let types = [storage(true), storage(true), storage(true), storage(false), uniform(Some(STEP_BYTES))];
        let layout = layout(device, "passes of tiles", ShaderStages::COMPUTE, &types);
        let size = std::num::NonZeroU64::new(STEP_BYTES);
        let step = wgpu::BufferBinding { buffer: self.steps, offset: 0, size };
        let of = |(words, streams): (&Buffer, &Buffer)| {
            let resources = [
                self.plan.as_entire_binding(),
                words.as_entire_binding(),
                streams.as_entire_binding(),
                self.scratch.as_entire_binding(),
                BindingResource::Buffer(step.clone()),
            ];
            group(device, &layout, &resources)
        };
        let words = self.streams.buffers().next().into_iter().cycle();
        let groups = words.zip(self.streams.buffers()).map(of).collect();
        (layout, groups)
    }

    /// Bindings of shaders that draw from the cache.
    fn drawn(&self, device: &Device) -> (BindGroupLayout, Drawn) {
        let layout = layout(device, "tiles", ShaderStages::FRAGMENT, &Drawn::TYPES);
        let drawn = Drawn {
            buffers: [self.textures, self.pages, self.feedback].map(Buffer::clone),
            views: [self.plain, self.srgb].map(TextureView::clone),
            sampler: self.sampler.clone(),
        };
        (layout, drawn)
    }
}

/// What shaders that draw from the cache bind.
#[derive(Debug)]
pub(super) struct Drawn {
    buffers: [Buffer; 3],
    views: [TextureView; 2],
    sampler: Sampler,
}

impl Drawn {
    /// Types of the bindings.
    pub(super) const TYPES: [BindingType; 6] = {
        let texture = BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: true },
            view_dimension: TextureViewDimension::D2Array,
            multisampled: false,
        };
        let filtering = BindingType::Sampler(wgpu::SamplerBindingType::Filtering);
        [storage(true), storage(true), storage(false), texture, texture, filtering]
    };

    pub(super) fn bindings(&self) -> [BindingResource<'_>; 6] {
        let [textures, pages, feedback] = self.buffers.each_ref().map(Buffer::as_entire_binding);
        let [plain, srgb] = self.views.each_ref().map(BindingResource::TextureView);
        [textures, pages, feedback, plain, srgb, BindingResource::Sampler(&self.sampler)]
    }
}

/// All that an update dispatches.
#[derive(Debug)]
pub(super) struct Pipelines {
    plan: (ComputePipeline, BindGroup),
    clear: ComputePipeline,
    read: ComputePipeline,
    transform: ComputePipeline,
    predict: ComputePipeline,
    deblock: [ComputePipeline; 2],
    write: ComputePipeline,
    /// For each buffer of streams.
    decode: Vec<BindGroup>,
    output: BindGroup,
    /// Bindings of passes that draw tiles, beside the texture's.
    pub(super) source_layout: BindGroupLayout,
    pub(super) draw_layout: BindGroupLayout,
    pub(super) draw: BindGroup,
    pub(super) drawn: Drawn,
}

impl Pipelines {
    pub(super) fn new(device: &Device, with: &Resources<'_>) -> Pipelines {
        let (decode_layout, decode) = with.passes(device);
        let target = BindingType::StorageTexture {
            access: wgpu::StorageTextureAccess::WriteOnly,
            format: super::FORMAT,
            view_dimension: TextureViewDimension::D2Array,
        };
        let compute = ShaderStages::COMPUTE;
        let output_layout =
            layout(device, "output of tiles", compute, &[storage(true), storage(true), target]);
        let output = group(
            device,
            &output_layout,
            &[
                with.textures.as_entire_binding(),
                with.stages.as_entire_binding(),
                BindingResource::TextureView(with.stored),
            ],
        );
        let module = shader(device, "passes of tiles", texfold_shaders::tile_passes());
        let pass = |entry: &str| pipeline(device, &module, entry, &[Some(&decode_layout)]);
        let source = [storage(true), storage(true), target, uniform(None)];
        let source_layout = layout(device, "source of tiles", compute, &source);
        let (draw_layout, drawn) = with.drawn(device);
        Pipelines {
            plan: with.plan(device),
            clear: pass("clear_scratch"),
            read: pass("read_superblocks"),
            transform: pass("transform_blocks"),
            predict: pass("predict_blocks"),
            deblock: [pass("deblock_columns"), pass("deblock_rows")],
            write: pipeline(device, &module, "write_tiles", &[Some(&decode_layout), Some(&output_layout)]),
            decode,
            output,
            source_layout,
            draw: group(device, &draw_layout, &drawn.bindings()),
            draw_layout,
            drawn,
        }
    }

    /// Records an update, whose sizes the plan writes to `workgroups`.
    pub(super) fn record<'s>(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        workgroups: &Buffer,
        sources: impl Iterator<Item = &'s Source>,
    ) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("update of tiles"),
            timestamp_writes: None,
        });
        let (plan, plan_group) = &self.plan;
        pass.set_pipeline(plan);
        pass.set_bind_group(0, plan_group, &[]);
        pass.dispatch_workgroups(1, 1, 1);
        let mut dispatch = |pipeline: &ComputePipeline, group: &BindGroup, step: u32, number: u32| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, group, &[step * STEP_STRIDE as u32]);
            pass.dispatch_workgroups_indirect(workgroups, u64::from(12 * number));
        };
        let [first, ..] = self.decode.as_slice() else { return };
        dispatch(&self.clear, first, 0, 0);
        for (streams, step) in self.decode.iter().zip(PLANES..) {
            dispatch(&self.read, streams, step, 1);
        }
        for plane in 0..PLANES {
            dispatch(&self.transform, first, plane, 2 + plane);
        }
        // As many workgroups as for the superblocks of all planes.
        dispatch(&self.predict, first, PLANES - 1, 1);
        for pipeline in &self.deblock {
            dispatch(pipeline, first, PLANES - 1, 1 + PLANES);
        }
        pass.set_bind_group(1, &self.output, &[]);
        pass.set_pipeline(&self.write);
        pass.dispatch_workgroups_indirect(workgroups, u64::from(12 * (2 + PLANES)));
        for source in sources {
            let Ok((texture, _)) = source.texture.bind_group(source.image) else { continue };
            pass.set_pipeline(&source.pipeline);
            pass.set_bind_group(0, &source.group, &[]);
            pass.set_bind_group(1, texture, &[]);
            pass.dispatch_workgroups_indirect(workgroups, u64::from(12 * (2 + PLANES + source.number)));
        }
    }
}

/// An image that is not in superblocks, and the pass that draws its tiles.
#[derive(Debug)]
pub(super) struct Source {
    /// Counted from 1.
    pub(super) number: u32,
    pub(super) texture: Arc<GpuTexture>,
    pub(super) image: u32,
    pub(super) pipeline: ComputePipeline,
    pub(super) group: BindGroup,
}
