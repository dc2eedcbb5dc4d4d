//! The functions of shaders as a CPU computes them: one implementation for each codec.

use glam::{IVec2, Vec2, Vec4};
use texfold_bc::BcTexture;
use texfold_core::address::texfold_level;
use texfold_core::{Encoded, Image2d};
use texfold_epitome::EpitomeTexture;
use texfold_progressive::ProgressiveTexture;
use texfold_vq::VqTexture;
use texfold_zipmap::ZipTexture;

/// A call of one of the functions that every module of images has.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Call {
    Fetch { at: IVec2, level: u32 },
    Nearest { uv: Vec2, level: u32 },
    Bilinear { uv: Vec2, level: u32 },
    Level { uv: Vec2, lod: f32 },
    Grad { uv: Vec2, dx: Vec2, dy: Vec2 },
}

/// An encoded texture with the CPU functions that its shader must equal.
pub(crate) trait Twin: Send + Sync {
    /// The texture.
    fn encoded(&self) -> &dyn Encoded<Domain = Image2d>;
    /// What the function gives for image `image` under the address mode of that number.
    fn call(&self, image: u32, mode: u32, call: Call) -> Vec4;
}

impl Twin for BcTexture {
    fn encoded(&self) -> &dyn Encoded<Domain = Image2d> {
        self
    }

    fn call(&self, image: u32, mode: u32, call: Call) -> Vec4 {
        use texfold_bc::decode::{
            texfold_bc_bilinear, texfold_bc_fetch, texfold_bc_nearest, texfold_bc_sample_level,
        };
        let mut view = self.view(image);
        view.params.address_mode = mode;
        match call {
            Call::Fetch { at, level } => texfold_bc_fetch(&view, at, level),
            Call::Nearest { uv, level } => texfold_bc_nearest(&view, uv, level),
            Call::Bilinear { uv, level } => texfold_bc_bilinear(&view, uv, level),
            Call::Level { uv, lod } => texfold_bc_sample_level(&view, uv, lod),
            // Levels are those of the plane, which may be smaller than the image.
            Call::Grad { uv, dx, dy } => {
                let lod = texfold_level(dx, dy, view.params.plane_size.into());
                texfold_bc_sample_level(&view, uv, lod)
            }
        }
    }
}

impl Twin for VqTexture {
    fn encoded(&self) -> &dyn Encoded<Domain = Image2d> {
        self
    }

    fn call(&self, image: u32, mode: u32, call: Call) -> Vec4 {
        use texfold_vq::decode::{
            texfold_vq_bilinear, texfold_vq_fetch, texfold_vq_nearest, texfold_vq_sample_level,
        };
        let (mut view, place) = self.view(image);
        view.params.address_mode = mode;
        match call {
            Call::Fetch { at, level } => texfold_vq_fetch(&view, place, at, level),
            Call::Nearest { uv, level } => texfold_vq_nearest(&view, place, uv, level),
            Call::Bilinear { uv, level } => texfold_vq_bilinear(&view, place, uv, level),
            Call::Level { uv, lod } => texfold_vq_sample_level(&view, place, uv, lod),
            Call::Grad { uv, dx, dy } => {
                let lod = texfold_level(dx, dy, view.params.size.into());
                texfold_vq_sample_level(&view, place, uv, lod)
            }
        }
    }
}

impl Twin for EpitomeTexture {
    fn encoded(&self) -> &dyn Encoded<Domain = Image2d> {
        self
    }

    fn call(&self, image: u32, mode: u32, call: Call) -> Vec4 {
        use texfold_epitome::decode::{
            texfold_epitome_bilinear, texfold_epitome_fetch, texfold_epitome_nearest,
            texfold_epitome_sample_level,
        };
        let mut view = self.view(image);
        view.params.address_mode = mode;
        match call {
            Call::Fetch { at, level } => texfold_epitome_fetch(&view, at, level),
            Call::Nearest { uv, level } => texfold_epitome_nearest(&view, uv, level),
            Call::Bilinear { uv, level } => texfold_epitome_bilinear(&view, uv, level),
            Call::Level { uv, lod } => texfold_epitome_sample_level(&view, uv, lod),
            Call::Grad { uv, dx, dy } => {
                let lod = texfold_level(dx, dy, view.params.size.into());
                texfold_epitome_sample_level(&view, uv, lod)
            }
        }
    }
}

impl Twin for ProgressiveTexture {
    fn encoded(&self) -> &dyn Encoded<Domain = Image2d> {
        self
    }

    fn call(&self, image: u32, mode: u32, call: Call) -> Vec4 {
        use texfold_progressive::decode::{
            texfold_progressive_bilinear, texfold_progressive_fetch, texfold_progressive_nearest,
            texfold_progressive_sample_level,
        };
        let mut view = self.view(image);
        view.params.address_mode = mode;
        match call {
            Call::Fetch { at, level } => texfold_progressive_fetch(&view, at, level),
            Call::Nearest { uv, level } => texfold_progressive_nearest(&view, uv, level),
            Call::Bilinear { uv, level } => texfold_progressive_bilinear(&view, uv, level),
            Call::Level { uv, lod } => texfold_progressive_sample_level(&view, uv, lod),
            // Levels are those of the image, whatever is stored of it.
            Call::Grad { uv, dx, dy } => {
                let lod = texfold_level(dx, dy, view.params.size.into());
                texfold_progressive_sample_level(&view, uv, lod)
            }
        }
    }
}

impl Twin for ZipTexture {
    fn encoded(&self) -> &dyn Encoded<Domain = Image2d> {
        self
    }

    fn call(&self, _: u32, mode: u32, call: Call) -> Vec4 {
        use texfold_zipmap::decode::{
            texfold_zipmap_bilinear, texfold_zipmap_fetch, texfold_zipmap_nearest,
            texfold_zipmap_sample_grad, texfold_zipmap_sample_level,
        };
        let mut view = self.view();
        view.params.address_mode = mode;
        match call {
            Call::Fetch { at, level } => texfold_zipmap_fetch(&view, at, level),
            Call::Nearest { uv, level } => texfold_zipmap_nearest(&view, uv, level),
            Call::Bilinear { uv, level } => texfold_zipmap_bilinear(&view, uv, level),
            Call::Level { uv, lod } => texfold_zipmap_sample_level(&view, uv, lod),
            // Patches are turned: what fits one of them does not follow from a level of the whole.
            Call::Grad { uv, dx, dy } => texfold_zipmap_sample_grad(&view, uv, dx, dy),
        }
    }
}
