//! What renderers without a window share: targets, a pipeline that draws one triangle over all of a target, and its texels.
#![allow(dead_code, reason = "each renderer uses its own part")]

use std::error::Error;

use texfold_gpu::{Gpu, wgpu};

/// A texture that is drawn into and read back.
pub(crate) fn target(gpu: &Gpu, (width, height): (u32, u32), format: wgpu::TextureFormat) -> wgpu::Texture {
    gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

/// All of a texture.
pub(crate) fn view_of(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// A pipeline of the entry points `vs`, which makes a triangle of the numbers 0 to 2, and `fs`, for targets of one format.
pub(crate) fn pipeline(
    gpu: &Gpu,
    shader: &wgpu::ShaderModule,
    groups: &[Option<&wgpu::BindGroupLayout>],
    constants: &[(&str, f64)],
    format: wgpu::TextureFormat,
) -> wgpu::RenderPipeline {
    let device = gpu.device();
    let described = wgpu::PipelineLayoutDescriptor { bind_group_layouts: groups, ..Default::default() };
    // Without groups the layout follows from the shader.
    let layout = (!groups.is_empty()).then(|| device.create_pipeline_layout(&described));
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: layout.as_ref(),
        vertex: wgpu::VertexState {
            module: shader,
            entry_point: Some("vs"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: shader,
            entry_point: Some("fs"),
            compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
            targets: &[Some(format.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Draws the triangle of such a pipeline with these bind groups, and returns the target's texels, row by row.
///
/// # Errors
/// Where the device fails.
pub(crate) fn draw(
    gpu: &Gpu,
    pipeline: &wgpu::RenderPipeline,
    groups: &[&wgpu::BindGroup],
    target: &wgpu::Texture,
) -> Result<Vec<u8>, Box<dyn Error>> {
    let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let view = view_of(target);
    {
        let ops =
            wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store };
        let attachment =
            wgpu::RenderPassColorAttachment { view: &view, depth_slice: None, resolve_target: None, ops };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(attachment)],
            ..Default::default()
        });
        pass.set_pipeline(pipeline);
        for (number, group) in (0..).zip(groups) {
            pass.set_bind_group(number, *group, &[]);
        }
        pass.draw(0..3, 0..1);
    }
    read_back(gpu, encoder, target)
}

/// The texels of a texture after the commands of `encoder`. The bytes of a row are a multiple of 256: rows need no padding.
///
/// # Errors
/// Where the device fails.
pub(crate) fn read_back(
    gpu: &Gpu,
    mut encoder: wgpu::CommandEncoder,
    texture: &wgpu::Texture,
) -> Result<Vec<u8>, Box<dyn Error>> {
    let texel_bytes = texture.format().block_copy_size(None).ok_or("a format that cannot be copied")?;
    let row_bytes = texel_bytes * texture.width();
    let buffer = gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(row_bytes * texture.height()),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let layout =
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row_bytes), rows_per_image: None };
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
        texture.size(),
    );
    gpu.queue().submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |_| ());
    gpu.device().poll(wgpu::PollType::wait_indefinitely())?;
    Ok(buffer.get_mapped_range(..)?.to_vec())
}
