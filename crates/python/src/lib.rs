//! The native part of the Python package `texfold`: what takes and gives numpy arrays of one shape, which `texfold/__init__.py` makes of
//! what users give.

mod encode;
mod error;
mod texture;

/// Encoding and textures.
#[pyo3::pymodule]
mod _texfold {
    #[pymodule_export]
    use super::encode::encode;
    #[pymodule_export]
    use super::texture::{Texture, open, psnr, ssim};
}
