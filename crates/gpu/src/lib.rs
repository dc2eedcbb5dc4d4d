//! Texfold textures in wgpu renderers.
//!
//! A renderer passes its device to [`Gpu::from_device`] and uploads the planes of an encoded texture
//! ([`texfold_core::Encoded::gpu`]) with [`Gpu::upload`], those of a light field with [`Gpu::upload_light`] (several in a scene: `examples/light.rs`). There are three
//! ways to draw images:
//!
//! - *A cache of decoded tiles, hardware sampler*: [`TileCache`], for any number of textures in one bind group, in the memory of their
//!   compressed form and of a pool: `examples/room.rs`. All maps of a material come from one lookup
//!   ([`TileCache::add_material`]).
//! - *Plain texels, hardware sampler*: [`GpuTexture::decoded_view`], for textures in blocks; anisotropic, filtered in linear light, no
//!   WGSL of ours: `examples/hardware.rs`.
//! - *Compressed texels, our WGSL*: the renderer binds [`GpuTexture::bind_group`] and pastes the module
//!   ([`texfold_shaders::paste`]) into its shader: `examples/draw.rs`. [`Gpu::material`] binds several textures, of one codec or of
//!   several, in one group of one shader: `examples/material.rs`.
//!
//! [`Gpu::update`] uploads again what changed of a file that arrives in pieces. With the feature `offscreen`, `Gpu` also draws without a
//! window, reads pixels back (`Gpu::read_view`, `draw_quad`, `draw_mesh`, `draw_light`) and measures times.
//!
//! [`wgpu`] is version 30, and version 29 with the feature `wgpu29`.
//!
//! Software Vulkan (Mesa's lavapipe) serves where there is no GPU. *Not done*: planes larger than the device's texture
//! limit, in several textures; uploads in the background.

#[cfg(not(any(feature = "wgpu29", feature = "wgpu30")))]
compile_error!("choose a version of wgpu: the feature wgpu30, which is on by default, or wgpu29");

// Renderers have one version of wgpu or the other.
#[cfg(feature = "wgpu29")]
pub extern crate wgpu29 as wgpu;

mod adapter;
mod compute;
mod dct;
mod error;
mod layouts;
mod light;
mod material;
#[cfg(feature = "offscreen")]
mod offscreen;
mod texture;
mod tiles;
mod update;
mod upload;

pub use adapter::{Gpu, Policy};
pub use dct::{DctChannel, DctDecoder, DctImage, MAX_SCRATCH};
pub use error::GpuError;
pub use light::GpuLight;
pub use material::{Layer, Material};
#[cfg(feature = "offscreen")]
pub use offscreen::{Filter, Lod, Lookup, Probe, View};
pub use texfold_shaders::ModuleInfo;
pub use texture::{AddressMode, GpuTexture};
#[doc(hidden)]
pub use tiles::tile_numbers;
pub use tiles::{
    TileBytes, TileCache, TileContents, TileLook, TileOptions, TileReport, TileTexture, TileUse, TileWatch,
};
pub use update::Updated;
#[cfg(not(feature = "wgpu29"))]
pub use wgpu;
