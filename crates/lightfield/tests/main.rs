//! Tests of light fields, as one program: what they share is compiled, linked and made once.

mod blocks;
mod cancel;
mod hard;
mod hostile;
mod sphere;
