//! Tests of GPU textures, drawn on a GPU or software Vulkan, as one program: what they share is compiled, linked and made once.

mod codecs;
mod dct;
mod drawing;
mod hardware;
mod layout;
mod light;
mod material;
mod support;
mod tiles;
mod twins;
mod update;
