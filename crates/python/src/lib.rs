//! The native part of the Python package `texfold`: what takes and gives numpy arrays of one shape, which `texfold/__init__.py` makes of
//! what users give.

mod bank;
mod encode;
mod error;
mod gpu;
mod light;
mod texture;
mod writer;

/// Encoding, textures and banks.
#[pyo3::pymodule]
mod _texfold {
    #[pymodule_export]
    use super::bank::Bank;
    #[pymodule_export]
    use super::encode::encode;
    #[pymodule_export]
    use super::gpu::Blocks;
    #[pymodule_export]
    use super::light::{LightField, encode_light, open_light, read_capture};
    #[pymodule_export]
    use super::texture::{Texture, open, psnr, ssim};
    #[pymodule_export]
    use super::writer::{
        BankWriter, TileSums, tile_bytes, tile_cuts, tile_name, tile_sampled, tile_seen, tile_step,
        tile_stride,
    };
}
