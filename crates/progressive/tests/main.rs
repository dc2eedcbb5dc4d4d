//! Tests of codec `progressive`, as one program: what they share is compiled, linked and made once.

mod goals;
mod texel;
