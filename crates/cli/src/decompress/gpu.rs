//! Decoding on the GPU, as a shader does.

use std::path::Path;

use glam::Affine2;
use texfold_core::image::Raster;
use texfold_core::{Encoded, Image2d, Rect, SourceError, Texel};
use texfold_gpu::{Gpu, GpuError, GpuTexture, Lookup, Policy, View};

use crate::error::CliError;

/// The machine's GPU.
#[derive(Debug)]
pub(crate) struct Device(Gpu);

/// A texture on the GPU.
#[derive(Debug)]
pub(crate) struct Fixture<'d> {
    gpu: &'d Gpu,
    texture: GpuTexture,
}

impl Device {
    /// The GPU, where it is wanted.
    pub(crate) fn where_wanted(is_wanted: bool) -> Result<Option<Device>, CliError> {
        // "TEXFOLD_GPU=off" is respected; without an adapter this is an error under any other policy.
        let device = is_wanted.then(|| Gpu::new(Policy::from_env()).map(Device)).transpose();
        device.map_err(|source| CliError::NoGpu { source: Box::new(source) })
    }

    pub(crate) fn upload(
        &self,
        path: &Path,
        encoded: &dyn Encoded<Domain = Image2d>,
    ) -> Result<Fixture<'_>, CliError> {
        let texture = self.0.upload(&encoded.gpu()).map_err(fault(path))?;
        Ok(Fixture { gpu: &self.0, texture })
    }
}

fn fault(path: &Path) -> impl FnOnce(GpuError) -> CliError {
    move |source| CliError::Gpu { path: path.to_owned(), source: Box::new(source) }
}

impl Fixture<'_> {
    /// A rectangle that exists.
    pub(crate) fn decode(
        &self,
        path: &Path,
        encoded: &dyn Encoded<Domain = Image2d>,
        rect: Rect,
        continuous: bool,
    ) -> Result<Raster, CliError> {
        let (corner, extent) = super::coordinates(encoded, rect);
        let Rect { image, level, width, height, .. } = rect;
        let lookup = if continuous { Lookup::Bilinear { level } } else { Lookup::Nearest { level } };
        let uv = Affine2::from_scale_angle_translation(extent, 0.0, corner);
        let view = View { image, size: (width, height), uv, lookup };
        let decoded = self.gpu.read_view(&self.texture, &view).map_err(fault(path))?;
        let texels: Vec<Texel> = decoded.into_iter().map(Texel::from).collect();
        let unsuitable = |source: SourceError| CliError::Source { path: path.to_owned(), source };
        Raster::from_texels(width, height, encoded.layout().pixel_of(rect.image), &texels).map_err(unsuitable)
    }
}
