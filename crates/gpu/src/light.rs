//! Surface light fields on their own meshes.

use texfold_core::GpuForm;
use texfold_shaders::{LightOffsets, ModuleInfo};
use wgpu::{BindGroup, Buffer, Queue};

use crate::upload::{module_of, number};
use crate::{Gpu, GpuError};

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
    /// The WGSL module that draws it.
    #[must_use]
    pub fn module(&self) -> &'static ModuleInfo {
        self.module
    }

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
        self.set_terms(terms);
        self
    }

    /// Draws submitted from now on show at most `terms` terms beside the mean.
    pub fn set_terms(&self, terms: u32) {
        let terms = terms.min(self.stored_terms);
        self.queue.write_buffer(&self.params, self.offsets.terms as u64, &terms.to_le_bytes());
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
        let [index] = &form.images[..] else {
            return Err(GpuError::Form { what: "a light field has another number of sizes than one" });
        };
        let decoded = self.decode_images(form)?;
        self.guarded(|| {
            let planes = self.upload_planes(form, decoded)?;
            let group = self.bind(module, form, index, &planes)?;
            let params = group.params.into_iter().next();
            let number = |offset| number(&form.uniforms[index.uniforms.clone()], offset);
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
}
