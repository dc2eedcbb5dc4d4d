//! Textured triangle meshes.

use glam::{Mat4, Vec2, Vec3};
use texfold_core::mesh::UvMesh;
use wgpu::{Buffer, BufferUsages, TextureFormat};

use super::pipeline::{DEPTH_FORMAT, PipelineKey, Shader};
use super::view::clear;
use crate::{Gpu, GpuError, GpuTexture};

/// The shader's parameters.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct SceneParams {
    view_projection: Mat4,
    image: u32,
    reserved: [u32; 3],
}

/// One corner in the vertex buffer.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Corner {
    position: Vec3,
    uv: Vec2,
}

impl Gpu {
    /// `mesh` with image `image` on it, on transparent black, nearest triangle in front, both sides of a triangle
    /// alike. `view_projection` leads to clip space with depths 0 to 1, as the projections of
    /// `glam::camera::rh::proj::directx` do.
    ///
    /// # Errors
    /// [`GpuError`] where there is no such image, the mesh is damaged, or the device fails.
    pub fn draw_mesh(
        &self,
        texture: &GpuTexture,
        image: u32,
        mesh: &UvMesh,
        view_projection: Mat4,
        (width, height): (u32, u32),
    ) -> Result<Vec<[u8; 4]>, GpuError> {
        let limit = self.side_limit();
        if width == 0 || height == 0 || width > limit || height > limit {
            return Err(GpuError::ImageSize { width, height, limit });
        }
        let shader = Shader::Mesh(texture.module());
        let pipeline = self.pipeline(PipelineKey { shader, target: TextureFormat::Rgba8Unorm })?;
        let mut pixels = vec![[0; 4]; width as usize * height as usize];
        self.guarded(|| {
            let (corners, indices, count) = self.mesh_buffers(mesh)?;
            let (textures, place) = texture.bind_group(image)?;
            let scene = SceneParams { view_projection, image: place, reserved: [0; 3] };
            let job = self.job_group(bytemuck::bytes_of(&scene));
            let colour = self.target(TextureFormat::Rgba8Unorm, (width, height));
            let (view, depth) = (view_of(&colour), view_of(&self.target(DEPTH_FORMAT, (width, height))));
            let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("mesh"),
                color_attachments: &[Some(clear(&view))],
                depth_stencil_attachment: Some(clear_depth(&depth)),
                ..Default::default()
            });
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, textures, &[]);
            pass.set_bind_group(1, &job, &[]);
            pass.set_vertex_buffer(0, corners.slice(..));
            pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..count, 0, 0..1);
            drop(pass);
            self.read_rows(encoder, &colour, |y, line| {
                let start = y as usize * width as usize;
                pixels[start..start + width as usize].copy_from_slice(bytemuck::cast_slice(line));
            })
        })?;
        Ok(pixels)
    }

    /// Corners, indices and the number of indices.
    fn mesh_buffers(&self, mesh: &UvMesh) -> Result<(Buffer, Buffer, u32), GpuError> {
        let indices = mesh.triangles.as_flattened();
        let count = u32::try_from(indices.len()).map_err(|_| GpuError::Mesh)?;
        if !mesh.is_valid() || count == 0 {
            return Err(GpuError::Mesh);
        }
        let corners: Vec<Corner> =
            mesh.positions.iter().zip(&mesh.uvs).map(|(&position, &uv)| Corner { position, uv }).collect();
        let corners = self.buffer("corners", bytemuck::cast_slice(&corners), BufferUsages::VERTEX);
        let indices = self.buffer("indices", bytemuck::cast_slice(indices), BufferUsages::INDEX);
        Ok((corners, indices, count))
    }
}

pub(crate) fn view_of(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

pub(crate) fn clear_depth(view: &wgpu::TextureView) -> wgpu::RenderPassDepthStencilAttachment<'_> {
    wgpu::RenderPassDepthStencilAttachment {
        view,
        depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(1.0), store: wgpu::StoreOp::Discard }),
        stencil_ops: None,
    }
}
