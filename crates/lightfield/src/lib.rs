//! Surface light-field maps: the colour of a mesh by place and by direction, as sums of products of maps.
//!
//! The light field of a triangle's point `x` seen along `d` is
//!
//! ```text
//! f(x, d) = mean(x) + sum over the triangle's vertices v, terms k:  g_vk(x) * h_vk(d)
//! ```
//!
//! `g` is a surface map over the triangles around the vertex, weighted by the vertex's hat function, so that the sum
//! is continuous across edges; `h` is a view map over the directions around the vertex's normal. The maps are those
//! of a principal component analysis of what photographs show around the vertex, quantised to 8 bits.
//!
//! Source: Chen, Bouguet, Chu, Grzeszczuk, "Light field mapping: efficient representation and hardware rendering
//! of surface light fields", 2002. Beyond the paper: one mean map a triangle instead of three; samples on edges are
//! shared by the triangles, so maps are continuous to the bit; view maps may be laid over the reflected direction.

mod bvh;
pub mod decode;
mod encoded;
mod kinds;
mod layout;
mod part_images;
mod parts;
mod render;
mod wire;

#[cfg(feature = "encode")]
mod capture;
#[cfg(feature = "encode")]
mod encode;
#[cfg(feature = "encode")]
mod error;
#[cfg(feature = "encode")]
mod params;

#[cfg(feature = "encode")]
pub use encode::{FittedMaps, LightQuality, simplify_mesh};
pub use encoded::LightTexture;
#[cfg(feature = "encode")]
pub use error::CaptureError;
pub use kinds::{Directions, Factors, MAX_TERMS};
#[cfg(feature = "encode")]
pub use params::{FitMethod, LightModel, LightParams, MapSizes, MapStorage, Updates};
pub use render::Renderer;
pub use texfold_core::{Camera, Capture, Mesh, Photograph};

use texfold_core::container::Sections;
use texfold_core::{Budget, CodecId, LoadError, SurfaceLight, TextureCodec};

/// Surface light-field maps.
#[derive(Debug, Clone, Copy)]
pub enum Lightfield {}

impl TextureCodec for Lightfield {
    const ID: CodecId = CodecId { number: 5, name: "lightfield" };
    type Domain = SurfaceLight;
    type Encoded = LightTexture;

    fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<LightTexture, LoadError> {
        wire::load(file, budget).map(|(parts, notes)| LightTexture::new(parts, notes))
    }
}
