//! Surface light fields on their own meshes.

use glam::{Mat4, Vec3};
use texfold_core::GpuForm;
use texfold_shaders::{LightOffsets, ModuleInfo};
use wgpu::{BindGroup, Buffer, Queue, TextureFormat};

use crate::decode::clear;
use crate::mesh::{clear_depth, view_of};
use crate::pipeline::{DEPTH_FORMAT, PipelineKey, Shader};
use crate::upload::{module_of, number};
use crate::{Gpu, GpuError};

/// The shader's parameters.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct SceneParams {
    view_projection: Mat4,
    eye: Vec3,
    reserved: u32,
}

/// A light field on the GPU.
#[derive(Debug)]
pub struct GpuLight {
    module: &'static ModuleInfo,
    offsets: LightOffsets,
    params: Buffer,
    bind_group: BindGroup,
    triangles: u32,
    stored_terms: u32,
    bytes: u64,
    queue: Queue,
}

impl GpuLight {
    /// Bytes of texels and parameters that were uploaded, or decoded from blocks.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Triangles of the mesh.
    #[must_use]
    pub fn triangles(&self) -> u32 {
        self.triangles
    }

    /// The same light field drawn with at most `terms` terms beside the mean.
    #[must_use]
    pub fn with_terms(self, terms: u32) -> GpuLight {
        let terms = terms.min(self.stored_terms);
        self.queue.write_buffer(&self.params, self.offsets.terms as u64, &terms.to_le_bytes());
        self
    }

    /// What to bind in the group that the module was pasted for.
    #[must_use]
    pub fn bind_group(&self) -> &BindGroup {
        &self.bind_group
    }
}

impl Gpu {
    /// Uploads all planes and parameters of an encoded light field. Maps in blocks are decoded into plain textures.
    ///
    /// # Errors
    /// [`GpuError`] where it is none, or the device cannot hold or sample it.
    pub fn upload_light(&self, form: &GpuForm<'_>) -> Result<GpuLight, GpuError> {
        let module = module_of(form)?;
        let offsets = module.light().ok_or(GpuError::Form { what: "an image is no light field" })?;
        let [surface] = &form.surfaces[..] else {
            return Err(GpuError::Form { what: "a light field has another number of surfaces than one" });
        };
        let decoded = self.decode_images(form)?;
        self.guarded(|| {
            let planes = self.upload_planes(form, decoded)?;
            let group = self.bind(module, form, surface, &planes)?;
            let params = group.params.into_iter().next();
            let number = |offset| number(&form.uniforms[surface.uniforms.clone()], offset);
            Ok(GpuLight {
                module,
                offsets,
                params: params.ok_or(GpuError::Form { what: "a shader without parameters" })?,
                bind_group: group.bind_group,
                triangles: number(offsets.triangles),
                stored_terms: number(offsets.stored_terms),
                bytes: planes.iter().map(|plane| plane.bytes).sum::<u64>() + group.params_bytes,
                queue: self.queue.clone(),
            })
        })
    }

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
        let corners = light.triangles.checked_mul(3).ok_or(GpuError::Mesh)?;
        let pipeline = self.pipeline(PipelineKey {
            shader: Shader::Light(light.module),
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
            pass.set_bind_group(0, &light.bind_group, &[]);
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
