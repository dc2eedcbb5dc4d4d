//! Zoom-into-parts texture maps: photographs of one surface at several scales as one texture.
//!
//! So far: [`register`], which puts an unordered folder of photographs in order.

mod linear;
mod register;

pub use register::{Agreement, Fault, LeftOut, Link, Placed, Registration, register};
