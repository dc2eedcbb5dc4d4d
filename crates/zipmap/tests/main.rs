//! Tests of zoom stacks, as one program: what they share is compiled, linked and made once.

mod cancel;
mod hard;
mod photos;
mod stacks;
