//! Tests of epitomes, as one program: what they share is compiled, linked and made once.

mod blocks;
mod cancel;
mod edges;
mod encode;
mod errors;
mod layers;
mod support;
mod transforms;
