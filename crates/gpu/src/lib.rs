//! Upload, draw and read back Texfold textures on any wgpu adapter.
//!
//! [`Gpu::upload`] takes the planes that an encoded texture hands out ([`texfold_core::Encoded::gpu`]);
//! [`Gpu::decode`], [`Gpu::draw_quad`], [`Gpu::draw_mesh`] and, for light fields ([`Gpu::upload_light`]), [`Gpu::draw_light`] draw off screen and read the pixels back. An
//! application with a renderer of its own passes its device to [`Gpu::from_device`], binds [`GpuTexture::bind_group`]
//! and pastes the module's WGSL ([`texfold_shaders::paste`]) into its shaders: see `examples/draw.rs`. [`Gpu::material`] binds several
//! textures, of one codec or of several, in one group of one shader: see `examples/material.rs`. [`Gpu::update`] uploads again what
//! changed of a file that arrives in pieces.
//!
//! Software Vulkan (Mesa's lavapipe) serves where there is no GPU. *Not done*: planes larger than the device's texture
//! limit, in several textures; uploads in the background.

mod adapter;
mod block;
mod decode;
mod draw;
mod error;
mod light;
mod material;
mod mesh;
mod pipeline;
mod readback;
mod texture;
mod timing;
mod update;
mod upload;

pub use adapter::{Gpu, Policy};
pub use block::{BlockChannel, BlockDecoder, BlockImage, MAX_SCRATCH};
pub use decode::{Filter, Lookup, View};
pub use draw::Lod;
pub use error::GpuError;
pub use light::GpuLight;
pub use material::{Layer, Material};
pub use texfold_shaders::ModuleInfo;
pub use texture::{AddressMode, GpuTexture};
pub use timing::Probe;
pub use update::Updated;
pub use wgpu;
