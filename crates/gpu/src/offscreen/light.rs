//! Surface light fields on their own meshes.

use glam::{Mat4, Vec3};
use wgpu::TextureFormat;

use super::mesh::{clear_depth, view_of};
use super::pipeline::{DEPTH_FORMAT, PipelineKey, Shader};
use super::view::clear;
use crate::{Gpu, GpuError, GpuLight};

/// The shader's parameters.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct SceneParams {
    view_projection: Mat4,
    eye: Vec3,
    reserved: u32,
}

impl Gpu {
    /// `light` as a camera at `eye` sees it, on transparent black, nearest triangle in front, both sides of a triangle alike.
    /// `view_projection` leads from the mesh's space to clip space with depths 0 to 1.
    ///
    /// # Errors
    /// [`GpuError`] where the image is empty or too large, or the device fails.
    pub fn draw_light(
        &self,
        light: &GpuLight,
        view_projection: Mat4,
        eye: Vec3,
        (width, height): (u32, u32),
    ) -> Result<Vec<[u8; 4]>, GpuError> {
        let limit = self.side_limit();
        if width == 0 || height == 0 || width > limit || height > limit {
            return Err(GpuError::ImageSize { width, height, limit });
        }
        let corners = light.triangles().checked_mul(3).ok_or(GpuError::Mesh)?;
        let pipeline = self.pipeline(PipelineKey {
            shader: Shader::Light(light.module()),
            target: TextureFormat::Rgba8Unorm,
        })?;
        let mut pixels = vec![[0; 4]; width as usize * height as usize];
        self.guarded(|| {
            let scene = SceneParams { view_projection, eye, reserved: 0 };
            let job = self.job_group(bytemuck::bytes_of(&scene));
            let colour = self.target(TextureFormat::Rgba8Unorm, (width, height));
            let (view, depth) = (view_of(&colour), view_of(&self.target(DEPTH_FORMAT, (width, height))));
            let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("light field"),
                color_attachments: &[Some(clear(&view))],
                depth_stencil_attachment: Some(clear_depth(&depth)),
                ..Default::default()
            });
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, light.bind_group(), &[]);
            pass.set_bind_group(1, &job, &[]);
            pass.draw(0..corners, 0..1);
            drop(pass);
            self.read_rows(encoder, &colour, |y, line| {
                let start = y as usize * width as usize;
                pixels[start..start + width as usize].copy_from_slice(bytemuck::cast_slice(line));
            })
        })?;
        Ok(pixels)
    }
}
