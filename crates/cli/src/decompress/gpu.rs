//! Decoding on the GPU, as a shader does.

use std::path::Path;

use texfold_core::image::Raster;
use texfold_core::{Encoded, Image2d, ImageSize, RegionError, SourceError, Texel};
use texfold_gpu::{Filter, Gpu, GpuError, GpuTexture, Policy};

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
    pub(crate) fn open() -> Result<Device, GpuError> {
        // "TEXFOLD_GPU=off" is respected; without an adapter this is an error under any other policy.
        Gpu::new(Policy::from_env()).map(Device)
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
    pub(crate) fn decode(
        &self,
        path: &Path,
        encoded: &dyn Encoded<Domain = Image2d>,
        image: u32,
        level: u32,
        continuous: bool,
    ) -> Result<Raster, CliError> {
        let layout = encoded.layout();
        let missing = || CliError::Region {
            path: path.to_owned(),
            source: RegionError::NoSuchImage { image, images: layout.images.len() },
        };
        let size = layout.images.get(image as usize).ok_or_else(missing)?.at_level(level);
        let ImageSize { width, height } = size;
        let filter = if continuous { Filter::Bilinear } else { Filter::Nearest };
        let decoded =
            self.gpu.decode(&self.texture, image, level, (width, height), filter).map_err(fault(path))?;
        let texels: Vec<Texel> = decoded.into_iter().map(Texel::from).collect();
        let unsuitable = |source: SourceError| CliError::Source { path: path.to_owned(), source };
        Raster::from_texels(width, height, layout.pixel, &texels).map_err(unsuitable)
    }
}
