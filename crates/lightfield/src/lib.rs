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
mod camera;
mod capture;
pub mod decode;
mod encode;
mod encoded;
mod error;
mod layout;
mod order;
mod params;
mod pictures;
mod render;
mod simplify;
mod wire;

pub use camera::Camera;
pub use capture::{Capture, Mesh, View};
pub use encode::{Fitted, Quality};
pub use encoded::LightTexture;
pub use error::CaptureError;
pub use params::{Directions, Factors, Fit, LightParams, MAX_TERMS, Model, Updates};
pub use render::Renderer;

use texfold_core::container::Sections;
use texfold_core::{Budget, CodecId, EncodeError, Encoder, Job, LoadError, SurfaceLight, TextureCodec};

/// Surface light-field maps.
#[derive(Debug, Clone, Copy)]
pub enum Lightfield {}

impl TextureCodec for Lightfield {
    const ID: CodecId = CodecId { number: 5, name: "lightfield" };
    type Domain = SurfaceLight;
    type Encoded = LightTexture;

    fn load(file: &Sections<'_>, budget: &mut Budget) -> Result<LightTexture, LoadError> {
        wire::load(file, budget)
    }
}

impl Encoder for Lightfield {
    type Source<'s> = &'s Capture;
    type Params = LightParams;

    fn encode(
        source: &Capture,
        params: &LightParams,
        job: &mut Job<'_>,
    ) -> Result<LightTexture, EncodeError> {
        Lightfield::encode_measured(source, params, job).map(|(texture, _)| texture)
    }
}

impl Lightfield {
    /// As [`Encoder::encode`], and how close the result comes to the photographs.
    ///
    /// # Errors
    /// As [`Encoder::encode`].
    pub fn encode_measured(
        source: &Capture,
        params: &LightParams,
        job: &mut Job<'_>,
    ) -> Result<(LightTexture, Quality), EncodeError> {
        encode::encode(source, params, job)
    }

    /// As [`Lightfield::encode_measured`], on a mesh of as few triangles as the photographs need: half of them, and half again, while
    /// that shows some photographs, drawn again, at [`LightParams::psnr`] or loses less than a quarter of a dB.
    ///
    /// # Errors
    /// As [`Encoder::encode`].
    pub fn encode_simplified(
        source: &Capture,
        params: &LightParams,
        job: &mut Job<'_>,
    ) -> Result<(LightTexture, Quality), EncodeError> {
        encode::encode_simplified(source, params, job)
    }

    /// The first half of an encode, for several ways to store what it finds.
    ///
    /// # Errors
    /// As [`Encoder::encode`].
    pub fn fit(source: &Capture, params: &LightParams, job: &mut Job<'_>) -> Result<Fitted, EncodeError> {
        encode::fit(source, params, job)
    }
}
