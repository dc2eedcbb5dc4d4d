//! Tests of codec `progressive`, as one program: what they share is compiled, linked and made once.

mod block;
mod goals;
mod texel;
