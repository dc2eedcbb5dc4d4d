//! Flat images as a renderer draws them.

use glam::Affine2;

use crate::{Gpu, GpuError, GpuTexture, Lookup, View};

/// Which mip level is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Lod {
    /// The one that fits the distance between pixels.
    #[default]
    Derivative,
    /// This one; fractions blend two.
    Explicit(f32),
}

impl Gpu {
    /// Image `image` on a rectangle of `size` pixels, trilinear; `uv` leads from the rectangle, (0, 0) its top left
    /// corner and (1, 1) its bottom right one, to texture coordinates.
    ///
    /// # Errors
    /// [`GpuError`] where there is no such image, or the device fails.
    pub fn draw_quad(
        &self,
        texture: &GpuTexture,
        image: u32,
        size: (u32, u32),
        uv: Affine2,
        lod: Lod,
    ) -> Result<Vec<[u8; 4]>, GpuError> {
        let lookup = match lod {
            Lod::Derivative => Lookup::Derivative,
            Lod::Explicit(lod) => Lookup::Level { lod },
        };
        self.read_view_rgba8(texture, &View { image, size, uv, lookup })
    }
}
