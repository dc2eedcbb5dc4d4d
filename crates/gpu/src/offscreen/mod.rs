//! Drawing off screen, reading back, timing: what tests, benches and command lines need, and renderers do not.

mod dct;
mod light;
mod mesh;
mod pipeline;
mod quad;
mod readback;
mod timing;
mod view;

pub(crate) use pipeline::Pipelines;
pub use quad::Lod;
pub use timing::Probe;
pub use view::{Filter, Lookup, View};
