//! Tests of the WGSL, as one program: what they share is compiled, linked and made once.

mod twins;
mod validate;
